"""What is drawn alike for every kind of recording: field, temperatures, hidden effects, disturbances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import (
    CAMERA,
    CATALOGUE,
    FLIGHT,
    LOCAL_KINDS,
    Hidden,
    draw_beta,
    draw_interval,
    draw_local,
    draw_names,
    log_uniform,
)
from sinan.experiments.blind.maker.curves import Curve, Sine
from sinan.experiments.blind.maker.instruments import Instrument
from sinan.experiments.blind.maker.outside import DRAWERS, NEEDS, Outside, Setting
from sinan.experiments.blind.maker.rough import Rough
from sinan.experiments.blind.maker.scene import Scene, WarmUp
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import Recording, Stream

CLASSES = ("none", "one", "several", "outside")


@dataclass(frozen=True)
class Order:
    """What is asked of a recording.

    Attributes
    ----------
    kind : one of `catalogue.KINDS`
    sensor : that a calibration is of; empty for flights
    names : effects to hide
    outside : a disturbance in nobody's catalogue to add, by its place in `DRAWERS[kind]`, or None
    rough : a rough world
    """

    kind: str
    sensor: str
    names: tuple[str, ...]
    outside: int | None
    rough: bool

    @property
    def outside_needs(self) -> str:
        """The sensor that the disturbance needs; empty where every recording has it."""
        return "" if self.outside is None else NEEDS.get(DRAWERS[self.kind][self.outside].__name__, "")


@dataclass(frozen=True)
class Made:
    """A recording with its sealed answer.

    Attributes
    ----------
    recording : what may be seen
    truth : the streams of `truth.csv`; None where there is no motion to know
    hidden : effects, with what `beta` they have; intervals on the recording's clock
    outside : disturbance, and its strength
    rough : what was rough
    also_true : names that would be true besides, such as outliers in a rough world
    style : of the motion
    """

    recording: Recording
    truth: Stream | None
    hidden: tuple[Hidden, ...]
    outside: Outside | None
    strength: float
    rough: Rough
    also_true: tuple[str, ...]
    style: str


def draw_order(rng: np.random.Generator, kind: str, what: str, rough: bool) -> Order:
    """An order of a class of `CLASSES`; two and three effects are equally likely in "several"."""
    sensor = {"accel_poses": "accel", "mag_poses": "mag"}.get(kind, "")
    if kind == "gyro_turns":
        sensor = "gyro" if rng.uniform() < 0.75 else "accel"
    if what == "outside":
        sensor = "gyro" if kind == "gyro_turns" else sensor
        return Order(kind, sensor, (), int(rng.integers(len(DRAWERS[kind]))), rough)
    count = {"none": 0, "one": 1, "several": int(rng.integers(2, 4))}[what]
    return Order(kind, sensor, draw_names(rng, kind, count, sensor, not rough), None, rough)


def draw_field(rng: np.random.Generator) -> FloatArray:
    """(3,) NED: any inclination at which a compass is of use, in a unit-norm field, microtesla or gauss."""
    unit = float(rng.choice([1.0, 1.0, 1.0, 48.0, 0.48])) * float(rng.uniform(0.95, 1.1))
    inclination = float(rng.uniform(-1.2, 1.2))
    declination = float(rng.uniform(-0.4, 0.4))
    level = np.array([np.cos(declination), np.sin(declination)]) * np.cos(inclination)
    return unit * np.array([*level, np.sin(inclination)])


def draw_warm_up(rng: np.random.Generator) -> WarmUp:
    """From a cold or a hot day; some instruments were switched on long before."""
    swing = [Sine(float(rng.uniform(0.1, 1.0)), 2.0 * np.pi * log_uniform(rng, 0.005, 0.03), float(rng.uniform(0, 6)))]
    return WarmUp(
        ambient=float(rng.uniform(5.0, 32.0)),
        rise=float(rng.uniform(5.0, 22.0)),
        before=log_uniform(rng, 1.0, 60.0),
        tau=log_uniform(rng, 20.0, 90.0),
        swing=Curve(sines=swing),
    )


def constant_temperature(rng: np.random.Generator) -> WarmUp:
    """A room's temperature."""
    return WarmUp(float(rng.uniform(18.0, 28.0)), 0.0, 0.0, 1.0, Curve())


def draw_hidden(
    rng: np.random.Generator, names: Sequence[str], scene: Scene, instruments: Mapping[str, Instrument],
    poses: bool = False,
) -> tuple[Hidden, ...]:  # fmt: skip
    """Parameters and intervals for names."""
    field_norm = float(np.linalg.norm(scene.field_n))
    found = []
    for name in names:
        stream, effect = name.split(".")
        if name in CATALOGUE:
            found.append(Hidden(name, draw_beta(rng, name, field_norm)))
        else:
            assert effect in LOCAL_KINDS
            beta = draw_local(rng, stream, effect, instruments[stream].noise, poses)
            found.append(Hidden(name, beta, draw_interval(rng, effect, scene.begin, scene.end, poses)))
    return tuple(found)


def draw_outside(
    rng: np.random.Generator, order: Order, scene: Scene, instruments: Mapping[str, Instrument], coarse: Body
) -> Outside | None:
    """The disturbance of an order."""
    if order.outside is None:
        return None
    return DRAWERS[order.kind][order.outside](rng, Setting(scene, instruments, coarse))


def also_true(rough: Rough) -> tuple[str, ...]:
    """What a tracer may name in a rough world without being wrong."""
    return tuple(f"{sensor}.outliers" for sensor, share in rough.outliers.items() if share > 0.0)


def with_flight_needs(order: Order) -> frozenset[str]:
    """Covariates and sensors that an order's effects and disturbance need."""
    from sinan.experiments.blind.maker.catalogue import needed

    extra = {order.outside_needs} - {""} if order.kind in (FLIGHT, CAMERA) else set()
    return needed(order.names) | extra
