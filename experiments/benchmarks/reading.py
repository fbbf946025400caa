"""What a recording costs beyond the parse of the library at its border, as a ratio of CPU times taken in turn.

`python -m sinan.experiments.benchmarks.reading FOLDER`, with pyulog, pymavlink and rosbags; FOLDER holds the data sets.
The ULogs are measured; dataflash, telemetry and bags are written here, a minute of an IMU at 200 Hz with what a vehicle
logs beside it.
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


def dataflash(path: Path) -> None:
    """Two IMUs, compass, barometer, attitude, outputs and battery in ArduPilot's binary form, at their usual rates."""
    kinds = {
        "IMU": (130, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
        "MAG": (131, "QBhhhhhhhhhBI", "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S"),
        "BARO": (132, "QBffcfIffB", "TimeUS,I,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,Health"),
        "ATT": (133, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
        "RCOU": (134, "QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
        "BAT": (135, "QBfffffcf", "TimeUS,Instance,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res"),
    }
    stored = {letter: letter for letter in "QBHhIf"} | {"c": "h", "C": "H", "n": "4s", "N": "16s", "Z": "64s"}
    packers = {name: struct.Struct("<" + "".join(stored[k] for k in form)) for name, (_, form, _) in kinds.items()}
    described = {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"), **kinds}
    parts = [
        b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, 3 + struct.calcsize("<" + "".join(map(stored.get, form))),  # type: ignore[arg-type]
                                      name.encode(), form.encode(), columns.encode())
        for name, (number, form, columns) in described.items()
    ]  # fmt: skip

    def add(name: str, *values: float) -> None:
        parts.append(b"\xa3\x95" + bytes([kinds[name][0]]) + packers[name].pack(*values))

    for k in range(int(SECONDS * RATE)):
        us = 10_000_000 + round(1e6 * k / RATE)
        for number in (0, 1):
            add("IMU", us, number, 0.01, 0.02, 0.03, 0.1, 0.2, -9.8, 0, 0, 41.5, 1, 1, 1000, 1000)
        if k % 8 == 0:
            add("ATT", us, 0, 100, 0, 200, 0, 9000, 0, 0, 3)
            add("RCOU", us, *[1500] * 8)
        if k % 20 == 0:
            add("MAG", us, 0, 210, -30, 420, 11, -22, 33, 0, 0, 0, 1, us // 1000)
            add("BARO", us, 0, 1.25, 95_000.0, 2350, 0.0, us // 1000, 0.0, 20.0, 1)
            add("BAT", us, 0, 15.2, 15.3, 12.0, 100.0, 1.0, 3000, 0.01)
    path.write_bytes(b"".join(parts))


def bag(path: Path, form: str) -> None:
    """A bag of `sensor_msgs/Imu`.

    Parameters
    ----------
    form : "ros1"; "sqlite3" or "mcap" of ROS 2
    """
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS1_NOETIC if form == "ros1" else Stores.ROS2_HUMBLE)
    kind = store.types
    vector, zeros = kind["geometry_msgs/msg/Vector3"], np.zeros(9)
    opened: Any
    if form == "ros1":
        opened = rosbag1.Writer(path)
    else:
        storage = rosbag2.StoragePlugin.SQLITE3 if form == "sqlite3" else rosbag2.StoragePlugin.MCAP
        opened = rosbag2.Writer(path, version=9, storage_plugin=storage)
    packed = store.serialize_ros1 if form == "ros1" else store.serialize_cdr
    with opened as writer:
        way = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        for k in range(int(SECONDS * RATE)):
            ns = 1_700_000_000_000_000_000 + round(1e9 * k / RATE)
            stamp = kind["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
            numbered = (k,) if form == "ros1" else ()
            head = kind["std_msgs/msg/Header"](*numbered, stamp, "imu")
            turn = kind["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            rate, force = vector(0.01, 0.02, 0.03), vector(0.1, 0.2, 9.8)
            message = kind["sensor_msgs/msg/Imu"](head, turn, zeros, rate, zeros, force, zeros)
            writer.write(way, ns, packed(message, "sensor_msgs/msg/Imu"))


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

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
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
        at = Path(made)
        telemetry(at / "flight.tlog")
        dataflash(at / "flight.bin")
        cases = [(path, pyulog) for path in sorted(folder.glob("px4_*/*.ulg"))]
        cases += [(at / "flight.tlog", pymavlink), (at / "flight.bin", pymavlink)]
        for name, form in (("flight.bag", "ros1"), ("sqlite3", "sqlite3"), ("mcap", "mcap")):
            bag(at / name, form)
            cases.append((at / name, rosbags))
        print("| log | MB | library | sinan / s | library / s | ratio |\n| --- | --- | --- | --- | --- | --- |")
        for path, library in cases:
            ours, theirs, ratio = compare(path, library)
            size = sum(one.stat().st_size for one in (path.iterdir() if path.is_dir() else (path,))) / 1e6
            print(f"| {path.name} | {size:.1f} | {library.__name__} | {ours:.3f} | {theirs:.3f} | {ratio:.2f} |")


if __name__ == "__main__":
    main()
