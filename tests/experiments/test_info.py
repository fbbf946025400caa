"""`sinan info`: what is said of a log, against logs that were made to have it."""

from __future__ import annotations

import hashlib
import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.experiments.commands.cli import app
from sinan.experiments.commands.info import gaps, recorded, run
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.recording import ACCEL, GYRO, MAG, Environment, Recording, Stream
from tests.sensors import test_ardupilot as ardupilot
from tests.sensors import test_formats_logs as logs


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.bin"
    path.write_bytes(ardupilot.binary(ardupilot.flight()))
    return path


def document_of(path: Path, choice: Choice = Choice()) -> dict:  # type: ignore[type-arg]  # noqa: B008
    out = path.with_name("info.json")
    run(str(path), None, out, choice=choice)
    return json.loads(out.read_text())  # type: ignore[no-any-return]


def test_what_a_log_is_and_holds(log: Path) -> None:
    document = document_of(log)
    assert document["format"] == "ArduPilot dataflash, binary"
    assert document["firmware"] == "ArduCopter V4.5.7 (2a3dc4b7)"
    assert document["parameters"]["MOT_PWM_MAX"] == 1900.0
    assert document["instances"] == {"imu": 2, "mag": 2, "baro": 1, "gps": 1}
    imu = document["streams"]["imu"]
    assert (imu["rows"], imu["rate_hz"]) == (50, pytest.approx(50.0))
    assert imu["columns"] == dict.fromkeys(ACCEL, "m/s^2") | dict.fromkeys(GYRO, "rad/s") | {"temperature": "degC"}
    assert document["streams"]["mag"]["columns"]["mag_x"] == "gauss"
    rows = {table["name"]: table["rows"] for table in document["tables"]}
    assert (rows["IMU"], rows["GPA"]) == (100, 5)
    assert document["reference"] == {"kind": "autopilot", "known": ["attitude"], "rows": 10}


def test_the_text_names_streams_sensors_and_what_to_do_next(log: Path) -> None:
    result = CliRunner().invoke(app, ["info", str(log), "--mag", "1"])
    assert result.exit_code == 0
    assert "imu     50 rows  50 Hz  accel [m/s^2], gyro [rad/s], temperature [degC]" in result.output
    assert "several of a kind: choose by --imu 0 to 1, --mag 0 to 1" in result.output
    assert f"next: `sinan trace {log} --mag 1`" in result.output


def test_a_page_says_the_same_and_rests_on_its_log(log: Path) -> None:
    page = log.with_name("info.html")
    result = CliRunner().invoke(app, ["info", str(log), "--html", str(page)])
    assert result.exit_code == 0, result.output
    text = page.read_text(encoding="utf-8")
    for said in ("ArduCopter V4.5.7", "<td>IMU</td>", "MOT_PWM_MAX", hashlib.sha256(log.read_bytes()).hexdigest(),
                 f"sinan trace {log}", "accel [m/s<sup>2</sup>]"):  # fmt: skip
        assert said in text, said


def test_a_page_of_what_is_no_recording_says_why(tmp_path: Path) -> None:
    """And what a log calls itself stays text."""
    log = tmp_path / "a.bin"
    log.write_bytes(ardupilot.binary([("MSG", (1, "<img src=x onerror=alert(1)>"))]))
    run(str(log), None, None, html=tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "Nothing can be estimated from it:" in text
    assert "<img" not in text


def test_a_gap_changes_no_rate() -> None:
    """40 s of 100 Hz and 20 s of nothing between."""
    t = 0.01 * np.arange(6000)
    imu = flight().streams["imu"]
    still = {name: np.zeros(4000) + values[0] for name, values in imu.columns.items()}
    silent = flight().replace(streams={"imu": Stream(t[(t < 20.0) | (t >= 40.0)], still)})
    told = recorded(silent)["streams"]["imu"]
    assert told["rate_hz"] == pytest.approx(100.0)
    assert told["gaps"]["count"] == 1


def test_a_gap_is_where_three_readings_are_missing() -> None:
    t = np.delete(0.01 * np.arange(100), [10, 11, 50, 51, 52, 70, 71, 72, 73])
    count, longest, at = gaps(t)
    assert (count, longest, at) == (2, pytest.approx(0.05), pytest.approx(0.69))
    assert gaps(0.01 * np.arange(100)) == (0, 0.0, None)
    assert gaps(np.zeros(1)) == (0, 0.0, None)


def flight(**power: np.ndarray) -> Recording:
    t = 0.01 * np.arange(200)
    imu = Stream(t, {name: np.full(200, -9.8 * (name == "accel_z")) for name in (*ACCEL, *GYRO)})
    streams = {"imu": imu, "mag": Stream(t, dict.fromkeys(MAG, 0.3 + 0.0 * t))}
    if power:
        streams["power"] = Stream(t, power)
    return Recording("a", "flight", streams, environment=Environment(field_unit="gauss"))


@pytest.mark.parametrize(
    ("power", "seen"),
    [({}, False), ({"current": np.full(200, 5.0)}, False), ({"current": np.linspace(0.0, 9.0, 200)}, True)],
    ids=["none", "constant", "varies"],
)
def test_an_effect_of_the_current_needs_one_that_varies(
    tmp_path: Path, power: dict[str, np.ndarray], seen: bool
) -> None:
    write_recording(flight(**power), tmp_path / "a")
    effects = document_of(tmp_path / "a")["effects"]
    assert ("mag.current" in effects["could_see"]) == seen
    assert ("mag.current" in effects["missing"].get("a supply or motors that vary", [])) != seen
    assert "mag.declination" in effects["missing"]["a declared magnetic field"]


def test_a_log_that_is_no_recording_is_told_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(ardupilot.binary([("BAT", (5, 0, 1.0, 1.0, 1.0, 1.0, 1.0, 1, 1.0))]))
    text = run(str(path), None, None)
    assert "nothing can be estimated from it: " in text
    assert "no accelerometer with a gyroscope" in text
    assert "BAT 1" in text


def test_a_receiver_alone_is_nothing_to_trace(tmp_path: Path) -> None:
    path = tmp_path / "a.ubx"
    path.write_bytes(b"".join(logs.solution(1000 * k) for k in range(9)))
    text = run(str(path), None, None)
    assert "a trace could see: nothing" in text
    assert "and with an accelerometer with a gyroscope: gps.lever_arm" in text
    assert "next:" not in text


def test_poses_that_let_nothing_be_fitted_are_not_recommended(tmp_path: Path) -> None:
    """A compass that turns about the vertical alone, and one that turns all round."""
    rng, t = np.random.default_rng(1), np.arange(400.0)
    level = np.stack([0.3 * np.cos(t), 0.3 * np.sin(t), np.full(len(t), 0.45)], axis=-1)
    around = rng.normal(size=(len(t), 3))
    around *= 0.5 / np.linalg.norm(around, axis=1, keepdims=True)
    said = []
    for name, field in (("level", level), ("around", around)):
        field = field + rng.normal(scale=0.005, size=field.shape)
        mag = Stream(t, dict(zip(MAG, field.T, strict=True)))
        write_recording(Recording(name, "poses", {"mag": mag}), tmp_path / name)
        said.append(run(str(tmp_path / name), None, None))
    assert "a trace could see: nothing" in said[0]
    assert "and with other poses (directions too much alike to fix scale and offset;" in said[0].replace("\n    ", " ")
    assert "next:" not in said[0]
    assert "a trace could see: mag.cross_axis" in said[1]
    assert f"next: `sinan calibrate all {tmp_path / 'around'}`" in said[1]


@pytest.mark.measured
def test_a_data_set_is_the_same_by_its_name_and_by_its_path(
    measured_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    text = run("px4_quad_64a", None, None)
    assert run(str(measured_data / "px4_quad_64a"), None, None) == text
    assert "a trace could see: nothing" in text
    assert "next:" not in text


def test_it_takes_a_second(tmp_path: Path) -> None:
    """Ten minutes of a log of 4 MB, in time of this process."""
    messages = [ardupilot.imu(10_000_000 + 10_000 * k) for k in range(60_000)]
    path = tmp_path / "a.bin"
    path.write_bytes(ardupilot.binary(messages))
    begin = time.process_time()
    run(str(path), None, None)
    assert time.process_time() - begin < 1.0


@pytest.mark.measured
def test_a_measured_log(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg"
    text = run(str(measured_data / name), None, None)
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    assert run(name, None, None) == text.replace(str(measured_data / name), name)
    assert "PX4_FMU_V6XRT, 1135 parameters, flight of 95.13 s" in text
    assert re.search(r"baro +477 rows +5\.7\d+ Hz", text)  # most steps are of 0.173 s, though 477 in 95 s are 5.0 Hz
    assert "3 gaps, the longest 6 s at 60.27 s" in text
    assert "--imu 0 to 2, --mag 0 to 1, --baro 0 to 1" in text


def test_the_sensor_that_is_asked_for_is_converted(log: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["convert", str(log), str(tmp_path / "out"), "--mag", "1", "--imu", "1"])
    assert result.exit_code == 0, result.output
    streams = read_recording(tmp_path / "out").streams
    assert streams["mag"]["mag_x"][0] == pytest.approx(0.3)
    assert streams["imu"]["accel_z"][0] == pytest.approx(-9.7)


@pytest.mark.parametrize("command", ["info", "convert", "estimate", "trace", "observability"])
def test_a_map_says_itself_what_is_read(log: Path, tmp_path: Path, command: str) -> None:
    (tmp_path / "map.toml").write_text('kind = "flight"\n')
    more = [str(tmp_path / "out")] if command == "convert" else []
    result = CliRunner().invoke(app, [command, str(log), *more, "--map", str(tmp_path / "map.toml"), "--mag", "1"])
    assert isinstance(result.exception, InputError)
    assert str(result.exception).startswith("--mag 1: of ")
