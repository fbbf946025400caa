"""Seeded damage to a file of every format: it is read, or it ends in one line that names the file, soon and in little.

Damage is what disks, links and editors do (bytes turned, cut out, doubled, zeroed, a file cut off) and what numbers and
brackets in a text can be made to say.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import re
import resource
import struct
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from sinan.experiments.gnss.reference import read_reference
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.formats.rinex import read_navigation, read_observations
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, SensorSpec, Stream
from tests.estimator import gnss_simulation as simulation
from tests.sensors import test_ardupilot as ardupilot
from tests.sensors import test_formats_logs as logs
from tests.sensors import test_tlog as tlog
from tests.sensors import test_ulog as ulog

CASES = int(os.environ.get("SINAN_CASES", "150"))  # of each format
SECONDS, MEGABYTES = 10.0, 400
TEXTS = [
    b"1e300",
    b"-1e300",
    b"nan",
    b"9" * 5000,
    b"[" * 3000,
    b'"',
    b"\x1b[2J",
    b"=",
    b"\0",
    b"1e-300",
    b",",
    b"-1",
    b"{}",
]
POSES = np.array([[0.0, 0.0, -9.8], [9.8, 0.0, 0.0], [0.0, 9.8, 0.1], [0.0, -9.8, 0.2], [1.0, 2.0, 9.0]])
T = np.arange(12) / 100.0
FLIGHT = Recording(
    "flight", "flight",
    {
        "imu": Stream(T, {name: 0.01 * T - 9.8 * (name == "accel_z") for name in (*ACCEL, *GYRO)}),
        "mag": Stream(T, dict.fromkeys(MAG, 0.5 + T)),
    },
    {"mag": SensorSpec(noise_std=0.01), "gyro": SensorSpec(noise_density=1e-3, bias_walk=1e-5)},
    effects={"mag.current": (0.1, 0.0, 0.0)},
)  # fmt: skip
TEXT = "t,x,y,z\n" + "".join(f"{k * 0.01:.2f},{0.1 * k:.3f},0.5,-9.8\n" for k in range(40))
MAP_OF_TEXT = """
kind = "poses"
[file]
header = true
member = "a"
[streams.poses]
time = "t"
accel = { columns = ["x", "y", "z"], unit = "m/s^2", axes = ["y", "x", "-z"], undo = { offset = [0, 0, 1.5] } }
drop = ["held value"]
keep = { column = "x", above = -1.0, below = 100.0 }
"""
MAP_OF_RECORDS = """
kind = "poses"
[file.records]
fields = [["magic", "uint16"], ["more", "uint8"], ["x", "float32"], ["y", "float32"], ["z", "float32"]]
magic = 42330
tail = [["h", "int32"]]
tail_if = "more"
[streams.poses]
accel = ["x", "y", "z"]
"""
MAP_OF_UBX = """
kind = "poses"
[streams.poses]
time = { column = "NAV-PVT.iTOW", unit = "ms" }
accel = ["NAV-PVT.velN", "NAV-PVT.velE", "NAV-PVT.velD"]
"""
MAP_OF_DATAFLASH = """
kind = "poses"
[streams.poses]
time = { column = "IMU.TimeUS", unit = "us" }
accel = ["IMU.X", "IMU.Y", "IMU.Z"]
"""
SCENARIO = """
like = "hover"
without = ["sonar"]
start = [0.0, 0.0, -10.0, 30.0]
[warming]
time_constant = 20.0
[sensors.mag]
rate = 20.0
noise_std = 0.01
dropouts = [[1.0, 2.0]]
[[manoeuvre]]
kind = "square"
laps = 2.0
duration = 8.0
[[manoeuvre]]
kind = "take_off"
spin_up = 1.0
duration = 5.0
"""


def zipped(method: int) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr("a", TEXT)
    return file.getvalue()


def matlab(**options: object) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, {"acc": POSES, "s": {"a": np.arange(3.0), "b": {"c": np.eye(2)}}}, **options)
    return file.getvalue()


def hdf5() -> bytes:
    h5py = pytest.importorskip("h5py")
    file = io.BytesIO()
    with h5py.File(file, "w") as container:
        container.create_dataset("acc", data=POSES, chunks=(2, 3), compression="gzip", shuffle=True)
        container["x"] = np.arange(5)
    return file.getvalue()


def ubx() -> bytes:
    messages = b""
    for k in range(3):
        body = (
            b"\x01\x07"
            + struct.pack("<H", 92)
            + struct.pack("<I", 1000 * k)
            + bytes(44)
            + struct.pack("<iii", 1, 2, k)
            + bytes(32)
        )
        a = b = 0
        for byte in body:
            a, b = (a + byte) & 0xFF, (b + a + byte) & 0xFF
        messages += b"\xb5\x62" + body + bytes((a, b))
    return messages


NAVIGATION = simulation.messages("GE")
OBSERVED = simulation.observe(NAVIGATION, simulation.START + 30.0 * np.arange(3))
OBSERVATION_3 = simulation.observation_3(OBSERVED).encode()
DATAFLASH = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\nFMT, 1, 9, IMU, Qfff, TimeUS,X,Y,Z\n" + "".join(
    f"IMU, {1000 * k}, 0.{k}, 0, -9.8\n" for k in range(9)
)
REFERENCE = "gps_week,tow_s,x,y,z,q\n" + "".join(f"2200,{k}.0,4e6,3e5,{4.9e6 + k},1\n" for k in range(9))


def read_mapped(rules: str) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        path.with_name("map.toml").write_text(rules)
        return open_log(path, path.with_name("map.toml"))

    return read


def read_map(path: Path) -> object:
    path.with_name("log").write_text(TEXT)
    return open_log(path.with_name("log"), path)


def read_scenario(path: Path) -> object:
    place = path.with_suffix(".toml")
    place.write_bytes(path.read_bytes())
    return load_scenario(place)


def within(name: str) -> Callable[[Path], object]:
    """The damaged file in the place of one of a recording's."""

    def read(path: Path) -> object:
        folder = path.with_name("recording")
        if not folder.is_dir():
            write_recording(FLIGHT, folder)
        before = (folder / name).read_bytes()
        try:
            (folder / name).write_bytes(path.read_bytes())
            return read_recording(folder)
        finally:
            (folder / name).write_bytes(before)

    return read


def written(name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write_recording(FLIGHT, Path(folder) / "a")
        return (Path(folder) / "a" / name).read_bytes()


def crx() -> bytes:
    return bytes(pytest.importorskip("hatanaka").rnx2crx(OBSERVATION_3))


def compress() -> bytes:
    return bytes(pytest.importorskip("ncompress").compress(OBSERVATION_3))


def parquet() -> bytes:
    pa, written = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    file = io.BytesIO()
    columns = {"t": 1.0 * np.arange(40), "ax": np.zeros(40), "ay": np.zeros(40), "az": np.full(40, -9.8)}
    written.write_table(pa.table(columns), file)
    return file.getvalue()


FORMATS: dict[str, tuple[Callable[[], bytes], Callable[[Path], object]]] = {
    "recording.toml": (lambda: written("recording.toml"), within("recording.toml")),
    "imu.csv": (lambda: written("imu.csv"), within("imu.csv")),
    "text": (TEXT.encode, read_mapped(MAP_OF_TEXT)),
    "gzip": (lambda: gzip.compress(TEXT.encode()), read_mapped(MAP_OF_TEXT)),
    "bzip2": (lambda: bz2.compress(TEXT.encode()), read_mapped(MAP_OF_TEXT)),
    "xz": (lambda: lzma.compress(TEXT.encode()), read_mapped(MAP_OF_TEXT)),
    "zip": (lambda: zipped(zipfile.ZIP_DEFLATED), read_mapped(MAP_OF_TEXT)),
    "zip of bzip2": (lambda: zipped(zipfile.ZIP_BZIP2), read_mapped(MAP_OF_TEXT)),
    "zip of LZMA": (lambda: zipped(zipfile.ZIP_LZMA), read_mapped(MAP_OF_TEXT)),
    "MATLAB 5": (matlab, open_log),
    "MATLAB 5, compressed": (lambda: matlab(do_compression=True), open_log),
    "MATLAB 7.3": (hdf5, open_log),
    "ULog": (lambda: ulog.HEAD + b"".join(map(ulog.reading, range(30))), open_log),
    "MWLOG": (
        lambda: struct.pack("<8sIBBH", b"MWLOGV01", 0, 3, 2, 12) + POSES.astype("<f4").tobytes(),
        read_mapped('kind = "poses"\n[streams.poses]\naccel = [1, 2, 3]\n'),
    ),
    "records": (
        lambda: b"".join(
            struct.pack("<HBfff", 42330, k % 2, k, 0, -9.8) + bytes(4) * (k % 2) for k in range(9)
        ),
        read_mapped(MAP_OF_RECORDS),
    ),
    "UBX": (ubx, read_mapped(MAP_OF_UBX)),
    "UBX, by its own names": (lambda: b"".join(map(logs.solution, range(0, 9000, 1000))), open_log),
    "dataflash": (DATAFLASH.encode, read_mapped(MAP_OF_DATAFLASH)),
    "dataflash, by its own names": (lambda: ardupilot.text(ardupilot.flight()), open_log),
    "dataflash, binary": (lambda: ardupilot.binary(ardupilot.flight()), open_log),
    "dataflash, binary, raw": (
        lambda: ardupilot.binary(ardupilot.compensated(ardupilot.COMPASS | ardupilot.INERTIAL)[0]),
        lambda path: open_log(path, choice=Choice(raw=True)),
    ),
    "named columns": (lambda: b"t_ms,ax,ay,az,gx,gy,gz,mag x [uT],my [uT],mz [uT]\n" + b"".join(
        b"%d,0.1,0.2,-9.8,0,0,0.1,20,%d,40\n" % (10 * k, k) for k in range(40)), open_log),
    "dates and units": (lambda: b"device 7\ntime,ax,ay,az,gx,gy,gz\n-,g,g,g,deg/s,deg/s,deg/s\n" + b"".join(
        b"2023-05-05 12:00:00.%03d,0.1,0.2,-1.0,0,0,0.1\n" % (10 * k) for k in range(40)), open_log),
    "Parquet": (parquet, open_log),
    "telemetry": (lambda: tlog.written(tlog.flight()), open_log),
    "map": (MAP_OF_TEXT.encode, read_map),
    "map of records": (MAP_OF_RECORDS.encode, read_map),
    "scenario": (SCENARIO.encode, read_scenario),
    "RINEX 3": (lambda: OBSERVATION_3, read_observations),
    "RINEX 2": (lambda: simulation.observation_2(OBSERVED).encode(), read_observations),
    "compact RINEX": (crx, read_observations),
    "RINEX in .Z": (compress, read_observations),
    "navigation 3": (lambda: simulation.navigation_3(NAVIGATION).encode(), read_navigation),
    "navigation 2": (lambda: simulation.navigation_2(simulation.messages("G")).encode(), read_navigation),
    "positions": (REFERENCE.encode, read_reference),
}  # fmt: skip


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """The file with one to three kinds of damage, each somewhere."""
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, len(data) + 1))
        size = int(rng.choice([1, 1, 2, 4, 8, 100]))
        kind = rng.integers(0, 8)
        if kind == 0:
            data = data[:at]
        elif kind == 1:
            data = data[:at] + data[at + size :]
        elif kind == 2:
            data = data[:at] + rng.bytes(size) + data[at + size :]
        elif kind == 3:
            data = data[:at] + data[at : at + size] * 2 + data[at + size :]
        elif kind == 4:
            data = data[:at] + bytes([int(rng.choice([0, 255]))]) * size + data[at + size :]
        elif kind == 5:
            data = data[:at] + TEXTS[int(rng.integers(len(TEXTS)))] + data[at + size :]
        elif kind == 6 and at < len(data):
            data = data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
        else:
            data = _with_another_number(data, rng)
        data = data or b"x"
    return data


def _with_another_number(data: bytes, rng: np.random.Generator) -> bytes:
    """One of the numbers of a text, or the text between two commas, is another."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?", data[:100_000]))
    if not found:
        return data
    match = found[int(rng.integers(len(found)))]
    return data[: match.start()] + TEXTS[int(rng.integers(len(TEXTS)))] + data[match.end() :]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("error")
def test_damage_ends_in_a_line_that_names_the_file(tmp_path: Path, name: str) -> None:
    make, read = FORMATS[name]
    good = make()
    path = tmp_path / "damaged"
    path.write_bytes(good)
    if name != "map of records":  # of another log
        read(path)
    highest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused = 0
    for seed in range(CASES):
        path.write_bytes(damaged(good, np.random.default_rng([seed, len(name)])))
        begin = time.process_time()
        try:
            read(path)
        except InputError as error:
            refused += 1
            text = str(error)
            assert str(tmp_path) in text, seed
            assert text.isprintable(), seed
            assert "; expected " in text, seed
            assert len(text) < 6000, seed
        except BaseException as error:
            raise AssertionError(f"seed {seed}") from error
        assert time.process_time() - begin < SECONDS, seed
    assert refused > CASES // 200
    if name != "MATLAB 7.3":
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - highest < 1024 * MEGABYTES
