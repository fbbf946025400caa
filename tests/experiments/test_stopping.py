"""Ctrl-C and what else ends a command: its processes end, what was finished is kept, one line says how to go on."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from sinan.experiments.scenarios import simulate_to_folder
from sinan.experiments.workers.processes import MOST_RESTARTS, in_processes
from sinan.experiments.workers.stopping import Stopped, going_on, listening
from sinan.sensors.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
#: A command and its workers end in a tenth of a second, where nothing else runs; this long they would have stayed [s].
LIMIT = 30.0
#: Seconds of flight, so many of them that no test sees the last.
SHORT = 'like = "hover"\n[[manoeuvre]]\nkind = "hold"\nduration = 6.0\n'
MANY = "3000"


class Command:
    """A command in a session of its own, as in a terminal: Ctrl-C there goes to all its processes."""

    def __init__(self, *arguments: str, cwd: Path) -> None:
        (cwd / "short.toml").write_text(SHORT)
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sinan", *arguments],
            cwd=cwd, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def processes(self) -> list[int]:
        """Its processes that have not ended, wherever they were started."""
        found = []
        for entry in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, _, session = entry.read_text().rsplit(")", 1)[1].split()[:4]
            except OSError:  # has ended since
                continue
            if int(session) == self.process.pid and state != "Z":
                found.append(int(entry.parent.name))
        return found

    def wait_for(self, ready: Callable[[], object], most: float = 120.0) -> None:
        end = time.monotonic() + most
        while not ready():
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < end
            time.sleep(0.005)

    def interrupt(self, times: int = 1) -> None:
        for _ in range(times):
            os.killpg(self.process.pid, signal.SIGINT)
            time.sleep(0.02)

    def end(self) -> tuple[int, str]:
        """Status and error output, once all its processes have ended, which they must within `LIMIT`."""
        begin = time.monotonic()
        while self.processes() and time.monotonic() < begin + LIMIT:
            self.process.poll()
            time.sleep(0.005)
        assert self.processes() == []
        _, error = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, error


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    """Starts commands in a folder; what is left of them at the end is killed."""
    started: list[Command] = []

    def start(*arguments: str) -> Command:
        started.append(Command(*arguments, cwd=tmp_path))
        return started[-1]

    yield start
    for one in started:
        for number in one.processes():
            os.kill(number, signal.SIGKILL)
        one.process.communicate()


def finished(folder: Path) -> int:
    return len(list(folder.glob("run-*.json")))


def fly(command: Callable[..., Command], *options: str) -> Command:
    return command("montecarlo", "short.toml", "--seed", "4", *options)


@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_ends_the_flights_and_keeps_what_was_finished(
    command: Callable[..., Command], tmp_path: Path, workers: str, times: int
) -> None:
    kept = tmp_path / "kept"
    run = fly(command, "--runs", MANY, "--workers", workers, "--resume", "kept")
    run.wait_for(lambda: finished(kept) >= 3)
    run.interrupt(times)
    status, error = run.end()
    assert status == 130
    assert error.count("\n") == 1
    if times == 1 or "at once" not in error:
        found = re.fullmatch(rf"sinan: stopped after (\d+) of {MANY} flights: the same command goes on\n", error)
        assert found, error
        assert int(found[1]) == finished(kept)
    assert finished(kept) >= 3
    assert not list(kept.glob(".*"))
    for path in kept.glob("run-*.json"):
        json.loads(path.read_text())


def test_it_goes_on_from_what_was_kept_without_a_folder_too(command: Callable[..., Command], tmp_path: Path) -> None:
    run = fly(command, "--runs", "90", "--workers", "2")
    run.wait_for(lambda: len(run.processes()) >= 5)  # two workers, the fork server, the tracker
    time.sleep(0.3)
    run.interrupt()
    status, error = run.end()
    assert status == 130, error
    found = re.fullmatch(
        r"sinan: stopped after \d+ of 90 flights, kept: the same command with --resume (\S+) goes on\n", error
    )
    assert found, error
    kept = Path(found[1])
    assert finished(kept) >= 1
    outputs = []
    for options in (["--resume", str(kept)], []):
        whole = fly(command, "--runs", "90", "--workers", "1", *options, "--json", f"{len(options)}.json")
        assert whole.process.wait(120) == 0
        outputs.append((tmp_path / f"{len(options)}.json").read_bytes())
    assert outputs[0] == outputs[1]
    for path in kept.iterdir():
        path.unlink()
    kept.rmdir()


@pytest.mark.parametrize("processes", [2, 3, 4, 5])
def test_ctrl_c_while_the_workers_are_started(command: Callable[..., Command], processes: int) -> None:
    """The tracker, the fork server that loads and compiles, the first worker, the second."""
    run = fly(command, "--runs", MANY, "--workers", "2", "--resume", "kept")
    run.wait_for(lambda: len(run.processes()) >= processes)
    run.interrupt()
    status, error = run.end()
    assert status == 130
    assert re.fullmatch(rf"sinan: stopped after \d+ of {MANY} flights: the same command goes on\n", error), error


def test_a_system_that_ends_a_command_is_heard_too(command: Callable[..., Command], tmp_path: Path) -> None:
    run = fly(command, "--runs", MANY, "--workers", "2", "--resume", "kept")
    run.wait_for(lambda: finished(tmp_path / "kept") >= 2)
    run.process.terminate()
    status, error = run.end()
    assert status == 128 + signal.SIGTERM
    assert error.startswith("sinan: stopped after")


def test_workers_end_with_a_command_that_is_killed(command: Callable[..., Command], tmp_path: Path) -> None:
    run = fly(command, "--runs", MANY, "--workers", "2", "--resume", "kept")
    run.wait_for(lambda: finished(tmp_path / "kept") >= 2)
    run.process.kill()
    assert run.end()[0] == -signal.SIGKILL


def test_ctrl_c_ends_the_traces_of_blind_recordings_and_keeps_them(
    command: Callable[..., Command], tmp_path: Path
) -> None:
    """Of this seed the second and third are poses, which are traced in a moment, the first a flight."""
    reports = tmp_path / "out" / "reports"
    run = command("blind", "out", "--runs", "3", "--seed", "13", "--workers", "2")
    run.wait_for(lambda: list(reports.glob("*.json")))
    run.interrupt()
    status, error = run.end()
    assert status == 130
    found = re.fullmatch(r"sinan: stopped after (\d) of 3 recordings: the same command goes on\n", error)
    assert found, error
    assert int(found[1]) <= len(list(reports.glob("*.json"))) < 3
    for path in reports.glob("*.json"):
        assert "grade" in json.loads(path.read_text())


def test_ctrl_c_ends_a_batch_and_the_same_command_goes_on(command: Callable[..., Command], tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    for k in range(6):
        simulate_to_folder("mag_poses", tmp_path / "logs" / f"run{k}", [], seed=k)
    reports = tmp_path / "out" / "reports"
    run = command("batch", "logs", "--out", "out", "--workers", "2")
    run.wait_for(lambda: list(reports.glob("*.json")))
    run.interrupt()
    status, error = run.end()
    assert status == 130, error
    found = re.fullmatch(r"sinan: stopped after (\d) of 6 logs: the same command goes on\n", error)
    assert found, error
    kept = {path: path.stat().st_mtime_ns for path in reports.glob("*.json")}
    assert int(found[1]) == len(kept) < 6
    assert command("batch", "logs", "--out", "out", "--workers", "1").process.wait(120) == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert len(list(reports.glob("*.json"))) == 6


def double(number: int) -> int:
    return 2 * number


def die_once(folder: str) -> int:
    """Killed the first time, as for want of memory."""
    mark = Path(folder) / "mark"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 1


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def refuse(number: int) -> int:
    if number == 1:
        raise InputError("task", "one", "another")
    time.sleep(60.0)
    return number


def test_every_task_is_done_once() -> None:
    found: dict[int, int] = {}
    in_processes(double, list(range(7)), 2, lambda task, result: found.update({task: found.get(task, 0) + result}))
    assert found == {number: 2 * number for number in range(7)}


def test_what_a_killed_worker_had_to_do_is_done_by_another(tmp_path: Path) -> None:
    found: list[int] = []
    in_processes(die_once, [str(tmp_path)], 1, lambda task, result: found.append(result))
    assert found == [1]


def test_workers_that_die_again_and_again_are_an_error() -> None:
    with pytest.raises(InputError, match=rf"workers died {MOST_RESTARTS + 1} times"):
        in_processes(die, [1], 1, lambda task, result: None)


def test_an_error_in_a_task_does_not_wait_for_the_others() -> None:
    begin = time.monotonic()
    with pytest.raises(InputError, match="one"):
        in_processes(refuse, [0, 1], 2, lambda task, result: None)
    assert time.monotonic() - begin < 30.0


def test_there_is_no_other_pool() -> None:
    """What the tests above show of two pools, that of a study and that of a batch, they show of all."""
    makes = re.compile(r"\bProcessPoolExecutor\b|\bPool\(|\bLocalCluster\b|\.Process\(|\bos\.fork\b")
    folders = ("sinan", "sensors", "estimator", "calibration", "experiments")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    assert sorted(path.name for path in sources if makes.search(path.read_text())) == ["alone.py", "processes.py"]


def stopped_work() -> None:
    with going_on(lambda: " after all"):
        raise Stopped(signal.SIGINT)


def test_what_is_left_is_said() -> None:
    with pytest.raises(Stopped, match=r"^stopped after all$"):
        stopped_work()


def test_signals_are_as_before_when_the_work_is_done() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with listening():
        assert signal.getsignal(signal.SIGINT) not in before
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_signal_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with listening():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


#: A library that swallows what is raised in it, in three ways, and then goes on for a minute.
SWALLOWS = """
import os, signal, sys, time
from sinan.experiments.workers.stopping import listening

class Deleted:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)

def delete():
    Deleted()

def catch():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
    except:
        pass

def turn():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
    except BaseException as error:
        raise ImportError("no such library") from error

with listening():
    {"delete": delete, "catch": catch, "turn": turn}[sys.argv[1]]()
    time.sleep(60.0)
"""


@pytest.mark.parametrize("way", ["delete", "catch", "turn"])
def test_ctrl_c_that_a_library_swallows_is_heard_all_the_same(way: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWS, way], cwd=ROOT, capture_output=True, text=True, timeout=30.0, check=False
    )
    assert (done.returncode, done.stderr) == (130, "sinan: stopped\n")


#: The two ways to call the command, with an interrupt where it first looks for a module.
LOADING = """
import os, runpy, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

way, module, sys.argv[1:] = sys.argv[1], sys.argv[2], ["--help"]
sys.meta_path.insert(0, Interrupt())
if way == "module":
    runpy.run_module("sinan", run_name="__main__")
else:
    name, function = way.split(":")
    getattr(__import__(name, fromlist=[function]), function)()
"""


@pytest.mark.parametrize("module", ["typer", "inspect", "sinan.experiments.labs"])
@pytest.mark.parametrize("way", ["module", "script"])
def test_ctrl_c_while_the_command_is_loaded(way: str, module: str) -> None:
    if way == "script":
        way = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["sinan"]
    call = [sys.executable, "-c", LOADING, way, module]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=30.0, check=False)
    assert (done.returncode, done.stderr) == (130, "sinan: stopped\n")


def test_what_is_done_in_whole_is_not_interrupted() -> None:
    program = """
import os, signal, time
from sinan.experiments.workers.stopping import in_whole, listening
with listening():
    with in_whole():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.6)  # longer than until it is raised again
        print("whole", flush=True)
    print("more", flush=True)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "whole\n", "sinan: stopped\n")
