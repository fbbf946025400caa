"""`pseudorange.earth_rotation`: the Earth turns while the signal travels."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import EARTH_RATE, SPEED_OF_LIGHT
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion


def sagnac(satellite_e: FloatArray, receiver_e: FloatArray) -> FloatArray:
    """(n,) lengthening of the path to first order: (w_e / c) (x_s y_r - y_s x_r) [m]."""
    return EARTH_RATE / SPEED_OF_LIGHT * (satellite_e[:, 0] * receiver_e[:, 1] - satellite_e[:, 1] * receiver_e[:, 0])


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1) metres for b = 1."""
    satellite_e, receiver_e = motion.covariates["satellite_position"], motion.covariates["receiver_position"]
    return sagnac(satellite_e, receiver_e)[:, None, None]


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """|Rz(w tau) p_s - p_r| - |p_s - p_r| added to the plain range; tau, the time of travel, by three iterations."""
    satellite_e, receiver_e = motion.covariates["satellite_position"], motion.covariates["receiver_position"]
    straight = np.linalg.norm(satellite_e - receiver_e, axis=1)
    path = straight
    for _ in range(3):
        angle = beta[0] * EARTH_RATE * path / SPEED_OF_LIGHT
        x = np.cos(angle) * satellite_e[:, 0] + np.sin(angle) * satellite_e[:, 1]
        y = -np.sin(angle) * satellite_e[:, 0] + np.cos(angle) * satellite_e[:, 1]
        path = np.linalg.norm(np.stack([x, y, satellite_e[:, 2]], axis=-1) - receiver_e, axis=1)
    return np.asarray(plain + (path - straight)[:, None])


EFFECT = Effect(
    name="pseudorange.earth_rotation",
    stream="pseudorange",
    summary="The pseudorange is longer or shorter because the Earth turns by w tau while the signal travels.",
    enters="range += b (w_e / c) (x_s y_r - y_s x_r),  b = 1 in full",
    physics=(
        "The satellite's position is computed in the frame that turns with the Earth, at the instant of transmission; "
        "until reception that frame turns by 5 microradians. To first order the range changes by (w_e / c) times twice "
        "the area swept in the equatorial plane, up to 40 m, which is very nearly what a shift of the receiver to the "
        "east by 20 to 40 m does: what is left in the residuals of one fix is below a metre. The first-order form is "
        "right to a millimetre. A known position, or satellites at very different distances, reveal it."
    ),
    source="N. Ashby, Relativity in the Global Positioning System, Living Reviews in Relativity 6 (2003) 1, eq. 16",
    parameters=(Parameter("share", "1", 1.0),),
    needs=("satellite_position", "receiver_position"),
    regressor=regressor,
    exact=exact,
    kinds=frozenset({"pseudoranges"}),
    separates="a receiver at a known position, or satellites of medium and of geosynchronous orbits together",
)
