"""Folders of well-known data sets: EuRoC and TUM-VI (`mav0/imu0/data.csv`), KITTI (`oxts/data/*.txt`).

Sources: M. Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016 (ASL format); D. Schubert et al., "The
TUM VI benchmark", IROS 2018; A. Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 2013, and its
`dataformat.txt`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.formats.column_names import meaning
from sinan.sensors.formats.columns import FileOptions, names_of, read_columns
from sinan.sensors.formats.facts import Facts
from sinan.sensors.formats.logged import FRD_OF_FLU, NED_OF_ENU, recording_of, turned
from sinan.sensors.formats.packed import read_plain, require_numbers
from sinan.sensors.recording import (
    ACCEL,
    GEODETIC,
    GYRO,
    POSITION,
    QUATERNION,
    VELOCITY,
    Recording,
    SensorSpec,
    Stream,
)
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_matrix, quaternion_from_rpy

_NANOSECOND = 1e-9
#: Forward-right-down of forward-left-up; north-east-down of east-north-up; forward-right-down of a camera that looks
#: forward (its x to the right, y down, z forward).
_OF_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: Where the ground truth of EuRoC, its raw cameras, and TUM-VI's are.
_TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")
_LARGEST_TEXT = 2**20
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_STAMP = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(?:\.\d{1,9})?")
#: Columns of a KITTI file, by their place.
_KITTI = 30
_LLA, _RPY, _V_NE, _V_UP, _ACCEL, _GYRO = (0, 1, 2), (3, 4, 5), (6, 7), 10, (11, 12, 13), (17, 18, 19)
_POSITION_STD, _VELOCITY_STD = 23, 24


def kind_of_folder(path: Path) -> str:
    """euroc, kitti, or empty: none of them."""
    if _euroc_root(path) is not None:
        return "euroc"
    return "kitti" if _kitti_root(path) is not None else ""


def _euroc_root(path: Path) -> Path | None:
    return next((root for root in (path, path / "mav0") if (root / "imu0" / "data.csv").is_file()), None)


def _kitti_root(path: Path) -> Path | None:
    return next((root for root in (path / "oxts", path)
                 if (root / "data").is_dir() and (root / "timestamps.txt").is_file()), None)  # fmt: skip


def folder_facts(path: Path) -> Facts:
    """What a folder is."""
    return Facts("EuRoC or TUM-VI folder" if kind_of_folder(path) == "euroc" else "KITTI oxts folder")


def read_euroc(path: Path, choice: Choice = FIRST) -> Recording:
    """The IMU of a folder in ASL's format, with the noise that `sensor.yaml` declares, and its ground truth.

    The body is turned so that the camera looks forward (`cam0/sensor.yaml`, or `dso/camchain.yaml`), by quarter turns
    alone: readings stay those of one axis each. The world's z is up; its heading is arbitrary. Neglected: images.

    Raises
    ------
    InputError : a file that is damaged, a sensor that is not there
    """
    choice.require_none(path, "with one IMU")
    root = _euroc_root(path)
    if root is None:
        raise InputError(path, "no imu0/data.csv", "a folder in ASL's format")
    C, notes = _to_body(root)
    table = _table(root / "imu0" / "data.csv", lambda name: one.column if (one := meaning(name)) else None)
    missing = [name for name in ("t", *ACCEL, *GYRO) if name not in table]
    if missing:
        raise InputError(root / "imu0" / "data.csv", f"no {', '.join(missing)}", "timestamp, w_RS_S, a_RS_S", "line 1")
    axes = np.hstack([turned(C, _three(table, names)) for names in (ACCEL, GYRO)])
    imu = Stream(table["t"] * _NANOSECOND, dict(zip((*ACCEL, *GYRO), axes.T, strict=True)))
    return recording_of(path, {"imu": imu}, _truth(root, C), _noise(root / "imu0" / "sensor.yaml"), notes,
                        reference="cameras")  # fmt: skip


def _three(table: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    return np.stack([table[name] for name in names], axis=-1)


def _table(path: Path, called: object) -> dict[str, FloatArray]:
    """The columns of a CSV by what their names are called; others left out."""
    wanted = {name: column for name in names_of(path) if (column := called(name)) is not None}  # type: ignore[operator]
    columns = read_columns(path, FileOptions(header=True), list(wanted))
    return {column: columns[name] for name, column in wanted.items()}


def _state_column(name: str) -> str | None:
    """What a column of a ground truth is called here."""
    words = name.strip().lstrip("#").strip().lower()
    if words.startswith("timestamp"):
        return "t"
    found = re.match(r"([pqv])_rs(?:_r)?_([wxyz])\b", words)
    return f"{found[1]}{found[2]}" if found else None


def _truth(root: Path, C: FloatArray) -> Stream | None:
    """Pose and velocity of the IMU in the world, as body in NED."""
    file = next((file for name in _TRUTHS if (file := root / name / "data.csv").is_file()), None)
    if file is None:
        return None
    table = _table(file, _state_column)
    if not {"t", "px", "py", "pz", "qw", "qx", "qy", "qz"} <= set(table):
        raise InputError(file, f"columns {', '.join(table)}", "timestamp, p_RS_R, q_RS", "line 1")
    columns = dict(zip(POSITION, turned(NED_OF_ENU, _three(table, ("px", "py", "pz"))).T, strict=True))
    if {"vx", "vy", "vz"} <= set(table):
        columns |= dict(zip(VELOCITY, turned(NED_OF_ENU, _three(table, ("vx", "vy", "vz"))).T, strict=True))
    q = _three(table, ("qw", "qx", "qy", "qz"))
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(q, axis=1)
    good = (norm > 0.5) & (norm < 2.0)
    unit = np.where(good[:, None], q, [1.0, 0.0, 0.0, 0.0]) / np.where(good, norm, 1.0)[:, None]
    C_nb = NED_OF_ENU @ matrix_from_quaternion(unit) @ C.T
    columns |= dict(zip(QUATERNION, np.where(good[:, None], quaternion_from_matrix(C_nb), np.nan).T, strict=True))
    return Stream(table["t"] * _NANOSECOND, columns)


def _to_body(root: Path) -> tuple[FloatArray, list[str]]:
    """(3, 3) quarter turns from the IMU's axes to forward-right-down, by the camera; none where nobody says."""
    camera = root / "cam0" / "sensor.yaml"
    chain = root.parent / "dso" / "camchain.yaml"
    if camera.is_file():
        T = _matrix(camera, "T_BS")
        C_cam_imu = None if T is None else T[:3, :3].T
    elif chain.is_file():
        T = _matrix(chain, "T_cam_imu")
        C_cam_imu = None if T is None else T[:3, :3]
    else:
        C_cam_imu = None
    nearest = None if C_cam_imu is None else _quarter_turns(_OF_CAMERA @ C_cam_imu)
    if nearest is None:
        return np.eye(3), ["axes are those of the IMU: no cam0/sensor.yaml says which way is forward"]
    return nearest, ["axes: forward is where cam0 looks, by quarter turns of the IMU's"]


def _quarter_turns(C: FloatArray) -> FloatArray | None:
    """The rotation by quarter turns that is nearest; None: none is near, or it is no rotation."""
    nearest = np.zeros((3, 3))
    for k in range(3):
        longest = int(np.argmax(np.abs(C[k])))
        nearest[k, longest] = np.sign(C[k, longest])
    return nearest if np.isclose(np.linalg.det(nearest), 1.0) else None


def _yaml_text(path: Path) -> str:
    text = read_plain(path, _LARGEST_TEXT).decode("utf-8", "replace")
    return "\n".join(line.split("#")[0] for line in text.splitlines())


def _matrix(path: Path, name: str) -> FloatArray | None:
    """(4, 4) the first matrix of a name in a YAML file, a list of 16 numbers or of four lists."""
    found = re.search(rf"\b{name}\s*:(.{{0,2000}})", _yaml_text(path), re.DOTALL)
    if found is None:
        return None
    numbers = re.findall(rf"(?:(?<=[\[,\s])|^){_NUMBER}(?=[\],\s])", found[1].partition("data:")[2] or found[1])[:16]
    return np.array(numbers, dtype=np.float64).reshape(4, 4) if len(numbers) == 16 else None


def _noise(path: Path) -> dict[str, SensorSpec]:
    """The white noise and the random walk of the bias that a `sensor.yaml` declares."""
    if not path.is_file():
        return {}
    text = _yaml_text(path)

    def number(name: str) -> float | None:
        found = re.search(rf"^\s*{name}\s*:\s*({_NUMBER})\s*$", text, re.MULTILINE)
        return float(found[1]) if found and 0.0 < float(found[1]) < 1e12 else None

    specs = {}
    for sensor, name in (("accel", "accelerometer"), ("gyro", "gyroscope")):
        density, walk = number(f"{name}_noise_density"), number(f"{name}_random_walk")
        if density is not None or walk is not None:
            specs[sensor] = SensorSpec(noise_density=density, bias_walk=walk)
    return specs


def read_kitti(path: Path, choice: Choice = FIRST) -> Recording:
    """The inertial unit of a KITTI drive: force and rate, its fused position and velocity as `gps`, its attitude as a
    reference of kind `rtk`; x forward, y left, z up are turned into forward-right-down.

    Raises
    ------
    InputError : a file that is damaged, as many times as files
    """
    choice.require_none(path, "with one IMU")
    root = _kitti_root(path)
    if root is None:
        raise InputError(path, "no data folder with a timestamps.txt beside it", "the oxts folder of a KITTI drive")
    files = sorted((root / "data").glob("*.txt"))
    require_numbers(path, len(files) * _KITTI)
    table = np.array([_kitti_row(file) for file in files]).reshape(-1, _KITTI)
    t = _kitti_times(root / "timestamps.txt")
    if len(t) != len(table) or len(t) == 0:
        raise InputError(root, f"{len(table)} files and {len(t)} times", "one time a file", "timestamps.txt")
    axes = np.hstack([turned(FRD_OF_FLU, table[:, columns]) for columns in (_ACCEL, _GYRO)])
    gps = dict(zip(GEODETIC, table[:, _LLA].T, strict=True))
    gps |= dict(zip(VELOCITY, (table[:, _V_NE[0]], table[:, _V_NE[1]], -table[:, _V_UP]), strict=True))
    gps |= {"eph": table[:, _POSITION_STD], "s_variance": table[:, _VELOCITY_STD]}
    C = NED_OF_ENU @ matrix_from_quaternion(quaternion_from_rpy(table[:, _RPY])) @ FRD_OF_FLU
    attitude = dict(zip(QUATERNION, quaternion_from_matrix(C).T, strict=True))
    found = {"imu": Stream(t, dict(zip((*ACCEL, *GYRO), axes.T, strict=True))), "gps": Stream(t, gps)}
    notes = ["gps: the inertial unit's own fused position and velocity"]
    return recording_of(path, found, Stream(t, attitude), {}, notes, reference="rtk")


def _kitti_row(path: Path) -> list[float]:
    try:
        row = [float(cell) for cell in read_plain(path, _LARGEST_TEXT).split()]
    except ValueError as error:
        raise InputError(path, str(error), f"{_KITTI} numbers") from None
    if len(row) != _KITTI:
        raise InputError(path, f"{len(row)} numbers", f"{_KITTI}, as dataformat.txt says")
    return row


def _kitti_times(path: Path) -> FloatArray:
    """(n,) seconds after the first."""
    lines = read_plain(path, 64 * _LARGEST_TEXT).decode("ascii", "replace").split("\n")
    stamps = [line.strip() for line in lines if line.strip()]
    if not all(map(_STAMP.fullmatch, stamps)):
        raise InputError(path, "a line that is no time", "2011-09-26 13:02:25.594360375, one a line")
    try:
        t = np.array(stamps, dtype="datetime64[ns]")
    except ValueError as error:
        raise InputError(path, str(error), "times that are") from None
    return (t - t[:1]).astype(np.int64) * _NANOSECOND
