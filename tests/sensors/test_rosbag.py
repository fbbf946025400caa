"""ROS bags as rosbags' own writers make them: frames by physics, units by hand, damage in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, VELOCITY, Recording
from sinan.sensors.rotation import matrix_from_quaternion, rpy_from_quaternion

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

GRAVITY = 9.80665
START = 1_700_000_000
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FORMATS = ("ros1", "sqlite3", "mcap")
Message = tuple[str, float, str, dict[str, Any]]


class Maker:
    """Messages of one typestore, with what is not given empty."""

    def __init__(self, form: str) -> None:
        self.form = form
        self.store = get_typestore(Stores.ROS1_NOETIC if form == "ros1" else Stores.ROS2_HUMBLE)
        self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))

    def make(self, kind: str, t: float = 0.0, frame: str = "base_link", **values: Any) -> Any:
        """A message of a kind such as `sensor_msgs/msg/Imu`; nested ones as dictionaries."""
        types = self.store.types
        fields = {}
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            value = values.get(name)
            if name == "header":
                second = int(np.floor(t))
                fields[name] = types["std_msgs/msg/Header"](
                    **({"seq": 0} if self.form == "ros1" else {}), frame_id=frame,
                    stamp=types["builtin_interfaces/msg/Time"](sec=START + second, nanosec=round(1e9 * (t - second))),
                )  # fmt: skip
            elif node.name == "NAME":
                fields[name] = value if hasattr(value, "__msgtype__") else self.make(str(detail), **(value or {}))
            elif node.name == "BASE":
                fields[name] = value if value is not None else ("" if detail[0] == "string" else 0)
            elif node.name == "ARRAY":
                fields[name] = np.zeros(9) if value is None else np.asarray(value, dtype=np.float64)
            else:
                fields[name] = (
                    []
                    if value is None and detail[0][1] == "string"
                    else (value if value is not None else np.zeros(0, np.float32))
                )
        return types[kind](**fields)

    def write(self, path: Path, messages: list[Message]) -> Path:
        """A bag of messages: topic, stamp [s], kind, fields; received 5 ms later."""
        if self.form == "ros1":
            writer: Any = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if self.form == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(path, version=8, storage_plugin=plugin)
        with writer:
            known = {}
            for topic, t, kind, fields in messages:
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=self.store)
                message = self.make(kind, **({} if kind.endswith("TFMessage") else {"t": t}), **fields)
                data = self.store.serialize_ros1(message, kind) if self.form == "ros1" else self.store.serialize_cdr(
                    message, kind)  # fmt: skip
                writer.write(known[topic], START * 10**9 + round(1e9 * (t + 0.005)), bytes(data))
        return path


def xyz(*values: float) -> dict[str, float]:
    return dict(zip("xyz", values, strict=True))


def imu(t: float, force: tuple[float, ...] = (0.0, 0.0, GRAVITY), rate: tuple[float, ...] = (0.0, 0.0, 0.0),
        topic: str = "/imu", **more: Any) -> Message:  # fmt: skip
    fields = {"linear_acceleration": xyz(*force), "angular_velocity": xyz(*rate),
              "orientation": {"w": 1.0, **xyz(0.0, 0.0, 0.0)}}  # fmt: skip
    return topic, t, "sensor_msgs/msg/Imu", fields | more


def at_rest(force: tuple[float, ...] = (0.0, 0.0, GRAVITY), **more: Any) -> list[Message]:
    return [imu(0.01 * k, force, **more) for k in range(100)]


@pytest.fixture(params=FORMATS)
def maker(request: pytest.FixtureRequest) -> Maker:
    return Maker(request.param)


def read(maker: Maker, folder: Path, messages: list[Message], choice: Choice | None = None) -> Recording:
    path = maker.write(folder / ("bag.bag" if maker.form == "ros1" else "bag"), messages)
    return open_log(path, choice=choice or Choice())


@pytest.mark.parametrize(
    ("force", "expected"),
    [
        ((0.0, 0.0, GRAVITY), (0.0, 0.0, -GRAVITY)),  # level: pushed up by the ground
        ((GRAVITY / 2, 0.0, GRAVITY * 0.75**0.5), (GRAVITY / 2, 0.0, -GRAVITY * 0.75**0.5)),  # nose up by 30 deg
        ((0.0, -GRAVITY / 2, GRAVITY * 0.75**0.5), (0.0, GRAVITY / 2, -GRAVITY * 0.75**0.5)),  # right side up
    ],
)
def test_a_body_at_rest(maker: Maker, tmp_path: Path, force: tuple[float, ...], expected: tuple[float, ...]) -> None:
    recording = read(maker, tmp_path, at_rest(force))
    np.testing.assert_allclose(recording.streams["imu"].array(ACCEL)[0], expected, atol=1e-12)
    np.testing.assert_allclose(recording.streams["imu"].t, 0.01 * np.arange(100), atol=1e-8)
    assert not any("does not read its weight upward" in note for note in recording.notes)


def test_a_turn_to_the_right_seen_from_above(maker: Maker, tmp_path: Path) -> None:
    """Negative about ROS's upward axis, positive about down; the heading of the orientation grows with it."""
    messages = []
    for k in range(200):
        t = 0.01 * k
        half = -0.25 * t  # of a yaw of -0.5 rad/s from east
        messages.append(imu(t, rate=(0.0, 0.0, -0.5), orientation={"w": np.cos(half), **xyz(0.0, 0.0, np.sin(half))}))
    recording = read(maker, tmp_path, messages)
    np.testing.assert_allclose(recording.streams["imu"].array(GYRO)[0], [0.0, 0.0, 0.5])
    assert recording.truth is not None
    assert recording.truth.kind == "autopilot"
    yaw = rpy_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))[:, 2]
    np.testing.assert_allclose(yaw, np.pi / 2 + 0.5 * recording.truth.stream.t, atol=1e-9)


def test_every_kind_of_message(maker: Maker, tmp_path: Path) -> None:
    messages = at_rest()
    limits = {"min_range": 0.2, "max_range": 7.0}
    for k in range(10):
        t = 0.1 * k
        messages += [
            ("/mag", t, "sensor_msgs/msg/MagneticField", {"magnetic_field": xyz(0.2e-4, 0.1e-4, -0.4e-4)}),
            ("/fix", t, "sensor_msgs/msg/NavSatFix", {
                "status": {"status": 0 if k else -1}, "latitude": 47.0, "longitude": 8.0, "altitude": 400.0 + k,
                "position_covariance": np.diag([0.5, 1.5, 4.0]).ravel(), "position_covariance_type": 2}),
            ("/vel", t, "geometry_msgs/msg/TwistStamped", {"frame": "map", "twist": {"linear": xyz(1.0, 2.0, 3.0)}}),
            ("/pressure", t, "sensor_msgs/msg/FluidPressure", {"fluid_pressure": 95_000.0}),
            ("/sonar", t, "sensor_msgs/msg/Range", {"range": 1.5 if k % 2 else 9.0, **limits}),
            ("/lidar", t, "sensor_msgs/msg/Range", {"range": 1.6, **limits, "radiation_type": 1}),
            ("/battery", t, "sensor_msgs/msg/BatteryState", {"voltage": 16.0, "current": -12.0}),
            ("/vicon/body", t, "geometry_msgs/msg/PoseStamped", {"frame": "map", "pose": {
                "position": xyz(1.0, 2.0, 3.0), "orientation": {"w": 1.0, **xyz(0.0, 0.0, 0.0)}}}),
        ]  # fmt: skip
    streams = (recording := read(maker, tmp_path, messages)).streams
    np.testing.assert_allclose(streams["mag"].array(MAG)[0], [0.2, -0.1, 0.4])  # gauss; northern field points down
    gps = streams["gps"]
    assert len(gps) == 9
    np.testing.assert_allclose(gps.array(VELOCITY)[0], [2.0, 1.0, -3.0])
    np.testing.assert_allclose(gps.array(("eph", "epv"))[0], [1.0, 2.0])
    np.testing.assert_allclose(gps.array(POSITION)[-1], [0.0, 0.0, -8.0], atol=1e-6)
    assert streams["baro"]["pressure"][0] == 95_000.0
    assert (len(streams["sonar"]), streams["sonar"]["range"][0]) == (5, pytest.approx(1.5))
    assert streams["laser"]["range"][0] == pytest.approx(1.6)
    assert streams["power"].array(("current", "voltage"))[0] == pytest.approx([12.0, 16.0])
    assert recording.truth is not None
    assert (recording.truth.kind, recording.truth.known) == ("cameras", ("attitude",))
    C_nb = matrix_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))[0]
    np.testing.assert_allclose(C_nb, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)  # forward is east, right is south


@pytest.mark.parametrize(
    ("unit", "factor"), [("T", 1e-4), ("uT", 100.0), ("gauss", 1.0), ("mGauss", 1000.0), ("nT", 1e5)]
)
def test_a_magnetometer_in_another_unit_than_the_message_s_is_told(tmp_path: Path, unit: str, factor: float) -> None:
    field = np.array([0.2, 0.1, -0.4])
    mag = [("/mag", 0.02 * k, "sensor_msgs/msg/MagneticField", {"magnetic_field": xyz(*factor * field)})
           for k in range(50)]  # fmt: skip
    recording = read(Maker("ros1"), tmp_path, at_rest() + mag)
    np.testing.assert_allclose(recording.streams["mag"].array(MAG)[0], [0.2, -0.1, 0.4])
    said = [note for note in recording.notes if note.startswith("mag: /mag reads")]
    assert len(said) == (unit != "T")
    assert all(f"taken for {unit}: " in note for note in said)


def test_where_nothing_else_tells_the_place_the_pose_does(maker: Maker, tmp_path: Path) -> None:
    pose = {"position": xyz(1.0, 2.0, 3.0), "orientation": {"w": 1.0, **xyz(0.0, 0.0, 0.0)}}
    messages = at_rest() + [("/pose", 0.1 * k, "geometry_msgs/msg/PoseStamped", {"pose": pose}) for k in range(9)]
    truth = read(maker, tmp_path, messages).truth
    assert truth is not None
    assert (truth.kind, truth.known) == ("other", ("position", "attitude"))
    np.testing.assert_allclose(truth.stream.array(POSITION)[0], [2.0, 1.0, -3.0])


def mounted(child: str, w: float, x: float, y: float, z: float) -> Message:
    return "/tf_static", 0.0, "tf2_msgs/msg/TFMessage", {
        "transforms": [(child, {"w": w, **xyz(x, y, z)})]
    }  # fmt: skip


def with_frames(maker: Maker, messages: list[Message]) -> list[Message]:
    """The messages with the transforms made of what they are given as."""
    made = []
    for topic, t, kind, fields in messages:
        if kind.endswith("TFMessage"):
            fields = {
                "transforms": [
                    maker.make("geometry_msgs/msg/TransformStamped", child_frame_id=child, transform={"rotation": q})
                    for child, q in fields["transforms"]
                ]
            }
        made.append((topic, t, kind, fields))
    return made


def test_a_sensor_is_turned_as_its_frame_is(maker: Maker, tmp_path: Path) -> None:
    """A board on its side: its y axis, +90 deg about x, is the body's up; at rest it reads +g along y."""
    half = 0.5**0.5
    messages = [mounted("board", half, half, 0.0, 0.0), *at_rest((0.0, GRAVITY, 0.0), frame="board")]
    recording = read(maker, tmp_path, with_frames(maker, messages))
    np.testing.assert_allclose(recording.streams["imu"].array(ACCEL)[0], [0.0, 0.0, -GRAVITY], atol=1e-9)


def test_a_frame_that_is_not_forward_left_up_is_told(maker: Maker, tmp_path: Path) -> None:
    recording = read(maker, tmp_path, at_rest((GRAVITY, 0.0, 0.0), frame="camera"))
    assert any("its frame `camera` is not forward-left-up" in note for note in recording.notes)


def test_a_scan_across_and_below_the_body(maker: Maker, tmp_path: Path) -> None:
    """A scanner turned by +90 deg about y: its x points down, its y to the left; a beam at +30 deg hits on the left."""
    half = 0.5**0.5
    scan = {"angle_min": -np.pi / 6, "angle_max": np.pi / 6, "angle_increment": np.pi / 6, "range_min": 0.1,
            "range_max": 30.0, "ranges": np.array([2.0, 1.5, 2.5], np.float32)}  # fmt: skip
    messages = [mounted("scanner", half, 0.0, half, 0.0), *at_rest()]
    messages += [("/scan", 0.1 * k, "sensor_msgs/msg/LaserScan", {"frame": "scanner", **scan}) for k in range(9)]
    recording = read(maker, tmp_path, with_frames(maker, messages))
    angles = recording.spec("laser").angles
    np.testing.assert_allclose(angles, [np.pi / 6, 0.0, -np.pi / 6], atol=1e-6)  # positive to the right
    np.testing.assert_allclose(recording.streams["laser"].array(("range_0", "range_1", "range_2"))[0], [2, 1.5, 2.5])


def test_a_scan_around_the_body_is_left_out(maker: Maker, tmp_path: Path) -> None:
    scan = {"angle_increment": 0.1, "range_min": 0.1, "range_max": 30.0, "ranges": np.ones(9, np.float32)}
    recording = read(maker, tmp_path, [*at_rest(), ("/scan", 0.0, "sensor_msgs/msg/LaserScan", scan)])
    assert "laser" not in recording.streams
    assert any("/scan is not read" in note for note in recording.notes)


def test_of_several_topics_the_one_that_is_asked_for(maker: Maker, tmp_path: Path) -> None:
    messages = at_rest() + at_rest((0.0, 0.0, 9.7), topic="/imu_2")
    recording = read(maker, tmp_path, messages, Choice(imu=1))
    assert recording.streams["imu"]["accel_z"][0] == pytest.approx(-9.7)
    assert "imu: /imu_2 is read, of /imu, /imu_2 (--imu 0 to 1)" in recording.notes
    path = next(tmp_path.iterdir())
    with pytest.raises(InputError, match="--imu: no imu number 2; expected one of 0, 1"):
        open_log(path, choice=Choice(imu=2))
    with pytest.raises(InputError, match="does not say what was corrected"):
        open_log(path, choice=Choice(raw=True))
    facts = facts_of(path)
    assert facts is not None
    assert [(table.name, table.rows) for table in facts.tables] == [("/imu", 100), ("/imu_2", 100)]


def test_a_bag_is_told_by_its_content(tmp_path: Path) -> None:
    """Of ROS 1, and the one file of ROS 2's folder."""
    good = Maker("ros1").write(tmp_path / "a.bag", at_rest())
    files = [good, *Maker("mcap").write(tmp_path / "b", at_rest()).glob("*.mcap")]
    files += Maker("sqlite3").write(tmp_path / "c", at_rest()).glob("*.db3")
    assert len(files) == 3
    for k, file in enumerate(files):
        named = tmp_path / f"log{k}"
        named.write_bytes(file.read_bytes())
        assert len(open_log(named).streams["imu"]) == 100


def test_a_bag_without_an_imu(maker: Maker, tmp_path: Path) -> None:
    pressure = [("/pressure", 0.1 * k, "sensor_msgs/msg/FluidPressure", {"fluid_pressure": 95e3}) for k in range(9)]
    with pytest.raises(InputError, match=r"no accelerometer with a gyroscope \(there are /pressure \(FluidPressure\)"):
        read(maker, tmp_path, pressure)


def test_what_is_missing_is_named(tmp_path: Path, without_library: Callable[[str], None]) -> None:
    path = Maker("ros1").write(tmp_path / "a.bag", at_rest())
    without_library("rosbags")
    with pytest.raises(InputError, match=r"pip install -e '\.\[ros\]'"):
        open_log(path)


def damaged(good: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    for _ in range(40):
        at, size = int(rng.integers(len(good))), int(rng.choice([1, 4, 100]))
        yield good[:at]
        yield good[:at] + rng.bytes(size) + good[at + size :]
        yield good[:at] + good[at + size :]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("form", FORMATS)
def test_damage_ends_in_one_line(tmp_path: Path, form: str) -> None:
    path = Maker(form).write(tmp_path / "bag", at_rest())
    good = (path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")).read_bytes()
    said = []
    for k, data in enumerate(damaged(good, np.random.default_rng(5))):
        file = tmp_path / f"damaged{k}"
        file.write_bytes(data)
        try:
            open_log(file)
        except InputError as error:
            said.append((str(file), str(error)))
        file.unlink()
    assert all(name in text and text.isprintable() for name, text in said)
    assert len(said) > 10
