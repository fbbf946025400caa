"""Everything about a flight that its recording does not declare, as parameters with priors: the likeliest of them.

reading = truth + bias (random walk) + first-order colour + white noise. What a class of instruments is known to do is
the prior of each size: a median, and how far it is off in the logarithm. The log-likelihood of the filter's innovations
and the priors together are maximised, with the exact gradient of `estimator.evidence.level_scores`. What is declared
stays.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as default
from itertools import product

import numpy as np

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.heading import beside_iron, with_heading
from sinan.calibration.levels.noise_start import (
    aiding_sensors,
    datum,
    imu_density,
    reading_noise,
    readings_of,
    rounding_of,
)
from sinan.calibration.levels.zero_rate import zero_rate_of
from sinan.estimator.evidence.level_scores import LevelScores, level_scores
from sinan.estimator.filter.alignment import ALIGNING, first_state
from sinan.estimator.filter.effect_forms import declared_terms
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import SAID_OF, stamp_variances, white_shares
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import InStep, Stray, Upset
from sinan.estimator.filter.imu import in_step_accel, in_step_gyro
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.tails import log_density
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, NO_HEIGHT, VELOCITY, Recording, SensorSpec
from sinan.sensors.registry import height_sensors, sensor, sensors, where
from sinan.sensors.zero_rate import ZeroRate

#: Degrees of freedom of the Student law of innovations where no noise is declared: between the 3 of the roughest
#: instruments and the 8 from which on nobody would notice (Lange, Little, Taylor, J. Am. Stat. Assoc. 84(408), 1989).
TAIL = 4.0
#: Share of a range finder's answers that are of something else than the ground, before any is seen: a choice, on which
#: only readings about five sigma off depend. Half and twice move the height of a flight whose laser answers 1.5 m to
#: everything beyond 2.5 m by 0.65 and 0.17 sigma at most (`bounds_of_work beyond`).
STRAY = 0.05
#: How far the stamps of a magnetometer are off those of the gyroscope, one by one [s], median of the prior: it is read
#: from a register that is written some 100 times a second, so that a reading may be 1 / 100 s old.
STAMP_STD = 0.01


#: Hard iron that a calibration which was accepted leaves, as a part of the Earth's field: ArduPilot accepts one whose
#: residual is 16 milligauss RMS (AP_COMPASS_CALIBRATION_FITNESS_DEFAULT, AP_Compass.h), of a field of 490.
CALIBRATED = 16.0 / 490.0
#: Hard iron of a compass that was never calibrated: two sigma are offsets of 600 milligauss, beyond which ArduPilot
#: would not fly (AP_ARMING_COMPASS_OFFSETS_MAX, AP_Arming.cpp); how large it is in a log its likelihood says, to a
#: factor of sixteen.
AS_IT_COMES = 300.0 / 490.0
#: Noise below this, in SI units, is that of numbers which no sensor gave: numbers of about 1 are rounded to
#: 2^-53 = 1e-16.
NO_NOISE = 1e-15
#: Iterations of the search at most, what one gains at least of log L, and a round of it: bound of work
#: (`bounds_of_work sizes`). Half of the first moves a size by 0.3 sigma, half of the second by 0.12.
MOST, GAINED, SETTLED = 20, 0.05, 1.0
#: Sizes that are no key of a sensor's specs.
OF_NO_SENSOR = frozenset({"bounds", "in_step", "latency", "stamps"})
#: Zeros of two height sensors that differ by less are the same [m]: a choice. Half moves the height of a hover whose
#: zeros differ by 0.3 m by 8 cm, twice that of one with 0.7 m by 23 cm, half a sigma (`bounds_of_work zeros`).
SAME_ZERO = 0.5
#: First step of the search for a lateness, in its spread, and how often one step of the IMU is halved at most, where
#: what a log tells is finer: bound of work (`bounds_of_work sizes`).
FIRST_MOVE, HALVED = 0.5, 6
#: Rounds of times and sizes: bound of work (`bounds_of_work sizes`).
ROUNDS = 6
#: The same in the whole of a long log, from where its excerpts left them: bound of work (`bounds_of_work long`).
SETTLING = 2
#: Lateness of a compass, median and spread [s]: autopilots' filters take 0 (PX4's `EKF2_MAG_DELAY`, which may be 0.3)
#: and 0.06 (ArduPilot's `magDelay_ms`), one spread on either side.
LATE_COMPASS = 0.03, 0.03
#: Parts of a log whose gradients show how well it tells the sizes, three for each of up to twenty: bound of work
#: (`bounds_of_work sizes`). Half and twice move a size by 0.06 and 0.11 of its sigma.
PARTS = 64


@dataclass(frozen=True)
class Size:
    """A size that nobody declared.

    Attributes
    ----------
    sensor, key : such as ("gps", "colour_std"); of noise in step with the motion ("in_step", "gyro"), of a bound
        ("bounds", "place"), of the jitter of stamps ("stamps", "mag")
    median : of the prior
    spread : standard deviation of its logarithm in the prior; of a time ("latency", "gps") of itself
    linear : it is a time, not a size
    """

    sensor: str
    key: str
    median: float
    spread: float
    linear: bool = False

    def at(self, theta: float) -> float:
        """The size at so many spreads from its median."""
        return self.median + self.spread * theta if self.linear else self.median * float(np.exp(self.spread * theta))

    def theta(self, value: float) -> float:
        """So many spreads from the median is a size, within the bounds."""
        off = value - self.median if self.linear else float(np.log(value / self.median))
        return float(np.clip(off / self.spread, *self.bounds))

    @property
    def is_of_position(self) -> bool:
        """Whether it is the lateness of a fix's position beside its velocity."""
        return (self.sensor, self.key) == ("latency", "gps_position")

    @property
    def bounds(self) -> tuple[float, float]:
        """Of theta; also of a lateness: what is later is an effect that a trace names."""
        return -4.0, 4.0


#: Lateness of a receiver's fixes, of their velocity where they have one, and of their position beside it: median and
#: spread [s]; u-blox receivers are 0.05 to 0.25 s late over a serial line. Position and velocity are of different
#: filters, whose outputs need not be of one age (docs/notes/receiver_latency.md).
LATE_FIX = Size("latency", "gps", 0.1, 0.1, linear=True)
LATE_POSITION = Size("latency", "gps_position", 0.1, 0.1, linear=True)
#: The same where the velocity's lateness is declared: what is left of the position's, which had both spreads.
LEFT_OF_POSITION = replace(LATE_POSITION, median=0.0, spread=float(np.hypot(LATE_FIX.spread, LATE_POSITION.spread)))


@dataclass(frozen=True)
class Levels:
    """Sizes of everything that is not told, and the model that they make.

    Attributes
    ----------
    specs : by sensor, complete
    in_step : noise of the IMU that goes with the motion
    bounds : of the motion, where no position is measured
    m_n, field : (3,) magnetic field and (3, 3) its covariance; None: declared
    iron : (3,) hard iron from which the magnetometer's bias starts; None: zero
    tail, stamp_std, rounding, said, upsets, latency, stray : see `FlightModel`
    lead : how much later than its velocity the position of a fix is [s], see `Gps`; `latency` is the velocity's
    zero_rate : where the body does not turn
    axes_std, turned_std : of the gyroscope's scale and axes, and of the compass's axes against those of the IMU
    own_north : see `FlightModel`
    found : the sizes that the log gave
    sigmas : 1-sigma of each, in the logarithm; of a time, of itself
    log_posterior : of the log at these sizes
    in_excerpts : they were sought in excerpts of it at first
    """

    specs: Mapping[str, SensorSpec]
    in_step: InStep
    bounds: Bounds | None
    m_n: FloatArray | None
    field: FloatArray | None
    tail: float | None
    stamp_std: float
    rounding: Mapping[str, FloatArray]
    said: Mapping[str, float]
    upsets: tuple[Upset, ...] = ()
    latency: Mapping[str, float] = default(default_factory=dict)
    lead: float = 0.0
    stray: Mapping[str, Stray] = default(default_factory=dict)
    zero_rate: ZeroRate | None = None
    axes_std: float = 0.0
    turned_std: float = 0.0
    own_north: bool = False
    found: tuple[Size, ...] = ()
    sigmas: tuple[float, ...] = ()
    log_posterior: float = float("nan")
    in_excerpts: bool = False
    iron: FloatArray | None = None

    def flight(self, recording: Recording) -> Flight:
        """A recording with the model that these sizes make."""
        return Flight.of(
            recording, specs=self.specs, in_step=self.in_step, bounds=self.bounds, magnetic_field=self.m_n,
            field=self.field, iron=self.iron, tail=self.tail, stray=self.stray, stamp_std=self.stamp_std,
            rounding=self.rounding, said=self.said, upsets=self.upsets, gate_level=None, latency=self.latency,
            lead=self.lead, zero_rate=self.zero_rate, axes_std=self.axes_std, turned_std=self.turned_std,
            own_north=self.own_north,
        )  # fmt: skip

    def with_size(self, size: Size, value: float) -> Levels:
        """With another value of one size; the position's lateness after that of the velocity."""
        if size.sensor == "in_step":
            return replace(self, in_step=replace(self.in_step, **{size.key: value}))
        if size.sensor == "stamps":
            return replace(self, stamp_std=value)
        if size.is_of_position:
            return replace(self, lead=self.latency.get("gps", 0.0) - value)
        if size.sensor == "latency":
            return replace(self, latency={**self.latency, size.key: value})
        if size.sensor == "bounds":
            assert self.bounds is not None
            return replace(self, bounds=replace(self.bounds, **{size.key: value}))  # type: ignore[arg-type]
        spec = replace(self.specs[size.sensor], **{size.key: value})  # type: ignore[arg-type]
        return replace(self, specs={**self.specs, size.sensor: spec})

    def value(self, size: Size) -> float:
        """Of one size."""
        if size.sensor == "stamps":
            return self.stamp_std
        if size.is_of_position:
            return self.latency.get("gps", 0.0) - self.lead
        if size.sensor == "latency":
            return self.latency[size.key]
        holder = {"in_step": self.in_step, "bounds": self.bounds}.get(size.sensor) or self.specs[size.sensor]
        return float(getattr(holder, size.key))


#: What the scale, the axes and the lever arm of a consumer accelerometer make of a hand's motion, as white noise
#: [m/s^2/sqrt(Hz)]; where no position is known nothing in the log tells it from the motion. A choice, half and twice of
#: which move the sizes of flights without a GPS by 0.21 and 0.16 sigma (`bounds_of_work hand`).
OF_THE_MOTION = 0.05
#: 1-sigma of each element of what a gyroscope's scale and axes err by, a state where nobody declares its noise: a
#: choice, a quarter of the 2 % that a data sheet allows (`effects.gyro_cross_axis`). Half and twice move the sizes of
#: flights without a GPS by 0.10 and 0.09 sigma (`bounds_of_work hand`).
AXES_STD = 0.005
#: The same of the turn of a compass's axes against those of the IMU [rad]: a choice, a tenth of what one is off at most
#: that is aligned by eye (`effects.mag_misalignment`). Half and twice move the sizes of flights without a GPS by 0.03
#: sigma (`bounds_of_work hand`).
TURNED_STD = 0.01
#: Median of the white noise that goes with the rate of turn [sqrt(s)], for what scale and axes leave, such as lateness:
#: a choice, half and twice of which move a size by 0.7 and 0.6 sigma (`bounds_of_work sizes`).
TURNING = 0.002


@dataclass(frozen=True, eq=False)
class Iron:
    """The hard iron of a compass, as it is believed before its sizes are sought.

    Attributes
    ----------
    left : median of the prior of what `taken` leaves, as a part of the field
    taken : (3,) that the bias starts from, which is no part of the field's norm; None: zero
    """

    left: float = CALIBRATED
    taken: FloatArray | None = None

    def norm(self, recording: Recording) -> float:
        """Of the field, as the readings have it."""
        m = recording.streams["mag"].array(MAG) - (0.0 if self.taken is None else self.taken)
        return float(np.median(np.linalg.norm(m, axis=1)))


#: Of a compass that was calibrated.
LITTLE = Iron()


def sizes_of(recording: Recording, iron: Iron = LITTLE) -> list[Size]:
    """The sizes that the recording does not declare, with their priors."""
    streams = recording.streams
    sizes: list[Size] = []
    unaided = 0.0 if "gps" in streams else 1.0
    of_motion = unaided * OF_THE_MOTION
    for name, columns, other, bias, walk in (
        ("accel", ACCEL, of_motion, 0.05, 1e-3),
        ("gyro", GYRO, 0.0, 0.01, 3e-5),
    ):
        density = float(np.hypot(imu_density(recording, columns), other))
        sizes += [
            Size(name, "noise_density", density, 1.0),
            Size(name, "bias_std", bias, 0.7),
            Size(name, "bias_walk", walk, 1.0),
            Size("in_step", name, 1.0 / 6.0, 0.7),
        ]
    sizes.append(Size("in_step", "rate", TURNING, 0.7))
    if "mag" in streams:
        norm = iron.norm(recording)
        sizes += [
            Size("mag", "noise_std", max(_white(recording, "mag"), (0.065 if unaided else 0.01) * norm), 1.0),
            Size("mag", "colour_std", 0.045 * norm, 0.7),
            Size("mag", "colour_time", 3.0, 0.7),
            Size("mag", "bias_std", iron.left * norm, 0.7),
            Size("stamps", "mag", STAMP_STD, 1.0),
            Size("latency", "mag", *LATE_COMPASS, linear=True),
        ]
    for entry in sensors():
        if entry.levels and entry.name in streams:
            sizes += [Size(entry.name, "noise_std", _white(recording, entry.name), 1.0)]
            sizes += [Size(entry.name, *level) for level in entry.levels]
    if "gps" in streams:
        sizes += [Size("gps", "noise_std", _white(recording, "gps"), 1.0)]
        if streams["gps"].has(VELOCITY):
            sizes += [Size("gps", "velocity_noise_std", _white(recording, "gps", "velocity_noise_std"), 1.0)]
        sizes += slow_error_of_gps(recording)
        sizes += [Size("gps", "bias_walk", 0.05, 1.0), LATE_FIX]
        if streams["gps"].has(VELOCITY):
            sizes.append(LEFT_OF_POSITION if _is_declared_late(recording, "gps") else LATE_POSITION)
    else:
        sizes += [Size("bounds", "place", 0.5, 1.0), Size("bounds", "speed", 1.0, 1.0)]
    return [size for size in sizes if not _declared(recording, size)]


def slow_error_of_gps(recording: Recording) -> list[Size]:
    """What a receiver's positions and velocities err by for seconds: reflections, and its own filter."""
    white = _white(recording, "gps")
    sizes = [Size("gps", "colour_std", max(0.2, 2.0 * white), 1.5), Size("gps", "colour_time", 2.0, 1.0)]
    if recording.streams["gps"].has(VELOCITY):
        white = _white(recording, "gps", "velocity_noise_std")
        sizes += [Size("gps", "velocity_colour_std", max(0.1, 2.0 * white), 1.5)]
    return sizes


def _white(recording: Recording, name: str, key: str = "noise_std") -> float:
    """White noise of one reading of a sensor, from the readings alone.

    Raises
    ------
    InputError : it is not declared, and nothing shows it
    """
    values = readings_of(recording, name, key)
    rounding = rounding_of(recording, name)
    noise = reading_noise(values, rounding[3:] if key == "velocity_noise_std" else rounding[: values.shape[1]])
    if noise < NO_NOISE and getattr(recording.spec(name), key) is None:
        found = "1 reading" if len(values) == 1 else f"{len(values)} readings without any noise"
        wanted = f"{key} declared, or readings to find it in"
        raise InputError(recording.where, f"{found} and no {key}", wanted, f"sensor {name}")
    return noise


def _declared(recording: Recording, size: Size) -> bool:
    """Whether the recording says the size, or says white noise alone."""
    if size.sensor == "in_step":
        return recording.spec("gyro" if size.key == "rate" else size.key).says_noise
    if size.sensor == "bounds":
        return False
    if size.sensor == "stamps":
        return recording.spec(size.key).says_noise
    if size.sensor == "latency":
        if size.is_of_position:
            return recording.spec("gps").says_noise
        return recording.spec(size.key).says_noise or _is_declared_late(recording, size.key)
    spec = recording.spec(size.sensor)
    if size.key in ("noise_density", "colour_std", "colour_time", "velocity_colour_std"):
        return spec.says_noise
    return getattr(spec, size.key) is not None


def _is_declared_late(recording: Recording, stream: str) -> bool:
    """Whether the recording declares an effect that is the lateness of a stream."""
    return bool(declared_terms(recording).of_stream(stream, lateness=True))


def first_levels(
    recording: Recording,
    sizes: Sequence[Size],
    m_n: FloatArray | None,
    field: FloatArray | None,
    imu_samples: str = "instant",
) -> Levels:
    """All sizes at the medians of their priors; `imu_samples` as in `SensorSpec`, where the recording has no other."""
    specs = {name: recording.spec(name) for name in where(lambda entry: entry.make is not None)}
    if imu_samples != "instant":
        specs["accel"] = replace(specs["accel"], imu_samples=imu_samples)
    undeclared = {size.sensor for size in sizes} - OF_NO_SENSOR
    if "gps" in recording.streams and specs["gps"].bias_std is None:
        specs["gps"] = replace(specs["gps"], bias_std=sensor("gps").believed_bias)
    for name in height_sensors():
        if name in recording.streams and specs[name].bias_std is None and name in undeclared:
            std = float(np.hypot(sensor(name).believed_bias, datum(recording, name)))
            walk = specs[name].bias_walk or 0.0
            specs[name] = replace(specs[name], bias_std=std if std > SAME_ZERO else 0.0, bias_walk=walk)
    if "mag" in recording.streams and specs["mag"].bias_walk is None:
        specs["mag"] = replace(specs["mag"], bias_walk=0.0)
    bounds = Bounds(1.0, 1.0, height={"baro", "sonar", "laser"}.isdisjoint(recording.streams))
    is_open = bool(sizes) and has_open_gyro(recording)
    still = zero_rate_of(recording) if is_open else None
    stray = stray_answers(recording, undeclared) | ({} if still is None else {still[0].name: still[1]})
    levels = Levels(
        specs, InStep(), None if "gps" in recording.streams else bounds, m_n, field,
        TAIL if undeclared else None, STAMP_STD if "mag" in undeclared else 0.0,
        {name: rounding_of(recording, name) for name in aiding_sensors() if name in undeclared},
        _said_of_most(recording, sizes), stray=stray, zero_rate=None if still is None else still[0],
        axes_std=AXES_STD if is_open else 0.0,
        turned_std=TURNED_STD if is_open and "mag" in recording.streams else 0.0,
        own_north=has_its_own_north(recording),
    )  # fmt: skip
    for size in sizes:
        levels = levels.with_size(size, size.median)
    return levels


def has_open_gyro(recording: Recording) -> bool:
    """Whether nobody declares the gyroscope's noise."""
    return not recording.spec("gyro").says_noise


def has_its_own_north(recording: Recording) -> bool:
    """Whether nothing but a compass in an unknown field tells a direction: no place, no fixes, nothing that is seen."""
    initial, blind = recording.initial, where(lambda entry: entry.kernel in ("", "field", "height", "range"))
    told = (initial.quaternion, initial.position, initial.velocity, recording.environment.magnetic_field)
    seen = {name for name in recording.streams if name in where(lambda entry: True)} - set(blind)
    return not seen and recording.origin is None and all(one is None for one in told)


def stray_answers(recording: Recording, sensors: Collection[str]) -> dict[str, Stray]:
    """What the range finders among some sensors answer besides, up to the farthest of their answers in the log."""
    finders = where(lambda entry: entry.kernel == "range")
    seen = [name for name in finders if name in recording.streams and name in sensors]
    return {name: Stray(STRAY, float(np.max(readings_of(recording, name)))) for name in seen}


def _said_of_most(recording: Recording, sizes: Sequence[Size]) -> dict[str, float]:
    """What a receiver says of its fixes, by column the median of those of which it says anything, where white noise of
    their components is sought.
    """
    sought, found = {size.key for size in sizes if size.sensor == "gps"}, {}
    for column in SAID_OF:
        if ("velocity_noise_std" if column == "s_variance" else "noise_std") in sought:
            said = recording.streams["gps"].columns.get(column, np.zeros(0))
            said = said[(said > 0.0) & (said < NO_HEIGHT)]
            if len(said):
                found[column] = float(np.median(said))
    return found


class Problem:
    """Log-posterior over theta: (log value - log median) / spread of each size."""

    def __init__(self, recording: Recording, sizes: Sequence[Size], first: Levels) -> None:
        self.recording, self.sizes, self.first = recording, tuple(sizes), first
        self._step = float(np.median(np.diff(recording.streams["imu"].t)))
        self._readings = Readings.of(first.flight(recording))

    def heard_in(self, excerpts: Sequence[Recording]) -> Problem:
        """The same sizes, sought in excerpts of the recording; in the whole, where there is one, or no state follows
        from the readings of one.
        """
        try:
            return self if len(excerpts) == 1 else _InExcerpts(self, excerpts)
        except InputError:
            return self

    def levels(self, theta: FloatArray) -> Levels:
        """Sizes at theta."""
        levels = self.first
        for size, x in zip(self.sizes, theta, strict=True):
            levels = levels.with_size(size, size.at(float(x)))
        return levels

    def inputs(self, levels: Levels) -> RunInputs:
        """What the filter runs on."""
        return self._readings.inputs(levels.flight(self.recording))

    def value(self, theta: FloatArray) -> float:
        """Log-posterior by a forward pass alone; of what cannot be, minus infinity."""
        try:
            journal = run(self.inputs(self.levels(theta)), "numba", 0)
        except InputError:
            return -np.inf
        return journal.log_likelihood - 0.5 * float(theta @ theta)

    def value_and_gradient(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log-posterior and its gradient, of which times have no part."""
        value, each = self._of_parts(theta, times=False)
        return value, np.sum(each, axis=0) - theta

    def _of_parts(self, theta: FloatArray, parts: int = 0, times: bool = True) -> tuple[float, FloatArray]:
        """Log-posterior, and (parts, sizes) the gradients of log L of so many parts, 0: as few as there are."""
        levels = self.levels(theta)
        inputs = self.inputs(levels)
        scores = level_scores(inputs, max(2, len(inputs.imu) // parts) if parts else None)
        here = densities(inputs, scores)
        value = float(np.sum(here)) - 0.5 * float(theta @ theta)
        return value, self._slopes(theta, levels, inputs, scores, here, times)

    def _slopes(
        self, theta: FloatArray, levels: Levels, inputs: RunInputs, scores: LevelScores, here: FloatArray, times: bool
    ) -> FloatArray:
        """(parts, sizes) gradient of the log-likelihood of each part; by a time over one step of the IMU to each side,
        or left out.
        """
        found = np.zeros((len(scores.first_reading), len(self.sizes)))
        for i, size in enumerate(self.sizes):
            if size.linear:
                if times:
                    step = self._step / size.spread
                    later, sooner = (self._gained(theta, i, move, inputs, here, scores) for move in (step, -step))
                    found[:, i] = (later - sooner) / (2.0 * step)
            else:
                found[:, i] = size.spread * slopes(inputs, scores, levels, size)
        return found

    def _gained(
        self, theta: FloatArray, i: int, step: float, inputs: RunInputs, here: FloatArray, scores: LevelScores
    ) -> FloatArray:
        """(parts,) what log L of each part gains by a step of one theta; readings of two streams may change places."""
        moved, gained = theta.copy(), np.zeros(len(here))
        moved[i] += step
        other = run(self.inputs(self.levels(moved)), "numba", 0)
        mine, its = (np.lexsort((one.index, one.sensor)) for one in (inputs.events, other))
        both = other.accepted[its] & (here[mine] != 0.0)  # not what is before the start in one of them
        gained[mine] = np.where(both, other.log_density[its] - here[mine], 0.0)
        return sums_from(gained, scores.first_reading)

    def timed(self, theta: FloatArray, *, far: bool) -> FloatArray:
        """Theta with the likeliest lateness of each stream.

        Where its readings lie between two samples of the IMU makes log L go up and down by tens, with the IMU's step
        for a period: a comb, in which a slope leads to the next tooth. So steps are compared, whole ones from long to
        short where it may be far off; else one, then halves of it, until a step is no longer than a sigma.
        """
        for i, size in enumerate(self.sizes):
            if size.linear:
                theta = self._timed(theta, i, size, far)
        return theta

    def _timed(self, theta: FloatArray, i: int, size: Size, far: bool) -> FloatArray:
        """Theta with the likeliest lateness of one stream."""
        seen: dict[float, float] = {}

        def at(x: float) -> FloatArray:
            moved = theta.copy()
            moved[i] = x
            return moved

        def value(x: float) -> float:
            if x not in seen:
                seen[x] = self.value(at(x)) if size.bounds[0] <= x <= size.bounds[1] else -np.inf
            return seen[x]

        unit, best = self._step / size.spread, float(theta[i])
        whole = max(1, round(FIRST_MOVE * size.spread / self._step))
        moves = [whole >> k for k in range(whole.bit_length())] if far else [0.5**k for k in range(HALVED + 1)]
        for move in moves:
            step = move * unit
            while (near := max(best + step, best - step, key=value)) != best and value(near) > value(best):
                best = near
            if not far and 2.0 * value(best) - value(best + step) - value(best - step) <= 1.0:
                break  # minus the second difference is (step / sigma)^2
        return at(best)

    def sigmas(self, theta: FloatArray) -> FloatArray:
        """(sizes,) 1-sigma of theta about its likeliest value, 1 being that of the prior."""
        return np.sqrt(np.diag(np.linalg.inv(self._information(theta)[1])))

    def _information(self, theta: FloatArray, times: bool = True) -> tuple[float, FloatArray]:
        """Log-posterior, and (sizes, sizes) the information of log and prior.

        That of the log is the scatter of its parts' gradients (Berndt, Hall, Hall, Hausman, Ann. Econ. Soc. Meas. 3(4),
        1974), to which the prior adds one. Neglects that the gradients of neighbouring parts go together.
        """
        value, each = self._of_parts(theta, PARTS, times)
        each -= np.mean(each, axis=0)
        return value, each.T @ each + np.eye(len(theta))

    def maximise(self, theta: FloatArray) -> tuple[FloatArray, float]:
        """Times as they are, all else by quasi-Newton, in units of what the log tells; the best point that was seen."""
        from scipy.optimize import minimize

        best: list[object] = [-np.inf, theta]
        free = np.array([not size.linear for size in self.sizes])
        first, information = self._information(theta, times=False)
        unit = np.diag(information)[free] ** -0.5

        def negative(x: FloatArray) -> tuple[float, FloatArray]:
            whole = theta.copy()
            whole[free] = unit * x
            try:
                value, gradient = self.value_and_gradient(whole)
            except InputError:
                return 1e12, np.zeros(len(x))
            if value > best[0]:  # type: ignore[operator]
                best[:] = [value, whole]
            return -value, -unit * gradient[free]

        bounds = np.array([size.bounds for size in self.sizes])[free] / unit[:, None]
        options = {"maxiter": MOST, "maxfun": 2 * MOST, "ftol": GAINED / max(1.0, abs(first))}
        minimize(negative, theta[free] / unit, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return best[1], float(best[0])  # type: ignore[return-value, arg-type]

    def settled(self, levels: Levels) -> Levels:
        """The likeliest levels near some that were found in excerpts, by few turns of times and all else."""
        if not self.sizes:
            return levels
        found = self.found(*self.likeliest(self.theta(levels), turns=SETTLING, far=False))
        return replace(found, in_excerpts=True)

    def theta(self, levels: Levels) -> FloatArray:
        """Where the sizes of some levels are, within the bounds."""
        return np.array([size.theta(levels.value(size)) for size in self.sizes])

    def found(self, theta: FloatArray, value: float) -> Levels:
        """The levels at the likeliest theta."""
        sigmas = (float(s) * size.spread for s, size in zip(self.sigmas(theta), self.sizes, strict=True))
        return replace(self.levels(theta), found=self.sizes, sigmas=tuple(sigmas), log_posterior=value)

    def likeliest(self, theta: FloatArray, turns: int | None = None, far: bool = True) -> tuple[FloatArray, float]:
        """Times and all else in turns, until one turn of both gains nothing; times at first may be far off."""
        value = -np.inf
        for turn in range(ROUNDS if turns is None else turns):
            before = value
            theta, value = self.maximise(self.timed(theta, far=far and turn == 0))
            if turn and value < before + SETTLED:
                break
        return theta, value


class _InExcerpts(Problem):
    """The sizes of a recording by excerpts of it, each with a first state of its own.

    The prior of a size counts once. Neglects that their biases are one: each counts as often as there are excerpts.
    """

    def __init__(self, whole: Problem, excerpts: Sequence[Recording]) -> None:
        self.recording, self.sizes, self.first, self._step = whole.recording, whole.sizes, whole.first, whole._step
        self._each = [self._begun(one) for one in excerpts]

    def _begun(self, excerpt: Recording) -> Problem:
        """The problem of one excerpt alone, with a first heading of its own."""
        first = self.first
        samples = first.specs["accel"].imu_samples
        own = replace(first_levels(excerpt, self.sizes, first.m_n, first.field, samples), iron=first.iron)
        return Problem(beside_iron(own.flight(with_heading(excerpt, own.specs))), self.sizes, own)

    def value(self, theta: FloatArray) -> float:
        return sum(one.value(theta) for one in self._each) + self._counted_again(theta)

    def _of_parts(self, theta: FloatArray, parts: int = 0, times: bool = True) -> tuple[float, FloatArray]:
        found = [one._of_parts(theta, parts // len(self._each), times) for one in self._each]
        value = sum(of_one for of_one, _ in found) + self._counted_again(theta)
        return value, np.concatenate([each for _, each in found])

    def _counted_again(self, theta: FloatArray) -> float:
        """What takes the prior back that every excerpt has counted, but once."""
        return 0.5 * (len(self._each) - 1) * float(theta @ theta)


def densities(inputs: RunInputs, scores: LevelScores) -> FloatArray:
    """(K,) log density of each innovation by the law that the model gives it; 0 where the reading was not used."""
    events = inputs.events
    used = scores.loglik != 0.0
    m = events.freedom[used]
    found = np.zeros(len(events))
    found[used] = log_density(
        inputs.model, events.sensors, events.sensor[used], m, scores.loglik[used], scores.nis[used]
    )
    return found


def sums_from(values: FloatArray, first: IntArray) -> FloatArray:
    """Sums of what begins at each of `first` and ends before the next; 0 of a part that is empty."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.diff(total[np.append(first, len(values))])


_ROWS = {"noise_std": slice(0, 3), "velocity_noise_std": slice(3, 6)}


def slopes(inputs: RunInputs, scores: LevelScores, levels: Levels, size: Size) -> FloatArray:
    """(parts,) d log L / d log of a size, of the readings of each part; what the first state says is the first's."""
    model, imu, events = inputs.model, inputs.imu, inputs.events
    layout, first = model.layout, scores.first_interval
    if size.sensor in ("accel", "gyro") and size.key == "noise_density":
        q, by = (imu.q_accel, scores.q_accel) if size.sensor == "accel" else (imu.q_gyro, scores.q_gyro)
        return 2.0 * sums_from(by * np.minimum(levels.value(size) ** 2, q), first)
    if size.sensor == "in_step":
        u, only = imu.u, InStep(**{size.key: levels.value(size)})
        if size.key == "accel":
            return sums_from(scores.q_accel * in_step_accel(imu.t, u, only), first)
        factor = 2.0 if size.key == "rate" else 1.0
        return factor * sums_from(scores.q_gyro * in_step_gyro(imu.t, u, only), first)
    if size.sensor in ("bounds", "stamps") or size.key in _ROWS:
        name = size.sensor if size.key in _ROWS else size.key
        if name not in events.sensors:
            return np.zeros(len(first))
        k = np.flatnonzero(events.sensor == events.sensors.index(name))
        width = model.sensors[name].size
        columns = np.arange(width)[_ROWS.get(size.key, slice(None))] if name == "gps" else np.arange(width)
        if size.sensor == "stamps":
            grown = stamp_variances(inputs.flight)[:, None]
        else:
            grown = levels.value(size) ** 2 * white_shares(inputs.flight, name)[:, columns]
        of_reading = np.zeros(len(events))
        of_reading[k] = np.sum(grown[events.index[k]] * scores.r[events.row[k][:, None] + columns], axis=1)
        found = 2.0 * sums_from(of_reading, scores.first_reading)
        if name == "gps":  # of whose first fix the first state is
            found[0] += _slope_of_start(inputs, scores, levels, size)
        return found
    if size.key == "colour_time":
        blocks = [block for block in (f"c_{size.sensor}", f"c_{size.sensor}_velocity") if layout.has(block)]
        each = [np.sum(scores.time_of_part[:, layout.slice(block)], axis=1) for block in blocks]
        return np.sum(each, axis=0) if each else np.zeros(len(first))
    kinds = {"colour_std": "c_", "velocity_colour_std": "c_", "bias_std": "b_", "bias_walk": "b_"}
    block = kinds[size.key] + size.sensor
    block += "_velocity" if size.key == "velocity_colour_std" else ""
    if not layout.has(block):
        return np.zeros(len(first))
    walks = 2.0 * np.sum(scores.bias_of_part[:, layout.slice(block)], axis=1) if size.key != "bias_std" else 0.0
    start = 0.0 if size.key == "bias_walk" else _slope_of_start(inputs, scores, levels, size, layout.slice(block))
    return walks + np.eye(len(first))[0] * start


def _slope_of_start(
    inputs: RunInputs, scores: LevelScores, levels: Levels, size: Size, block: slice | None = None
) -> float:
    """What the first state and its covariance contribute: by the block itself, where there is one and the first
    attitude is not found from the sensor, else by a difference.
    """
    if block is not None and size.sensor not in ALIGNING:
        return 2.0 * levels.value(size) ** 2 * float(np.trace(scores.start[block, block]))
    other = levels.with_size(size, levels.value(size) * 1.01).flight(inputs.recording)
    x, P = first_state(other)
    moved = inputs.model.layout.difference(x, inputs.x)
    return float((np.sum((P - inputs.P) * scores.start) + moved @ scores.start_x) / np.log(1.01))


def fit_levels(
    recording: Recording,
    m_n: FloatArray | None = None,
    field: FloatArray | None = None,
    iron: Iron = LITTLE,
    imu_samples: str = "instant",
) -> Levels:
    """The likeliest sizes of what a flight does not declare; see `problem_of`."""
    return likeliest(problem_of(recording, m_n, field, iron, imu_samples))


def problem_of(
    recording: Recording,
    m_n: FloatArray | None = None,
    field: FloatArray | None = None,
    iron: Iron = LITTLE,
    imu_samples: str = "instant",
) -> Problem:
    """The sizes of what a flight does not declare, to be sought.

    Parameters
    ----------
    m_n, field : (3,), (3, 3) magnetic field and its covariance, where the recording declares none
    iron, imu_samples : see `Iron`, `first_levels`
    """
    sizes = sizes_of(recording, iron)
    first = replace(first_levels(recording, sizes, m_n, field, imu_samples), iron=iron.taken)
    if "gps" not in recording.streams:
        first = widest_bounds_needed(recording, first)
        sizes = [size for size in sizes if is_told_without_position(size)]
    return Problem(recording, sizes, first)


def likeliest(problem: Problem, near: Levels | None = None) -> Levels:
    """The likeliest sizes of a problem, sought from those of `near` on; default: the medians."""
    if not problem.sizes:
        return problem.first
    return _likeliest(problem, np.zeros(len(problem.sizes)) if near is None else problem.theta(near))


#: How far declared white noise of a receiver is off, in the logarithm: a choice, 1.6 times as much at one sigma. Half
#: calls white noise slow that is 8 times as declared, twice calls none (`bounds_of_work slow`).
AS_DECLARED = 0.5
#: A slow error that is tried first, its size over the white noise and its time constant [s]: bound of work
#: (`bounds_of_work slow`).
TRIED = tuple(product((0.3, 1.0), (3.0, 10.0)))
_WHITE_OF = {"colour_std": "noise_std", "velocity_colour_std": "velocity_noise_std"}


def with_slow_gps(recording: Recording) -> Levels:
    """The levels of a recording that declares its noise, and what its receiver errs by for seconds besides, or its
    white noise as the log has it: the likeliest of the three; before the log they are as likely.

    The evidence of sizes is Laplace's, which neglects how they go together.
    """
    plain = first_levels(recording, (), None, None)
    slow = [replace(s, median=5.0) if s.key == "colour_time" else s for s in slow_error_of_gps(recording)]
    gps = plain.specs["gps"]
    keys = [_WHITE_OF[s.key] for s in slow if s.key in _WHITE_OF]
    white = [Size("gps", key, getattr(gps, key), AS_DECLARED) for key in keys if getattr(gps, key)]
    first = plain
    for size in slow:
        first = first.with_size(size, size.median)
    problem = Problem(recording, [*slow, *white], first)

    def theta(share: float, time: float) -> FloatArray:
        values = [
            time if s.key == "colour_time" else share * (getattr(gps, _WHITE_OF[s.key]) or s.median) for s in slow
        ]
        sought = [np.log(value / s.median) / s.spread for value, s in zip(values, slow, strict=True)]
        return np.array([*sought, *(0.0 for _ in white)])

    _, _, start = max((problem.value(tried), k, tried) for k, tried in enumerate(theta(*one) for one in TRIED))
    without = Problem(recording, (), plain).value(np.zeros(0))
    found = [(without, plain)]
    for one, begin in ((Problem(recording, white, plain), np.zeros(len(white))), (problem, start)):
        levels = _likeliest(one, begin)
        found.append((_evidence(levels), levels))
    return max(found, key=lambda one: one[0])[1]


def _evidence(levels: Levels) -> float:
    """Logarithm of the probability of the log, the sizes that were found integrated over."""
    narrower = (np.log(sigma / size.spread) for sigma, size in zip(levels.sigmas, levels.found, strict=True))
    return levels.log_posterior + float(sum(narrower))


def _likeliest(problem: Problem, start: FloatArray) -> Levels:
    """The likeliest sizes of a problem, the others as they are at first."""
    return problem.found(*problem.likeliest(start))


#: Bounds that are tried, those of a hand, a swing or a robot arm, and so many times as wide: a choice. Of half and
#: twice a hover takes the narrowest, a figure of eight 7.5 and 10 m for 5 m (`bounds_of_work hand`).
HAND, WIDER = Bounds(0.5, 1.0), (1.0, 3.0, 10.0, 30.0, 100.0)


def widest_bounds_needed(recording: Recording, levels: Levels) -> Levels:
    """With the likeliest of the bounds on place and speed: each alone may be so wide that it says nothing."""
    tried = []
    readings = Readings.of(levels.flight(recording))
    for place in WIDER:
        for speed in WIDER[:3]:
            assert levels.bounds is not None
            bounds = replace(levels.bounds, place=HAND.place * place, speed=HAND.speed * speed)
            one = replace(levels, bounds=bounds)
            tried.append((run(readings.inputs(one.flight(recording)), "numba", 0).log_likelihood, one))
    return max(tried, key=lambda pair: pair[0])[1]


def is_told_without_position(size: Size) -> bool:
    """Whether a log without position tells a size.

    Its innovations are colour on the scale of the motion, of which the one-step likelihood makes instruments that are
    too good; a time is told by the motion itself, and a height sensor's noise by the sensor. A compass's colour by the
    log is smaller and slower than its prior, and what varies in a room is then named (docs/notes/ablation.md).
    """
    return size.sensor in ("latency", *height_sensors()) or (size.sensor, size.key) == ("mag", "bias_std")
