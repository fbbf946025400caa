"""What a small file may cost: unfolded sizes, columns, cells and numbers are bounded, and messages say the bound."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from sinan.sensors.errors import InputError, printable
from sinan.sensors.formats import open_log
from sinan.sensors.formats.columns import FileOptions, read_columns
from sinan.sensors.formats.plain import read_recording
from sinan.sensors.formats.rinex import read_observations
from sinan.sensors.formats.toml_table import load_toml
from sinan.sensors.recording import ACCEL, Recording, Stream
from tests.estimator import gnss_simulation as simulation

MIB = 2**20
ZEROS = 100 * MIB  # bytes that a kilobyte of bzip2 unfolds to
MEMORY = 80 * MIB  # bytes of address space beside what the interpreter and its libraries take
BOUND = 8 * MIB  # of the reader's, in place of a gigabyte: the test is the faster


def zipped(data: bytes, method: int, name: str = "log.txt") -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr(name, data)
    return file.getvalue()


PACK: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.compress,
    "bzip2": bz2.compress,
    "xz": lzma.compress,
    "zip": lambda data: zipped(data, zipfile.ZIP_DEFLATED),
    "zip of bzip2": lambda data: zipped(data, zipfile.ZIP_BZIP2),
    "zip of LZMA": lambda data: zipped(data, zipfile.ZIP_LZMA),
}
OPTIONS = FileOptions(member="log.txt")


def error(read: Callable[[], object]) -> str:
    """The one line that reading raises."""
    with pytest.raises(InputError) as caught:
        read()
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- packed text -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("pack", PACK.values(), ids=PACK)
def test_packed_text_is_read(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    (tmp_path / "log").write_bytes(pack(b"1,2\n3,4\n"))
    columns = read_columns(tmp_path / "log", OPTIONS, {"1", "2"})
    np.testing.assert_array_equal(columns["2"], [2.0, 4.0])


@pytest.mark.parametrize("pack", PACK.values(), ids=PACK)
def test_what_a_few_bytes_unfold_to_is_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pack: Callable[[bytes], bytes]
) -> None:
    monkeypatch.setattr("sinan.sensors.formats.packed.LARGEST", MIB)
    (tmp_path / "log").write_bytes(pack(b"0" * (MIB + 1)))
    text = error(lambda: read_columns(tmp_path / "log", OPTIONS, {"1"}))
    assert text.startswith(f"{tmp_path}/log: more than 1 MiB once unfolded; expected at most 1 MiB")


@pytest.mark.parametrize("pack", PACK.values(), ids=PACK)
def test_damaged_in_any_way_is_one_line(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    """Every byte of the packed log in turn, wrong; and the log cut off there."""
    good = pack(b"1,2\n3,4\n" * 20)
    for k in range(len(good)):
        for bad in (good[:k] + bytes([good[k] ^ 0xFF]) + good[k + 1 :], good[:k]):
            (tmp_path / "log").write_bytes(bad)
            with contextlib.suppress(InputError):
                read_columns(tmp_path / "log", OPTIONS, {"1", "2"})


#: Reads a log in a process whose address space is bounded: where the bound is not kept, that process fails.
_READ = """
import resource, sys
from pathlib import Path
from sinan.sensors.errors import InputError
from sinan.sensors.formats.columns import FileOptions, read_columns
from sinan.sensors.formats.rinex import read_observations
import pandas, sinan.sensors.formats.packed as packed
packed.LARGEST = {bound}
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {memory}, used + {memory}))
try:
    if sys.argv[2] == "rinex":
        read_observations(Path(sys.argv[1]))
    else:
        read_columns(Path(sys.argv[1]), FileOptions(member=sys.argv[3]), {{"1", "2"}})
except InputError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def bombs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Hundreds of megabytes of zeros in a kilobyte of bzip2, alone and in a zip."""
    folder = tmp_path_factory.mktemp("bombs")
    (folder / "bzip2").write_bytes(bz2.compress(bytes(ZEROS)))
    (folder / "zip").write_bytes(zipped(bytes(ZEROS), zipfile.ZIP_BZIP2))
    assert max(path.stat().st_size for path in folder.iterdir()) < 1000
    return folder


@pytest.mark.parametrize(("name", "kind"), [("bzip2", "text"), ("zip", "text"), ("bzip2", "rinex"), ("zip", "rinex")])
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the bound on memory is set as Linux has it")
def test_kilobytes_that_unfold_to_gigabytes_take_bounded_memory(bombs: Path, name: str, kind: str) -> None:
    command = [sys.executable, "-c", _READ.format(memory=MEMORY, bound=BOUND), str(bombs / name), kind, "log.txt"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    assert "more than 8 MiB once unfolded" in result.stdout


def test_compact_rinex_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compact RINEX says only what changes: an epoch of many satellites that stay the same is a line end each."""
    hatanaka = pytest.importorskip("hatanaka")
    navigation = simulation.messages("GE")
    text = simulation.observation_3(simulation.observe(navigation, simulation.START + 30.0 * np.arange(20)))
    (tmp_path / "log").write_bytes(hatanaka.rnx2crx(text.encode()))
    assert len(read_observations(tmp_path / "log").t) > 0
    monkeypatch.setattr("sinan.sensors.formats.packed.LARGEST", len(text) // 2)
    monkeypatch.setattr("sinan.sensors.formats.packed.size_shown", str)
    found = error(lambda: read_observations(tmp_path / "log"))
    assert f"more than {len(text) // 2}" in found


def test_rinex_packed_by_compress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ncompress = pytest.importorskip("ncompress")
    (tmp_path / "log").write_bytes(ncompress.compress(b"0" * 5 * MIB))
    monkeypatch.setattr("sinan.sensors.formats.packed.LARGEST", MIB)
    assert "more than 1 MiB once unfolded" in error(lambda: read_observations(tmp_path / "log"))


# --- tables ----------------------------------------------------------------------------------------------


def imu(tmp_path: Path, header: str, *rows: str) -> Path:
    """A recording of an IMU."""
    (tmp_path / "recording.toml").write_text('format = 1\nkind = "flight"\n')
    (tmp_path / "imu.csv").write_text("\n".join([header, *rows]) + "\n")
    return tmp_path


PLAIN = "t,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"
ROW = "0,0,0,-9.8,0,0,0"


def test_columns_are_bounded(tmp_path: Path) -> None:
    names = ",".join(f"c{k}" for k in range(5000))
    text = error(lambda: read_recording(imu(tmp_path, f"{PLAIN},{names}")))
    assert text == f"{tmp_path}/imu.csv, line 1: 5007 columns; expected at most 4096"
    (tmp_path / "log").write_text("1," * 5000 + "1\n")
    text = error(lambda: read_columns(tmp_path / "log", FileOptions(), {"1"}))
    assert text == f"{tmp_path}/log, line 1: 5001 columns; expected at most 4096"


def test_covariates_are_bounded(tmp_path: Path) -> None:
    names = ",".join(f"c{k}" for k in range(65))
    text = error(lambda: read_recording(imu(tmp_path, f"{PLAIN},{names}", ROW + ",1" * 65)))
    assert "imu.csv, stream imu: 65 further columns" in text
    assert "expected at most 64 besides the format's own" in text


def test_a_row_without_end_is_bounded(tmp_path: Path) -> None:
    """Tokenised as it is, a gigabyte of commas takes 16."""
    folder = imu(tmp_path, PLAIN, ROW, "1" + "," * 3 * MIB)
    for path in (
        lambda: read_recording(folder),
        lambda: read_columns(folder / "imu.csv", FileOptions(header=True), {"t"}),
    ):
        assert "imu.csv: a line of more than 1 MiB; expected lines of at most 1 MiB" in error(path)


def test_text_cells_of_columns_that_nobody_asked_for_are_not_kept(tmp_path: Path) -> None:
    """A cell of text takes 50 bytes and more: of 8 million at once 400 MB."""
    (tmp_path / "log").write_bytes((b"1" + b",a" * 200 + b"\n") * 40_000)
    code = (
        "import resource, sys\nfrom pathlib import Path\n"
        "from sinan.sensors.formats.columns import FileOptions, read_columns\n"
        "import pandas\nbefore = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "n = len(read_columns(Path(sys.argv[1]), FileOptions(), {'1'})['1'])\n"
        "print(n, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "log")]
    rows, kilobytes = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert int(rows) == 40_000
    assert int(kilobytes) < 250_000


def test_numbers_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.sensors.formats.packed.MOST_NUMBERS", 20)
    rows = [ROW.replace("0", str(k), 1) for k in range(4)]
    assert "28 numbers; expected at most 20" in error(lambda: read_recording(imu(tmp_path, PLAIN, *rows)))


def test_many_columns_of_text_are_left_out_in_one_go(tmp_path: Path) -> None:
    """Text in the last row alone, of fifty columns: they are all found at the first look."""
    names = [f"c{k}" for k in range(50)]
    rows = [f"{k},0,0,-9.8,0,0,0" + ",1" * 50 for k in range(3)] + ["3,0,0,-9.8,0,0,0" + ",x" * 50]
    recording = read_recording(imu(tmp_path, f"{PLAIN},{','.join(names)}", *rows))
    assert list(recording.streams["imu"].columns) == PLAIN.split(",")[1:]
    assert f"left out: {', '.join(names)}" in recording.notes[0]


@pytest.mark.parametrize("value", ["1e300", "-1e31"])
def test_a_reading_beyond_every_unit_is_named(tmp_path: Path, value: str) -> None:
    text = error(lambda: read_recording(imu(tmp_path, PLAIN, ROW, f"1,{value},0,-9.8,0,0,0")))
    assert "imu.csv, stream imu, row 2:" in text
    assert "in column accel_x; expected at most 1e+30" in text


# --- TOML ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = 1\ny = " + "9" * 5001, "line 2: a whole number of more than 4300 digits"),
        ("\nx = " + "[" * 5000 + "]" * 5000, "line 2: more than 20 tables and lists in one another"),
        ("x = " + "{x=" * 3000 + "1" + "}" * 3000, "line 1: more than 20 tables and lists in one another"),
        ("x" + ".x" * 3000 + " = 1", "key x: more than 20 tables and lists in one another"),
        ("[x" + ".x" * 30 + "]", "key x: more than 20 tables and lists in one another"),
        ("# " + "x" * 2**18, "more than 262144 bytes"),
        ("x = 1\nx = 2\n", "line 2"),
    ],
)
def test_toml_is_bounded(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    found = error(lambda: load_toml(tmp_path / "a.toml"))
    assert found.startswith(f"{tmp_path}/a.toml")
    assert expected in found


# --- MATLAB ----------------------------------------------------------------------------------------------

POSES = np.eye(3).repeat(2, axis=1) * 9.8


def test_hdf5_that_leads_into_other_files_is_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(POSES.tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["acc"] = POSES
    with h5py.File(tmp_path / "external.mat", "w") as file:
        file.create_dataset("acc", shape=POSES.shape, dtype="f8", external=[(str(tmp_path / "secret"), 0, 200)])
    layout = h5py.VirtualLayout(shape=POSES.shape, dtype="f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "acc", shape=POSES.shape)
    with h5py.File(tmp_path / "virtual.mat", "w") as file:
        file.create_virtual_dataset("acc", layout)
    for name in ("external.mat", "virtual.mat"):
        with h5py.File(tmp_path / name) as file:
            np.testing.assert_array_equal(file["acc"][()], POSES)  # what it leads to is there
        text = error(lambda name=name: open_log(tmp_path / name))
        assert (
            text
            == f"{tmp_path}/{name}, variable acc: numbers that lie in other files; expected a file that holds its own"
        )


def test_bytes_count_as_the_doubles_that_they_become(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file.create_dataset("mag", shape=(3, 40_000_000), dtype="u1", chunks=(3, 1000))
    assert "less than 512 MiB" in error(lambda: open_log(tmp_path / "a.mat"))


def test_numbers_of_a_matlab_file_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sinan.sensors.formats.packed.MOST_NUMBERS", 20)
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.ones(11), "y": np.ones(11)}, do_compression=True)
    assert "22 numbers; expected at most 20" in error(lambda: open_log(tmp_path / "a.mat"))


# --- what a terminal sees --------------------------------------------------------------------------------

CLEAR = "\x1b[2J\x9b31m\u202e\x07\r\n"  # clears the screen, colours, turns the direction of writing, rings


def test_control_characters_of_cells_and_names_are_escaped(tmp_path: Path) -> None:
    cell = error(lambda: read_recording(imu(tmp_path, PLAIN, ROW, "1,\x1b[2Jx,0,-9.8,0,0,0")))
    assert r"`\x1b[2Jx` in column accel_x" in cell
    scipy.io.savemat(tmp_path / "a.mat", {"x": POSES})
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(data.replace(b"\x01\0\x01\0x\0", b"\x01\0\x01\0\x1b\0"))
    name = error(lambda: open_log(tmp_path / "a.mat"))
    assert r"variables \x1b" in name
    for text in (cell, name, printable(CLEAR), str(InputError(CLEAR, CLEAR, CLEAR, CLEAR))):
        assert text.isprintable()


def test_a_column_whose_name_does_not_print_is_refused() -> None:
    columns = {name: np.zeros(1) for name in (*ACCEL, "\x1b[2J")}
    text = error(lambda: Recording("a", "poses", {"poses": Stream(np.zeros(1), columns)}))
    assert text.isprintable()
    assert "expected a name that prints" in text


def test_long_names_are_told_by_their_ends() -> None:
    text = str(InputError("a" * 5000 + "/b", "no such file", "a log"))
    assert "(5002 characters)" in text
    assert "/b: no such file" in text
    assert len(text) < 500


def test_an_error_survives_the_way_from_a_worker() -> None:
    import pickle

    before = InputError("a", "b", "c", "d")
    after = pickle.loads(pickle.dumps(before))
    assert str(after) == str(before)
    assert (after.where, after.place, after.found, after.expected) == ("a", "d", "b", "c")
