"""The first attitude of a log that begins in a manoeuvre."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.calibration.levels.heading import with_heading
from sinan.estimator.evidence.consistency import nees
from sinan.estimator.filter.alignment import align
from sinan.estimator.filter.alignment_in_motion import wahba
from sinan.estimator.filter.flight import Flight
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import QUATERNION, Initial, Recording
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_rpy,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    rotate_back,
)
from sinan.sensors.simulate import simulate

DEGREE = np.deg2rad(1.0)
FALSE_ALARM = 0.001
STARTS = np.arange(8.0, 100.0, 4.0)  # s into the aerobatics: turns, climbs, circles, eights


@pytest.fixture(scope="module")
def aerobatics() -> tuple[Recording, FloatArray]:
    recording, truth = simulate(load_scenario("aerobatics"), np.random.default_rng(4))
    q = quaternion_interpolate(recording.streams["imu"].t, truth.t, truth.array(QUATERNION))
    return recording.replace(initial=Initial()), q


def begun_at(recording: Recording, start: float, compass: bool) -> Recording:
    streams = {n: s.rows((s.t >= start) & (s.t < start + 10.0)) for n, s in recording.streams.items()}
    return recording.replace(streams={n: s for n, s in streams.items() if len(s) and (compass or n != "mag")})


def error_of(recording: Recording, q_true: FloatArray) -> tuple[FloatArray, FloatArray]:
    q, P, _ = align(Flight.of(recording))
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(q), q_true))), P


@pytest.mark.parametrize("compass", [True, False], ids=["compass", "no compass"])
def test_attitude_of_a_start_in_a_manoeuvre_is_within_its_sigma(aerobatics, compass: bool) -> None:
    """Chi-square over starts 4 s apart, of which none shares a reading with the next."""
    recording, q = aerobatics
    t, errors, total = recording.streams["imu"].t, [], 0.0
    for start in STARTS:
        error, P = error_of(begun_at(recording, start, compass), q[np.searchsorted(t, start)])
        total += nees(error, P)
        errors.append(np.linalg.norm(error))
    size = 3 * len(STARTS)
    assert total / size < chi2.ppf(1.0 - FALSE_ALARM, size) / size
    assert np.median(errors) < 6.0 * DEGREE


def test_wahba_turns_vectors_home() -> None:
    q = quaternion_from_rpy(np.array([2.0, -1.1, 0.7]))
    nav = np.random.default_rng(1).normal(size=(5, 3))
    found = wahba(rotate_back(q, nav), nav, np.arange(1.0, 6.0))
    assert np.linalg.norm(quaternion_log(quaternion_multiply(quaternion_conjugate(q), found))) < 1e-9


def test_start_in_a_manoeuvre_needs_no_search_for_its_heading(aerobatics) -> None:
    recording, _ = aerobatics
    begun = begun_at(recording, 16.0, compass=False)
    assert with_heading(begun, recording.sensors) is begun


def test_hover_leaves_the_heading_open(aerobatics) -> None:
    recording, q = aerobatics
    error, P = error_of(begun_at(recording, 0.5, compass=False), q[np.searchsorted(recording.streams["imu"].t, 0.5)])
    assert np.linalg.eigvalsh(P)[-1] > (30.0 * DEGREE) ** 2
    assert nees(error, P) < 16.3  # chi-square of three, one in a thousand
