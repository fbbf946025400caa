"""One contract for every effect of the catalogue; a new effect is taken up by its registry line."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from sinan.experiments.scenarios import load_scenario
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, Effect, apply_effects, effects_for, sonar_beam_cone, step, transient
from sinan.sensors.effects.streams import STREAMS, textbook_model
from sinan.sensors.laser import Laser
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply, rotate_back

RATE = 400.0  # Hz
SLOPE = 2e-5  # share of the regressor's largest entry by which central differences may be off
#: Those of a camera, which sees points, are in tests/sensors/test_camera_effects.py.
FLIGHT_EFFECTS = tuple(name for name in CATALOGUE if not name.startswith(("pseudorange.", "camera.")))
#: The others are linear: what their regressor is compared with is in `test_effects_by_another_hand`.
WITH_AN_EXACT_FORM = tuple(name for name in FLIGHT_EFFECTS if CATALOGUE[name].exact is not None)


def swing() -> Motion:
    """A body that turns about one axis at a changing rate and moves on sines, with every covariate."""
    t = np.arange(0.0, 4.0, 1.0 / RATE)
    axis = np.array([0.6, 0.0, 0.8])
    tilted = quaternion_exp(np.array([0.2, -0.3, 0.1]))
    angle, rate = 0.3 * np.sin(1.3 * t), 0.39 * np.cos(1.3 * t)
    q_nb = quaternion_multiply(np.broadcast_to(tilted, (len(t), 4)), quaternion_exp(angle[:, None] * axis))
    frequency, amplitude = np.array([0.7, 0.9, 0.5]), np.array([3.0, 2.0, 0.8])
    phase = t[:, None] * frequency
    p_n = amplitude * np.sin(phase) + np.array([4.0, -3.0, -5.0])
    v_n = amplitude * frequency * np.cos(phase)
    a_n = -amplitude * frequency**2 * np.sin(phase)
    g_n = np.array([0.0, 0.0, 9.8])
    m_n = np.array([[0.53, -0.06, 0.85]])
    slow = np.sin(0.4 * t)
    covariates = {
        "temperature": 30.0 + 8.0 * slow,
        "current": 12.0 + 4.0 * slow,
        "throttle": 0.5 + 0.2 * slow,
        "airspeed": np.linalg.norm(v_n, axis=1),
        "wind": np.stack([1.0 + slow, slow], axis=1),
        "vibration": np.stack([1.0 + slow, 2.0 + slow, 3.0 - slow], axis=1),
        "rotor_drag": np.full(len(t), 0.3),
    }
    w, dw = rate[:, None] * axis, (-0.507 * np.sin(1.3 * t))[:, None] * axis
    f_b = rotate_back(q_nb, a_n - g_n)
    m_b = rotate_back(q_nb, m_n)
    return Motion(t, p_n, v_n, a_n, q_nb, f_b, w, dw, m_b, m_n, g_n, covariates=covariates)


def plain_reading(effect: Effect, motion: Motion) -> FloatArray:
    """What the perfect sensor of the effect's stream reads."""
    if effect.stream in ("accel", "level"):
        return motion.f_b
    if effect.stream == "gyro":
        return motion.w_ib_b
    if effect.stream == "base":
        return np.zeros((len(motion), 3))
    return textbook_model(effect.stream, 6, motion).predict(motion)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swing()


@pytest.fixture(params=FLIGHT_EFFECTS)
def effect(request: pytest.FixtureRequest) -> Effect:
    return CATALOGUE[request.param]


@pytest.mark.parametrize("effect", WITH_AN_EXACT_FORM, indirect=True)
def test_the_regressor_is_the_derivative_of_the_exact_form(effect: Effect, motion: Motion) -> None:
    plain = plain_reading(effect, motion)
    G = effect.rows(motion, plain.shape[1])
    inner = slice(20, -20)  # away from the ends, where the motion of other instants is extrapolated
    for k in range(effect.size):
        step = 1e-3 * effect.plausible[k] * np.eye(effect.size)[k]
        change = (effect.apply(plain, step, motion) - effect.apply(plain, -step, motion)) / (2.0 * np.sum(step))
        np.testing.assert_allclose(G[inner, :, k], change[inner], atol=tolerance(effect) * (1e-9 + np.max(np.abs(G))))


def tolerance(effect: Effect) -> float:
    """Share of the largest entry: motion at other instants is linear in between ((h w)^2 / 8), a lag is one-sided."""
    if effect.name == "gps.latency" or effect.name.endswith(".time_offset"):
        return 0.01
    return 1e-3 if effect.name == "baro.lag" else SLOPE


@pytest.mark.parametrize("effect", WITH_AN_EXACT_FORM, indirect=True)
def test_zero_beta_is_the_plain_model(effect: Effect, motion: Motion) -> None:
    plain = plain_reading(effect, motion)
    np.testing.assert_allclose(effect.apply(plain, np.zeros(effect.size), motion), plain, atol=1e-12)


def test_the_regressor_has_its_shape(effect: Effect, motion: Motion) -> None:
    size = plain_reading(effect, motion).shape[1]
    assert effect.rows(motion, size).shape == (len(motion), size, effect.size)


def test_it_works_with_nothing_but_what_it_needs(effect: Effect, motion: Motion) -> None:
    fields = {name: getattr(motion, name) for name in effect.needs if name not in motion.covariates}
    covariates = {name: motion.covariates[name] for name in effect.needs if name in motion.covariates}
    bare = Motion(motion.t, covariates=covariates, **fields)
    assert effect.missing(bare) == ()
    assert effect.regressor(bare).shape[0] == len(motion)


def test_a_motion_that_lacks_something_is_said_to(effect: Effect, motion: Motion) -> None:
    assert effect.missing(Motion(motion.t)) == effect.needs


def test_parameters_have_units_and_plausible_sizes(effect: Effect) -> None:
    assert all(parameter.unit and parameter.plausible > 0.0 for parameter in effect.parameters)


def test_it_says_what_and_why_and_from_where(effect: Effect) -> None:
    assert effect.summary.endswith(".")
    assert len(effect.physics) > 60
    assert effect.source
    assert effect.separates


def test_the_name_begins_with_its_stream(effect: Effect) -> None:
    assert effect.name.split(".")[0] == ("motion" if effect.stream == "level" else effect.stream)


@pytest.mark.parametrize("effect", WITH_AN_EXACT_FORM, indirect=True)
def test_the_slope_at_zero_is_the_regressor(effect: Effect, motion: Motion) -> None:
    plain = plain_reading(effect, motion)
    G = effect.rows(motion, plain.shape[1])
    slope = effect.slope(plain, np.zeros(effect.size), motion)
    np.testing.assert_allclose(slope[20:-20], G[20:-20], atol=tolerance(effect) * (1e-9 + np.max(np.abs(G))))


def test_effects_of_one_stream_add(motion: Motion) -> None:
    plain = motion.f_b
    both = {"accel.scale": np.full(3, 0.01), "accel.misalignment": np.array([0.1, 0.0, 0.05])}
    alone = [apply_effects(plain, {name: beta}, motion, None) - plain for name, beta in both.items()]  # type: ignore[arg-type]
    np.testing.assert_allclose(apply_effects(plain, both, motion, None), plain + sum(alone), atol=1e-12)  # type: ignore[arg-type]


def test_poses_have_no_candidates_of_moving_sensors() -> None:
    streams = {candidate.stream for candidate in effects_for("poses", ("accel", "gyro", "mag", "baro", "gps"))}
    assert streams == {"accel", "gyro", "mag"}


@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("kind", [step, transient], ids=["step", "transient"])
def test_an_offset_knows_its_stream(kind: ModuleType, stream: str) -> None:
    """Of the whole recording where no interval is named, in a flight that has the stream, in the field's units."""
    entry, size = kind.for_stream(stream), len(STREAMS[stream].components)
    whole = entry.regressor(Motion(t=np.array([-5.0, 0.0, 7.0])))
    np.testing.assert_array_equal(whole, np.broadcast_to(np.eye(size), (3, size, size)))
    assert stream in load_scenario(entry.scenario).sensors
    assert (entry.scenario == "base_receiver") == (stream == "base")
    assert entry.in_field_units == (stream == "mag")
    assert kind.for_stream(stream, size=size).parameters == entry.parameters


@pytest.mark.parametrize("kind", [step, transient], ids=["step", "transient"])
def test_an_offset_enters_every_component_of_a_reading(kind: ModuleType) -> None:
    assert [p.name for p in kind.for_stream("gps").parameters] == ["north", "east", "down"]
    assert [p.name for p in kind.for_stream("gps", size=6).parameters] == ["c0", "c1", "c2", "c3", "c4", "c5"]
    assert [p.name for p in kind.for_stream("laser", size=2).parameters] == ["c0", "c1"]


def test_a_late_reading_is_that_of_the_model_it_is_late_for() -> None:
    """A scan whose beams the motion does not know: 0.2 s after, level above the ground that a body climbs from."""
    t = np.linspace(0.0, 1.0, 11)
    zero = np.zeros((11, 3))
    up = np.column_stack([zero[:, :2], -5.0 - 2.0 * t])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (11, 1))
    motion = Motion(t, up, np.array([0.0, 0.0, -2.0]) + zero, q_nb=level, w_ib_b=zero)
    scan = Laser(0.1, angles=np.deg2rad([0.0, 60.0]))
    late = CATALOGUE["laser.time_offset"].apply(scan.predict(motion), np.array([0.2]), motion, scan)
    height = 5.0 + 2.0 * (t[3:] - 0.2)
    np.testing.assert_allclose(late[3:], np.column_stack([height, 2.0 * height]), rtol=1e-12)


@pytest.mark.parametrize("turn", [0.3, 0.7, 1.1, 2.3])
def test_upside_down_is_half_a_turn(turn: float) -> None:
    """Rounding takes the cosine of a tilt below -1 there."""
    upside_down = Motion(t=np.zeros(1), q_nb=np.array([[0.0, np.cos(turn) * (1.0 + 1e-15), np.sin(turn), 0.0]]))
    assert sonar_beam_cone.tilt(upside_down)[0] == pytest.approx(np.pi)
