"""What begins within a turn or within a rest of a gyroscope's log."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.poses.evidence.source import LeastSquaresSource
from sinan.calibration.poses.evidence.turns import GyroTurns
from sinan.calibration.poses.gyro import read_turns
from sinan.estimator.evidence.source import Fit, log_p_needed
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.shared_ends import merged
from sinan.experiments.residual_loop.trace import trace
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.residual_loop.trials import Finding
from sinan.sensors.arrays import FloatArray
from tests.calibration.test_gyro import turned_log

OFFSET = np.array([0.004, -0.003, 0.005])


def source_with(
    offset: FloatArray, start: float, end: float, poses: int = 16, declared: bool = True
) -> LeastSquaresSource:
    """A rest of 2 s and a turn of 1 s each, at 100 Hz, with an offset of the gyroscope in an interval; the noise is
    declared or not.
    """
    t, accel, gyro = turned_log(np.random.default_rng(41), poses)
    gyro = gyro + offset * ((t >= start) & (t < end))[:, None]
    return LeastSquaresSource(GyroTurns("simulated", read_turns(t, accel, gyro, 9.8), declared))


@pytest.mark.parametrize("start", [20.5, 21.3], ids=["in a turn", "in a rest"])
def test_a_step_is_found_where_it_begins(start: float) -> None:
    found = trace(source_with(OFFSET, start, np.inf)).selection.findings
    assert [f.term.name for f in found] == ["gyro.step"]
    interval = found[0].term.interval
    assert interval is not None
    assert interval[0] == pytest.approx(start, abs=0.25)
    assert np.all(np.abs(found[0].beta - OFFSET) < 4.0 * found[0].std)


LAST = 48.0  # s: after the last reading
NOTHING = (np.zeros(3), np.zeros(3), -50.0, -50.0, 50.0, 100.0, 100.0)


def found(fit: Fit, term: Term, rivals: Sequence[Finding]) -> Finding:
    """An offset of a fit, as it was found beside its rivals."""
    return replace(Finding(term, *NOTHING, tuple(rivals), search=5.0), beta=fit.beta[term], std=fit.std[term])


def one_in_place(source: LeastSquaresSource, *intervals: tuple[float, float]) -> Finding | None:
    """What `merged` puts in the place of offsets in two intervals."""
    terms = [Term("gyro.step" if end == LAST else "gyro.transient", (begin, end)) for begin, end in intervals]
    fit = source.fit(terms)
    others = (("gyro.temperature",), ("gyro.step", "accel.step"))
    findings = [
        found(fit, term, [Finding(Term(name), *NOTHING, ()) for name in other])
        for term, other in zip(terms, others, strict=True)
    ]
    one = merged(source, fit, findings, log_p_needed(source, 0.01), set())
    return None if one is None else one.finding


@pytest.mark.parametrize(
    ("two", "one"),
    [
        (((12.3, LAST), (12.3, 21.3)), (21.3, LAST)),  # the transient takes back the beginning of the step
        (((12.3, LAST), (21.3, LAST)), (12.3, 21.3)),
        (((12.3, 21.3), (21.3, LAST)), (12.3, LAST)),
        (((12.3, 21.3), (21.3, 30.3)), (12.3, 30.3)),
        (((12.3, 30.3), (21.3, 30.3)), (12.3, 21.3)),
    ],
)
@pytest.mark.parametrize("declared", [True, False], ids=["noise declared", "noise estimated"])
def test_offsets_that_share_an_end_are_merged(
    two: tuple[tuple[float, float], tuple[float, float]], one: tuple[float, float], declared: bool
) -> None:
    found = one_in_place(source_with(OFFSET, *one, declared=declared), *two)
    assert found is not None
    assert found.term.name == ("gyro.step" if one[1] == LAST else "gyro.transient")
    assert found.term.interval == pytest.approx(one, abs=0.25)
    assert np.all(np.abs(found.beta - OFFSET) < 4.0 * found.std)
    assert set(found.confused_with) == {"gyro.temperature", "gyro.step", "accel.step"} - {found.term.name}


def test_offsets_that_share_an_end_and_differ_stay_two() -> None:
    t, accel, gyro = turned_log(np.random.default_rng(41), 16)
    gyro = gyro + OFFSET * (t >= 12.3)[:, None] + OFFSET[::-1] * ((t >= 12.3) & (t < 30.0))[:, None]
    source = LeastSquaresSource(GyroTurns("simulated", read_turns(t, accel, gyro, 9.8), True))
    assert one_in_place(source, (12.3, LAST), (12.3, 30.0)) is None


def test_offsets_that_share_no_end_stay_two() -> None:
    assert one_in_place(source_with(OFFSET, 21.3, LAST), (12.3, 30.0), (21.3, LAST)) is None


def test_share_of_a_rest() -> None:
    """The mean of a rest takes up an offset by the share of the rest that it lasts."""
    t, accel, gyro = turned_log(np.random.default_rng(41), 16)
    log = read_turns(t, accel, gyro, 9.8)
    problem = GyroTurns("simulated", log, True)
    begin, end = log.t[log.poses.start[7]], log.t[log.poses.stop[7] - 1]

    def mark(until: float) -> FloatArray:
        term = Term("gyro.transient", (begin, until))
        effects = problem.rows(problem.start(), {term: np.zeros(3)}, ()).effects[term.key]
        return np.linalg.norm(effects[np.isclose(problem.t, log.poses.t[7])])

    assert mark(begin + 0.25 * (end - begin)) == pytest.approx(0.25 * mark(end + 0.01), rel=0.1)


def test_an_offset_within_one_turn_is_not_determined() -> None:
    """Two residuals of one turn do not tell three components, and no end: no sigma then, which the report can say."""
    source = source_with(20.0 * OFFSET, 20.2, 20.8)
    result = trace(source)
    assert [f.term.name for f in result.selection.findings] == ["gyro.transient"]
    assert not np.all(np.isfinite(result.selection.findings[0].std))
    document = json.loads(json.dumps(report(Traced.alone(source, result)), allow_nan=False))
    assert None in document["effects"][0]["std"]
