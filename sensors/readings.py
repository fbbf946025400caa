"""One simulated sensor: when it is read, what it reads, and which readings get lost.

reading = predict(motion) + sum over effects (apply - predict) + bias + white noise. Every sensor draws from streams of
random numbers of its own, named after it: adding a sensor changes no other.
"""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect, apply_effects
from sinan.sensors.effects.outliers import draw
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess, random_walk, sample_std
from sinan.sensors.recording import POSITION, VELOCITY
from sinan.sensors.registry import sensor
from sinan.sensors.scenario import Instrument, Scenario
from sinan.sensors.sensor_type import Given
from sinan.sensors.vehicle import Vehicle

#: A grid so fine that what an effect reads between its points (a delay, a lag) is exact to 1e-6 of the signal
FINE_STEP = 1e-3  # s
#: How long before the first reading that grid begins: longer than any plausible lag or delay
LEAD = 5.0  # s
#: Sensors that are read in flight on the clock of the accelerometer
ON_THE_IMU_CLOCK = ("accel", "gyro")


@dataclass(frozen=True)
class Present:
    """An effect that is in the simulated world.

    Attributes
    ----------
    effect : its declaration
    beta : (parameters,) its size
    t0, t1 : the interval in which it acts [s]
    """

    effect: Effect
    beta: FloatArray
    t0: float = -np.inf
    t1: float = np.inf


@dataclass(frozen=True)
class World:
    """What the sensors share.

    Attributes
    ----------
    scenario, vehicle : what is flown
    effects : what the plain models lack
    roots : numbers from which every stream of random numbers begins
    clock : (n,) instants of the IMU, on which every bias walks [s]
    """

    scenario: Scenario
    vehicle: Vehicle
    effects: tuple[Present, ...]
    roots: tuple[int, ...]
    clock: FloatArray

    def rng(self, name: str) -> np.random.Generator:
        """The stream of random numbers of that name."""
        return np.random.default_rng(np.random.SeedSequence([*self.roots, crc32(name.encode())]))

    def on(self, stream: str) -> list[Present]:
        """The effects on one stream."""
        return [present for present in self.effects if present.effect.stream == stream]


@dataclass(frozen=True)
class Readings:
    """Readings of one sensor.

    Attributes
    ----------
    t : (n,) time stamps [s]
    value : (n, size)
    heard : (n,) which of them arrived
    """

    t: FloatArray
    value: FloatArray
    heard: BoolArray


def model_of(name: str, instrument: Instrument) -> SensorModel:
    """The sensor model with the noise that the instrument declares."""
    spec = instrument.spec
    if spec.noise_density is not None and spec.noise_std is None:
        sigma = sample_std(spec.noise_density, instrument.rate)
    else:
        sigma = spec.noise_std or 0.0
    make = sensor(name).make
    if make is None:
        raise ValueError(f"`{name}` cannot be simulated: its declaration has no `make`")
    return make(
        Given(
            sigma=sigma,
            bias_std=spec.bias_std or 0.0,
            bias_walk=spec.bias_walk or 0.0,
            sigma_velocity=(spec.velocity_noise_std or 0.0) if instrument.velocity else None,
            angles=np.zeros(1) if spec.angles is None else spec.angles,
            minimum=instrument.minimum,
            maximum=instrument.maximum,
            beam_angle=instrument.beam_angle,
        )
    )


def columns_of(name: str, size: int) -> tuple[str, ...]:
    """Names of the columns of a reading."""
    return (*POSITION, *VELOCITY)[:size] if sensor(name).velocity else sensor(name).named(size)


def instants(scenario: Scenario, name: str, rng: np.random.Generator) -> FloatArray:
    """(n,) when a sensor is read [s]: an even clock, each instant off by the jitter but in order."""
    instrument = scenario.sensors[name]
    step = 1.0 / instrument.rate
    even = instrument.offset + step * np.arange(
        int(np.ceil((scenario.duration - instrument.offset) * instrument.rate - 1e-9))
    )
    off = np.clip(instrument.jitter * rng.standard_normal(len(even)), -0.45 * step, 0.45 * step)
    off[0] = max(off[0], 0.0) if len(off) else 0.0
    return np.asarray(even + off)


def read(world: World, name: str) -> Readings:
    """All readings of one sensor, with those that do not arrive still among them."""
    scenario, instrument = world.scenario, world.scenario.sensors[name]
    model = model_of(name, instrument)
    if name in ON_THE_IMU_CLOCK:
        t = world.clock
    else:
        t = instants(scenario, name, world.rng(f"{name}.clock"))
    motion, value = perfect(world, name, t, model)
    if name == "accel":
        value = value + world.vehicle.shaking(motion, world.rng("vibration"))
    scale = scale_of(world, name)
    if np.any(scale):
        value = value + scale * model.predict(motion)
    value = value + bias_at(world, sensor(name).block.removeprefix("b_"), t, asked_by=name, size=model.size)
    sigma = np.sqrt(np.diag(model.R))
    value = value + sigma * world.rng(f"{name}.noise").standard_normal((len(t), model.size))
    for present in world.on(name):
        if present.effect.name.endswith(".outliers"):
            wrong = draw(len(t), float(present.beta[0]), sigma, world.rng(f"{name}.outliers"))
            value = value + wrong * _acting(present, t)[:, None]
    if name == "base":
        value = value + np.array(instrument.place)
    return Readings(t, value, _arrives(world, name, motion, model))


def perfect(world: World, name: str, t: FloatArray, model: SensorModel) -> tuple[Motion, FloatArray]:
    """The true motion at the instants t, and the reading with effects but without bias and noise.

    Effects that read the motion at other instants are applied along a grid of `FINE_STEP` that begins `LEAD` earlier.
    """
    present = [p for p in world.on(name) if not p.effect.name.endswith(".outliers")]
    rows: IntArray | slice = slice(None)
    grid = t
    if any(p.effect.other_instants for p in present):
        even = np.arange(t[0] - LEAD, t[-1] + FINE_STEP, FINE_STEP)
        after = np.clip(np.searchsorted(t, even), 1, len(t) - 1)
        apart = np.minimum(np.abs(even - t[after - 1]), np.abs(even - t[after])) > 1e-3 * FINE_STEP
        grid = np.union1d(even[apart], t)
        rows = np.searchsorted(grid, t).astype(np.int64)
    motion = world.vehicle.motion(grid, name)
    plain = model.predict(motion)
    always = [(p.effect, p.beta) for p in present if not np.isfinite([p.t0, p.t1]).any()]
    value = apply_effects(plain, always, motion, model)
    for p in present:
        if np.isfinite([p.t0, p.t1]).any():
            value += np.where(_acting(p, grid)[:, None], p.effect.change(plain, p.beta, motion, model), 0.0)
    return motion.rows(rows), value[rows]


def _acting(present: Present, t: FloatArray) -> BoolArray:
    return np.asarray((t >= present.t0) & (t < present.t1))


def scale_of(world: World, name: str) -> FloatArray:
    """(size,) error of the scale of each axis that the plain model of poses knows; zero in flight."""
    instrument = world.scenario.sensors[name]
    if world.scenario.kind != "poses" or instrument.scale_std == 0.0:
        return np.zeros(1)
    return instrument.scale_std * world.rng(f"{name}.scale").standard_normal(3)


def bias_at(world: World, name: str, t: FloatArray, asked_by: str = "", size: int | None = None) -> FloatArray:
    """(n, size) the bias of a sensor at the instants t.

    It walks over the instants of the IMU and of the sensor itself. At any other instant it is drawn from the walk that
    is tied to its neighbours (Brownian bridge), so that it does not matter who else asks.
    """
    process = model_of(name, world.scenario.sensors[name]).bias if name in world.scenario.sensors else None
    if process is None:
        return np.zeros((len(t), size or 1))
    own = world.clock
    if name not in ON_THE_IMU_CLOCK:
        own = np.union1d(world.clock, instants(world.scenario, name, world.rng(f"{name}.clock")))
    walk = random_walk(own, process, world.rng(f"{name}.bias"))
    value = tied(t, own, walk, process, world.rng(f"{name}.bias.{asked_by}"))
    if process.size == 1 or size is None:
        return value
    return np.pad(value, ((0, 0), (0, size - process.size)))


def tied(
    t: FloatArray, known_t: FloatArray, walk: FloatArray, process: BiasProcess, rng: np.random.Generator
) -> FloatArray:
    """(n, size) the walk at the instants t: as known where it is known, drawn between its neighbours elsewhere."""
    i = np.clip(np.searchsorted(known_t, t, side="right") - 1, 0, len(known_t) - 2)
    before, after = t - known_t[i], known_t[i + 1] - t
    span = before + after
    mean = (walk[i] * after[:, None] + walk[i + 1] * before[:, None]) / span[:, None]
    std = process.walk * np.sqrt(np.maximum(before * after / span, 0.0))
    return np.asarray(mean + std[:, None] * rng.standard_normal(mean.shape))


def lost(world: World, name: str, t: FloatArray) -> BoolArray:
    """(n,) which readings get lost or are in a drop-out."""
    instrument = world.scenario.sensors[name]
    gone = world.rng(f"{name}.loss").random(len(t)) < instrument.loss
    for start, end in instrument.dropouts:
        gone |= (t >= start) & (t < end)
    return np.asarray(gone)


def _arrives(world: World, name: str, motion: Motion, model: SensorModel) -> BoolArray:
    """(n,) which readings arrive: not in a drop-out, not lost, and with an echo, decided on the true range."""
    instrument = world.scenario.sensors[name]
    heard = ~lost(world, name, motion.t)
    returns = sensor(name).heard
    if returns is not None:
        heard &= returns(model, motion, instrument.softness)
    return np.asarray(heard)
