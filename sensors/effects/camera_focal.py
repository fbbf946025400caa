"""camera.focal: the focal length is not the one declared."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.02  # 1; lenses are made to some per cent of their focal length, and breathe as they are focused


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 2): u - u0 and v - v0 on the diagonal."""
    camera = Camera.of(motion)
    from_centre = camera.predict(motion) - camera.intrinsics.centre
    return np.asarray(from_centre[:, :, None] * np.eye(2))


EFFECT = Effect(
    name="camera.focal",
    stream="camera",
    summary="The camera's focal length is not the one declared.",
    enters="u += b_x (u - u0), v += b_y (v - v0)",
    physics=(
        "f_x (1 + b_x) and f_y (1 + b_y): the picture is larger or smaller about the principal point. Exact. A camera "
        "that flies straight ahead towards points of one distance shows the same from another place."
    ),
    source="R. Hartley, A. Zisserman, Multiple View Geometry, 2nd edition, 2004, section 6.1",
    parameters=(Parameter("x", "1", PLAUSIBLE), Parameter("y", "1", PLAUSIBLE)),
    needs=("p_n", "q_nb", "point_n", "camera"),
    regressor=regressor,
    separates="points at several distances, near the edges of the picture",
)
