"""A minute of a measured log, with the covariates that the log lacks, and an effect put into its readings.

reading = what was logged + (reading with the effect - plain reading), by the formulas of `blind.maker`: docs/effects.md
written out once more, which share no code with the effects that the tracer knows. The plain reading of accelerometer,
gyroscope and magnetometer is the logged one, that of a range finder too; that of barometer and GPS is along the motion
that the log itself shows. A lateness is put into the stamps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from sinan.calibration.levels.preparation import Prepared, prepared
from sinan.estimator.filter.events import height_of, position_of
from sinan.experiments.blind.maker.catalogue import CATALOGUE, LOCAL_KINDS, Hidden, log_uniform
from sinan.experiments.blind.maker.drawing import draw_warm_up
from sinan.experiments.blind.maker.flight_recording import (
    CURRENT_NOISE,
    IDLE,
    LOAD,
    TEMPERATURE_NOISE,
    draw_payload,
    logged,
)
from sinan.experiments.blind.maker.forward import Seen
from sinan.experiments.blind.maker.measure import DELAYS, FORWARD, local_offset
from sinan.experiments.blind.maker.scene import POWER_EXPONENT
from sinan.experiments.blind.measured.surroundings import Along, along
from sinan.experiments.blind.measured.wander import errors, imu_wander, scatter, wander
from sinan.experiments.measured.minutes import lively_starts
from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, VELOCITY, Recording, Stream
from sinan.sensors.window import between

#: Length of a minute, the step of its possible starts, and what is kept on either side for readings that come late [s].
LENGTH, EVERY, MARGIN = 60.0, 30.0, 5.0
#: Rate of a drawn current [Hz].
POWER_RATE = 50.0
#: Stream and columns of each sensor's reading; GPS as far as it has them.
COLUMNS = {
    "accel": ("imu", ACCEL), "gyro": ("imu", GYRO), "mag": ("mag", MAG), "baro": ("baro", ("height",)),
    "sonar": ("sonar", ("range",)), "laser": ("laser", ("range",)), "gps": ("gps", (*POSITION, *VELOCITY)),
}  # fmt: skip


@dataclass(frozen=True)
class Minute:
    """A minute and what is on either side of it.

    Attributes
    ----------
    recording : with margins and drawn covariates
    begin, end : of the minute [s]
    drawn : covariates that the log has not: current, temperature_imu, temperature_baro
    around : surroundings along the log's own motion
    ready : the recording made ready for the filter
    """

    recording: Recording
    begin: float
    end: float
    drawn: tuple[str, ...]
    around: Along
    ready: Prepared

    @property
    def control(self) -> Recording:
        """The minute with nothing put in."""
        return between(self.recording, self.begin, self.end)

    def columns(self, sensor: str) -> tuple[str, tuple[str, ...]]:
        """Stream and columns of a sensor's reading."""
        stream, names = COLUMNS[sensor]
        return stream, tuple(name for name in names if name in self.recording.streams[stream])

    def reading(self, sensor: str) -> FloatArray:
        """(n, k) what the sensor reported."""
        stream, names = self.columns(sensor)
        return self.recording.streams[stream].array(names)


def rng_of(seed: int, name: str) -> np.random.Generator:
    """The random numbers of a log's minute; they depend on nothing but the seed and the log's name."""
    return np.random.default_rng([seed, crc32(name.encode())])


def minute_of(recording: Recording, rng: np.random.Generator) -> Minute:
    """Draw a lively minute of a log, and the covariates that it lacks."""
    begin = float(rng.choice(lively_starts(recording, LENGTH, EVERY)))
    whole = recording.replace(truth=None)  # nothing is scored, and nothing beside the answer is given away
    part = as_predicted(between(whole, begin - MARGIN, begin + LENGTH + MARGIN))
    part, drawn = with_covariates(part, rng)
    ready = prepared(part)
    end = min(begin + LENGTH, float(part.streams["imu"].t[-1]) + 1e-9)
    return Minute(part, begin, end, drawn, along(part, ready), ready)


def as_predicted(recording: Recording) -> Recording:
    """Readings in the form in which the filter takes them: heights for pressures, north, east, down for degrees."""
    streams = dict(recording.streams)
    if "baro" in streams and "height" not in streams["baro"]:
        streams["baro"] = _with(streams["baro"], height=height_of(recording))
    if "gps" in streams and not streams["gps"].has(POSITION):
        streams["gps"] = _with(streams["gps"], **dict(zip(POSITION, position_of(recording, "gps").T, strict=True)))
    return recording.replace(streams=streams)


def with_covariates(recording: Recording, rng: np.random.Generator) -> tuple[Recording, tuple[str, ...]]:
    """Temperatures and a supply current where the log has none, as the blind maker draws them, and which were drawn.

    The current goes with the thrust, which in flight is the specific force; in the hand nothing goes with it.
    """
    streams, drawn = dict(recording.streams), []
    t0 = streams["imu"].t[0]
    for name in ("imu", "baro"):
        warmth = draw_warm_up(rng)
        if name in streams and "temperature" not in streams[name]:
            values = logged(rng, warmth(streams[name].t - t0), TEMPERATURE_NOISE)
            streams[name] = _with(streams[name], temperature=values)
            drawn.append(f"temperature_{name}")
    draw = draw_current(rng, "gps" in streams)
    if "power" not in streams or "current" not in streams["power"]:
        imu = streams["imu"]
        t = streams["power"].t if "power" in streams else np.arange(t0, imu.t[-1], 1.0 / POWER_RATE)
        force = np.interp(t, imu.t, np.linalg.norm(imu.array(ACCEL), axis=1))
        current = logged(rng, draw(t - t0, force / STANDARD_GRAVITY), CURRENT_NOISE)
        streams["power"] = _with(streams.get("power", Stream(t, {})), current=current)
        drawn.append("current")
    return recording.replace(streams=streams), tuple(drawn)


def draw_current(rng: np.random.Generator, flies: bool) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """(instants, thrust in weights) -> supply current [A], of what else is on board alone where nothing flies."""
    idle, load, payload = float(rng.uniform(*IDLE)), log_uniform(rng, *LOAD), draw_payload(rng)

    def current(t: FloatArray, thrust: FloatArray) -> FloatArray:
        rotors = load * thrust**POWER_EXPONENT if flies else 0.0
        return np.asarray(idle + rotors + payload.derivatives(t, 0)[0])

    return current


def _with(stream: Stream, **columns: FloatArray) -> Stream:
    return Stream(stream.t, {**stream.columns, **columns})


def sensors_of(minute: Minute) -> tuple[str, ...]:
    """The sensors whose reading an effect can be put into; of a scan, which has several, no effect is."""
    streams = minute.recording.streams
    return tuple(
        name for name, (stream, columns) in COLUMNS.items() if stream in streams and columns[0] in streams[stream]
    )


def lasting(minute: Minute) -> tuple[str, ...]:
    """The lasting effects of the catalogue that act on readings of a minute and whose covariates it has."""
    streams, sensors = minute.recording.streams, sensors_of(minute)
    columns = {"motors": ("motors", "motor_1"), "airspeed": ("air", "airspeed"), "current": ("power", "current"),
               "temperature_imu": ("imu", "temperature"), "temperature_baro": ("baro", "temperature")}  # fmt: skip
    lacking = {
        need for need, (stream, column) in columns.items() if stream not in streams or column not in streams[stream]
    }
    return tuple(
        name for name, entry in CATALOGUE.items() if name.split(".")[0] in sensors and not lacking & set(entry.needs)
    )


def local(minute: Minute) -> tuple[str, ...]:
    """The time-localised effects of a minute's streams; single samples of an IMU no filter judges."""
    return tuple(
        f"{sensor}.{kind}" for sensor in sensors_of(minute) for kind in LOCAL_KINDS
        if kind != "outliers" or sensor not in ("accel", "gyro")
    )  # fmt: skip


def put(minute: Minute, hidden: Hidden, rng: np.random.Generator) -> Recording:
    """The minute with an effect in it that it does not declare.

    Parameters
    ----------
    hidden : name, beta and interval; of outliers beta is their share
    rng : of outliers
    """
    name, columns = minute.columns(hidden.stream)
    stream = minute.recording.streams[name]
    if hidden.effect in DELAYS:
        changed = Stream(stream.t + float(hidden.beta[0]), stream.columns)
    else:
        reading = minute.reading(hidden.stream) + added(minute, hidden, rng)
        changed = _with(stream, **dict(zip(columns, reading.T, strict=True)))
    whole = minute.recording.replace(streams={**minute.recording.streams, name: changed})
    return between(whole, minute.begin, minute.end)


def added(minute: Minute, hidden: Hidden, rng: np.random.Generator) -> FloatArray:
    """(n, k) what an effect adds to a sensor's reading."""
    if hidden.effect in LOCAL_KINDS:
        t = minute.recording.streams[minute.columns(hidden.stream)[0]].t
        return local_offset(rng, [hidden], t, scatter(errors_of(minute, hidden.stream)))[0]
    found = FORWARD[hidden.name](hidden.beta, seen_by(minute, hidden.stream))
    if hidden.stream == "gps" and found.shape[1] > 3:  # the position of a fix is of another instant than its velocity
        found[:, :3] += minute.ready.levels.lead * found[:, 3:]
    return found


def instants(minute: Minute, sensor: str) -> FloatArray:
    """(n,) at which a sensor was read: its stamps less how late the log shows them to be [s]; a receiver's velocity."""
    stream = minute.columns(sensor)[0]
    return minute.recording.streams[stream].t - minute.ready.levels.latency.get(stream, 0.0)


def seen_by(minute: Minute, sensor: str) -> Seen:
    """Plain reading of a sensor and what its effects need, at the instants of its readings."""
    t, reading = instants(minute, sensor), minute.reading(sensor)
    body = minute.around.motion(t)
    if sensor in ("sonar", "laser"):  # the ground is where the beam ends
        down = minute.around.ground_down - reading[:, 0] * body.C[:, 2, 2]
        body = replace(body, p=np.column_stack([body.p[:, :2], down]))
    plain = -body.p[:, 2:] if sensor == "baro" else reading
    return Seen(body, minute.around, plain, minute.around.temperature(sensor, t))


def errors_of(minute: Minute, sensor: str) -> FloatArray:
    """(n, k) readings of a sensor less what the perfect one reads along the log's own motion; of an IMU its readings,
    whose steps are all that is asked of them.
    """
    reading = minute.reading(sensor)
    if sensor in ("accel", "gyro"):
        return reading
    return errors(minute.ready.model, minute.around.estimate, sensor, instants(minute, sensor), reading)


def wander_of(minute: Minute, sensor: str, length: float) -> FloatArray:
    """(k,) how far the error of a sensor wanders over so long [s]; of a receiver that of its position."""
    if sensor in ("accel", "gyro"):
        return np.full(3, imu_wander(minute.ready.levels.specs[sensor], length))
    t = minute.recording.streams[minute.columns(sensor)[0]].t
    return wander(t, errors_of(minute, sensor)[:, :3], length)
