"""Normal gravity of the WGS-84 ellipsoid; geodesy itself is pymap3d's."""

from __future__ import annotations

import numpy as np

from sinan.sensors.constants import (
    EARTH_RATE,
    GRAVITY_EQUATOR,
    GRAVITY_FORMULA,
    WGS84_A,
    WGS84_GM,
    WGS84_INVERSE_FLATTENING,
)


def normal_gravity(latitude: float, height: float) -> float:
    """Normal gravity [m/s^2] at a geodetic latitude [rad] and ellipsoidal height [m].

    On the ellipsoid Somigliana's closed formula,
        gamma_0 = gamma_e (1 + k sin^2 lat) / sqrt(1 - e^2 sin^2 lat),
    above it the Taylor series in h / a to the second order (to 1e-6 m/s^2 below 10 km),
        gamma = gamma_0 (1 - 2 / a (1 + f + m - 2 f sin^2 lat) h + 3 / a^2 h^2),  m = w^2 a^2 b / GM.

    Neglects gravity anomalies (up to 1e-3 m/s^2) and the deflection of the vertical.

    Source: NIMA TR8350.2, 3rd ed., eq. 4-1 and 4-3.
    """
    f = 1.0 / WGS84_INVERSE_FLATTENING
    e2 = f * (2.0 - f)
    s2 = float(np.sin(latitude) ** 2)
    m = EARTH_RATE**2 * WGS84_A**3 * (1.0 - f) / WGS84_GM
    on_ellipsoid = GRAVITY_EQUATOR * (1.0 + GRAVITY_FORMULA * s2) / np.sqrt(1.0 - e2 * s2)
    falls = 1.0 - 2.0 / WGS84_A * (1.0 + f + m - 2.0 * f * s2) * height + 3.0 * (height / WGS84_A) ** 2
    return float(on_ellipsoid * falls)
