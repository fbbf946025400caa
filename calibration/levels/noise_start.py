"""First guesses of noise levels from the readings alone: still stretches, differences, resolution."""

from __future__ import annotations

import numpy as np

from sinan.calibration.levels.allan import white_density
from sinan.calibration.poses.segments import still_rows
from sinan.estimator.filter.events import gives_place, own_readings, position_of
from sinan.sensors.arrays import FloatArray, runs_of
from sinan.sensors.errors import InputError
from sinan.sensors.last_digit import rounding_variance
from sinan.sensors.recording import ACCEL, GYRO, VELOCITY, Recording, tells_height
from sinan.sensors.registry import height_sensors, sensor, where
from sinan.sensors.rounding import rounding_of_places

#: A still stretch counts when it is at least this long [s]: 50 readings a second tell a
#: sigma to 1 / sqrt(2 * 50) = 10 %.
LEAST_STILL = 1.0
#: Median of the magnitude of a standard normal: the 75 % point, norm.ppf(0.75).
MEDIAN_NORMAL = 0.6745


def aiding_sensors() -> tuple[str, ...]:
    """The sensors whose readings update the filter and whose noise a log shows."""
    return where(lambda entry: entry.columns and entry.make is not None)


def within_imu(recording: Recording) -> Recording:
    """The recording without readings before the first and after the last IMU sample: the filter uses none of them.

    A GPS that was switched on long before, or logged long after, would else give its own flight's noise and datum.

    Raises
    ------
    InputError : a stream with readings, all of them outside
    """
    imu, aiding = recording.streams["imu"], aiding_sensors()
    kept = {}
    for name, stream in recording.streams.items():
        inside = (stream.t >= imu.t[0]) & (stream.t <= imu.t[-1])
        if name in aiding and len(stream) and not np.any(inside):
            found = f"{len(stream)} readings from {stream.t[0]:g} to {stream.t[-1]:g} s"
            expected = f"some within the IMU's time, {imu.t[0]:g} to {imu.t[-1]:g} s: one clock for all streams"
            raise InputError(recording.where, found, expected, f"stream {name}")
        kept[name] = stream if name not in aiding or np.all(inside) else stream.rows(inside)
    if all(kept[name] is stream for name, stream in recording.streams.items()):
        return recording
    return recording.replace(streams=kept)


def imu_density(recording: Recording, names: tuple[str, ...] = ACCEL) -> float:
    """White-noise density [unit/sqrt(Hz)] of a triad of the IMU: the root mean square over its axes.

    From the longest still stretch of the log, else from all of it; then motion and vibration count as noise, and the
    value is an upper bound.
    """
    imu = recording.streams["imu"]
    rate = 1.0 / imu.step
    values = imu.array(names)
    start, stop = longest_still(recording)
    if imu.t[stop - 1] - imu.t[start] >= LEAST_STILL:
        values = values[start:stop]
    density = float(np.sqrt(np.mean([white_density(column, rate) ** 2 for column in values.T])))
    return max(density, float(np.sqrt(np.max(rounding_variance(imu.array(names))) / rate)))


def longest_still(recording: Recording) -> tuple[int, int]:
    """Rows [start, stop) of the longest stretch in which the IMU lies still; one row where it never does."""
    imu = recording.streams["imu"]
    still = still_rows(imu.t, imu.array(ACCEL), imu.array(GYRO))
    return max(runs_of(still), key=lambda run: run[1] - run[0], default=(0, 1))


def reading_noise(values: FloatArray, rounding: FloatArray) -> float:
    """Standard deviation of the white noise of one reading, of the columns together; deaf to smooth motion and jumps.

    Third differences of white noise have 20 times its variance and of a parabola none; their median magnitude does not
    see outliers. Columns whose differences are no larger than rounding makes them say nothing; where all are so, it is
    taken for what the finest rounding makes: a converter's last digit is chosen so. A column that never changes, whose
    rounding is zero, shows no digit either.

    Parameters
    ----------
    values : (n, columns); NaN: no reading
    rounding : (columns,) variance of the error of rounding
    """
    there = np.isfinite(values)
    has = np.any(there, axis=0)
    if np.any(rounding[has] > 0.0):
        has &= rounding > 0.0
    found = np.array([_variance(column[own]) for column, own in zip(values.T[has], there.T[has], strict=True)])
    left = found - rounding[has]
    white = float(np.mean(left[left > 0.0])) if np.any(left > 0.0) else 0.0
    return float(np.sqrt(max(white, np.min(rounding[has]))))


def _variance(values: FloatArray) -> float:
    """Of the white noise of one column, with that of rounding."""
    if len(values) < 8:
        return float(np.var(values))
    third = np.diff(values, n=3) / np.sqrt(20.0)
    spread = float(np.median(np.abs(third))) / MEDIAN_NORMAL
    return (spread if spread > 0.0 else float(np.std(third))) ** 2


def rounding_of(recording: Recording, name: str) -> FloatArray:
    """(m,) variance of the error of rounding of each component of a sensor's readings, of a receiver's velocity too."""
    if not gives_place(name):
        return rounding_variance(readings_of(recording, name))
    stream = recording.streams[name]
    place = rounding_of_places(position_of(recording, name), recording.origin)
    return np.concatenate([place, rounding_variance(stream.array(VELOCITY))]) if stream.has(VELOCITY) else place


def datum(recording: Recording, name: str) -> float:
    """How far the first height of a height sensor is from that of the GPS, else of a sensor that sees the ground [m]:
    their zeros need not agree. 0 where there is neither: then the sensor itself says where the flight begins.

    Neglects the tilt at the first reading, and the climb until the first fix that tells a height.
    """
    seen = [other for other in height_sensors() if other in recording.streams and sensor(other).kernel == "range"]
    gps = recording.streams.get("gps")
    if gps is not None and np.any(told := tells_height(gps)):
        down = float(position_of(recording, "gps")[np.argmax(told), 2])
    elif seen:
        down = _first_down(recording, min(seen, key=lambda other: sensor(other).height_turn))
    else:
        return 0.0
    return abs(_first_down(recording, name) - down)


def _first_down(recording: Recording, name: str) -> float:
    """Position down [m] by the first reading of a height sensor; of a scan by the beam nearest to the vertical."""
    first = float(np.min(readings_of(recording, name)[0]))
    return recording.environment.ground_down - first if sensor(name).kernel == "range" else -first


def readings_of(recording: Recording, name: str, key: str = "noise_std") -> FloatArray:
    """(n, k) the readings of a sensor whose noise a key of its specs is; a barometer's are heights [m]. NaN: the height
    of a fix that tells none.
    """
    entry = sensor(name)
    if key == "velocity_noise_std":
        return recording.streams[name].array(VELOCITY)
    if not entry.columns:
        return recording.streams[entry.stream].array(entry.named(3))
    if not gives_place(name):
        return own_readings(recording, name)
    places = position_of(recording, name).copy()
    places[~tells_height(recording.streams[name]), 2] = np.nan
    return places
