"""`pseudorange.troposphere`: the neutral atmosphere slows the signal down."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import LAPSE_RATE, SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

RELATIVE_HUMIDITY = 0.7  # 1, assumed where no weather is known; 0.1 of it is 1.5 cm of zenith delay at 15 degC
HIGHEST = 11000.0  # m: the standard atmosphere's lapse rate ends there


def mapping(elevation: FloatArray) -> FloatArray:
    """(n,) slant over zenith delay: 1.001 / sqrt(0.002001 + sin^2 E), good from 5 deg on (Black and Eisner 1984)."""
    return 1.001 / np.sqrt(0.002001 + np.sin(elevation) ** 2)


def zenith_delay(latitude: FloatArray, height: FloatArray) -> FloatArray:
    """Saastamoinen's zenith delay [m] in the standard atmosphere with 70 % humidity.

    dry = 0.0022768 p / (1 - 0.00266 cos 2 phi - 0.00028 h / km),  wet = 0.0022768 (1255 / T + 0.05) e,  p and e in hPa

    Parameters
    ----------
    latitude : (n,) [rad]
    height : (n,) above the ellipsoid [m]; taken as the height above the sea, and held within 0 to 11 km
    """
    h = np.clip(height, 0.0, HIGHEST)
    T = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * h
    p_hpa = SEA_LEVEL_PRESSURE / 100.0 * (1.0 - 2.2557e-5 * h) ** 5.2568
    saturation_hpa = 6.108 * np.exp((17.15 * T - 4684.0) / (T - 38.45))
    dry = 0.0022768 * p_hpa / (1.0 - 0.00266 * np.cos(2.0 * latitude) - 0.00028e-3 * h)
    wet = 0.0022768 * (1255.0 / T + 0.05) * RELATIVE_HUMIDITY * saturation_hpa
    return np.asarray(dry + wet)


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) slant delay for a zenith delay of one metre."""
    return mapping(motion.covariates["elevation"])[:, None, None]


EFFECT = Effect(
    name="pseudorange.troposphere",
    stream="pseudorange",
    summary="The pseudorange is too long by the delay in the neutral atmosphere.",
    enters="range += b m(elevation),  m the mapping function",
    physics=(
        "Dry air and water vapour delay the signal by 2.3 to 2.6 m at the zenith at sea level, in proportion to the "
        "path through them: five times that at 11 degrees. Mostly a function of height; unmodelled it lowers or raises "
        "the fix by several metres. Neglected: weather (some centimetres dry, a decimetre wet) and gradients. The "
        "saturation pressure is Magnus's."
    ),
    source=(
        "J. Saastamoinen, AGU Geophysical Monograph 15 (1972) 247; H. D. Black, A. Eisner, J. Geophys. Res. 89 (1984) "
        "2616; humidity as in the RTKLIB 2.4.2 manual, E.5"
    ),
    parameters=(Parameter("zenith delay", "m", 2.4),),
    needs=("elevation",),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="satellites near the horizon",
)
