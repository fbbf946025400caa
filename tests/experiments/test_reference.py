"""What a recording is scored against: only what the reference knows, at its own stamps, and said to be what it is."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinan.experiments.commands import estimate as estimate_command
from sinan.experiments.commands import trace as trace_command
from sinan.experiments.datasets import convert, resolve
from sinan.experiments.reference import mounted, reference_of
from sinan.experiments.report.words import reference_name
from sinan.experiments.scenarios import simulate_to_folder
from sinan.sensors.formats.plain import read_recording, write_recording
from sinan.sensors.recording import (
    ACCEL,
    GYRO,
    MAG,
    POSITION,
    QUATERNION,
    TRUTH_KINDS,
    VELOCITY,
    Environment,
    Recording,
    SensorSpec,
    Stream,
    Truth,
)
from sinan.sensors.rotation import quaternion_log
from sinan.sensors.window import WHOLE, Span

ROOT = Path(__file__).resolve().parents[2]
DEGREE = np.deg2rad(1.0)
PX4 = "px4_esc_lidar_flight/esc_status_log.ulg"
NO_TRUTH = "which is not a truth"


#: Half a minute of that flight [s].
PART = (30.0, 60.0)


def estimated(log: Path | str, tmp_path: Path, page: bool = False, span: Span = WHOLE) -> tuple[dict[str, Any], str]:
    """JSON and text of `sinan estimate`."""
    out = tmp_path / "estimate.json"
    html = tmp_path / "estimate.html" if page else None
    text = estimate_command.run(str(log), "auto", None, None, out, html, span=span)
    return json.loads(out.read_text()), text


@pytest.fixture(scope="module")
def hover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated flight as a folder."""
    folder = tmp_path_factory.mktemp("reference") / "hover"
    simulate_to_folder("hover", folder, seed=3)
    return folder


def with_truth(source: Path, folder: Path, kind: str, *columns: str, zeros: tuple[str, ...] = ()) -> Path:
    """The recording with only some columns of its truth, and zeros in others of which nothing is known."""
    recording = read_recording(source)
    assert recording.truth is not None
    stream = recording.truth.stream
    kept = {name: stream[name] for name in columns}
    nothing = dict.fromkeys(zeros, np.zeros(len(stream)))
    write_recording(recording.replace(truth=Truth(Stream(stream.t, {**nothing, **kept}), kind)), folder)
    return folder


def test_a_simulated_truth_says_so(hover: Path, tmp_path: Path) -> None:
    assert (
        '[truth]\nkind = "simulation"\nknown = ["position", "velocity", "attitude"]\n'
        in (hover / "recording.toml").read_text()
    )
    document, text = estimated(hover, tmp_path)
    assert document["truth"]["kind"] == "simulation"
    assert {"position_rms", "velocity_rms", "attitude_rms", "bias_error", "within"} <= document["truth"].keys()
    for quantity in ("position", "height", "velocity", "attitude", "tilt", "heading"):
        assert f"  {quantity} error (RMS) against the simulation: " in text


def test_only_what_the_reference_knows_is_scored(hover: Path, tmp_path: Path) -> None:
    """Of cameras that give an attitude alone no position is known: an error against zeros is how far it flew."""
    folder = with_truth(hover, tmp_path / "seen", "cameras", *QUATERNION)
    document, text = estimated(folder, tmp_path, page=True)
    errors = {name for name in document["truth"] if name.endswith("_rms")}
    assert errors == {"attitude_rms", "tilt_rms", "heading_rms"}
    assert "position" not in text
    assert "velocity" not in text
    assert "attitude error (RMS) against the cameras: " in text
    assert "attitude error (RMS) against the cameras" in (tmp_path / "estimate.html").read_text()
    assert document["truth"]["attitude_rms"] < DEGREE
    assert re.search(r"comparison with the cameras: its mounting \(.* deg\), its delay \(.* s\) and one constant", text)


def test_zeros_in_columns_that_are_not_known_are_no_truth(hover: Path, tmp_path: Path) -> None:
    folder = with_truth(hover, tmp_path / "seen", "rtk", *QUATERNION, zeros=(*POSITION, *VELOCITY))
    header = folder / "recording.toml"
    header.write_text(
        header.read_text().replace('known = ["position", "velocity", "attitude"]', 'known = ["attitude"]')
    )
    document, _ = estimated(folder, tmp_path)
    assert document["truth"]["known"] == ["attitude"]
    assert not {"position_rms", "velocity_rms"} & document["truth"].keys()


def test_an_autopilots_own_estimate_is_called_no_truth(hover: Path, tmp_path: Path) -> None:
    _, text = estimated(with_truth(hover, tmp_path / "seen", "autopilot", *QUATERNION), tmp_path)
    assert f"attitude difference (RMS) from the autopilot's own estimate, {NO_TRUTH}: " in text
    assert "error (RMS)" not in text


def test_every_kind_has_its_own_words() -> None:
    assert len({reference_name("attitude_rms", kind) for kind in (*TRUTH_KINDS, "")}) == len(TRUTH_KINDS) + 1


def test_a_reference_of_another_time_scores_nothing(hover: Path, tmp_path: Path) -> None:
    recording = read_recording(hover)
    assert recording.truth is not None
    later = Stream(recording.truth.stream.t + 1e4, recording.truth.stream.columns)
    write_recording(recording.replace(truth=Truth(later, "simulation")), tmp_path / "later")
    document, text = estimated(tmp_path / "later", tmp_path)
    assert document["truth"] == {"kind": "simulation", "known": ["position", "velocity", "attitude"]}
    assert "no error: the simulation knows nothing of what is estimated at any instant of the flight" in text


def swinging(stamps: np.ndarray) -> Recording:
    """A body that swings about the vertical, 80 deg to either side in two seconds: yaw = A sin(pi t), at rest in place.

    The gyroscope reads the derivative, A pi cos(pi t), the accelerometer (0, 0, -g), the magnetometer
    (B cos yaw, -B sin yaw, B) of a field (B, 0, B).
    """
    a, t = np.deg2rad(80.0), np.arange(0.0, 30.0, 0.01)
    zero, rng = np.zeros(len(t)), np.random.default_rng(1)
    noise = 1e-4 * rng.standard_normal((9, len(t)))
    yaw = a * np.sin(np.pi * t)
    imu = dict(zip((*ACCEL, *GYRO), [zero, zero, zero - 9.8, zero, zero, a * np.pi * np.cos(np.pi * t)], strict=True))
    mag = dict(zip(MAG, [np.cos(yaw), -np.sin(yaw), zero + 1.0], strict=True))
    imu = {name: values + noise[k] for k, (name, values) in enumerate(imu.items())}
    mag = {name: values + 10.0 * noise[6 + k] for k, (name, values) in enumerate(mag.items())}
    half = 0.5 * a * np.sin(np.pi * stamps)
    truth = Stream(stamps, dict(zip(QUATERNION, [np.cos(half), 0 * half, 0 * half, np.sin(half)], strict=True)))
    sensors = {
        "accel": SensorSpec(noise_density=1e-5, bias_walk=1e-6, bias_std=1e-3),
        "gyro": SensorSpec(noise_density=1e-5, bias_walk=1e-7, bias_std=1e-4),
        "mag": SensorSpec(noise_std=1e-3, bias_walk=0.0, bias_std=0.0),
    }
    return Recording(
        "swinging", "flight", {"imu": Stream(t, imu), "mag": Stream(t[::2], {n: v[::2] for n, v in mag.items()})},
        sensors, Environment(9.8, np.array([1.0, 0.0, 1.0])), truth=Truth(truth, "simulation"),
    )  # fmt: skip


@pytest.mark.parametrize("stamps", [np.arange(0.5, 29.0, 1.0), np.arange(0.5, 29.0, 0.013)])
def test_errors_are_those_at_the_stamps_of_the_reference(tmp_path: Path, stamps: np.ndarray) -> None:
    """Between stamps a second apart the body turns by 160 deg: a reference that is interpolated there is far off."""
    write_recording(swinging(stamps), tmp_path / "swinging")
    document, _ = estimated(tmp_path / "swinging", tmp_path)
    assert document["truth"]["attitude_rms"] < 0.2 * DEGREE


def test_a_trace_is_scored_at_the_stamps_of_the_reference_too(tmp_path: Path) -> None:
    write_recording(swinging(np.arange(0.5, 29.0, 1.0)), tmp_path / "swinging")
    out = tmp_path / "trace.json"
    trace_command.run([str(tmp_path / "swinging")], None, 0.01, None, None, out, None)
    errors = json.loads(out.read_text())["error"]
    assert errors["truth"]["kind"] == "simulation"
    assert errors["truth"]["known"] == ["attitude"]
    assert errors["truth"]["before"].keys() == {"attitude_rms", "tilt_rms", "heading_rms"}
    assert errors["truth"]["before"]["attitude_rms"] < 0.2 * DEGREE
    assert errors["truth_held_out"]["before"]["attitude_rms"] < 0.2 * DEGREE


@pytest.mark.measured
def test_of_a_ulog_only_the_attitude_is_scored_and_is_no_truth(measured_data: Path, tmp_path: Path) -> None:
    """Its reference is `vehicle_attitude`: "13 m and 3.23 m/s" was how far and how fast it flew."""
    document, text = estimated(measured_data / PX4, tmp_path, span=PART)
    assert document["truth"]["kind"] == "autopilot"
    assert document["truth"]["known"] == ["attitude"]
    assert not {"position_rms", "velocity_rms", "height_rms"} & document["truth"].keys()
    assert "position" not in text
    assert f"attitude difference (RMS) from the autopilot's own estimate, {NO_TRUTH}: " in text
    assert "removed before the comparison with the autopilot's own estimate: one constant heading" in text


@pytest.mark.measured
def test_a_converted_log_keeps_its_reference(measured_data: Path, tmp_path: Path) -> None:
    convert(str(measured_data / PX4), tmp_path / "run")
    assert '[truth]\nkind = "autopilot"\nknown = ["attitude"]\n' in (tmp_path / "run" / "recording.toml").read_text()
    assert (tmp_path / "run" / "truth.csv").read_text().startswith("t,qw,qx,qy,qz\n")
    log, again = (estimated(path, tmp_path, span=PART)[0]["truth"] for path in (measured_data / PX4, tmp_path / "run"))
    assert again == log


@pytest.mark.measured
def test_the_clock_of_a_ulogs_reference_is_that_of_its_streams(measured_data: Path) -> None:
    """By the gyroscope: over the flight the autopilot turns when the gyroscope says so."""
    from sinan.experiments.reference import mounted

    recording = resolve(str(measured_data / PX4))
    assert recording.truth is not None
    assert abs(mounted(recording, recording.truth.stream).delay) < 0.05


def test_what_estimates_does_not_see_the_truth(hover: Path, tmp_path: Path) -> None:
    """With another truth, and with none, the same to the last bit."""
    recording = read_recording(hover)
    assert recording.truth is not None
    stream = recording.truth.stream
    other = Stream(stream.t, {name: np.roll(values, 50) for name, values in stream.columns.items()})
    documents = []
    for name, truth in (("one", recording.truth), ("other", Truth(other, "rtk")), ("none", None)):
        write_recording(recording.replace(truth=truth), tmp_path / name)
        document, _ = estimated(tmp_path / name, tmp_path)
        which = ("truth", "called", "call", "logs")  # says which recording it is of
        documents.append({key: value for key, value in document.items() if key not in which})
    assert documents[0] == documents[1] == documents[2]


def test_nothing_that_estimates_reads_the_truth() -> None:
    """No attribute `truth` in what estimates: only formats, what cuts out a part and what scores know of it."""
    for package in ("estimator", "calibration", "sensors"):
        for path in (ROOT / package).rglob("*.py"):
            if path.parent.name == "formats" or path.name == "window.py":
                continue
            names = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
            assert "truth" not in names, path


@pytest.mark.measured
def test_a_reference_that_its_makers_aligned_is_taken_as_it_is(
    measured_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hand that hardly turns shows no mounting: from the rates it is more than a degree, where there is none."""
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    recording = resolve("broad_orientation/15_undisturbed_fast_translation_A.mat")
    target = reference_of(recording)
    assert recording.truth is not None
    assert target is not None
    assert (recording.truth.aligned, target.delay, target.same_north) == (True, 0.0, False)
    np.testing.assert_array_equal(target.mounting, [1.0, 0.0, 0.0, 0.0])
    from_rates = quaternion_log(mounted(recording, recording.truth.stream).mounting)
    assert np.degrees(np.linalg.norm(from_rates)) > 1.0
