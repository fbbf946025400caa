"""The command line: what it writes, how it refuses, and that help does not wait for what it does not need."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import typer

from sinan.experiments.commands import trace as trace_command
from sinan.experiments.commands.cli import _spread, app
from sinan.experiments.scenarios import simulate_to_folder
from sinan.sensors.errors import InputError
from tests.experiments.conftest import require_fit

ROOT = Path(__file__).resolve().parents[2]


def sinan(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error::RuntimeWarning", "-m", "sinan", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # whatever is installed, wherever it runs
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=cwd, env=environment, check=False)


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli") / "run1"
    result = sinan("simulate", "mag_poses", str(folder), "--effect", "mag.cross_axis=0.03,0,-0.02", "--seed", "7")
    assert result.returncode == 0, result.stderr
    return folder


def test_help_imports_no_numerics() -> None:
    heavy = ("numpy", "scipy", "matplotlib", "numba", "pandas")
    code = f"import sinan.experiments.commands.cli, sys; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


#: A command that warns itself and in a worker, as NumPy does of a number that is none.
WARNS = """
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import numpy as np
from sinan.experiments import labs
from sinan.experiments.commands import cli

def run(name, out):
    np.array([0.0]) / 0.0
    for method in ("spawn", "forkserver"):
        with ProcessPoolExecutor(1, mp_context=get_context(method)) as pool:
            print(pool.submit(np.log, np.array([0.0])).result())

if __name__ == "__main__":
    labs.run = run
    sys.argv = ["sinan", "lab", "heading"]
    cli.main()
"""


@pytest.mark.parametrize(("options", "shown"), [([], 0), (["-W", "default"], 3)], ids=["a user", "a developer"])
def test_warnings_of_libraries_reach_no_user(tmp_path: Path, options: list[str], shown: int) -> None:
    script = tmp_path / "warns.py"
    script.write_text(WARNS)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, *options, str(script)]
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=120, cwd=tmp_path, env=environment, check=True
    )
    assert result.stdout.split() == ["[-inf]", "[-inf]"]
    assert result.stderr.count("RuntimeWarning") == shown
    assert shown or not result.stderr


def test_answer_lies_beside_the_folder_and_not_in_it(poses: Path) -> None:
    assert poses.with_name("run1.answer.json").is_file()
    assert all("cross_axis" not in path.read_text() for path in poses.iterdir())


def test_calibrate_writes_its_report(poses: Path, tmp_path: Path) -> None:
    out = tmp_path / "mag.json"
    files = ("--json", str(out), "--html", str(tmp_path / "mag.html"))
    result = sinan("calibrate", "mag", str(poses), "--axes", "full", *files)
    assert result.returncode == 0, result.stderr
    document = json.loads(out.read_text())
    assert document["sensor"] == "mag"
    assert len(document["undetermined"]) == 3
    assert document["T"][0][1] is None
    assert document["sse"] < document["sse_before"]
    assert (tmp_path / "mag.html").read_text().startswith("<!doctype html>")


def test_trace_writes_its_report(poses: Path, tmp_path: Path) -> None:
    out = tmp_path / "trace.json"
    result = sinan("trace", str(poses), "--json", str(out), "--html", str(tmp_path / "trace.html"))
    assert result.returncode == 0, result.stderr
    document = json.loads(out.read_text())
    assert document["verdict"] == "effects"
    effect = document["effects"][0]
    assert effect["name"] == "mag.cross_axis"
    error = np.abs(np.array(effect["beta"]) - [0.03, 0.0, -0.02])
    assert np.all(error < 4.0 * np.array(effect["std"]))
    assert document["error"]["after"]["rms"] < document["error"]["before"]["rms"]
    page = (tmp_path / "trace.html").read_text()
    for words in ("headline", "says", "next"):
        assert document[words] in result.stdout or document[words][1:] in result.stdout
    assert "Verdict <code>effects</code>: " in page
    assert f"<footer>sinan {version('sinan-nav')}, <code>sinan trace {poses} --json {out}" in page


def test_same_input_same_report(poses: Path, tmp_path: Path) -> None:
    for name in ("a.json", "b.json"):
        assert sinan("trace", str(poses), "--json", str(tmp_path / name)).returncode == 0
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_demo_writes_pages_and_figures(tmp_path: Path) -> None:
    result = sinan("demo", str(tmp_path / "out"))
    assert result.returncode == 0, result.stderr
    assert "mag.cross_axis" in result.stdout
    assert str(tmp_path / "out") in result.stdout
    assert (tmp_path / "out" / "simulated.html").stat().st_size > 50_000
    assert (tmp_path / "out" / "simulated_residuals.png").read_bytes().startswith(b"\x89PNG")
    documents = [*(tmp_path / "out").glob("*.json")]
    assert tmp_path / "out" / "simulated.json" in documents
    for path in documents:
        require_fit("trace", json.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["trace", "nowhere"], 1, "nowhere"),
        (["calibrate", "gyro", "{poses}"], 1, "no gyro"),
        (["estimate", "{poses}"], 1, "poses"),
        (["simulate", "no_such", "{tmp}/x"], 1, "no such scenario"),
        (["simulate", "mag_poses", "{tmp}/x", "--effect", "mag.nothing=1"], 1, "mag.nothing"),
        (["simulate", "mag_poses", "{tmp}/x", "--effect", "mag.current", "0.1"], 1, "a blank after the name"),
        (["simulate", "mag_poses", "{poses}"], 1, "--force"),
        (["convert", "{poses}", "{poses}/.."], 1, "not written by sinan"),
        (["trace", "{poses}", "--json", "/proc/none/x.json"], 1, "/proc/none"),
        (["trace", "{poses}", "--html", "{tmp}/none/none/x.html"], 1, "no folder {tmp}/none"),
        (["simulate", "mag_poses", "{tmp}/none/none/x"], 1, "no folder {tmp}/none"),
        (["trace"], 2, "INPUT"),
        (["calibrate", "nose", "{poses}"], 2, "nose"),
        (["lab", "nothing"], 1, "one of spring_mass"),
    ],
)
def test_bad_input_is_one_line(poses: Path, tmp_path: Path, arguments: list[str], status: int, says: str) -> None:
    result = sinan(*(a.format(poses=poses, tmp=tmp_path) for a in arguments))
    assert result.returncode == status, result.stderr
    assert says.format(tmp=tmp_path) in result.stderr
    assert "Traceback" not in result.stderr
    if status == 1:
        assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "none").exists()


def test_nan_is_named_with_file_and_row(poses: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    for path in poses.iterdir():
        (broken / path.name).write_text(path.read_text())
    lines = (broken / "mag.csv").read_text().splitlines()
    lines[5] = lines[5].rsplit(",", 1)[0] + ",nan"
    (broken / "mag.csv").write_text("\n".join(lines) + "\n")
    result = sinan("trace", str(broken))
    assert result.returncode == 1
    assert "mag" in result.stderr
    assert "5" in result.stderr


def test_estimate_reports_errors_and_draws_the_biases(tmp_path: Path) -> None:
    flight, page = tmp_path / "flight", tmp_path / "flight.html"
    assert sinan("simulate", "hover", str(flight), "--seed", "3").returncode == 0
    files = ("--json", str(tmp_path / "e.json"), "--html", str(page), "--states", str(tmp_path / "states.csv"))
    result = sinan("estimate", str(flight), *files)
    assert result.returncode == 0, result.stderr
    document = json.loads((tmp_path / "e.json").read_text())
    assert document["truth"]["attitude_rms"] < 0.05
    assert 0.9 < document["nis"]["mag"] < 1.1
    assert (tmp_path / "states.csv").read_text().startswith("t,position_north")
    assert "data:image/png" in page.read_text()


@pytest.mark.parametrize(
    "given", [["1.5", "-2", "3"], ["1.5,-2,3"], ["1.5, -2, 3"], ["1.5,", "-2,", "3"], ["1.5 -2 3"]]
)
def test_a_position_may_have_commas_or_blanks(given: list[str]) -> None:
    expected = ["gnss", "a", "b", "--position", "1.5", "-2", "3", "--json", "c"]
    assert _spread(["gnss", "a", "b", "--position", *given, "--json", "c"]) == expected
    assert _spread(["--base-position=1,2,3"]) == ["--base-position", "1", "2", "3"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("calibrate acel x", "'acel' is not one of 'accel', 'gyro', 'mag', 'all'"),
        ("calibrate accel x --axes most", "'most' is not one of 'none', 'triangular', 'full'"),
        ("trace x --to abc", "'abc' is not a number"),
        ("trace x --alpha nan", "nan is not a number"),
        ("trace x --imu 1.5", "'1.5' is not a whole number"),
        ("trace x --alpha 7", "7 is more than 0.5"),
        ("montecarlo square --runs 0", "0 is less than 1"),
    ],
)
def test_a_value_that_is_none_is_told_in_plain_words(arguments: str, says: str) -> None:
    with pytest.raises(typer.BadParameter) as error:
        app(arguments.split(), standalone_mode=False)
    assert error.value.message == says


@pytest.mark.parametrize("given", [["1", "2"], ["1,2"], [], ["1,2,3,4"]])
def test_a_position_with_another_number_of_numbers_is_refused(given: list[str]) -> None:
    with pytest.raises(InputError, match="three numbers"):
        _spread(["gnss", "a", "b", "--position", *given, "--json", "c"])


def test_convert_says_what_can_be_scored(tmp_path: Path) -> None:
    assert sinan("simulate", "hover", str(tmp_path / "flight")).returncode == 0
    lines = sinan("convert", str(tmp_path / "flight"), str(tmp_path / "part"), "--to", "10").stdout.splitlines()
    assert lines[1] == "truth.csv: position, velocity, attitude by the simulation"
    result = sinan("estimate", str(tmp_path / "flight"), "--from", "1000")
    assert result.returncode == 1
    assert "from 1000 s of a log of" in result.stderr


def test_version() -> None:
    assert sinan("--version").stdout.startswith("sinan ")


def test_results_are_called_as_the_recording(poses: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    assert sinan("calibrate", "mag", str(poses), "--html", str(page)).returncode == 0
    assert "<h1>run1: magnetometer calibrated</h1>" in page.read_text()
    assert sinan("trace", ".", cwd=poses).stdout.startswith("run1: effects")


def test_what_was_written_is_said(poses: Path, tmp_path: Path) -> None:
    files = ("--json", str(tmp_path / "a.json"), "--html", str(tmp_path / "a.html"))
    lines = sinan("calibrate", "mag", str(poses), *files).stdout.splitlines()
    assert lines[-2:] == [f"JSON: {tmp_path / 'a.json'}", f"page: {tmp_path / 'a.html'}"]


def test_a_file_without_a_place_is_refused_before_the_work(poses: Path, tmp_path: Path) -> None:
    result = sinan("trace", str(poses), "--json", str(tmp_path / "a.json"), "--html", str(tmp_path))
    assert result.returncode == 1
    assert "a folder; expected a file that can be written" in result.stderr
    assert not (tmp_path / "a.json").exists()


def test_a_sensor_named_for_a_flight_is_remarked_upon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*arguments: object, **named: object) -> None:
        raise InputError("test", "enough", "nothing")

    simulate_to_folder("hover", tmp_path / "flight", seed=3)
    monkeypatch.setattr(trace_command, "trace", stop)
    with pytest.raises(InputError, match="enough"):
        trace_command.run([str(tmp_path / "flight")], "mag", 0.01, None, None, None, None)
    assert "--sensor mag is for poses" in capsys.readouterr().err
