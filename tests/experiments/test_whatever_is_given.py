"""Every command and each of its paths, given what strangers give: it is read, or one line says what and what to do."""

from __future__ import annotations

import inspect
import os
import re
import shutil
import sys
import typing
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.commands import cli
from sinan.experiments.scenarios import simulate_to_folder
from tests.estimator import gnss_simulation
from tests.sensors import test_ardupilot as ardupilot
from tests.sensors import test_tlog as tlog
from tests.sensors import test_ulog as ulog

#: How each path of a command is given to it: {} is the stranger's, names in capitals are good ones.
READ = {
    "simulate scenario": "simulate {} OUT",
    "simulate own_effects": "simulate mag_poses OUT --effects {}",
    "info input": "info {}",
    "info map": "info TABLE --map {}",
    "convert input": "convert {} OUT",
    "convert map": "convert TABLE OUT --map {}",
    "calibrate input": "calibrate all {} --poses",
    "calibrate map": "calibrate accel TABLE --map {}",
    "estimate input": "estimate {}",
    "estimate map": "estimate TABLE --map {}",
    "estimate own_effects": "estimate TABLE --effects {}",
    "trace inputs": "trace {}",
    "trace map": "trace TABLE --map {}",
    "trace own_effects": "trace POSES --effects {}",
    "params input": "params {} --for px4",
    "params map": "params TABLE --for px4 --map {}",
    "params report": "params POSES --for px4 --trace {}",
    "gnss observation": "gnss {} NAV",
    "gnss navigation": "gnss OBS {}",
    "gnss reference": "gnss OBS NAV --reference {}",
    "gnss base": "gnss OBS NAV --base {} --base-position 4000000 500000 4900000",
    "ranges scenario": "ranges {}",
    "observability input": "observability {}",
    "observability map": "observability TABLE --map {}",
    "montecarlo scenario": "montecarlo {} --runs 1 --workers 1",
    "batch own_effects": "batch POSES --out OUT --effects {}",
    "camera place": "camera {} --board 9x6",
    "camera what": "camera hand-eye {} --body BODY",
    "camera body": "camera hand-eye CORNERS --body {}",
    "camera gyro": "camera hand-eye CORNERS --body BODY --gyro {}",
    "camera cameras": "camera wand {} --cameras {},{} --along 0,0.2,0.5",
    "allan input": "allan {}",
    "allan map": "allan TABLE --map {}",
    "map input": "map {} --out OUT",
    "map map": "map TABLE --out OUT --map {}",
    "heights input": "heights {}",
    "heights map": "heights TABLE --map {}",
    "lab answer": "lab check magnetometer {}",
    "effects own_effects": "effects --effects {}",
    "blind logs": "blind OUT --measured --runs 1 --logs {}",
}
WRITTEN = {
    "demo out": "demo {}",
    "simulate out": "simulate mag_poses {}",
    "info json": "info POSES --json {}",
    "info html": "info POSES --html {}",
    "convert out": "convert POSES {}",
    "calibrate json": "calibrate mag POSES --json {}",
    "calibrate html": "calibrate mag POSES --html {}",
    "estimate states": "estimate TABLE --states {}",
    "estimate json": "estimate TABLE --json {}",
    "estimate html": "estimate TABLE --html {}",
    "trace json": "trace POSES --json {}",
    "trace html": "trace POSES --html {}",
    "params out": "params POSES --for px4 --out {}",
    "gnss solution": "gnss OBS NAV --solution {}",
    "gnss json": "gnss OBS NAV --json {}",
    "gnss html": "gnss OBS NAV --html {}",
    "ranges out": "ranges static_ca --out {}",
    "ranges json": "ranges static_ca --json {}",
    "ranges html": "ranges static_ca --html {}",
    "observability json": "observability hover --json {}",
    "observability html": "observability hover --html {}",
    "montecarlo resume": "montecarlo hover --runs 1 --resume {}",
    "montecarlo json": "montecarlo hover --runs 1 --json {}",
    "montecarlo html": "montecarlo hover --runs 1 --html {}",
    "batch out": "batch POSES --out {}",
    "capture out": "capture --link udp:127.0.0.1:14999 --for 0.1 --out {}",
    "capture mwlog": "capture --link udp:127.0.0.1:14999 --for 0.1 --out OUT --mwlog {}",
    "capture params": "capture --link udp:127.0.0.1:14999 --for 0.1 --out OUT --poses accel --params {}",
    "capture json": "capture --link udp:127.0.0.1:14999 --for 0.1 --out OUT --poses accel --json {}",
    "capture html": "capture --link udp:127.0.0.1:14999 --for 0.1 --out OUT --poses accel --html {}",
    "camera corners": "camera CORNERS --corners {}",
    "camera json": "camera CORNERS --json {}",
    "camera html": "camera CORNERS --html {}",
    "allan json": "allan POSES --json {}",
    "allan html": "allan POSES --html {}",
    "map out": "map TABLE --out {}",
    "map json": "map TABLE --out OUT --json {}",
    "heights json": "heights TABLE --json {}",
    "heights html": "heights TABLE --html {}",
    "lab out": "lab gravity --out {}",
    "lab key": "lab begin magnetometer --student a --out OUT --key {}",
    "blind out": "blind {} --runs 1",
    "blind html": "blind OUT --runs 1 --html {}",
    "blind table": "blind OUT --measured --runs 1 --table {}",
}
#: Words, and one that is none of them.
VALUES = {
    "fetch names": "fetch nothing",
    "simulate effect": "simulate mag_poses OUT --effect mag.current=1",
    "simulate sensors": "simulate mag_poses OUT --sensors nose",
    "estimate engine": "estimate TABLE --engine slow",
    "gnss systems": "gnss OBS NAV --systems X",
    "gnss link": "gnss OBS NAV --link nonsense",
    "montecarlo dask": "montecarlo hover --runs 1 --dask nowhere",
    "batch dask": "batch POSES --out OUT --dask nowhere",
    "serve port": "serve --port 99999",
    "capture link": "capture --link nonsense --out OUT",
    "camera board": "camera CORNERS --board 9",
    "camera dictionary": "camera EMPTY --board 9x6 --square 0.02 --marker 0.01 --dictionary none",
    "camera lens": "camera CORNERS --lens bottle",
    "camera along": "camera wand TABLE --cameras a.json,b.json --along 0,x",
    "lab name": "lab nothing",
    "lab what": "lab check nothing answer.json",
    "lab student": "lab begin magnetometer --out OUT",
    "lab secret": "lab begin magnetometer --student a --out OUT --secret short",
    "effects name": "effects nothing",
    "schema name": "schema nothing",
}
#: Numbers that are none: of commands that take no word.
NUMBERS = {
    "gravity": "calibrate mag POSES --gravity nan",
    "gravity of a capture": "capture --link udp:127.0.0.1:14999 --out OUT --poses accel --gravity -1",
    "alpha": "trace POSES --alpha nan",
    "from and to": "info POSES --from nan",
    "cell": "map TABLE --out OUT --cell 0",
    "mask": "gnss OBS NAV --mask 91",
    "runs": "blind OUT --runs 0",
    "memory": "serve --memory nan",
    "time": "batch POSES --out OUT --time 0",
    "rate": "capture --link udp:127.0.0.1:14999 --out OUT --rate nan",
    "seed": "ranges static_ca --seed -1",
    "imu": "heights POSES --imu 16",
    "position": "gnss OBS NAV --position 1 2",
    "square": "camera EMPTY --board 9x6 --square nan",
}
#: Inputs of `batch`: a log that cannot be read is said on its page, and harms no other (test_fleet.py).
ELSEWHERE = {"batch inputs"}

ROWS = [(0.01 * k, 0.1, 0.2, -9.8, 0.01, 0.0, 0.1) for k in range(100)]
Said = tuple[int, str, str]
Sinan = Callable[..., Said]


def table(rows: list[tuple[object, ...]], head: str = "t,ax,ay,az,gx,gy,gz\n") -> bytes:
    return (head + "".join(",".join(map(str, row)) + "\n" for row in rows)).encode()


def with_one(value: object, row: int = 50, column: int = 0) -> bytes:
    rows: list[tuple[object, ...]] = [*ROWS]
    rows[row] = (*rows[row][:column], value, *rows[row][column + 1 :])
    return table(rows)


def strangers() -> dict[str, bytes]:
    """Files that no command can make all of."""
    log = ulog.HEAD + b"".join(map(ulog.reading, range(30)))
    flash, sent = ardupilot.binary(ardupilot.flight()), tlog.written(tlog.flight())
    return {
        "empty": b"",
        "rubbish": np.random.default_rng(0).bytes(20_000),
        "cut.ulg": log[: len(ulog.HEAD) + 3],
        "cut.bin": flash[:90],
        "cut.tlog": sent[:20],
        "cut.csv": table([*ROWS])[:777] + b"\n",  # a line that ends is wrong; one that does not was cut
        "cut.bag": b"#ROSBAG V2.0\nE\0\0\0" + bytes(50),
        "cut.zip": b"PK\x03\x04" + bytes(100),
        "nan.csv": with_one("nan", column=2),
        "text.csv": with_one("none", column=2),
        "header.csv": table([]),
        "bare.csv": table([*ROWS], head=""),
        "list.json": b"[1, 2",
        "keys.json": b"{}",
        "keys.toml": b"a = 1\n",
        "cut.toml": b"a = [",
        "raises.py": b"raise ValueError('no')\n",
        "ends.py": b"import sys\nsys.exit(3)\n",
    }


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What a command would read."""
    folder = tmp_path_factory.mktemp("good")
    named = {name: folder / name.lower() for name in ("POSES", "TABLE", "OBS", "NAV", "BODY", "CORNERS", "EMPTY")}
    simulate_to_folder("mag_poses", named["POSES"])
    named["TABLE"].write_bytes(table([*ROWS]))
    messages = gnss_simulation.messages("G")
    seen = gnss_simulation.observe(messages, gnss_simulation.START + 30.0 * np.arange(3))
    named["OBS"].write_text(gnss_simulation.observation_3(seen))
    named["NAV"].write_text(gnss_simulation.navigation_3(messages))
    named["BODY"].write_text("image,qw,qx,qy,qz\na,1,0,0,0\n")
    named["CORNERS"].write_text("image,x,y,z,u,v\na,0,0,0,1,2\n")
    named["EMPTY"].mkdir()
    return named


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What strangers give."""
    folder = tmp_path_factory.mktemp("given")
    found = {"nothing there": folder / "none.ulg", "a folder": folder / "folder", "a link to itself": folder / "loop"}
    found["a folder"].mkdir()
    (found["a folder"] / "a.txt").write_text("a")
    found["a link to itself"].symlink_to("loop")
    for name, content in strangers().items():
        found[name] = folder / name
        found[name].write_bytes(content)
    return found


@pytest.fixture
def sinan(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, good: dict[str, Path]
) -> Sinan:
    """Runs a command in this process: status, output, error output."""
    monkeypatch.setattr(cli, "_leave_warnings_to_developers", lambda: None)
    monkeypatch.chdir(tmp_path)

    def run(text: str, it: object = "") -> Said:
        places = {"OUT": tmp_path / "out", **good}
        words = [re.sub(r"^[A-Z]+$", lambda m: str(places.get(m[0], m[0])), word) for word in text.split()]
        monkeypatch.setattr(sys, "argv", ["sinan", *(word.replace("{}", str(it)) for word in words)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        return status, *capsys.readouterr()

    return run


def require_one_line(said: Said, it: str) -> None:
    """Status 1 and one line below the notes; it names what was given, and what was expected."""
    status, out, err = said
    *notes, last = err.splitlines()
    assert (status, out) == (1, ""), (it, said)
    assert last.startswith("sinan: "), it
    assert re.search("; expected [^;]", last), it
    assert all(note.startswith("note: ") for note in notes), it


def test_every_path_and_every_word_of_every_command_is_in_the_tables() -> None:
    wanted, commands = set(), set()
    for command in cli.app.registered_commands:
        function = command.callback
        assert function is not None
        name = command.name or function.__name__
        commands.add(name)
        for parameter, hint in typing.get_type_hints(function).items():
            if parameter != "return" and {str, Path} & {hint, *typing.get_args(hint), *_inner(hint)}:
                wanted.add(f"{name} {parameter}")
    tables = READ | WRITTEN | VALUES
    assert {row.split()[0] for row in tables} == commands
    assert {row for row in tables if row != "serve port"} | ELSEWHERE == wanted
    assert all(inspect.cleandoc(text).split()[0] == row.split()[0] for row, text in tables.items())


def _inner(hint: object) -> set[object]:
    """Types within unions and lists."""
    return {one for part in typing.get_args(hint) for one in (part, *_inner(part))}


@pytest.mark.parametrize("row", READ)
def test_what_cannot_be_read(sinan: Sinan, given: dict[str, Path], row: str) -> None:
    for name, path in given.items():
        require_one_line(sinan(READ[row], path), f"{row}, {name}")


@pytest.mark.parametrize("row", WRITTEN)
def test_what_cannot_be_written(sinan: Sinan, given: dict[str, Path], row: str) -> None:
    """Places of which none can be a file, and none a folder."""
    before = given["text.csv"].read_bytes()
    places = {
        "in a file": given["text.csv"] / "x",
        "in a folder that is not there": given["a folder"] / "no" / "no" / "x",
        "in a folder of the system": Path("/proc/none/x"),
        "too long": given["a folder"] / ("n" * 300),
    }
    for name, path in places.items():
        require_one_line(sinan(WRITTEN[row], path), f"{row}, {name}")
    assert os.listdir(given["a folder"]) == ["a.txt"]
    assert given["text.csv"].read_bytes() == before


FOLDERS = ("demo out", "simulate out", "convert out", "ranges out", "montecarlo resume", "batch out", "capture out",
           "map out", "lab out", "blind out")  # fmt: skip


@pytest.mark.parametrize("row", WRITTEN)
def test_a_file_in_the_place_of_a_folder_and_the_reverse(sinan: Sinan, given: dict[str, Path], row: str) -> None:
    before = given["text.csv"].read_bytes()
    said = sinan(WRITTEN[row], given["text.csv"] if row in FOLDERS else given["a folder"])
    require_one_line(said, row)
    assert "a file; expected a folder" in said[2] if row in FOLDERS else "a folder; expected a file" in said[2]
    assert given["text.csv"].read_bytes() == before


@pytest.mark.parametrize("row", WRITTEN)
def test_a_folder_without_permission(sinan: Sinan, tmp_path: Path, row: str) -> None:
    (tmp_path / "closed").mkdir(mode=0o555)
    if os.access(tmp_path / "closed", os.W_OK):
        pytest.skip("nothing is forbidden to the superuser")
    require_one_line(sinan(WRITTEN[row], tmp_path / "closed" / "x"), row)


@pytest.mark.parametrize("row", VALUES | NUMBERS)
def test_what_is_no_value(sinan: Sinan, row: str) -> None:
    status, out, err = said = sinan((VALUES | NUMBERS)[row])
    assert "Traceback" not in out + err
    if status == 2:  # of the library of the command line: a box
        assert "Invalid value for" in err
        assert not re.search(r"Value\s+error|Input\s+should|parse", err)
    else:
        require_one_line(said, row)


@pytest.mark.parametrize("content", [with_one(0.0), table([*ROWS][:1]), table([*ROWS][:2])], ids=["back", "one", "two"])
@pytest.mark.parametrize("row", [row for row in READ if row.endswith((" input", " inputs"))])
def test_a_clock_that_goes_back_and_hardly_any_sample(sinan: Sinan, tmp_path: Path, row: str, content: bytes) -> None:
    """There may be something to say of it, or nothing."""
    (tmp_path / "log.csv").write_bytes(content)
    status, out, err = said = sinan(READ[row], tmp_path / "log.csv")
    if status:
        require_one_line(said, row)
    else:
        assert out
        assert "Traceback" not in err


#: Part of a file of the measured data.
CUT = {"ulog": ("px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg", [20, 1000, 100_001]),
       "dataflash": ("arducopter_sonar_baro/underpowered.log", [100, 5021, 50_021]),
       "matlab": ("rfly_course/MagRaw.mat", [100, 1500]),
       "csv": ("xio_fusion_imu/sensor_data.csv", [10, 1001])}  # fmt: skip


@pytest.mark.measured
@pytest.mark.parametrize("name", CUT)
@pytest.mark.parametrize("command", ["info {}", "convert {} OUT", "allan {}", "calibrate all {} --poses", "heights {}"])
def test_a_measured_log_that_was_cut_off(
    sinan: Sinan, measured_data: Path, tmp_path: Path, name: str, command: str
) -> None:
    file, sizes = CUT[name]
    for size in sizes:
        cut = tmp_path / Path(file).name
        cut.write_bytes((measured_data / file).read_bytes()[:size])
        status, out, err = said = sinan(command, cut)
        if status:
            require_one_line(said, f"{name}, {size}")
        else:
            assert out
            assert "Traceback" not in err
