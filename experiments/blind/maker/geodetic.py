"""NED at an origin to geodetic coordinates on WGS-84, by the Cartesian frame and Bowring's iteration."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import WGS84_A, WGS84_INVERSE_FLATTENING

_E2 = (2.0 - 1.0 / WGS84_INVERSE_FLATTENING) / WGS84_INVERSE_FLATTENING


def to_geodetic(p_n: FloatArray, origin: tuple[float, float, float]) -> FloatArray:
    """(n, 3) latitude [deg], longitude [deg], height [m] of NED positions (n, 3)."""
    lat, lon = np.radians(origin[:2])
    n, e, d = p_n.T
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    radius = WGS84_A / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    at_origin = (radius + origin[2]) * up - np.array([0.0, 0.0, radius * _E2 * np.sin(lat)])
    x, y, z = (at_origin + np.outer(n, north) + np.outer(e, east) - np.outer(d, up)).T
    return cartesian_to_geodetic(x, y, z)


def cartesian_to_geodetic(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """(n, 3) by fixed-point iteration of tan(lat) = (z + e^2 N sin(lat)) / p, which gains three digits a round."""
    p = np.hypot(x, y)
    lat = np.arctan2(z, p * (1.0 - _E2))
    for _ in range(8):
        radius = WGS84_A / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
        lat = np.arctan2(z + _E2 * radius * np.sin(lat), p)
    radius = WGS84_A / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    height = p * np.cos(lat) + z * np.sin(lat) - WGS84_A**2 / radius
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), height], axis=-1)
