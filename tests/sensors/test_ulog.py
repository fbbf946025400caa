"""ULogs, whole and damaged: what is whole is read as pyulog reads it, what is not is counted and said."""

from __future__ import annotations

import contextlib
import io
import re
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of, open_log
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.logged import recording_of, rising, sound
from sinan.sensors.formats.ulog_messages import read_topics
from sinan.sensors.recording import Stream

WHOLE = "px4_esc_lidar_flight/esc_status_log.ulg"
DAMAGED = "px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg"
SYNC = bytes.fromhex("2f731320250cbb12")
IMU = "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;uint8_t[5] _padding0;"


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def reading(k: int, number: int = 7, padding: int = 5) -> bytes:
    """The IMU of a body at rest, k ms after the start; PX4 does not write the padding at the end."""
    values = struct.pack("<Q6f", 1_000_000 + 1000 * k, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8)
    return message("D", struct.pack("<H", number) + values + bytes(padding))


HEAD = (
    b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    + message("B", bytes(40))
    + message("F", IMU.encode())
    + message("A", b"\0" + struct.pack("<H", 7) + b"sensor_combined")
)  # fmt: skip


def log(path: Path, *parts: bytes) -> Path:
    path.write_bytes(HEAD + b"".join(parts))
    return path


def by_pyulog(path: Path) -> dict[str, np.ndarray]:
    """The topics as PX4's own reader reads them."""
    pyulog = pytest.importorskip("pyulog")
    with contextlib.redirect_stdout(io.StringIO()):
        data = pyulog.ULog(str(path)).data_list
    names = [(one, one.name if one.multi_id == 0 else f"{one.name}#{one.multi_id}") for one in data]
    return {f"{name}.{column}": np.asarray(values) for one, name in names for column, values in one.data.items()}


def rows_of(topics: Mapping[str, np.ndarray], name: str) -> set[tuple[float, ...]]:
    """The readings of a topic, to be found among others."""
    columns = [
        np.nan_to_num(np.asarray(topics[key], np.float64)) for key in sorted(topics) if key.startswith(f"{name}.")
    ]
    return set(zip(*(column.tolist() for column in columns), strict=True))


# --- measured logs ---------------------------------------------------------------------------------------


@pytest.mark.measured
def test_a_whole_log_is_read_as_pyulog_reads_it(measured_data: Path) -> None:
    topics, expected = read_topics(measured_data / WHOLE), by_pyulog(measured_data / WHOLE)
    assert topics.keys() == expected.keys()
    assert topics.notes == ()
    for name, values in expected.items():
        np.testing.assert_array_equal(topics[name], values.astype(np.float64), err_msg=name)


@pytest.mark.measured
def test_a_damaged_log_gives_what_pyulog_reads_of_it_and_more(measured_data: Path) -> None:
    """pyulog goes on at the next sync mark; here at the next message that fits."""
    topics, expected = read_topics(measured_data / DAMAGED), by_pyulog(measured_data / DAMAGED)
    assert topics.keys() == expected.keys()
    for name in {key.split(".")[0] for key in expected}:
        assert rows_of(expected, name) <= rows_of(topics, name), name
    more = topics["sensor_combined.timestamp"]
    assert len(more) > len(expected["sensor_combined.timestamp"])
    assert np.all(np.diff(more) > 0.0)


@pytest.mark.measured
def test_a_damaged_log_is_a_recording_whose_notes_say_what_is_missing(measured_data: Path) -> None:
    recording = open_log(measured_data / DAMAGED)
    assert {"imu", "mag", "baro", "gps", "power"} <= set(recording.streams)
    assert len(recording.streams["imu"]) == 19191  # the 95 s of its README at 201 Hz
    assert "topics that are not announced (number 32812): not read, one such place, 38 bytes" in recording.notes[0]
    assert "no message: not read, 4 such places, 35 bytes, the first at byte 1644033" in recording.notes[1]


@pytest.mark.measured
def test_the_notes_of_a_mapped_log_say_so_too(measured_data: Path, tmp_path: Path) -> None:
    columns = {name: ", ".join(f'"sensor_combined.{name}[{k}]"' for k in range(3)) for name in
               ("accelerometer_m_s2", "gyro_rad")}  # fmt: skip
    (tmp_path / "map.toml").write_text(
        'kind = "flight"\n[streams.imu]\ntime = { column = "sensor_combined.timestamp", unit = "us" }\n'
        f"accel = [{columns['accelerometer_m_s2']}]\ngyro = [{columns['gyro_rad']}]\n"
    )
    recording = open_log(measured_data / DAMAGED, tmp_path / "map.toml")
    assert any("not announced (number 32812)" in note for note in recording.notes)


@pytest.mark.measured
def test_the_reference_is_on_the_clock_of_the_recording(measured_data: Path) -> None:
    """The attitude of the vehicle's own estimator; the first sample of all is one of the motors'."""
    topics, recording = by_pyulog(measured_data / WHOLE), open_log(measured_data / WHOLE)
    start = topics["sensor_combined.timestamp"][0] * 1e-6 - recording.streams["imu"].t[0]
    assert recording.truth is not None
    t = topics["vehicle_attitude.timestamp"] * 1e-6 - start
    np.testing.assert_allclose(recording.truth.stream.t, t, atol=1e-9)


@pytest.mark.measured
@pytest.mark.parametrize("seed", range(5))
def test_a_few_damaged_bytes_cost_a_few_readings(measured_data: Path, tmp_path: Path, seed: int) -> None:
    """Eight holes of 1 to 200 bytes: what they do not touch is read, and nothing that was not there but the touched."""
    rng = np.random.default_rng(seed)
    data = bytearray((measured_data / WHOLE).read_bytes())
    whole = read_topics(measured_data / WHOLE)
    start = len(data) // 5  # beyond the formats and announcements
    for at in rng.integers(start, len(data) - 200, 8):
        size = int(rng.integers(1, 200))
        data[at : at + size] = rng.bytes(size)
    (tmp_path / "log").write_bytes(data)
    topics = read_topics(tmp_path / "log")
    lost = new = 0
    for name in {key.split(".")[0] for key in whole}:
        before, after = rows_of(whole, name), rows_of(topics, name) if f"{name}.timestamp" in topics else set()
        lost, new = lost + len(before - after), new + len(after - before)
    assert lost < 100  # of 9000
    assert new <= 8
    with contextlib.suppress(InputError):
        open_log(tmp_path / "log")


# --- logs written here -----------------------------------------------------------------------------------


def test_readings_with_and_without_the_padding_at_their_end(tmp_path: Path) -> None:
    short = message("D", reading(1)[3:-5])
    topics = read_topics(log(tmp_path / "log", reading(0), short, reading(2)))
    np.testing.assert_array_equal(topics["sensor_combined.timestamp"], [1_000_000, 1_001_000, 1_002_000])
    assert topics.notes == ()
    assert "sensor_combined._padding0[0]" not in topics


@pytest.mark.parametrize(
    ("damage", "note"),
    [
        (
            reading(5, number=9),
            "readings of topics that are not announced (number 9): not read, one such place, 42 bytes",
        ),
        (
            message("D", reading(5)[3:-7]),
            "readings of another size (sensor_combined): not read, one such place, 35 bytes",
        ),
        (message("D", reading(5)[3:] + b"x"), "readings of another size"),
        (b"\xff" * 30, "bytes that are no message: not read, one such place, 30 bytes"),
        (b"D\0D" * 50, "bytes that are no message"),
        (message("S", b"12345678"), "bytes that are no message"),
        (message("Z", b"12345678"), "bytes that are no message"),
        (message("A", b"\0\x08\0unknown_topic"), "topics without a format that can be read (unknown_topic)"),
        (message("F", b"no fields"), "bytes that are no message"),
        (message("O", b"123"), "bytes that are no message"),
    ],
)
def test_what_is_no_message_is_passed_over_and_told(tmp_path: Path, damage: bytes, note: str) -> None:
    path = log(tmp_path / "log", *map(reading, range(4)), damage, *map(reading, range(10, 14)))
    topics = read_topics(path)
    t = (topics["sensor_combined.timestamp"] - 1_000_000) / 1000
    np.testing.assert_array_equal(t, [0, 1, 2, 3, 10, 11, 12, 13])
    at = len(HEAD) + 4 * len(reading(0))
    assert len(topics.notes) == 1
    assert topics.notes[0].startswith(note)
    assert topics.notes[0].endswith(f"the first at byte {at}")


def test_a_log_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    topics = read_topics(log(tmp_path / "log", *map(reading, range(4)), reading(4)[:-3]))
    assert len(topics["sensor_combined.timestamp"]) == 4
    assert topics.notes[0].startswith("what is after the last whole message: not read, one such place, 39 bytes")


def test_data_that_were_appended_after_a_crash(tmp_path: Path) -> None:
    """The last message before them is not whole, as the guide says, and that is no damage."""
    before = HEAD + b"".join(map(reading, range(4))) + reading(4)[:20]
    flags = bytes(8) + b"\1" + bytes(7) + struct.pack("<3Q", len(before), 0, 0)
    (tmp_path / "log").write_bytes(
        before.replace(message("B", bytes(40)), message("B", flags)) + reading(5) + reading(6)
    )
    topics = read_topics(tmp_path / "log")
    t = (topics["sensor_combined.timestamp"] - 1_000_000) / 1000
    np.testing.assert_array_equal(t, [0, 1, 2, 3, 5, 6])
    assert topics.notes == ()


def test_a_log_that_needs_another_reader_is_refused(tmp_path: Path) -> None:
    path = log(tmp_path / "log", reading(0))
    path.write_bytes(path.read_bytes().replace(message("B", bytes(40)), message("B", bytes(8) + b"\2" + bytes(31))))
    with pytest.raises(InputError, match="byte 16: flags 0200000000000000 of what a reader has to know"):
        read_topics(path)


@pytest.mark.parametrize(
    "fields",
    [
        "a:b b;",
        "a:uint8_t[99999] x;a[99999] y;",
        "a:uint8_t[60000] x;uint8_t[60000] y;",
        "a:float x;float x;",
        "a:float",
    ],
)
def test_a_format_that_unfolds_without_end_is_none(tmp_path: Path, fields: str) -> None:
    nested = b"".join(message("F", f"n{k}:n{k + 1}[60000] x;".encode()) for k in range(6))
    announced = [message("A", b"\0\x09\0a"), message("A", b"\0\x0a\0n0"), message("D", b"\x09\0" + bytes(20))]
    path = log(tmp_path / "log", message("F", fields.encode()), nested, message("F", b"n6:"), *announced, reading(0))
    topics = read_topics(path)
    assert {name.split(".")[0] for name in topics} == {"sensor_combined"}
    assert "topics without a format that can be read (" in topics.notes[0]


def test_rows_that_hold_no_number_or_go_back_are_left_out_and_counted(tmp_path: Path) -> None:
    gap = struct.pack("<Q6f", 1_000_000 + 5000, np.nan, 0, 0, 0, 0, -9.8)
    wrong = struct.pack("<Q6f", 2**60, 0, 0, 0, 0, 0, -9.8)
    damaged = [message("D", struct.pack("<H", 7) + body) for body in (gap, wrong)]
    recording = open_log(log(tmp_path / "log", *map(reading, range(4)), *damaged, *map(reading, range(10, 40))))
    assert len(recording.streams["imu"]) == 34
    assert recording.notes == ("imu: 1 rows left out: not a number", "imu: 1 rows left out: the time goes back")


def test_rows_behind_a_leap_of_the_clock_are_left_out_and_counted(tmp_path: Path) -> None:
    late = message("D", struct.pack("<HQ6f", 7, 2**60, 0, 0, 0, 0, 0, -9.8))
    recording = open_log(log(tmp_path / "log", *map(reading, range(40)), late))
    assert len(recording.streams["imu"]) == 40
    assert recording.notes == ("imu: 1 rows left out: their time is more than a day from the others'",)
    t = np.concatenate([np.arange(5.0), 1e9 + np.arange(7.0), 2e9 + np.arange(7.0)])
    kept, _ = sound("imu", Stream(t, {"gyro_x": np.zeros(len(t))}))
    assert kept.t.tolist() == (1e9 + np.arange(7.0)).tolist()
    assert len(sound("imu", Stream(np.empty(0), {}))[0]) == 0


def test_a_log_of_many_topics_without_an_imu_names_a_few() -> None:
    with pytest.raises(InputError, match=r"\(there are t0, t1, .*, t9 and 62 more; `sinan info` lists all\)"):
        recording_of(Path("log.ulg"), {}, there=[f"t{k}" for k in range(72)])


def test_the_longest_choice_of_rows_whose_time_rises() -> None:
    assert np.flatnonzero(rising(np.array([1.0, 9.0, 2.0, 3.0, 3.0, 0.0, 4.0]))).tolist() in (
        [0, 2, 3, 6],
        [0, 2, 4, 6],
    )
    assert np.all(rising(np.array([1.0, 2.0, 3.0])))
    assert len(rising(np.empty(0))) == 0


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (HEAD, "no reading of any topic; expected a log with data"),
        (HEAD + b"\xff" * 99, "no reading of any topic (what is after the last whole message"),
        (b"ULog\x01\x12\x35", "a ULog"),
    ],
)
def test_a_log_without_data(tmp_path: Path, data: bytes, expected: str) -> None:
    (tmp_path / "log").write_bytes(data)
    with pytest.raises(InputError) as caught:
        open_log(tmp_path / "log")
    assert str(tmp_path / "log") in str(caught.value)
    assert expected in str(caught.value)


# --- what is read ----------------------------------------------------------------------------------------

GPS = (
    "sensor_gps:uint64_t timestamp;uint64_t timestamp_sample;double latitude_deg;double longitude_deg;"
    "double altitude_ellipsoid_m;float s_variance_m_s;float eph;float epv;float hdop;float vdop;float vel_n_m_s;"
    "float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;uint8_t satellites_used;uint8_t[2] _padding0;"
)


def with_gps(path: Path, sampled: int, vdop: float = 1.3) -> Path:
    """A log with two fixes, published 1 and 2 ms after the start, and taken `sampled` us before (0: it is not said)."""
    fixes = [
        struct.pack("<HQQ3d8f2B2x", 8, published, published - sampled if sampled else 0, 47.0, 8.0, 400.0,
                    0.2, 0.7, 1.1, 0.9, vdop if k else 1.3, 1.0, 2.0, 3.0, 4, 11)
        for k, published in enumerate((1_001_000, 1_002_000))
    ]  # fmt: skip
    head = HEAD.replace(message("F", IMU.encode()), message("F", IMU.encode()) + message("F", GPS.encode()))
    announced = message("A", b"\0" + struct.pack("<H", 8) + b"sensor_gps")
    path.write_bytes(
        head + announced + b"".join([reading(k) for k in range(30)] + [message("D", fix) for fix in fixes])
    )
    return path


def test_what_a_receiver_says_of_its_fix_is_kept(tmp_path: Path) -> None:
    gps = open_log(with_gps(tmp_path / "a.ulg", 0)).streams["gps"]
    said = gps.array(("eph", "epv", "s_variance", "hdop", "vdop", "satellites"))
    np.testing.assert_allclose(said, np.tile([0.7, 1.1, 0.2, 0.9, 1.3, 11.0], (2, 1)), rtol=1e-6)


def test_what_a_receiver_does_not_say_throughout_costs_no_fix(tmp_path: Path) -> None:
    gps = open_log(with_gps(tmp_path / "a.ulg", 0, vdop=float("nan"))).streams["gps"]
    assert len(gps) == 2
    assert "vdop" not in gps
    assert "hdop" in gps


@pytest.mark.parametrize(("sampled", "t"), [(0, [0.001, 0.002]), (400, [0.0006, 0.0016])])
def test_a_reading_is_stamped_when_it_was_taken_where_the_log_says_it(
    tmp_path: Path, sampled: int, t: list[float]
) -> None:
    gps = open_log(with_gps(tmp_path / "a.ulg", sampled)).streams["gps"]
    np.testing.assert_allclose(gps.t, t, atol=1e-9)


@pytest.mark.measured
def test_samples_that_fill_their_step_are_averages(measured_data: Path) -> None:
    """One log integrates 4.95 of 4.96 ms, the other 4 to 5 of 100 ms."""
    assert open_log(measured_data / DAMAGED).spec("accel").imu_samples == "average"
    assert open_log(measured_data / WHOLE).spec("accel").imu_samples == "instant"


# --- several sensors, and every firmware's names -----------------------------------------------------------


def topics_of(path: Path, *topics: tuple[str, int, str, list[tuple[object, ...]]]) -> Path:
    """A log of some topics: name, instance, fields, readings; formats of arrays are as `struct` writes them."""
    letters = {"uint64_t": "Q", "float": "f", "double": "d", "uint8_t": "B", "int32_t": "i"}
    formats, announced, data = [message("F", IMU.encode())], [], []
    for number, (name, instance, fields, readings) in enumerate(topics, 20):
        form = "<"
        for kind, count in re.findall(r"(\w+)(?:\[(\d+)\])? \w+;", fields):
            form += f"{count or ''}{letters[kind]}"
        formats.append(message("F", f"{name}:{fields}".encode()))
        announced.append(message("A", bytes([instance]) + struct.pack("<H", number) + name.encode()))
        data += [message("D", struct.pack("<H", number) + struct.pack(form, *one)) for one in readings]
    head = HEAD.replace(formats[0], b"".join(dict.fromkeys(formats)))
    path.write_bytes(b"".join([head, *announced, *data, *(reading(k, padding=0) for k in range(30))]))
    return path


TIMES = range(1_000_000, 1_030_000, 2000)
MAGNETOMETER = "uint64_t timestamp;float[3] magnetometer_ga;"
SENSOR = "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;"
IMU_INTEGRALS = (
    "uint64_t timestamp;float[3] delta_angle;float[3] delta_velocity;uint8_t[2] _padding0;float delta_angle_dt;"
    "float delta_velocity_dt;"
)


def two_of_each(path: Path) -> Path:
    return topics_of(
        path,
        ("vehicle_magnetometer", 0, MAGNETOMETER, [(t, 0.2, 0.0, 0.4) for t in TIMES]),
        ("sensor_mag", 0, SENSOR, [(t, t, 0.25, 0.0, 0.4) for t in TIMES]),
        ("sensor_mag", 1, SENSOR, [(t, t, 0.3, 0.0, 0.4) for t in TIMES]),
        ("battery_status", 0, "uint64_t timestamp;float current_a;float voltage_v;", [(t, 5.0, 16.0) for t in TIMES]),
        ("battery_status", 1, "uint64_t timestamp;float current_a;float voltage_v;", [(t, 7.0, 15.0) for t in TIMES]),
        ("actuator_motors", 0, "uint64_t timestamp;float[3] control;",
         [(t, 0.5 + 1e-6 * (t - 1_000_000), 0.25 + 1e-6 * (t - 1_000_000), np.nan) for t in TIMES]),
        ("vehicle_imu", 1, IMU_INTEGRALS,
         [(t, 0.001, 0.0, 0.0, 0.0, 0.0, -0.0196, 0, 0, 2000.0, 2000.0) for t in TIMES]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("choice", "expected"), [(Choice(), 0.2), (Choice(mag=1), 0.3), (Choice(raw=True), 0.25)], ids=["0", "1", "raw"]
)
def test_the_magnetometer_that_is_asked_for(tmp_path: Path, choice: Choice, expected: float) -> None:
    recording = open_log(two_of_each(tmp_path / "a"), choice=choice)
    assert recording.streams["mag"]["mag_x"][0] == pytest.approx(expected)


def test_a_further_imu_is_means_over_its_integrals(tmp_path: Path) -> None:
    recording = open_log(two_of_each(tmp_path / "a"), choice=Choice(imu=1))
    assert recording.streams["imu"]["gyro_x"][0] == pytest.approx(0.5)  # 1 mrad in 2 ms
    assert recording.streams["imu"]["accel_z"][0] == pytest.approx(-9.8, rel=1e-5)
    assert recording.spec("accel").imu_samples == "average"


def test_batteries_and_motors_beside_one_another(tmp_path: Path) -> None:
    streams = open_log(two_of_each(tmp_path / "a")).streams
    power = {name: values[0] for name, values in streams["power"].columns.items()}
    assert power == pytest.approx({"current": 5.0, "voltage": 16.0, "current_2": 7.0, "voltage_2": 15.0})
    assert {name: values[0] for name, values in streams["motors"].columns.items()} == pytest.approx(
        {"motor_1": 0.5, "motor_2": 0.25}
    )


@pytest.mark.parametrize("sensor", ["imu", "mag", "baro", "gps"])
def test_a_sensor_that_is_not_there(tmp_path: Path, sensor: str) -> None:
    with pytest.raises(InputError, match=f"--{sensor}: no {sensor} number 5"):
        open_log(two_of_each(tmp_path / "a"), choice=Choice(**{sensor: 5}))


@pytest.mark.parametrize(
    ("topic", "fields", "values", "stream", "column", "expected"),
    [
        ("sensor_baro", "uint64_t timestamp;float pressure;float temperature;", (950.0, 20), "baro", "pressure", 95e3),
        ("sensor_baro", "uint64_t timestamp;float pressure;float temperature;", (95e3, 20.0), "baro", "pressure", 95e3),
        ("airspeed_validated", "uint64_t timestamp;float true_airspeed_m_s;", (12.0,), "air", "airspeed", 12.0),
        ("sensor_mag", "uint64_t timestamp;float x;float y;float z;", (0.1, 0.2, 0.3), "mag", "mag_z", 0.3),
    ],
)  # fmt: skip
def test_names_of_other_firmware(
    tmp_path: Path, topic: str, fields: str, values: tuple[float, ...], stream: str, column: str, expected: float
) -> None:
    path = topics_of(tmp_path / "a", (topic, 0, fields, [(t, *values) for t in TIMES]))
    assert open_log(path).streams[stream][column][0] == pytest.approx(expected)


def test_outputs_of_a_board_without_speed_controllers_that_talk(tmp_path: Path) -> None:
    rows = [(t, 4, 1500.0 + k, 1250.0 + k, 0.0, 0.0) for k, t in enumerate(TIMES)]
    path = topics_of(tmp_path / "a", ("actuator_outputs", 0, "uint64_t timestamp;uint8_t n;float[4] output;", rows))
    motors = open_log(path).streams["motors"]
    assert list(motors.columns) == ["motor_1", "motor_2"]
    np.testing.assert_allclose(motors.array(("motor_1", "motor_2"))[0], [0.5, 0.25])


def test_what_a_log_says_of_itself(tmp_path: Path) -> None:
    path = log(
        tmp_path / "log",
        message("I", b"\x10char[3] sys_namePX4".replace(b"\x10", bytes([16]))),
        message("P", bytes([16]) + b"float CAL_MAG_SC" + struct.pack("<f", 1.5)),
        message("P", bytes([16]) + b"int32_t SYS_AUTO" + struct.pack("<i", 4001)),
        message("L", b"\x06" + bytes(8) + b"takeoff"),
        *map(reading, range(11)),
    )
    facts = facts_of(path)
    assert facts is not None
    assert (facts.firmware, facts.messages) == ("PX4", ("takeoff",))
    assert facts.parameters == {"CAL_MAG_SC": 1.5, "SYS_AUTO": 4001.0}
    assert facts.tables[0].rate == pytest.approx(1000.0)


@pytest.mark.measured
def test_parameters_are_as_pyulog_reads_them(measured_data: Path) -> None:
    pyulog = pytest.importorskip("pyulog")
    with contextlib.redirect_stdout(io.StringIO()):
        theirs = pyulog.ULog(str(measured_data / WHOLE))
    last = dict(theirs.initial_parameters) | {name: value for _, name, value in theirs.changed_parameters}
    facts = facts_of(measured_data / WHOLE)
    assert facts is not None
    assert facts.parameters == pytest.approx(last)
    assert facts.firmware.startswith(f"{theirs.msg_info_dict['sys_name']} {theirs.msg_info_dict['ver_sw']}")


def test_controllers_that_tell_no_speed_leave_the_commands(tmp_path: Path) -> None:
    commands = [(t, 0.5 + 1e-6 * (t - 1_000_000)) for t in TIMES]
    path = topics_of(tmp_path / "a", ("actuator_motors", 0, "uint64_t timestamp;float[1] control;", commands))
    data = path.read_bytes() + message("F", b"esc:int32_t esc_rpm;")
    formats = message("F", b"esc_status:uint64_t timestamp;uint8_t esc_count;esc[1] esc;")
    rows = b"".join(message("D", struct.pack("<HQBi", 30, t, 1, 0)) for t in TIMES)
    path.write_bytes(data + formats + message("A", b"\0\x1e\0esc_status") + rows)
    topics = read_topics(path)
    assert not np.any(topics["esc_status.esc[0].esc_rpm"])
    assert open_log(path).streams["motors"]["motor_1"][0] == pytest.approx(0.5)
