"""camera.misalignment: the camera is turned against the mounting declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import rotation_exp, skew

PLAUSIBLE = 0.05  # rad; a module glued by hand is straight to some degrees


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 3): J C_cb [P_b - l_b]x, since Exp(-b) v = v + [v]x b to first order."""
    camera = Camera.of(motion)
    return np.asarray(camera.by_body(motion) @ skew(camera.points_b(motion) - camera.l_b))


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """The whole rotation: C_cb Exp(-b)."""
    camera = Camera.of(motion)
    return replace(camera, C_bc=rotation_exp(np.asarray(beta, dtype=np.float64)) @ camera.C_bc).predict(motion)


EFFECT = Effect(
    name="camera.misalignment",
    stream="camera",
    summary="The camera is turned against the mounting declared.",
    enters="P_c = C_cb Exp(-b) (P_b - l_b)",
    physics=(
        "The camera looks along Exp(b) C_bc instead of C_bc, b in body axes: every point is moved alike, whatever its "
        "distance. The whole rotation is used."
    ),
    source="M. Li, A. I. Mourikis, International Journal of Robotics Research 32(6), 2013 (camera-to-IMU calibration)",
    parameters=(Parameter("x", "rad", PLAUSIBLE), Parameter("y", "rad", PLAUSIBLE), Parameter("z", "rad", PLAUSIBLE)),
    needs=("p_n", "q_nb", "point_n", "camera"),
    regressor=regressor,
    exact=exact,
    separates="turns about several axes",
)
