"""What a camera reads of known points: a pinhole with a bent picture, and its effects, written once more.

    (X, Y, Z) = D' (C' (m - p) - r),   D = Exp(turn) D_0,   r = r_0 + arm
    x, y = X / Z, Y / Z;   s = 1 + k1 q + k2 q^2,  q = x^2 + y^2
    u = f (1 + b_u) (s x + 2 p1 x y + p2 (q + 2 x^2)) + c_u,   v likewise with p1 and p2 changed round

Source: D. C. Brown, Photogrammetric Engineering 37(8), 1971.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.maker.turning import exp_rotation, mat_vec
from sinan.sensors.arrays import BoolArray, FloatArray

#: Effects by the field of `Pinhole` that they change.
CHANGES = {
    "camera.focal": "stretch",
    "camera.principal_point": "shift",
    "camera.distortion": "bend",
    "camera.misalignment": "turn",
    "camera.lever_arm": "arm",
}
#: A point nearer than this to the plane of the lens is not seen [m].
NEAREST = 0.3


@dataclass(frozen=True)
class Pinhole:
    """A camera as it is.

    Attributes
    ----------
    focal : (2,) [pixels]
    size : (2,) of the picture [pixels]; the principal point that is declared is its middle
    axes : (3, 3) D_0, columns are the camera's axes in the body, as declared
    place : (3,) r_0 of the lens in the body, as declared [m]
    stretch, shift, bend, turn, arm : what differs from what is declared: (2,) [1], (2,) [pixels], (4,) k1, k2, p1, p2,
        (3,) [rad], (3,) [m]
    """

    focal: FloatArray
    size: FloatArray
    axes: FloatArray
    place: FloatArray
    stretch: FloatArray = field(default_factory=lambda: np.zeros(2))
    shift: FloatArray = field(default_factory=lambda: np.zeros(2))
    bend: FloatArray = field(default_factory=lambda: np.zeros(4))
    turn: FloatArray = field(default_factory=lambda: np.zeros(3))
    arm: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def middle(self) -> FloatArray:
        """(2,) principal point as declared [pixels]."""
        return 0.5 * (self.size - 1.0)

    def with_effects(self, hidden: Sequence[Hidden]) -> Pinhole:
        """The same with what a recording hides."""
        return replace(self, **{CHANGES[one.name]: one.beta for one in hidden if one.name in CHANGES})

    def in_front(self, body: Body, marks: FloatArray) -> FloatArray:
        """(n, 3) of marks (n, 3) NED in the camera's axes [m]."""
        axes = exp_rotation(self.turn[None])[0] @ self.axes
        seen_b = mat_vec(np.swapaxes(body.C, 1, 2), marks - body.p)
        return np.asarray((seen_b - self.place - self.arm) @ axes)

    def pixels(self, body: Body, marks: FloatArray) -> FloatArray:
        """(n, 2) u, v of marks (n, 3) NED, one for each instant of `body`; not a number behind the lens."""
        X = self.in_front(body, marks)
        ahead = X[:, 2] > NEAREST
        x, y = (np.divide(X[:, k], X[:, 2], out=np.full(len(X), np.nan), where=ahead) for k in (0, 1))
        k1, k2, p1, p2 = self.bend
        q = x * x + y * y
        s = 1.0 + k1 * q + k2 * q * q
        bent = np.stack([
            s * x + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
            s * y + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
        ], axis=1)  # fmt: skip
        return np.asarray(self.focal * (1.0 + self.stretch) * bent + self.middle + self.shift)

    def inside(self, uv: FloatArray) -> BoolArray:
        """(n,) whether pixels are in the picture."""
        return np.asarray(np.all((uv > -0.5) & (uv < self.size - 0.5), axis=1))
