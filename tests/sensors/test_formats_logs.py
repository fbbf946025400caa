"""Logs told by their content: what can be read, and what a damaged one says."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from sinan.experiments.datasets import resolve
from sinan.sensors.errors import InputError
from sinan.sensors.formats import open_log
from sinan.sensors.formats.columns import FileOptions, content_of, notes_of, read_columns
from sinan.sensors.formats.matlab import read_matlab
from sinan.sensors.formats.mwlog import MwlogWriter, read_mwlog
from sinan.sensors.formats.records import RecordLayout, read_records
from sinan.sensors.formats.ubx import read_ubx

POSES = np.array([[0.0, 0.0, -9.8], [9.8, 0.0, 0.0], [0.0, 9.8, 0.1], [0.0, -9.8, 0.2]])


def mwlog(values: np.ndarray, kind: int = 2, signals: int | None = None, size: int | None = None) -> bytes:
    """An MWLOGV01 log of singles; `signals` and `size` overwrite what its header says."""
    count = values.shape[1] if signals is None else signals
    header = struct.pack("<8sIBBH", b"MWLOGV01", 0, count, kind, 4 * values.shape[1] if size is None else size)
    return header + values.astype("<f4").tobytes()


def ubx(payload: bytes, kind: bytes = b"\x01\x07") -> bytes:
    """A UBX message with its checksum."""
    body = kind + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a, b = (a + byte) & 0xFF, (b + a + byte) & 0xFF
    return b"\xb5\x62" + body + bytes((a, b))


def message(path: Path) -> str:
    """The one line that reading raises."""
    with pytest.raises(InputError) as caught:
        open_log(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- what a log is ---------------------------------------------------------------------------------------


def test_content_not_suffix_decides(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    scipy.io.savemat(path, {"acc": POSES}, appendmat=False)
    assert content_of(path) == "matlab"
    assert len(open_log(path).streams["poses"]) == len(POSES)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "an empty file"),
        (mwlog(POSES), "MWLOGV01"),
        (b"1 2 3\n", "text or unknown data"),
        (b"PK\x03\x04rest", "a zip"),
        (b"\x1f\x8b\x08rest", "compressed data"),
        (bytes(range(256)), "text or unknown data"),
    ],
)
def test_log_without_map_says_what_it_is(tmp_path: Path, content: bytes, found: str) -> None:
    (tmp_path / "log").write_bytes(content)
    text = message(tmp_path / "log")
    assert found in text
    assert "--map" in text


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in message(tmp_path / "absent.bin")


# --- MATLAB ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["AccRaw", "acc"])
@pytest.mark.parametrize("array", [POSES, POSES.T, POSES[:3]])
def test_matlab_poses(tmp_path: Path, name: str, array: np.ndarray) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {name: array}, do_compression=len(array) == 4)
    recording = open_log(tmp_path / "a.mat")
    rows = array if array.shape[0] == 4 else array.T
    assert recording.kind == "poses"
    np.testing.assert_array_equal(recording.streams["poses"].array(("accel_x", "accel_y", "accel_z")), rows)
    np.testing.assert_array_equal(recording.streams["poses"].t, np.arange(len(rows)))


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"x": POSES}, "variables x"),
        ({"acc": POSES, "mag": POSES}, "one of AccRaw"),
        ({"acc": np.ones((4, 4))}, "3 x n"),
        ({"acc": np.ones((3, 4, 5))}, "3 x n"),
        ({"acc": 3.0}, "3 x n"),
        ({"acc": POSES * np.nan}, "nan"),
        ({"acc": "text"}, "no variable that holds numbers"),
        ({"acc": POSES + 1j}, "no variable that holds numbers"),
        ({"acc": {"field": "text"}}, "no variable that holds numbers"),
        ({"acc": {"field": POSES}}, "variables acc.field"),
        ({"acc": np.array([(POSES,), (POSES,)], dtype=[("field", object)])}, "no variable that holds numbers"),
        ({"acc": np.array([POSES, "x"], dtype=object)}, "no variable that holds numbers"),
        ({"acc": POSES / 9.8}, "looks like g"),
    ],
)
def test_matlab_variable_that_does_not_fit(tmp_path: Path, variables: dict[str, object], expected: str) -> None:
    scipy.io.savemat(tmp_path / "a.mat", variables)
    assert expected in message(tmp_path / "a.mat")


@pytest.mark.parametrize("kind", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"])
def test_matlab_numbers_are_those_of_scipy(tmp_path: Path, kind: str) -> None:
    arrays = {"a": np.arange(12).reshape(3, 4).astype(kind), "b": np.arange(24).reshape(2, 3, 4).astype(kind), "c": 3}
    scipy.io.savemat(tmp_path / "a.mat", arrays, do_compression=kind.startswith("i"))
    expected = scipy.io.loadmat(tmp_path / "a.mat")
    found = read_matlab(tmp_path / "a.mat")
    for name in arrays:
        np.testing.assert_array_equal(found[name].squeeze(), expected[name].squeeze())


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_fields_of_a_structure_are_variables(tmp_path: Path, compressed: bool) -> None:
    inner = {"of_a_name_that_is_longer_than_most": np.arange(5.0)}
    flight = {"lat": POSES[:, :1], "note": "text", "mode": np.array([1, 2], dtype="u1"), "inner": inner, "none": []}
    scipy.io.savemat(tmp_path / "a.mat", {"flight": flight, "t": 3.0}, do_compression=compressed, long_field_names=True)
    found = read_matlab(tmp_path / "a.mat")
    assert set(found) == {
        "flight.lat", "flight.mode", "flight.inner.of_a_name_that_is_longer_than_most", "flight.none", "t",
    }  # fmt: skip
    np.testing.assert_array_equal(found["flight.lat"], POSES[:, 0])
    np.testing.assert_array_equal(found["flight.mode"], [1.0, 2.0])
    np.testing.assert_array_equal(found["flight.inner.of_a_name_that_is_longer_than_most"], np.arange(5.0))


def test_matlab_structures_within_one_another_end(tmp_path: Path) -> None:
    nest: dict[str, object] = {"x": POSES}
    for _ in range(30):
        nest = {"s": nest}
    scipy.io.savemat(tmp_path / "a.mat", {**nest, "y": POSES})
    assert list(read_matlab(tmp_path / "a.mat")) == ["y"]


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("content", [POSES, {"x": POSES}])
def test_matlab_cut_off_anywhere(tmp_path: Path, compressed: bool, content: object) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"mag": content}, do_compression=compressed)
    data = (tmp_path / "a.mat").read_bytes()
    for end in range(20, len(data), 7):
        (tmp_path / "b.mat").write_bytes(data[:end])
        with pytest.raises(InputError):
            open_log(tmp_path / "b.mat")


def test_matlab_length_beyond_the_file_allocates_nothing(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"mag": POSES})
    data = bytearray((tmp_path / "a.mat").read_bytes())
    data[132:136] = struct.pack("<I", 2**32 - 1)
    (tmp_path / "a.mat").write_bytes(data)
    assert "an element of 4294967295 bytes" in message(tmp_path / "a.mat")


def test_matlab_dimensions_beyond_the_data(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"mag": POSES})
    data = (tmp_path / "a.mat").read_bytes()
    shape, huge = struct.pack("<ii", *POSES.shape), struct.pack("<ii", 2**30, 3)
    assert data.count(shape) == 1
    (tmp_path / "a.mat").write_bytes(data.replace(shape, huge))
    assert "1073741824 x 3 in 96 bytes" in message(tmp_path / "a.mat")


def test_matlab_that_unfolds_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.sensors.formats.matlab.UNFOLDED_LIMIT", 10_000)
    scipy.io.savemat(tmp_path / "a.mat", {"mag": np.zeros((3, 10_000))}, do_compression=True)
    assert "in compressed elements" in message(tmp_path / "a.mat")


def test_hdf5_poses_and_oddities(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["mag"] = POSES  # HDF5 lists dimensions in the opposite order of MATLAB: 3 x 4 there
        file["words"] = "text"
        file.create_group("group")
        file["elsewhere"] = h5py.ExternalLink("other.mat", "/x")
        file["nowhere"] = h5py.SoftLink("/absent")
    assert len(open_log(tmp_path / "a.mat").streams["poses"]) == len(POSES)


@pytest.mark.parametrize("shape", [(0,), (4,), (2, 2), (3, 4, 5), ()])
def test_hdf5_of_another_shape(tmp_path: Path, shape: tuple[int, ...]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["acc"] = np.ones(shape)
    with pytest.raises(InputError):
        open_log(tmp_path / "a.mat")


def test_hdf5_that_says_ten_gigabytes(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file.create_dataset("mag", shape=(3, 450_000_000), dtype="f8", chunks=(3, 1000))
    assert (tmp_path / "a.mat").stat().st_size < 100_000
    assert "450000000" in message(tmp_path / "a.mat")


def test_hdf5_cut_off(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["mag"] = POSES
    data = (tmp_path / "a.mat").read_bytes()
    for end in range(8, len(data), 97):
        (tmp_path / "b.mat").write_bytes(data[:end])
        with pytest.raises(InputError):
            open_log(tmp_path / "b.mat")


@settings(max_examples=80, deadline=None)
@given(at=st.integers(128, 400), byte=st.integers(0, 255), compressed=st.booleans(), nested=st.booleans())
def test_matlab_with_one_wrong_byte(
    tmp_path_factory: pytest.TempPathFactory, at: int, byte: int, compressed: bool, nested: bool
) -> None:
    path = tmp_path_factory.mktemp("mat") / "a.mat"
    scipy.io.savemat(path, {"mag": {"x": POSES} if nested else POSES}, do_compression=compressed)
    data = bytearray(path.read_bytes())
    data[at % len(data)] = byte
    path.write_bytes(data)
    with suppress(InputError):
        read_matlab(path)


# --- MWLOGV01 --------------------------------------------------------------------------------------------


def test_mwlog_round_trip(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(mwlog(POSES))
    columns = read_mwlog(tmp_path / "a")
    np.testing.assert_array_equal(np.stack([columns[k] for k in "123"], axis=1), POSES.astype(np.float32))


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"MWLOGV02" + bytes(8), "magic"),
        (b"MWLOGV01\0\0", "a header of 10 bytes"),
        (mwlog(POSES, kind=77), "type 77"),
        (mwlog(POSES)[:-1], "cut off"),
        (mwlog(POSES, signals=255, size=65535), "records of 65535 bytes with 255 signals"),
        (mwlog(POSES, signals=0, size=0), "at least one signal"),
        (mwlog(POSES, size=8), "3 x 4"),
    ],
)
def test_mwlog_damaged(tmp_path: Path, data: bytes, expected: str) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(InputError, match=expected):
        read_mwlog(tmp_path / "a")


@pytest.mark.parametrize("kind", range(1, 10))
def test_mwlog_is_written_as_it_is_read(tmp_path: Path, kind: int) -> None:
    values = np.arange(12.0).reshape(4, 3) * (0.5 if kind < 3 else 1.0)
    with MwlogWriter(tmp_path / "a", 3, kind) as log:
        log.write(values[:3])
        log.write(values[3])
    columns = read_mwlog(tmp_path / "a")
    np.testing.assert_array_equal(np.stack([columns[k] for k in "123"], axis=1), values)


@pytest.mark.parametrize("name", ["e_acc1_A.bin", "e3_m_A.bin", "e4_A.bin"])
def test_the_courses_logs_are_written_byte_by_byte(tmp_path: Path, measured_data: Path, name: str) -> None:
    path = measured_data / "rfly_course" / name
    columns, theirs = read_mwlog(path), path.read_bytes()
    with MwlogWriter(tmp_path / name, len(columns), begun=int.from_bytes(theirs[8:12], "little")) as log:
        log.write(np.stack(list(columns.values()), axis=1))
    assert (tmp_path / name).read_bytes() == theirs


def test_what_an_mwlog_does_not_take(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="256 signals; expected 1 to 255"):
        MwlogWriter(tmp_path / "a", 256)
    with MwlogWriter(tmp_path / "a", 2, kind=7) as log:
        for values, expected in (([1.0, 2.0, 3.0], "records of 3 signals"), ([1.0, 200.0], "too large"),
                                 ([0.5, 0.0], "not whole")):  # fmt: skip
            with pytest.raises(InputError, match=expected):
                log.write(np.array(values))
    assert len(read_mwlog(tmp_path / "a")["1"]) == 0


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=80))
def test_mwlog_any_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("mwlog") / "a"
    path.write_bytes(b"MWLOGV01" + data)
    try:
        columns = read_mwlog(path)
    except InputError:
        return
    assert sum(column.size for column in columns.values()) <= len(data)


# --- fixed records, u-blox, dataflash, compressed text ---------------------------------------------------

LAYOUT = RecordLayout((("magic", "uint16"), ("more", "uint8"), ("x", "float32")), 0xA55A, (("h", "int32"),), "more")


def test_records_with_a_tail(tmp_path: Path) -> None:
    data = b"".join(
        struct.pack("<HBf", 0xA55A, k % 2, k) + (struct.pack("<i", 100 * k) if k % 2 else b"") for k in range(5)
    )
    (tmp_path / "a").write_bytes(data)
    columns = read_records(tmp_path / "a", LAYOUT)
    np.testing.assert_array_equal(columns["x"], np.arange(5))
    np.testing.assert_array_equal(columns["tail.h"], [100, 300])
    np.testing.assert_array_equal(columns["tail.row"], [1, 3])


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "no record"),
        (struct.pack("<HBf", 0xA55B, 0, 1), "byte 0, record 1: 0xa55b"),
        (struct.pack("<HBf", 0xA55A, 0, 1) + b"\x5a", "byte 7, record 2: a record cut off"),
        (struct.pack("<HBf", 0xA55A, 1, 1), "tail is cut off"),
    ],
)
def test_records_damaged(tmp_path: Path, data: bytes, expected: str) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(InputError, match=expected):
        read_records(tmp_path / "a", LAYOUT)


def test_ubx_passes_over_other_messages(tmp_path: Path) -> None:
    payload = struct.pack("<I", 1000) + bytes(20) + struct.pack("<ii", 1_160_000_000, 400_000_000) + bytes(60)
    (tmp_path / "a").write_bytes(b"$GNGGA\r\n" + ubx(b"\0" * 4, b"\x01\x22") + ubx(payload))
    columns = read_ubx(tmp_path / "a")
    assert columns["NAV-PVT.iTOW"] == 1000
    assert columns["NAV-PVT.lat"] == 400_000_000


def solution(ms: int, fix: int = 3, flags: int = 1, north: int = 0) -> bytes:
    """NAV-PVT by its places: iTOW 0, fixType 20, flags 21, numSV 23, lon 24, lat 28, height 32, hAcc 40, velN 48."""
    payload = bytearray(92)
    for at, form, value in (
        (0, "<I", ms), (20, "B", fix), (21, "B", flags), (23, "B", 17), (24, "<i", 85_000_000), (28, "<i", 470_000_000),
        (32, "<i", 400_000), (40, "<I", 900), (44, "<I", 1500), (48, "<i", north), (68, "<I", 200), (76, "<H", 150),
    ):  # fmt: skip
        struct.pack_into(form, payload, at, value)
    return ubx(bytes(payload))


def test_a_receiver_alone_is_a_recording_across_the_end_of_the_week(tmp_path: Path) -> None:
    week = 604_800_000
    fixes = [solution((week - 2000 + 1000 * k) % week, north=1000 * k) for k in range(5)]
    (tmp_path / "a").write_bytes(b"".join([solution(week - 3000, fix=0), solution(week - 2500, flags=0), *fixes]))
    recording = open_log(tmp_path / "a")
    gps = recording.streams["gps"]
    np.testing.assert_allclose(gps.t, np.arange(5.0))
    np.testing.assert_allclose(gps["vel_north"], np.arange(5.0))
    said = gps.array(("eph", "epv", "s_variance", "pdop", "satellites"))[0]
    np.testing.assert_allclose(said, [0.9, 1.5, 0.2, 1.5, 17.0])
    assert recording.origin == pytest.approx((47.0, 8.5, 400.0))
    assert "gps: 2 of 7 solutions without a fix left out" in recording.notes
    (tmp_path / "a").write_bytes(solution(0, fix=0))
    assert "no gps" in message(tmp_path / "a")


@pytest.mark.measured
def test_a_measured_log_of_a_receiver_is_as_its_map_reads_it(measured_data: Path) -> None:
    own = open_log(measured_data / "gnss" / "boulder_walk_imu_2025" / "gnss_1730.ubx").streams["gps"]
    mapped = resolve("boulder_walk_imu_2025/gnss_1730.ubx").streams["gps"]
    assert len(own) == len(mapped)
    for name in ("vel_north", "vel_down", "eph", "s_variance", "pdop", "satellites"):
        np.testing.assert_allclose(own[name], mapped[name], rtol=1e-12)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (ubx(bytes(92))[:-1], "no NAV-PVT message; the last message is cut off: its 99 bytes left out"),
        (ubx(bytes(92))[:4] + b"\xff\xff" + ubx(bytes(92)), "a message of 65535 bytes that is cut off"),
        (ubx(bytes(92))[:-1] + b"\0", "checksum"),
        (ubx(bytes(80)), "NAV-PVT of 80 bytes"),
        (ubx(b"", b"\x01\x22"), "no NAV-PVT"),
        (b"\xb5\x62\x01\x07\xff\xff", "no NAV-PVT message; the last message is cut off: its 6 bytes left out"),
    ],
)
def test_ubx_damaged(tmp_path: Path, data: bytes, expected: str) -> None:
    (tmp_path / "a").write_bytes(data)
    with pytest.raises(InputError, match=expected):
        read_ubx(tmp_path / "a")


@pytest.mark.parametrize("left", [3, 23, 99])
def test_a_last_ubx_message_that_is_cut_off_is_left_out(tmp_path: Path, left: int) -> None:
    whole = b"".join(solution(1000 * k) for k in range(3))
    (tmp_path / "a.ubx").write_bytes(whole + solution(3000)[:left])
    note = f"the last message is cut off: its {left} bytes left out"
    recording = open_log(tmp_path / "a.ubx")
    np.testing.assert_allclose(recording.streams["gps"].t, np.arange(3.0))
    assert note in recording.notes
    assert notes_of(read_ubx(tmp_path / "a.ubx")) == (note,)


@pytest.mark.parametrize(
    ("solutions", "why"),
    [
        ([solution(0, fix=5), solution(1000, fix=5)], "2 of the time only (fixType 5)"),
        ([solution(0, fix=0), solution(1000, fix=2)], "1 without a fix (fixType 0), 1 in two dimensions (fixType 2)"),
        ([solution(0, flags=0)], "1 not within the receiver's own limits (gnssFixOK)"),
        ([solution(0, fix=9)], "1 of an unknown fixType"),
    ],
)
def test_solutions_that_are_no_fix_say_why(tmp_path: Path, solutions: list[bytes], why: str) -> None:
    (tmp_path / "a.ubx").write_bytes(b"".join(solutions))
    expected = f"no gps, since no solution is a fix in three dimensions: {why}; expected a receiver that solves for"
    assert expected in message(tmp_path / "a.ubx")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("CTUN, 1, x\n", "line 2: `x` in CTUN.Alt"),
        ("CTUN, 1\n", "line 2: 1 fields"),
        ("CTUN, 1, \xff\n", "UTF-8"),
    ],
)
def test_dataflash_damaged(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "a").write_bytes(("FMT, 128, 9, CTUN, ff, Thr,Alt\n" + text).encode("latin-1"))
    with pytest.raises(InputError, match=expected):
        read_columns(tmp_path / "a", FileOptions(), {"CTUN.Alt"})


@pytest.mark.parametrize("content", [b"\x1f\x8b\x08\x00damaged", b"PK\x03\x04damaged"])
def test_compressed_text_damaged(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match="undamaged compressed file"):
        read_columns(tmp_path / "a", FileOptions(member="x"), {"1"})


def test_compressed_text_that_unfolds_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import gzip

    monkeypatch.setattr("sinan.sensors.formats.packed.LARGEST", 1000)
    (tmp_path / "a").write_bytes(gzip.compress(b"0" * 100_000))
    with pytest.raises(InputError, match="once unfolded"):
        read_columns(tmp_path / "a", FileOptions(), {"1"})
