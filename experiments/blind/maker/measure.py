"""From the perfect reading to the reported one: hidden effects, disturbances, bias, noise, and what is rough."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinan.experiments.blind.maker.body import Body
from sinan.experiments.blind.maker.catalogue import LOCAL_KINDS, OUTLIER_SIZE, Hidden
from sinan.experiments.blind.maker.forward import VECTOR_EFFECTS, Seen
from sinan.experiments.blind.maker.forward_heights import HEIGHT_EFFECTS, beam_range
from sinan.experiments.blind.maker.instruments import Instrument, random_walk, white
from sinan.experiments.blind.maker.outside import Outside
from sinan.experiments.blind.maker.rough import Rough, isolated, jittered, markov, outside_gaps
from sinan.experiments.blind.maker.scene import Scene
from sinan.sensors.arrays import BoolArray, FloatArray

FORWARD = {**VECTOR_EFFECTS, **HEIGHT_EFFECTS}
#: Time stamps are written to the microsecond, readings to this many decimals.
STAMP_DECIMALS, READING_DECIMALS = 6, 9
DELAYS = ("time_offset", "latency")


@dataclass(frozen=True)
class Plan:
    """Everything that decides a recording's readings.

    Attributes
    ----------
    scene : what is there
    instruments : as declared
    hidden : effects of the catalogue that the recording does not declare
    outside : a disturbance in nobody's catalogue, or None
    rough : what is rough
    scales : by sensor, (3,) diagonal scale of the accelerometer and the magnetometer of a calibration
    """

    scene: Scene
    instruments: Mapping[str, Instrument]
    hidden: Sequence[Hidden] = ()
    outside: Outside | None = None
    rough: Rough = field(default_factory=Rough)
    scales: Mapping[str, FloatArray] = field(default_factory=dict)

    def of_stream(self, sensor: str) -> list[Hidden]:
        """The hidden effects of one sensor."""
        return [effect for effect in self.hidden if effect.stream == sensor]


@dataclass(frozen=True)
class Reported:
    """One sensor's stream.

    Attributes
    ----------
    t : (n,) time stamps [s]
    reading : (n, k) what is reported
    bias : (n, b) its bias, for the truth
    strength : sum over the rows of the disturbance's variance over that of the noise; 0 where there is none
    wrong : (n, k) by how many sigma readings are off that a hidden effect made wrong, zero in the others
    """

    t: FloatArray
    reading: FloatArray
    bias: FloatArray
    strength: float
    wrong: FloatArray


def stamps(rng: np.random.Generator, scene: Scene, rate: float) -> FloatArray:
    """Regular time stamps with a random phase, within the recording."""
    first = scene.begin + float(rng.uniform(0.02, 0.98)) / rate
    return np.round(np.arange(first, scene.end - 0.02, 1.0 / rate), STAMP_DECIMALS)


def plain_reading(sensor: str, body: Body, scene: Scene, size: int) -> FloatArray:
    """(n, k) the perfect sensor's reading."""
    match sensor:
        case "accel":
            return body.f
        case "gyro":
            return body.w
        case "mag":
            return body.to_body(scene.field_n)
        case "baro":
            return -body.p[:, 2:]
        case "sonar" | "laser":
            return beam_range(body, scene)[:, None]
        case "gps":
            return np.concatenate([body.p, body.v], axis=1)[:, :size]
    raise AssertionError(sensor)


def clean_reading(plan: Plan, sensor: str, instants: FloatArray, size: int, with_outside: bool = True) -> FloatArray:
    """(n, k) the reading at given instants with its effects, without bias and noise."""
    scene = plan.scene
    body = scene.motion(instants)
    warmth = scene.temperature_baro if sensor == "baro" else scene.temperature_imu
    seen = Seen(body, scene, plain_reading(sensor, body, scene, size), warmth(instants))
    reading = seen.plain.copy()
    if sensor in plan.scales:
        reading += plan.scales[sensor] * seen.plain
    for effect in plan.of_stream(sensor):
        if effect.name in FORWARD:
            reading += FORWARD[effect.name](effect.beta, seen)
    if sensor == "accel" and scene.vibration is not None:
        reading += scene.vibration.signal(instants)
    if with_outside and plan.outside is not None and plan.outside.add is not None and sensor in plan.outside.streams:
        reading += plan.outside.add(sensor, seen)
    return reading


def belonging(plan: Plan, sensor: str, t: FloatArray, with_outside: bool = True) -> FloatArray:
    """(n,) the instants that readings stamped t belong to: t - b, and where a clock runs fast."""
    late = sum(float(effect.beta[0]) for effect in plan.of_stream(sensor) if effect.effect in DELAYS)
    instants = t - late
    if with_outside and plan.outside is not None and sensor in plan.outside.streams:
        begin = plan.scene.begin
        instants = begin + (instants - begin) / (1.0 + plan.outside.clock)
    return instants


def local_offset(
    rng: np.random.Generator, hidden: Sequence[Hidden], t: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, k) what steps, transients and outliers of a stream add; of that the outliers. A receiver keeps its
    velocities.
    """
    offset, wrong = np.zeros((len(t), len(sigma))), np.zeros((len(t), len(sigma)))
    for effect in hidden:
        if effect.effect not in LOCAL_KINDS or effect.interval is None:
            continue
        if effect.effect == "outliers":
            wrong += isolated(rng, len(t), float(effect.beta[0]), sigma, OUTLIER_SIZE)
        else:
            begin, end = effect.interval
            inside = (t >= begin) & ((t < end) | (effect.effect == "step"))
            offset[inside, : len(effect.beta)] += effect.beta
    return offset + wrong, wrong


def report(
    rng: np.random.Generator, plan: Plan, sensor: str, t: FloatArray, size: int,
    bias: FloatArray | None = None, clean: Callable[[FloatArray, bool], FloatArray] | None = None,
) -> Reported:  # fmt: skip
    """What a sensor reports at time stamps t.

    Parameters
    ----------
    size : values of one reading
    bias : (n, b) where it is shared with another sensor; drawn here otherwise
    clean : (instants, with the disturbance) -> readings; None: those of `clean_reading`
    """
    instrument, rough = plan.instruments[sensor], plan.rough
    sigma = np.full(size, instrument.noise)
    sigma[3:] = instrument.velocity_noise
    factor = rough.factors.get(sensor, 1.0)
    bias = random_walk(rng, t, instrument, min(size, 3)) if bias is None else bias
    error = white(rng, len(t), factor * sigma)
    error[:, : bias.shape[1]] += bias
    offset, wrong = local_offset(rng, plan.of_stream(sensor), t, sigma)
    error += offset
    error += isolated(rng, len(t), rough.outliers.get(sensor, 0.0), sigma, OUTLIER_SIZE)
    if sensor == "gps" and rough.colour is not None:
        tau, share = rough.colour
        error[:, :3] += markov(rng, t, tau, share * instrument.noise, 3)
    source = clean or (lambda instants, outside: clean_reading(plan, sensor, instants, size, outside))
    reading = source(belonging(plan, sensor, t), True) + error
    strength = 0.0
    if plan.outside is not None and sensor in plan.outside.streams:
        undisturbed = source(belonging(plan, sensor, t, with_outside=False), False) + error
        if plan.outside.distort is not None:
            reading = plan.outside.distort(sensor, t, reading)
        off = (reading - undisturbed) / sigma
        strength = float(np.sum((off - off.mean(axis=0)) ** 2))
    at = jittered(rng, t, rough.jitter[sensor]) if sensor in rough.jitter else t
    keep = outside_gaps(t, rough.gaps.get(sensor, ()))
    stamped, reading = np.round(at[keep], STAMP_DECIMALS), np.round(reading[keep], READING_DECIMALS)
    return Reported(stamped, reading, bias[keep], strength, wrong[keep] / sigma)


def echoes(plan: Plan, t: FloatArray, farthest: float) -> BoolArray:
    """(n,) where the ground is near enough for an echo: decided by the true range, never by the noisy one."""
    body = plan.scene.motion(t)
    return np.asarray(beam_range(body, plan.scene) < farthest)
