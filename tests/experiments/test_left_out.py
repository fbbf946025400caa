"""Effects of other logs of an instrument, declared in one that had no part in them."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.filter.flight_model import flight_model
from sinan.experiments.benchmarks import left_out
from sinan.experiments.benchmarks.attitude import FILTER, SMOOTHER, VQF, VQF_OFFLINE, Score
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between

TURNED = (0.06, -0.04, 0.05)


def flight(seed: int) -> Recording:
    effect = parse_effect("mag.misalignment=" + ",".join(map(str, TURNED)))
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(seed), [effect])
    return between(recording.replace(effects={}, truth=None), 0.0, 16.0)


def test_what_other_logs_share_is_found_with_its_size() -> None:
    shared = left_out.Shared.of([flight(1), flight(2)])
    assert list(shared.effects) == ["mag.misalignment"]
    assert shared.effects["mag.misalignment"] == pytest.approx(TURNED, abs=0.02)
    other = shared.declared_in(flight(3))
    assert other.effects == shared.effects
    assert flight_model(other).averaged == shared.averaged


def test_every_log_is_left_out_once() -> None:
    folds = left_out.folds_of(list("abcdefg"), 3)
    assert folds == [["a", "d", "g"], ["b", "e"], ["c", "f"]]


def test_page_has_ratios_before_and_after() -> None:
    def row(filtered: float, after: float) -> dict[str, Score]:
        totals = {VQF: 2.0, VQF_OFFLINE: 1.0, FILTER: filtered, left_out.FILTER_AFTER: after}
        totals |= {SMOOTHER: 1.0, left_out.SMOOTHER_AFTER: 0.5}
        return {label: Score(total, total, 0.1) for label, total in totals.items()}

    found = [(["a"], left_out.Shared({"mag.time_offset": (0.004,)}, True)), (["b"], left_out.Shared({}, False))]
    page = left_out.text_of({"a": row(4.0, 1.0), "b": row(2.0, 2.0)}, found)
    assert "| filter over VQF | 1.50 | 1.50 | 2.00 (a) |" in page
    assert "| filter, after over VQF | 0.75 | 0.75 | 1.00 (b) |" in page
    assert "| smoother, after over VQF offline | 0.50 | 0.50 |" in page
    assert "Declared in a: mag.time_offset 0.004; samples are means over their step." in page
    assert "Declared in b: none." in page
