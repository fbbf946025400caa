"""What an offset explains of readings that a heavy-tailed law doubts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from sinan.estimator.evidence.intervals.doubted import Doubted, doubted_among, explained
from sinan.sensors.arrays import FloatArray

#: Degrees of freedom of the law, components of a reading, readings, of which the first are off.
TAIL, M, N, OFF = 4.0, 3, 30, 5
OFFSET = np.array([8.0, -3.0, 20.0])


def weights(z: FloatArray) -> FloatArray:
    """(n,) of readings z (n, 3) whose law is normal up to NIS = m, Student's beyond."""
    nis = np.sum(z**2, axis=1)
    return np.asarray(np.where(nis > M, (TAIL + M) / (TAIL + nis), 1.0))


def deviance(z: FloatArray) -> float:
    """-2 log of the same law, up to a constant: Student's density joined to the normal one at NIS = m."""
    law = stats.multivariate_t(shape=np.eye(M), df=TAIL)
    nis = np.sum(z**2, axis=1)
    joined = M + 2.0 * law.logpdf(np.sqrt(np.eye(1, M)[0] * M))
    return float(np.sum(np.where(nis > M, joined - 2.0 * law.logpdf(z), nis)))


def of(z: FloatArray, off: FloatArray) -> tuple[FloatArray, FloatArray, Doubted, FloatArray, FloatArray]:
    """Information, score, what is doubted, and its rows of one offset of the readings that are `off`."""
    weight = weights(z)
    H = off[:, None, None] * np.eye(M)
    W, white = np.sqrt(weight)[:, None, None] * H, np.sqrt(weight)[:, None] * z
    doubted = doubted_among(weight, np.full(N, M), np.full(N, TAIL), np.full(N, -np.inf))
    information, score = np.einsum("nci,ncj->ij", W, W), np.einsum("nci,nc->i", W, white)
    return information, score, doubted, W.reshape(-1, M)[doubted.row], white.ravel()[doubted.row]


@pytest.mark.parametrize("seed", range(4))
def test_an_offset_explains_what_the_law_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    off = np.arange(N) < OFF
    z = rng.standard_normal((N, M)) + off[:, None] * OFFSET
    information, score, doubted, W, white = of(z, off)
    gain, dof, beta = explained(information[None], score[None], W[None], white, doubted, 1e-9)
    best = optimize.minimize(lambda b: deviance(z - off[:, None] * b), OFFSET, method="Nelder-Mead",
                             options={"xatol": 1e-6, "fatol": 1e-8, "maxiter": 4000})  # fmt: skip
    assert dof[0] == M
    assert gain[0] == pytest.approx(deviance(z) - best.fun, abs=0.02)
    assert beta[0] == pytest.approx(best.x, abs=0.1)
    by_squares = float(score @ np.linalg.solve(information, score))
    assert gain[0] > 2.0 * by_squares  # at most nu + m = 7 of each of five
    assert by_squares < (TAIL + M) * OFF


def test_one_of_several_is_wrong_by_itself() -> None:
    off = np.arange(N) < OFF
    z = np.random.default_rng(9).standard_normal((N, M)) + off[:, None] * OFFSET
    z[2] = [-60.0, 40.0, 0.0]
    information, score, doubted, W, white = of(z, off)
    _, _, beta = explained(information[None], score[None], W[None], white, doubted, 1e-9)
    assert beta[0] == pytest.approx(OFFSET, abs=2.0)


def test_what_is_no_offset_explains_as_much_as_chance() -> None:
    """Of readings that follow the law: their gains are chi-square, a little less far, by the other weights."""
    rng, gains = np.random.default_rng(11), list[float]()
    off = np.arange(N) < 3 * OFF
    while len(gains) < 400:
        z = rng.standard_normal((N, M)) / np.sqrt(rng.chisquare(TAIL, (N, 1)) / TAIL)
        information, score, doubted, W, white = of(z, off)
        if np.any(W):
            gains.append(explained(information[None], score[None], W[None], white, doubted, 1e-9)[0][0])
    assert 0.7 * M < np.mean(gains) < 1.3 * M
    assert np.mean(np.array(gains) > stats.chi2.isf(0.05, M)) == pytest.approx(0.05, abs=0.03)


def test_readings_that_are_hardly_believed_show_every_direction() -> None:
    """At the weights without the offset, 1e-4 of the usual ones, none would be above the floor of the others."""
    off = np.arange(N) < OFF
    z = np.random.default_rng(4).standard_normal((N, M)) + off[:, None] * 30.0 * OFFSET
    information, score, doubted, W, white = of(z, off)
    floor = 1e-2 * OFF
    assert np.all(np.linalg.eigvalsh(information) < floor)
    gain, dof, beta = explained(information[None], score[None], W[None], white, doubted, floor)
    assert dof[0] == M
    assert beta[0] == pytest.approx(30.0 * OFFSET, abs=2.0)
    assert gain[0] > 200.0


def test_several_offsets_are_asked_each_by_itself() -> None:
    rng = np.random.default_rng(5)
    each = [np.arange(N) < OFF, (np.arange(N) >= 3) & (np.arange(N) < 12)]
    z = rng.standard_normal((N, M)) + each[0][:, None] * OFFSET
    parts = [of(z, off) for off in each]
    doubted, white = parts[0][2], parts[0][4]
    together = explained(*(np.stack([part[k] for part in parts]) for k in (0, 1, 3)), white, doubted, 1e-9)
    for k, part in enumerate(parts):
        gain, dof, beta = explained(part[0][None], part[1][None], part[3][None], white, doubted, 1e-9)
        assert together[0][k] == pytest.approx(gain[0])
        assert together[1][k] == dof[0] == M
        assert together[2][k] == pytest.approx(beta[0])
