"""Noise levels of a log that declares none: simulated flights without their declaration; compass; heading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.compass import compass_of, corrected, direction_at
from sinan.calibration.levels.heading import with_heading
from sinan.calibration.levels.noise_levels import NoiseFit, _Problem, first_guess, fit_noise_levels, noise_levels
from sinan.calibration.levels.noise_start import reading_noise, resolution, within_imu
from sinan.estimator.filter.events import height_of
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.atmosphere import pressure_from_height
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, SensorSpec, Stream
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_from_rpy,
    quaternion_log,
    quaternion_multiply,
    rotate_back,
)
from sinan.sensors.simulate import simulate

#: Factors within which levels come back from a flight of a minute: noise of readings; IMU noise, which aiding sees
#: late; walks, which are taken at the upper end of what the log allows.
READING, IMU, WALK = 1.15, 2.0, 4.0
#: NIS of a stream at the levels that were found.
NIS = 0.1


def bare(recording: Recording) -> Recording:
    """The recording without what it declares of its noise."""
    return recording.replace(
        sensors={n: SensorSpec(angles=s.angles, base_position=s.base_position) for n, s in recording.sensors.items()}
    )


@pytest.fixture(scope="module")
def flight() -> tuple[Recording, Stream]:
    return simulate(load_scenario("figure_eight"), np.random.default_rng(5))


@pytest.fixture(scope="module")
def fit(flight: tuple[Recording, Stream]) -> NoiseFit:
    return fit_noise_levels(bare(flight[0]))


@pytest.mark.parametrize("sensor", ["mag", "baro", "sonar", "laser", "gps"])
def test_noise_of_readings_comes_back(flight: tuple[Recording, Stream], fit: NoiseFit, sensor: str) -> None:
    ratio = fit.specs[sensor].noise_std / flight[0].spec(sensor).noise_std  # type: ignore[operator]
    assert 1.0 / READING < ratio < READING


@pytest.mark.parametrize("sensor", ["accel", "gyro"])
def test_noise_of_the_imu_comes_back(flight: tuple[Recording, Stream], fit: NoiseFit, sensor: str) -> None:
    ratio = fit.specs[sensor].noise_density / flight[0].spec(sensor).noise_density  # type: ignore[operator]
    assert 1.0 / READING < ratio < IMU


@pytest.mark.parametrize("sensor", ["accel", "gyro", "mag", "baro", "gps"])
def test_walks_are_not_too_small(flight: tuple[Recording, Stream], fit: NoiseFit, sensor: str) -> None:
    ratio = fit.specs[sensor].bias_walk / flight[0].spec(sensor).bias_walk  # type: ignore[operator]
    assert 0.7 < ratio < WALK


def test_nis_is_one(flight: tuple[Recording, Stream], fit: NoiseFit) -> None:
    journal = run_filter(bare(flight[0]), flight_model(bare(flight[0]), specs=fit.specs), engine="numba")
    assert all(abs(value - 1.0) < NIS for value in journal.nis_per_dof().values())


def test_a_field_alone_is_sought(flight: tuple[Recording, Stream]) -> None:
    """Every noise is declared: either the field gains, and its direction is said, or nothing is left to seek."""
    assert fit_noise_levels(flight[0], seek_field=True).m_n is None
    north, _, down = flight[0].environment.magnetic_field  # type: ignore[misc]
    elsewhere = replace(flight[0].environment, magnetic_field=(north, 0.3 * north, down))
    found = fit_noise_levels(flight[0].replace(environment=elsewhere), seek_field=True).m_n
    assert found is not None
    true = np.asarray(flight[0].environment.magnetic_field)
    assert abs(np.arctan2(found[1], found[0]) - np.arctan2(true[1], true[0])) < np.deg2rad(2.0)


@pytest.mark.parametrize("placed", [True, False])
def test_norm_of_the_field_is_sought_and_the_place_says_its_direction(
    flight: tuple[Recording, Stream], placed: bool
) -> None:
    recording = flight[0]
    true = np.asarray(recording.environment.magnetic_field)
    environment = replace(recording.environment, magnetic_field=0.97 * true)
    asked = recording.replace(environment=environment, origin=recording.origin if placed else None)
    found = fit_noise_levels(asked, seek_field=True).m_n
    assert found is not None
    assert np.linalg.norm(found) == pytest.approx(float(np.linalg.norm(true)), rel=0.01)
    turned = np.rad2deg(np.arccos(found @ true / np.linalg.norm(found) / np.linalg.norm(true)))
    assert turned < 0.5


def test_a_bias_of_the_accelerometer_is_known_only_where_nothing_shows_it(handheld: tuple[Recording, Stream]) -> None:
    """A height sensor shows its vertical part."""
    recording = bare(handheld[0])
    height = Stream(np.arange(0.0, 10.0, 0.1), {"height": np.random.default_rng(1).standard_normal(100)})
    for streams, known in ((recording.streams, True), ({**recording.streams, "baro": height}, False)):
        specs, _, _ = first_guess(recording.replace(streams=streams))
        assert (specs["accel"].bias_std == 0.0) == known
        assert (specs["accel"].bias_walk == 0.0) == known


def test_what_is_declared_stays(flight: tuple[Recording, Stream]) -> None:
    recording = flight[0]
    assert dict(noise_levels(recording)) == {name: recording.spec(name) for name in noise_levels(recording)}


def test_every_estimate_is_named(fit: NoiseFit) -> None:
    for sensor, key in (*fit.estimated, *fit.assumed):
        assert sum(note.startswith(f"{sensor}: ") and f"{key} " in note for note in fit.notes) == 1
    assert any(note.startswith("gps: noise_std") and "estimated from the log" in note for note in fit.notes)


def test_declared_key_stays_and_the_rest_is_found(flight: tuple[Recording, Stream]) -> None:
    recording = bare(flight[0])
    half = recording.replace(sensors={**recording.sensors, "mag": SensorSpec(noise_std=0.007)})
    specs, missing, _ = first_guess(half)
    assert specs["mag"].noise_std == 0.007
    assert ("mag", "bias_walk") in missing


@pytest.mark.parametrize("effects", [[], ["mag.current=0.01,0,0.005"]])
def test_every_level_is_in_the_likelihood(effects: list[str]) -> None:
    """The filter that the levels are sought with is the filter at those levels: of the IMU, too."""
    shown = [parse_effect(e) for e in effects]
    recording, _ = simulate(load_scenario("hover"), np.random.default_rng(6), shown, declare=bool(effects))
    asked = bare(recording)
    specs, missing, _ = first_guess(asked)
    problem = _Problem(asked, specs, tuple(missing))
    for i, key in enumerate(missing):
        theta = 1.5 * np.eye(len(missing))[i]
        levels = problem.specs_of(theta)
        at_levels = flight_model(asked, specs=levels, gate_level=None)
        known = run_filter(asked, at_levels, stride=0).log_likelihood
        assert problem.journal(theta, robust_level=None).log_likelihood == pytest.approx(known, abs=0.5), key


def test_an_effect_that_is_declared_is_no_noise() -> None:
    recording, _ = simulate(
        load_scenario("figure_eight"),
        np.random.default_rng(5),
        [parse_effect("mag.current=0.01,0,0.005")],
        declare=True,
    )
    truth = recording.spec("mag").noise_std
    asked = recording.replace(sensors={**recording.sensors, "mag": SensorSpec()})
    as_declared, as_nothing = (fit_noise_levels(one).specs["mag"] for one in (asked, asked.replace(effects={})))
    assert as_declared.noise_std == pytest.approx(truth, rel=READING - 1.0)
    assert as_nothing.bias_walk > 3.0 * as_declared.bias_walk  # type: ignore[operator]


def test_third_differences_see_noise_not_motion() -> None:
    rng, t = np.random.default_rng(2), np.arange(4000) * 0.1
    values = 20.0 * np.sin(0.2 * t)[:, None] + 0.3 * rng.standard_normal((4000, 1))
    values[::500] += 50.0
    assert reading_noise(values) == pytest.approx(0.3, rel=0.08)


def test_rounding_is_the_least_noise() -> None:
    values = np.round(np.cumsum(np.random.default_rng(3).standard_normal(2000)) * 0.01, 1)[:, None]
    assert resolution(values) == pytest.approx(0.1)
    assert reading_noise(values) >= 0.99 * 0.1 / np.sqrt(12.0)


@pytest.fixture(scope="module")
def handheld() -> tuple[Recording, Stream]:
    return simulate(load_scenario("no_aiding"), np.random.default_rng(4))


def shifted(recording: Recording, offset: np.ndarray) -> Recording:
    """The recording with more hard iron, without what it declares of the field."""
    moved = with_mag(bare(recording), recording.streams["mag"].array(MAG) + offset)
    return moved.replace(environment=replace(recording.environment, magnetic_field=None))


def test_hard_iron_within_its_sigma(handheld: tuple[Recording, Stream]) -> None:
    recording, truth = handheld
    offset = np.array([0.3, -0.2, 0.5])
    bias = np.mean([truth[f"bias_mag_{axis}"] for axis in "xyz"], axis=1)
    compass = compass_of(shifted(recording, offset))
    assert np.all(np.abs(compass.offset - offset - bias) < 4.0 * np.maximum(compass.std, 2e-3))


def test_field_of_the_compass_is_the_declared_one(handheld: tuple[Recording, Stream]) -> None:
    compass = compass_of(shifted(handheld[0], np.array([0.3, -0.2, 0.5])))
    declared = handheld[0].environment.magnetic_field
    assert declared is not None
    assert compass.norm == pytest.approx(float(np.linalg.norm(declared)), rel=0.02)
    assert np.sin(compass.dip) == pytest.approx(declared[2] / np.linalg.norm(declared), abs=0.03)


def test_dip_of_the_place_separates_hard_iron_from_field_near_level() -> None:
    """A body that turns about the vertical alone: without the dip, vertical field and vertical hard iron are one."""
    rng, t = np.random.default_rng(7), np.arange(0.0, 60.0, 0.1)
    dip, east = direction_at((47.0, 8.0, 400.0))
    yaw, offset = 0.3 * t, np.array([0.1, -0.05, 0.2])
    level = 0.5 * np.array([np.cos(dip), 0.0, np.sin(dip)])
    body = np.stack([level[0] * np.cos(yaw), -level[0] * np.sin(yaw), np.full(len(t), level[2])], axis=-1)
    mag = body + offset + 1e-3 * rng.standard_normal(body.shape)
    still = {name: np.full(len(t), value) for name, value in zip(ACCEL + GYRO, (0, 0, -9.81, 0, 0, 0.3), strict=True)}
    streams = {"imu": Stream(t, still), "mag": Stream(t, dict(zip(MAG, mag.T, strict=True)))}
    compass = compass_of(Recording("level", "flight", streams, origin=(47.0, 8.0, 400.0)))
    assert np.all(np.abs(compass.offset - offset) < 4.0 * np.maximum(compass.std, 1e-3))
    assert compass.norm == pytest.approx(0.5, rel=0.01)
    assert (compass.dip, compass.declination) == (dip, east)


@pytest.mark.parametrize("scenario", ["hover", "figure_eight", "climb_descent", "yaw_turns", "takeoff_landing"])
@pytest.mark.parametrize("placed", [True, False])
def test_what_a_flight_does_not_show_of_the_hard_iron_is_not_invented(scenario: str, placed: bool) -> None:
    """The sphere of the noise about the mean reading is no field, and a tilt that accelerations feign is no turn."""
    recording, truth = simulate(load_scenario(scenario), np.random.default_rng(12))
    undeclared = shifted(recording, np.zeros(3)).replace(origin=recording.origin if placed else None)
    compass = compass_of(undeclared)
    true = float(np.linalg.norm(np.asarray(recording.environment.magnetic_field)))
    bias = np.mean([truth[f"bias_mag_{axis}"] for axis in "xyz"], axis=1)
    assert compass.norm == pytest.approx(true, rel=0.03)
    assert np.all(np.abs(compass.offset - bias) < np.minimum(4.0 * np.maximum(compass.std, 2e-3), 0.1))


OFFSET, FIELD = np.array([0.3, -0.2, 0.4]), np.array([0.4, 0.0, 0.8])


def turned_by_hand(seconds: float, rest: float = 0.0) -> Recording:
    """A magnetometer and an IMU that lie for a while and are then turned about; soft iron of 5 %."""
    rng, t = np.random.default_rng(8), np.arange(0.0, rest + seconds, 0.05)
    angle = np.stack([0.9 * np.sin(0.7 * t), 1.1 * np.sin(0.9 * t), 0.8 * t], axis=-1) * (t >= rest)[:, None]
    q = quaternion_from_rpy(angle)
    mag = rotate_back(q, np.tile(FIELD, (len(t), 1))) @ np.diag([1.05, 0.95, 1.0]) + OFFSET
    force = rotate_back(q, np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    turn = quaternion_log(quaternion_multiply(quaternion_conjugate(q[:-1]), q[1:])) / 0.05
    imu = np.hstack([force + 0.05 * rng.standard_normal(force.shape), np.vstack([turn[:1], turn])])
    mag = mag + 2e-3 * rng.standard_normal(mag.shape)
    streams = {
        "imu": Stream(t, dict(zip(ACCEL + GYRO, imu.T, strict=True))),
        "mag": Stream(t, dict(zip(MAG, mag.T, strict=True))),
    }
    return Recording("hand", "flight", streams)


def with_mag(recording: Recording, mag: np.ndarray) -> Recording:
    """The recording with other readings of the magnetometer."""
    stream = Stream(recording.streams["mag"].t, dict(zip(MAG, mag.T, strict=True)))
    return recording.replace(streams={**recording.streams, "mag": stream})


def assert_found(recording: Recording) -> None:
    compass = compass_of(recording)
    assert np.all(np.abs(compass.offset - OFFSET) < 0.1)
    assert compass.norm == pytest.approx(float(np.linalg.norm(FIELD)), rel=0.05)


def test_a_rest_does_not_outvote_the_turns() -> None:
    """Five minutes on the table, half a minute in the hand."""
    assert_found(turned_by_hand(30.0, rest=300.0))


def test_a_burst_of_garbage_is_not_what_is_usual() -> None:
    recording = turned_by_hand(60.0)
    mag = recording.streams["mag"].array(MAG).copy()
    mag[200:250] += 3.0 * np.random.default_rng(2).standard_normal((50, 3))
    assert_found(with_mag(recording, mag))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_dropout_of_zeros_is_left_out() -> None:
    recording = turned_by_hand(60.0)
    mag = recording.streams["mag"].array(MAG).copy()
    mag[200:300] = 0.0
    assert_found(with_mag(recording, mag))


def test_few_readings_are_no_noise() -> None:
    """Quick turns between two readings a second: their differences are no noise."""
    recording = turned_by_hand(20.0)
    few = recording.replace(streams={**recording.streams, "mag": recording.streams["mag"].rows(slice(0, None, 10))})
    assert np.all(np.abs(compass_of(few).offset - OFFSET) < 0.2)


def test_an_accelerometer_without_force_is_an_error() -> None:
    recording = turned_by_hand(20.0)
    imu = recording.streams["imu"]
    still = Stream(imu.t, {name: np.zeros(len(imu)) for name in imu.columns})
    with pytest.raises(InputError, match="no force in the readings"):
        compass_of(recording.replace(streams={**recording.streams, "imu": still}))


def test_a_scan_of_the_laser_has_the_noise_of_a_beam(flight: tuple[Recording, Stream]) -> None:
    recording, laser = flight[0], flight[0].streams["laser"]
    noise = recording.spec("laser").noise_std
    assert noise is not None
    rng = np.random.default_rng(3)
    beams = {f"range_{k}": laser["range"] + 0.5 * k + noise * rng.standard_normal(len(laser)) for k in range(3)}
    scan = bare(recording).replace(
        streams={**recording.streams, "laser": Stream(laser.t, beams)},
        sensors={"laser": SensorSpec(angles=np.array([-0.2, 0.0, 0.2]))},
    )
    specs, _, _ = first_guess(scan)
    assert specs["laser"].noise_std == pytest.approx(np.sqrt(2.0) * noise, rel=0.1)  # a beam's and the range's own


def test_a_barometer_that_gives_pressure_alone_has_the_noise_of_its_height(flight: tuple[Recording, Stream]) -> None:
    recording, baro = flight[0], flight[0].streams["baro"]
    pressure = Stream(baro.t, {"pressure": pressure_from_height(baro["height"])})
    bare_specs, _, _ = first_guess(bare(recording))
    specs, _, _ = first_guess(bare(recording).replace(streams={**recording.streams, "baro": pressure}))
    assert specs["baro"].noise_std == pytest.approx(bare_specs["baro"].noise_std, rel=0.01)


def test_a_pressure_has_one_zero_with_or_without_what_lies_outside(flight: tuple[Recording, Stream]) -> None:
    """A logger that was switched on at the foot of the mountain."""
    recording = flight[0]
    baro, start = recording.streams["baro"], recording.streams["imu"].t[0]
    pressure = pressure_from_height(baro["height"])
    early = Stream(
        np.concatenate([start - np.array([20.0, 10.0]), baro.t]),
        {"pressure": np.concatenate([pressure_from_height(np.array([-300.0, -200.0])), pressure])},
    )
    whole = recording.replace(streams={**recording.streams, "baro": early})
    np.testing.assert_array_equal(height_of(whole)[2:], height_of(within_imu(whole)))


def test_angles_and_beams_of_a_scan_must_agree(flight: tuple[Recording, Stream]) -> None:
    recording, laser = flight[0], flight[0].streams["laser"]
    beams = Stream(laser.t, {f"range_{k}": laser["range"] for k in range(3)})
    for angles in (None, np.array([-0.2, 0.2])):
        spec = replace(recording.spec("laser"), angles=angles)
        scan = recording.replace(
            streams={**recording.streams, "laser": beams}, sensors={**recording.sensors, "laser": spec}
        )
        with pytest.raises(InputError, match=r"range_2.*expected [12] range.*angles"):
            run_filter(scan, flight_model(scan), engine="numba")


def test_no_pressure_is_an_error(flight: tuple[Recording, Stream]) -> None:
    baro = flight[0].streams["baro"]
    pressure = pressure_from_height(baro["height"])
    pressure[3] = 0.0
    streams = {**flight[0].streams, "baro": Stream(baro.t, {"pressure": pressure})}
    with pytest.raises(InputError, match="row 4: pressure 0 Pa; expected above 0"):
        first_guess(flight[0].replace(streams=streams))


def test_readings_outside_the_imus_time_change_no_level(flight: tuple[Recording, Stream], fit: NoiseFit) -> None:
    """A GPS that was logged for as long again before and after, at rest elsewhere."""
    recording = bare(flight[0])
    gps, imu = recording.streams["gps"], recording.streams["imu"].t
    span, rows = imu[-1] - imu[0] + 1.0, len(gps)
    t = np.concatenate([gps.t - span, gps.t, gps.t + span])
    far = {name: np.concatenate([np.full(rows, 50.0), gps[name], np.full(rows, 90.0)]) for name in gps.columns}
    longer = recording.replace(streams={**recording.streams, "gps": Stream(t, far)})
    assert fit_noise_levels(longer).specs == fit.specs


def test_zero_of_a_barometer_is_a_bias_and_no_height(flight: tuple[Recording, Stream], fit: NoiseFit) -> None:
    """Height above the sea beside a GPS that counts from the first fix."""
    recording = bare(flight[0])
    baro = recording.streams["baro"]
    above_sea = Stream(baro.t, {**baro.columns, "height": baro["height"] + 1800.0})
    recording = recording.replace(streams={**recording.streams, "baro": above_sea})
    found = fit_noise_levels(recording)
    assert found.specs["baro"].bias_std == pytest.approx(1800.0, rel=0.01)
    assert found.specs["baro"].noise_std == pytest.approx(fit.specs["baro"].noise_std, rel=0.1)
    journal = run_filter(recording, flight_model(recording, specs=found.specs), engine="numba")
    truth = np.interp(journal.imu_t, flight[1].t, flight[1]["down"])
    assert np.sqrt(np.mean((journal.imu_x[:, 2] - truth) ** 2)) < 1.5
    assert journal.x_end[journal.model.layout.nominal("b_baro")] == pytest.approx(1800.0, abs=5.0)


def test_a_stream_on_another_clock_is_an_error(flight: tuple[Recording, Stream]) -> None:
    recording = bare(flight[0])
    baro = recording.streams["baro"]
    late = recording.replace(streams={**recording.streams, "baro": Stream(baro.t + 1e6, baro.columns)})
    with pytest.raises(InputError, match="one clock"):
        fit_noise_levels(late)


def test_a_noise_that_no_level_makes_white_is_named() -> None:
    key = ("sonar", "noise_std")
    fit = NoiseFit({"sonar": SensorSpec(noise_std=1.0)}, (key,), (), {"sonar": 1.7, "gps": 3.0})
    assert [doubt.split(":")[0] for doubt in fit.doubts] == ["sonar"]


@pytest.mark.parametrize("factor", [1.08, 2.0])
def test_disturbed_stretch_is_left_out(handheld: tuple[Recording, Stream], factor: float) -> None:
    """A place where the field is stronger."""
    recording = handheld[0]
    mag = recording.streams["mag"]
    wrong = (mag.t > 40.0) & (mag.t < 50.0)
    columns = {name: mag[name] * np.where(wrong, factor, 1.0) for name in MAG}
    recording = recording.replace(streams={**recording.streams, "mag": Stream(mag.t, columns)})
    compass = compass_of(recording)
    assert np.mean(compass.disturbed[wrong]) > 0.95
    assert np.mean(compass.disturbed[~wrong]) < 0.05
    assert any("left out" in note for note in corrected(recording, compass).notes)


@pytest.mark.parametrize("seconds", [6.0, 20.0])
def test_magnet_on_the_instrument_is_left_to_the_loop(handheld: tuple[Recording, Stream], seconds: float) -> None:
    """About another hard iron the norm is the field's: the readings are kept, and the fit goes without them."""
    recording = handheld[0]
    mag = recording.streams["mag"]
    there = (mag.t > 40.0) & (mag.t < 40.0 + seconds)
    columns = {name: mag[name] + 0.5 * there for name in MAG}
    with_magnet = recording.replace(streams={**recording.streams, "mag": Stream(mag.t, columns)})
    compass, without = compass_of(with_magnet), compass_of(recording)
    assert np.mean(compass.shifted[there]) > 0.95
    assert not np.any(compass.disturbed)
    assert np.all(np.abs(compass.offset - without.offset) < 3.0 * compass.std)
    for keep in (False, True):
        one = corrected(with_magnet, compass, keep_shifted=keep)
        assert (len(one.streams["mag"]) == len(mag)) == keep
        assert any("about another hard iron" in note for note in one.notes)


def test_attitude_alone_has_no_nan_and_bounded_nis(handheld: tuple[Recording, Stream]) -> None:
    recording = bare(handheld[0])
    specs = noise_levels(recording)
    journal = run_filter(recording, flight_model(recording, specs=specs), engine="numba")
    assert np.all(np.isfinite(journal.imu_x))
    assert all(value < 1.5 for value in journal.nis_per_dof().values())


def test_heading_is_found_without_a_magnetometer(flight: tuple[Recording, Stream]) -> None:
    recording, truth = flight
    streams = {name: stream for name, stream in recording.streams.items() if name != "mag"}
    initial = replace(recording.initial, quaternion=None, attitude_std=None)
    found = with_heading(recording.replace(streams=streams, initial=initial), recording.sensors)
    q = truth.array(("qw", "qx", "qy", "qz"))[0]
    assert found.initial.quaternion is not None
    error = quaternion_log(quaternion_multiply(quaternion_conjugate(q), found.initial.quaternion))
    assert np.linalg.norm(error) < np.deg2rad(15.0)


@pytest.mark.parametrize("sensor", ["baro", "gps"])
def test_one_reading_of_undeclared_noise_is_an_error(flight: tuple[Recording, Stream], sensor: str) -> None:
    recording = bare(flight[0])
    one = recording.replace(streams={**recording.streams, sensor: recording.streams[sensor].rows(slice(0, 1))})
    with pytest.raises(InputError, match="1 reading and no noise_std"):
        first_guess(one)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_one_reading_of_declared_noise_is_none(flight: tuple[Recording, Stream]) -> None:
    recording = flight[0]
    one = recording.replace(
        streams={**recording.streams, "baro": recording.streams["baro"].rows(slice(0, 1))},
        sensors={"baro": recording.spec("baro")},
    )
    specs, _, _ = first_guess(one)
    assert specs["baro"].noise_std == recording.spec("baro").noise_std


@pytest.mark.parametrize(("sensor", "columns"), [("baro", ("height",)), ("mag", MAG)])
def test_readings_that_nobody_measured_are_an_error(
    flight: tuple[Recording, Stream], sensor: str, columns: tuple[str, ...]
) -> None:
    stream = flight[0].streams[sensor]
    zeros = Stream(stream.t, {**stream.columns, **{name: np.zeros(len(stream)) for name in columns}})
    recording = bare(flight[0]).replace(streams={**flight[0].streams, sensor: zeros})
    with pytest.raises(InputError, match="without any noise and no noise_std"):
        first_guess(recording)


def test_a_magnetometer_that_reads_no_field_is_an_error(handheld: tuple[Recording, Stream]) -> None:
    with pytest.raises(InputError, match="no field in the readings"):
        compass_of(with_mag(handheld[0], np.zeros((len(handheld[0].streams["mag"]), 3))))
