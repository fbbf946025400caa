"""camera.principal_point: the axis of the lens meets the picture elsewhere than declared."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 10.0  # pixels; sensors are glued under lenses to a tenth of a millimetre


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 2) the unit matrix."""
    return np.broadcast_to(np.eye(2), (len(motion), 2, 2))


EFFECT = Effect(
    name="camera.principal_point",
    stream="camera",
    summary="The camera's principal point is not the one declared.",
    enters="u += b_u, v += b_v",
    physics=(
        "The lens's axis meets the sensor at (u0 + b_u, v0 + b_v). Exact. To first order a small turn of the camera "
        "about its x or y axis does the same near the middle of the picture: a `camera.misalignment`."
    ),
    source="R. Hartley, A. Zisserman, Multiple View Geometry, 2nd edition, 2004, section 6.1",
    parameters=(Parameter("u", "pixel", PLAUSIBLE), Parameter("v", "pixel", PLAUSIBLE)),
    needs=("p_n", "q_nb", "point_n", "camera"),
    regressor=regressor,
    separates="points all over the picture, turns about the camera's axis",
)
