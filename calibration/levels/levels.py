"""Sizes of everything that a recording does not tell, and the model of a flight that they make."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as default

import numpy as np

from sinan.calibration.levels.noise_start import aiding_sensors, datum, readings_of, rounding_of
from sinan.calibration.levels.sizes import OF_NO_SENSOR, STAMP_STD, Size
from sinan.calibration.levels.zero_rate import zero_rate_of
from sinan.estimator.filter.events import SAID_OF
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import InStep, LowPass, Stray, Upset
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.recording import NO_HEIGHT, Recording, SensorSpec
from sinan.sensors.registry import height_sensors, sensor, where
from sinan.sensors.zero_rate import ZeroRate

#: Degrees of freedom of the Student law of innovations where no noise is declared: between the 3 of the roughest
#: instruments and the 8 from which on nobody would notice (Lange, Little, Taylor, J. Am. Stat. Assoc. 84(408), 1989).
TAIL = 4.0
#: Share of a range finder's answers that are of something else than the ground, before any is seen: a choice, on which
#: only readings about five sigma off depend. Half and twice move the height of a flight whose laser answers 1.5 m to
#: everything beyond 2.5 m by 0.65 and 0.17 sigma at most (`bounds_of_work beyond`).
STRAY = 0.05
#: Zeros of two height sensors that differ by less are the same [m]: a choice. Half moves the height of a hover whose
#: zeros differ by 0.3 m by 8 cm, twice that of one with 0.7 m by 23 cm, half a sigma (`bounds_of_work zeros`).
SAME_ZERO = 0.5
#: 1-sigma of each element of what a gyroscope's scale and axes err by, a state where nobody declares its noise: a
#: choice, a quarter of the 2 % that a data sheet allows (`effects.gyro_cross_axis`). Half and twice move the sizes of
#: flights without a GPS by 0.10 and 0.09 sigma (`bounds_of_work hand`).
AXES_STD = 0.005
#: The same of the turn of a compass's axes against those of the IMU [rad]: a choice, a tenth of what one is off at most
#: that is aligned by eye (`effects.mag_misalignment`). Half and twice move the sizes of flights without a GPS by 0.03
#: sigma (`bounds_of_work hand`).
TURNED_STD = 0.01


@dataclass(frozen=True)
class Levels:
    """Sizes of everything that is not told, and the model that they make.

    Attributes
    ----------
    specs : by sensor, complete
    in_step : noise of the IMU that goes with the motion
    low_pass : of its samples
    bounds : of the motion, where no position is measured
    m_n, field : (3,) magnetic field and (3, 3) its covariance; None: declared
    iron : (3,) hard iron from which the magnetometer's bias starts; None: zero
    tail, stamp_std, rounding, said, upsets, latency, stray : see `FlightModel`
    lead : how much later than its velocity the position of a fix is [s], see `Gps`; `latency` is the velocity's
    zero_rate : where the body does not turn
    axes_std, turned_std : of the gyroscope's scale and axes, and of the compass's axes against those of the IMU
    own_north : see `FlightModel`
    found : the sizes that the log gave
    covariance : (found, found) of all, each in spreads of its prior
    log_posterior : of the log at these sizes
    in_excerpts : they were sought in excerpts of it at first
    """

    specs: Mapping[str, SensorSpec]
    in_step: InStep
    low_pass: LowPass
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
    covariance: FloatArray | None = None
    log_posterior: float = float("nan")
    in_excerpts: bool = False
    iron: FloatArray | None = None

    @property
    def sigmas(self) -> tuple[float, ...]:
        """1-sigma of each size that was found, in the logarithm; of a time, of itself."""
        if self.covariance is None:
            return ()
        return tuple((np.sqrt(np.diag(self.covariance)) * [size.spread for size in self.found]).tolist())

    @property
    def sigma_of(self) -> dict[tuple[str, str], float]:
        """The same by sensor and key; empty where they are not known."""
        return {(size.sensor, size.key): sigma for size, sigma in zip(self.found, self.sigmas, strict=False)}

    @property
    def lead_sigma(self) -> float:
        """1-sigma of `lead`, the lateness of the velocity less that of the position [s]; 0: neither was sought."""
        signs = {"gps": 1.0, "gps_position": -1.0}
        by = np.array([signs.get(s.key, 0.0) * s.spread if s.sensor == "latency" else 0.0 for s in self.found])
        return 0.0 if self.covariance is None else float(np.sqrt(by @ self.covariance @ by))

    def flight(self, recording: Recording) -> Flight:
        """A recording with the model that these sizes make."""
        return Flight.of(
            recording, specs=self.specs, in_step=self.in_step, low_pass=self.low_pass, bounds=self.bounds,
            magnetic_field=self.m_n, field=self.field, iron=self.iron, tail=self.tail, stray=self.stray,
            stamp_std=self.stamp_std, rounding=self.rounding, said=self.said, upsets=self.upsets, gate_level=None,
            latency=self.latency, lead=self.lead, zero_rate=self.zero_rate, axes_std=self.axes_std,
            turned_std=self.turned_std, own_north=self.own_north,
        )  # fmt: skip

    def with_size(self, size: Size, value: float) -> Levels:
        """With another value of one size; the position's lateness after that of the velocity."""
        if size.sensor == "in_step":
            return replace(self, in_step=replace(self.in_step, **{size.key: value}))
        if size.sensor == "low_pass":
            return replace(self, low_pass=replace(self.low_pass, **{size.key: max(value, 0.0)}))
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
        held = {"in_step": self.in_step, "low_pass": self.low_pass, "bounds": self.bounds}
        holder = held.get(size.sensor) or self.specs[size.sensor]
        return float(getattr(holder, size.key))


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
    bounds = Bounds(1.0, 1.0, height=recording.streams.keys().isdisjoint(height_sensors()))
    is_open = bool(sizes) and has_open_gyro(recording)
    still = zero_rate_of(recording) if is_open else None
    stray = stray_answers(recording, undeclared) | ({} if still is None else {still[0].name: still[1]})
    levels = Levels(
        specs, InStep(), LowPass(), None if "gps" in recording.streams else bounds, m_n, field,
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
