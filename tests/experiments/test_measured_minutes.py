"""Effects put into measured minutes: the readings, the draw, the grade, the page."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.flight import Flight
from sinan.experiments.blind.maker.catalogue import CATALOGUE, OUTLIER_SIZE, Hidden
from sinan.experiments.blind.maker.drawing import draw_warm_up
from sinan.experiments.blind.maker.flight_recording import as_streams, draw_payload, draw_vibration, report_sensors
from sinan.experiments.blind.maker.flights import draw_multirotor
from sinan.experiments.blind.maker.instruments import Instrument, specs
from sinan.experiments.blind.maker.measure import DELAYS, Plan, clean_reading
from sinan.experiments.blind.maker.scene import Scene
from sinan.experiments.blind.measured import benchmark, command
from sinan.experiments.blind.measured.command import named
from sinan.experiments.blind.measured.draw import BEYOND, NOT_VISIBLE, PUT, SIZES, UNDONE, Order, draw, sized
from sinan.experiments.blind.measured.grade import grade
from sinan.experiments.blind.measured.knowing import gain, told
from sinan.experiments.blind.measured.minute import (
    Minute,
    added,
    lasting,
    local,
    minute_of,
    put,
    rng_of,
    seen_by,
    wander_of,
)
from sinan.experiments.blind.measured.page import (
    BETA,
    FURTHER,
    FURTHER_LEFT_OUT,
    IN_CLASS,
    LOCAL,
    LOCAL_ANY,
    LOCAL_SEEN,
    LOCAL_TOLD,
    LOST,
    OUTLIERS,
    RIGHT,
    RIGHT_ANY,
    RIGHT_TOLD,
    against,
    page,
    rates,
    sizes_of,
)
from sinan.experiments.blind.measured.surroundings import Shaken
from sinan.experiments.blind.measured.wander import imu_wander, wander
from sinan.experiments.commands.cli import app
from sinan.experiments.measured.flights import LOGS
from sinan.experiments.measured.minutes import lively_starts
from sinan.sensors.arrays import FloatArray
from sinan.sensors.covariates import covariates_for
from sinan.sensors.effects import effect
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, Environment, Initial, Recording, SensorSpec, Stream
from sinan.sensors.vibration import vibration_power
from sinan.sensors.window import between
from tests.experiments.conftest import require_fit

SEED, LENGTH = 3, 72.0
#: What the log's own motion makes of an effect, over what it is: the share that its errors may spoil.
BY_ESTIMATE = 0.1
PER_MILLE, ROUNDING = 1e-3, 1e-9
#: A size of each effect of the catalogue: in the middle of what the blind maker draws.
SHAKING = "accel.vibration"
OF_MINUTES = [name for name in CATALOGUE if name.split(".")[0] != "camera"]  # of which no measured log has one
LASTING = [name for name in OF_MINUTES if name.split(".")[1] not in DELAYS and name != SHAKING]
LATE = [name for name in OF_MINUTES if name.split(".")[1] in DELAYS]


def beta_of(name: str, field: float) -> FloatArray:
    """Parameters of a size that occurs, all of them different."""
    entry = CATALOGUE[name]
    size = float(np.sqrt(entry.low * entry.high)) * (field if entry.of_field else 1.0)
    return size * np.linspace(1.0, 0.4, entry.parameters)


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A flight near the ground with quiet instruments of every kind."""
    rng = np.random.default_rng(SEED)
    scene = Scene(
        draw_multirotor(rng, "figure_eight", LENGTH, 9.8, True, True), 0.0, LENGTH, 9.8, np.array([0.5, 0.1, 0.7]), 0.0,
        draw_warm_up(rng), draw_warm_up(rng), 1.0, 10.0, draw_payload(rng),
    )  # fmt: skip
    instruments = {
        "accel": Instrument(200.0, 0.01, 1e-5, 0.01), "gyro": Instrument(200.0, 1e-3, 1e-6, 1e-3),
        "mag": Instrument(50.0, 1e-3, 1e-6, 1e-3), "baro": Instrument(20.0, 0.05, 1e-3, 0.1),
        "sonar": Instrument(20.0, 0.01, 0.0, 0.0), "laser": Instrument(20.0, 0.01, 0.0, 0.0),
        "gps": Instrument(10.0, 0.05, 0.0, 0.0, 0.02),
    }  # fmt: skip
    return Plan(scene, instruments)


@pytest.fixture(scope="module")
def recording(plan: Plan) -> Recording:
    rng = np.random.default_rng(SEED)
    has = {"temperature_imu", "temperature_baro", "current", "motors", "airspeed"}
    streams = as_streams(rng, report_sensors(rng, plan), plan, has)
    scene = plan.scene
    return Recording(
        "flown",
        "flight",
        streams,
        specs(plan.instruments),
        Environment(scene.gravity, scene.field_n, scene.ground_down),
    )


@pytest.fixture(scope="module")
def minute(recording: Recording) -> Minute:
    return minute_of(recording, np.random.default_rng(SEED))


def moved(values: FloatArray) -> FloatArray:
    """Without what a bias takes up."""
    return values - values.mean(axis=0)


# ---- readings


@pytest.mark.parametrize("name", LASTING)
def test_an_effect_is_what_the_blind_maker_makes(plan: Plan, minute: Minute, name: str) -> None:
    """The maker knows the true motion, the minute what its readings say of it."""
    hidden = Hidden(name, beta_of(name, 0.87))
    sensor = hidden.stream
    t = minute.recording.streams[minute.columns(sensor)[0]].t
    size = minute.reading(sensor).shape[1]
    true = clean_reading(replace(plan, hidden=[hidden]), sensor, t, size) - clean_reading(plan, sensor, t, size)
    found = added(minute, hidden, np.random.default_rng(0))
    inside = (t > minute.begin) & (t < minute.end)
    miss = moved(found[inside]) - moved(true[inside])
    assert np.sqrt(np.mean(miss**2)) < BY_ESTIMATE * np.sqrt(np.mean(moved(true[inside]) ** 2)) + ROUNDING


@pytest.mark.parametrize("name", LASTING)
def test_an_effect_is_what_the_project_declares(minute: Minute, name: str) -> None:
    """Along one motion the forms of both agree; a lag is integrated in two ways."""
    sensor, entry, beta = name.split(".")[0], effect(name), beta_of(name, 0.87)
    seen = seen_by(minute, sensor)
    t = seen.body.t
    covariates = covariates_for(minute.recording, sensor, t)
    motion = replace(minute.around.estimate.at(t), covariates=covariates, p_n=seen.body.p)
    own = {"accel": "f_b", "gyro": "w_ib_b", "mag": "m_b"}.get(sensor)
    if own and name not in ("accel.lever_arm", "mag.declination"):  # of the reading, not of the motion
        motion = replace(motion, **{own: seen.plain}, m_n=np.empty((0, 3)))
    expected = entry.apply(seen.plain, beta, motion) - seen.plain
    found = added(minute, Hidden(name, beta), np.random.default_rng(0))
    inside = (t > minute.begin) & (t < minute.end)
    share = PER_MILLE if name == "baro.lag" else ROUNDING
    assert np.max(np.abs(found - expected)[inside]) < share * (1.0 + np.max(np.abs(expected)))


def test_what_is_stamped_late_has_the_effect_of_the_instant_at_which_it_was_read(minute: Minute) -> None:
    late = replace(minute.ready, levels=replace(minute.ready.levels, latency={"gps": 0.2}))
    stamps = minute.recording.streams["gps"].t
    np.testing.assert_allclose(seen_by(replace(minute, ready=late), "gps").body.t, stamps - 0.2)
    np.testing.assert_allclose(seen_by(replace(minute, ready=late), "mag").body.t, minute.recording.streams["mag"].t)


def test_vibration_is_the_variance_of_what_is_quick() -> None:
    """Of a flight that shakes: as it was drawn, and as the project measures it, but for a constant."""
    rng = np.random.default_rng(5)
    shake, t = draw_vibration(rng, LENGTH), np.arange(0.0, LENGTH, 0.005)
    f_b = 0.3 * np.sin(2.0 * t)[:, None] + [0.0, 0.0, -9.8] + shake.signal(t) + 0.02 * rng.normal(size=(len(t), 3))
    found = Shaken.of(Stream(t, dict(zip(ACCEL, f_b.T, strict=True)))).variance(t)
    for other in (shake.variance(t), vibration_power(t, f_b)):
        miss, whole = moved(found)[200:-200] - moved(other)[200:-200], moved(other)[200:-200]
        assert np.sqrt(np.mean(miss**2)) < 2.0 * BY_ESTIMATE * np.sqrt(np.mean(whole**2))


@pytest.mark.parametrize("name", LATE)
def test_a_late_stream_reports_what_was(minute: Minute, name: str) -> None:
    """A reading stamped t is that of t - b; the log begins with the minute, and goes on behind it."""
    stream, late = name.split(".")[0], 0.4
    found = put(minute, Hidden(name, np.array([late])), np.random.default_rng(0)).streams[stream]
    source = minute.recording.streams[stream]
    row = np.searchsorted(source.t, found.t - late - 1e-9)
    column = next(iter(found.columns))
    assert np.allclose(source.t[row] + late, found.t)
    assert np.array_equal(source[column][row], found[column])
    assert found.t[0] < minute.begin + late + 0.11
    assert found.t[-1] > minute.end - 0.11


@pytest.mark.parametrize("name", ["gps.step", "accel.transient", "baro.step", "laser.transient"])
def test_an_offset_is_in_its_interval_alone(minute: Minute, name: str) -> None:
    """A receiver keeps its velocities."""
    stream, columns = minute.columns(name.split(".")[0])
    beta = np.array([0.5, -0.2, 0.1])[: 3 if len(columns) > 1 else 1]
    begin = minute.begin + 20.0
    hidden = Hidden(name, beta, (begin, minute.end if name.endswith("step") else begin + 7.0))
    off, plain = (log.streams[stream] for log in (put(minute, hidden, np.random.default_rng(0)), minute.control))
    inside = (off.t >= begin) & (off.t < hidden.interval[1])  # type: ignore[index]
    expected = np.zeros((len(off), len(columns)))
    expected[inside, : len(beta)] = beta
    assert np.allclose(off.array(columns) - plain.array(columns), expected)


def test_a_share_of_readings_is_wrong(minute: Minute) -> None:
    """By six and more sigma of the stream's own noise, which is 0.05 m."""
    hidden = Hidden("baro.outliers", np.array([0.05]), (minute.begin, minute.end))
    off = np.abs(
        put(minute, hidden, np.random.default_rng(0)).streams["baro"]["height"]
        - minute.control.streams["baro"]["height"]
    )
    wrong = off > 0.0
    assert 0.02 < np.mean(wrong) < 0.09
    assert OUTLIER_SIZE[0] * 0.04 < np.min(off[wrong])
    assert np.max(off) < OUTLIER_SIZE[1] * 0.06


def test_nothing_else_changes(minute: Minute) -> None:
    changed = put(minute, Hidden("mag.current", np.full(3, 1e-3)), np.random.default_rng(0))
    assert {n: s for n, s in changed.streams.items() if n != "mag"}.keys() == minute.control.streams.keys() - {"mag"}
    for name, stream in minute.control.streams.items():
        if name != "mag":
            assert all(np.array_equal(stream[c], changed.streams[name][c]) for c in stream.columns)
    assert changed.effects == {}


# ---- the minute


def test_what_a_log_lacks_is_drawn(recording: Recording) -> None:
    """And stays the same for the same seed; what it has stays as it is."""
    bare = {name: s for name, s in recording.streams.items() if name in ("imu", "gps", "baro")}
    bare["imu"] = Stream(bare["imu"].t, {c: v for c, v in bare["imu"].columns.items() if c != "temperature"})
    one, other = (minute_of(recording.replace(streams=bare), rng_of(1, "a log")) for _ in range(2))
    assert one.drawn == ("temperature_imu", "current")
    assert np.array_equal(one.control.streams["power"]["current"], other.control.streams["power"]["current"])
    assert "mag.current" not in lasting(one)
    assert "accel.temperature" in lasting(one)
    assert np.array_equal(
        one.recording.streams["baro"]["temperature"], bare["baro"]["temperature"][: len(one.recording.streams["baro"])]
    )


def test_the_current_of_a_flight_goes_with_its_thrust(minute: Minute, recording: Recording) -> None:
    streams = {name: s for name, s in recording.streams.items() if name in ("imu", "gps")}
    found = minute_of(recording.replace(streams=streams), rng_of(2, "a log")).recording.streams["power"]
    imu = recording.streams["imu"]
    force = np.interp(found.t, imu.t, np.linalg.norm(imu.array(ACCEL), axis=1))
    assert np.corrcoef(force, found["current"])[0, 1] > 0.5


def test_minutes_are_the_lively_ones() -> None:
    """Of a log that turns in its last two minutes alone."""
    t = np.arange(0.0, 300.0, 0.1)
    still = dict.fromkeys((*ACCEL, *GYRO), np.zeros(len(t)))
    log = Recording("log", "flight", {"imu": Stream(t, {**still, "gyro_z": np.where(t > 180.0, 1.0, 0.0)})})
    starts = lively_starts(log, 60.0, 30.0)
    assert np.min(starts) >= 120.0
    assert lively_starts(between(log, 0.0, 40.0), 60.0, 30.0) == pytest.approx([0.0])


def test_a_part_has_no_first_state_of_the_whole(recording: Recording) -> None:
    declared = recording.replace(initial=Initial(position=np.ones(3)))
    assert between(declared, 0.0, 10.0).initial.position is not None
    assert between(declared, 5.0, 10.0).initial == Initial()
    assert all(s.t[0] >= 5.0 and s.t[-1] < 10.0 for s in between(declared, 5.0, 10.0).streams.values())


# ---- wander


def test_wander_of_white_noise_and_of_a_walk() -> None:
    """Variances 3/2 sigma^2 / n and w^2 length / 4: 10 Hz, 5 s."""
    rng, t = np.random.default_rng(6), np.arange(0.0, 20000.0, 0.1)
    assert wander(t, 0.3 * rng.normal(size=(len(t), 1)), 5.0) == pytest.approx(0.3 * np.sqrt(1.5 / 50.0), rel=0.05)
    walk = 0.2 * np.sqrt(0.1) * np.cumsum(rng.normal(size=(len(t), 1)), axis=0)
    assert wander(t, walk, 5.0) == pytest.approx(0.2 * np.sqrt(5.0 / 4.0), rel=0.05)
    spec = SensorSpec(noise_density=0.3 * np.sqrt(0.1), bias_walk=0.2)
    assert imu_wander(spec, 5.0) == pytest.approx(np.sqrt(0.09 * 1.5 / 50.0 + 0.04 * 5.0 / 4.0))


def test_a_trend_and_a_gap_are_no_wander() -> None:
    t = np.concatenate([np.arange(0.0, 20.0, 0.1), np.arange(45.0, 90.0, 0.1)])
    assert wander(t[t > 40.0], 0.1 * t[t > 40.0, None], 5.0) == pytest.approx(0.0, abs=1e-9)
    assert wander(t, 0.1 * t[:, None], 5.0) < 0.1 * 5.0 / 4.0
    assert wander(t[:2], np.ones((2, 1)), 5.0) == pytest.approx(0.0)


def test_wander_of_a_stream_is_that_of_its_instrument(minute: Minute) -> None:
    """Baro: 0.05 m at 20 Hz, a walk of 1e-3; of three axes GPS has a wander."""
    expected = np.sqrt(1.5 * 0.05**2 / 200.0 + 1e-6 * 10.0 / 4.0)
    assert wander_of(minute, "baro", 10.0) == pytest.approx(expected, rel=0.5)
    assert wander_of(minute, "gps", 10.0).shape == (3,)
    assert wander_of(minute, "accel", 10.0) == pytest.approx(0.01 / np.sqrt(200.0) * np.sqrt(0.15), rel=0.01)


# ---- draw and size


def report_of(*effects: Mapping[str, Any], **detectable: list[float | None]) -> dict[str, Any]:
    """A report with effects found, and what is detectable of others."""
    found = [{"interval": None, "confused_with": [], **e} for e in effects]
    candidates = [{"name": n.replace("__", "."), "detectable_from": d} for n, d in detectable.items()]
    return {
        "verdict": "effects" if found else "no_effect",
        "effects": found,
        "candidates": candidates,
        "cpu_seconds": 6.0,
    }


def order_of(name: str, size: float, direction: list[float], interval: tuple[float, float] | None = None) -> Order:
    return Order(0, name, size, np.array(direction), interval)


def test_draws_go_with_seed_and_number_alone(minute: Minute) -> None:
    orders = [draw(1, run, minute) for run in range(200)]
    again = draw(1, 17, minute)
    assert again.name == orders[17].name
    assert np.array_equal(again.direction, orders[17].direction)
    assert {o.size for o in orders} == set(SIZES)
    assert {o.name for o in orders if not o.is_lasting} <= set(local(minute))
    assert 0.45 < np.mean([o.is_lasting for o in orders]) < 0.75
    assert all(np.all(o.direction > 0.0) for o in orders if o.is_lasting and CATALOGUE[o.name].positive)


def test_a_lasting_effect_is_as_large_as_the_control_finds_detectable(minute: Minute) -> None:
    """Of the component that is seen best: 2 x 0.01 / 0.6 along (0.6, 0, 0.8), where the third is seen from 0.04 on."""
    control = report_of(gyro__scale=[0.01, None, 0.04])
    hidden, status = sized(order_of("gyro.scale", 2.0, [0.6, 0.0, 0.8]), minute, control)
    assert status == PUT
    assert hidden is not None
    assert hidden.beta == pytest.approx(2.0 * 0.01 / 0.6 * np.array([0.6, 0.0, 0.8]))
    assert np.max(np.abs(hidden.beta) / [0.01, np.inf, 0.04]) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("name", "control", "status"),
    [
        ("gyro.scale", report_of(), NOT_VISIBLE),
        ("gyro.scale", report_of(gyro__scale=[None, None, None]), NOT_VISIBLE),
        ("gyro.scale", report_of(gyro__scale=[0.5, 0.5, 0.5]), BEYOND),
        ("gyro.scale", {"verdict": "refused", "effects": []}, NOT_VISIBLE),
    ],
)
def test_what_cannot_be_put_in_says_why(minute: Minute, name: str, control: dict[str, Any], status: str) -> None:
    assert sized(order_of(name, 1.0, [0.6, 0.0, 0.8]), minute, control) == (None, status)


@pytest.mark.parametrize(("named", "status"), [(-0.009, UNDONE), (0.009, PUT), (-0.005, PUT), (None, PUT)])
def test_what_undoes_an_effect_of_the_log_is_not_put_in(minute: Minute, named: float | None, status: str) -> None:
    """0.012 put in where 0.006 would be found: with -0.009 of the log's own there are 0.003 left, with -0.005 0.007."""
    own = [] if named is None else [{"name": "mag.time_offset", "beta": [named]}]
    control = report_of(*own, mag__time_offset=[0.006])
    assert sized(order_of("mag.time_offset", 2.0, [1.0]), minute, control)[1] == status


@pytest.mark.parametrize(("late", "status"), [(-0.009, UNDONE), (0.009, PUT)])
def test_what_undoes_a_lateness_that_has_no_name_is_not_put_in(minute: Minute, late: float, status: str) -> None:
    """The log may have one that is too little to be told."""
    model = minute.ready.model.replace(latency={"mag": late})
    ready = replace(minute.ready, flight=Flight(minute.ready.recording, model))
    order = order_of("mag.time_offset", 2.0, [1.0])
    assert sized(order, replace(minute, ready=ready), report_of(mag__time_offset=[0.006]))[1] == status


def test_a_magnetic_size_goes_with_the_field(minute: Minute) -> None:
    """`mag.current` occurs up to 0.03 of the field an ampere."""
    bound = CATALOGUE["mag.current"].high * float(np.linalg.norm(minute.around.field_n))
    for share, status in ((0.9, PUT), (1.1, BEYOND)):
        least = [share * bound, None, None]
        assert sized(order_of("mag.current", 1.0, [1.0, 0.0, 0.0]), minute, report_of(mag__current=least))[1] == status


def test_a_transient_is_ten_times_the_wander_over_its_length(minute: Minute) -> None:
    interval = (minute.begin + 10.0, minute.begin + 15.0)
    hidden, _ = sized(order_of("baro.transient", 2.0, [-1.0], interval), minute, report_of())
    assert hidden is not None
    assert hidden.beta == pytest.approx(-20.0 * wander_of(minute, "baro", 5.0))


def test_an_offset_that_does_not_occur_is_not_put_in(minute: Minute) -> None:
    """A barometer is off by 9 m at most; wanders of centimetres are no reason to put in more."""
    interval = (minute.begin + 10.0, minute.begin + 15.0)
    size = 9.1 / (10.0 * float(wander_of(minute, "baro", 5.0)[0]))
    assert sized(order_of("baro.transient", size, [1.0], interval), minute, report_of()) == (None, BEYOND)
    assert sized(order_of("baro.transient", 0.9 * size, [1.0], interval), minute, report_of())[1] == PUT


# ---- what one who knows gains


@pytest.mark.parametrize(
    ("name", "beta", "interval"),
    [("gps.latency", [0.05], None), ("mag.scale", [0.01, 0.0, 0.0], None), ("baro.step", [0.5], 40.0)],
)
def test_one_who_knows_gains_what_there_is_to_see(
    minute: Minute, name: str, beta: list[float], interval: float | None
) -> None:
    """As the sensitivity of the innovations has it: lambda = beta' Lambda beta."""
    span = None if interval is None else (minute.begin + interval, minute.end)
    hidden = Hidden(name, np.array(beta), span)
    entry = effect(name) if span is None else effect(name).over(*span)
    information, _ = sensitivity_pass(Flight(minute.control, minute.ready.model), [entry])[1].total
    expected = float(hidden.beta @ information @ hidden.beta)
    assert expected > DETECTABLE_LAMBDA
    assert gain(minute, hidden) == pytest.approx(expected, abs=4.0 * np.sqrt(expected))


def test_nobody_gains_by_outliers_or_by_nothing(minute: Minute) -> None:
    assert gain(minute, Hidden("gps.outliers", np.array([0.05]), (0.0, 60.0))) is None
    assert told(minute, Hidden("gps.outliers", np.array([0.05]), (0.0, 60.0))) is None
    assert gain(minute, Hidden("mag.scale", np.full(3, 1e-9))) == pytest.approx(0.0, abs=1e-3)
    assert told(minute, Hidden("mag.scale", np.full(3, 1e-9))) == pytest.approx(0.0, abs=0.5)


def test_a_minute_tells_of_a_lateness_all_and_of_a_step_what_its_noise_leaves(recording: Recording) -> None:
    """A bias that walks takes a part of a step up; of a lateness hardly a thing. Few streams have few sizes to seek."""
    streams = {name: recording.streams[name] for name in ("imu", "baro", "gps")}
    undeclared = minute_of(recording.replace(streams=streams, sensors={}), np.random.default_rng(SEED))
    share = {}
    for name, span in (("gps.latency", None), ("baro.step", (undeclared.begin + 40.0, undeclared.end))):
        either = [gain(undeclared, Hidden(name, np.array([size]), span)) for size in (0.01, -0.01)]
        assert either[0] is not None
        assert either[1] is not None
        both = either[0] + either[1]  # without what noise adds, which is of either sign
        hidden = Hidden(name, np.array([0.01 * np.sqrt(300.0 / both)]), span)
        known, seen = gain(undeclared, hidden), told(undeclared, hidden)
        assert known == pytest.approx(150.0, abs=4.0 * np.sqrt(150.0))
        assert seen is not None
        share[name] = seen / known
    assert share["gps.latency"] == pytest.approx(0.9, abs=0.15), share
    assert 0.0 < share["baro.step"] < 0.7, share


# ---- grade


PUT_IN = Hidden("gyro.scale", np.array([0.02, 0.0, 0.0]))
SCALE = {"name": "gyro.scale", "beta": [0.03, 0.0, 0.0], "std": [0.01, 0.01, None]}
KNOWN = {"name": "gyro.scale", "beta": [0.03, 0.0, 0.0], "std": [0.001, 0.001, 0.001]}
LATENCY = {"name": "gps.latency", "beta": [0.2], "std": [0.01]}
STEP = {"name": "gps.step", "beta": [1.0, 0.0, 0.0], "std": [0.1, 0.1, 0.1], "interval": [20.0, 60.0]}


def test_the_right_name_beside_those_of_the_control() -> None:
    found = grade(PUT_IN, report_of(SCALE, LATENCY), report_of(LATENCY), 6.0)
    assert (found.right, found.in_class, found.known, found.further, found.lost) == (True, True, False, (), ())
    assert found.z == pytest.approx(0.5, abs=0.5)  # one sigma, the larger of two


def test_beta_is_less_that_of_the_control() -> None:
    """0.05 where the control has 0.03 and 0.02 was put in."""
    both = {**SCALE, "beta": [0.05, 0.0, 0.0]}
    found = grade(PUT_IN, report_of(both), report_of(KNOWN), 6.0)
    assert (found.right, found.known) == (True, True)
    assert found.z == pytest.approx(0.0, abs=1e-6)


def test_a_name_that_the_control_has_is_no_find_by_itself() -> None:
    found = grade(PUT_IN, report_of(KNOWN), report_of(KNOWN), 6.0)
    assert (found.right, found.in_class, found.known, found.further) == (False, False, True, ())


def test_further_and_lost_names() -> None:
    found = grade(PUT_IN, report_of(STEP), report_of(LATENCY), 6.0)
    assert (found.right, found.further, found.lost, found.z) == (False, ("gps.step",), ("gps.latency",), None)
    confused = grade(PUT_IN, report_of({**STEP, "confused_with": ["gyro.scale"]}), report_of(), 6.0)
    assert (confused.right, confused.in_class) == (False, True)


def test_a_further_name_that_the_control_calls_confused_is_counted_apart() -> None:
    control = report_of({**LATENCY, "confused_with": ["gps.step"]})
    found = grade(PUT_IN, report_of(STEP), control, 6.0)
    assert (found.further, found.further_left_out) == (("gps.step",), ())
    assert grade(PUT_IN, report_of(STEP), report_of(LATENCY), 6.0).further_left_out == ("gps.step",)


@pytest.mark.parametrize(("interval", "right"), [((15.0, 25.0), True), ((5.0, 15.0), False)])
def test_a_step_is_right_at_its_time(interval: tuple[float, float], right: bool) -> None:
    hidden = Hidden("gps.step", np.array([1.0, 0.0, 0.0]), interval)
    assert grade(hidden, report_of(STEP), report_of(), 6.0).right is right


# ---- rates and page


def row(
    name: str = "gyro.scale",
    size: float = 1.0,
    status: str = PUT,
    gain: float | None = 50.0,
    told: float = 40.0,
    **changed: Any,
) -> dict[str, Any]:
    """One run as its JSON has it."""
    found = asdict(grade(PUT_IN, report_of(SCALE), report_of(), 6.0)) | changed
    lasting = name in CATALOGUE
    rest = (
        {"gain": gain, "told": told, "grade": found, "beta": [0.02, 0.0, 0.0], "interval": None, "why": ""}
        if status == PUT
        else {"why": status}
    )
    return {
        "log": "a log",
        "seed": 0,
        "run": 0,
        "name": name,
        "size": size,
        "lasting": lasting,
        "status": status,
        **rest,
    }


@pytest.mark.parametrize(
    ("asked", "rows", "reached"),
    [
        (RIGHT, (row(), row(right=False), row(size=0.5, right=False), row("gps.step", right=False)), (1, 2)),
        (RIGHT_ANY, (row(), row(size=0.5, right=False)), (1, 2)),
        (IN_CLASS, (row(right=False), row(right=False, in_class=False)), (1, 2)),
        (LOCAL, (row("gps.step"), row("gps.step", 0.5, right=False), row("gps.outliers", right=False), row()), (1, 1)),
        (LOCAL_SEEN, (row("gps.step"), row("gps.step", gain=20.0), row("gps.step", 0.5), row()), (1, 1)),
        (LOCAL_TOLD, (row("gps.step"), row("gps.step", told=20.0), row("gps.step", 0.5), row()), (1, 1)),
        (RIGHT_TOLD, (row(), row(told=20.0), row(size=0.5, right=False), row("gps.step")), (1, 2)),
        (LOCAL_ANY, (row("gps.step"), row("baro.transient", 0.5, right=False)), (1, 2)),
        (OUTLIERS, (row("gps.outliers"), row("gps.step")), (1, 1)),
        (FURTHER_LEFT_OUT, (row(), row(further=("gps.step",)), row(further_left_out=("gps.step",))), (1, 3)),
        (FURTHER, (row(), row(further=("gps.step",)), row(status=BEYOND)), (1, 2)),
        (LOST, (row(), row(control=("gps.latency",), lost=("gps.latency",)), row(control=("gps.latency",))), (1, 2)),
        (BETA, (row(z=2.9), row(z=3.1), row(z=None)), (1, 2)),
    ],
)
def test_rate(asked: str, rows: Sequence[dict[str, Any]], reached: tuple[int, int]) -> None:
    found = rates(rows)[asked]
    assert (found["k"], found["n"]) == reached


def control_of(**detectable: list[float | None]) -> dict[str, Any]:
    report = report_of(LATENCY, **detectable)
    return {"log": "a log", "seed": 0, "begin": 0.0, "end": 60.0, "drawn": ["current"], "report": report}


def test_detectable_sizes_are_held_against_those_of_the_reference() -> None:
    """Medians of components; gone is infinite, new is zero, never seen is not counted."""
    before = control_of(
        gyro__scale=[0.02, 0.02, 0.02], mag__scale=[0.1, None, None], baro__lag=[None], gps__latency=[1.0]
    )
    now = control_of(
        gyro__scale=[0.01, 0.01, 0.04], mag__scale=[None, None, None], baro__lag=[0.3], accel__scale=[1.0] * 3
    )
    assert sorted(against([now], sizes_of([before]))) == [0.0, 0.5, np.inf]
    assert list(against([before], sizes_of([before]))) == [1.0, 1.0, 1.0]


def test_page_says_what_is_detectable() -> None:
    """The median of the logs that show an effect, by its best component."""
    two = {**control_of(gyro__scale=[0.03, 0.04, None]), "log": "another"}
    three = {**control_of(gyro__scale=[None, None, None], baro__lag=[None]), "log": "a third"}
    text = page([control_of(gyro__scale=[0.01, 0.02, 0.02]), two, three], [row()])
    assert "| gyro.scale | 0.02 | 2, 3 | - |" in text
    assert "| baro.lag | - | 0, 1 | - |" in text


def test_page_says_what_was_put_in() -> None:
    rows = [row(), row(status=NOT_VISIBLE), row("gps.step", size=2.0, right=False, further=("baro.step",))]
    text = page([control_of()], rows)
    assert "3 draws of seed 0 from 1 logs: 2 put, 1 not visible." in text
    assert "| a log | gyro.scale 0.02, 0, 0 | 1 | 50 | 40 | yes | - | - |" in text
    assert "| a log | gps.step 0.02, 0, 0 | 2 | 50 | 40 | no | baro.step | - |" in text
    assert "| a log | 0 | current | gps.latency | effects | 6 |" in text


# ---- a small benchmark


@pytest.fixture
def one_log(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A log that a tracer is asked about which finds everything late, and the names of what it was asked."""
    asked: list[str] = []

    def examined(log: Recording) -> dict[str, Any]:
        asked.append(log.name)
        if len(asked) == 3:
            raise ValueError("no model")
        return report_of(LATENCY, gps__latency=[0.02], mag__scale=[0.01, 0.01, 0.01])

    monkeypatch.setattr(benchmark, "LOGS", {"a log": "folder/log"})
    monkeypatch.setattr(benchmark, "resolve", lambda given: recording)
    monkeypatch.setattr(benchmark, "examined", examined)
    return asked


def require_files_fit(out: Path) -> None:
    """What the benchmark keeps in order to go on."""
    for path in sorted(out.glob("*/*.json")):
        require_fit(f"blind-measured-{path.parent.name}", json.loads(path.read_text(encoding="utf-8")))


def test_benchmark_goes_on_where_it_was_stopped(one_log: list[str], tmp_path: Path) -> None:
    benchmark.run(tmp_path, ["a log"], 8, 4)
    controls, done = benchmark.collected(tmp_path)
    assert [r["run"] for r in done] == list(range(8))
    assert len(controls) == 1
    traced = len(one_log)
    assert traced == 1 + sum(r["status"] == PUT for r in done)
    assert sum(r["grade"]["verdict"] == "refused" for r in done if r["status"] == PUT) == 1
    (tmp_path / benchmark.RUNS / "4-00005.json").write_text("{", encoding="utf-8")
    assert len(benchmark.collected(tmp_path)[1]) == 7
    benchmark.run(tmp_path, ["a log"], 8, 4)
    assert benchmark.collected(tmp_path)[1][5] == done[5]
    assert len(one_log) == traced + (done[5]["status"] == PUT)
    require_files_fit(tmp_path)


def test_a_log_without_a_minute_is_told(one_log: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable(given: str) -> Recording:
        raise InputError(given, "nothing", "a log")

    monkeypatch.setattr(benchmark, "resolve", unreadable)
    benchmark.run(tmp_path, ["a log"], 1, 4)
    found = benchmark.collected(tmp_path)[1]
    assert found[0]["status"] == "refused"
    assert "nothing" in page([], found)
    require_files_fit(tmp_path)


def test_an_unknown_log_is_named(tmp_path: Path) -> None:
    assert named(LOGS["walk, RTK"]) == "walk, RTK"
    with pytest.raises(InputError, match="no measured flight"):
        named("walk")


def test_command_writes_page_and_rates(one_log: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "LOGS", {"a log": "folder/log"})
    asked = ["blind", str(tmp_path / "out"), "--measured", "--logs", "folder/log", "--runs", "4"]
    result = CliRunner().invoke(app, [*asked, "--table", str(tmp_path / "page.md")])
    assert result.exit_code == 0, result.output
    assert RIGHT in result.output
    assert "4 draws of seed 0 from 1 logs" in (tmp_path / "page.md").read_text(encoding="utf-8")
    kept = json.loads((tmp_path / "out" / "rates.json").read_text(encoding="utf-8"))
    assert kept["detectable"]["0 a log"]["mag.scale"] == [0.01, 0.01, 0.01]
    require_fit("blind-measured", kept)


@pytest.mark.measured
def test_the_tracer_before_a_measured_minute(
    measured_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flight of the course, and two draws that can be put in: all that the page needs is in the reports."""
    if "SINAN_DATA" not in os.environ:
        monkeypatch.setenv("SINAN_DATA", str(measured_data))
    benchmark.run(tmp_path, ["course, quadrotor"], 2, 0)
    controls, runs = benchmark.collected(tmp_path)
    assert [r["status"] for r in runs] == [PUT, PUT]
    assert all(r["grade"]["verdict"] != "refused" and np.isfinite([r["gain"], r["told"]]).all() for r in runs)
    assert "gyro.scale" in sizes_of(controls)["0 course, quadrotor"]
    assert "| course, quadrotor | gyro." in page(controls, runs)
