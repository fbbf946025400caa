"""How much older than its position a receiver's velocity is, by two derivations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sinan.calibration.levels.preparation import prepared
from sinan.experiments.benchmarks.receiver_latency import fixes_of, lead_of_fixes, main
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS
from sinan.sensors.window import between
from tests.estimator.test_old_velocity import FINE, LEAD, older


@pytest.mark.parametrize("lead", [0.0, LEAD])
def test_positions_are_the_integrals_of_velocities(lead: float) -> None:
    recording, _ = older(60.0, lead=lead, specs=FINE)
    found = lead_of_fixes(*fixes_of(recording))
    assert found.lead == pytest.approx(lead, abs=0.02)
    assert (found.rms[1] < 0.8 * found.rms[0]) == (lead > 0.0)


def test_fixes_of_less_than_a_window_tell_none() -> None:
    recording, _ = older(9.0, specs=FINE)
    assert np.isnan(lead_of_fixes(*fixes_of(recording)).lead)


@pytest.mark.measured
def test_a_receiver_that_walked_is_told_alike(measured_data: Path) -> None:
    """Its fixes alone, and the filter's sizes with the IMU: two derivations of 0.13 s."""
    recording = between(resolve(LOGS["walk, RTK"]), 0.0, 40.0)
    found, levels = lead_of_fixes(*fixes_of(recording)), prepared(recording).levels
    assert found.lead > 0.1
    assert found.rms[1] < 0.5 * found.rms[0]
    assert levels.lead == pytest.approx(found.lead, abs=0.03)


@pytest.mark.measured
def test_logs_of_no_receiver_are_no_rows(measured_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["BROAD 26, phone vibration"])
    assert "BROAD" not in capsys.readouterr().out
