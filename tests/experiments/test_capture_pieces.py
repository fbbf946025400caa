"""The pieces of a capture by themselves: its clock, the poses of the course's own readings, parameters, files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from sinan.calibration.poses.triad import calibrate_norm
from sinan.experiments.autopilots.calibrated import calibration_params, parameter_names
from sinan.experiments.autopilots.files import as_file
from sinan.experiments.capture.clock import LiveClock, Message
from sinan.experiments.capture.faces import FaceWatch
from sinan.experiments.capture.link import open_link
from sinan.experiments.capture.poses import POSES, PoseWatch
from sinan.experiments.capture.vehicle import Vehicle
from sinan.experiments.commands.cli import app
from sinan.sensors.errors import InputError
from sinan.sensors.formats.mwlog import read_mwlog
from tests.experiments.test_autopilots import (
    ARDUPILOT_MAG,
    IMUS,
    PX4_MAG,
    ardupilot_mag,
    of_file,
    px4_mag,
)

G = 9.80665
MILLISECOND = 1e-3
Arrival = tuple[float, float | None]


def stamped(arrivals: Sequence[Arrival], said: list[str] | None = None) -> list[tuple[float | None, float]]:
    """Own clock and time of each message that was stamped; arrivals count from the beginning."""
    clock = LiveClock(1000.0, [].append if said is None else said.append)
    found: list[Message] = []
    for arrived, own in arrivals:
        found += clock.stamp(Message(1000.0 + arrived, "RAW_IMU", b"", own))
    return [(one.own, one.t) for one in found + clock.settle()]


def test_times_are_the_vehicles_own_whatever_the_delay() -> None:
    """50 a second, 10 to 60 ms late; one that has no clock lies where it came less the least delay."""
    rng = np.random.default_rng(1)
    own = 70.0 + 0.02 * np.arange(500)
    late = 0.01 + 0.05 * rng.random(500)
    late[3] = 0.01
    found = stamped([(t - 70.0 + d, t) for t, d in zip(own, late, strict=True)] + [(10.05, None)])
    t = np.array([at for _, at in found])
    np.testing.assert_allclose(np.diff(t[:-1]), 0.02, atol=1e-9)
    assert t[0] == pytest.approx(0.01, abs=MILLISECOND)
    assert t[-1] == pytest.approx(10.05, abs=MILLISECOND)


def test_a_burst_after_a_pause_keeps_its_times() -> None:
    """Five seconds are held up and come within a moment: longer than what is taken for a delay at once."""
    own = 0.02 * np.arange(1, 751)
    arrived = np.where((own > 5.0) & (own < 10.0), 10.0 + 1e-5 * own, own)
    said: list[str] = []
    found = stamped(list(zip(arrived.tolist(), own.tolist(), strict=True)), said)
    assert said == []
    np.testing.assert_allclose(np.diff([t for _, t in found]), 0.02, atol=1e-9)


@pytest.mark.parametrize("to", [1.0, 90.0, 4000.0])
def test_a_clock_that_jumps(to: float) -> None:
    """A restart, a small step back, a leap: time goes on, and the steps beyond are right again."""
    before = [(0.02 * k, 100.0 + 0.02 * k) for k in range(250)]
    after = [(5.0 + 0.02 * k, to + 0.02 * k) for k in range(250)]
    said: list[str] = []
    found = stamped(before + after, said)
    assert len(said) == 1
    assert f"to {to:.1f} s" in said[0]
    t = np.array([at for _, at in found])
    assert len(t) == 500
    assert np.all(np.diff(t) > -1e-9)
    np.testing.assert_allclose(t[250:], 5.0 + 0.02 * np.arange(250), atol=0.03)


def test_one_wrong_stamp_costs_one_message() -> None:
    good = [(0.02 * k, 100.0 + 0.02 * k) for k in range(250)]
    said: list[str] = []
    found = stamped([*good[:100], (2.0, 9.0e4), *good[100:]], said)
    assert said == []
    np.testing.assert_allclose(np.diff([t for _, t in found]), 0.02, atol=1e-9)
    assert len(found) == 250


def test_the_poses_of_the_courses_own_readings(measured_data: Path) -> None:
    """Nine of the ten; of the tenth the readings have none: its authors showed the right side twice, 5 deg apart."""
    columns = read_mwlog(measured_data / "rfly_course" / "e_acc1_A.bin")
    readings = np.stack([columns[k] for k in "123"], axis=-1)
    said: list[str] = []
    watch = PoseWatch(said.append)
    for k, reading in enumerate(readings):
        watch.add(0.004 * k, reading, np.zeros(3))
    assert watch.wanted == ["right side down by 45 deg"]
    assert any("refused: on its right side was shown before, 5 deg from this" in line for line in said)
    theirs = loadmat(measured_data / "rfly_course" / "AccRaw.mat")["AccRaw"].T
    theirs = theirs * [0.992, 0.999, 0.994] - [-0.006, -0.265, -0.136]  # as PX4 corrected the log
    ours = np.array([watch.taken[name].mean for name in POSES if name in watch.taken])
    nearest = np.min(np.linalg.norm(ours[:, None] - theirs[None], axis=2), axis=1)
    assert np.max(nearest) < 1.0  # m/s^2; a hand holds no pose for long


@pytest.mark.parametrize(
    ("moves", "word"),
    [(lambda t: np.array([0.0, 0.4 * np.sin(40.0 * t), -G]), "to and fro"),
     (lambda t: np.array([0.0, G * np.sin(0.2 * t), -G * np.cos(0.2 * t)]), "it turns")],
)  # fmt: skip
def test_what_moves_is_refused(moves: Callable[[float], np.ndarray], word: str) -> None:
    """Still for 0.6 s, then shaken by a hand, or turned slowly."""
    said: list[str] = []
    watch = PoseWatch(said.append)
    for k in range(300):
        t = 0.01 * k
        assert watch.add(t, np.array([0.0, 0.0, -G]) if t < 0.6 else moves(t - 0.6), np.zeros(3)) is None
    assert len(said) == 1
    assert said[0].startswith("refused: moved after")
    assert word in said[0]


def test_a_pose_between_two_is_refused() -> None:
    said: list[str] = []
    watch = PoseWatch(said.append)
    tilt = np.radians(140.0)
    for k in range(200):
        watch.add(0.01 * k, G * np.array([np.sin(tilt), 0.0, -np.cos(tilt)]), np.zeros(3))
    assert said[0].startswith("refused: 40 deg from")
    assert watch.taken == {}


def test_faces_are_counted_about_the_vertical_whatever_the_offset() -> None:
    """A hard iron of half the field; a face is done with its whole turn, and half of one is told."""
    said: list[str] = []
    watch = FaceWatch(said.append)
    field, offset = np.array([0.2, 0.0, 0.45]), np.array([0.2, -0.15, 0.1])
    for face, angles in (((0.0, 0.0), 360.0), ((180.0, 0.0), 360.0), ((90.0, 0.0), 180.0)):
        for yaw in np.radians(np.arange(0.0, angles, 5.0)):
            C = _attitude(np.radians(face[0]), np.radians(face[1]), yaw)
            watch.add(C.T @ [0.0, 0.0, -G], C.T @ field + offset)
    watch.update()
    assert (
        "on its right side (4 of 8 headings)" in watch.wanted or "on its right side (3 of 8 headings)" in watch.wanted
    )
    assert [line.split(";")[0] for line in said] == ["turned round: level", "turned round: upside down"]


def _attitude(roll: float, pitch: float, yaw: float) -> np.ndarray:
    from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_rpy

    return matrix_from_quaternion(quaternion_from_rpy(np.array([roll, pitch, yaw])))


# --- parameters, against the corrections that the autopilots document ---------------------------------------


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("axes", ["none", "triangular"])
def test_a_compass_that_is_mounted_turned_and_was_calibrated_before(autopilot: str, axes: str) -> None:
    """What the new parameters make of the chip's readings has one length, and the calibration's, but for a turn."""
    correct, before = {"px4": (px4_mag, PX4_MAG), "ardupilot": (ardupilot_mag, ARDUPILOT_MAG)}[autopilot]
    before = {**before, **dict.fromkeys(("CAL_MAG_COMP_TYP", "COMPASS_MOTCT"), 0.0)}
    rng = np.random.default_rng(4)
    directions = rng.standard_normal((400, 3))
    raw = 0.5 * directions / np.linalg.norm(directions, axis=1)[:, None] * [1.05, 0.95, 1.0] + [0.1, -0.07, 0.04]
    none = np.zeros(len(raw))
    sent = correct(raw, none, before)
    norm = float(np.mean(np.linalg.norm(sent, axis=1)))
    result = calibrate_norm("mag", sent / norm, 1.0, axes, normalised_by=norm)  # type: ignore[arg-type]
    params = calibration_params(autopilot, "mag", result, before)
    new = correct(raw, none, {**before, **of_file(as_file(params))})
    length = np.linalg.norm(new, axis=1)
    wanted = np.linalg.norm(result.apply(sent), axis=1) * norm
    np.testing.assert_allclose(length, wanted, atol=1e-6)
    if axes == "triangular":  # what was there before has axes that are not at right angles
        assert np.std(length) < 1e-6 * np.mean(length)
    assert np.std(length) < 0.5 * np.std(np.linalg.norm(sent, axis=1))


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_an_accelerometer_on_a_board_that_is_turned(autopilot: str) -> None:
    correct, before = IMUS[autopilot]
    rng = np.random.default_rng(5)
    directions = rng.standard_normal((300, 3))
    raw = G * directions / np.linalg.norm(directions, axis=1)[:, None] * [1.02, 0.97, 1.01] + [0.2, -0.3, 0.1]
    warm = np.full(len(raw), 30.0)
    sent = correct(raw, warm, before, "accel")
    assert np.std(np.linalg.norm(sent, axis=1)) > 0.05
    params = calibration_params(autopilot, "accel", calibrate_norm("accel", sent, G), before)
    new = correct(raw, warm, {**before, **of_file(as_file(params))}, "accel")
    np.testing.assert_allclose(np.linalg.norm(new, axis=1), G, atol=1e-5)


def test_what_no_parameter_can_hold_is_refused_and_what_was_not_told_is_said() -> None:
    rng = np.random.default_rng(6)
    directions = rng.standard_normal((60, 3))
    skew = np.array([[1.0, 0.02, 0.0], [0.0, 1.0, 0.01], [0.0, 0.0, 1.0]])
    sent = G * directions / np.linalg.norm(directions, axis=1)[:, None] @ np.linalg.inv(skew).T
    result = calibrate_norm("accel", sent, G, "triangular")
    with pytest.raises(InputError, match="axes that are not at right angles"):
        calibration_params("px4", "accel", result, {})
    with pytest.raises(InputError, match="mounted in a way that is not known"):
        calibration_params("ardupilot", "accel", calibrate_norm("accel", sent, G), {"AHRS_ORIENTATION": 77.0})
    params = calibration_params("ardupilot", "accel", calibrate_norm("accel", sent, G), {"AHRS_ORIENTATION": 0.0})
    assert "INS_ACCSCAL_X" in params.notes[0]
    assert "AHRS" not in params.notes[0]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("sensor", ["accel", "mag"])
@pytest.mark.parametrize("number", [0, 1])
def test_names_of_parameters_fit_into_a_message(autopilot: str, sensor: str, number: int) -> None:
    names = parameter_names(autopilot, sensor, number)
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 16


# --- the link, the command ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["udp:14550", "udp::14550", "tcp:localhost:0", "tcp:localhost:70000", "serial:", "usb:1", ""]
)
def test_a_link_that_is_none(text: str) -> None:
    with pytest.raises(InputError, match="udp:HOST:PORT"):
        open_link(text)


def test_a_port_in_use_is_said() -> None:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="Address already in use; expected an address that is free"):
            open_link(f"udp:127.0.0.1:{one.getsockname()[1]}")


def test_a_serial_line_is_read_and_one_that_is_gone_is_waited_for(tmp_path: Path) -> None:
    """A pseudo terminal stands for it."""
    import os

    pytest.importorskip("serial")
    master, slave = os.openpty()
    link = open_link(f"serial:{os.ttyname(slave)}:115200")
    assert link.receive(0.05) == []
    os.write(master, b"\xfd\x01\x02")
    assert b"".join(link.receive(0.5)) == b"\xfd\x01\x02"
    link.send(b"abc")
    assert os.read(master, 3) == b"abc"
    link.close()
    os.close(slave)
    os.close(master)
    gone = open_link(f"serial:{tmp_path / 'ttyX'}:57600")
    assert gone.receive(0.01) == []
    assert gone.trouble
    gone.close()


def test_libraries_that_are_missing_are_named(without_library: Callable[[str], None]) -> None:
    without_library("serial")
    with pytest.raises(InputError, match=r"pip install -e '\.\[mavlink\]'"):
        open_link("serial:/dev/ttyACM0")
    without_library("pymavlink")
    with pytest.raises(InputError, match=r"pip install -e '\.\[mavlink\]'"):
        Vehicle({})


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    result = CliRunner().invoke(app, ["capture", "--link", "udp:127.0.0.1:0", "--out", str(tmp_path / "out")])
    assert result.exit_code != 0
    result = CliRunner().invoke(
        app, ["capture", "--link", "tcp:127.0.0.1:9", "--out", str(tmp_path / "out"), "--for", "1"]
    )
    assert isinstance(result.exception, InputError)
    assert "files that were not written by sinan" in str(result.exception)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]
