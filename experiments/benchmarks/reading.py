"""What a recording costs beyond the parse of the library at its border, as a ratio of CPU times taken in turn.

`python -m sinan.experiments.benchmarks.reading FOLDER`, with pyulog, pymavlink and rosbags; FOLDER holds the data sets.
The ULogs are measured; telemetry and bag are written here, a minute of an IMU at 200 Hz with what a vehicle sends.
"""

from __future__ import annotations

import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sinan.sensors.formats import open_log

ROUNDS, SECONDS, RATE = 7, 60.0, 200.0


def telemetry(path: Path) -> None:
    """HIGHRES_IMU, ATTITUDE and a heart beat, as a ground station logs them."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link, parts = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), []
    for k in range(int(SECONDS * RATE)):
        t = 10.0 + k / RATE
        sent = [mavlink.MAVLink_highres_imu_message(round(1e6 * t), 0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 0.2, 0.0, 0.4,
                                                    950.0, 0.0, 500.0, 30.0, 0x1FFF)]  # fmt: skip
        if k % 10 == 0:
            sent.append(mavlink.MAVLink_attitude_message(round(1e3 * t), 0.0, 0.01, 0.02, 0.0, 0.0, 0.0))
        if k % 200 == 0:
            sent.append(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
        for message in sent:
            link.seq = (link.seq + 1) % 256
            parts.append(struct.pack(">Q", 1_700_000_000_000_000 + round(1e6 * t)) + bytes(message.pack(link)))
    path.write_bytes(b"".join(parts))


def bag(path: Path) -> None:
    """A ROS 1 bag of `sensor_msgs/Imu`."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS1_NOETIC)
    kind = store.types
    vector, zeros = kind["geometry_msgs/msg/Vector3"], np.zeros(9)
    with Writer(path) as writer:
        way = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k in range(int(SECONDS * RATE)):
            ns = 1_700_000_000_000_000_000 + round(1e9 * k / RATE)
            stamp = kind["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
            head = kind["std_msgs/msg/Header"](k, stamp, "imu")
            turn = kind["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            rate, force = vector(0.01, 0.02, 0.03), vector(0.1, 0.2, 9.8)
            message = kind["sensor_msgs/msg/Imu"](head, turn, zeros, rate, zeros, force, zeros)
            writer.write(way, ns, store.serialize_ros1(message, "sensor_msgs/msg/Imu"))


def pyulog(path: Path) -> None:
    """All topics as columns."""
    from pyulog import ULog

    ULog(str(path))


def pymavlink(path: Path) -> None:
    """All messages, decoded."""
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path))
    while log.recv_msg() is not None:
        pass


def rosbags(path: Path) -> None:
    """All messages, decoded."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        for way, _, data in reader.messages():
            reader.deserialize(data, way.msgtype)


def compare(path: Path, library: Callable[[Path], None]) -> tuple[float, float, float]:
    """CPU seconds of ours and of the library, the least of each, and the median of the ratios of neighbours."""
    times = []
    for k in range(1 + ROUNDS):
        pair = []
        for read in (open_log, library):
            begin = time.process_time()
            read(path)
            pair.append(time.process_time() - begin)
        if k:  # the first one loads modules
            times.append(pair)
    ours, theirs = np.array(times).T
    return float(ours.min()), float(theirs.min()), float(np.median(ours / theirs))


def main() -> None:
    """Print the table."""
    folder = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as made:
        telemetry(Path(made) / "flight.tlog")
        bag(Path(made) / "flight.bag")
        cases = [(path, pyulog) for path in sorted(folder.glob("px4_*/*.ulg"))]
        cases += [(Path(made) / "flight.tlog", pymavlink), (Path(made) / "flight.bag", rosbags)]
        print("| log | MB | library | sinan / s | library / s | ratio |\n| --- | --- | --- | --- | --- | --- |")
        for path, library in cases:
            ours, theirs, ratio = compare(path, library)
            size = path.stat().st_size / 1e6
            print(f"| {path.name} | {size:.1f} | {library.__name__} | {ours:.3f} | {theirs:.3f} | {ratio:.2f} |")


if __name__ == "__main__":
    main()
