"""The units that a map may name, and their factors to SI; a magnetic field comes out in gauss."""

from __future__ import annotations

import numpy as np

from sinan.sensors.constants import STANDARD_GRAVITY, ZERO_CELSIUS

_DEGREE = np.pi / 180.0
_FOOT = 0.3048  # m, exact since 1959
_KNOT = 1852.0 / 3600.0  # m/s, exact

#: What a column may be, and the units it may be in: SI value = factor * value + offset.
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "acceleration": {
        "m/s^2": (1.0, 0.0),
        "g": (STANDARD_GRAVITY, 0.0),
        "mg": (1e-3 * STANDARD_GRAVITY, 0.0),
    },
    "rate": {
        "rad/s": (1.0, 0.0),
        "deg/s": (_DEGREE, 0.0),
        "mdeg/s": (1e-3 * _DEGREE, 0.0),
    },
    "field": {
        "gauss": (1.0, 0.0),
        "mGauss": (1e-3, 0.0),
        "T": (1e4, 0.0),
        "uT": (1e-2, 0.0),
        "nT": (1e-5, 0.0),
    },
    "length": {
        "m": (1.0, 0.0),
        "cm": (1e-2, 0.0),
        "mm": (1e-3, 0.0),
        "km": (1e3, 0.0),
        "ft": (_FOOT, 0.0),
    },
    "speed": {
        "m/s": (1.0, 0.0),
        "cm/s": (1e-2, 0.0),
        "mm/s": (1e-3, 0.0),
        "km/h": (1.0 / 3.6, 0.0),
        "kn": (_KNOT, 0.0),
    },
    "pressure": {
        "Pa": (1.0, 0.0),
        "hPa": (1e2, 0.0),
        "mbar": (1e2, 0.0),
        "kPa": (1e3, 0.0),
    },
    "temperature": {
        "degC": (1.0, 0.0),
        "K": (1.0, -ZERO_CELSIUS),
        "degF": (5.0 / 9.0, -160.0 / 9.0),
    },
    "current": {"A": (1.0, 0.0), "mA": (1e-3, 0.0)},
    "voltage": {"V": (1.0, 0.0), "mV": (1e-3, 0.0)},
    "angle": {"rad": (1.0, 0.0), "deg": (_DEGREE, 0.0)},
    "degrees": {"deg": (1.0, 0.0), "1e-7 deg": (1e-7, 0.0), "rad": (1.0 / _DEGREE, 0.0)},
    "time": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0)},
    "ratio": {"1": (1.0, 0.0), "percent": (1e-2, 0.0)},
    "number": {"1": (1.0, 0.0)},
}
#: That of a magnetometer's readings of which a map names the unit.
FIELD_UNIT = "gauss"
#: Named for readings without a unit of their own: nothing is changed.
COUNT = "count"
