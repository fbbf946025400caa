"""The pseudorange model: orbits against precise ones, effects against their exact forms, what is left out and said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.constants import SPEED_OF_LIGHT, WGS84_GM
from sinan.sensors.effects import (
    effect,
    pseudorange_earth_rotation,
    pseudorange_group_delay,
    pseudorange_ionosphere,
    pseudorange_relativity,
    pseudorange_troposphere,
)
from sinan.sensors.ephemeris import SatelliteStates, geostationary, kepler_orbit, runge_kutta, satellite_states
from sinan.sensors.formats.rinex import read_navigation
from sinan.sensors.formats.rinex_text import WEEK, gps_seconds
from sinan.sensors.motion import Motion
from sinan.sensors.pseudorange import circumstances, full_size, pseudoranges
from tests.estimator import gnss_simulation as simulation

MILLIMETRE = 1e-3
CENTIMETRE = 1e-2
NAVIGATION = simulation.messages("G")


def test_velocity_is_the_derivative_of_position() -> None:
    t_k = np.full(len(NAVIGATION.kepler), 700.0)
    _, velocity = kepler_orbit(NAVIGATION.kepler, t_k)
    ahead, behind = (kepler_orbit(NAVIGATION.kepler, t_k + h)[0] for h in (0.5, -0.5))
    np.testing.assert_allclose(velocity, ahead - behind, atol=1e-4)


def test_geostationary_velocity_is_the_derivative_of_position() -> None:
    message = NAVIGATION.kepler[:1].copy()
    message["satellite"] = "C01"
    _, velocity = kepler_orbit(message, np.array([700.0]))
    ahead, behind = (kepler_orbit(message, np.array([700.0 + h]))[0] for h in (0.5, -0.5))
    np.testing.assert_allclose(velocity, ahead - behind, atol=1e-4)


def test_geostationary_turn_keeps_lengths() -> None:
    p, _ = geostationary(np.array([[4.2e7, 0.0, 1e5]]), np.zeros((1, 3)), np.array([7.29e-5]), np.array([1234.0]))
    assert np.linalg.norm(p) == pytest.approx(np.hypot(4.2e7, 1e5))


def test_runge_kutta_there_and_back() -> None:
    state = np.array([[7003e3, -12206e3, 21280e3, 783.0, 2804.0, 1352.0]])
    there = runge_kutta(state, np.zeros((1, 3)), np.array([900.0]))
    back = runge_kutta(there, np.zeros((1, 3)), np.array([-900.0]))
    np.testing.assert_allclose(back[:, :3], state[:, :3], atol=CENTIMETRE)


def one_row(**changes: float) -> tuple[int, float]:
    navigation = replace(NAVIGATION, kepler=NAVIGATION.kepler[:1].copy())
    t = changes.pop("t", simulation.START)
    for name, value in changes.items():
        navigation.kepler[name] = value
    states = satellite_states(navigation, np.array(["G01"]), simulation.WEEK_NUMBER, np.array([t]), np.array([2.2e7]))
    return int(states.status[0]), float(states.position[0, 0])


@pytest.mark.parametrize(
    ("changes", "status"),
    [({}, 0), ({"t": simulation.START + 7300.0}, 2), ({"health": 63.0}, 3), ({"accuracy": 8192.0}, 3)],
    ids=["used", "stale", "unhealthy", "no accuracy"],
)
def test_which_messages_are_used(changes: dict[str, float], status: int) -> None:
    found, x = one_row(**changes)
    assert found == status
    assert np.isfinite(x) == (status == 0)


def test_a_week_may_end_between_message_and_observation() -> None:
    saturday = (simulation.WEEK_NUMBER + 1) * WEEK - 600.0
    navigation = replace(NAVIGATION, kepler=NAVIGATION.kepler[:1].copy())
    navigation.kepler["toe"] = navigation.kepler["toc"] = saturday
    states = [
        satellite_states(navigation, np.array(["G01"]), week, np.array([t]), np.array([2.2e7]))
        for week, t in ((simulation.WEEK_NUMBER, WEEK + 60.0), (simulation.WEEK_NUMBER + 1, 60.0))
    ]
    assert states[0].status[0] == 0
    np.testing.assert_allclose(states[0].position, states[1].position, atol=MILLIMETRE)


def test_first_order_earth_rotation_is_exact_to_a_millimetre() -> None:
    satellite = simulation.simulated("G", epochs=1).position
    receiver = np.broadcast_to(simulation.RECEIVER, satellite.shape)
    motion = Motion(
        t=np.zeros(len(satellite)), covariates={"satellite_position": satellite, "receiver_position": receiver}
    )
    first = pseudorange_earth_rotation.regressor(motion)[:, 0, 0]
    exact = pseudorange_earth_rotation.exact(np.zeros((len(first), 1)), np.ones(1), motion)[:, 0]
    assert np.abs(first).max() > 10.0
    np.testing.assert_allclose(first, exact, atol=MILLIMETRE)


def test_relativity_is_that_of_the_eccentric_anomaly() -> None:
    """-2 sqrt(GM) e sqrt(A) sin E / c^2 on a Kepler orbit without corrections (IS-GPS-200N, 20.3.3.3.3.1)."""
    message = NAVIGATION.kepler[:1].copy()
    for name in ("crs", "crc", "cus", "cuc", "cis", "cic", "delta_n"):
        message[name] = 0.0
    message["e"] = 0.02
    t_k = np.array([1000.0])
    p, v = kepler_orbit(message, t_k)
    M = message["m0"] + np.sqrt(WGS84_GM) / message["sqrt_a"] ** 3 * t_k
    E = M
    for _ in range(20):
        E = M + 0.02 * np.sin(E)
    expected = 2.0 * np.sqrt(WGS84_GM) * 0.02 * message["sqrt_a"] * np.sin(E) / SPEED_OF_LIGHT
    motion = Motion(t=t_k, covariates={"satellite_position": p, "satellite_velocity": v})
    assert pseudorange_relativity.regressor(motion)[0, 0, 0] == pytest.approx(expected[0], abs=MILLIMETRE)


def test_troposphere_at_the_zenith() -> None:
    """2.3 m dry and 0.1 to 0.2 m wet at sea level; a third is gone at 3 km."""
    delay = pseudorange_troposphere.zenith_delay(np.radians([45.0, 45.0]), np.array([0.0, 3000.0]))
    assert 2.4 < delay[0] < 2.55
    assert 0.6 < delay[1] / delay[0] < 0.7
    assert pseudorange_troposphere.mapping(np.array([np.pi / 2]))[0] == pytest.approx(1.0, abs=1e-3)


def test_klobuchar_gives_the_published_example() -> None:
    """J. A. Klobuchar in Parkinson and Spilker (1996), p. 513: 40 N, 100 W, E = 20, A = 210 deg, 20:45: 23.784 m."""
    coefficients = np.array([[3.82e-8, 1.49e-8, -1.79e-7, 0.0, 1.43e5, 0.0, -3.28e5, 1.13e5]])
    angles = np.radians([[40.0], [-100.0], [20.0], [210.0]])
    found = pseudorange_ionosphere.klobuchar(coefficients, *angles, np.array([20.75 * 3600.0]))
    assert found[0] == pytest.approx(23.784, abs=MILLIMETRE)


def test_the_ionosphere_of_another_frequency_goes_with_its_square() -> None:
    """Without coefficients the zenith delay is one metre, on B1I (1575.42 / 1561.098)^2 = 1.01843 of it."""
    elevation, frequency = np.full(2, np.pi / 2), np.array([1575.42e6, 1561.098e6])
    motion = Motion(t=np.zeros(2), covariates={"elevation": elevation, "frequency": frequency})
    found = pseudorange_ionosphere.regressor(motion)[:, 0, 0]
    np.testing.assert_allclose(found, [1.000432, 1.018873], atol=1e-6)  # 1 + 16 x 0.03^3 at the zenith


def test_the_troposphere_is_as_long_as_its_slant_path() -> None:
    """Black and Eisner (1984): 1.001 / sqrt(0.002001 + sin^2 E), which is 1 / sin E but near the horizon."""
    motion = Motion(t=np.zeros(3), covariates={"elevation": np.radians([90.0, 30.0, 5.0])})
    found = pseudorange_troposphere.regressor(motion)[:, 0, 0]
    np.testing.assert_allclose(found, [1.0, 1.994, 10.219], atol=0.002)


def test_a_group_delay_of_five_nanoseconds_is_a_metre_and_a_half() -> None:
    motion = Motion(t=np.zeros(1), covariates={"group_delay": np.array([5e-9])})
    assert pseudorange_group_delay.regressor(motion)[0, 0, 0] == pytest.approx(1.49896, abs=1e-5)


def test_a_fault_hits_its_satellite_and_grows() -> None:
    faulty, elapsed = np.array([1.0, 0.0, 1.0]), np.array([0.0, 10.0, 20.0])
    motion = Motion(t=elapsed, covariates={"faulty": faulty, "elapsed": elapsed})
    found = effect("pseudorange.satellite_fault").apply(np.zeros((3, 1)), np.array([7.0, 0.5]), motion)
    np.testing.assert_allclose(found[:, 0], [7.0, 0.0, 17.0])


def klobuchar(hour: float) -> float:
    one = np.ones(1)
    value = pseudorange_ionosphere.klobuchar(
        simulation.KLOBUCHAR[None], 0.8 * one, 0.0 * one, np.pi / 2 * one, 0.0 * one, 3600.0 * hour * one
    )
    return float(value[0])


def test_klobuchar_at_night_and_at_two_in_the_afternoon() -> None:
    night = 5e-9 * SPEED_OF_LIGHT * (1.0 + 16.0 * 0.03**3)
    assert klobuchar(2.0) == pytest.approx(night, rel=1e-6)
    assert klobuchar(14.0) > max(klobuchar(11.0), klobuchar(17.0)) > night


def test_ionosphere_without_coefficients_has_no_known_size() -> None:
    ranges = replace(simulation.simulated("G", epochs=1), klobuchar=None)
    motion = circumstances(ranges, simulation.RECEIVER[None])
    assert not full_size("pseudorange.ionosphere", motion).any()


def test_unusable_satellites_are_said() -> None:
    navigation = replace(NAVIGATION, kepler=NAVIGATION.kepler.copy())
    observed = simulation.observe(navigation, np.array([simulation.START]))
    first, second = str(observed.satellite[0]), str(observed.satellite[1])
    navigation.kepler["health"][navigation.kepler["satellite"] == first] = 1.0
    navigation = replace(navigation, kepler=navigation.kepler[navigation.kepler["satellite"] != second])
    ranges = pseudoranges(observed, navigation, "G")
    assert not {first, second} & set(ranges.satellite.tolist())
    assert any("unhealthy" in line and first in line for line in ranges.journal)
    assert any("no navigation" in line and second in line for line in ranges.journal)


#: What stands for a clock that the file does not know [us].
NO_CLOCK = 999999.0


def at_precise_instants(measured_data: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, SatelliteStates]:
    """Satellite, time [s], precise position and clock (n, 4) [km, us] of GPS and GLONASS, and the broadcast states."""
    folder = measured_data / "gnss/esbjerg_static_2020"
    rows, time = [], 0.0
    for line in (folder / "GRG0MGXFIN_20201770000_01D_15M_ORB.SP3").read_text().splitlines():
        words = line.split()
        if line.startswith("*"):
            time = float(gps_seconds(*map(int, words[1:6])) or 0.0)
        elif line[:2] in ("PG", "PR") and time % 7200.0 == 900.0:
            rows.append((line[1:4], time, [float(word) for word in words[1:5]]))
    name, t, precise = np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
    navigation = read_navigation(folder / "ESBC00DNK_R_20201770000_01D_MN.rnx")
    week = int(t[0] // WEEK)
    return name, t, precise, satellite_states(navigation, name, week, t - week * WEEK, np.zeros(len(t)))


@pytest.mark.measured
def test_broadcast_orbits_against_precise_ones(measured_data: Path) -> None:
    """GPS within 6 m and GLONASS within 10 m of the precise orbits (which are of the centre of mass)."""
    name, _, precise, states = at_precise_instants(measured_data)
    x = 1e3 * precise[:, :3]
    error = np.linalg.norm(states.position - x, axis=1)
    used = states.status == 0
    assert used.sum() > 300
    assert error[used & (name.astype("<U1") == "G")].max() < 6.0
    assert error[used & (name.astype("<U1") == "R")].max() < 10.0


@pytest.mark.measured
def test_broadcast_clocks_against_precise_ones(measured_data: Path) -> None:
    """Polynomial and group delay of GPS within 5 ns of the precise clocks but for their common time scale."""
    name, t, precise, states = at_precise_instants(measured_data)
    used = (states.status == 0) & (name.astype("<U1") == "G") & (precise[:, 3] < NO_CLOCK)
    clock = 1e-6 * precise[:, 3]
    left = (states.clock - clock)[used]
    for instant in np.unique(t[used]):
        left[t[used] == instant] -= np.median(left[t[used] == instant])
    assert used.sum() > 200
    assert np.ptp(clock[used]) > 1e-4  # what is taken out
    assert np.sqrt(np.mean(left**2)) < 5e-9
