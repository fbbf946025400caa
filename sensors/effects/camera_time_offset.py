"""camera.time_offset: the time stamps of the pictures are late."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.05  # s; exposure, readout and USB of small cameras


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 1): -d pixel / dt = -(H_position v_n + H_attitude w_ib_b)."""
    H = Camera.of(motion).jacobian(motion)
    rate = np.einsum("nij,nj->ni", H["position"], motion.v_n) + np.einsum("nij,nj->ni", H["attitude"], motion.w_ib_b)
    return -rate[:, :, None]


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """The same points from where the body was at t - b."""
    earlier = motion.at(motion.t - beta[0]).with_covariates(**motion.covariates)
    return Camera.of(motion).predict(earlier)


EFFECT = Effect(
    name="camera.time_offset",
    stream="camera",
    summary="The camera's time stamps are late.",
    opposite="The camera's time stamps are early.",
    enters="pixel -> that of t - b",
    physics=(
        "The picture was taken at t - b, b > 0 if it is stamped after it was exposed: exposure, readout, transfer, or "
        "another clock. The picture at t - b is used, not its first order. The clock is that of the IMU."
    ),
    source="M. Li, A. I. Mourikis, International Journal of Robotics Research 33(7), 2014",
    parameters=(Parameter("b", "s", PLAUSIBLE),),
    needs=("p_n", "v_n", "q_nb", "w_ib_b", "point_n", "camera"),
    regressor=regressor,
    exact=exact,
    other_instants=True,
    separates="quick turns",
)
