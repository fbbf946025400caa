"""Motion, sensor models and effects -> a recording and its truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from sinan.sensors.errors import InputError
from sinan.sensors.pictures import pictures
from sinan.sensors.readings import (
    ON_THE_IMU_CLOCK,
    Present,
    World,
    bias_at,
    columns_of,
    instants,
    model_of,
    read,
    scale_of,
)
from sinan.sensors.recording import (
    POSITION,
    QUATERNION,
    VELOCITY,
    Environment,
    Initial,
    Recording,
    SensorSpec,
    Stream,
    Truth,
)
from sinan.sensors.registry import BySensor, sensor
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply
from sinan.sensors.scenario import Scenario
from sinan.sensors.trajectory import Multicopter
from sinan.sensors.vehicle import Vehicle

__all__ = ["Present", "simulate"]

#: Amplitude given to a vehicle that does not shake when the effect of its vibration is asked for [m/s^2]
SHAKING = (1.0, 1.0, 2.0)
BIAS_COLUMNS = BySensor(lambda entry: entry.bias_columns)


def simulate(
    scenario: Scenario,
    rng: np.random.Generator,
    effects: Sequence[Present] | Mapping[str, Sequence[float]] = (),
    declare: bool = False,
) -> tuple[Recording, Stream]:
    """Simulate a scenario.

    Parameters
    ----------
    scenario : what is flown or turned, with which instruments
    rng : source of all randomness; the same state gives the same recording
    effects : what the plain models lack and the data show
    declare : write the effects into the recording, where every estimator models them; else they are nowhere in it

    Returns
    -------
    the recording; the truth, with the biases (reading = truth + bias)

    Raises
    ------
    InputError : an effect that does not fit the scenario
    """
    present = _checked(scenario, effects, declare)
    scenario = _with_effects_on_the_vehicle(scenario, present)
    roots = tuple(int(root) for root in rng.integers(0, 2**32, 4))
    first = "accel" if "accel" in scenario.sensors else next(iter(scenario.sensors))
    clock = instants(scenario, first, np.random.default_rng(roots))
    world = World(scenario, Vehicle(scenario, scenario.trajectory()), present, roots, clock)
    truth = _truth(world)
    streams, points = _streams(world), None
    if "camera" in scenario.sensors:
        streams["camera"], points = pictures(world)
    recording = Recording(
        name=scenario.name,
        kind=scenario.kind,
        streams={name: stream for name, stream in streams.items() if len(stream)},
        sensors={name: _declared(scenario, name) for name in scenario.sensors},
        environment=Environment(scenario.gravity, np.array(scenario.magnetic_field), scenario.ground_down),
        initial=_initial(world),
        origin=scenario.origin,
        effects={p.effect.name: tuple(float(b) for b in p.beta) for p in present} if declare else {},
        truth=Truth(truth, "simulation"),
        points=points,
    )
    return recording, truth


def _checked(
    scenario: Scenario, effects: Sequence[Present] | Mapping[str, Sequence[float]], declare: bool
) -> tuple[Present, ...]:
    """The effects as `Present`, each fitting the scenario."""
    if isinstance(effects, Mapping):
        effects = [Present(effect(name), np.array(beta, dtype=np.float64)) for name, beta in effects.items()]
    where = f"scenario {scenario.name}"
    for entry in effects:
        name, stream = entry.effect.name, entry.effect.stream
        place = f"effect {name}"
        if len(entry.beta) != entry.effect.size:
            raise InputError(where, f"{len(entry.beta)} values", f"{entry.effect.size}", place)
        if not np.all(np.isfinite(entry.beta)):
            raise InputError(where, "a value that is not finite", "numbers", place)
        entry.effect.check(entry.beta, where, place)
        if scenario.kind not in entry.effect.kinds:
            kinds = " or ".join(sorted(entry.effect.kinds))
            raise InputError(where, f'kind = "{scenario.kind}"', f"a scenario of kind {kinds}", place)
        if stream != "level" and stream not in scenario.sensors:
            raise InputError(where, f"no sensor `{stream}`", "one of " + ", ".join(scenario.sensors), place)
        if stream == "level" and scenario.turns is not None:
            raise InputError(where, "no multicopter", "a scenario with manoeuvres", place)
        if declare and (entry.effect.is_local or np.isfinite([entry.t0, entry.t1]).any()):
            raise InputError(where, "--declare", "an effect that acts all the time: only these can be declared", place)
    return tuple(effects)


def _with_effects_on_the_vehicle(scenario: Scenario, present: Sequence[Present]) -> Scenario:
    """Drag and wind change the flight itself; a vehicle is made to shake where the effect of vibration is asked for."""
    for entry in present:
        if entry.effect.name == "motion.rotor_drag":
            scenario = scenario.replace(air=replace(scenario.air, drag=float(entry.beta[0])))
        elif entry.effect.name == "motion.wind":
            scenario = scenario.replace(air=replace(scenario.air, wind=(float(entry.beta[0]), float(entry.beta[1]))))
        elif entry.effect.name == "accel.vibration" and not any(scenario.vibration.amplitude):
            scenario = scenario.replace(vibration=replace(scenario.vibration, amplitude=SHAKING))
    return scenario


def _streams(world: World) -> dict[str, Stream]:
    """Every stream of the recording but the camera's."""
    scenario = world.scenario
    streams: dict[str, Stream] = {}
    for name in scenario.sensors:
        if name == "camera":
            continue
        readings = read(world, name)
        columns = dict(zip(columns_of(name, readings.value.shape[1]), readings.value.T, strict=True))
        if scenario.static:
            target = "poses"
        else:
            target = "imu" if name in ON_THE_IMU_CLOCK else name
        if target in streams:
            columns = {**streams[target].columns, **columns}
        stream = Stream(readings.t, {**columns, **_temperature(world, name, readings.t)})
        streams[target] = stream.rows(readings.heard) if target == name else stream
    return streams | _aboard(world)


def _temperature(world: World, name: str, t: FloatArray) -> dict[str, FloatArray]:
    """The thermometer on the chip: of the IMU, of the barometer, and of a magnetometer without an IMU beside it."""
    if sensor(name).thermometer or (name == "mag" and "accel" not in world.scenario.sensors):
        return {"temperature": world.vehicle.temperature(t, name)}
    return {}


def _aboard(world: World) -> dict[str, Stream]:
    """The streams of covariates: power, motors, air."""
    scenario, vehicle = world.scenario, world.vehicle
    if scenario.covariate_rate == 0.0:
        return {}
    t = np.arange(0.0, scenario.duration, 1.0 / scenario.covariate_rate)
    motion = vehicle.trajectory.motion(t)
    aboard = vehicle.aboard(motion)
    streams = {"power": Stream(t, {"current": aboard["current"], "voltage": vehicle.voltage(t)})}
    if isinstance(vehicle.trajectory, Multicopter):
        motors = vehicle.motors(motion)
        streams["motors"] = Stream(t, {f"motor_{i + 1}": motors[:, i] for i in range(motors.shape[1])})
        air = {"airspeed": aboard["airspeed"]}
        if scenario.air.wind_known:
            air |= {"wind_north": aboard["wind"][:, 0], "wind_east": aboard["wind"][:, 1]}
        streams["air"] = Stream(t, {**air, "temperature": np.full(len(t), scenario.warming.ambient)})
    return streams


def _truth(world: World) -> Stream:
    """Truth at every so many instants of the IMU's clock."""
    scenario = world.scenario
    every = 1
    if scenario.truth_rate > 0.0:
        every = max(1, round(len(world.clock) / (scenario.duration * scenario.truth_rate)))
    t = world.clock[::every]
    motion = world.vehicle.trajectory.motion(t)
    columns = {
        **dict(zip(POSITION, motion.p_n.T, strict=True)),
        **dict(zip(VELOCITY, motion.v_n.T, strict=True)),
        **dict(zip(QUATERNION, motion.q_nb.T, strict=True)),
    }
    for name in scenario.sensors:
        if name in BIAS_COLUMNS and model_of(name, scenario.sensors[name]).bias is not None:
            bias = bias_at(world, name, t, asked_by="truth")
            columns |= dict(zip(BIAS_COLUMNS[name], bias.T, strict=True))
        if scenario.sensors[name].scale_std > 0.0:
            scale = scale_of(world, name)
            columns |= {f"scale_{name}_{axis}": np.full(len(t), s) for axis, s in zip("xyz", scale, strict=True)}
    return Stream(t, columns)


def _initial(world: World) -> Initial:
    """The declared first state: the truth at the first IMU sample, off by one draw of its own sigma."""
    if world.scenario.initial is None or world.scenario.kind == "poses":
        return Initial()
    position_std, velocity_std, attitude_std = world.scenario.initial
    rng = world.rng("initial")
    off = rng.standard_normal((3, 3)) * np.array([[position_std], [velocity_std], [attitude_std]])
    first = world.vehicle.trajectory.motion(world.clock[:1])
    return Initial(
        position=first.p_n[0] - off[0],
        velocity=first.v_n[0] - off[1],
        quaternion=quaternion_multiply(first.q_nb[0], quaternion_exp(-off[2])),
        position_std=position_std,
        velocity_std=velocity_std,
        attitude_std=attitude_std,
    )


def _declared(scenario: Scenario, name: str) -> SensorSpec:
    """What the recording declares about a sensor; the place of a base receiver is geodetic where there is an origin."""
    instrument = scenario.sensors[name]
    if name != "base":
        return instrument.spec
    place = np.array(instrument.place)
    if scenario.origin is not None:
        from sinan.sensors.formats.geodetic import geodetic_columns

        place = geodetic_columns(np.asarray(instrument.place, dtype=np.float64)[None, :], scenario.origin)[0]
    return replace(instrument.spec, base_position=place)
