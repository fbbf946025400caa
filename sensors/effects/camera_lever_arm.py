"""camera.lever_arm: the camera sits elsewhere on the body than declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.1  # m; the size of a multicopter's frame


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 3): -J C_cb."""
    return -Camera.of(motion).by_body(motion)


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """Seen from l_b + b."""
    camera = Camera.of(motion)
    return replace(camera, l_b=camera.l_b + np.asarray(beta, dtype=np.float64)).predict(motion)


EFFECT = Effect(
    name="camera.lever_arm",
    stream="camera",
    summary="The camera sits elsewhere on the body than declared.",
    enters="P_c = C_cb (P_b - l_b - b)",
    physics=(
        "The lens's centre is at l_b + b from the body's reference point: near points are moved more than far ones, "
        "and the move turns with the body. Exact."
    ),
    source="M. Li, A. I. Mourikis, International Journal of Robotics Research 32(6), 2013 (camera-to-IMU calibration)",
    parameters=(Parameter("x", "m", PLAUSIBLE), Parameter("y", "m", PLAUSIBLE), Parameter("z", "m", PLAUSIBLE)),
    needs=("p_n", "q_nb", "point_n", "camera"),
    regressor=regressor,
    exact=exact,
    separates="turns about several axes near the points",
)
