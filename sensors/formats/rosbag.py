"""ROS 1 bags and ROS 2 bags (sqlite3, MCAP) as recordings, read by `rosbags`, without ROS.

ROS has the body forward-left-up and the world east-north-up (REP-103), and an accelerometer that reads +g upward at
rest (REP-145): vectors are turned into forward-right-down, v_FRD = (x, -y, -z), poses into north-east-down. A sensor
whose frame `/tf_static` ties to `base_link` is turned into that first; any other is taken for aligned with the body.
"""

from __future__ import annotations

import tempfile
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError, with_extra
from sinan.sensors.formats.choice import FIRST, Choice, not_there
from sinan.sensors.formats.facts import Facts, Table
from sinan.sensors.formats.logged import FRD_OF_FLU, NED_OF_ENU, numbered, recording_of, turned
from sinan.sensors.formats.packed import MOST_COLUMNS, MOST_NUMBERS, require_numbers
from sinan.sensors.formats.plausible import check_field, unit_of_field
from sinan.sensors.formats.units import UNITS
from sinan.sensors.recording import (
    ACCEL,
    GEODETIC,
    GYRO,
    MAG,
    POSITION,
    QUATERNION,
    VELOCITY,
    Recording,
    SensorSpec,
    Stream,
)
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_matrix, quaternion_multiply

#: What the library tells a file by, which need not be its name's end.
_SUFFIXES = {"rosbag": ".bag", "sqlite": ".db3", "mcap": ".mcap"}
#: Axes: forward-right-down of forward-left-up, and north-east-down of east-north-up; both are their own inverses.
#: The frames that a body may be called, best first.
_BODIES = ("base_link", "base_link_frd", "body", "base_footprint", "imu_link")
_ULTRASOUND = 0
#: A beam of a scan lies in the plane across the body's forward axis, and below its horizon, within this [rad].
_ACROSS = 0.02
#: Names of topics that tell what made a pose.
_CAMERAS = ("vicon", "mocap", "optitrack", "vrpn", "qualisys", "motive")
_OWN = ("mavros", "fmu", "local_position", "odom")
#: Part of the fixes that a velocity has to cover to be theirs.
_COVERED = 0.9
_WHOLE = "a whole ROS bag; `rosbag reindex`, `ros2 bag reindex` or `mcap recover` may mend it"


def _imu(m: Any) -> Sequence[float]:
    a, w, q = m.linear_acceleration, m.angular_velocity, m.orientation
    return a.x, a.y, a.z, w.x, w.y, w.z, q.w, q.x, q.y, q.z, m.orientation_covariance[0]


def _mag(m: Any) -> Sequence[float]:
    return m.magnetic_field.x, m.magnetic_field.y, m.magnetic_field.z


def _fix(m: Any) -> Sequence[float]:
    c = m.position_covariance
    return m.latitude, m.longitude, m.altitude, m.status.status, c[0], c[4], c[8], m.position_covariance_type


def _pressure(m: Any) -> Sequence[float]:
    return (m.fluid_pressure,)


def _range(m: Any) -> Sequence[float]:
    return m.range, m.min_range, m.max_range, m.radiation_type


def _scan(m: Any) -> Sequence[float]:
    near, far = m.range_min, m.range_max
    ranges = np.asarray(m.ranges, dtype=np.float64)
    if len(ranges) > MOST_COLUMNS:
        raise ValueError(f"a scan of {len(ranges)} beams")
    return m.angle_min, m.angle_increment, *np.where((ranges > near) & (ranges < far), ranges, np.nan).tolist()


def _battery(m: Any) -> Sequence[float]:
    return -m.current, m.voltage  # negative when it discharges


def _twist(m: Any) -> Sequence[float]:
    v = m.twist.linear
    return v.x, v.y, v.z


def _pose(m: Any) -> Sequence[float]:
    p, q = m.pose.position, m.pose.orientation
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


def _odometry(m: Any) -> Sequence[float]:
    return _pose(m.pose)


def _transform(m: Any) -> Sequence[float]:
    p, q = m.transform.translation, m.transform.rotation
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


#: The kinds of messages that are read, and the numbers that are taken out of each.
_TAKEN: Mapping[str, Callable[[Any], Sequence[float]]] = {
    "sensor_msgs/msg/Imu": _imu, "sensor_msgs/msg/MagneticField": _mag, "sensor_msgs/msg/NavSatFix": _fix,
    "sensor_msgs/msg/FluidPressure": _pressure, "sensor_msgs/msg/Range": _range, "sensor_msgs/msg/LaserScan": _scan,
    "sensor_msgs/msg/BatteryState": _battery, "geometry_msgs/msg/TwistStamped": _twist,
    "geometry_msgs/msg/PoseStamped": _pose, "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/TransformStamped": _transform,
}  # fmt: skip
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped", "nav_msgs/msg/Odometry")


@dataclass
class _Topic:
    """The readings of one topic.

    Attributes
    ----------
    kind : of its messages
    frame : of the first of them
    seconds, nanoseconds : stamps, since the first message of the bag
    values : of all messages in a row
    width : of one message
    """

    kind: str
    frame: str = ""
    seconds: array[int] = field(default_factory=lambda: array("q"))
    nanoseconds: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    width: int = 0
    other: int = 0

    def add(self, second: int, nanosecond: int, received: int, values: Sequence[float]) -> None:
        """Take in a message; without a stamp when it was received [ns] counts. One of another length than the first is
        counted and left out.
        """
        if len(values) != self.width:
            if self.width:
                self.other += 1
                return
            self.width = len(values)
        if not (second or nanosecond):
            second, nanosecond = divmod(received, 10**9)
        self.seconds.append(second)
        self.nanoseconds.append(nanosecond)
        self.values.extend(values)

    def __len__(self) -> int:
        return len(self.seconds)

    def t(self, start: int) -> FloatArray:
        """(n,) stamps after a whole second [s]."""
        return (np.array(self.seconds, np.int64) - start) + 1e-9 * np.array(self.nanoseconds, np.int64)

    def table(self) -> FloatArray:
        """(n, width) what was taken."""
        return np.array(self.values).reshape(len(self), self.width)


@dataclass
class _Bag:
    """What of a bag is read: topics by name, and how frames lie in one another."""

    path: Path
    topics: dict[str, _Topic] = field(default_factory=dict)
    frames: dict[str, tuple[str, FloatArray]] = field(default_factory=dict)

    def of(self, kind: str) -> list[str]:
        """The topics of a kind, in the order of their names."""
        return sorted(name for name, topic in self.topics.items() if topic.kind == f"sensor_msgs/msg/{kind}")

    @property
    def start(self) -> int:
        """The first whole second of a stamp."""
        return min(min(topic.seconds) for topic in self.topics.values() if len(topic))

    def turned(self, name: str) -> FloatArray:
        """(3, 3) from the frame of a topic to the body, forward-right-down."""
        frame = self.topics[name].frame
        C = np.eye(3)
        for _ in range(len(self.frames) + 1):
            if frame in _BODIES or frame not in self.frames:
                break
            frame, C_step = self.frames[frame]
            C = C_step @ C
        return np.asarray(FRD_OF_FLU @ C if frame in _BODIES else FRD_OF_FLU)


def read_rosbag(path: Path, choice: Choice = FIRST) -> Recording:
    """A bag as a recording: Imu, MagneticField, NavSatFix with TwistStamped, FluidPressure, Range, LaserScan,
    BatteryState; PoseStamped, Odometry or TransformStamped as a reference, else the IMU's own orientation.

    Stamps are those of the messages' headers. Of several topics of a kind the first by name is read, or that which is
    asked for. Neglected: what moves in `/tf`, covariances but those of a fix, images, points.

    Raises
    ------
    InputError : no `rosbags`, a damaged bag, no IMU, a topic that is not there
    """
    choice = choice if not choice.raw else _no_raw(path)
    bag = _read(path)
    notes = [f"{name}: {topic.other} messages of another length left out" for name, topic in bag.topics.items()
             if topic.other]  # fmt: skip
    if not any(map(len, bag.topics.values())):
        raise InputError(path, "no message of a kind that is read", f"one of {', '.join(_TAKEN)}")
    gps = _gps(bag, choice.gps, notes)
    found = {
        "imu": _imu_of(bag, choice.imu, notes), "mag": _mag_of(bag, choice.mag, notes), "gps": gps,
        "baro": _baro_of(bag, choice.baro, notes), "power": _power(bag), **_ranges(bag, notes),
    }  # fmt: skip
    scan, angles = _scan_of(bag, notes) if "laser" not in found else (None, None)
    if scan is not None:
        found["laser"] = scan
    sensors = {"laser": SensorSpec(angles=angles)} if angles is not None else {}
    reference, kind = _reference(bag, gps is not None, choice.imu)
    there = [f"{name} ({topic.kind.split('/')[-1]})" for name, topic in sorted(bag.topics.items()) if len(topic)]
    recording = recording_of(path, found, reference, sensors, notes, there, kind)
    check_field(recording)
    return recording


def rosbag_facts(path: Path) -> Facts:
    """What a bag says of itself."""
    with _opened(path) as reader:
        span = (reader.start_time * 1e-9, reader.end_time * 1e-9) if reader.message_count else None
        tables = []
        for topic, known in sorted(reader.topics.items()):
            kind = (known.msgtype or "several kinds").replace("/msg/", "/")
            tables.append(Table(topic, known.msgcount, span if known.msgcount else None, (kind,)))
        several = {
            sensor: sum(1 for known in reader.topics.values() if known.msgtype == f"sensor_msgs/msg/{kind}")
            for sensor, kind in
            (("imu", "Imu"), ("mag", "MagneticField"), ("baro", "FluidPressure"), ("gps", "NavSatFix"))
        }  # fmt: skip
        return Facts("ROS 2 bag" if reader.is2 else "ROS 1 bag", "", {}, tuple(tables), several)


def _no_raw(path: Path) -> Choice:
    raise InputError(path, "a bag, which does not say what was corrected in it", "no --raw", "--raw")


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The library's reader of a bag, found by its content; whatever goes wrong in it is one line."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputError(path, "a ROS bag, which `rosbags` reads", with_extra("ros")) from None
    from sinan.sensors.formats.columns import content_of

    known = get_typestore(Stores.LATEST)  # for a bag that does not say what its messages are
    known.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", _TRANSFORMS))
    with tempfile.TemporaryDirectory() as folder:
        place = path
        suffix = "" if path.is_dir() else _SUFFIXES[content_of(path)]
        if suffix and path.suffix != suffix:
            place = Path(folder) / f"bag{suffix}"
            place.symlink_to(path.resolve())
        try:
            with AnyReader([place], default_typestore=known) as reader:
                yield reader
        except InputError:
            raise
        except Exception as error:  # the library lets through what the bytes make it stumble over
            found = f"damaged bag ({type(error).__name__}: {error})"
            raise InputError(path, found, _WHOLE) from None


def _read(path: Path) -> _Bag:
    """The messages that are read, topic by topic."""
    bag, numbers = _Bag(path), 0
    with _opened(path) as reader:
        wanted = [connection for connection in reader.connections
                  if connection.msgtype in _TAKEN or connection.topic.endswith("tf_static")]  # fmt: skip
        if not wanted:
            return bag
        for connection, when, data in reader.messages(wanted):
            kind = connection.msgtype
            message = reader.deserialize(data, kind)
            take = _TAKEN.get(kind)
            if take is None:
                if kind == _TRANSFORMS:
                    _frames(bag, message.transforms)
                continue
            header, values = message.header, take(message)
            topic = bag.topics.get(connection.topic)
            if topic is None:
                topic = bag.topics[connection.topic] = _Topic(kind, header.frame_id.lstrip("/"))
            stamp = header.stamp
            topic.add(stamp.sec, stamp.nanosec, when, values)
            numbers += len(values) + 2
            if numbers > MOST_NUMBERS:
                require_numbers(path, numbers, connection.topic)
    return bag


def _frames(bag: _Bag, transforms: Iterable[Any]) -> None:
    """Take in how frames lie in one another: C of the child's axes in the parent's."""
    for one in transforms:
        q = one.transform.rotation
        quaternion = np.array([q.w, q.x, q.y, q.z])
        norm = np.linalg.norm(quaternion)
        if 0.5 < norm < 2.0:
            parent = one.header.frame_id.lstrip("/")
            bag.frames[one.child_frame_id.lstrip("/")] = parent, matrix_from_quaternion(quaternion / norm)


def _asked(bag: _Bag, kind: str, sensor: str, number: int, notes: list[str]) -> str | None:
    """The topic of a sensor, or None; an error where another than the first is asked for and is not there."""
    names = bag.of(kind)
    if number >= len(names):
        if number:
            not_there(bag.path, sensor, number, len(names))
        return None
    if len(names) > 1:
        notes.append(f"{sensor}: {names[number]} is read, of {', '.join(names)} (--{sensor} 0 to {len(names) - 1})")
    return names[number]


def _vectors(bag: _Bag, name: str, table: FloatArray) -> FloatArray:
    return turned(bag.turned(name), table)


def _imu_of(bag: _Bag, number: int, notes: list[str]) -> Stream | None:
    name = _asked(bag, "Imu", "imu", number, notes)
    if name is None:
        return None
    table = bag.topics[name].table()
    force = _vectors(bag, name, table[:, 0:3])
    rate = _vectors(bag, name, table[:, 3:6])
    with np.errstate(over="ignore", invalid="ignore"):
        upward = -np.median(force[:, 2]) >= 0.5 * np.median(np.linalg.norm(force, axis=1))
    if not upward:
        notes.append(f"imu: {name} does not read its weight upward: its frame `{bag.topics[name].frame}` is not "
                     "forward-left-up; convert, and turn it with a map")  # fmt: skip
    columns = dict(zip((*ACCEL, *GYRO), np.hstack([force, rate]).T, strict=True))
    return Stream(bag.topics[name].t(bag.start), columns)


def _mag_of(bag: _Bag, number: int, notes: list[str]) -> Stream | None:
    name = _asked(bag, "MagneticField", "mag", number, notes)
    if name is None:
        return None
    reading = bag.topics[name].table()
    with np.errstate(invalid="ignore", over="ignore"):
        norms = np.linalg.norm(reading, axis=1)
    middle = float(np.median(norms[np.isfinite(norms)])) if np.any(np.isfinite(norms)) else 0.0
    unit = unit_of_field(middle) or "T"
    if unit != "T":
        notes.append(
            f"mag: {name} reads {middle:.4g}, taken for {unit}: the message has teslas, where no field is so large"
        )
    gauss = _vectors(bag, name, UNITS["field"][unit][0] * reading)
    return Stream(bag.topics[name].t(bag.start), dict(zip(MAG, gauss.T, strict=True)))


def _baro_of(bag: _Bag, number: int, notes: list[str]) -> Stream | None:
    name = _asked(bag, "FluidPressure", "baro", number, notes)
    if name is None:
        return None
    return Stream(bag.topics[name].t(bag.start), {"pressure": bag.topics[name].table()[:, 0]})


def _gps(bag: _Bag, number: int, notes: list[str]) -> Stream | None:
    """Fixes with their covariance, and the velocity of a TwistStamped in east-north-up that covers them."""
    name = _asked(bag, "NavSatFix", "gps", number, notes)
    if name is None:
        return None
    table, t = bag.topics[name].table(), bag.topics[name].t(bag.start)
    columns = dict(zip(GEODETIC, table[:, :3].T, strict=True))
    if np.all(table[:, 7] > 0.0) and np.all(table[:, 4:7] >= 0.0):  # covariance known
        columns |= {"eph": np.sqrt(np.mean(table[:, 4:6], axis=1)), "epv": np.sqrt(table[:, 6])}
    for other in sorted(name for name, topic in bag.topics.items() if topic.kind == "geometry_msgs/msg/TwistStamped"):
        topic = bag.topics[other]
        if topic.frame in _BODIES or len(topic) < 2:
            notes.append(f"gps: {other} is not read, a velocity about the body")
            continue
        when, velocity = topic.t(bag.start), turned(NED_OF_ENU, topic.table())
        if np.mean((t >= when[0]) & (t <= when[-1])) < _COVERED or np.any(np.diff(when) < 0.0):
            continue
        columns |= {axis: np.interp(t, when, velocity[:, k]) for k, axis in enumerate(VELOCITY)}
        notes.append(f"gps: velocity of {other}")
        break
    return Stream(t, columns).rows(table[:, 3] >= 0.0)


def _power(bag: _Bag) -> Stream | None:
    streams = []
    for name in bag.of("BatteryState"):
        table = bag.topics[name].table()
        columns = {column: table[:, k] for k, column in enumerate(("current", "voltage"))
                   if np.all(np.isfinite(table[:, k]))}  # fmt: skip
        if columns:
            streams.append(Stream(bag.topics[name].t(bag.start), columns))
    return numbered(streams)


def _ranges(bag: _Bag, notes: list[str]) -> dict[str, Stream]:
    """The first range by sound and the first by light, within their own limits, taken for downward."""
    found: dict[str, Stream] = {}
    for name in bag.of("Range"):
        table, t = bag.topics[name].table(), bag.topics[name].t(bag.start)
        good = (table[:, 0] > table[:, 1]) & (table[:, 0] < table[:, 2])
        sensor = "sonar" if table[0, 3] == _ULTRASOUND else "laser"
        if np.any(good) and sensor not in found:
            found[sensor] = Stream(t[good], {"range": table[good, 0]})
            notes.append(f"{sensor}: {name} is taken for downward")
    return found


def _scan_of(bag: _Bag, notes: list[str]) -> tuple[Stream | None, FloatArray | None]:
    """A scan across the body's forward axis: its beams below the horizon, as angles from body down."""
    for name in bag.of("LaserScan"):
        table, t = bag.topics[name].table(), bag.topics[name].t(bag.start)
        theta = table[0, 0] + table[0, 1] * np.arange(table.shape[1] - 2)
        beams = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=-1) @ bag.turned(name).T
        if np.max(np.abs(beams[:, 0]), initial=0.0) > _ACROSS or np.any(table[:, :2] != table[0, :2]):
            notes.append(f"laser: {name} is not read: /tf_static does not say that it scans across and below the body")
            continue
        ranges = table[:, 2:]
        below = (beams[:, 2] > np.sin(_ACROSS)) & np.any(np.isfinite(ranges), axis=0)
        if not np.any(below):
            continue
        angles = np.arctan2(beams[below, 1], beams[below, 2])
        columns = {f"range_{k}": values for k, values in enumerate(ranges[:, below].T)}
        return Stream(t, columns), angles
    return None, None


def _reference(bag: _Bag, with_gps: bool, number: int) -> tuple[Stream | None, str]:
    """Poses of something else than the sensors, else the orientation that the IMU's message has; and what made them.

    Positions have an origin of their own, and are left out where there is a GPS.
    """
    names = [name for kind in _POSES for name, topic in sorted(bag.topics.items()) if topic.kind == kind and len(topic)]
    rank = [sum(word in name.lower() for word in _CAMERAS) for name in names]
    if names:
        name = names[int(np.argmax(rank))]
        table = bag.topics[name].table()
        own = any(word in name.lower() for word in _OWN)
        kind = "cameras" if max(rank) else "autopilot" if own else "other"
        columns = {} if with_gps else dict(zip(POSITION, turned(NED_OF_ENU, table[:, :3]).T, strict=True))
        q = table[:, 3:7]
    else:
        imus = bag.of("Imu")
        if number >= len(imus):
            return None, ""
        name, kind, columns = imus[number], "autopilot", {}
        table = bag.topics[name].table()
        q = np.where(table[:, 10:11] < 0.0, np.nan, table[:, 6:10])  # -1: no estimate
    with np.errstate(invalid="ignore", over="ignore"):
        q_nb = quaternion_multiply(np.broadcast_to(quaternion_from_matrix(NED_OF_ENU), q.shape), q)
        q_nb = quaternion_multiply(q_nb, np.broadcast_to(quaternion_from_matrix(FRD_OF_FLU), q.shape))
    columns |= dict(zip(QUATERNION, q_nb.T, strict=True))
    return Stream(bag.topics[name].t(bag.start), columns), kind
