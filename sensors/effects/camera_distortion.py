"""camera.distortion: the lens bends straight lines more than declared."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.camera import Camera
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.lenses import bend_slopes
from sinan.sensors.motion import Motion

RADIAL, TANGENTIAL = 0.2, 0.002  # 1; lenses of small cameras, and how askew they sit


def regressor(motion: Motion) -> FloatArray:
    """(n, 2, 4): f times d bend / d (k1, k2, p1, p2) at the undistorted place in the plane, as a Brown lens has it."""
    camera = Camera.of(motion)
    P = camera.points_c(motion)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = P[:, :2] / np.where(P[:, 2] > 0.0, P[:, 2], np.nan)[:, None]
    _, by_k = bend_slopes(xy, np.zeros(4))
    return np.asarray(camera.intrinsics.f[:, None] * by_k)


EFFECT = Effect(
    name="camera.distortion",
    stream="camera",
    summary="The camera's lens bends straight lines.",
    enters="x += x (k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2), y likewise; (x, y) = (X, Y) / Z",
    physics=(
        "Radial distortion (k1, k2) by the glass, tangential (p1, p2) by a lens that sits askew, added to the "
        "coefficients that are declared. Exact for a Brown lens, for points ahead of the camera."
    ),
    source="D. C. Brown, Photogrammetric Engineering 37(8), 1971; coefficients as OpenCV's",
    parameters=(
        Parameter("k1", "1", RADIAL),
        Parameter("k2", "1", RADIAL),
        Parameter("p1", "1", TANGENTIAL),
        Parameter("p2", "1", TANGENTIAL),
    ),
    needs=("p_n", "q_nb", "point_n", "camera"),
    regressor=regressor,
    separates="points near the edges and near the middle of the picture",
)
