"""The sizes that a recording does not declare, with their priors: what a class of instruments is known to do.

reading = truth + bias (random walk) + first-order colour + white noise. The prior of each size is a median, and how far
it is off in the logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.noise_start import imu_density, reading_noise, readings_of, rounding_of
from sinan.estimator.filter.effect_forms import declared_terms
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, VELOCITY, Recording
from sinan.sensors.registry import height_sensors, sensors

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
#: Sizes that are no key of a sensor's specs.
OF_NO_SENSOR = frozenset({"bounds", "in_step", "latency", "low_pass", "stamps"})
#: Lateness of a compass, median and spread [s]: autopilots' filters take 0 (PX4's `EKF2_MAG_DELAY`, which may be 0.3)
#: and 0.06 (ArduPilot's `magDelay_ms`), one spread on either side.
LATE_COMPASS = 0.03, 0.03
#: What the scale, the axes and the lever arm of a consumer accelerometer make of a hand's motion, as white noise
#: [m/s^2/sqrt(Hz)]; where no position is known nothing in the log tells it from the motion. A choice, half and twice of
#: which move the sizes of flights without a GPS by 0.21 and 0.16 sigma (`bounds_of_work hand`).
OF_THE_MOTION = 0.05
#: Median of the white noise that goes with the rate of turn [sqrt(s)], for what scale and axes leave, such as lateness:
#: a choice, half and twice of which move a size by 0.7 and 0.6 sigma (`bounds_of_work sizes`).
TURNING = 0.002
#: What a driver lets through to a log [Hz]: ArduPilot filters accelerometer and gyroscope at 20 (INS_ACCEL_FILTER,
#: INS_GYRO_FILTER, AP_InertialSensor.cpp). A log of less than twice that has faster vibration in its samples (Nyquist).
LET_THROUGH = 20.0
#: Time constant of the low pass of such samples, spread [s]: a choice, the time in which a vehicle changes its force.
#: Half and twice move that of a gyroscope by 0.8 and 1.7 sigma, of an accelerometer by 2.1 and 0.5; where vibration
#: drowns the force it is the longest that is sought with half and with this (docs/notes/noise_levels.md).
PASSED_IN = 1.0


@dataclass(frozen=True)
class Size:
    """A size that nobody declared.

    Attributes
    ----------
    sensor, key : such as ("gps", "colour_std"); of noise in step with the motion ("in_step", "gyro"), of a bound
        ("bounds", "place"), of the jitter of stamps ("stamps", "mag"), of a low pass ("low_pass", "accel")
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
        """Of theta; also of a lateness: what is later is an effect that a trace names. No low pass looks backwards."""
        return (0.0 if self.sensor == "low_pass" else -4.0), 4.0


#: Lateness of a receiver's fixes, of their velocity where they have one, and of their position beside it: median and
#: spread [s]; u-blox receivers are 0.05 to 0.25 s late over a serial line. Position and velocity are of different
#: filters, whose outputs need not be of one age (docs/notes/receiver_latency.md).
LATE_FIX = Size("latency", "gps", 0.1, 0.1, linear=True)
LATE_POSITION = Size("latency", "gps_position", 0.1, 0.1, linear=True)
#: The same where the velocity's lateness is declared: what is left of the position's, which had both spreads.
LEFT_OF_POSITION = replace(LATE_POSITION, median=0.0, spread=float(np.hypot(LATE_FIX.spread, LATE_POSITION.spread)))


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
    is_slow = 1.0 / streams["imu"].step < 2.0 * LET_THROUGH
    for name, columns, other, bias, walk in (
        ("accel", ACCEL, of_motion, 0.05, 1e-3),
        ("gyro", GYRO, 0.0, 0.01, 3e-5),
    ):
        density = float(np.hypot(imu_density(recording, columns), other))
        sizes += [
            Size(name, "noise_density", density, 1.0),
            Size(name, "bias_std", bias, 0.7),
            _walk_of(name, walk, density if is_slow and not unaided and not recording.spec(name).says_noise else walk),
            Size("in_step", name, 1.0 / 6.0, 0.7),
        ]
    sizes.append(Size("in_step", "rate", TURNING, 0.7))
    if is_slow:
        sizes += [Size("low_pass", name, 0.0, PASSED_IN, linear=True) for name in ("accel", "gyro")]
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


def _walk_of(name: str, walk: float, vibration: float) -> Size:
    """The random walk of a bias of the IMU: the median halfway between that of its class and what vibration makes of it
    that looks slow, either within two spreads.

    Parameters
    ----------
    walk, vibration : that of the class, and as much in a second as the mean of white samples is off by then
    """
    most = max(vibration, walk)
    return Size(name, "bias_walk", float(np.sqrt(walk * most)), max(1.0, 0.25 * float(np.log(most / walk))))


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
    if size.sensor in ("low_pass", "stamps"):
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


def is_told_without_position(size: Size) -> bool:
    """Whether a log without position tells a size.

    Its innovations are colour on the scale of the motion, of which the one-step likelihood makes instruments that are
    too good; a time is told by the motion itself, and a height sensor's noise by the sensor. A compass's colour by the
    log is smaller and slower than its prior, and what varies in a room is then named (docs/notes/ablation.md).
    """
    return size.sensor in ("latency", *height_sensors()) or (size.sensor, size.key) == ("mag", "bias_std")
