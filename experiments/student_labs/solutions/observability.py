"""Solutions of the lab `observability`."""

from __future__ import annotations

import numpy as np

from sinan.experiments.student_labs.lab import Data, Solution
from sinan.experiments.student_labs.observability import HOVER, G, columns
from sinan.sensors.arrays import FloatArray


def matrix(heading: float) -> FloatArray:
    """(4, 4) H, H F, H F^2, H F^3 of position, speed, tilt error, bias while the heading stands still."""
    F = np.zeros((4, 4))
    F[0, 1], F[1, 2], F[1, 3] = 1.0, G, np.cos(heading)
    rows = [np.array([1.0, 0.0, 0.0, 0.0])]
    for _ in range(3):
        rows.append(rows[-1] @ F)
    return np.array(rows)


def direction(data: Data) -> FloatArray:
    """Bias [m/s^2] for each rad of tilt error in the direction that the hover leaves open."""
    null = np.linalg.svd(matrix(data["heading"][0]))[2][-1]
    return np.array([null[3] / null[2]])


def total(data: Data) -> FloatArray:
    """G tilt + cos(heading) bias of the hover [m/s^2]."""
    hover = data["t"] < HOVER
    return np.array([2.0 * np.polyfit(data["t"][hover], data["position"][hover], 2)[0]])


def fitted(data: Data) -> tuple[FloatArray, FloatArray]:
    """(4,) p0, v0, tilt error, bias of the whole flight, and 1 sigma of each."""
    A = np.column_stack([np.ones_like(data["t"]), data["t"], columns(data["t"], data["heading"])])
    x, rest, *_ = np.linalg.lstsq(A, data["position"], rcond=None)
    sigma = np.sqrt(np.diag(np.linalg.inv(A.T @ A)) * rest[0] / (len(A) - 4))
    return np.asarray(x, dtype=np.float64), np.asarray(sigma, dtype=np.float64)


def alone(data: Data) -> FloatArray:
    """1 sigma of the bias if the tilt error were known."""
    t = data["t"]
    A = np.column_stack([np.ones_like(t), t, columns(t, data["heading"])[:, 1]])
    whole = np.column_stack([A, t**2])
    rest = np.linalg.lstsq(whole, data["position"], rcond=None)[1]
    return np.sqrt(np.diag(np.linalg.inv(A.T @ A))[2:] * rest[0] / (len(A) - 4))


SOLUTIONS = {
    "rank": Solution(
        lambda d: np.array([float(np.linalg.matrix_rank(matrix(d["heading"][0])))]), (lambda _: np.array([4.0]),)
    ),
    "direction": Solution(direction, (lambda d: -direction(d), lambda d: direction(d) * np.cos(d["heading"][0]))),
    "sum": Solution(total, (lambda d: 0.5 * total(d),)),
    "tilt": Solution(lambda d: fitted(d)[0][2:3], (lambda d: np.rad2deg(fitted(d)[0][2:3]),)),
    "bias": Solution(lambda d: fitted(d)[0][3:], (lambda d: -fitted(d)[0][3:],)),
    "sigma": Solution(lambda d: fitted(d)[1][3:], (alone, lambda d: fitted(d)[1][3:] ** 2)),
}
