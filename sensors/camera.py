"""Camera: a known point of the world as a pixel. The course, section 8, figures 7.18 and 7.19.

The course's three steps: from the Earth to the camera (M2), from the camera to the image plane (the lens, with f), from
the image plane to pixels (dX, dY, u0, v0; with f these are M1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sinan.sensors.arrays import FloatArray, as_floats
from sinan.sensors.lenses import LENSES, Lens
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_matrix, rotate_back, skew
from sinan.sensors.sensor_type import SensorType

#: A camera that looks ahead: its x is body right, its y body down, its z body forward. Columns are the camera's axes.
LOOKS_AHEAD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Intrinsics:
    """What turns a point in the camera into a pixel.

    u = f_x x_d + u0,  v = f_y y_d + v0,  (x_d, y_d) = lens(P_c, k)

    Pixel (0, 0) is the centre of the upper left one, u to the right, v down.

    Attributes
    ----------
    f : (2,) focal lengths f / dX, f / dY [pixels]
    centre : (2,) principal point u0, v0 [pixels]
    lens : a name of `sensors.lenses.LENSES`
    k : coefficients of the lens, missing ones are zero
    """

    f: FloatArray
    centre: FloatArray
    lens: str = "brown"
    k: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.lens not in LENSES:
            raise ValueError(f"`lens` is {self.lens!r}; expected one of {', '.join(LENSES)}")
        object.__setattr__(self, "f", as_floats("f", self.f, (2,), "f / dX, f / dY in pixels"))
        object.__setattr__(self, "centre", as_floats("centre", self.centre, (2,), "u0, v0 in pixels"))
        k = np.asarray(self.k, dtype=np.float64)
        names = LENSES[self.lens].coefficients
        if k.ndim != 1 or len(k) > len(names):
            raise ValueError(f"`k` has shape {k.shape}; a {self.lens} lens has at most {', '.join(names)}")
        object.__setattr__(self, "k", np.pad(k, (0, len(names) - len(k))))

    @staticmethod
    def from_millimetres(f: float, dX: float, dY: float, u0: float, v0: float) -> Intrinsics:
        """The course's camera: focal length f and size of a pixel dX, dY in one unit, principal point in pixels."""
        return Intrinsics(np.array([f / dX, f / dY]), np.array([u0, v0]))

    @property
    def model(self) -> Lens:
        """The lens."""
        return LENSES[self.lens]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the entries of `values`."""
        return ("f_x", "f_y", "u0", "v0", *self.model.coefficients)

    @property
    def values(self) -> FloatArray:
        """(4 + coefficients,) f_x, f_y, u0, v0, k."""
        return np.concatenate([self.f, self.centre, self.k])

    def with_values(self, values: FloatArray) -> Intrinsics:
        """The same lens with other `values`."""
        return replace(self, f=values[:2], centre=values[2:4], k=values[4:])

    @property
    def M1(self) -> FloatArray:
        """(3, 4) from the camera to pixels without distortion: s (u, v, 1) = M1 (P_c, 1)."""
        return np.array(
            [[self.f[0], 0.0, self.centre[0], 0.0], [0.0, self.f[1], self.centre[1], 0.0], [0.0, 0.0, 1.0, 0.0]]
        )

    def pixels(self, P_c: FloatArray) -> FloatArray:
        """(n, 2) u, v of points (n, 3) in the camera; not a number where the lens does not see them."""
        return self.f * self.model.plane(P_c, self.k) + self.centre

    def slopes(self, P_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """d pixel / d P_c (n, 2, 3), and d pixel / d `values` (n, 2, 4 + coefficients)."""
        by_P, by_k = self.model.slopes(P_c, self.k)
        f = self.f[:, None]
        plane = self.model.plane(P_c, self.k)
        by_f = plane[..., None] * np.eye(2)
        by_centre = np.broadcast_to(np.eye(2), by_f.shape)
        return f * by_P, np.concatenate([by_f, by_centre, f * by_k], axis=-1)

    def rays(self, uv: FloatArray) -> FloatArray:
        """(n, 3) unit vectors in the camera towards pixels (n, 2): the inverse of `pixels` but for the distance."""
        return self.model.ray((uv - self.centre) / self.f, self.k)

    def undistorted(self, uv: FloatArray) -> FloatArray:
        """(n, 2) where the pinhole with the same f and centre would see pixels (n, 2); nowhere if not ahead of it."""
        return Intrinsics(self.f, self.centre).pixels(self.rays(uv))


def M2(R: FloatArray, T: FloatArray) -> FloatArray:
    """(4, 4) from the Earth to the camera: (P_c, 1) = M2 (P_e, 1), of the rotation R_ec (3, 3) and T (3,)."""
    return np.block([[R, np.reshape(T, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


@dataclass(frozen=True)
class Camera:
    """A camera on the body that sees points whose places are known, one point a reading.

    (u, v) = pixels(P_c) + n,  P_c = C_cb (C_bn (point_n - p_n) - l_b)

    These are the course's R = C_cb C_bn and T = -R p_n - C_cb l_b.

    The point of each reading is the covariate `point_n` (n, 3) of the motion, north, east, down [m].

    Neglects camera.focal, camera.principal_point, camera.distortion, camera.misalignment, camera.lever_arm,
    camera.time_offset; a shutter that reads line by line.

    Attributes
    ----------
    sigma : standard deviation of u and of v [pixels]
    intrinsics : lens, and from its plane to pixels: `sensors.camera.Intrinsics`
    C_bc : (3, 3) camera -> body, columns are the camera's axes in the body
    l_b : (3,) the camera's centre in the body [m]
    """

    sigma: float
    intrinsics: Intrinsics
    C_bc: FloatArray = field(default_factory=lambda: LOOKS_AHEAD)
    l_b: FloatArray = field(default_factory=lambda: np.zeros(3))
    name: str = "camera"
    size: int = 2

    @property
    def R(self) -> FloatArray:
        """(2, 2) pixels^2."""
        return np.eye(2) * self.sigma**2

    @property
    def bias(self) -> BiasProcess | None:
        """None: an offset of the pixels is the effect camera.principal_point."""
        return None

    def covariate(self, n: int) -> FloatArray:
        """(n, 17) all of it in numbers, the same in each row: it travels with a motion as the beams of a scan do.

        Number of the lens, f, centre, five coefficients, C_bc as a quaternion, l_b.

        Parameters
        ----------
        n : rows
        """
        k = np.pad(self.intrinsics.k, (0, 5 - len(self.intrinsics.k)))
        lens = list(LENSES).index(self.intrinsics.lens)
        q_bc = quaternion_from_matrix(self.C_bc)
        return np.tile(np.concatenate([[float(lens)], self.intrinsics.values[:4], k, q_bc, self.l_b]), (n, 1))

    @staticmethod
    def of(motion: Motion) -> Camera:
        """The camera that the covariate `camera` of a motion tells, for effects; its noise is of no account.

        Parameters
        ----------
        motion : with the covariate `camera`, as of `covariate`
        """
        row = motion.covariates["camera"][0]
        lens = list(LENSES)[int(row[0])]
        k = row[5 : 5 + len(LENSES[lens].coefficients)]
        return Camera(1.0, Intrinsics(row[1:3], row[3:5], lens, k), matrix_from_quaternion(row[10:14]), row[14:17])

    def points_b(self, motion: Motion) -> FloatArray:
        """(n, 3) the known points in the body, from its reference point: C_bn (point_n - p_n) [m].

        Parameters
        ----------
        motion : (n) with the covariate `point_n`
        """
        return rotate_back(motion.q_nb, motion.covariates["point_n"] - motion.p_n)

    def points_c(self, motion: Motion) -> FloatArray:
        """(n, 3) the known points in the camera [m].

        Parameters
        ----------
        motion : (n) with the covariate `point_n`
        """
        return (self.points_b(motion) - self.l_b) @ self.C_bc

    def predict(self, motion: Motion) -> FloatArray:
        """(n, 2) u, v [pixels]; not a number where the point is not in the field of view."""
        return self.intrinsics.pixels(self.points_c(motion))

    def jacobian(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Blocks position -J C_cb C_bn and attitude J C_cb [P_b]x, J = d pixel / d P_c, P_b = C_bn (point_n - p_n)."""
        by_body = self.by_body(motion)
        return {
            "position": -by_body @ np.swapaxes(matrix_from_quaternion(motion.q_nb), -1, -2),
            "attitude": by_body @ skew(self.points_b(motion)),
        }

    def by_body(self, motion: Motion) -> FloatArray:
        """(n, 2, 3) d pixel / d P_b = J C_cb.

        Parameters
        ----------
        motion : (n) with the covariate `point_n`
        """
        by_P, _ = self.intrinsics.slopes(self.points_c(motion))
        return by_P @ self.C_bc.T


SENSOR = SensorType(
    name="camera",
    title="camera",
    make=None,  # of its lens and mounting: `covariates.camera_of`
    kernel="form",
    columns=(("point", "u", "v"),),
    declares=("noise_std", "focal", "centre", "lens", "coefficients", "mounting", "lever_arm"),
)
