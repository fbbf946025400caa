"""Suspects that are no effects, for calibrations: what the error of a triad at rest, or of a gyroscope between poses,
would follow if nothing in the catalogue explained it.

As in `estimator/evidence/probes.py`, each is a block of generic functions of one thing. A set of poses has few
readings, so a block comes in two or three sizes, and the largest is taken that leaves enough of them. The functions are
taken along the plain model's readings and stay as they are: a generic function has no exact form that would be worth
iterating for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sinan.estimator.evidence.probes import goes_with_time, offsets, powers_from, probe
from sinan.estimator.evidence.term import varies
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect
from sinan.sensors.motion import Motion

Shape = Callable[[Motion], FloatArray]
#: A block: what it follows, what it needs, and its sizes with (motion -> (n, 3, size)), the largest first.
_Block = tuple[str, tuple[str, ...], Sequence[tuple[int, Shape]]]


def probes_of_a_triad(stream: str, motion: Motion, still: bool, most: int) -> tuple[Effect, ...]:
    """Probes of poses whose true reading has one norm.

    The functions are of the direction alone: the noise along it is the residual, and a function of that would follow
    its own noise.

    Parameters
    ----------
    stream : accel or mag
    motion : of the plain model, at the poses
    still : the noise is declared, and with it how the bias wanders; else a drift is the bias, which every model has
    most : parameters that a probe may have
    """
    what = "f_b" if stream == "accel" else "m_b"

    def along(motion: Motion) -> FloatArray:
        u: FloatArray = getattr(motion, what)
        return np.asarray(u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12))

    blocks: list[_Block] = [
        ("its own size", (what,), _powers(along, (lambda x: x**3, lambda x: x * np.abs(x), lambda x: x**2))),
        ("direction", (what,), [(16, lambda m: _radial(along(m), 4)), (7, lambda m: _radial(along(m), 3))]),
        ("the reading before", (what,), _powers(lambda m: _before(along(m)), (lambda x: x, lambda x: x**3))),
        *_of_time_and_covariates(stream, motion, still),
    ]
    return _probes(stream, blocks, motion, most)


def probes_of_turns(gravity: float, motion: Motion, still: bool, most: int) -> tuple[Effect, ...]:
    """Probes of a gyroscope turned between poses.

    Parameters
    ----------
    gravity : m/s^2
    motion : of the plain model, at the samples in use
    still : the noise is declared, and with it how the bias wanders; else a drift is the bias, which every model has
    most : parameters that a probe may have
    """

    fastest = max(float(np.max(np.abs(motion.w_ib_b))), 1e-12)

    def of_force(motion: Motion) -> FloatArray:
        return offsets((motion.f_b / gravity) ** 2, 3)

    blocks: list[_Block] = [
        ("its own size", ("w_ib_b",), _powers(lambda m: m.w_ib_b / fastest, (lambda x: x * np.abs(x), lambda x: x**3))),
        ("the squared specific force", ("f_b",), [(9, of_force)]),
        *_of_time_and_covariates("gyro", motion, still),
    ]
    return _probes("gyro", blocks, motion, most)


def _probes(stream: str, blocks: Sequence[_Block], motion: Motion, most: int) -> tuple[Effect, ...]:
    found = []
    for follows, needs, sizes in blocks:
        fitting = [(size, shape) for size, shape in sizes if size <= most]
        if fitting:
            size, shape = fitting[0]
            found.append(probe(stream, follows, size, _constant(shape(motion)), needs=needs))
    return tuple(found)


def _constant(G: FloatArray) -> Shape:
    return lambda motion: G


def _of_time_and_covariates(stream: str, motion: Motion, still: bool) -> list[_Block]:
    """A slow drift as Legendre polynomials of the time; powers of covariates that no effect of the catalogue has, but
    for a drift in disguise where a drift is the bias.
    """
    t = motion.t
    blocks: list[_Block] = []
    if still and varies(t):
        begin, half = float(np.min(t)), 0.5 * float(np.ptp(t))
        blocks.append(("time", (), _polynomials(lambda m: (m.t - begin) / half - 1.0, (1, 2, 3), (3, 2, 1))))
    for name, first in powers_from(stream, motion).items():
        if first == 1 and not still and goes_with_time(motion.covariates[name], t):
            continue
        orders = range(first, 4)
        share = _share(name, motion.covariates[name])
        blocks.append((name, (name,), _polynomials(share, orders, range(len(orders), 0, -1))))
    return blocks


def _share(name: str, values: FloatArray) -> Shape:
    middle, half = 0.5 * float(np.max(values) + np.min(values)), 0.5 * float(np.ptp(values))
    return lambda motion: np.asarray((motion.covariates[name] - middle) / half)


def _polynomials(x: Shape, orders: Sequence[int], counts: Sequence[int]) -> list[tuple[int, Shape]]:
    """A free offset times the first so many Legendre polynomials of x (n,)."""

    def first(count: int) -> Shape:
        return lambda motion: offsets(
            np.stack([np.polynomial.Legendre.basis(order)(x(motion)) for order in orders[:count]], axis=1), 3
        )

    return [(3 * count, first(count)) for count in counts]


def _powers(x: Shape, functions: Sequence[Callable[[FloatArray], FloatArray]]) -> list[tuple[int, Shape]]:
    """Each axis follows functions of its own component of x (n, 3)."""

    def first(count: int) -> Shape:
        return lambda motion: np.concatenate(
            [function(x(motion))[:, :, None] * np.eye(3) for function in functions[:count]], axis=2
        )

    return [(3 * count, first(count)) for count in range(len(functions), 0, -1)]


def _before(x: FloatArray) -> FloatArray:
    """(n, 3) the reading before each; of the first nothing is known."""
    return np.concatenate([np.zeros((1, 3)), x[:-1]])


def _radial(x: FloatArray, degree: int) -> FloatArray:
    """(n, 3, k) harmonic polynomials of degree 3 up to `degree` of the direction x, along it.

    Degree 0 to 2 is what bias, scale and cross-axis do to a norm.
    """
    u, v, w = x.T
    columns = [u * v * w, u * (v**2 - w**2), v * (w**2 - u**2), w * (u**2 - v**2)]
    columns += [a * (5.0 * a**2 - 3.0) / 2.0 for a in (u, v, w)]
    if degree > 3:
        for a, b, c in ((u, v, w), (v, w, u), (w, u, v)):
            columns += [a * b * (7.0 * c**2 - 1.0), a * b * (a**2 - b**2)]
            columns.append((35.0 * a**4 - 30.0 * a**2 + 3.0) / 8.0)
    return np.asarray(x[:, :, None] * np.stack(columns, axis=1)[:, None, :])
