"""What a log shows of its field, its compass and its samples before any size is sought."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.calibration.levels import iron
from sinan.calibration.levels.fields import DECLINATION_STD, beforehand, fitted
from sinan.calibration.levels.iron import iron_of_turns
from sinan.calibration.levels.preparation import prepared
from sinan.calibration.levels.sizes import AS_IT_COMES, CALIBRATED
from sinan.estimator.filter.layout import Q_NB
from sinan.sensors.geomagnetism import direction_at, field_along, inclination
from sinan.sensors.recording import ACCEL, GYRO, MAG, Environment, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_from_rpy, rotate_back, rpy_from_quaternion
from tests.estimator.analytic_flight import fly

ZURICH = (47.4, 8.5, 400.0)


def turned_at(origin: tuple[float, float, float] | None, m_n: np.ndarray) -> Recording:
    """A board that is turned to and fro about all axes in a field, and says where on the Earth it is."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 40.0, 0.02)
    rpy = np.stack([0.4 * np.sin(0.7 * t), 0.5 * np.sin(0.9 * t), 0.8 * np.sin(0.3 * t)], axis=-1)
    roll, pitch, _ = rpy.T
    rates = np.stack([0.28 * np.cos(0.7 * t), 0.45 * np.cos(0.9 * t), 0.24 * np.cos(0.3 * t)], axis=-1)
    w = np.stack(
        [
            rates[:, 0] - np.sin(pitch) * rates[:, 2],
            np.cos(roll) * rates[:, 1] + np.sin(roll) * np.cos(pitch) * rates[:, 2],
            -np.sin(roll) * rates[:, 1] + np.cos(roll) * np.cos(pitch) * rates[:, 2],
        ],
        axis=-1,
    )
    q = quaternion_from_rpy(rpy)
    f = rotate_back(q, np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    imu = np.concatenate([f + 0.02 * rng.standard_normal(f.shape), w + 1e-3 * rng.standard_normal(w.shape)], axis=1)
    m = rotate_back(q, np.tile(m_n, (len(t), 1)))
    mag = (m + 0.003 * rng.standard_normal(m.shape))[::5]
    streams = {
        "imu": Stream(t, dict(zip((*ACCEL, *GYRO), imu.T, strict=True))),
        "mag": Stream(t[::5], dict(zip(MAG, mag.T, strict=True))),
    }
    return Recording("board", "flight", streams, origin=origin, environment=Environment())


@pytest.mark.parametrize(
    ("off", "words"),
    [(0.0, "of the place"), (0.12, "of the place, but beside steel"), (0.9, "not that of the place")],
)
def test_the_log_says_whether_its_field_is_that_of_the_place(off: float, words: str) -> None:
    dip, east = direction_at(ZURICH)
    m_n = field_along(0.5, dip - off, east)
    found = beforehand(turned_at(ZURICH, m_n)).field
    assert found is not None
    assert found.words.endswith(words)
    error = inclination(found.m_n) - inclination(m_n)
    assert abs(error) < 0.13 if off < 0.5 else abs(error) < 0.05


def test_without_a_place_there_is_one_belief() -> None:
    found = beforehand(turned_at(None, field_along(0.5, -0.6, 0.0))).field
    assert found is not None
    assert found.prior == 1.0
    assert np.linalg.norm(found.m_n) == pytest.approx(0.5, rel=0.02)
    assert inclination(found.m_n) == pytest.approx(-0.6, abs=0.05)


@pytest.mark.parametrize(("hard_iron", "iron"), [(0.0, CALIBRATED), (0.02, CALIBRATED), (0.25, AS_IT_COMES)])
@pytest.mark.parametrize("origin", [None, ZURICH])
def test_the_log_says_whether_its_compass_was_calibrated(
    origin: tuple[float, float, float] | None, hard_iron: float, iron: float
) -> None:
    board = turned_at(origin, field_along(0.5, *direction_at(ZURICH)))
    assert beforehand(with_iron(board, hard_iron * np.array([0.6, -0.7, 0.4]))).iron == iron


def with_iron(board: Recording, iron: np.ndarray) -> Recording:
    """The same, with hard iron in its readings."""
    mag = board.streams["mag"]
    columns = dict(zip(MAG, (mag.array(MAG) + iron).T, strict=True))
    return board.replace(streams={**board.streams, "mag": Stream(mag.t, columns)})


@pytest.mark.parametrize("rate", [0.0, 0.05])
def test_turns_show_the_hard_iron(rate: float) -> None:
    iron = np.array([0.36, -0.42, 0.24])
    board = with_iron(turned_at(None, field_along(0.5, 1.1, 0.0)), iron)
    imu = board.streams["imu"]
    columns = {name: column + (rate if name in GYRO else 0.0) for name, column in imu.columns.items()}
    found, sigma = iron_of_turns(board.replace(streams={**board.streams, "imu": Stream(imu.t, columns)}), 0.3, 0.01)
    assert sigma < 0.01
    assert np.linalg.norm(found - iron) < 3.0 * np.sqrt(3.0) * sigma


@pytest.mark.parametrize("rounds", [iron.ROUNDS // 2, 2 * iron.ROUNDS])
def test_half_and_twice_of_the_rounds_find_the_same_iron(rounds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    board = with_iron(turned_at(None, field_along(0.5, 1.1, 0.0)), np.array([0.36, -0.42, 0.24]))
    imu = board.streams["imu"]
    columns = {name: column + (0.05 if name in GYRO else 0.0) for name, column in imu.columns.items()}
    board = board.replace(streams={**board.streams, "imu": Stream(imu.t, columns)})
    found, sigma = iron_of_turns(board, 0.3, 0.01)
    monkeypatch.setattr(iron, "ROUNDS", rounds)
    assert np.linalg.norm(iron_of_turns(board, 0.3, 0.01)[0] - found) < sigma


def test_what_does_not_turn_shows_no_hard_iron() -> None:
    board = with_iron(turned_at(None, field_along(0.5, 1.1, 0.0)), np.array([0.3, 0.0, 0.0]))
    for name, columns in (("imu", GYRO), ("mag", MAG)):
        stream = board.streams[name]
        still = {k: np.full(len(stream), c[0] if k in columns else 0.0) for k, c in stream.columns.items()}
        still |= {k: 0.0 * c for k, c in stream.columns.items() if k in GYRO}
        board = board.replace(streams={**board.streams, name: Stream(stream.t, still)})
    found, sigma = iron_of_turns(board, 0.3, 0.01)
    assert np.all(np.abs(found) < 1e-6)
    assert sigma == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("heading", [0.5, 2.0, -2.5])
def test_iron_larger_than_the_field_turns_no_heading(heading: float) -> None:
    """North of the iron and of the field may be opposite: no filter that is linear finds back from there."""
    level = np.array([np.cos(heading), np.sin(heading), 0.0])
    board = with_iron(turned_at(None, field_along(0.5, 1.1, 0.0)), 0.6 * level + np.array([0.0, 0.0, 0.2]))
    journal = prepared(board).run()
    yaw = rpy_from_quaternion(journal.imu_x[:, Q_NB])[:, 2]
    truth = 0.8 * np.sin(0.3 * journal.imu_t)
    late = journal.imu_t > 5.0
    assert np.max(np.abs(np.angle(np.exp(1j * (yaw - truth))))[late]) < np.deg2rad(5.0)


@pytest.mark.parametrize(("imu_samples", "every"), [("instant", 25), ("average", 10)])
def test_a_flight_says_what_its_samples_are(imu_samples: str, every: int) -> None:
    """Instants are told from means where steps are long (125 ms). Means over 50 ms are near to instants of streams
    that are early by half of it, so it has to count that their streams are of one clock.
    """
    recording, _ = fly(4, duration=60.0, sensors=("gps", "mag", "baro"))
    imu = recording.streams["imu"]
    rows = np.arange(every, len(imu), every)
    columns = {
        name: column[rows]
        if imu_samples == "instant"
        else np.array([np.trapezoid(column[k - every : k + 1]) / every for k in rows])
        for name, column in imu.columns.items()
    }
    slow = recording.replace(sensors={}, streams={**recording.streams, "imu": Stream(imu.t[rows], columns)})
    assert fitted(slow, beforehand(slow)).specs["accel"].imu_samples == imu_samples


def test_a_declared_kind_of_samples_stays() -> None:
    board = turned_at(None, field_along(0.5, -0.6, 0.0))
    accel = SensorSpec(noise_density=1e-3)
    declared = board.replace(sensors={"accel": accel})
    assert fitted(declared, beforehand(declared)).specs["accel"].imu_samples == "instant"
    assert fitted(board, beforehand(board)).specs["accel"].imu_samples == "average"


def test_most_of_the_earth_between_60_degrees_has_a_smaller_declination_than_its_sigma() -> None:
    high = np.sin(np.deg2rad(60.0))
    latitudes = np.rad2deg(np.arcsin(np.linspace(-high, high, 22)[1:-1]))  # of equal areas
    east = [direction_at((lat, lon, 0.0))[1] for lat in latitudes for lon in np.arange(-180.0, 180.0, 15.0)]
    assert np.mean(np.abs(east) < DECLINATION_STD) == pytest.approx(0.62, abs=0.03)
