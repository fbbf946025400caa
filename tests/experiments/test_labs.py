"""The course's experiments: what they say is what the formulas do on a simulated flight, worked out beside them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.labs import LABS, run
from sinan.experiments.labs.course_flight import flown, rms
from sinan.experiments.labs.scan_height import FLOWN, flight

SIMULATED = ("heading", "sonar_height", "scan_height")  # the others need the course's data


def said(name: str, tmp_path: Path) -> dict[str, float]:
    """The lines of a lab that end in a number and a unit, by what stands before the colon."""
    lines: list[str] = []
    run(name, tmp_path, lines.append)
    assert (tmp_path / f"{name}.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    found = [re.fullmatch(r"(.*): ([\d.]+) (?:m|deg) RMS.*", line) for line in lines]
    return {match[1]: float(match[2]) for match in found if match}


def test_every_lab_has_its_file() -> None:
    folder = Path(__file__).parents[2] / "experiments" / "labs"
    assert all((folder / f"{name}.py").is_file() for name in LABS)
    assert set(SIMULATED) <= set(LABS)


def test_the_height_of_a_scan_has_the_noise_of_its_beams(tmp_path: Path) -> None:
    """3 cm a beam, nine beams: 1 cm; less where the beams are long, since the height is what is across them."""
    found = said("scan_height", tmp_path)
    assert 0.006 < found["all beams by least squares"] < 0.01
    assert found["the course's mean"] > 20.0 * found["all beams by least squares"]


def test_the_course_s_mean_errs_in_flight_as_its_formula_says() -> None:
    """By d (mean(1 / (1 + tan(roll) tan(a))) - 1), written out for the true roll; the noise adds a centimetre."""
    _, motion, rpy = flown("aerobatics", "laser", FLOWN)
    relative = np.mean(1.0 / (1.0 + np.tan(rpy[:, :1]) * np.tan(FLOWN)), axis=1) - 1.0
    errors, level = flight()
    assert errors["the course's mean"] == pytest.approx(rms(relative * motion.height), abs=0.01)
    assert errors["the same less its known error"] < 0.01
    assert 0.02 < level < 0.03  # noise of 3 cm along beams that lean by up to 45 deg


def test_the_height_of_a_sonar_needs_the_temperature_and_the_tilt(tmp_path: Path) -> None:
    """The air is 15 K colder than the sonar thinks: its ranges are too long by sqrt(293.15 / 278.15) - 1 = 2.7 %."""
    found = said("sonar_height", tmp_path)
    warm, cold, level = found.values()
    stream, motion, rpy = flown("low_pass", "sonar")
    assert warm == pytest.approx(rms(np.sqrt(293.15 / 278.15) * stream["range"] - motion.height), abs=1e-3)
    assert cold == pytest.approx(rms(stream["range"] - motion.height), abs=1e-3)
    cosine = np.cos(rpy[:, 0]) * np.cos(rpy[:, 1])
    assert level == pytest.approx(rms(stream["range"] * cosine - motion.height), abs=1e-3)
    assert level < 0.03 < cold < warm


def test_the_heading_needs_the_true_tilt(tmp_path: Path) -> None:
    none, force, true = said("heading", tmp_path).values()
    assert true < 0.2 * none
    assert abs(force - none) < 0.1 * none  # a multicopter's thrust shows no tilt
