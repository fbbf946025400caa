"""`--from` and `--to`: every command looks at the part that is asked for, and at all of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.calibration.levels.preparation import prepared
from sinan.experiments.answers.observability import case_of
from sinan.experiments.bias_observability.case import case_of_recording
from sinan.experiments.commands import (
    calibrate as calibrate_command,
)
from sinan.experiments.commands import (
    estimate as estimate_command,
)
from sinan.experiments.commands import (
    trace as trace_command,
)
from sinan.experiments.datasets import convert, resolve
from sinan.experiments.report.words import trace_call
from sinan.experiments.scenarios import simulate_to_folder

SPAN = (20.0, 45.0)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("windows") / "square"
    simulate_to_folder("square", folder, seed=3)
    return folder


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("windows") / "poses"
    simulate_to_folder("mag_poses", folder, ["mag.cross_axis=0.03,0,-0.02"], seed=7)
    return folder


#: Keys of a report that say which log it is of, and how it was asked.
SAYS_WHICH = ("called", "window", "warnings", "call", "logs")


def without(document: dict[str, Any], *keys: str) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key not in keys}


def estimated(log: Path, out: Path, span: tuple[float | None, float | None] = (None, None)) -> dict[str, Any]:
    estimate_command.run(str(log), "auto", None, None, out / "e.json", None, span=span)
    return json.loads((out / "e.json").read_text())


def test_a_part_is_estimated_as_the_log_of_that_part(flight: Path, tmp_path: Path) -> None:
    convert(str(flight), tmp_path / "part", span=SPAN)
    part = resolve(str(tmp_path / "part"))
    assert part.streams["imu"].t[0] >= 20.0
    assert part.streams["imu"].t[-1] < 45.0
    one, other = estimated(flight, tmp_path, SPAN), estimated(tmp_path / "part", tmp_path)
    assert (one["window"], other["window"]) == ([20.0, 45.0], None)
    assert one["called"] == "square from 20 s to 45 s"
    assert one["duration"] == pytest.approx(25.0, abs=0.01)
    *notes, clock = other["notes"]
    assert "20.000 s on its own clock" in clock  # of the whole log it shows zero at the first sample
    assert one["notes"] == notes
    assert without(one, *SAYS_WHICH, "notes") == without(other, *SAYS_WHICH, "notes")


def test_a_part_finds_its_own_first_state(flight: Path, tmp_path: Path) -> None:
    """The declared one is that of the take-off, 11 m away: the first fix and the first field are where it begins."""
    errors = estimated(flight, tmp_path, SPAN)["truth"]
    assert errors["position_rms"] < 3.0
    assert errors["tilt_rms"] < np.deg2rad(2.0)


def test_poses_are_calibrated_and_traced_in_part(poses: Path, tmp_path: Path) -> None:
    t = resolve(str(poses)).streams["mag"].t
    span = (5.0, float(np.round(0.5 * t[-1])))
    convert(str(poses), tmp_path / "part", span=span)
    files = [tmp_path / f"{k}.json" for k in range(4)]
    calibrate_command.run("mag", str(poses), None, None, None, files[0], None, span)
    calibrate_command.run("mag", str(tmp_path / "part"), None, None, None, files[1], None)
    trace_command.run([str(poses)], None, 0.01, None, None, files[2], tmp_path / "page.html", span)
    trace_command.run([str(tmp_path / "part")], None, 0.01, None, None, files[3], None)
    found = [json.loads(file.read_text()) for file in files]
    assert found[0]["n"] == np.sum((t >= t[0] + 5.0) & (t < t[0] + span[1]))
    assert found[0]["window"] == list(span)
    words = (*SAYS_WHICH, "notes", "next")
    for one, other in ((found[0], found[1]), (found[2], found[3])):
        assert without(one, *words) == without(other, *words)
    assert found[2]["called"] == f"poses from 5 s to {span[1]:g} s"
    assert "from 5 s to" in (tmp_path / "page.html").read_text()


def test_what_a_part_shows_is_asked_of_that_part(flight: Path) -> None:
    whole, part = case_of("square"), case_of("square", span=SPAN)
    assert part.name == "square from 20 s to 45 s"
    assert (part.motion.t[0], part.motion.t[-1]) == pytest.approx((20.0, 45.0), abs=0.01)
    assert 0 < len(part.segments) < len(whole.segments)
    assert (part.segments[0].start, part.segments[-1].stop) == pytest.approx((20.0, 45.0), abs=0.01)
    recorded = case_of(str(flight), span=SPAN)
    assert (recorded.motion.t[0], recorded.motion.t[-1]) == pytest.approx((20.0, 45.0), abs=0.01)
    assert all(np.all((t >= 20.0) & (t < 45.0)) for t in recorded.readings.values())


def test_standing_still_before_and_after_a_flight_is_part_of_it(tmp_path: Path) -> None:
    """At rest a gyroscope shows its bias: nothing is left out unless somebody asks for it."""
    simulate_to_folder("takeoff_landing", tmp_path / "run", seed=2)
    recording = resolve(str(tmp_path / "run"))
    t = recording.streams["imu"].t
    journal = prepared(recording).run()
    assert (journal.t_start, journal.t_end) == (t[0], t[-1])
    readings = case_of_recording(recording).readings["mag"]
    assert readings[0] < 1.0  # stands on the ground for six seconds
    assert readings[-1] > t[-1] - 1.0


def test_the_command_that_is_advised_looks_at_the_same_part() -> None:
    assert trace_call("run", span=(10.0, None)) == "sinan trace run --from 10"
    assert trace_call("run", sensor="mag", span=(0.5, 20.0)) == "sinan trace run --sensor mag --from 0.5 --to 20"
