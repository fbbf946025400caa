"""First guesses of noise from the readings alone, what is no reading, and the first heading without a compass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.heading import with_heading
from sinan.calibration.levels.noise_start import reading_noise, within_imu
from sinan.calibration.levels.preparation import not_of_the_earth, prepared
from sinan.calibration.levels.sizes import sizes_of
from sinan.estimator.filter.events import height_of
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.atmosphere import pressure_from_height
from sinan.sensors.errors import InputError
from sinan.sensors.last_digit import rounding_variance
from sinan.sensors.recording import MAG, NO_HEIGHT, Recording, SensorSpec, Stream
from sinan.sensors.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between


def bare(recording: Recording) -> Recording:
    """The recording without what it declares of its noise."""
    return recording.replace(
        sensors={n: SensorSpec(angles=s.angles, base_position=s.base_position) for n, s in recording.sensors.items()}
    )


def declaring(recording: Recording, *sensors: str) -> Recording:
    """The recording with what it declares of the noise of some sensors alone."""
    return recording.replace(sensors={name: recording.spec(name) for name in sensors})


@pytest.fixture(scope="module")
def flight() -> tuple[Recording, Stream]:
    return simulate(load_scenario("figure_eight"), np.random.default_rng(5))


def first_guess(recording: Recording, sensor: str) -> float:
    """Median of the prior of a reading's white noise."""
    return next(size.median for size in sizes_of(recording) if (size.sensor, size.key) == (sensor, "noise_std"))


def test_third_differences_see_noise_not_motion() -> None:
    rng, t = np.random.default_rng(2), np.arange(4000) * 0.1
    values = 20.0 * np.sin(0.2 * t)[:, None] + 0.3 * rng.standard_normal((4000, 1))
    values[::500] += 50.0
    assert reading_noise(values, np.zeros(1)) == pytest.approx(0.3, rel=0.08)


def test_rounding_is_the_least_noise_and_what_is_above_it_the_instrument() -> None:
    rng = np.random.default_rng(3)
    fine = np.round(np.cumsum(rng.standard_normal(2000)) * 0.01, 1)[:, None]
    assert reading_noise(fine, rounding_variance(fine)) == pytest.approx(0.1 / np.sqrt(12.0))
    noisy = np.round(0.3 * rng.standard_normal((4000, 2)) / [0.01, 0.5]) * [0.01, 0.5]
    assert reading_noise(noisy, rounding_variance(noisy)) == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_what_stands_in_the_place_of_a_height_has_no_noise(flight: tuple[Recording, Stream], share: float) -> None:
    """Of all fixes one height, which in NED has the curve of the Earth and is no third of the receiver's; of some a
    jump.
    """
    recording, gps = bare(flight[0]), flight[0].streams["gps"]
    flat = np.random.default_rng(1).uniform(size=len(gps)) < share
    down = np.where(flat, 500.0 + (gps["north"] ** 2 + gps["east"] ** 2) / (2.0 * 6.4e6), gps["down"])
    fixes = Stream(gps.t, {**gps.columns, "down": down, "epv": np.where(flat, NO_HEIGHT, 0.5)})
    found = first_guess(recording.replace(streams={**recording.streams, "gps": fixes}), "gps")
    assert found == pytest.approx(first_guess(recording, "gps"), rel=0.06)


def test_white_noise_is_found_beside_a_longitude_of_few_digits(flight: tuple[Recording, Stream]) -> None:
    recording = between(flight[0], 0.0, 15.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps", "mag")})
    gps, white = recording.streams["gps"], recording.spec("gps").noise_std
    assert white is not None
    printed = {**gps.columns, "east": np.round(gps["east"] / 0.88) * 0.88}
    recording = recording.replace(streams={**recording.streams, "gps": Stream(gps.t, printed)})
    levels = prepared(declaring(recording, "accel", "gyro", "mag")).levels
    assert np.sqrt(levels.rounding["gps"][:3]) == pytest.approx([0.0, 0.88 / np.sqrt(12.0), 0.0], abs=0.02 * white)
    assert levels.specs["gps"].noise_std == pytest.approx(white, rel=0.35)


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
    assert first_guess(scan, "laser") == pytest.approx(np.sqrt(2.0) * noise, rel=0.1)  # a beam's and the range's own


def test_a_barometer_that_gives_pressure_alone_has_the_noise_of_its_height(flight: tuple[Recording, Stream]) -> None:
    recording, baro = flight[0], flight[0].streams["baro"]
    pressure = Stream(baro.t, {"pressure": pressure_from_height(baro["height"])})
    other = bare(recording).replace(streams={**recording.streams, "baro": pressure})
    assert first_guess(other, "baro") == pytest.approx(first_guess(bare(recording), "baro"), rel=0.01)


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
            run_filter(Flight.of(scan), engine="numba")


def test_no_pressure_is_an_error(flight: tuple[Recording, Stream]) -> None:
    baro = flight[0].streams["baro"]
    pressure = pressure_from_height(baro["height"])
    pressure[3] = 0.0
    streams = {**flight[0].streams, "baro": Stream(baro.t, {"pressure": pressure})}
    with pytest.raises(InputError, match="row 4: pressure 0 Pa; expected above 0"):
        prepared(bare(flight[0]).replace(streams=streams))


def test_a_stream_on_another_clock_is_an_error(flight: tuple[Recording, Stream]) -> None:
    recording = bare(flight[0])
    baro = recording.streams["baro"]
    late = recording.replace(streams={**recording.streams, "baro": Stream(baro.t + 1e6, baro.columns)})
    with pytest.raises(InputError, match="one clock"):
        prepared(late)


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
        prepared(one)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_one_reading_of_declared_noise_is_none(flight: tuple[Recording, Stream]) -> None:
    """Of IMU and GPS besides."""
    recording = between(flight[0], 0.0, 10.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps", "baro")})
    one = recording.replace(
        streams={**recording.streams, "baro": recording.streams["baro"].rows(slice(0, 1))},
        sensors={"baro": recording.spec("baro")},
    )
    assert prepared(one).levels.specs["baro"] == recording.spec("baro")


@pytest.mark.parametrize(("sensor", "columns"), [("baro", ("height",)), ("mag", MAG)])
def test_readings_that_nobody_measured_are_an_error(
    flight: tuple[Recording, Stream], sensor: str, columns: tuple[str, ...]
) -> None:
    stream = flight[0].streams[sensor]
    zeros = Stream(stream.t, {**stream.columns, **{name: np.zeros(len(stream)) for name in columns}})
    recording = bare(flight[0]).replace(streams={**flight[0].streams, sensor: zeros})
    with pytest.raises(InputError, match="without any noise and no noise_std"):
        prepared(recording)


def test_readings_outside_the_imus_time_change_no_level(flight: tuple[Recording, Stream]) -> None:
    """A GPS that was logged for as long again before and after, at rest elsewhere; 10 s of IMU and GPS."""
    recording = between(bare(flight[0]), 0.0, 10.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps")})
    gps, imu = recording.streams["gps"], recording.streams["imu"].t
    span, rows = imu[-1] - imu[0] + 1.0, len(gps)
    t = np.concatenate([gps.t - span, gps.t, gps.t + span])
    far = {name: np.concatenate([np.full(rows, 50.0), gps[name], np.full(rows, 90.0)]) for name in gps.columns}
    longer = recording.replace(streams={**recording.streams, "gps": Stream(t, far)})
    assert prepared(longer).levels.specs == prepared(recording).levels.specs


def test_zero_of_a_barometer_is_a_bias_and_no_height(flight: tuple[Recording, Stream]) -> None:
    """Height above the sea beside a GPS that counts from the first fix, neither with a declared noise; 20 s."""
    recording = between(declaring(flight[0], "accel", "gyro", "mag"), 0.0, 20.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps", "mag", "baro")})
    baro = recording.streams["baro"]
    above_sea = Stream(baro.t, {**baro.columns, "height": baro["height"] + 1800.0})
    ready = prepared(recording.replace(streams={**recording.streams, "baro": above_sea}))
    assert ready.levels.specs["baro"].bias_std == pytest.approx(1800.0, rel=0.01)
    journal = ready.run()
    truth = np.interp(journal.imu_t, flight[1].t, flight[1]["down"])
    assert np.sqrt(np.mean((journal.imu_x[:, 2] - truth) ** 2)) < 1.5
    assert journal.x_end[journal.model.layout.nominal("b_baro")] == pytest.approx(1800.0, abs=5.0)


def test_an_effect_that_is_declared_is_no_noise() -> None:
    recording, _ = simulate(
        load_scenario("figure_eight"), np.random.default_rng(5), [parse_effect("mag.current=0.01,0,0.005")],
        declare=True,
    )  # fmt: skip
    recording = between(recording, 0.0, 20.0)
    recording = recording.replace(streams={name: recording.streams[name] for name in ("imu", "gps", "mag", "power")})
    asked = recording.replace(sensors={**recording.sensors, "mag": SensorSpec()})
    known, missing = (prepared(one).levels.specs["mag"] for one in (asked, asked.replace(effects={})))
    sizes = [np.hypot(spec.colour_std, spec.noise_std) for spec in (known, missing)]  # type: ignore[arg-type]
    assert sizes[1] > 1.5 * sizes[0]


def test_a_field_that_alone_is_not_declared_is_a_state(flight: tuple[Recording, Stream]) -> None:
    """Every noise is: the readings say the norm, the place its direction."""
    recording = flight[0].replace(environment=replace(flight[0].environment, magnetic_field=None))
    ready = prepared(recording)
    true = np.asarray(flight[0].environment.magnetic_field)
    journal = ready.run()
    found = estimated_motion(journal).m_n[-1]
    sigma = np.sqrt(np.diag(journal.P_end)[journal.model.layout.slice("field")])
    assert np.all(np.abs(found - true) < 4.0 * sigma)
    assert np.linalg.norm(sigma) < 0.05 * np.linalg.norm(true)
    assert ready.levels.specs["mag"] == flight[0].spec("mag")


@pytest.mark.parametrize(("norm", "unit", "told"), [(0.5, "gauss", False), (0.97, "gauss", True), (0.1, "gauss", True),
                                                    (0.97, "", False)])  # fmt: skip
def test_a_field_that_is_none_of_the_earth_is_told(
    flight: tuple[Recording, Stream], norm: float, unit: str, told: bool
) -> None:
    recording = flight[0].replace(environment=replace(flight[0].environment, field_unit=unit))
    said = not_of_the_earth(recording, norm * np.array([0.6, 0.0, 0.8]))
    assert [f"a field of {norm:.2g} gauss is none of the Earth" in one for one in said] == [True] * told
    assert not_of_the_earth(recording, None) == []


def test_a_column_that_never_changes_shows_no_digit() -> None:
    """A hover whose longitude, or height, is one number."""
    rng = np.random.default_rng(6)
    coarse = np.column_stack([np.round(np.cumsum(0.02 * rng.standard_normal(400)), 1), np.full(400, 412.0)])
    assert rounding_variance(coarse)[1] == 0.0
    assert reading_noise(coarse, rounding_variance(coarse)) == pytest.approx(0.1 / np.sqrt(12.0), rel=0.3)
    turned = coarse + 1e-8 * rng.standard_normal(coarse.shape) * [0.0, 1.0]
    assert reading_noise(turned, np.array([0.1**2 / 12.0, 0.0])) == pytest.approx(0.1 / np.sqrt(12.0), rel=0.3)
