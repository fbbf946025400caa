"""No command loses or halves a file: killed at every write, without room, through links; a part is known for one."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sinan.experiments.commands.cli import app
from sinan.experiments.datasets import convert
from sinan.experiments.monte_carlo.study import run
from sinan.experiments.scenarios import simulate_to_folder
from sinan.sensors.errors import InputError
from sinan.sensors.formats.plain import read_recording
from tests.killing import FOR_FULL_DISKS, ROOT, is_write, killed, no_file_beyond

#: A moment of flight, with all its streams.
SHORT = 'like = "hover"\n[[manoeuvre]]\nkind = "hold"\nduration = 4.0\n'
LOG = "t,ax,ay,az\n" + "".join(f"{k},0.0,{k % 7}.5,-9.8\n" for k in range(400))
MAP = """
kind = "poses"
[file]
header = true
[streams.poses]
time = "t"
accel = { columns = ["ax", "ay", "az"], unit = "m/s^2" }
"""


def simulate_again(folder: Path) -> None:
    simulate_to_folder(folder / "short.toml", folder / "run", ["mag.current=0.003,0,0"], seed=2, force=True)


def convert_again(folder: Path) -> None:
    convert(str(folder / "log.csv"), folder / "run", folder / "log.toml", force=True)


def digest(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.is_dir() else {}


def seed_of(folder: Path) -> int:
    return int(json.loads((folder / "run.answer.json").read_text())["seed"])


def test_a_simulation_killed_at_every_write_leaves_the_old_or_the_new_recording(tmp_path: Path) -> None:
    before = tmp_path / "before"
    before.mkdir()
    (before / "short.toml").write_text(SHORT)
    simulate_to_folder(before / "short.toml", before / "run", seed=1)
    old = digest(before / "run")
    *dead, alive = killed(__file__, "simulate_again", tmp_path)
    new = digest(alive / "run")
    assert len(dead) > 20
    assert old != new
    assert set(os.listdir(alive)) == {"run", "run.answer.json", "short.toml"}
    states = [({1: old, 2: new}[seed_of(folder)] == digest(folder / "run"), digest(folder / "run")) for folder in dead]
    assert all(found in (old, new) for _, found in states)
    # two names are not moved in one step: killed right between them, and only then, the answer is still the old one
    assert [found for paired, found in states if not paired] == [new]


def test_a_conversion_killed_at_every_write_leaves_the_old_or_the_new_recording(tmp_path: Path) -> None:
    before = tmp_path / "before"
    before.mkdir()
    (before / "log.csv").write_text(LOG)
    (before / "log.toml").write_text(MAP)
    simulate_to_folder("mag_poses", before / "run", seed=1)
    old = digest(before / "run")
    *dead, alive = killed(__file__, "convert_again", tmp_path)
    assert len(dead) > 8
    assert len(read_recording(alive / "run").streams["poses"]) == 400
    assert all(digest(folder / "run") in (old, digest(alive / "run")) for folder in dead)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    (folder / "short.toml").write_text(SHORT)
    simulate_to_folder(folder / "short.toml", folder / "run", seed=1)
    return folder


def test_a_recording_that_was_cut_off_is_known_for_a_part(flight: Path, tmp_path: Path) -> None:
    """As a killed copy leaves it: each stream missing, or with its first half."""
    whole = read_recording(flight / "run")
    for name, stream in whole.streams.items():
        part = shutil.copytree(flight / "run", tmp_path / name)
        lines = (part / f"{name}.csv").read_text().splitlines(keepends=True)
        (part / f"{name}.csv").write_text("".join(lines[: len(stream) // 2 + 1]))
        with pytest.raises(InputError, match=rf"{name}\.csv with {len(stream) // 2} of {len(stream)} rows"):
            read_recording(part)
        (part / f"{name}.csv").unlink()
        with pytest.raises(InputError, match=rf"no {name}\.csv with its {len(stream)} rows"):
            read_recording(part)


@pytest.mark.parametrize("force", [False, True])
def test_a_linked_answer_is_not_overwritten(flight: Path, tmp_path: Path, force: bool) -> None:
    (tmp_path / "kept").write_text("kept")
    (tmp_path / "run.answer.json").symlink_to("kept")
    with pytest.raises(InputError, match=r"run\.answer\.json: a link"):
        simulate_to_folder(flight / "short.toml", tmp_path / "run", force=force)
    assert (tmp_path / "kept").read_text() == "kept"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("text", "force", "found"), [("mine", True, "no answer"), (None, False, "answer that was")])
def test_an_answer_is_replaced_as_a_recording_is(
    flight: Path, tmp_path: Path, text: str | None, force: bool, found: str
) -> None:
    answer = tmp_path / "run.answer.json"
    answer.write_text(text or (flight / "run.answer.json").read_text())
    before = answer.read_text()
    with pytest.raises(InputError, match=found):
        simulate_to_folder(flight / "short.toml", tmp_path / "run", seed=5, force=force)
    assert answer.read_text() == before
    if text is None:
        simulate_to_folder(flight / "short.toml", tmp_path / "run", seed=5, force=True)
        assert json.loads(answer.read_text())["seed"] == 5


def test_force_does_not_follow_a_linked_header(flight: Path, tmp_path: Path) -> None:
    run = shutil.copytree(flight / "run", tmp_path / "run")
    kept = (run / "recording.toml").rename(tmp_path / "kept.toml")
    (run / "recording.toml").symlink_to(kept)
    before = digest(run)
    with pytest.raises(InputError, match=r"recording\.toml: a link"):
        simulate_to_folder(flight / "short.toml", run, seed=5, force=True)
    (tmp_path / "log.csv").write_text(LOG)
    (tmp_path / "log.toml").write_text(MAP)
    with pytest.raises(InputError, match=r"recording\.toml: a link"):
        convert(str(tmp_path / "log.csv"), run, tmp_path / "log.toml", force=True)
    assert digest(run) == before


def test_the_answer_of_the_current_folder_lies_beside_it(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path / "run")
    assert simulate_to_folder(flight / "short.toml", Path(".")) == tmp_path / "run.answer.json"
    assert read_recording(Path(".")).kind == "flight"
    with pytest.raises(InputError, match="the current folder"):
        simulate_to_folder(flight / "short.toml", Path("."), force=True)


def test_a_full_disk_in_estimate_leaves_nothing_half(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    estimate = ["estimate", str(flight / "run"), "--states", "s.csv", "--html", "e.html", "--json", "e.json"]
    app(estimate, standalone_mode=False)
    before = digest(tmp_path)
    assert set(before) == {"s.csv", "e.html", "e.json"}
    for content in before.values():
        too_large = "|".join(name for name in before if len(before[name]) >= len(content))
        expected = rf"^({too_large}): File too large; expected more room on its disk$"
        with no_file_beyond(len(content) - 1), pytest.raises(InputError, match=expected):
            app(estimate, standalone_mode=False)
        assert digest(tmp_path) == before


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_full_disk_in_montecarlo_leaves_what_was_finished(flight: Path, tmp_path: Path, workers: str) -> None:
    run(flight / "short.toml", 2, workers=1, resume=tmp_path / "kept")
    before = digest(tmp_path / "kept")
    command = ["montecarlo", str(flight / "short.toml"), "--workers", workers, "--resume", "kept", "--runs", "4"]
    done = subprocess.run(
        [sys.executable, "-m", "sinan", *command],
        cwd=tmp_path, env={**os.environ, **FOR_FULL_DISKS, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        timeout=120, check=False, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (600, 600)),
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("sinan: kept/run-00000")
    assert done.stderr.endswith("File too large; expected more room on its disk\n")
    assert done.stderr.count("\n") == 1
    assert digest(tmp_path / "kept") == before


def test_a_full_standard_output_is_said() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "sinan", "effects"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT, check=False)
    assert done.returncode == 1
    assert done.stderr == "sinan: standard output: No space left on device; expected more room on its disk\n"


#: What a user types, one after the other, in one folder.
SESSION = [
    ["simulate", "short.toml", "run"],
    ["simulate", "short.toml", "run", "--force"],
    ["simulate", "mag_poses", "poses"],
    ["convert", "run", "again"],
    ["convert", "run", "again", "--force"],
    ["calibrate", "mag", "poses", "--json", "c.json", "--html", "c.html"],
    ["trace", "poses", "--json", "t.json", "--html", "t.html"],
    ["params", "poses", "--for", "px4", "--trace", "t.json", "--out", "p.params"],
    ["batch", "poses", "--workers", "1", "--out", "fleet"],
    ["estimate", "run", "--json", "e.json", "--html", "e.html", "--states", "e.csv"],
    ["observability", "short.toml", "--json", "o.json", "--html", "o.html"],
    ["montecarlo", "short.toml", "--runs", "2", "--workers", "1", "--resume", "kept", "--json", "m.json"],
    ["montecarlo", "short.toml", "--runs", "2", "--workers", "1", "--resume", "kept", "--html", "m.html"],
    ["blind", "blind", "--runs", "1", "--seed", "2"],
    ["lab", "scan_height", "--out", "lab"],
    ["demo", "demo"],
    ["gnss", "OBS", "NAV", "--systems", "G", "--json", "g.json", "--html", "g.html", "--solution", "g.csv"],
]  # fmt: skip


@pytest.mark.measured
def test_no_command_writes_at_the_place_of_a_file(tmp_path: Path, measured_data: Path) -> None:
    """Whatever is written, is written at a hidden name: what has a name of its own has been moved there."""
    (tmp_path / "short.toml").write_text(SHORT)
    gnss = measured_data / "gnss" / "esbjerg_static_2020"
    names = {"OBS": str(next(gnss.glob("*MO.rnx"))), "NAV": str(next(gnss.glob("*MN.rnx")))}
    session = [[names.get(word, word) for word in command] for command in SESSION]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, __file__, json.dumps(session)],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = [Path(path) for path in json.loads(done.stdout.splitlines()[-1])]
    inside = [path.relative_to(tmp_path) for path in written if path.is_relative_to(tmp_path)]
    assert len(inside) > 50
    assert [path for path in inside if not any(part.startswith(".") for part in path.parts)] == []
    left = {path.name for path in tmp_path.iterdir()}
    assert left >= {
        "run",
        "run.answer.json",
        "again",
        "c.json",
        "e.csv",
        "kept",
        "blind",
        "lab",
        "demo",
        "g.csv",
        "p.params",
        "fleet",
    }
    assert not any(path.name.startswith(".") for path in tmp_path.rglob("*"))


def _watched(session: list[list[str]]) -> None:
    """Run commands, then print the paths of all files that were opened for writing."""
    from sinan.experiments.commands.cli import app

    written: list[str] = []

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and is_write(event, arguments) and isinstance(arguments[0], str | bytes):
            written.append(os.path.abspath(os.fsdecode(arguments[0])))

    sys.addaudithook(hook)
    for command in session:
        app(command, standalone_mode=False)
    print("\n" + json.dumps(written))


if __name__ == "__main__":
    _watched(json.loads(sys.argv[1]))
