"""`sinan capture` against a process of its own that speaks MAVLink on loopback: loss, bursts, restarts, kills."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.sensors.formats import open_log
from sinan.sensors.formats.mwlog import read_mwlog
from sinan.sensors.recording import ACCEL, MAG, Recording
from tests.experiments.conftest import require_fit
from tests.sensors import test_tlog as telemetry

pytest.importorskip("pymavlink")
ROOT = Path(__file__).resolve().parents[2]
VEHICLE = Path(__file__).with_name("mavlink_vehicle.py")
REPLAY = Path(__file__).with_name("mavlink_replay.py")
G = 9.80665
#: Nothing here takes longer, however busy the machine is [s].
MOST = 90.0
ALL = ["RAW_IMU", "SCALED_PRESSURE", "GPS_RAW_INT", "BATTERY_STATUS", "ATTITUDE"]
REST = [[0, 0, 0]]
#: The ten poses, and one of them again, 8 deg from before.
TEN = [[0, 0, 0], [180, 0, 0], [-90, 0, 0], [90, 0, 0], [-82, 0, 0], [0, -90, 0], [0, 90, 0], [-45, 0, 0], [45, 0, 0],
       [0, -45, 0], [0, 45, 0]]  # fmt: skip
FACES = [[0, 0, 0], [180, 0, 0], [-90, 0, 0], [90, 0, 0], [0, -89, 0], [0, 89, 0]]


class Loopback:
    """A vehicle and captures of it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_port()
        self.started: list[subprocess.Popen[str]] = []
        self.kind = "udp"

    def vehicle(self, link: str = "udp", **plan: Any) -> None:
        """Start it; it ends by itself."""
        self.kind = link
        whole = {
            "link": link,
            "port": self.port,
            "seconds": MOST,
            "lead": 0.1,
            "sends": ALL,
            "shown": REST,
            "hold": 1e3,
        } | plan
        (self.folder / "plan.json").write_text(json.dumps(whole))
        self._start(str(VEHICLE), str(self.folder / "plan.json"))

    def replay(self, log: bytes, every: int) -> None:
        """Play a telemetry log, of which every so many frames one is lost."""
        (self.folder / "log.tlog").write_bytes(log)
        self._start(str(REPLAY), str(self.folder / "log.tlog"), str(self.port), str(every))

    def capture(self, *options: str, out: str = "run", terminal: int | None = None) -> subprocess.Popen[str]:
        """Start one."""
        link = f"{self.kind}:127.0.0.1:{self.port}"
        arguments = "-m", "sinan", "capture", "--link", link, "--out", str(self.folder / out), *options
        return self._start(*arguments, stdout=subprocess.PIPE if terminal is None else terminal)

    def _start(self, *arguments: str, stdout: int = subprocess.PIPE) -> subprocess.Popen[str]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "default"}
        one = subprocess.Popen(
            [sys.executable, *arguments], cwd=self.folder, env=environment, text=True,
            stdout=stdout, stderr=subprocess.PIPE,
        )  # fmt: skip
        self.started.append(one)
        return one

    def account(self, out: str = "run") -> dict[str, Any]:
        """What a capture says of itself."""
        found: dict[str, Any] = json.loads((self.folder / out / "capture.json").read_text())
        return found


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@pytest.fixture
def loopback(tmp_path: Path) -> Iterator[Loopback]:
    both = Loopback(tmp_path)
    yield both
    for one in both.started:
        if one.poll() is None:
            one.kill()
        one.communicate()


def ended(one: subprocess.Popen[str]) -> str:
    """What a capture printed; it ended well."""
    said, error = one.communicate(timeout=MOST)
    assert one.returncode == 0, f"{said}{error}"
    assert error == ""
    return said or ""


def wait_for(ready: Callable[[], bool], one: subprocess.Popen[str]) -> None:
    end = time.monotonic() + MOST
    while not ready():
        assert one.poll() is None, one.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def rows_of(path: Path) -> int:
    return path.read_bytes().count(b"\n") - 1 if path.is_file() else 0


def steps(recording: Recording, name: str = "imu") -> np.ndarray:
    return np.diff(recording.streams[name].t)


def test_a_replayed_log_with_loss_is_recorded_but_for_what_was_lost(loopback: Loopback) -> None:
    """Each reading tells its number; every tenth frame is lost."""
    alive = (10.0, "HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3})
    sent = [alive, *(telemetry.raw_imu(10.0 + 0.02 * k, az=-1000 + k) for k in range(150))]
    loopback.replay(telemetry.written(sent), every=10)
    ended(loopback.capture("--for", "5"))
    imu = open_log(loopback.folder / "run").streams["imu"]
    kept = np.array([k for k in range(150) if (k + 2) % 10])
    np.testing.assert_allclose(imu["accel_z"], 1e-3 * G * (kept - 1000), rtol=1e-9)
    np.testing.assert_allclose(imu.t - imu.t[0], 0.02 * (kept - kept[0]), atol=0.001)
    assert loopback.account()["lost"] == 15


def test_a_recording_as_it_goes_with_loss_and_a_burst(loopback: Loopback) -> None:
    """Every 20th message is lost, and for 0.7 s all are held up: a burst keeps the times at which it was read."""
    loopback.vehicle(loss=0.05, held=[[1.5, 2.2], [3.0, 3.7]])
    said = ended(loopback.capture("--for", "5", "--rate", "100", "--mwlog", "course.bin"))
    recording, account = open_log(loopback.folder / "run"), loopback.account()
    assert recording.kind == "flight"
    assert set(recording.streams) == {"imu", "mag", "baro", "gps", "power"}
    assert recording.truth is not None
    assert recording.truth.kind == "autopilot"
    assert recording.origin == pytest.approx((47.3977, 8.5456, 536.0))
    imu = recording.streams["imu"]
    assert np.median(steps(recording)) == pytest.approx(0.01, abs=0.002)
    assert len(imu) > 0.85 * 100.0 * (imu.t[-1] - imu.t[0])
    assert np.percentile(steps(recording), 99.0) < 0.1
    np.testing.assert_allclose(imu.array(ACCEL).mean(axis=0), [0.0, 0.0, -G], atol=0.01)
    np.testing.assert_allclose(recording.streams["mag"].array(MAG).mean(axis=0), [0.22, 0.02, 0.44], atol=1e-3)
    assert recording.streams["power"]["current_2"][-1] == pytest.approx(3.5)
    assert recording.streams["baro"]["pressure"][0] == pytest.approx(95_000.0)
    assert 0.02 < account["lost"] / sum(account["messages"].values()) < 0.09
    require_fit("capture", account)
    assert f"lost {account['lost']} messages" in said
    assert "missing: " not in said.splitlines()[-2]
    course = read_mwlog(loopback.folder / "course.bin")
    assert len(course) == 9
    np.testing.assert_allclose(np.stack([course[k] for k in "123"], axis=-1), imu.array(ACCEL), rtol=1e-6)
    np.testing.assert_allclose(np.diff(course["9"]), 1e6 * steps(recording), atol=2.0)


def test_a_vehicle_that_is_started_again_and_one_whose_clock_jumps(loopback: Loopback) -> None:
    """The link is away for 1.5 s, rates are forgotten, the clock begins at 1 s; later it leaps by an hour."""
    loopback.vehicle("tcp", clock=[{"at": 2.0, "to": 1.0, "away": 1.5}, {"at": 6.0, "to": 3600.0}])
    run = loopback.capture("--for", "9")
    said = ended(run)
    recording, account = open_log(loopback.folder / "run"), loopback.account()
    assert account["clock_jumps"] == 2, said
    assert "it was started again, or its clock set back" in said
    assert "it jumped" in said
    gaps = steps(recording)[steps(recording) > 0.5]
    assert len(gaps) == 1
    assert 1.0 < gaps[0] < 3.5
    t = recording.streams["imu"].t
    assert t[-1] < 9.5
    assert np.sum(t > t[-1] - 2.0) > 80  # it was asked for 50 a second again
    assert sum(account["rows_left_out"].values()) < 20


def test_what_is_killed_has_lost_the_last_second_and_is_known_for_a_part(loopback: Loopback) -> None:
    loopback.vehicle()
    run, folder = loopback.capture("--rate", "100", "--mwlog", "course.bin"), loopback.folder / "run"
    wait_for(lambda: rows_of(folder / "imu.csv") > 0, run)
    ahead, since = [], time.monotonic()
    while time.monotonic() < since + 3.0:
        last = (folder / "imu.csv").read_text().rstrip("\n").rsplit("\n", 1)[-1]
        ahead.append(time.monotonic() - float(last.split(",")[0]))
        time.sleep(0.01)
    killed = time.monotonic()
    run.kill()
    run.wait(MOST)
    recording = open_log(folder)
    assert "a part: what wrote it was cut off, or goes on; rows that are not whole are left out" in recording.notes
    assert killed - recording.streams["imu"].t[-1] < min(ahead) + 1.0
    assert recording.truth is not None
    assert len(read_mwlog(loopback.folder / "course.bin")["1"]) == pytest.approx(len(recording.streams["imu"]), abs=60)
    with (folder / "imu.csv").open("a") as file:
        file.write("99.0,1.0,2")  # a row that a disk took half of
    assert len(open_log(folder).streams["imu"]) == len(recording.streams["imu"])


def test_ctrl_c_ends_it_well(loopback: Loopback) -> None:
    """On a terminal, which shows a table meanwhile."""
    loopback.vehicle()
    ours, theirs = os.openpty()
    run, folder = loopback.capture(terminal=theirs), loopback.folder / "run"
    os.close(theirs)
    wait_for(lambda: rows_of(folder / "imu.csv") > 30, run)
    time.sleep(2.0)  # every stream has come, and the table was drawn since
    run.send_signal(signal.SIGINT)
    too_long = threading.Timer(MOST, run.kill)
    too_long.start()
    shown = b""
    with suppress(OSError):  # what a terminal says whose other side is closed
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    too_long.cancel()
    assert ended(run) == ""
    said = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())
    assert "Ctrl-C ends it well" in said
    assert "missing: " not in said[said.rindex("Ctrl-C") :]
    recording = open_log(folder)
    assert not [note for note in recording.notes if "part" in note]
    assert f"imu {len(recording.streams['imu'])}" in said[said.rindex("rows: ") :]
    assert f"imu = {len(recording.streams['imu'])}\n" in (folder / "recording.toml").read_text()


def test_an_old_autopilot_is_asked_for_groups_of_messages(loopback: Loopback) -> None:
    """It does not know SET_MESSAGE_INTERVAL, and sends its IMU once it is asked for RAW_SENSORS."""
    loopback.vehicle(old=True)
    ended(loopback.capture("--for", "6"))
    assert np.median(steps(open_log(loopback.folder / "run"))) == pytest.approx(0.02, abs=0.005)


def test_nobody_there(loopback: Loopback) -> None:
    loopback.kind = "tcp"
    run = loopback.capture("--for", "0.8")
    _, error = run.communicate(timeout=MOST)
    assert run.returncode == 1
    assert "not one reading (no vehicle has been heard on tcp:127.0.0.1:" in error
    assert "refused); expected readings: a vehicle that is on" in error
    assert error.count("\n") == 1


ARDUPILOT = {
    "INS_ACCOFFS_X": 0.1, "INS_ACCOFFS_Y": -0.05, "INS_ACCOFFS_Z": 0.0, "INS_ACCSCAL_X": 1.0, "INS_ACCSCAL_Y": 1.02,
    "INS_ACCSCAL_Z": 1.0, "AHRS_ORIENTATION": 0.0, "COMPASS_OFS_X": 20.0, "COMPASS_OFS_Y": 0.0, "COMPASS_OFS_Z": -15.0,
    "COMPASS_DIA_X": 1.05, "COMPASS_DIA_Y": 1.0, "COMPASS_DIA_Z": 1.0, "COMPASS_SCALE": 1.0, "COMPASS_MOTCT": 0.0,
    **{f"COMPASS_{group}_{axis}": 0.0 for group in ("ODI", "MOT") for axis in "XYZ"},
}  # fmt: skip
PX4 = {
    "CAL_ACC0_XOFF": 0.1, "CAL_ACC0_YOFF": 0.0, "CAL_ACC0_ZOFF": -0.04, "CAL_ACC0_XSCALE": 1.0, "CAL_ACC0_YSCALE": 0.99,
    "CAL_ACC0_ZSCALE": 1.0, "SENS_BOARD_ROT": 0.0, **{f"SENS_BOARD_{axis}_OFF": 0.0 for axis in "XYZ"},
}  # fmt: skip
SCALE, OFFSET, FIELD_OFFSET = np.array([1.03, 0.98, 1.01]), np.array([0.3, -0.2, 0.1]), np.array([0.08, -0.05, 0.03])


def typed(said: str) -> dict[str, float]:
    """The parameters that were printed."""
    lines = [line.split(": ", 1)[1].split() for line in said.splitlines() if line.startswith(("ArduPilot: ", "PX4: "))]
    return {line[0]: float(line[1].rstrip(",")) for line in lines if line[0] != "note:"}


def typed_in(loopback: Loopback, said: str) -> dict[str, float]:
    """The parameters that were printed, set in the vehicle one by one."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    values = typed(said)
    link, told = mavlink.MAVLink(None, srcSystem=255), set[str]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        way.bind(("127.0.0.1", loopback.port))
        way.settimeout(0.2)
        end = time.monotonic() + 10.0
        while told != set(values) and time.monotonic() < end:
            data, peer = way.recvfrom(65536)
            for message in link.parse_buffer(data) or []:
                if message.get_type() == "PARAM_VALUE" and message.param_value == np.float32(values[message.param_id]):
                    told.add(message.param_id)
            for name in set(values) - told:
                way.sendto(mavlink.MAVLink_param_set_message(1, 1, name.encode(), values[name], 9).pack(link), peer)
    assert told == set(values)
    return values


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_ten_poses_are_captured_calibrated_typed_in_and_captured_again(loopback: Loopback, autopilot: str) -> None:
    """The ten, and one of them twice. K and b of the second capture are one and zero, as the first one's were not."""
    parameters = {"ardupilot": ARDUPILOT, "px4": PX4}[autopilot]
    loopback.vehicle(
        autopilot=autopilot, shown=TEN, hold=0.55, sends=["RAW_IMU" if autopilot == "ardupilot" else "HIGHRES_IMU"],
        parameters=parameters, accel={"scale": SCALE.tolist(), "offset": OFFSET.tolist()}, loss=0.01,
    )  # fmt: skip
    poses = ("--poses", "accel", "--rate", "250", "--for", "40")
    said = ended(loopback.capture(*poses, "--mwlog", "course.bin", "--json", "first.json", "--html", "first.html"))
    assert said.count("taken: ") == 10
    page = (loopback.folder / "first.html").read_text()
    assert all(name in page for name in ("Parameters to type in", *typed(said)))
    assert re.search("refused: on its left side was shown before, [789] deg from this", said), said
    values = typed_in(loopback, said)
    off, scale = (
        ("INS_ACCOFFS_{}", "INS_ACCSCAL_{}") if autopilot == "ardupilot" else ("CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE")
    )
    np.testing.assert_allclose([values[scale.format(axis)] for axis in "XYZ"], 1.0 / SCALE, atol=1e-3)
    np.testing.assert_allclose([values[off.format(axis)] for axis in "XYZ"], OFFSET, atol=0.01)  # m/s^2, 1 mg
    first = json.loads((loopback.folder / "first.json").read_text())
    course = read_mwlog(loopback.folder / "course.bin")
    points = np.stack([course[k] for k in "456"], axis=-1)
    poses_csv = open_log(loopback.folder / "run").streams["poses"]
    np.testing.assert_allclose(points[np.any(points != 0.0, axis=1)], poses_csv.array(ACCEL), rtol=1e-6)
    if autopilot == "px4":  # its correction has the same form
        return
    ended(loopback.capture(*poses, "--json", "second.json", out="again"))
    second = json.loads((loopback.folder / "second.json").read_text())
    assert second["n"] == 10
    np.testing.assert_allclose(second["K"], 1.0, atol=1e-3)
    np.testing.assert_allclose(second["b"], 0.0, atol=0.01)
    assert second["sse_before"] < 0.01 * first["sse_before"]


def test_six_faces_are_captured_calibrated_typed_in_and_captured_again(loopback: Loopback) -> None:
    fault = {"scale": [1.04, 0.97, 1.0], "offset": FIELD_OFFSET.tolist()}
    loopback.vehicle(shown=FACES, hold=1.0, round=True, sends=["RAW_IMU"], parameters=ARDUPILOT, mag=fault, loss=0.01)
    faces = ("--faces", "mag", "--rate", "100", "--for", "40")
    said = ended(loopback.capture(*faces, "--mwlog", "course.bin", "--json", "first.json"))
    assert len(re.findall("^turned round: ", said, re.MULTILINE)) == 6
    values = typed_in(loopback, said)
    ofs = [values[f"COMPASS_OFS_{axis}"] for axis in "XYZ"]
    np.testing.assert_allclose(ofs, -1e3 * FIELD_OFFSET, atol=2.0)  # mGauss
    dia = np.array([values[f"COMPASS_DIA_{axis}"] for axis in "XYZ"])
    np.testing.assert_allclose(dia / dia[2], [1.0 / 1.04, 1.0 / 0.97, 1.0], atol=5e-3)
    assert len(read_mwlog(loopback.folder / "course.bin")) == 3
    ended(loopback.capture(*faces, "--json", "second.json", out="again"))
    first, second = (json.loads((loopback.folder / f"{name}.json").read_text()) for name in ("first", "second"))
    np.testing.assert_allclose(second["K"], 1.0, atol=5e-3)
    np.testing.assert_allclose(second["b"], 0.0, atol=5e-3)
    assert second["sse_before"] / second["n"] < 0.01 * first["sse_before"] / first["n"]
