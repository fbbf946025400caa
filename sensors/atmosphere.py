"""The standard atmosphere (ISO 2533:1975) up to 11 km and the speed of sound: what the barometer and sonar need."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import (
    GAS_CONSTANT_AIR,
    HEAT_CAPACITY_RATIO_AIR,
    LAPSE_RATE,
    SEA_LEVEL_PRESSURE,
    SEA_LEVEL_TEMPERATURE,
    STANDARD_GRAVITY,
    ZERO_CELSIUS,
)

_EXPONENT = STANDARD_GRAVITY / (GAS_CONSTANT_AIR * LAPSE_RATE)  # 5.2559


def pressure_from_height(height: FloatArray) -> FloatArray:
    """Pressure [Pa] at geopotential height [m], troposphere: p = p0 (1 - L h / T0)^(g / (R L)). ISO 2533 eq. 12."""
    return np.asarray(SEA_LEVEL_PRESSURE * (1.0 - LAPSE_RATE * np.asarray(height) / SEA_LEVEL_TEMPERATURE) ** _EXPONENT)


def height_from_pressure(pressure: FloatArray, reference: float = SEA_LEVEL_PRESSURE) -> FloatArray:
    """Geopotential height [m] above the level where the pressure is `reference` [Pa].

    h = T0 / L (1 - (p / p_ref)^(R L / g)): the air at the reference level is taken to have 15 degC.

    Neglects weather (pressure at sea level), a lapse other than 6.5 K/km (`baro.scale`), humidity.

    Raises
    ------
    ValueError : pressure not positive
    """
    pressure = np.asarray(pressure, dtype=np.float64)
    if np.any(pressure <= 0.0) or reference <= 0.0:
        raise ValueError("`pressure` holds values that are not positive; expected Pa, near 101325 at sea level")
    return np.asarray(SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - (pressure / reference) ** (1.0 / _EXPONENT)))


def speed_of_sound(temperature: FloatArray) -> FloatArray:
    """Speed of sound in dry air [m/s] at `temperature` [degC]: sqrt(gamma R T). ISO 2533 eq. 22.

    Neglects humidity (+0.3 % at 20 degC and saturation).
    """
    return np.asarray(np.sqrt(HEAT_CAPACITY_RATIO_AIR * GAS_CONSTANT_AIR * (np.asarray(temperature) + ZERO_CELSIUS)))
