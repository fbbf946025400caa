"""The measured data sets: registry, fetching, resolving, and what each log shows when its map has read it."""

from __future__ import annotations

import gzip
import hashlib
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from sinan.experiments.datasets import DataFile, Dataset, called, convert, dataset_names, load_dataset, resolve
from sinan.experiments.datasets import fetch as fetch_module
from sinan.experiments.datasets.fetch import fetch
from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.map_file import read_map
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.rotation import quaternion_interpolate, rotate

SINGLE_PRECISION = 1e-6
ALL_LOGS = [f"{name}/{log}" for name in dataset_names() for log in load_dataset(name).logs()]
GRAVITY = 9.81
#: A hobby accelerometer's scale and bias leave its mean at rest within this of gravity.
UNCALIBRATED = 0.06 * GRAVITY


# --- registry --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", dataset_names())
def test_registry_is_complete(name: str) -> None:
    dataset = load_dataset(name)
    assert dataset.folder.endswith(name)
    assert dataset.repository.startswith("https://github.com/")
    assert len(dataset.commit) == 40
    assert dataset.licence
    assert dataset.citation
    assert all(len(file.sha256) == 64 and file.size > 0 for file in dataset.files.values())
    assert dataset.logs()


@pytest.mark.parametrize("name", dataset_names())
def test_every_map_can_be_read_and_reads_a_log(name: str) -> None:
    dataset = load_dataset(name)
    used = {dataset.map_of(log) for log in dataset.logs()}
    for path in (Path(fetch_module.__file__).parent / name).glob("*.toml"):
        if path.name != "dataset.toml":
            read_map(path)
            assert path in used


def test_url_names_commit_and_file() -> None:
    dataset = load_dataset("rfly_course")
    url = dataset.url(dataset.files["AccRaw.mat"])
    assert url == (
        "https://raw.githubusercontent.com/RflySim/RflyExpCode/7dbec4d8796d6e23ee86c523e4ba5712203b1519"
        "/code/e3/e3.1/AccRaw.mat"
    )


def test_unknown_data_set() -> None:
    with pytest.raises(InputError, match="one of arducopter_sonar_baro"):
        load_dataset("absent")


@pytest.mark.parametrize("text", ["run1", "run1/", "run1/recording.toml"])
def test_a_folder_is_called_by_its_name_and_a_log_by_its_own(tmp_path: Path, text: str) -> None:
    stream = Stream(np.arange(2.0), dict.fromkeys(MAG, np.ones(2)))
    recording = Recording(name="mag_poses", kind="poses", streams={"mag": stream})
    (tmp_path / "run1").mkdir()
    assert called(str(tmp_path / text), recording) == "run1"
    assert called(str(tmp_path / "run1" / "log.ulg"), recording) == "mag_poses"


def test_what_a_map_reads_beside_a_log_belongs_to_it() -> None:
    """So its checksum is looked at too: of the odometry's log, the seven further topics that its map names."""
    log = "7c824ee5-cf25-4c19-8739-12455adfae23_vehicle_visual_odometry_0.csv"
    dataset = load_dataset("px4_vio_quad")
    topics = {file.name.split("_", 1)[1] for file in dataset.files_of(log)}
    assert topics == {
        "vehicle_visual_odometry_0.csv", "sensor_gyro_0.csv", "vehicle_acceleration_0.csv",
        "vehicle_magnetometer_0.csv", "vehicle_air_data_0.csv", "distance_sensor_0.csv", "battery_status_0.csv",
        "actuator_outputs_2.csv",
    }  # fmt: skip
    assert len(dataset.files_of(".")) == len(dataset.files)
    assert [file.name for file in load_dataset("rfly_course").files_of("e_acc1_A.bin#log")] == ["e_acc1_A.bin"]


@pytest.mark.measured
def test_a_log_that_is_all_of_a_data_set_is_called_by_its_name(measured: Path) -> None:
    assert resolve("px4_quad_64a").name == "px4_quad_64a"


# --- fetching --------------------------------------------------------------------------------------------


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def origin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small data set `demo` whose origin is a server on this machine; returns the folder that it serves."""
    served, cache = tmp_path / "served", tmp_path / "cache"
    served.mkdir()
    (served / "a.txt").write_text("1 2 3\n")
    (served / "b.txt").write_text("4 5 6\n")
    digest = {name: hashlib.sha256((served / name).read_bytes()).hexdigest() for name in ("a.txt", "b.txt")}
    files = {
        "a.txt": DataFile("a.txt", 6, digest["a.txt"], "a.txt"),
        "b.txt.gz": DataFile("b.txt.gz", 30, "0" * 64, "b.txt", packed_from=digest["b.txt"]),
        "derived.txt": DataFile("derived.txt", 6, digest["a.txt"]),
    }
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(served)))
    Thread(target=server.serve_forever, daemon=True).start()
    base = f"http://127.0.0.1:{server.server_address[1]}"
    demo = Dataset("demo", "demo", "Demo", "", "", "", "", files, {})
    monkeypatch.setattr(Dataset, "url", lambda self, file: f"{base}/{file.source}")
    monkeypatch.setattr(fetch_module, "load_dataset", lambda name: demo)
    monkeypatch.setattr(fetch_module, "cache_folder", lambda: cache)
    monkeypatch.delenv("SINAN_DATA", raising=False)
    yield served
    server.shutdown()
    server.server_close()


def test_fetch_downloads_checks_and_packs(origin: Path) -> None:
    seen: list[str] = []
    folder = fetch(["demo"], lambda name, file, done, total: seen.append(f"{file} {done}/{total}"))["demo"]
    assert seen == ["a.txt 0/2", "b.txt.gz 1/2"]
    assert (folder / "a.txt").read_text() == "1 2 3\n"
    assert gzip.decompress((folder / "b.txt.gz").read_bytes()) == b"4 5 6\n"
    assert not (folder / "derived.txt").exists()


def test_fetch_again_downloads_nothing(origin: Path) -> None:
    fetch(["demo"])
    for file in origin.iterdir():
        file.unlink()
    fetch(["demo"])


def test_fetch_of_another_content_is_refused(origin: Path) -> None:
    (origin / "a.txt").write_text("9 9 9\n")
    with pytest.raises(InputError, match=r"a\.txt"):
        fetch(["demo"])


def test_fetch_without_a_network_says_what_else_would_do(origin: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pooch
    import requests

    def unreachable(*args: object, **options: object) -> None:
        raise requests.exceptions.ConnectionError("Max retries exceeded")

    monkeypatch.setattr(pooch, "retrieve", unreachable)
    with pytest.raises(InputError, match=r"no connection .* SINAN_DATA=FOLDER"):
        fetch(["demo"])


def test_fetch_of_a_missing_file(origin: Path) -> None:
    (origin / "a.txt").unlink()
    with pytest.raises(InputError, match="404"):
        fetch(["demo"])


def test_damaged_cache_is_noticed(origin: Path) -> None:
    folder = fetch(["demo"])["demo"]
    (folder / "a.txt").write_text("damaged")
    with pytest.raises(InputError, match="sha256"):
        fetch(["demo"])


def test_mirror_is_checked_not_downloaded(origin: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fetch(["demo"])["demo"]
    monkeypatch.setenv("SINAN_DATA", str(folder.parent))
    with pytest.raises(InputError, match=r"derived\.txt: no such file"):
        fetch(["demo"])


# --- resolving -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nothing", "no such file, folder or data set"),
        ("rfly_course", "rfly_course/FILE"),
        ("rfly_course/absent", "no log of that name"),
        ("rfly_course/e4_ekf_A.bin", "a file without a map"),
    ],
)
def test_unknown_input(text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        resolve(text)


def test_data_set_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.experiments.datasets.inputs.data_roots", lambda: iter([tmp_path]))
    with pytest.raises(InputError, match="sinan fetch rfly_course"):
        resolve("rfly_course/AccRaw.mat")


def test_file_with_another_checksum_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.experiments.datasets.inputs.data_roots", lambda: iter([tmp_path]))
    (tmp_path / "rfly_course").mkdir()
    (tmp_path / "rfly_course" / "AccRaw.mat").write_bytes(b"other")
    with pytest.raises(InputError, match="sha256"):
        resolve("rfly_course/AccRaw.mat")


def test_convert_onto_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text('format = 1\nkind = "poses"\n')
    (tmp_path / "poses.csv").write_text("accel_x,accel_y,accel_z\n0,0,-9.8\n")
    with pytest.raises(InputError, match="another folder"):
        convert(str(tmp_path), tmp_path)


def test_convert_keeps_streams_and_truth(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    (source / "recording.toml").write_text('format = 1\nkind = "poses"\n')
    (source / "poses.csv").write_text("accel_x,accel_y,accel_z\n0,0,-9.8\n")
    (source / "truth.csv").write_text("t,north\n0,1\n")
    convert(str(source), tmp_path / "out")
    truth = resolve(str(tmp_path / "out")).truth
    assert truth is not None
    assert truth.stream["north"] == 1.0
    np.testing.assert_array_equal(open_log(tmp_path / "out").streams["poses"]["accel_z"], [-9.8])


# --- what the logs show ----------------------------------------------------------------------------------


@pytest.fixture
def measured(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The measured data, which `resolve` then uses."""
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    return measured_data


@pytest.mark.measured
@pytest.mark.parametrize("log", ALL_LOGS)
def test_every_log_resolves_and_survives_the_plain_format(measured: Path, log: str, tmp_path: Path) -> None:
    recording = resolve(log)
    if sum(len(stream) for stream in recording.streams.values()) > 30_000:
        return  # the round trip is the same for long ones
    convert(log, tmp_path / "plain")
    again = open_log(tmp_path / "plain")
    for name, stream in recording.streams.items():
        for column in stream.columns:
            np.testing.assert_array_equal(again.streams[name][column], stream[column])
    if recording.truth is None or again.truth is None:
        assert again.truth is recording.truth
        return
    assert (again.truth.kind, again.truth.known) == (recording.truth.kind, recording.truth.known)
    for column in recording.truth.stream.columns:
        np.testing.assert_array_equal(again.truth.stream[column], recording.truth.stream[column])


#: Which of the logs were followed by something that knows better than they do, or at least otherwise.
BETTER = {
    "broad_orientation": "cameras", "robot_arm_marg": "robot", "boulder_walk_imu_2025": "rtk",
    "px4_vio_quad": "other",
}  # fmt: skip


@pytest.mark.measured
@pytest.mark.parametrize("log", ALL_LOGS)
def test_every_log_says_what_its_reference_is(measured: Path, log: str) -> None:
    """By the READMEs of the data sets: all others have what an autopilot thought of itself, or nothing."""
    truth = resolve(log).truth
    assert truth is None or truth.kind == BETTER.get(log.split("/")[0], "autopilot")
    assert truth is None or truth.known


@pytest.mark.measured
def test_autopilot_calibration_is_undone(measured: Path) -> None:
    """The feature points of the binary log are the raw readings of AccRaw.mat; MagRaw.mat and its log agree too."""
    for binary, matlab in (("e_acc1_A.bin", "AccRaw.mat"), ("e3_m_A.bin", "MagRaw.mat")):
        a, b = (resolve(f"rfly_course/{name}").streams["poses"].columns for name in (binary, matlab))
        for column in a:
            np.testing.assert_allclose(a[column], b[column], atol=SINGLE_PRECISION * GRAVITY)


@pytest.mark.measured
def test_direct_path_is_read_as_it_is(measured: Path) -> None:
    direct = open_log(measured / "rfly_course" / "MagRaw.mat").streams["poses"].array(MAG)
    mapped = resolve("rfly_course/MagRaw.mat").streams["poses"].array(MAG)
    np.testing.assert_allclose(mapped - direct, np.tile([0.064, 0.014, -0.053], (240, 1)), atol=1e-12)


def turns(recording: Recording, stream: str, triad: tuple[str, ...]) -> tuple[float, float]:
    """Scale and correlation of how a direction turns with what the gyroscope says, over 0.3 s: both near 1."""
    imu, seen = recording.streams["imu"], recording.streams[stream]
    w = imu.array(GYRO) - np.median(imu.array(GYRO), axis=0)
    t, u = seen.t, seen.array(triad)
    if triad == MAG:  # hard iron: the middle of what goes all round
        u = u - 0.5 * (u.max(axis=0) + u.min(axis=0))
    rate = -np.cross(np.stack([np.interp(t, imu.t, column) for column in w.T], axis=-1), u)
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * np.diff(t)[:, None] * (rate[1:] + rate[:-1]), axis=0)])
    rows = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 0.3)))
    du, expected = np.diff(u[rows], axis=0).ravel(), np.diff(angle[rows], axis=0).ravel()
    return float(expected @ du / (expected @ expected)), float(np.corrcoef(expected, du)[0, 1])


@pytest.mark.measured
@pytest.mark.parametrize(
    ("log", "stream", "triad"),
    [
        ("mpu6050_hmc5883l/full-sphere", "mag", MAG),
        ("mpu6050_hmc5883l/full-sphere", "imu", ACCEL),
        ("xsens_mti_imu_tk/xsens_acc.mat.gz", "imu", ACCEL),
        ("rfly_course/e4_A.bin", "imu", ACCEL),
        ("broad_orientation/02_undisturbed_slow_rotation_B.mat", "mag", MAG),
        ("robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat", "mag", MAG),
        ("robot_arm_marg/eV50p/Sequencia1/MPU9150.mat", "mag", MAG),
    ],
)
def test_gyro_and_direction_turn_together(measured: Path, log: str, stream: str, triad: tuple[str, ...]) -> None:
    scale, correlation = turns(resolve(log), stream, triad)
    assert scale == pytest.approx(1.0, abs=0.2)
    assert correlation > 0.8


@pytest.mark.measured
@pytest.mark.parametrize(
    ("log", "rest"),
    [
        ("broad_orientation/02_undisturbed_slow_rotation_B.mat", slice(0, 1000)),
        ("mpu6050_hmc5883l/unmoved-with-x-pointing-forward", slice(None)),
        ("inertialnav_quads/quad106.zip", slice(0, 20)),
        ("vario_imu_baro/ms5611_datalog", slice(500, 2500)),
        ("robot_arm_marg/eV50p/Sequencia1/MPU9150.mat", slice(0, 50)),
        ("boulder_walk_imu_2025/imu_1730.csv", slice(0, 200)),
        ("rfly_course/e4_A.bin", slice(0, 100)),
        ("px4_esc_lidar_flight/esc_status_log.ulg", slice(-15, None)),
    ],
)
def test_at_rest_the_accelerometer_shows_minus_g_down(measured: Path, log: str, rest: slice) -> None:
    force = resolve(log).streams["imu"].array(ACCEL)[rest].mean(axis=0)
    np.testing.assert_allclose(force, [0.0, 0.0, -GRAVITY], atol=UNCALIBRATED)


@pytest.mark.measured
@pytest.mark.parametrize(
    "log",
    [
        "broad_orientation/02_undisturbed_slow_rotation_B.mat",
        "robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat",
        "robot_arm_marg/eV50p/Sequencia1/MPU9150.mat",
        "inertialnav_quads/quad106.zip",
        "inertialnav_quads/quadOptFlowLogData.zip",
    ],
)
def test_reference_attitude_turns_the_mean_force_upright(measured: Path, log: str) -> None:
    recording = resolve(log)
    assert recording.truth is not None
    imu, reference = recording.streams["imu"], recording.truth.stream
    inside = (imu.t > reference.t[0]) & (imu.t < reference.t[-1])
    q = quaternion_interpolate(imu.t[inside], reference.t, reference.array(("qw", "qx", "qy", "qz")))
    mean_force = rotate(q, imu.array(ACCEL)[inside]).mean(axis=0)
    np.testing.assert_allclose(mean_force, [0.0, 0.0, -GRAVITY], atol=UNCALIBRATED)


@pytest.mark.measured
def test_quaternions_interpolated_through_their_change_of_sign_are_left_out(measured: Path) -> None:
    """The robot's pose is interpolated component by component to the sensor's stamps: 18 rows are no attitude."""
    name = "robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat"
    recording = resolve(name)
    assert recording.truth is not None
    assert len(recording.truth.stream) == len(recording.streams["imu"]) + 1 - 18
    assert any(note.startswith("reference: 18 rows left out") for note in recording.notes)


@pytest.mark.measured
@pytest.mark.parametrize("log", ALL_LOGS)
def test_reference_is_never_in_the_recording(measured: Path, log: str) -> None:
    recording = resolve(log)
    own = {column for stream in recording.streams.values() for column in stream.columns}
    assert not own & {"qw", "qx", "qy", "qz", "roll", "pitch", "yaw"}
