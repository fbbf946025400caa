"""Every effect against the formulas of the maker of blind recordings, which were written without looking at it.

A linear effect has no exact form that its regressor could be compared with, so its own file cannot show it wrong.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad

from sinan.experiments.blind.maker.body import Body, Multirotor
from sinan.experiments.blind.maker.catalogue import Hidden
from sinan.experiments.blind.maker.curves import Curve, Sine
from sinan.experiments.blind.maker.forward import Seen
from sinan.experiments.blind.maker.forward_heights import beam_range
from sinan.experiments.blind.maker.instruments import Instrument
from sinan.experiments.blind.maker.measure import FORWARD, Plan, belonging, local_offset, plain_reading
from sinan.experiments.blind.maker.scene import Scene, Vibration, WarmUp
from sinan.experiments.blind.maker.turning import quaternion, rot_x, rot_y
from sinan.sensors.accelerometer import Accelerometer
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, Effect, effect
from sinan.sensors.effects.algebra import airspeed
from sinan.sensors.effects.baro_lag import moments
from sinan.sensors.effects.streams import STREAMS, textbook_model
from sinan.sensors.gyroscope import Gyroscope
from sinan.sensors.laser import Laser
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

ROUNDING = 1e-9  # of the largest change
T = np.arange(2.0, 14.0, 0.005)
DRAG, WIND, GRAVITY = 0.3, (3.0, -2.0), 9.79
FIELD = np.array([0.31, -0.04, 0.38])
#: Components of beta in plausible sizes: of either sign, no two alike.
PATTERN = np.array([1.0, -0.7, 0.8, 0.6, -0.9, 0.75, -0.65, 0.85, -0.95])
LOCAL = ("step", "transient")
DELAYS = ("time_offset", "latency")
LATE = [name for name in CATALOGUE if name.split(".")[1] in DELAYS and not name.startswith("camera.")]
INTERVAL = (5.0, 8.0)
#: What the maker has no formula for, and where its independent test is
ELSEWHERE = {
    "motion.rotor_drag": "below, against the force that the maker's body feels",
    "motion.wind": "below, likewise",
    **{f"{stream}.outliers": "tests/sensors/test_simulate.py: their mean is zero" for stream in STREAMS},
    **{name: "tests/sensors/test_camera_effects.py" for name in CATALOGUE if name.startswith("camera.")},
    **{name: "tests/sensors/test_pseudorange.py" for name in CATALOGUE if name.startswith("pseudorange.")},
}


@cache
def scene() -> Scene:
    """A flight with leaning, climbing and turning, in wind, warming up and shaking."""
    path = (
        Curve(3.0, [Sine(2.0, 1.1, 0.3), Sine(0.8, 2.0, 1.0)]),
        Curve(-4.0, [Sine(1.5, 1.4, 2.0)]),
        Curve(-3.0, [Sine(1.0, 0.9, 0.5)]),
    )
    air = (Curve(WIND[0]), Curve(WIND[1]), Curve(0.0))
    motion = Multirotor(path, Curve(0.4, [Sine(0.8, 0.7, 0.0)]), air, DRAG, GRAVITY)
    swing = Curve(0.0, [Sine(0.5, 1.0, 0.0)])
    shaking = Vibration(Curve(2.0, [Sine(0.7, 0.6, 0.1)]), np.array([1.0, 0.8, 1.6]), np.full(3, 300.0), Curve())
    warm = WarmUp(15.0, 20.0, 3.0, 30.0, swing), WarmUp(18.0, 9.0, 1.0, 12.0, swing)
    return Scene(motion, 0.0, 16.0, GRAVITY, FIELD, 0.7, *warm, idle=0.5, load=11.0, vibration=shaking)


@cache
def body() -> Body:
    """What there is to sense."""
    return scene().motion(T)


def motion_of(stream: str, known: Body | None = None) -> Motion:
    """The same as the sensor models take it."""
    at, of = known or body(), scene()
    assert of.vibration is not None
    covariates = {
        "temperature": temperature(stream),
        "current": of.current(at),
        "throttle": of.throttle(at).mean(axis=1),
        "airspeed": at.airspeed,
        "vibration": of.vibration.variance(at.t),
    }
    return Motion(
        at.t, at.p, at.v, at.a, quaternion(at.C), at.f, at.w, at.dw, at.to_body(FIELD), FIELD[None],
        np.array([0.0, 0.0, GRAVITY]), of.ground_down, covariates,
    )  # fmt: skip


def temperature(stream: str) -> FloatArray:
    """(n,) of the sensor's own chip."""
    warm = scene().temperature_baro if stream == "baro" else scene().temperature_imu
    return warm(T)


def model_of(stream: str) -> SensorModel:
    """The plain model of a stream."""
    drivers: dict[str, SensorModel] = {"accel": Accelerometer(1.0), "gyro": Gyroscope(1.0)}
    return drivers[stream] if stream in drivers else textbook_model(stream, 6, motion_of(stream))


def plain(stream: str) -> FloatArray:
    """What the maker's perfect sensor reads."""
    return plain_reading(stream, body(), scene(), 6)


def beta_of(entry: Effect) -> FloatArray:
    """A size of the effect; those that have to be positive begin with a positive one."""
    return np.asarray(entry.plausible * PATTERN[: entry.size])


def test_every_effect_is_compared_with_something_else() -> None:
    """A new one is written out a second time in `experiments/blind/maker`, or named in `ELSEWHERE` with its test."""
    of_the_maker = {name for name in CATALOGUE if name in FORWARD or name.split(".")[1] in LOCAL} | set(LATE)
    assert of_the_maker | set(ELSEWHERE) == set(CATALOGUE)
    assert not of_the_maker & set(ELSEWHERE)


@pytest.mark.parametrize("stream", ["accel", "gyro", "mag", "baro", "sonar", "laser", "gps"])
def test_the_plain_models_read_what_the_maker_s_sensors_read(stream: str) -> None:
    np.testing.assert_allclose(model_of(stream).predict(motion_of(stream)), plain(stream), rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("name", [name for name in CATALOGUE if name in FORWARD])
def test_it_enters_as_the_maker_has_it(name: str) -> None:
    entry = effect(name)
    motion, reading, beta = motion_of(entry.stream), plain(entry.stream), beta_of(entry)
    expected = FORWARD[name](beta, Seen(body(), scene(), reading, temperature(entry.stream)))
    found = entry.apply(reading, beta, motion, model_of(entry.stream)) - reading
    # The lag's own integrations: of cubics between the samples here, of 2 ms steps there; both have settled
    settled = slice(int(10.0 * beta[0] / 0.005), None) if name == "baro.lag" else slice(None)
    tolerance = 1e-4 if name == "baro.lag" else ROUNDING
    assert np.max(np.abs(expected[settled])) > 0.0
    np.testing.assert_allclose(
        found[settled], expected[settled], rtol=0.0, atol=tolerance * float(np.max(np.abs(expected)))
    )


def plan(hidden: Hidden) -> Plan:
    """A recording with one effect."""
    return Plan(scene(), {hidden.stream: Instrument(200.0, 1.0, 0.0, 0.0)}, [hidden])


@pytest.mark.parametrize("name", LATE)
def test_a_late_stream_reads_what_was(name: str) -> None:
    """The motion is known every 5 ms and linear in between: 3e-5 of the signal is left at 3 rad/s."""
    entry = effect(name)
    beta = beta_of(entry)
    instants = belonging(plan(Hidden(name, beta)), entry.stream, T)
    expected = plain_reading(entry.stream, scene().motion(instants), scene(), 6) - plain(entry.stream)
    reading = plain(entry.stream)
    found = entry.apply(reading, beta, motion_of(entry.stream), model_of(entry.stream)) - reading
    inner = slice(100, -100)
    np.testing.assert_allclose(found[inner], expected[inner], rtol=0.0, atol=3e-4 * float(np.max(np.abs(expected))))


@pytest.mark.parametrize("name", [name for name in CATALOGUE if name.split(".")[1] in LOCAL])
def test_an_offset_comes_and_goes_as_the_maker_has_it(name: str) -> None:
    entry = effect(name)
    interval = INTERVAL if name.endswith("transient") else (INTERVAL[0], np.inf)
    beta, stream = beta_of(entry), entry.stream
    size = 3 if stream == "base" else plain(stream).shape[1]
    expected, _ = local_offset(np.random.default_rng(0), [Hidden(name, beta, interval)], T, np.ones(size))
    reading = np.zeros((len(T), size))
    found = entry.over(*interval).apply(reading, beta, motion_of(stream)) - reading
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("step", [0.01, 0.3, 2.0], ids=["finely sampled", "about the lag", "coarsely sampled"])
def test_a_lag_is_the_solution_of_its_equation(step: float) -> None:
    """Of b dz/dt = u - z with a cubic u: z = u - b d + b^2 dd - b^3 ddd + c exp(-t / b), begun at u - b d."""
    b, t = 0.4, np.arange(0.0, 12.0, step)
    u, d, dd, ddd = 3.0 + 2.0 * t + 0.7 * t**2 - 0.1 * t**3, 2.0 + 1.4 * t - 0.3 * t**2, 1.4 - 0.6 * t, -0.6
    zero = np.zeros((len(t), 2))
    motion = Motion(t, np.column_stack([zero, -u]), np.column_stack([zero, -d]))
    forced = u - b * d + b**2 * dd - b**3 * ddd
    begun = (u - b * d - forced)[0] * np.exp(-t / b)
    found = effect("baro.lag").apply(u[:, None], np.array([b]), motion)[:, 0]
    np.testing.assert_allclose(found, forced + begun, rtol=0.0, atol=1e-10)


ANGLES = np.deg2rad([-20.0, 5.0, 25.0])


def scanned(turn: FloatArray | None = None, slope: FloatArray | None = None, late: float = 0.0) -> FloatArray:
    """(n, beams) ranges of a scan by the maker's formula, its beams turned, the ground inclined, or some time ago."""
    at = scene().motion(T - late)
    beams = np.array([[0.0, np.sin(a), np.cos(a)] for a in ANGLES])
    turned = beams if turn is None else beams @ turn.T
    return np.stack([beam_range(at, scene(), beam, slope) for beam in turned], axis=1)


@pytest.mark.parametrize(
    "name", ["boresight", "terrain_slope", "scale", "mount_offset", "time_offset", "step", "transient"]
)
def test_a_scan_has_the_effect_in_every_beam(name: str) -> None:
    entry = effect(f"laser.{name}")
    entry = entry.over(*INTERVAL) if name in LOCAL else entry
    beta, motion = beta_of(entry), motion_of("laser").with_covariates(angles=np.tile(ANGLES, (len(T), 1)))
    reading, inside = scanned(), (INTERVAL[0] <= T) & (INTERVAL[1] > T)
    expected = {
        "boresight": lambda: scanned(turn=rot_x(float(beta[0])) @ rot_y(float(beta[1]))),
        "terrain_slope": lambda: scanned(slope=beta),
        "scale": lambda: reading * (1.0 + beta),
        "mount_offset": lambda: reading + beta,
        "time_offset": lambda: scanned(late=float(beta[0])),
        "step": lambda: reading + inside[:, None] * beta,
        "transient": lambda: reading + inside[:, None] * beta,
    }[name]()
    model = Laser(1.0, angles=ANGLES)
    np.testing.assert_allclose(model.predict(motion), reading, rtol=0.0, atol=1e-11)
    inner, tolerance = (slice(100, -100), 3e-4) if name == "time_offset" else (slice(None), ROUNDING)
    found = entry.apply(reading, beta, motion, model)
    change = float(np.max(np.abs(expected - reading)))
    np.testing.assert_allclose(found[inner], expected[inner], rtol=0.0, atol=tolerance * change)
    slope = (entry.apply(reading, 1e-5 * beta, motion, model) - reading) / 1e-5
    G = entry.rows(motion, len(ANGLES)) @ beta
    np.testing.assert_allclose(slope[inner], G[inner], rtol=0.0, atol=0.01 * float(np.max(np.abs(G))))


def test_a_beam_that_does_not_meet_an_inclined_ground_has_no_end() -> None:
    """Rolled by 80 deg to the left, its beam goes 10 deg down to the right: ground that falls by 0.1 it meets, ground
    that falls by 0.3, 17 deg, it does not.
    """
    rolled = quaternion(rot_x(np.deg2rad(-80.0))[None])
    at = Motion(np.zeros(1), np.array([[0.0, 0.0, -2.0]]), q_nb=rolled)
    ranges = [effect("laser.terrain_slope").apply(np.ones((1, 1)), np.array([0.0, s]), at)[0, 0] for s in (-0.1, -0.3)]
    assert ranges[0] == pytest.approx(2.0 / (np.sin(np.deg2rad(10.0)) - 0.1 * np.cos(np.deg2rad(10.0))))
    assert ranges[1] == np.inf


@pytest.mark.parametrize("x", [1e-9, 1e-4, 0.3, 0.99, 1.0, 4.0, 30.0, 1e5])
def test_the_lag_of_a_cubic_has_the_integrals_of_its_equation(x: float) -> None:
    """int_0^1 x exp(-x (1 - s)) s^k ds; with u = x (1 - s) it is int_0^x exp(-u) (1 - u / x)^k du."""
    found = moments(np.array([x]))
    for k in range(4):
        expected, _ = quad(lambda u, k=k: np.exp(-u) * (1.0 - u / x) ** k, 0.0, min(x, 60.0), epsabs=0.0, epsrel=1e-12)
        assert found[k][0] == pytest.approx(expected, rel=1e-10)


def test_an_airspeed_that_is_not_measured_is_the_speed_against_the_wind() -> None:
    entry, motion = effect("baro.airspeed"), motion_of("baro")
    known = {name: values for name, values in motion.covariates.items() if name != "airspeed"}
    windy = replace(motion, covariates={**known, "wind": body().wind[:, :2]})
    beta, reading = beta_of(entry), plain("baro")
    assert np.array_equal(airspeed(motion), body().airspeed)
    np.testing.assert_allclose(airspeed(windy), body().airspeed, rtol=1e-12)
    expected = entry.apply(reading, beta, motion)
    np.testing.assert_allclose(entry.apply(reading, beta, windy), expected, rtol=0.0, atol=1e-11)
    still = entry.apply(reading, beta, replace(motion, covariates=known)) - reading
    np.testing.assert_allclose(still, beta * np.sum(body().v ** 2, axis=1)[:, None], rtol=0.0, atol=1e-11)


def test_a_current_that_is_not_measured_is_the_throttle() -> None:
    entry, motion = effect("mag.current"), motion_of("mag")
    beta = beta_of(entry)
    known = {name: values for name, values in motion.covariates.items() if name != "current"}
    found = entry.apply(np.zeros((len(T), 3)), beta, replace(motion, covariates=known))
    np.testing.assert_allclose(found, np.outer(scene().throttle(body()).mean(axis=1), beta), rtol=0.0, atol=1e-15)


def test_rotor_drag_is_the_horizontal_force_of_the_maker_s_body() -> None:
    """Its rotors push along body up and its drag acts across that, so what is felt across is drag alone."""
    motion = motion_of("level").with_covariates(wind=body().wind[:, :2])
    found = effect("motion.rotor_drag").apply(np.zeros((len(T), 3)), np.array([DRAG]), motion)
    np.testing.assert_allclose(found, body().f * [1.0, 1.0, 0.0], rtol=0.0, atol=1e-11)


def test_drag_in_still_air_and_wind_together_are_the_drag_in_wind() -> None:
    """Without knowing the wind, drag is taken of the speed over ground; the wind makes up for it."""
    motion = motion_of("level").with_covariates(rotor_drag=np.full(len(T), DRAG))
    zero = np.zeros((len(T), 3))
    found = effect("motion.rotor_drag").apply(zero, np.array([DRAG]), motion)
    found = found + effect("motion.wind").apply(zero, np.array(WIND), motion)
    np.testing.assert_allclose(found, body().f * [1.0, 1.0, 0.0], rtol=0.0, atol=1e-11)
