"""What the last digit of latitude, longitude and height hides of a place."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.geodetic import Origin, geodetic_columns, ned_columns
from sinan.sensors.last_digit import last_digit, rounding_variance
from sinan.sensors.recording import POSITION


def rounding_of_places(ned: FloatArray, origin: Origin | None) -> FloatArray:
    """(3,) variance of the error of rounding of fixes (n, 3) in NED [m^2].

    The digits are those of latitude, longitude and height where an origin is known, else of NED. An angle that never
    changes shows none: it is taken to have those of the other one. A height that never changes has zero.
    """
    if origin is None:
        return rounding_variance(ned)
    lla = geodetic_columns(ned, origin)
    latitude, longitude, height = (last_digit(column) for column in lla.T)
    steps = np.array([latitude or longitude, longitude or latitude, height])
    about = np.median(lla, axis=0)
    moved = ned_columns(np.vstack([about, about + np.diag(steps)]), origin)
    places = np.column_stack([moved[axis] for axis in POSITION])
    variance = np.sum((places[1:] - places[0]) ** 2, axis=0) / 12.0
    return variance * [1.0, 1.0, height > 0.0]  # not what an angle's digit turns
