"""Many logs: the same whoever traces them, nothing done twice, no log stops the others; ranked by what was hidden."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.experiments import datasets
from sinan.experiments.commands.batch import run as command
from sinan.experiments.commands.cli import app
from sinan.experiments.fleet import batch
from sinan.experiments.fleet.logs import Log, in_order, logs_in
from sinan.experiments.fleet.one_log import Answer, answer, failed
from sinan.experiments.fleet.ranking import fleet
from sinan.experiments.scenarios import simulate_to_folder
from sinan.experiments.workers.alone import Limits
from sinan.sensors.errors import InputError
from sinan.sensors.formats import facts_of
from tests.experiments.test_monte_carlo import cluster  # noqa: F401
from tests.sensors import test_ardupilot as ardupilot
from tests.sensors import test_ulog as px4

HIDDEN = {
    "ash/flight2": "mag.cross_axis=0.03,0,-0.02",
    "ash/flight10": "mag.cross_axis=0.06,0,-0.02",
    "birch/flight1": "mag.cross_axis=0.01,0,0.01",
    "birch/flight2": None,
    "oak/flight1": "mag.cross_axis=0.02,0,0.02",
}
BAD = "oak/damaged.bin"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five recordings of three vehicles, one damaged log, and files that are no logs."""
    folder = tmp_path_factory.mktemp("logs")
    for k, (name, effect) in enumerate(HIDDEN.items()):
        (folder / name).parent.mkdir(exist_ok=True)
        simulate_to_folder("mag_poses", folder / name, [effect] if effect else [], seed=k)
    (folder / BAD).write_bytes(ardupilot.binary([])[:500] + bytes(3000))
    (folder / "oak" / "README.txt").write_text("no log\n")
    return folder


@pytest.fixture(scope="module")
def alone(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """By one worker."""
    out = tmp_path_factory.mktemp("alone")
    command([str(logs)], out, 1, None)
    return out


def written(out: Path) -> dict[str, bytes]:
    """All but the pages, whose last line says when they were made."""
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*.json"))}


def of(out: Path) -> dict[str, Mapping[str, object]]:
    """The last log of each vehicle."""
    found = json.loads((out / "fleet.json").read_text())
    return {one["vehicle"]: one["logs"][-1] for one in found["vehicles"]}


def test_vehicles_are_ranked_by_what_was_hidden_in_their_last_logs(alone: Path) -> None:
    found = json.loads((alone / "fleet.json").read_text())
    assert [one["vehicle"] for one in found["vehicles"]] == ["ash", "oak", "birch"]
    (effect,) = found["effects"]
    assert effect["name"] == "mag.cross_axis"
    assert [one["vehicle"] for one in effect["ranking"]] == ["ash", "oak"]
    assert effect["ranking"][0]["norm"] > 2.0 * effect["ranking"][1]["norm"]


def test_what_changed_since_the_last_time_is_said(alone: Path) -> None:
    """The tenth log comes after the second."""
    last = of(alone)
    assert Path(str(last["ash"]["log"])).name == "flight10"
    assert [one["change"] for one in last["ash"]["effects"]] == ["more"]  # type: ignore[attr-defined]
    assert last["birch"]["gone"] == ["mag.cross_axis"]
    assert [one["change"] for one in last["oak"]["effects"]] == [""]  # type: ignore[attr-defined]


def test_a_damaged_log_is_named_and_has_no_page(alone: Path) -> None:
    found = json.loads((alone / "fleet.json").read_text())
    (bad,) = found["failed"]
    assert Path(bad["log"]).name == "damaged.bin"
    assert len(list((alone / "pages").iterdir())) == len(HIDDEN)
    page = (alone / "index.html").read_text()
    assert "damaged.bin" in page
    for one in found["vehicles"]:
        for log in one["logs"]:
            assert (alone / log["page"]).is_file()
            assert f'href="{log["page"]}"' in page


def test_the_result_is_the_same_for_two_workers(logs: Path, alone: Path, tmp_path: Path) -> None:
    command([str(logs)], tmp_path, 2, None)
    assert written(tmp_path) == written(alone)


def test_what_is_finished_is_not_done_again(
    logs: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for what was left half, what is of another content, and what could not be traced."""
    names = logs_in([str(logs)], tmp_path)
    command([str(logs)], tmp_path, 1, None)
    before = written(tmp_path)
    half = tmp_path / "reports" / f"{names[0].name}.json"
    half.write_text(half.read_text()[:100])
    (tmp_path / "pages" / f"{names[1].name}.html").unlink()
    asked: list[str] = []

    def here(work: object, tasks: list[Log], workers: int, limits: Limits, done: batch.Done, _: str) -> None:
        for log in tasks:
            asked.append(Path(log.path).name)
            done(log, answer(log, log.path, limits))

    monkeypatch.setattr(batch, "each_alone", here)
    command([str(logs)], tmp_path, 1, None)
    assert asked == [Path(names[0].path).name, Path(names[1].path).name, "damaged.bin"]
    assert written(tmp_path) == before


def hostile(limits: Limits, log: Log) -> Answer:
    """As a log that kills whoever reads it, has no end, or takes all memory, which its reader calls damage."""
    match log.path:
        case "killer":
            os.kill(os.getpid(), signal.SIGKILL)
        case "endless":
            signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
            while True:
                time.sleep(1.0)
        case "huge":
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(datasets, "resolve", huge)
                return answer(log, log.path, limits)
    return failed(log, "as always")


def huge(path: str) -> None:
    try:
        np.ones(2**31)
    except Exception:
        raise InputError(path, "damaged") from None


HOSTILE = [Log(name, name[0] * 64) for name in ("a", "killer", "endless", "b", "huge", "c")]
SMALL = Limits(seconds=2.0, memory=400 * 2**20)


def test_a_log_without_end_or_bound_harms_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what a limit stopped is not tried again, unless it may take more."""
    monkeypatch.setattr(batch, "_answer", hostile)
    found = batch.run(HOSTILE, tmp_path, workers=2, limits=SMALL)
    assert [one["log"] for one in found] == [log.path for log in HOSTILE]
    said = {one["log"]: one["why_not"] for one in found}
    assert said.pop("killer") == "the process that traced it was killed: for want of memory, perhaps"
    assert said.pop("endless") == "stopped after 2 s, the longest that a log may take (--time)"
    assert said.pop("huge") == "it needs more than 400 MB of memory, the most that a log may take (--memory)"
    assert set(said.values()) == {"as always"}

    asked: list[str] = []

    def again(work: object, tasks: list[Log], *more: object) -> None:
        asked.extend(log.path for log in tasks)
        for log in tasks:
            more[2](log, failed(log, "again"))  # type: ignore[operator]

    monkeypatch.setattr(batch, "each_alone", again)
    for limits, expected in ((SMALL, []), (replace(SMALL, seconds=3.0), ["endless"]),
                             (replace(SMALL, memory=2**30), ["endless", "huge"])):  # fmt: skip
        asked.clear()
        batch.run(HOSTILE, tmp_path, workers=2, limits=limits)
        assert [name for name in asked if name in ("endless", "huge")] == expected


def test_a_dask_cluster_that_loses_a_worker_gives_the_same(
    logs: Path,
    alone: Path,
    tmp_path: Path,
    cluster: tuple[str, list[subprocess.Popen[bytes]]],  # noqa: F811
) -> None:
    address, workers = cluster
    killed: list[int] = []

    def kill_one(done: int, total: int) -> None:
        if done >= 1 and not killed:
            workers[0].send_signal(signal.SIGKILL)
            killed.append(done)

    out = tmp_path / "out"
    found = logs_in([str(logs)], out)
    documents = batch.run(found, out, dask=address, progress=kill_one)
    assert killed
    assert killed[0] < len(found)
    assert workers[0].wait(10) == -signal.SIGKILL
    expected = {name: text for name, text in written(alone).items() if name != "fleet.json"}
    assert written(out) == expected
    pages = [f"pages/{log.name}.html" for log in found]
    assert fleet(documents, pages) == json.loads((alone / "fleet.json").read_text())


def test_two_logs_of_the_same_content_are_one(logs: Path, tmp_path: Path) -> None:
    path = logs / BAD
    (tmp_path / "copy.bin").write_bytes(path.read_bytes())
    assert [log.path for log in logs_in([str(tmp_path / "copy.bin"), str(path)], tmp_path)] == [
        min(str(tmp_path / "copy.bin"), str(path), key=lambda text: in_order(Path(text)))
    ]


def test_numbers_in_names_are_in_order() -> None:
    names = ["log_10.ulg", "log_9.ulg", "Log.bin", "log_09.ulg"]
    assert [str(p) for p in sorted(map(Path, names), key=in_order)] == [
        "Log.bin",
        "log_09.ulg",
        "log_9.ulg",
        "log_10.ulg",
    ]


def test_what_holds_no_log_is_said(tmp_path: Path) -> None:
    (tmp_path / "README.txt").write_text("no log\n")
    for inputs, expected in (([str(tmp_path)], "no log"), ([str(tmp_path / "x")], "no such file")):
        with pytest.raises(InputError, match=expected):
            logs_in(inputs, tmp_path / "out")


def test_a_hostile_name_is_escaped_and_stays_inside(logs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "<b>"
    folder.mkdir()
    name = "<img src=x onerror=alert(1)>\n.bin"
    (folder / name).write_bytes((logs / BAD).read_bytes())
    (log,) = logs_in([str(folder)], tmp_path / "out")
    assert not set(log.name) & set("<>/\n ")
    result = CliRunner().invoke(app, ["batch", str(folder), "--out", str(tmp_path / "out"), "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert "<img" not in (tmp_path / "out" / "index.html").read_text()


def test_a_board_that_tells_its_number_is_the_vehicle(tmp_path: Path) -> None:
    """PX4's `sys_uuid`; ArduPilot's line of the board."""
    path = tmp_path / "log.bin"
    messages = [("MSG", (1, text)) for text in ("ArduCopter V4.5.1", "CubeOrange 0031002D 31385115 33373935")]
    path.write_bytes(ardupilot.binary([*ardupilot.flight(), *messages]))
    facts = facts_of(path)
    assert facts is not None
    assert facts.vehicle == "0031002D 31385115 33373935"
    uuid = b"char[4] sys_uuid"
    log = px4.log(tmp_path / "log.ulg", px4.message("I", bytes([len(uuid)]) + uuid + b"0a1b"), px4.reading(0))
    facts = facts_of(log)
    assert facts is not None
    assert facts.vehicle == "0a1b"
