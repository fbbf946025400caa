"""A flight as a recording: which sensors, how good, what they report, what the header says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import CAMERA, log_uniform
from sinan.experiments.blind.maker.curves import Curve, Sine
from sinan.experiments.blind.maker.drawing import (
    Made,
    Order,
    also_true,
    draw_field,
    draw_hidden,
    draw_outside,
    draw_warm_up,
    with_flight_needs,
)
from sinan.experiments.blind.maker.filming import filmed
from sinan.experiments.blind.maker.flights import STYLES, TILTING, draw_multirotor
from sinan.experiments.blind.maker.geodetic import to_geodetic
from sinan.experiments.blind.maker.instruments import (
    Instrument,
    draw_baro,
    draw_gps,
    draw_imu,
    draw_mag,
    draw_ranger,
    random_walk,
    specs,
)
from sinan.experiments.blind.maker.measure import (
    READING_DECIMALS,
    STAMP_DECIMALS,
    Plan,
    Reported,
    echoes,
    report,
    stamps,
)
from sinan.experiments.blind.maker.rough import Rough, draw_rough
from sinan.experiments.blind.maker.scene import Scene, Vibration
from sinan.experiments.blind.maker.truth import hidden_on_clock, outside_on_clock, truth_stream
from sinan.experiments.blind.maker.turning import exp_rotation, quaternion
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import (
    ACCEL,
    GEODETIC,
    GYRO,
    MAG,
    POSITION,
    VELOCITY,
    Environment,
    Initial,
    Recording,
    SensorSpec,
    Stream,
)

LENGTH = (60.0, 150.0)
#: How often a flight has each sensor, where no effect needs it.
OFTEN: Mapping[str, float] = {"gps": 0.92, "mag": 0.9, "baro": 0.85, "sonar": 0.4, "laser": 0.4, "base": 0.25}
COVARIATES: Mapping[str, float] = {"current": 0.5, "motors": 0.4, "airspeed": 0.35, "temperature_imu": 0.6,
                                   "temperature_baro": 0.5, "vibration": 0.15}  # fmt: skip
#: Farthest echo of a range finder [m], and the least share of the flight within it.
FARTHEST: Mapping[str, float] = {"sonar": 12.0, "laser": 45.0}
ECHO_SHARE = 0.5
#: Supply current without thrust, and that which goes with it [A].
IDLE, LOAD = (0.3, 1.5), (6.0, 25.0)
#: Errors of what is logged beside the sensors.
CURRENT_NOISE, AIRSPEED_NOISE, TEMPERATURE_NOISE = 0.03, 0.05, 0.02


def make_flight(rng: np.random.Generator, order: Order, name: str) -> Made:
    """Draw a flight for an order; with a camera it has a compass and GPS too."""
    filming = order.kind == CAMERA
    needs = with_flight_needs(order) | ({"gps", "mag"} if filming else set())
    has = {what for what, often in {**OFTEN, **COVARIATES}.items() if rng.uniform() < often} | set(needs)
    has |= {"gps"} if "base" in has and "base" in needs else set()
    has -= {"base"} if "gps" not in has else set()
    has |= {"mag", "baro"} if "gps" not in has else set()
    at_rest = bool(rng.uniform() < 0.5)
    scene, style = draw_scene(rng, has, needs, at_rest)
    instruments = draw_instruments(rng, has, style, float(np.linalg.norm(scene.field_n)))
    rough = draw_rough(rng, instruments, scene.begin, scene.end) if order.rough else Rough()
    coarse = scene.motion(np.arange(scene.begin, scene.end, 0.05))
    hidden = draw_hidden(rng, order.names, scene, instruments)
    plan = Plan(scene, instruments, hidden, draw_outside(rng, order, scene, instruments, coarse), rough)
    reported = report_sensors(rng, plan)
    streams = as_streams(rng, reported, plan, has)
    sensors = specs(instruments)
    if "base" in instruments:
        base_position = np.round(rng.normal(0.0, 30.0, 3), 3) * np.array([1.0, 1.0, 0.05])
        streams["base"], sensors["base"] = place_base(streams["base"], sensors["base"], base_position)
    points = None
    if filming:
        streams["camera"], sensors["camera"], points = filmed(rng, plan)
    clock = float(np.round(rng.uniform(0.0, 500.0), STAMP_DECIMALS)) if rng.uniform() < 0.3 else 0.0
    origin = draw_origin(rng)
    if origin is not None:
        streams, sensors = in_geodetic(rng, streams, sensors, origin)
    recording = Recording(
        name=name,
        kind="flight",
        streams={key: later(stream, clock) for key, stream in streams.items()},
        sensors=sensors,
        environment=Environment(scene.gravity, scene.field_n, scene.ground_down),
        initial=draw_initial(rng, scene.motion(np.zeros(1)), at_rest and {"gps", "mag"} <= has),
        origin=origin,
        points=points,
    )
    return Made(
        recording=recording,
        truth=truth_stream(scene, reported, clock),
        hidden=hidden_on_clock(hidden, reported, clock),
        outside=outside_on_clock(plan.outside, clock),
        strength=max((r.strength for r in reported.values()), default=0.0),
        rough=rough,
        also_true=also_true(rough),
        style=style,
    )


def draw_scene(
    rng: np.random.Generator, has: set[str], needs: frozenset[str], at_rest: bool
) -> tuple[Scene, str]:  # fmt: skip
    """A motion with its surroundings; range finders that are not needed are taken out of `has` where none echoes."""
    gravity = float(np.round(rng.uniform(9.78, 9.83), 4))
    length = float(rng.uniform(*LENGTH))
    while True:
        style = str(rng.choice(TILTING if "tilt" in needs else list(STYLES)))
        style = "gusts" if "gps" not in has else style
        low = "low" in needs or rng.uniform() < 0.15
        motion = draw_multirotor(rng, style, length, gravity, low, at_rest)
        scene = Scene(
            motion=motion,
            begin=0.0,
            end=length,
            gravity=gravity,
            field_n=draw_field(rng),
            ground_down=0.0,
            temperature_imu=draw_warm_up(rng),
            temperature_baro=draw_warm_up(rng),
            idle=float(rng.uniform(*IDLE)),
            load=log_uniform(rng, *LOAD),
            payload=draw_payload(rng),
            vibration=draw_vibration(rng, length) if "vibration" in has else None,
        )
        t = np.arange(0.0, length, 0.1)
        seeing = {s: float(np.mean(echoes(Plan(scene, {}), t, FARTHEST[s]))) for s in FARTHEST if s in has}
        near = float(np.min(-motion(t).p[:, 2])) > 0.25
        if near and all(share > ECHO_SHARE for sensor, share in seeing.items() if sensor in needs):
            has -= {sensor for sensor, share in seeing.items() if share <= ECHO_SHARE}
            return scene, style


def draw_instruments(rng: np.random.Generator, has: set[str], style: str, field: float) -> dict[str, Instrument]:
    """Instruments for the sensors of `has`; violent flights have the faster IMUs."""
    rate = float(rng.choice([200.0, 250.0] if style in ("aggressive", "gusts") else [100.0, 125.0, 200.0, 250.0]))
    instruments = draw_imu(rng, rate)
    if "mag" in has:
        instruments["mag"] = draw_mag(rng, field)
    if "baro" in has:
        instruments["baro"] = draw_baro(rng)
    for sensor in ("sonar", "laser"):
        if sensor in has:
            instruments[sensor] = draw_ranger(rng, sensor == "laser")
    if "gps" in has:
        gps = instruments["gps"] = draw_gps(rng)
        if "base" in has:
            instruments["base"] = Instrument(float(rng.choice([1.0, 2.0, 5.0])), gps.noise, 0.0, 0.0)
    return instruments


def report_sensors(rng: np.random.Generator, plan: Plan) -> dict[str, Reported]:
    """Every sensor's stream; a base receiver reads zero plus the bias that it shares with the receiver on board."""
    rate = plan.instruments["accel"].rate
    t_imu = np.round(np.arange(0.0, plan.scene.end, 1.0 / rate), STAMP_DECIMALS)
    reported = {sensor: report(rng, plan, sensor, t_imu, 3) for sensor in ("accel", "gyro")}
    times = {s: stamps(rng, plan.scene, plan.instruments[s].rate) for s in plan.instruments if s not in reported}
    shared = shared_bias(rng, plan, times)
    for sensor, t in times.items():
        if sensor in FARTHEST:
            t = t[echoes(plan, t, FARTHEST[sensor])]
        size = {"mag": 3, "base": 3, "gps": 6 if plan.instruments[sensor].velocity_noise > 0.0 else 3}.get(sensor, 1)
        clean = (lambda instants, _: np.zeros((len(instants), 3))) if sensor == "base" else None
        reported[sensor] = report(rng, plan, sensor, t, size, shared.get(sensor), clean)
    return reported


def shared_bias(rng: np.random.Generator, plan: Plan, times: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """One random walk for the receiver on board and the base, at the stamps of each."""
    both = [sensor for sensor in ("gps", "base") if sensor in times]
    if not both:
        return {}
    t = np.unique(np.concatenate([times[sensor] for sensor in both]))
    walk = random_walk(rng, t, plan.instruments["gps"], 3)
    return {sensor: walk[np.searchsorted(t, times[sensor])] for sensor in both}


def as_streams(
    rng: np.random.Generator, reported: Mapping[str, Reported], plan: Plan, has: set[str]
) -> dict[str, Stream]:
    """Columns as the format names them, with temperatures and what is logged beside the sensors."""
    imu = columns([*ACCEL, *GYRO], np.concatenate([reported["accel"].reading, reported["gyro"].reading], axis=1))
    scene, t_imu = plan.scene, reported["accel"].t
    if "temperature_imu" in has:
        imu["temperature"] = logged(rng, scene.temperature_imu(t_imu), TEMPERATURE_NOISE)
    streams = {"imu": Stream(t_imu, imu)}
    for sensor, names in {"mag": MAG, "baro": ("height",), "sonar": ("range",), "laser": ("range",),
                          "gps": (*POSITION, *VELOCITY), "base": POSITION}.items():  # fmt: skip
        if sensor in reported:
            found = reported[sensor]
            streams[sensor] = Stream(found.t, columns(names[: found.reading.shape[1]], found.reading))
    if "temperature_baro" in has and "baro" in streams:
        t = streams["baro"].t
        warmth = logged(rng, scene.temperature_baro(t), TEMPERATURE_NOISE)
        streams["baro"] = Stream(t, {**streams["baro"].columns, "temperature": warmth})
    return {**streams, **covariate_streams(rng, scene, has)}


def covariate_streams(rng: np.random.Generator, scene: Scene, has: set[str]) -> dict[str, Stream]:
    """Supply current, throttles and airspeed."""
    streams = {}
    grid = {what: np.round(np.arange(0.0, scene.end, 1.0 / rate), STAMP_DECIMALS)
            for what, rate in {"power": 50.0, "motors": 50.0, "air": 25.0}.items()}  # fmt: skip
    if "current" in has:
        current = logged(rng, scene.current(scene.motion(grid["power"])), CURRENT_NOISE)
        voltage = np.round(16.4 - 0.02 * current - 4e-3 * grid["power"], 4)
        streams["power"] = Stream(grid["power"], {"current": current, "voltage": voltage})
    if "motors" in has:
        throttle = np.round(scene.throttle(scene.motion(grid["motors"])), 6)
        streams["motors"] = Stream(grid["motors"], columns([f"motor_{k}" for k in range(1, 5)], throttle))
    if "airspeed" in has:
        body = scene.motion(grid["air"])
        air = {"airspeed": np.abs(logged(rng, body.airspeed, AIRSPEED_NOISE))}
        if rng.uniform() < 0.5:
            air |= columns(["wind_north", "wind_east"], np.round(body.wind[:, :2], 6))
        streams["air"] = Stream(grid["air"], air)
    return streams


def draw_initial(rng: np.random.Generator, first: Body, may_be_missing: bool) -> Initial:
    """Mean and 1-sigma of the first state: the mean is off by what the sigma says; some recordings give none."""
    given = rng.uniform()
    if may_be_missing and given < 0.4:
        return Initial()
    stds = (log_uniform(rng, 0.1, 2.0), log_uniform(rng, 0.03, 0.4), log_uniform(rng, 5e-3, 0.05))
    tilted = first.C @ exp_rotation(stds[2] * rng.normal(size=(1, 3)))
    return Initial(
        position=first.p[0] + stds[0] * rng.normal(size=3),
        velocity=first.v[0] + stds[1] * rng.normal(size=3),
        quaternion=None if may_be_missing and given < 0.6 else quaternion(tilted)[0],
        position_std=stds[0],
        velocity_std=stds[1],
        attitude_std=None if may_be_missing and given < 0.6 else stds[2],
    )


def draw_payload(rng: np.random.Generator) -> Curve:
    """Servos, radio and camera: slow swings of an ampere or so."""
    swings = [
        Sine(float(rng.uniform(0.1, 1.0)), 2.0 * np.pi * log_uniform(rng, 0.01, 0.6), float(rng.uniform(0.0, 6.28)))
        for _ in range(3)
    ]
    return Curve(3.0, swings)


def draw_vibration(rng: np.random.Generator, length: float) -> Vibration:
    """An airframe that shakes more at some times than at others; tones of 40 to 48 Hz, seen by every IMU rate."""
    swing = float(rng.uniform(0.5, 4.0))
    level = Curve(swing * float(rng.uniform(1.05, 1.5)),
                  [Sine(0.5 * swing, 2.0 * np.pi * log_uniform(rng, 0.01, 0.08), float(rng.uniform(0.0, 6.28)))
                   for _ in range(2)])  # fmt: skip
    drift = Curve(0.0, [Sine(float(rng.uniform(2.0, 6.0)), 2.0 * np.pi * 0.2, float(rng.uniform(0.0, 6.28)))])
    return Vibration(level, rng.uniform(0.3, 1.0, size=3), 2.0 * np.pi * rng.uniform(40.0, 48.0, size=3), drift)


def draw_origin(rng: np.random.Generator) -> tuple[float, float, float] | None:
    """Half the recordings say where on the Earth they were made."""
    if rng.uniform() < 0.5:
        return None
    return (
        float(np.round(rng.uniform(-60.0, 65.0), 7)),
        float(np.round(rng.uniform(-180.0, 180.0), 7)),
        float(np.round(rng.uniform(0.0, 800.0), 3)),
    )


def place_base(stream: Stream, spec: SensorSpec, at: FloatArray) -> tuple[Stream, SensorSpec]:
    """A base at a known place: its readings are about that place."""
    moved = np.round(stream.array(POSITION) + at, READING_DECIMALS)
    return Stream(stream.t, columns(POSITION, moved)), replace(spec, base_position=at)


def in_geodetic(
    rng: np.random.Generator, streams: dict[str, Stream], sensors: dict[str, SensorSpec],
    origin: tuple[float, float, float],
) -> tuple[dict[str, Stream], dict[str, SensorSpec]]:  # fmt: skip
    """With an origin the base's place is geodetic, and of every third recording the positions are too."""
    place = sensors["base"].base_position if "base" in sensors else None
    if place is not None:
        sensors = {**sensors, "base": replace(sensors["base"], base_position=to_geodetic(place[None], origin)[0])}
    if rng.uniform() < 1.0 / 3.0:
        for name in ("gps", "base"):
            if name in streams:
                rest = {key: value for key, value in streams[name].columns.items() if key not in POSITION}
                lla = to_geodetic(streams[name].array(POSITION), origin)
                streams[name] = Stream(streams[name].t, {**columns(GEODETIC, lla), **rest})
    return streams, sensors


def columns(names: object, values: FloatArray) -> dict[str, FloatArray]:
    """Named columns of an array (n, k)."""
    return dict(zip(list(names), values.T, strict=True))  # type: ignore[call-overload]


def logged(rng: np.random.Generator, values: FloatArray, noise: float) -> FloatArray:
    """What a logger writes of a covariate."""
    return np.asarray(np.round(values + noise * rng.normal(size=len(values)), 4))


def later(stream: Stream, clock: float) -> Stream:
    """The same on a clock that began earlier."""
    return Stream(np.round(stream.t + clock, STAMP_DECIMALS), stream.columns)
