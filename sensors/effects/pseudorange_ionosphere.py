"""`pseudorange.ionosphere`: the free electrons slow the code down."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

REFERENCE_FREQUENCY = 1575.42e6  # Hz, GPS L1, for which the broadcast coefficients hold
NIGHT = 5.0e-9  # s, vertical delay at night


def obliquity(elevation: FloatArray) -> FloatArray:
    """(n,) slant over vertical delay: 1 + 16 (0.53 - E / pi)^3."""
    return 1.0 + 16.0 * (0.53 - elevation / np.pi) ** 3


def klobuchar(
    coefficients: FloatArray,
    latitude: FloatArray,
    longitude: FloatArray,
    elevation: FloatArray,
    azimuth: FloatArray,
    t: FloatArray,
) -> FloatArray:
    """(n,) slant delay on L1 [m] by the broadcast model; angles inside are in semicircles, as in the source.

    Parameters
    ----------
    coefficients : (n, 8) alpha_0..3, beta_0..3
    latitude, longitude : (n,) of the receiver [rad]
    elevation, azimuth : (n,) of the satellite [rad]
    t : (n,) GPS time [s], of day or of week
    """
    E = np.maximum(elevation, 0.0) / np.pi
    psi = 0.0137 / (E + 0.11) - 0.022  # angle at the Earth's centre
    phi_i = np.clip(latitude / np.pi + psi * np.cos(azimuth), -0.416, 0.416)  # pierce point
    lambda_i = longitude / np.pi + psi * np.sin(azimuth) / np.cos(phi_i * np.pi)
    phi_m = phi_i + 0.064 * np.cos((lambda_i - 1.617) * np.pi)  # geomagnetic latitude
    local = (43200.0 * lambda_i + t) % 86400.0
    powers = np.stack([np.ones_like(phi_m), phi_m, phi_m**2, phi_m**3], axis=-1)
    amplitude = np.maximum(np.sum(coefficients[:, :4] * powers, axis=1), 0.0)
    period = np.maximum(np.sum(coefficients[:, 4:] * powers, axis=1), 72000.0)
    x = 2.0 * np.pi * (local - 50400.0) / period
    day = np.where(np.abs(x) < 1.57, amplitude * (1.0 - x**2 / 2.0 + x**4 / 24.0), 0.0)
    return SPEED_OF_LIGHT * obliquity(np.maximum(elevation, 0.0)) * (NIGHT + day)


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) Klobuchar's slant delay [m] for b = 1; without coefficients the slant delay of 1 m at the zenith.

    Other frequencies than L1 see (f_1 / f)^2 of it.
    """
    elevation = motion.covariates["elevation"]
    dispersion = (REFERENCE_FREQUENCY / motion.covariates["frequency"]) ** 2
    if not motion.has("klobuchar"):
        return (dispersion * obliquity(elevation))[:, None, None]
    delay = klobuchar(
        motion.covariates["klobuchar"],
        motion.covariates["latitude"],
        motion.covariates["longitude"],
        elevation,
        motion.covariates["azimuth"],
        motion.t,
    )
    return (dispersion * delay)[:, None, None]


EFFECT = Effect(
    name="pseudorange.ionosphere",
    stream="pseudorange",
    summary="The pseudorange is too long by the delay in the ionosphere.",
    enters="range += b x Klobuchar's slant delay,  b = 1 in full; without coefficients b x obliquity",
    physics=(
        "Free electrons between 50 and 1000 km delay the code by 40.3 TEC / f^2: 1 to 30 m at the zenith, up to three "
        "times that near the horizon. The broadcast model takes about half of it away. The delay is positive; the "
        "course's d_iono is the correction added to the pseudorange, that is minus the delay. Neglected: everything "
        "finer than the model's one cosine a day."
    ),
    source="IS-GPS-200N, 20.3.3.5.2.5 and fig. 20-4; J. A. Klobuchar, IEEE Trans. AES 23 (1987) 325",
    parameters=(Parameter("share, or zenith delay without coefficients", "1 or m", 1.0),),
    needs=("elevation", "azimuth", "latitude", "longitude", "frequency"),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="a second frequency, or several hours of a day",
)
