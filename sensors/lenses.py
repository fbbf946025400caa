"""Lenses: from a direction in the camera to the image plane at distance one, and back. The course, section 8.

Camera axes: x right, y down, z forward. The plane coordinates (x, y) are without unit; pixels are made of them by
`sensors.camera.Intrinsics`. Where a lens does not see a direction, or no direction reaches a place, there is no number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray

#: Newton's method doubles its digits at each round: from the distorted place ten are enough but beside a fold.
_ROUNDS = 30
#: What a round may still change when the place counts as found [1]: a millionth of a pixel of any camera that is sold.
_SETTLED = 1e-10
#: What no round mends [1].
_ROUNDING = 1e-15
#: Square of the ratio below which arctan(q) / q is its series: the next term, q^6 / 7, is below rounding.
_SMALL_SQUARE = 1e-5


@dataclass(frozen=True)
class Lens:
    """One model of a lens.

    Attributes
    ----------
    name : as recordings and the command line say it
    coefficients : names of the coefficients k, in the order of OpenCV
    plane : (P_c (n, 3), k) -> (n, 2)
    slopes : (P_c (n, 3), k) -> d plane / d P_c (n, 2, 3) and d plane / d k (n, 2, len(k))
    ray : (plane (n, 2), k) -> (n, 3) unit vectors in the camera
    source : author, edition, equation
    """

    name: str
    coefficients: tuple[str, ...]
    plane: Callable[[FloatArray, FloatArray], FloatArray]
    slopes: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
    ray: Callable[[FloatArray, FloatArray], FloatArray]
    source: str


def _joined(rows: list[list[FloatArray]]) -> FloatArray:
    """(n, rows, columns) of entries (n,) each."""
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def bend(xy: FloatArray, k: FloatArray) -> FloatArray:
    """Radial and tangential distortion of plane coordinates (n, 2) by k = (k1, k2, p1, p2[, k3]).

    radial = 1 + k1 r^2 + k2 r^4 + k3 r^6
    x_d = x radial + 2 p1 x y + p2 (r^2 + 2 x^2)
    y_d = y radial + p1 (r^2 + 2 y^2) + 2 p2 x y

    Source: D. C. Brown, Photogrammetric Engineering 37(8), 1971; coefficients as OpenCV's `projectPoints`.
    """
    x, y = xy[..., 0], xy[..., 1]
    k1, k2, p1, p2, k3 = (*k, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )


def bend_slopes(xy: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """d bend / d xy (n, 2, 2), symmetric, and d bend / d k (n, 2, len(k))."""
    x, y = xy[..., 0], xy[..., 1]
    k1, k2, p1, p2, k3 = (*k, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    growth = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)  # d radial / d r^2
    across = 2.0 * (x * y * growth + p1 * x + p2 * y)
    by_xy = _joined(
        [
            [radial + 2.0 * x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x, across],
            [across, radial + 2.0 * y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x],
        ]
    )
    columns = [
        [x * r2, x * r2**2, 2.0 * x * y, r2 + 2.0 * x * x, x * r2**3],
        [y * r2, y * r2**2, r2 + 2.0 * y * y, 2.0 * x * y, y * r2**3],
    ]
    return by_xy, _joined([row[: len(k)] for row in columns])


def straighten(xy_d: FloatArray, k: FloatArray) -> FloatArray:
    """The plane coordinates (n, 2) that `bend` takes to `xy_d`, by Newton's method.

    Not a number beyond the radius at which the distortion folds the image over: there its Jacobian's determinant is not
    positive, and two places look alike.
    """
    xy = np.array(xy_d, dtype=np.float64)
    for _ in range(_ROUNDS):
        with np.errstate(invalid="ignore", over="ignore"):
            by_xy, _ = bend_slopes(xy, k)
            off = bend(xy, k) - xy_d
            one_to_one = np.linalg.det(by_xy) > 0.0
            if np.max(np.abs(off[one_to_one]), initial=0.0) < _ROUNDING:
                break
            xy = xy - np.linalg.solve(np.where(one_to_one[..., None, None], by_xy, np.nan), off[..., None])[..., 0]
    with np.errstate(invalid="ignore"):
        found = np.all(np.abs(bend(xy, k) - xy_d) < _SETTLED, axis=-1)
    return np.where(found[..., None], xy, np.nan)


def _seen(P_c: FloatArray, divisor: FloatArray) -> FloatArray:
    """The divisor of a projection, not a number where the point is behind the lens."""
    return np.where(np.real(divisor) > 0.0, divisor, np.nan)


def brown_plane(P_c: FloatArray, k: FloatArray) -> FloatArray:
    """Pinhole x = X / Z, y = Y / Z, then `bend`; the course's P_xi / f, P_yi / f where k is zero."""
    return bend(P_c[..., :2] / _seen(P_c, P_c[..., 2])[..., None], k)


def brown_slopes(P_c: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """d x / d P_c = (1, 0, -x) / Z, then the chain rule through `bend`."""
    Z = _seen(P_c, P_c[..., 2])
    xy = P_c[..., :2] / Z[..., None]
    by_xy, by_k = bend_slopes(xy, k)
    inward = np.concatenate([np.broadcast_to(np.eye(2), (*Z.shape, 2, 2)), -xy[..., :, None]], axis=-1)
    return by_xy @ (inward / Z[..., None, None]), by_k


def brown_ray(xy_d: FloatArray, k: FloatArray) -> FloatArray:
    """Unit vector along (x, y, 1)."""
    xy = straighten(xy_d, k)
    ray = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def _slope_angle(P_c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """theta / r of a point at the angle theta from the axis, its r^2 = X^2 + Y^2, and its squared distance d^2.

    theta = 2 arctan(q), q = r / (d + Z): no case of its own on the axis, nor beside or behind the camera.
    """
    X, Y, Z = P_c[..., 0], P_c[..., 1], P_c[..., 2]
    r2 = X * X + Y * Y
    d2 = r2 + Z * Z
    forward = np.sqrt(d2) + Z
    q2 = r2 / _seen(P_c, forward) ** 2
    small = np.real(q2) < _SMALL_SQUARE
    q = np.sqrt(np.where(small, 1.0, q2))
    ratio = np.where(small, 1.0 - q2 / 3.0 + q2 * q2 / 5.0, np.arctan(q) / q)
    return 2.0 * ratio / forward, r2, d2


def _angle_powers(theta2: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """theta_d / theta = 1 + sum k_j theta^(2 j), and d theta_d / d theta = 1 + sum (2 j + 1) k_j theta^(2 j)."""
    value, slope = np.ones_like(theta2), np.ones_like(theta2)
    power = np.ones_like(theta2)
    for j, coefficient in enumerate(k, start=1):
        power = power * theta2
        value = value + coefficient * power
        slope = slope + (2 * j + 1) * coefficient * power
    return value, slope


def fisheye_plane(P_c: FloatArray, k: FloatArray) -> FloatArray:
    """At the radius theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), theta from the axis.

    Sees beyond 90 deg, all but what is straight behind.

    Source: J. Kannala, S. S. Brandt, IEEE Trans. PAMI 28(8), 2006, eq. 6; coefficients as OpenCV's `fisheye`.
    """
    per_radius, r2, _ = _slope_angle(P_c)
    value, _ = _angle_powers(r2 * per_radius**2, k)
    return P_c[..., :2] * (per_radius * value)[..., None]


def fisheye_slopes(P_c: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """With x = a X, a = theta_d / r:  d x / d (X, Y, Z) = (a + X^2 b, X Y b, -X theta_d' / d^2).

    b = (theta_d' Z / d^2 - a) / r^2, since d theta / d r = Z / d^2 and d theta / d Z = -r / d^2.
    """
    X, Y, Z = P_c[..., 0], P_c[..., 1], P_c[..., 2]
    per_radius, r2, d2 = _slope_angle(P_c)
    theta2 = r2 * per_radius**2
    value, slope = _angle_powers(theta2, k)
    a = per_radius * value
    b = (slope * Z / d2 - a) / np.where(r2 > 0.0, r2, 1.0)  # on the axis X = Y = 0 multiply it
    by_P = _joined([[a + X * X * b, X * Y * b, -X * slope / d2], [X * Y * b, a + Y * Y * b, -Y * slope / d2]])
    powers = [per_radius * theta2 ** (j + 1) for j in range(len(k))]
    return by_P, _joined([[axis * power for power in powers] for axis in (X, Y)])


def fisheye_ray(xy_d: FloatArray, k: FloatArray) -> FloatArray:
    """(sin theta cos phi, sin theta sin phi, cos theta), theta from theta_d by Newton's method."""
    theta_d = np.linalg.norm(xy_d, axis=-1)
    theta = np.array(theta_d)
    for _ in range(_ROUNDS):
        value, slope = _angle_powers(theta**2, k)
        with np.errstate(invalid="ignore", over="ignore"):
            theta = theta - (theta * value - theta_d) / np.where(slope > 0.0, slope, np.nan)
    value, _ = _angle_powers(theta**2, k)
    with np.errstate(invalid="ignore"):
        found = (np.abs(theta * value - theta_d) < _SETTLED) & (theta < np.pi)
    theta = np.where(found, theta, np.nan)
    away = xy_d / np.maximum(theta_d, np.finfo(float).tiny)[..., None]
    return np.concatenate([np.sin(theta)[..., None] * away, np.cos(theta)[..., None]], axis=-1)


def omnidirectional_plane(P_c: FloatArray, k: FloatArray) -> FloatArray:
    """The unit sphere seen from xi behind its centre, then `bend`; k = (xi, k1, k2, p1, p2).

    (x, y) = (X, Y) / (Z + xi |P_c|);  xi = 0 is the pinhole, xi = 1 a parabolic mirror

    Source: C. Mei, P. Rives, ICRA 2007, eq. 3 to 5; coefficients as OpenCV's `omnidir` (its skew is zero here).
    """
    return bend(P_c[..., :2] / _through_sphere(P_c, k[0])[..., None], k[1:])


def _through_sphere(P_c: FloatArray, xi: float) -> FloatArray:
    """Z + xi |P_c|; not a number for what the sphere hides: for xi > 1 beyond cos = -1 / xi two points look alike."""
    d = np.sqrt(np.sum(P_c * P_c, axis=-1))
    divisor = P_c[..., 2] + xi * d
    hidden = np.real(xi * P_c[..., 2] + d) <= 0.0
    return np.where(hidden, np.nan, _seen(P_c, divisor))


def omnidirectional_slopes(P_c: FloatArray, k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """With s = Z + xi d: d x / d P_c = (e_x - x (e_z + xi P_c / d)) / s, d x / d xi = -x d / s; then `bend`."""
    s = _through_sphere(P_c, k[0])
    d = np.sqrt(np.sum(P_c * P_c, axis=-1))
    xy = P_c[..., :2] / s[..., None]
    by_xy, by_bend = bend_slopes(xy, k[1:])
    growth = k[0] * P_c / d[..., None] + np.array([0.0, 0.0, 1.0])  # d s / d P_c
    by_P = (np.eye(2, 3) - xy[..., :, None] * growth[..., None, :]) / s[..., None, None]
    by_xi = -xy * (d / s)[..., None]
    return by_xy @ by_P, np.concatenate([by_xy @ by_xi[..., None], by_bend], axis=-1)


def omnidirectional_ray(xy_d: FloatArray, k: FloatArray) -> FloatArray:
    """(eta x, eta y, eta - xi) with eta = (xi + sqrt(1 + (1 - xi^2) r^2)) / (1 + r^2), back onto the sphere."""
    xy, xi = straighten(xy_d, k[1:]), k[0]
    r2 = np.sum(xy * xy, axis=-1)
    with np.errstate(invalid="ignore"):
        eta = (xi + np.sqrt(1.0 + (1.0 - xi * xi) * r2)) / (1.0 + r2)
    return np.concatenate([eta[..., None] * xy, (eta - xi)[..., None]], axis=-1)


LENSES: Mapping[str, Lens] = {
    lens.name: lens
    for lens in (
        Lens(
            "brown", ("k1", "k2", "p1", "p2", "k3"), brown_plane, brown_slopes, brown_ray,
            "D. C. Brown, Photogrammetric Engineering 37(8), 1971",
        ),
        Lens(
            "fisheye", ("k1", "k2", "k3", "k4"), fisheye_plane, fisheye_slopes, fisheye_ray,
            "J. Kannala, S. S. Brandt, IEEE Trans. PAMI 28(8), 2006",
        ),
        Lens(
            "omnidirectional", ("xi", "k1", "k2", "p1", "p2"), omnidirectional_plane, omnidirectional_slopes,
            omnidirectional_ray, "C. Mei, P. Rives, ICRA 2007",
        ),
    )
}  # fmt: skip
