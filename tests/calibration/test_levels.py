"""Sizes that nobody declares, found from a simulated log whose sizes are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2

from sinan.calibration.levels.assumptions import FOUND, assumptions_of
from sinan.calibration.levels.fit import fit_levels
from sinan.calibration.levels.levels import TAIL, Levels, first_levels
from sinan.calibration.levels.noise_start import datum
from sinan.calibration.levels.preparation import level_notes, prepared
from sinan.calibration.levels.problem import Problem
from sinan.calibration.levels.sizes import Size, sizes_of
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DP, P_N
from sinan.sensors import registry
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.noise import colour, random_walk
from sinan.sensors.recording import MAG, NO_HEIGHT, POSITION, VELOCITY, Initial, Recording, SensorSpec, Stream
from sinan.sensors.simulate import simulate
from sinan.sensors.window import between
from tests.estimator.analytic_flight import SLOW_IMU, SPECS, fly
from tests.flights import scenario_at

#: A size from a minute of readings.
FACTOR = 1.6
#: By which a law of other answers may move, in the root mean square, what is estimated where there are none.
A_PART_OF_SIGMA = 0.1
#: Of the differences that check a slope: within ten times as much some readings change from right to wrong.
STEP = 0.002
COLOUR_STD, COLOUR_TIME, LATE = 0.8, 2.0, 0.15


@pytest.fixture(scope="module")
def bare() -> Recording:
    """A minute without any declared noise, whose GPS has colour and is late."""
    recording, _ = fly(21, duration=60.0, sensors=("gps", "mag", "baro"), rates=SLOW_IMU)
    gps = recording.streams["gps"]
    error = random_walk(gps.t, colour("c_gps", 3, COLOUR_STD, COLOUR_TIME), np.random.default_rng(5))
    columns = {**gps.columns, **{name: gps[name] + error[:, k] for k, name in enumerate(POSITION)}}
    late = Stream(gps.t + LATE, columns)
    return recording.replace(sensors={}, streams={**recording.streams, "gps": late})


@pytest.fixture(scope="module")
def found(bare: Recording) -> Levels:
    """The likeliest of its sizes, its field a state."""
    return fit_levels(bare, bare.environment.magnetic_field, np.diag([0.02, 0.01, 0.03]) ** 2)


def test_colour_and_delay_of_a_gps_are_found(found: Levels) -> None:
    assert found.latency["gps"] == pytest.approx(LATE, abs=0.02)
    assert 1.0 / FACTOR < found.specs["gps"].colour_std / COLOUR_STD < FACTOR
    assert 1.0 / FACTOR**2 < found.specs["gps"].colour_time / COLOUR_TIME < FACTOR**2


@pytest.fixture(scope="module")
def rough(bare: Recording) -> Recording:
    """The same with one GPS reading and one of the magnetometer in seven far off: Student's law has much to do."""
    rng, streams = np.random.default_rng(12), dict(bare.streams)
    for name, columns, size in (("gps", (*POSITION, *VELOCITY), 2.0), ("mag", MAG, 0.06)):
        stream = streams[name]
        far = (rng.random(len(stream)) < 1.0 / 7.0) * size
        streams[name] = Stream(
            stream.t, {**stream.columns, **{c: stream[c] + far * rng.normal(size=len(far)) for c in columns}}
        )
    return bare.replace(streams=streams)


@pytest.fixture(scope="module")
def said(bare: Recording) -> Recording:
    """The same with what the receiver says of each fix, from half to twice the usual, and with fixes of no height."""
    rng, gps = np.random.default_rng(13), bare.streams["gps"]
    quality = {name: rng.uniform(0.5, 2.0, len(gps)) for name in ("eph", "epv", "s_variance")}
    quality["epv"][::10] = NO_HEIGHT
    return bare.replace(streams={**bare.streams, "gps": Stream(gps.t, {**gps.columns, **quality})})


@pytest.fixture(scope="module")
def flat(rough: Recording) -> Recording:
    """Readings far off, and fixes of no height alone: five components tell something."""
    gps = rough.streams["gps"]
    columns = {**gps.columns, "epv": np.full(len(gps), NO_HEIGHT)}
    return rough.replace(streams={**rough.streams, "gps": Stream(gps.t, columns)})


@pytest.fixture(scope="module")
def astray(bare: Recording) -> Recording:
    """The same with a laser that answers anything in one reading of seven, and for five seconds about 4 m."""
    rng, laser = np.random.default_rng(14), fly(21, duration=60.0, sensors=("laser",))[0].streams["laser"]
    z = np.where(rng.random(len(laser)) < 1.0 / 7.0, rng.uniform(0.0, 12.0, len(laser)), laser["range"])
    wrong = (laser.t > 20.0) & (laser.t < 25.0)
    z[wrong] = rng.normal(4.0, 0.1, np.count_nonzero(wrong))
    return bare.replace(streams={**bare.streams, "laser": Stream(laser.t, {"range": z})})


@pytest.mark.parametrize("log", ["bare", "rough", "said", "flat", "astray"])
def test_the_gradient_is_that_of_the_posterior(
    log: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each size alone, about a point that is not the start; by a lateness no slope is asked."""
    recording: Recording = request.getfixturevalue(log)
    sizes = sizes_of(recording)
    problem = Problem(recording, sizes, first_levels(recording, sizes, recording.environment.magnetic_field, None))
    monkeypatch.setattr("sinan.calibration.levels.problem.MOST", 4)
    theta = problem.maximise(np.zeros(len(sizes)))[0] + 0.2 * np.random.default_rng(3).normal(size=len(sizes))
    _, gradient = problem.value_and_gradient(theta)
    for i, size in enumerate(sizes):
        step = STEP * np.eye(len(sizes))[i]
        expected = (problem.value(theta + step) - problem.value(theta - step)) / (2.0 * STEP)
        if not size.linear:
            assert gradient[i] == pytest.approx(expected, rel=0.05, abs=1.0), (size.sensor, size.key)


@pytest.fixture(scope="module")
def over_ground() -> tuple[Recording, FloatArray]:
    """A minute at 6.5 to 9.5 m whose receiver tells no height, and the heights at the IMU samples."""
    specs = {**SPECS, "baro": replace(SPECS["baro"], bias_std=0.0)}
    recording, truth = fly(31, duration=60.0, specs=specs, rates=SLOW_IMU)
    gps = recording.streams["gps"]
    flat = Stream(gps.t, {**gps.columns, "epv": np.full(len(gps), NO_HEIGHT)})
    return recording.replace(sensors={}, streams={**recording.streams, "gps": flat}), -truth[:, P_N][:, 2]


def test_a_height_does_not_follow_a_laser_whose_ground_is_out_of_reach(
    over_ground: tuple[Recording, FloatArray],
) -> None:
    """It answers about 4 m to everything beyond 8 m, for seconds at a time, and is believed again below."""
    recording, height = over_ground
    laser = recording.streams["laser"]
    beyond = laser["range"] > 8.0
    z = np.where(beyond, np.random.default_rng(15).normal(4.0, 0.3, len(laser)), laser["range"])
    recording = recording.replace(streams={**recording.streams, "laser": Stream(laser.t, {"range": z})})
    levels = fit_levels(recording, recording.environment.magnetic_field)
    journal = run(prepare(levels.flight(recording)), "numba")
    error = -journal.imu_x[:, P_N][:, 2] - height
    assert 0.3 < np.mean(beyond) < 0.7
    assert np.max(np.abs(error[journal.imu_t > 5.0])) < 1.0
    weight = journal.stream("laser").weight
    assert np.all(weight[beyond] < 0.01)
    assert np.mean(weight[~beyond] > 0.5) > 0.9


def test_a_laser_that_always_sees_the_ground_loses_nothing(over_ground: tuple[Recording, FloatArray]) -> None:
    recording, _ = over_ground
    levels = fit_levels(recording, recording.environment.magnetic_field)
    assert set(levels.stray) == {"laser"}
    mixed, plain = (run(prepare(one.flight(recording)), "numba") for one in (levels, replace(levels, stray={})))
    sigma = np.sqrt(plain.imu_var[:, DP])
    apart = (mixed.imu_x[:, P_N] - plain.imu_x[:, P_N]) / sigma
    assert np.max(np.sqrt(np.mean(apart**2, axis=0))) < A_PART_OF_SIGMA
    assert np.max(np.mean(np.sqrt(mixed.imu_var[:, DP]) / sigma, axis=0)) < 1.0 + A_PART_OF_SIGMA


def test_what_a_receiver_says_counts_where_its_noise_is_sought(said: Recording) -> None:
    """The level is that of the median of all fixes that tell anything, also in a part of them."""
    field, declared = said.environment.magnetic_field, SensorSpec(noise_std=0.5)
    usual = first_levels(said, sizes_of(said), field, None).said
    heights = said.streams["gps"]["epv"]
    assert usual["epv"] == np.median(heights[heights < NO_HEIGHT])
    assert set(usual) == {"eph", "epv", "s_variance"}
    partly = said.replace(sensors={"gps": declared})
    assert set(first_levels(partly, sizes_of(partly), field, None).said) == {"s_variance"}


def test_the_search_ends_at_one_place_wherever_it_begins(rough: Recording) -> None:
    """And a GPS may be ahead of its stamps' clock, far from what is usual."""
    ahead = Stream(rough.streams["gps"].t - LATE - 0.1, rough.streams["gps"].columns)
    recording = rough.replace(streams={**rough.streams, "gps": ahead})
    sizes = sizes_of(recording)
    problem = Problem(recording, sizes, first_levels(recording, sizes, recording.environment.magnetic_field, None))
    starts = [np.zeros(len(sizes)), np.where([size.linear for size in sizes], 0.0, -1.0)]
    found = [problem.likeliest(start) for start in starts]
    assert found[0][1] == pytest.approx(found[1][1], abs=1.0)
    assert problem.levels(found[0][0]).latency["gps"] == pytest.approx(-0.1, abs=0.02)


def test_what_is_declared_stays(bare: Recording) -> None:
    declared, _ = fly(21, duration=10.0, sensors=("gps", "mag", "baro"))
    assert not sizes_of(declared)
    partly = bare.replace(sensors={"baro": declared.spec("baro")})
    asked = {(size.sensor, size.key) for size in sizes_of(partly)}
    assert not any(sensor == "baro" for sensor, _ in asked)
    assert ("gps", "colour_std") in asked


@pytest.mark.parametrize("name", ["accel", "gyro"])
def test_white_noise_of_an_imu_is_declared_by_one_reading_as_well(bare: Recording, name: str) -> None:
    """Of the sizes of such an instrument its bias alone is sought, as where a density is declared."""

    def sought(spec: SensorSpec) -> set[str]:
        sizes = sizes_of(bare.replace(sensors={name: spec}))
        return {size.key for size in sizes if name == size.sensor or (size.sensor, size.key) == ("in_step", name)}

    assert sought(SensorSpec(noise_std=0.02)) == sought(SensorSpec(noise_density=0.002)) == {"bias_std", "bias_walk"}
    levels = first_levels(
        *(partly := bare.replace(sensors={name: SensorSpec(noise_std=0.02)}), sizes_of(partly)), None, None
    )
    model = levels.flight(partly).model
    assert {"accel": model.accel, "gyro": model.gyro}[name].sigma == 0.02


def test_bounds_are_as_wide_as_the_motion_needs() -> None:
    """A flight of tens of metres without position is not held to a hand's place."""
    recording, _ = fly(23, duration=30.0, sensors=("mag",), rates=SLOW_IMU)
    bare = recording.replace(sensors={})
    levels = fit_levels(bare, recording.environment.magnetic_field)
    assert levels.bounds is not None
    held = replace(levels, bounds=Bounds(0.05, 0.1))
    journals = [run(prepare(one.flight(bare)), "numba", 0) for one in (levels, held)]
    assert journals[0].nis_per_dof()["place"] < 2.0 < journals[1].nis_per_dof()["place"]


def test_any_sensor_of_height_bounds_the_height(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was registered does, as a barometer does."""
    recording = fly(23, duration=5.0, sensors=("mag", "baro"), rates=SLOW_IMU)[0].replace(sensors={})
    other = replace(registry.sensor("baro"), name="depth")
    monkeypatch.setitem(registry._SENSORS, "depth", other)
    streams = {"depth" if name == "baro" else name: one for name, one in recording.streams.items()}
    field = recording.environment.magnetic_field
    for log in (recording, recording.replace(streams=streams)):
        bounds = first_levels(log, (), field, None).bounds
        assert bounds is not None
        assert not bounds.height


def test_sigmas_are_those_of_the_curvature(bare: Recording, found: Levels) -> None:
    """Against the second difference of the posterior, along the axes of theta that the log tells best."""
    problem = Problem(bare, found.found, found)
    theta = np.array([size.theta(found.value(size)) for size in found.found])
    sigmas = np.sqrt(np.diag(problem.covariance(theta)))
    assert np.allclose(sigmas * [size.spread for size in found.found], found.sigmas)
    assert np.all((sigmas > 0.0) & (sigmas <= 1.0))  # a log adds to the prior
    for i in np.argsort(sigmas)[:4]:
        step = np.zeros(len(theta))
        step[i] = 0.5 * sigmas[i]
        values = [problem.value(theta + k * step) for k in (-1, 0, 1)]
        curvature = -(values[0] - 2.0 * values[1] + values[2]) / step[i] ** 2
        assert 0.3 < curvature * sigmas[i] ** 2 < 6.0


def test_a_lateness_is_told_as_well_as_its_likelihood_is_narrow() -> None:
    """One sigma off it is lower by a half, also where a class of instruments is noisier than this compass."""
    recording, _ = simulate(scenario_at(50.0, "no_aiding"), np.random.default_rng(3), [])
    ready = prepared(between(recording, 0.0, 30.0).replace(sensors={}, initial=Initial()))
    problem = Problem(ready.recording, ready.levels.found, ready.levels)
    theta = problem.theta(ready.levels)
    k = next(k for k, size in enumerate(ready.levels.found) if size.linear)
    step = np.eye(len(theta))[k] * ready.levels.sigmas[k] / ready.levels.found[k].spread
    top, *lower = (problem.value(theta + side * step, inside=True) for side in (0.0, 1.0, -1.0))
    assert ready.levels.sigmas[k] < 0.5 * ready.levels.found[k].spread
    assert 0.3 < top - np.mean(lower) < 1.0


def test_every_open_size_is_in_the_table_of_assumptions(bare: Recording, found: Levels) -> None:
    rows = assumptions_of(bare, found, sizes_of(bare))
    assert len([row for row in rows if row.source == FOUND]) == len(found.found)
    late = next(row for row in rows if (row.subject, row.quantity) == ("gps", "lateness of its stamps"))
    assert (late.unit, late.is_ratio) == ("s", False)
    assert abs(late.value - LATE) < 4.0 * late.sigma
    of_mag = {row.quantity: row.value for row in rows if row.subject == "mag"}
    together = np.hypot(of_mag["white noise of a reading"], of_mag["first-order noise"])  # a little colour is found
    known = fly(21, duration=1.0, sensors=("mag",))[0].spec("mag").noise_std
    assert together == pytest.approx(known * _scale_of_normal_noise(TAIL, 3), rel=0.1)


def _scale_of_normal_noise(tail: float, m: int) -> float:
    """The scale of a Student law that is likeliest for normal noise of unit variance: E[q w(q)] = m, q = chi^2_m / s^2,
    where the weight w is that of Student's law beyond m, and one within.
    """

    def excess(s: float) -> float:
        q = chi2.ppf((np.arange(4000) + 0.5) / 4000, m) / s**2
        return float(np.mean(q * np.minimum(1.0, (tail + m) / (tail + q)))) - m

    return float(brentq(excess, 0.3, 1.5))


def test_the_field_is_in_the_table_with_the_sigmas_of_its_covariance(bare: Recording) -> None:
    """Against draws from the covariance."""
    m_n = bare.environment.magnetic_field
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.4], [0.5, -0.4, 2.0]]) * 1e-6 * float(m_n @ m_n)
    sizes = sizes_of(bare)
    levels = first_levels(bare, sizes, m_n, covariance)
    rows = {row.quantity: row for row in assumptions_of(bare, levels, sizes) if row.subject == "field"}
    draws = np.random.default_rng(8).multivariate_normal(m_n, covariance, size=20_000)
    norm, dip = np.linalg.norm(draws, axis=1), np.arctan2(draws[:, 2], np.hypot(draws[:, 0], draws[:, 1]))
    east = np.arctan2(draws[:, 1], draws[:, 0])
    for name, values in (("norm", norm), ("dip", dip), ("declination", east)):
        assert rows[name].value == pytest.approx(np.mean(values), abs=4.0 * np.std(values))
        assert rows[name].sigma == pytest.approx(np.std(values), rel=0.03)


def test_a_flight_that_declares_everything_assumes_nothing() -> None:
    declared, _ = fly(21, duration=10.0, sensors=("gps", "mag", "baro"))
    assert prepared(declared).model.assumptions == ()


def test_a_lateness_at_its_bound_is_told_as_such(bare: Recording) -> None:
    size = Size("latency", "mag", 0.01, 0.01, linear=True)
    levels = replace(first_levels(bare, [], None, None), found=(size,), covariance=np.array([[0.16]]))
    told = [level_notes(replace(levels, latency={"mag": late}))[-1] for late in (0.02, 0.05)]
    assert told[0] == "mag: stamps 20 ± 4 ms late, by the likelihood"
    assert "the most that is sought" in told[1]


def test_a_lateness_that_may_be_none_is_not_told(bare: Recording) -> None:
    """Within two sigma, 8 ms; nor how old a velocity is that is known to 5 ms."""
    late, position = (Size("latency", key, 0.01, 0.01, linear=True) for key in ("gps", "gps_position"))
    found, none = (late, position), first_levels(bare, [], None, None)
    levels = replace(none, found=found, covariance=np.diag([0.16, 0.09]))
    told = {
        (one, lead): " ".join(level_notes(replace(levels, latency={"gps": one}, lead=lead)))
        for one, lead in ((0.0079, 0.0099), (0.0081, 0.0101))
    }
    assert told[0.0079, 0.0099] == ""
    assert "gps: stamps 8 ± 4 ms late" in told[0.0081, 0.0101]
    assert "gps: velocities 10 ± 5 ms older than the places" in told[0.0081, 0.0101]


def test_a_barometer_is_held_against_the_first_fix_that_tells_a_height() -> None:
    flown, _ = fly(4, duration=3.0, sensors=("mag", "baro", "gps"))
    gps = flown.streams["gps"]
    flat = Stream(gps.t, {**gps.columns, "down": np.where(gps.t < 0.5, 0.0, gps["down"] - 190.0)})
    for epv, expected in ((np.where(gps.t < 0.5, NO_HEIGHT, 1.0), 190.0), (np.full(len(gps), NO_HEIGHT), 0.0)):
        fixes = Stream(gps.t, {**flat.columns, "epv": epv})
        recording = flown.replace(streams={**flown.streams, "gps": fixes})
        assert datum(recording, "baro") == pytest.approx(expected, abs=10.0)


def test_a_barometer_may_count_from_the_sea_where_a_laser_sees_the_ground() -> None:
    """Without a GPS nothing was known of that: a log whose barometer stood at 189 m had a `baro.step` of 166 m."""
    flown, _ = fly(4, duration=20.0, sensors=("mag", "baro", "laser"), rates=SLOW_IMU)
    baro = flown.streams["baro"]
    high = Stream(baro.t, {name: column + 190.0 for name, column in baro.columns.items()})
    recording = flown.replace(sensors={}, streams={**flown.streams, "baro": high})
    assert datum(recording, "baro") == pytest.approx(190.0, abs=5.0)
    assert datum(recording, "laser") == 0.0
    journal = prepared(recording).run()
    assert journal.nis_per_dof()["baro"] < 2.0
    assert np.all(journal.stream("baro").weight[:20] > 0.1)


def test_a_log_of_which_only_a_lateness_is_open_is_opened() -> None:
    """IMU and a compass whose bias is declared."""
    recording, _ = simulate(scenario_at(50.0, "hover"), np.random.default_rng(3), [])
    recording = between(recording, 10.0, 22.0)
    streams = {name: recording.streams[name] for name in ("imu", "mag")}
    bare = recording.replace(streams=streams, sensors={"mag": SensorSpec(bias_std=0.03)}, initial=Initial())
    levels = prepared(bare).levels
    assert [(size.sensor, size.key) for size in levels.found] == [("latency", "mag")]
    assert abs(levels.latency["mag"] - levels.found[0].median) < 3.0 * levels.sigmas[0]
    assert np.isfinite(levels.log_posterior)
