"""Folders of EuRoC, TUM-VI and KITTI, written as their documents say: axes by physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.recording import ACCEL, GYRO, POSITION, VELOCITY
from sinan.sensors.rotation import matrix_from_quaternion, rpy_from_quaternion

GRAVITY = 9.80665
START = 1_403_636_579_758_555_392
IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
TRUTH_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1]"
)
IMU_YAML = """%YAML:1.0
sensor_type: imu
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]
gyroscope_random_walk: 1.9393e-05       # [ rad / s^2 / sqrt(Hz) ]
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
"""
CAMERA_YAML = """#Default camera
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
"""
#: The IMU's x points up, y to the right, z forward; a level body that looks north (the world's y): from IMU to world.
LEVEL = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def quaternion(C: np.ndarray) -> list[float]:
    """Of a matrix whose trace is above -1, scalar first."""
    w = 0.5 * np.sqrt(1.0 + np.trace(C))
    return [w, *(np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) / (4.0 * w))]


def euroc(folder: Path, truth: str = "state_groundtruth_estimate0") -> Path:
    """A second at rest, level, that turns to the right at 0.5 rad/s: about down, which is -x of the IMU."""
    imu = folder / "mav0" / "imu0"
    imu.mkdir(parents=True)
    rows = [f"{START + 5_000_000 * k},-0.5,0,0,{GRAVITY},0,0" for k in range(200)]
    (imu / "data.csv").write_text("\n".join([IMU_HEADER, *rows]) + "\n")
    (imu / "sensor.yaml").write_text(IMU_YAML)
    place = folder / "mav0" / truth
    place.mkdir()
    values = ",".join(f"{x:.12g}" for x in (1, 2, 3, *quaternion(LEVEL), 0.1, 0.2, 0.3, 0))
    rows = [f"{START + 5_000_000 * k},{values}" for k in range(200)]
    (place / "data.csv").write_text("\n".join([TRUTH_HEADER, *rows]) + "\n")
    return folder


def with_camera(folder: Path) -> Path:
    (folder / "mav0" / "cam0").mkdir()
    (folder / "mav0" / "cam0" / "sensor.yaml").write_text(CAMERA_YAML)
    return folder


def with_chain(folder: Path) -> Path:
    """TUM-VI's way: camera from IMU, four lists."""
    rows = "".join(
        f"  - [{', '.join(map(str, row))}]\n"
        for row in ([0.0, 1.0, 0.0, 0.04], [-1.0, 0.0, 0.0, -0.05], [0.0, 0.0, 1.0, -0.06], [0.0, 0.0, 0.0, 1.0])
    )
    (folder / "dso").mkdir()
    (folder / "dso" / "camchain.yaml").write_text(f"cam0:\n  T_cam_imu:\n{rows}  cam_overlaps: [1]\n")
    return folder


@pytest.mark.parametrize("camera", [with_camera, with_chain])
@pytest.mark.parametrize("part", ["", "mav0"])
def test_a_level_body_that_turns_right(tmp_path: Path, camera: object, part: str) -> None:
    recording = open_log(camera(euroc(tmp_path)) / part)  # type: ignore[operator]
    imu = recording.streams["imu"]
    np.testing.assert_allclose(imu.t, 0.005 * np.arange(200), atol=1e-6)
    np.testing.assert_allclose(imu.array(ACCEL)[0], [0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(imu.array(GYRO)[0], [0.0, 0.0, 0.5])
    assert recording.truth is not None
    assert (recording.truth.kind, recording.truth.known) == ("cameras", ("position", "velocity", "attitude"))
    truth = recording.truth.stream
    np.testing.assert_allclose(rpy_from_quaternion(truth.array(("qw", "qx", "qy", "qz")))[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(truth.array(POSITION)[0], [2.0, 1.0, -3.0])
    np.testing.assert_allclose(truth.array(VELOCITY)[0], [0.2, 0.1, -0.3])


def test_the_noise_that_is_declared(tmp_path: Path) -> None:
    recording = open_log(with_camera(euroc(tmp_path)))
    assert (recording.spec("gyro").noise_density, recording.spec("gyro").bias_walk) == (1.6968e-4, 1.9393e-5)
    assert (recording.spec("accel").noise_density, recording.spec("accel").bias_walk) == (2e-3, 3e-3)
    facts = facts_of(tmp_path)
    assert facts is not None
    assert facts.format == "EuRoC or TUM-VI folder"


def test_without_a_camera_the_axes_are_the_imus(tmp_path: Path) -> None:
    recording = open_log(euroc(tmp_path, "mocap0"))
    np.testing.assert_allclose(recording.streams["imu"].array(ACCEL)[0], [GRAVITY, 0.0, 0.0])
    assert any("axes are those of the IMU" in note for note in recording.notes)
    assert recording.truth is not None
    C_nb = matrix_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))[0]
    np.testing.assert_allclose(C_nb @ [GRAVITY, 0.0, 0.0], [0.0, 0.0, -GRAVITY], atol=1e-6)  # up in the world


def kitti(folder: Path, yaw: float = 0.5 * np.pi, pitch: float = 0.0, roll: float = 0.0) -> Path:
    """Ten rows, 0.1 s apart, of a car at rest: heading north where yaw, from east to the left, is 90 deg."""
    data = folder / "oxts" / "data"
    data.mkdir(parents=True)
    # Force upward in x forward, y left, z up: the last row of Rz(yaw) Ry(pitch) Rx(roll)
    up = np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    for k in range(10):
        row = [49.0, 8.4, 112.8, roll, pitch, yaw, 3.0, 4.0, 5.0, 0.0, 0.25, *(GRAVITY * up), 0, 0, 0, 0.01, 0.02, 0.03,
               0, 0, 0, 0.05, 0.01, 4, 9, 6, 6, 6]  # fmt: skip
        (data / f"{k:010}.txt").write_text(" ".join(map(str, row)))
    stamps = [f"2011-09-26 13:02:{25.594360375 + 0.1 * k:.9f}" for k in range(10)]
    (folder / "oxts" / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    return folder


@pytest.mark.parametrize(
    ("attitude", "force", "rpy"),
    [
        ({}, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)),
        ({"pitch": -0.3}, (np.sin(0.3), 0.0, -np.cos(0.3)), (0.0, 0.3, 0.0)),  # positive: front down, says KITTI
        ({"roll": 0.2}, (0.0, -np.sin(0.2), -np.cos(0.2)), (0.2, 0.0, 0.0)),  # positive: left side up
        ({"yaw": 0.0}, (0.0, 0.0, -1.0), (0.0, 0.0, 0.5 * np.pi)),
    ],
    ids=["level", "nose up", "left side up", "east"],
)
def test_a_car_at_rest(
    tmp_path: Path, attitude: dict[str, float], force: tuple[float, ...], rpy: tuple[float, ...]
) -> None:
    recording = open_log(kitti(tmp_path, **attitude))
    imu = recording.streams["imu"]
    np.testing.assert_allclose(imu.t, 0.1 * np.arange(10), atol=1e-6)
    np.testing.assert_allclose(imu.array(ACCEL)[0], GRAVITY * np.array(force), atol=1e-9)
    np.testing.assert_allclose(imu.array(GYRO)[0], [0.01, -0.02, -0.03])
    assert recording.truth is not None
    assert recording.truth.kind == "rtk"
    np.testing.assert_allclose(
        rpy_from_quaternion(recording.truth.stream.array(("qw", "qx", "qy", "qz")))[0], rpy, atol=1e-9
    )
    gps = recording.streams["gps"]
    np.testing.assert_allclose(gps.array(VELOCITY)[0], [3.0, 4.0, -0.25])
    assert recording.origin == pytest.approx((49.0, 8.4, 112.8))
    assert gps["eph"][0] == 0.05


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("oxts/data/0000000003.txt", "1 2 3", "3 numbers; expected 30"),
        ("oxts/data/0000000003.txt", "1 x", "could not convert"),
        ("oxts/timestamps.txt", "today\n", "a line that is no time"),
        ("oxts/timestamps.txt", "2011-09-26 13:02:25.5\n", "10 files and 1 times"),
    ],
)
def test_a_damaged_drive(tmp_path: Path, file: str, text: str, expected: str) -> None:
    (kitti(tmp_path) / file).write_text(text)
    with pytest.raises(InputError, match=expected):
        open_log(tmp_path)


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("imu0/data.csv", "#timestamp [ns],w_RS_S_x [rad s^-1]\n1,2\n", "no accel_x"),
        ("imu0/data.csv", IMU_HEADER + "\n1,2,x,4,5,6,7\n", "imu0/data.csv"),
        ("imu0/data.csv", "", "no text|an empty file"),
        ("state_groundtruth_estimate0/data.csv", "#timestamp,p_RS_R_x [m]\n1,2\n", "expected timestamp, p_RS_R, q_RS"),
    ],
)
def test_a_damaged_folder(tmp_path: Path, file: str, text: str, expected: str) -> None:
    (euroc(tmp_path) / "mav0" / file).write_text(text)
    with pytest.raises(InputError, match=expected):
        open_log(tmp_path)


def test_there_is_one_imu(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="with one IMU"):
        open_log(euroc(tmp_path), choice=Choice(imu=1))
