"""Whatever is typed or lies in a file: status 1 and one line, that names it, what was found and what was expected."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sinan.experiments.commands import cli
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError

LONG = "x" * 5000
Said = tuple[int, str, str]


@pytest.fixture
def sinan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """Runs a command in this process: status, output, error output."""
    monkeypatch.setattr(cli, "_leave_warnings_to_developers", lambda: None)

    def run(*arguments: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["sinan", *map(str, arguments)])
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from sinan.experiments.scenarios import simulate_to_folder

    folder = tmp_path_factory.mktemp("bad") / "poses"
    simulate_to_folder("mag_poses", folder)
    return folder


def line(said: Said) -> str:
    """The one line of an error."""
    status, out, err = said
    assert (status, out) == (1, "")
    assert err.endswith("\n")
    assert err[:-1].isprintable()
    assert "; expected " in err
    assert len(err) < 5000
    return err


@pytest.mark.parametrize(
    "arguments",
    [
        ("trace", LONG),
        ("trace", "{poses}/" + LONG),
        ("trace", "{poses}", "--map", LONG),
        ("trace", "{poses}", "--json", LONG),
        ("trace", "{poses}", "--html", LONG),
        ("trace", f"rfly_course/{LONG}"),
        ("estimate", LONG),
        ("estimate", "{poses}", "--states", LONG),
        ("calibrate", "mag", LONG),
        ("observability", LONG),
        ("convert", LONG, "{out}"),
        ("convert", "{poses}", LONG),
        ("convert", "{poses}", "{out}/" + LONG),
        ("simulate", LONG, "{out}"),
        ("simulate", f"{LONG}.toml", "{out}"),
        ("simulate", "mag_poses", LONG),
        ("simulate", "mag_poses", "{out}", "--effect", LONG),
        ("simulate", "mag_poses", "{out}", "--effect", "mag.current=" + "9" * 5000),
        ("montecarlo", LONG),
        ("montecarlo", "hover", "--runs", "1", "--resume", LONG),
        ("gnss", LONG, LONG),
        ("gnss", "{poses}/mag.csv", "{poses}/mag.csv", "--position", "nan", "0", "0"),
        ("lab", LONG),
        ("lab", "gravity", "--out", LONG),
        ("effects", LONG),
        ("fetch", LONG),
        ("demo", LONG),
        ("blind", LONG, "--runs", "1"),
    ],
    ids=lambda arguments: " ".join(a if len(a) < 40 else "LONG" for a in arguments),
)
def test_five_thousand_letters(
    sinan: Callable[..., Said], poses: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    line(sinan(*(a.replace("{poses}", str(poses)).replace("{out}", str(tmp_path / "out")) for a in arguments)))


@pytest.mark.parametrize("path", ["/dev/null", "/dev/zero", "/proc/self/mem", "", "{poses}/recording.toml/x"])
def test_inputs_that_are_no_logs(sinan: Callable[..., Said], poses: Path, path: str) -> None:
    line(sinan("trace", path.format(poses=poses)))


@pytest.mark.parametrize(
    "arguments",
    [
        ("montecarlo", "hover", "--seed", "-1"),
        ("montecarlo", "hover", "--seed", "9" * 30),
        ("montecarlo", "hover", "--runs", "9" * 18),
        ("montecarlo", "hover", "--workers", "9" * 9),
        ("simulate", "hover", "out", "--seed", "-1"),
        ("blind", "out", "--seed", "-1"),
        ("gnss", "a", "b", "--mask", "1e300"),
    ],
)
def test_numbers_beyond_their_bounds_are_wrong_usage(sinan: Callable[..., Said], arguments: tuple[str, ...]) -> None:
    status, _, err = sinan(*arguments)
    assert status == 2
    assert f"'{arguments[-2]}'" in err


@pytest.mark.parametrize("value", ["1e300", "inf", "0", "-9.8", "nan"])
def test_a_gravity_that_is_none(sinan: Callable[..., Said], tmp_path: Path, value: str) -> None:
    assert sinan("simulate", "accel_poses", tmp_path / "run")[0] == 0
    assert "--gravity" in line(sinan("calibrate", "accel", tmp_path / "run", "--gravity", value))


@pytest.mark.parametrize(
    "key",
    ["noise_std", "bias_walk", "bias_std", "average_time"],
)
@pytest.mark.parametrize("value", ["1e300", "-1e300", "1e13"])
def test_a_sigma_that_is_none(sinan: Callable[..., Said], tmp_path: Path, poses: Path, key: str, value: str) -> None:
    for path in poses.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    header = tmp_path / "recording.toml"
    text = header.read_text().split("[sensors.mag]")[0]
    header.write_text(f"{text}[sensors.mag]\n{key} = {value}\n")
    said = line(sinan("trace", tmp_path))
    assert f"recording.toml, [sensors.mag] {key}: {float(value)!r}" in said
    assert "at most 1e+12" in said


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = " + "9" * 5001, "line 1: a whole number of more than 4300 digits"),
        ("x = " + "[" * 5000 + "]" * 5000, "line 1: more than 20 tables and lists in one another"),
        (f'like = "{LONG}"', "key like: 'xxx"),
        ('like = "hover"\nsensors = 3', "key sensors: 3; expected a table"),
        ('like = ["hover"]', "key like: ['hover']"),
        ("manoeuvre = [1]\n[sensors.accel]\nrate = 1", "key manoeuvre: 1 as number 1; expected a table"),
        ('like = "hover"\n[sensors.mag]\nrate = 1e12', "[sensors.mag] rate: 1000000000000.0; expected a number"),
        ('like = "hover"\n[sensors.mag]\nrate = 99999.0', "sensors.mag.rate: 99999 Hz for"),
        ('like = "hover"\ntruth_rate = 1e5', "key truth_rate: 100000 Hz for"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "hold"\nduration = 1e9', "[manoeuvre 1] duration"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "square"\nlaps = 0.1\nduration = 9', "[manoeuvre 1] laps: 0.1"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "land"\nspin_down = 9\nduration = 9', "less than its duration"),
        ('like = "hover"\n[[manoeuvre]]\nkind = "shake"\nperiod = 0\nduration = 9', "[manoeuvre 1] period: 0"),
        ('like = "mag_poses"\n[turns]\nposes = 999999999', "[turns] poses: 999999999; expected"),
        ('like = "mag_poses"\n[sensors.mag]\nrate = 1e-9\n', "two readings or more"),
        ('like = "hover"\n[warming]\ntime_constant = 0', "[warming] time_constant: 0; expected"),
        ('like = "hover"\n[sensors.mag]\nnoise_std = 1e300', "[sensors.mag] noise_std: 1e+300; expected"),
        ('like = "hover"\n[sensors.gps]\ndropouts = [[1]]', "[sensors.gps] dropouts: [[1]]; expected a list of"),
        ('like = "hover"\n[origin]\nlatitude = 1\nlongitude = 1\nheight = 1\ndate = 9999-01-01', "[origin] date: 9999"),
        ('like = "hover"\n[environment]\nmagnetic_field = [0, 0, 0]', "[environment] magnetic_field"),
    ],
)  # fmt: skip
def test_scenarios_that_are_none(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenario(tmp_path / "a.toml")
    assert str(caught.value).startswith(f"{tmp_path}/a.toml, ") or "like" in expected or "sensors" in expected
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("records", "expected"),
    [
        ('fields = [["x", ["int16"]]]', "fields: [['x', ['int16']]]; expected a list of [name, type]"),
        ('fields = [["x", {}]]', "fields: [['x', {}]]; expected a list of [name, type]"),
        ('fields = [["", "int16"]]', "fields: [['', 'int16']]; expected a list of [name, type]"),
        ('fields = [["x", "float32"]]\nmagic = 7', "byte 0, record 1: nan at the start of a record; expected 0x7"),
    ],
)
def test_maps_that_are_none(sinan: Callable[..., Said], tmp_path: Path, records: str, expected: str) -> None:
    (tmp_path / "log").write_bytes(b"\0\0\xc0\x7f" * 4)
    (tmp_path / "map.toml").write_text(
        f'kind = "poses"\n[streams.poses]\naccel = ["x", "x", "x"]\n[file.records]\n{records}\n'
    )
    assert expected in line(sinan("calibrate", "accel", tmp_path / "log", "--map", tmp_path / "map.toml"))


def test_a_name_with_control_characters_does_not_reach_the_terminal(
    sinan: Callable[..., Said], poses: Path, tmp_path: Path
) -> None:
    for path in poses.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    header = tmp_path / "recording.toml"
    name = next(row for row in header.read_text().splitlines() if row.startswith("name"))
    header.write_text(header.read_text().replace(name, r'name = "\u001b[2J\u202e\u0007"'))
    status, out, err = sinan("convert", tmp_path, tmp_path / "out")
    assert (status, err) == (0, "")
    assert out.startswith(r"\x1b[2J\u202e\x07: poses with mag")


def test_a_memory_that_does_not_suffice_is_said(
    sinan: Callable[..., Said], poses: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("sinan.sensors.formats.plain.read_recording", read)
    assert "more than the memory holds" in line(sinan("trace", poses))
