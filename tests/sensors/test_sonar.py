"""The sonar: its model against cosines written out, and each reason for which no echo comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_from_rpy
from sinan.sensors.simulate import simulate
from sinan.sensors.sonar import Sonar, range_from_time_of_flight

SONAR = Sonar(0.03, minimum=0.5, maximum=8.0, beam_angle=np.deg2rad(30.0))


def standing(height: float, roll_deg: float = 0.0, pitch_deg: float = 0.0) -> Motion:
    """One instant over ground at down = 2 m."""
    rpy = np.deg2rad([[roll_deg, pitch_deg, 70.0]])
    return Motion(np.zeros(1), np.array([[3.0, -4.0, 2.0 - height]]), q_nb=quaternion_from_rpy(rpy), ground_down=2.0)


def heard(motion: Motion, softness: FloatArray | float = 0.0, threshold: float = 1.0) -> bool:
    return bool(SONAR.echo(motion, softness, threshold)[0])


def test_it_reads_the_height_over_the_cosine_of_the_tilt() -> None:
    found = Sonar(0.03).predict(standing(4.0, 20.0, -25.0))[0, 0]
    assert found == pytest.approx(4.0 / (np.cos(np.deg2rad(20.0)) * np.cos(np.deg2rad(25.0))), rel=1e-12)


@pytest.mark.parametrize(("height", "comes"), [(0.49, False), (0.51, True), (7.99, True), (8.01, False)])
def test_an_echo_comes_from_within_the_range(height: float, comes: bool) -> None:
    assert heard(standing(height)) == comes


def test_the_range_that_counts_is_the_slant_one() -> None:
    """7.5 m at 25 deg are 8.28 m along the beam."""
    assert heard(standing(7.5))
    assert not heard(standing(7.5, 25.0))
    assert heard(standing(0.48, 25.0))


@pytest.mark.parametrize(("roll", "pitch", "comes"), [(29.0, 0.0, True), (31.0, 0.0, False), (0.0, -31.0, False)])
def test_beyond_the_beam_angle_the_echo_is_mirrored_away(roll: float, pitch: float, comes: bool) -> None:
    assert heard(standing(4.0, roll, pitch)) == comes


@pytest.mark.parametrize(("softness", "reach"), [(0.0, 8.0), (0.36, 6.4), (0.75, 4.0), (0.99, 0.8)])
def test_a_soft_target_is_heard_as_far_as_a_quarter_of_the_energy_at_half_the_range(
    softness: float, reach: float
) -> None:
    """Energy (1 - s) / d^2 at the threshold of hearing: d = 8 m sqrt(1 - s), numbers worked out by hand."""
    assert heard(standing(reach - 0.01), softness)
    assert not heard(standing(reach + 0.01), softness)


def test_what_swallows_everything_is_never_heard_and_more_than_everything_is_everything() -> None:
    assert not heard(standing(0.6), 1.0)
    assert not heard(standing(0.6), 1.2)
    assert not heard(standing(8.1), -0.5)


def test_the_threshold_stretches_the_reach() -> None:
    assert heard(standing(3.9), threshold=0.5)
    assert not heard(standing(4.1), threshold=0.5)


def test_without_a_word_it_hears_every_ground_that_it_looks_at() -> None:
    hears = Sonar(0.03).echo
    assert hears(standing(1000.0))[0]
    assert hears(standing(0.001))[0]
    assert hears(standing(2.0, 80.0))[0]
    assert not hears(standing(2.0, 180.0))[0]


def test_every_reading_has_its_own_softness() -> None:
    both = standing(5.0).rows(np.array([0, 0]))
    assert SONAR.echo(both, np.array([0.0, 0.9])).tolist() == [True, False]


def test_a_time_of_flight_counts_there_and_back() -> None:
    """331.3 m/s at 0 degC and 343.2 m/s at 20 degC in dry air (CRC Handbook of Chemistry and Physics)."""
    found = range_from_time_of_flight(np.array([0.02, 0.02]), np.array([0.0, 20.0]))
    np.testing.assert_allclose(found, [3.313, 3.432], atol=0.001)


def test_a_soft_ground_loses_the_far_echoes_of_a_simulated_flight() -> None:
    """Softness 0.75: nothing beyond half of the sonar's 8 m, nearer readings as they were."""
    scenario = load_scenario("low_pass")
    soft = replace(scenario.sensors["sonar"], softness=0.75)
    hard = simulate(scenario, np.random.default_rng(1))[0].streams["sonar"]
    found = simulate(scenario.replace(sensors={**scenario.sensors, "sonar": soft}), np.random.default_rng(1))[0]
    stream = found.streams["sonar"]
    at = scenario.trajectory().motion(hard.t)
    slant = SONAR.predict(at)[:, 0]
    np.testing.assert_array_equal(stream.t, hard.t[slant <= 4.0])
    np.testing.assert_array_equal(stream["range"], hard["range"][slant <= 4.0])
