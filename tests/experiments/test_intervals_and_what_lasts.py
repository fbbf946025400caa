"""Where withheld readings can be asked, intervals are offered along with what lasts: one kind of hypothesis."""

from __future__ import annotations

from pathlib import Path

import pytest

from sinan.experiments.blind.examine import examined
from sinan.experiments.blind.measured.minute import minute_of, rng_of
from sinan.experiments.datasets import resolve
from sinan.experiments.measured.flights import LOGS


@pytest.mark.xfail(
    strict=True,
    reason="with rest, or with the iron of turns, a temperature that is drawn is named at p = 4e-6",
)
@pytest.mark.measured
def test_a_magnet_that_is_taken_off_is_no_temperature(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """BROAD 35: a magnet 4 cm from the instrument for the first half of the trial alone. A temperature that warms up
    meanwhile follows the same course, and was named while intervals had to wait for what lasts.
    """
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    name = "BROAD 35, attached magnet 4cm"
    minute = minute_of(resolve(LOGS[name]), rng_of(11, name))
    assert "temperature_imu" in minute.drawn
    document = examined(minute.control)
    assert [effect["name"] for effect in document["effects"]] == ["mag.time_offset", "mag.step"]
    assert document["error"]["same_names_on_fitting_part"] is None  # noise is found: withheld readings are the proof
