"""What the effects need besides the motion, taken from a recording's streams at given instants."""

from __future__ import annotations

import numpy as np

from sensors.arrays import FloatArray
from sensors.recording import Recording, Stream

#: Where the temperature of a sensor's own element is, in order of preference.
_TEMPERATURE = {
    "accel": ("imu", "poses"),
    "gyro": ("imu", "poses"),
    "mag": ("mag", "imu", "poses"),
    "baro": ("baro",),
    "sonar": ("air",),
    "laser": (),
}


def covariates_for(recording: Recording, sensor: str, t: FloatArray) -> dict[str, FloatArray]:
    """The covariates of one sensor's readings, by the names of `sensors.motion.Motion`.

    Linear in between, the last value beyond the ends of a stream. `temperature` is that of the sensor's own stream (a
    magnetometer without one takes the IMU's), `current` the supply current, `throttle` the mean motor command,
    `airspeed` and `wind` what the air stream has. Poses have them as columns of their own.

    Parameters
    ----------
    sensor : accel, gyro, mag, baro, sonar, laser, gps
    t : (n,) s

    Returns
    -------
    (n,) each; `wind` (n, 2)
    """
    found: dict[str, FloatArray] = {}
    for name in _TEMPERATURE.get(sensor, ()):
        stream = recording.streams.get(name)
        if stream is not None and "temperature" in stream:
            found["temperature"] = np.interp(t, stream.t, stream["temperature"])
            break
    poses = recording.streams.get("poses")
    for name, stream in (("current", recording.streams.get("power")), ("airspeed", recording.streams.get("air"))):
        for source in (stream, poses):
            if source is not None and name in source and name not in found:
                found[name] = np.interp(t, source.t, source[name])
    air = recording.streams.get("air")
    if air is not None and air.has(("wind_north", "wind_east")):
        found["wind"] = np.stack([np.interp(t, air.t, air[c]) for c in ("wind_north", "wind_east")], axis=-1)
    motors = recording.streams.get("motors")
    if motors is not None:
        found["throttle"] = np.interp(t, motors.t, mean_throttle(motors))
    return found


def mean_throttle(motors: Stream) -> FloatArray:
    """(n,) mean of the motor commands, 0 to 1."""
    columns = [motors[name] for name in motors.columns if name.startswith("motor_")]
    return np.asarray(np.mean(columns, axis=0))
