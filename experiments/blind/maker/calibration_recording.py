"""Recordings of the hand and the bench: attitude flights without aiding, poses, and turns for the gyroscope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.experiments.blind.maker.body import Motion
from sinan.experiments.blind.maker.catalogue import HAND, needed
from sinan.experiments.blind.maker.curves import Curve, Sine
from sinan.experiments.blind.maker.drawing import (
    Made,
    Order,
    also_true,
    constant_temperature,
    draw_field,
    draw_hidden,
    draw_outside,
    draw_warm_up,
)
from sinan.experiments.blind.maker.flight_recording import CURRENT_NOISE, TEMPERATURE_NOISE, columns, logged
from sinan.experiments.blind.maker.flights import draw_hand
from sinan.experiments.blind.maker.instruments import Instrument, draw_imu, draw_mag, specs
from sinan.experiments.blind.maker.measure import STAMP_DECIMALS, Plan, Reported, plain_reading, report, stamps
from sinan.experiments.blind.maker.rough import Rough, draw_rough
from sinan.experiments.blind.maker.scene import Scene, WarmUp
from sinan.experiments.blind.maker.still import draw_poses, draw_tumbling
from sinan.experiments.blind.maker.truth import hidden_on_clock, outside_on_clock, truth_stream
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import ACCEL as ACCEL_COLUMNS
from sinan.sensors.recording import GYRO as GYRO_COLUMNS
from sinan.sensors.recording import MAG as MAG_COLUMNS
from sinan.sensors.recording import Environment, Recording, SensorSpec, Stream

#: How often noise levels are declared.
DECLARED = 0.7


def make_hand(rng: np.random.Generator, order: Order, name: str) -> Made:
    """IMU and magnetometer in the hand, no position aiding: turns with rests between, first attitude not given."""
    gravity = draw_gravity(rng)
    motion, length = draw_hand(rng, int(rng.integers(22, 36)), (0.5, 2.5), (1.5, 3.5), 3.0, 2.0, gravity)
    scene = draw_bench(rng, motion, length, gravity, draw_warm_up(rng))
    instruments = draw_imu(rng, float(rng.choice([100.0, 125.0, 200.0])))
    instruments["mag"] = draw_mag(rng, float(np.linalg.norm(scene.field_n)))
    plan = draw_plan(rng, order, scene, instruments)
    reported = report_imu(rng, plan)
    reported["mag"] = report(rng, plan, "mag", stamps(rng, scene, instruments["mag"].rate), 3)
    warm = "temperature_imu" in needed(order.names) or rng.uniform() < 0.5
    found = reported["mag"]
    streams = {
        "imu": imu_stream(rng, reported, scene, warm),
        "mag": Stream(found.t, columns(MAG_COLUMNS, found.reading)),
    }
    environment = Environment(gravity, scene.field_n)
    return finished(Recording(name, "flight", streams, specs(instruments), environment), plan, reported, True, "hand")


def make_turns(rng: np.random.Generator, order: Order, name: str) -> Made:
    """A full-rate IMU of static poses with turns between."""
    gravity = draw_gravity(rng)
    first = float(rng.uniform(8.0, 20.0))
    motion, length = draw_hand(rng, int(rng.integers(15, 41)), (2.0, 4.0), (1.0, 2.5), first, 5.0, gravity)
    scene = draw_bench(rng, motion, length, gravity, draw_warm_up(rng))
    instruments = draw_imu(rng, float(rng.choice([100.0, 125.0, 200.0])))
    instruments["accel"] = replace(instruments["accel"], bias=0.05)
    plan = draw_plan(rng, order, scene, instruments)
    plan = replace(plan, scales={"accel": 0.005 * rng.normal(size=3)})
    reported = report_imu(rng, plan)
    warm = "temperature_imu" in needed(order.names) or rng.uniform() < 0.5
    sensors = {
        sensor: SensorSpec(noise_density=spec.noise_density, bias_walk=spec.bias_walk)
        for sensor, spec in specs(instruments).items()
    } if rng.uniform() < DECLARED else {}  # fmt: skip
    streams = {"imu": imu_stream(rng, reported, scene, warm)}
    return finished(Recording(name, "poses", streams, sensors, Environment(gravity)), plan, reported, False, "turns")


def make_poses(rng: np.random.Generator, order: Order, name: str) -> Made:
    """Static poses of an accelerometer or magnetometer, a row each; or a magnetometer that is turned slowly."""
    sensor = order.sensor
    gravity = draw_gravity(rng)
    turned = sensor == "mag" and rng.uniform() < 0.6
    needs = needed(order.names)
    if turned:
        count, rate = int(np.round(100.0 * 30.0 ** rng.uniform())), float(rng.choice([10.0, 20.0, 50.0]))
        motion: Motion = draw_tumbling(rng, count / rate, gravity)
    else:
        count, rate = int(rng.integers(12, 61)), 1.0 / float(rng.choice([1.0, 20.0, 45.0]))
        motion = draw_poses(rng, count, 1.0 / rate, gravity)
    length = count / rate
    scene = draw_bench(rng, motion, length, gravity, draw_chamber(rng, length))
    field_norm = float(np.linalg.norm(scene.field_n))
    unit = 1.0 if sensor == "accel" else field_norm
    noise = unit * float(np.exp(rng.uniform(*np.log([1.5e-3, 0.015]))))
    bias = unit * float(rng.uniform(0.05, 0.3))
    plan = draw_plan(rng, order, scene, {sensor: Instrument(rate, noise, 0.0, bias)}, poses=True)
    plan = replace(plan, scales={sensor: (0.02 if sensor == "accel" else 0.08) * rng.normal(size=3)})
    t = np.round(np.arange(count) / rate, STAMP_DECIMALS)
    found = report(rng, plan, sensor, t, 3)
    reported = {sensor: replace(found, wrong=along(found.wrong, plain_reading(sensor, motion(t), scene, 3)))}
    named = ACCEL_COLUMNS if sensor == "accel" else MAG_COLUMNS
    table = columns(named, found.reading)
    if "temperature_imu" in needs or rng.uniform() < 0.5:
        table["temperature"] = logged(rng, scene.temperature_imu(found.t), TEMPERATURE_NOISE)
    streams = {}
    if "current" in needs or (sensor == "mag" and rng.uniform() < 0.4):
        if turned and rng.uniform() < 0.5:
            streams["power"] = power_stream(rng, scene)
        else:
            table["current"] = logged(rng, scene.current(motion(found.t)), CURRENT_NOISE)
    streams["mag" if turned else "poses"] = Stream(found.t, table)
    sensors = {sensor: SensorSpec(noise_std=noise)} if rng.uniform() < DECLARED else {}
    environment = Environment(gravity) if sensor == "accel" else Environment(gravity, scene.field_n)
    recording = Recording(name, "poses", streams, sensors, environment)
    return finished(recording, plan, reported, False, "tumbling" if turned else "poses")


def along(wrong: FloatArray, truth: FloatArray) -> FloatArray:
    """(n, 1) what wrong readings change of the norm, which is all that is known of a pose."""
    return np.asarray(np.sum(wrong * truth, axis=1, keepdims=True) / np.linalg.norm(truth, axis=1, keepdims=True))


def draw_gravity(rng: np.random.Generator) -> float:
    """Anywhere on the Earth."""
    return float(np.round(rng.uniform(9.78, 9.83), 4))


def draw_bench(rng: np.random.Generator, motion: Motion, length: float, gravity: float, warmth: WarmUp) -> Scene:
    """Surroundings on the ground; the supply feeds something whose current changes."""
    swings = [
        Sine(
            float(rng.uniform(1.0, 3.0)), 2.0 * np.pi * float(rng.uniform(2.0, 12.0)) / length, float(rng.uniform(0, 6))
        )
        for _ in range(3)
    ]
    return Scene(motion, 0.0, length, gravity, draw_field(rng), 0.0, warmth, constant_temperature(rng), 1.0, 0.0,
                 Curve(9.0, swings))  # fmt: skip


def draw_chamber(rng: np.random.Generator, length: float) -> WarmUp:
    """A temperature that is taken through a wide range while the poses change."""
    swing = [
        Sine(
            float(rng.uniform(5.0, 12.0)), 2.0 * np.pi * float(rng.uniform(0.7, 3.0)) / length, float(rng.uniform(0, 6))
        )
        for _ in range(2)
    ]
    return WarmUp(float(rng.uniform(18.0, 32.0)), 0.0, 0.0, 1.0, Curve(sines=swing))


def draw_plan(
    rng: np.random.Generator, order: Order, scene: Scene, instruments: dict[str, Instrument], poses: bool = False
) -> Plan:
    """Hidden effects, disturbance and roughness; a set of poses has no jitter and no gaps."""
    coarse = scene.motion(np.arange(scene.begin, scene.end, 0.02 if not poses else (scene.end - scene.begin) / 500.0))
    rough = draw_rough(rng, instruments, scene.begin, scene.end) if order.rough else Rough()
    if poses or order.kind not in (HAND,):
        rough = replace(rough, jitter={}, gaps={})
    hidden = draw_hidden(rng, order.names, scene, instruments, poses)
    return Plan(scene, instruments, hidden, draw_outside(rng, order, scene, instruments, coarse), rough)


def report_imu(rng: np.random.Generator, plan: Plan) -> dict[str, Reported]:
    """Accelerometer and gyroscope on their common clock."""
    t = np.round(np.arange(0.0, plan.scene.end, 1.0 / plan.instruments["accel"].rate), STAMP_DECIMALS)
    return {sensor: report(rng, plan, sensor, t, 3) for sensor in ("accel", "gyro")}


def imu_stream(rng: np.random.Generator, reported: dict[str, Reported], scene: Scene, warm: bool) -> Stream:
    """`imu.csv`, with the IMU's temperature where it is logged."""
    readings = np.concatenate([reported["accel"].reading, reported["gyro"].reading], axis=1)
    table = columns([*ACCEL_COLUMNS, *GYRO_COLUMNS], readings)
    t = reported["accel"].t
    if warm:
        table["temperature"] = logged(rng, scene.temperature_imu(t), TEMPERATURE_NOISE)
    return Stream(t, table)


def power_stream(rng: np.random.Generator, scene: Scene) -> Stream:
    """`power.csv` at 20 Hz over the whole recording."""
    t: FloatArray = np.round(np.arange(0.0, scene.end + 0.05, 0.05), STAMP_DECIMALS)
    current = logged(rng, scene.current(scene.motion(t)), CURRENT_NOISE)
    return Stream(t, {"current": current, "voltage": np.round(16.4 - 0.02 * current, 4)})


def finished(recording: Recording, plan: Plan, reported: dict[str, Reported], moving: bool, style: str) -> Made:
    """The recording with its answer; only what moves has a truth."""
    return Made(
        recording=recording,
        truth=truth_stream(plan.scene, reported, 0.0) if moving else None,
        hidden=hidden_on_clock(plan.hidden, reported, 0.0),
        outside=outside_on_clock(plan.outside, 0.0),
        strength=max(found.strength for found in reported.values()),
        rough=plan.rough,
        also_true=also_true(plan.rough),
        style=style,
    )
