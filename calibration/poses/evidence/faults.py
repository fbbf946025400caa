"""Poses that are no measurement: a component at the end of its range, or one that stands still while others move."""

from __future__ import annotations

import numpy as np
from scipy import stats

from sinan.calibration.poses.triad import calibrate_norm, norm_jacobian, norm_residual
from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.estimator.filter.faults import FROZEN_LEVEL, stuck_runs
from sinan.sensors.arrays import BoolArray, FloatArray, runs_of
from sinan.sensors.errors import InputError

Fault = tuple[str, str, float, float]
#: How likely equal readings at the extreme may be by chance, as often as readings are equal elsewhere: a
#: stated risk.
_TIE_LEVEL = 0.02
#: Readings that must be left beyond the parameters of the plain model, to judge the others by: of ten
#: the sigma is known to 1 / sqrt(20), a fifth.
_LEAST_LEFT = 10


def poses_that_measured(
    sensor: str, t: FloatArray, reading: FloatArray, norm: float, sigma: FloatArray | None, where: str
) -> tuple[BoolArray, tuple[Fault, ...]]:
    """(n,) which poses are measurements, and the stretches of the others.

    Parameters
    ----------
    t, reading : (n,) s, (n, 3)
    norm : of the true reading
    sigma : (n,) white noise per axis; None: not declared
    """
    keep = np.ones(len(t), dtype=bool)
    found: list[Fault] = []
    for start, stop in stuck_runs(reading):
        if int(np.sum(keep)) - (stop - start - 1) >= _LEAST_LEFT:
            keep[start + 1 : stop] = False
            found.append((sensor, "frozen", float(t[start]), float(t[stop - 1])))
    pinned = at_an_end(reading) & keep
    if np.any(pinned) and _are_too_short(sensor, reading[keep], pinned[keep], norm, sigma, keep, where):
        keep &= ~pinned
        found += [(sensor, "saturated", float(t[a]), float(t[b - 1])) for a, b in runs_of(pinned)]
    return keep, tuple(found)


def at_an_end(reading: FloatArray) -> BoolArray:
    """(n,) whether a component is exactly as large as the largest of its axis, and too many others are, too.

    Two readings next to each other in size are equal with the share q of the stream's own habit, which a coarse
    converter makes large; m equal ones at the extreme come with q^(m - 1).
    """
    n = len(reading)
    pinned = np.zeros(n, dtype=bool)
    ordered = np.sort(reading, axis=0)
    equal = int(np.sum(ordered[1:] == ordered[:-1]))
    for column in reading.T:
        size = np.abs(column)
        for at in (column == np.max(column), column == np.min(column), size == np.max(size)):
            m = int(np.sum(at))
            if m < 2:
                continue
            here = np.sort(column[at])
            elsewhere = equal - int(np.sum(here[1:] == here[:-1]))
            q = min((elsewhere + 1.0) / max(3 * n - m, 1), 1.0)
            if (m - 1) * np.log(q) < np.log(_TIE_LEVEL):
                pinned |= at
    return pinned


def _are_too_short(
    sensor: str, reading: FloatArray, pinned: BoolArray, norm: float, sigma: FloatArray | None, keep: BoolArray,
    where: str,
) -> bool:  # fmt: skip
    """Whether the other readings say that those at the end of the range miss something: a limit that is seen."""
    rest = ~pinned
    if int(np.sum(rest)) < 6 + _LEAST_LEFT // 2:
        return False
    try:
        fit = calibrate_norm(sensor, reading[rest], norm, where=where).fit
    except InputError:  # the rest cannot be calibrated: nothing to judge by
        return False
    freedom = int(np.sum(rest)) - len(fit.x)
    noise = float(np.sqrt(fit.sse / freedom))
    per_unit = float(np.mean(fit.x[:3]))
    known = 0.0 if sigma is None else float(np.mean(sigma[keep])) * per_unit
    J, J_rest = norm_jacobian(fit.x, reading[pinned]), norm_jacobian(fit.x, reading[rest])
    off = norm_residual(fit.x, reading[pinned], norm) / max(noise, known)
    spread = J @ np.linalg.pinv(J_rest.T @ J_rest, rcond=1e-12, hermitian=True) @ J.T
    size, axes = np.linalg.eigh(spread)  # of C = I + spread, whose inverse is found from it however large that is
    gain = float(np.sum((axes.T @ off) ** 2 / (1.0 + np.maximum(size, 0.0))))
    m = len(off)
    log_p = float(stats.f.logsf(gain / m, m, freedom)) if noise >= known else float(stats.chi2.logsf(gain, m))
    short = bool(np.mean(off) < 0.0) and bool(np.all(off < 3.0 * np.sqrt(1.0 + np.diag(spread))))
    return short and gain - m > DETECTABLE_LAMBDA and log_p < np.log(np.sqrt(FROZEN_LEVEL))
