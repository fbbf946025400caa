"""The Earth's magnetic field at a place and date: World Magnetic Model through pygeomag, else IGRF through ppigrf."""

from __future__ import annotations

from datetime import date as Date
from datetime import datetime

import numpy as np

from sinan.sensors.arrays import FloatArray

NANOTESLA = 1e-9  # T
FIRST_YEAR, LAST_YEAR = 1900.0, 2030.0  # years that IGRF-14 covers

#: A recording has no date: dip and declination of most places move by 0.1 deg a year.
EPOCH = Date(2020, 1, 1)
#: 1-sigma of declination and dip of a place so found [rad]: five years of that, and what the crust and the model leave
#: (0.38 and 0.2 deg; error model of the World Magnetic Model, technical report of its 2020 release, section 3).
DIRECTION_STD = (np.deg2rad(0.63), np.deg2rad(0.54))

#: first and last decimal year of each release of the World Magnetic Model, and its file
_RELEASES = (
    (2010.0, 2015.0, "wmm/WMM_2010.COF"),
    (2015.0, 2020.0, "wmm/WMM_2015v2.COF"),
    (2020.0, 2025.0, "wmm/WMM_2020.COF"),
    (2025.0, 2030.0, "wmm/WMM_2025.COF"),
)


def decimal_year(date: Date) -> float:
    """The date as a year and its fraction; noon of the day."""
    start, end = Date(date.year, 1, 1), Date(date.year + 1, 1, 1)
    return date.year + ((date - start).days + 0.5) / (end - start).days


def earth_field(latitude_deg: float, longitude_deg: float, height: float, date: Date) -> FloatArray:
    """The field in NED [T].

    From 2010 to 2030 the release of the World Magnetic Model whose five years hold the date, before it the
    International Geomagnetic Reference Field.

    Parameters
    ----------
    latitude_deg, longitude_deg : geodetic [deg]
    height : above the ellipsoid [m]
    date : of the measurement; the field changes by some 0.1 % a year

    Neglects the crust's field (100 nT and more near iron) and the daily variation (20 to 100 nT).

    Raises
    ------
    ValueError : a date that no model covers, a latitude beyond the poles
    """
    if not abs(latitude_deg) <= 90.0:
        raise ValueError(f"`latitude_deg` is {latitude_deg:g}; expected -90 to 90")
    year = decimal_year(date)
    for first, last, file in _RELEASES:
        if first <= year < last:
            return _world_magnetic_model(latitude_deg, longitude_deg, height, year, file)
    if FIRST_YEAR <= year < LAST_YEAR:
        return _reference_field(latitude_deg, longitude_deg, height, date)
    raise ValueError(
        f"`date` is {date}; expected {FIRST_YEAR:.0f} to {LAST_YEAR - 1:.0f}, the years of the field models"
    )


def declination(field_n: FloatArray) -> float:
    """Angle of the horizontal field from north, positive to the east [rad]."""
    return float(np.arctan2(field_n[1], field_n[0]))


def inclination(field_n: FloatArray) -> float:
    """Angle of the field below the horizontal, the dip [rad]."""
    return float(np.arctan2(field_n[2], np.hypot(field_n[0], field_n[1])))


def field_along(norm: float, dip: float, east: float) -> FloatArray:
    """(3,) field in NED of a norm, inclination `dip` and declination `east` [rad]."""
    level = norm * np.cos(dip)
    return np.array([level * np.cos(east), level * np.sin(east), norm * np.sin(dip)])


def _world_magnetic_model(
    latitude_deg: float, longitude_deg: float, height: float, year: float, file: str
) -> FloatArray:
    from pygeomag import GeoMag

    result = GeoMag(coefficients_file=file).calculate(
        glat=latitude_deg, glon=(longitude_deg + 180.0) % 360.0 - 180.0, alt=height / 1000.0, time=year
    )
    return np.array([result.x, result.y, result.z], dtype=np.float64) * NANOTESLA


def _reference_field(latitude_deg: float, longitude_deg: float, height: float, date: Date) -> FloatArray:
    from ppigrf import igrf

    east, north, up = igrf(longitude_deg, latitude_deg, height / 1000.0, datetime(date.year, date.month, date.day))
    return np.array([north.item(), east.item(), -up.item()]) * NANOTESLA


def direction_at(origin: tuple[float, float, float]) -> tuple[float, float]:
    """Dip and declination of the Earth's field at a place [rad]; latitude and longitude in deg, height in m."""
    field_n = earth_field(*origin, EPOCH)
    return inclination(field_n), declination(field_n)
