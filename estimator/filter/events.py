"""All readings of a recording in the order of time, as flat arrays for the engines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sinan.estimator.filter.faults import Note, frozen_runs, saturated_runs
from sinan.estimator.filter.flight import Flight
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.atmosphere import height_from_pressure
from sinan.sensors.bounds import ASSUMED, RATE
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, NO_HEIGHT, POSITION, VELOCITY, Recording, Stream, tells_height
from sinan.sensors.registry import is_sensor, sensor

#: What became of a reading.
ACCEPTED, GATED, OUTSIDE, NO_PREDICTION, FAULTY, WITHHELD = 0, 1, 2, 3, 4, 5
STATUS = ("accepted", "gated", "outside the IMU's time", "no prediction", "faulty", "withheld")


def is_form_only(name: str) -> bool:
    """Whether the engines have no equations of a sensor: its readings enter as forms that replace the prediction."""
    return is_sensor(name) and sensor(name).kernel == "form"


@dataclass(frozen=True)
class StreamForm:
    """How effects change the predicted reading of one stream, along a reference motion.

    z_pred = h(x) + offset + D (x (-) x_ref):  exact in beta, first order in the distance from the reference.

    Attributes
    ----------
    offset : (k, m) reading with the effects less the plain one, along the reference
    D : (k, m, 9) its derivative by position, velocity and attitude error
    ref : (k, 10) position, velocity and quaternion of the reference
    replaces : offset and D are the whole reading, but for the bias, not what is added to h(x)
    """

    offset: FloatArray
    D: FloatArray
    ref: FloatArray
    replaces: bool = False


@dataclass(frozen=True)
class Events:
    """Readings in time order.

    Attributes
    ----------
    sensors : names; `sensor` is the index
    t : (K,) s, when the reading was valid (latency taken off)
    sensor : (K,)
    index : (K,) row in the stream
    row : (K + 1,) first component in `z`
    z : (rows,) readings, less the offsets of effects
    r : (rows,) variance of the white noise of each component
    status : (K,) what is known before the filter runs
    D, ref : (rows, 9), (K, 10) of `StreamForm`; one row of zeros where no stream has a form
    has_form : (sensors,) 1: a form is added, 2: it replaces the model's own prediction
    notes : frozen stretches, readings outside the IMU's time
    """

    sensors: tuple[str, ...]
    t: FloatArray
    sensor: IntArray
    index: IntArray
    row: IntArray
    z: FloatArray
    r: FloatArray
    status: IntArray
    D: FloatArray
    ref: FloatArray
    has_form: IntArray
    notes: tuple[Note, ...]

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def freedom(self) -> IntArray:
        """(K,) components of each reading that tell something: not the height of a fix in two dimensions."""
        found = np.diff(self.row)
        if "gps" in self.sensors:
            fixes = np.flatnonzero(self.sensor == self.sensors.index("gps"))
            rows = self.row[fixes][:, None] + np.arange(np.max(found[fixes], initial=0))
            found[fixes] = np.sum(self.r[rows] < NO_HEIGHT**2, axis=1)
        return found


def readings(flight: Flight, name: str) -> tuple[FloatArray, FloatArray]:
    """Readings (k, m) of one sensor and the instants (k,) at which they were valid [s].

    Raises
    ------
    InputError : a column that the sensor needs is not there
    """
    recording, t = flight.recording, stamps(flight, name)
    if name == "level":
        return window_means(flight, recording.streams["imu"].array(ACCEL)), t
    if name in ("place", "speed"):
        return np.zeros((len(t), 3)), t
    if name == "zero_rate":
        imu = recording.streams["imu"]
        return flight.model.rest.means(imu.t, imu.array(GYRO)), t
    stream, size = recording.streams[name], flight.model.sensors[name].size
    if name == "camera":
        return stream.array(("u", "v")), t
    if gives_place(name):
        position = position_of(recording, name)
        if name == "base":
            return position - _base_position(recording), t
        return (np.concatenate([position, stream.array(VELOCITY)], axis=1) if size == 6 else position), t
    values = own_readings(recording, name)
    if values.shape[1] != size:
        found = f"columns {', '.join(stream.columns)}"
        expected = f"{size} range(s), one for each of `angles` in [sensors.{name}]"
        raise InputError(recording.where, found, expected, f"stream {name}")
    return values, t


def gives_place(name: str) -> bool:
    """Whether a sensor's readings are places on the Earth."""
    return POSITION in sensor(name).columns


def own_readings(recording: Recording, name: str) -> FloatArray:
    """(n, k) the readings of a sensor that measures no place; pressures as heights [m]."""
    stream, entry = recording.streams[name], sensor(name)
    if ("pressure",) in entry.columns:
        return height_of(recording, name)[:, None]
    if entry.numbered:
        return stream.array(ranges_of(stream, entry.numbered))
    return stream.array(entry.columns[0])


def stamps(flight: Flight, name: str) -> FloatArray:
    """(k,) instants at which the readings of one sensor were valid [s]; of `level` the middles of its windows."""
    streams = flight.recording.streams
    if name == "level":
        return window_means(flight, streams["imu"].t)
    if name in ("place", "speed"):
        imu = streams["imu"].t
        return np.arange(imu[0], imu[-1], 1.0 / RATE)
    if name == "zero_rate":
        return flight.model.rest.end
    return streams[name].t - flight.model.latency.get(name, 0.0)


def variances(flight: Flight, name: str) -> FloatArray:
    """(k, m) variances of the white noise of each reading of one sensor, of a magnetometer also `stamp_variances`."""
    model = flight.model
    r = np.diag(model.sensors[name].R) * white_shares(flight, name)
    if name == "mag" and model.stamp_std > 0.0:
        r += stamp_variances(flight)[:, None]
    if name == "gps":
        r[~tells_height(flight.recording.streams[name]), 2] = NO_HEIGHT**2
    if name in model.rounding:
        r += model.rounding[name][: r.shape[1]]
    return r


def white_shares(flight: Flight, name: str) -> FloatArray:
    """(k, m) variance of the white noise of each reading over that of the level.

    Of a receiver whose noise nobody declared it goes with what it says of each fix itself, over what it says of most
    (`FlightModel.said`): a fix without fixed ambiguities, or behind a house, counts less by its own word.
    """
    model = flight.model
    shares = np.ones((len(stamps(flight, name)), model.sensors[name].size))
    if name == "gps":
        fixes = flight.recording.streams[name]
        for column, usual in model.said.items():
            accuracy = fixes[column] if column in fixes else np.zeros(len(fixes))
            known = accuracy > 0.0
            shares[known, SAID_OF[column]] = (accuracy[known, None] / usual) ** 2
        shares[~tells_height(fixes), 2] = 0.0  # no reading
    return shares


#: Components of a fix, of which a receiver says how well it knows them.
SAID_OF: Mapping[str, slice] = {"eph": slice(0, 2), "epv": slice(2, 3), "s_variance": slice(3, 6)}


def stamp_variances(flight: Flight) -> FloatArray:
    """(k,) what a magnetometer whose stamps are uncertain by s reads besides, of the field of another instant:
    (s |w| |m|)^2 / 2 on an axis on average, w from the gyroscope.
    """
    model, streams = flight.model, flight.recording.streams
    imu = streams["imu"]
    w = np.interp(streams["mag"].t, imu.t, np.linalg.norm(imu.array(GYRO), axis=1))
    return 0.5 * (model.stamp_std * w * np.linalg.norm(model.m_n)) ** 2


def with_variances(events: Events, flight: Flight) -> Events:
    """The events with the noise of another model."""
    r = np.zeros_like(events.r)
    for s, name in enumerate(events.sensors):
        mine = np.flatnonzero(events.sensor == s)
        at = events.row[mine][:, None] + np.arange(flight.model.sensors[name].size)
        r[at] = variances(flight, name)[events.index[mine]]
    return replace(events, r=r)


def with_added(events: Events, name: str, values: FloatArray) -> Events:
    """The events with (k, m) more in the readings of one sensor."""
    mine, z = np.flatnonzero(events.sensor == events.sensors.index(name)), events.z.copy()
    z[events.row[mine][:, None] + np.arange(values.shape[1])] += values[events.index[mine]]
    return replace(events, z=z)


def ranges_of(stream: Stream, numbered: str = "range_") -> tuple[str, ...]:
    """Columns of a range finder's readings: `range`, or `range_0`, `range_1`, ... of a scan, in this order."""
    single = numbered.removesuffix("_")
    if single in stream:
        return (single,)
    beams = [c for c in stream.columns if c.startswith(numbered) and c.removeprefix(numbered).isdigit()]
    return tuple(sorted(beams, key=lambda name: int(name.removeprefix(numbered))))


def height_of(recording: Recording, name: str = "baro") -> FloatArray:
    """(n,) height of a barometer's readings [m]; of one that gives pressure alone, above its first in the IMU's time.

    Raises
    ------
    InputError : a pressure of zero or less
    """
    baro = recording.streams[name]
    if "height" in baro:
        return baro["height"]
    pressure = baro["pressure"]
    if np.any(pressure <= 0.0):
        row = int(np.argmax(pressure <= 0.0))
        raise InputError(recording.where, f"pressure {pressure[row]:g} Pa", "above 0", f"stream {name}, row {row + 1}")
    start = recording.streams["imu"].t[0] if "imu" in recording.streams else -np.inf
    first = int(np.argmax(baro.t >= start))  # its very first where all are earlier
    return height_from_pressure(pressure, reference=float(pressure[first]))


def position_of(recording: Recording, name: str) -> FloatArray:
    """(n, 3) NED [m] of a receiver's fixes, `gps` or `base`."""
    if recording.streams[name].has(POSITION):
        return recording.streams[name].array(POSITION)
    from sinan.sensors.formats.geodetic import to_ned

    streams, _, _ = to_ned(recording.where, recording.streams, recording.origin)
    return streams[name].array(POSITION)


def _base_position(recording: Recording) -> FloatArray:
    place = recording.spec("base").base_position
    if place is None:
        raise InputError(
            recording.where, "not declared", "where the base receiver stands", "[sensors.base] base_position"
        )
    if recording.origin is None:
        return np.asarray(place, dtype=np.float64)
    from sinan.sensors.formats.geodetic import ned_columns

    columns = ned_columns(np.asarray(place, dtype=np.float64)[None, :], recording.origin)
    return np.array([columns[axis][0] for axis in POSITION])


def window_means(flight: Flight, values: FloatArray) -> FloatArray:
    """(k, ...) means over the windows of `level` of what goes with the rows of `imu`, (n, ...); a window with a gap
    inside is none.
    """
    t, model = flight.recording.streams["imu"].t, flight.model
    window = max(1, round(model.sensors["level"].window * model.rate))  # type: ignore[attr-defined]
    count = len(t) // window
    cut = t[: count * window].reshape(count, window)
    whole = cut[:, -1] - cut[:, 0] < 2.0 * window / model.rate
    means = values[: count * window].reshape(count, window, *values.shape[1:]).mean(axis=1)
    return np.asarray(means[whole])


@dataclass(frozen=True)
class _Part:
    """The readings of one sensor before they are put among the others."""

    t: FloatArray
    z: FloatArray
    status: IntArray
    form: StreamForm | None


def collect(
    flight: Flight,
    forms: Mapping[str, StreamForm] | None = None,
    shifts: Mapping[str, float] | None = None,
) -> Events:
    """Put the readings of all sensors into one time order.

    Parameters
    ----------
    forms : by sensor, what effects add to its prediction
    shifts : by sensor, further lateness of its stamps [s], as an effect has it
    """
    sensors = flight.model.sensors
    names, notes, parts = tuple(sensors), list[Note](), list[_Part]()
    for name in names:
        part, said = _part_of(flight, name, (forms or {}).get(name), (shifts or {}).get(name, 0.0))
        parts.append(part)
        notes += said
    which, t, index = _in_order(parts)
    sizes = np.array([sensors[name].size for name in names], dtype=np.int64)
    row = np.concatenate([[0], np.cumsum(sizes[which])]).astype(np.int64) if len(t) else np.zeros(1, dtype=np.int64)
    z, r, status = np.zeros(row[-1]), np.zeros(row[-1]), np.zeros(len(t), dtype=np.int64)
    formed = any(part.form is not None for part in parts)
    D, ref = np.zeros((row[-1] if formed else 1, 9)), np.zeros((len(t) if formed else 1, 10))
    for s, part in enumerate(parts):
        mine = np.flatnonzero(which == s)
        at = (row[mine][:, None] + np.arange(sizes[s])).ravel()
        z[at] = part.z[index[mine]].ravel()
        r[at] = variances(flight, names[s])[index[mine]].ravel()
        status[mine] = part.status[index[mine]]
        if part.form is not None:
            D[at] = part.form.D[index[mine]].reshape(-1, 9)
            ref[mine] = part.form.ref[index[mine]]
    has_form = np.array([0 if part.form is None else 1 + part.form.replaces for part in parts], dtype=np.int64)
    return Events(names, t, which, index, row, z, r, status, D, ref, has_form, tuple(notes))


def _in_order(parts: Sequence[_Part]) -> tuple[IntArray, FloatArray, IntArray]:
    """Sensor, instant and row in the stream of every reading; at one instant sensor after sensor."""
    if not parts:
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.int64)
    sensor = np.concatenate([np.full(len(part.t), s) for s, part in enumerate(parts)])
    t = np.concatenate([part.t for part in parts])
    index = np.concatenate([np.arange(len(part.t)) for part in parts])
    order = np.lexsort((index, sensor, t))
    return sensor[order].astype(np.int64), t[order], index[order].astype(np.int64)


def _part_of(flight: Flight, name: str, form: StreamForm | None, late: float) -> tuple[_Part, list[Note]]:
    """The readings of one sensor less what effects add, what is known of each, and what the report should say."""
    imu, model = flight.recording.streams["imu"].t, flight.model
    z, t = readings(flight, name)
    t = t - late
    status = np.where((t < imu[0]) | (t > imu[-1]), OUTSIDE, ACCEPTED)
    notes = [] if name in ASSUMED else _outside(name, t[t < imu[0]]) + _outside(name, t[t > imu[-1]])
    if is_sensor(name) and sensor(name).components and name != "base":
        notes += _faults(name, z, t, status)
    if form is None and is_form_only(name):  # the pass that finds the motion about which it is linear
        status = np.where(status == ACCEPTED, NO_PREDICTION, status)
    if form is not None:
        there = np.all(np.isfinite(form.offset), axis=1)  # a beam above the horizon has no prediction
        status = np.where(~there & (status == ACCEPTED), NO_PREDICTION, status)
        z = np.where(there[:, None], z - np.where(there[:, None], form.offset, 0.0), z)
    status[(status == ACCEPTED) & model.withholds(name, t + model.latency.get(name, 0.0) + late)] = WITHHELD
    return _Part(t, z, status, form), notes


def _outside(name: str, t: FloatArray) -> list[Note]:
    """The readings before the IMU's first sample, or those after its last: each side is a stretch of its own."""
    if not len(t):
        return []
    count = "1 reading" if len(t) == 1 else f"{len(t)} readings"
    return [Note(name, f"{count} outside the IMU's time", float(t[0]), float(t[-1]), "left out")]


def _faults(name: str, z: FloatArray, t: FloatArray, status: IntArray) -> list[Note]:
    """Frozen readings, which are marked, and saturated ones, which are not."""
    notes = []
    for start, stop in frozen_runs(z):
        status[start + 1 : stop] = FAULTY
        notes.append(Note(name, "frozen", float(t[start]), float(t[stop - 1]), "left out"))
    for start, stop in saturated_runs(z) if len(z) > 1 else []:
        notes.append(Note(name, "saturated", float(t[start]), float(t[stop - 1]), "used as read"))
    return notes
