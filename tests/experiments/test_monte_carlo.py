"""Monte Carlo: the filter's covariance tells the truth; the result does not depend on who computed it."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.monte_carlo.one_flight import Score, fly, noiseless, rng_of
from sinan.experiments.monte_carlo.study import Kept, MonteCarlo, averaged, digest_of, label, outside, run
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.manoeuvres import Manoeuvre
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]


def short() -> Scenario:
    """Twelve seconds of shaking at 100 Hz, with few readings."""
    scenario = load_scenario("aerobatics")
    rates = {"accel": 100.0, "gyro": 100.0, "mag": 20.0, "baro": 10.0, "sonar": 5.0, "laser": 5.0, "gps": 5.0}
    sensors = {name: replace(entry, rate=rates[name]) for name, entry in scenario.sensors.items()}
    manoeuvre = Manoeuvre("shake", 12.0, {"north": 2.0, "east": 1.5, "up": 1.0, "yaw": 40.0})
    return scenario.replace(name="short", sensors=sensors, manoeuvres=(manoeuvre,))


@pytest.fixture(scope="module")
def alone() -> MonteCarlo:
    return run(short(), 24, seed=7, workers=1)


def test_every_average_lies_in_its_family_wise_interval() -> None:
    """40 aerobatic flights: false alarm 1 % over all averages, with a fixed seed."""
    summary = run("aerobatics", 40, seed=1, workers=1).summary()
    assert list(outside(summary)) == []


def test_noise_that_is_not_declared_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A GPS that declares two thirds of its noise."""

    def boastful(scenario: Scenario, rng: np.random.Generator) -> tuple[Recording, Stream]:
        recording, truth = simulate(scenario, rng)
        gps = recording.spec("gps")
        assert gps.noise_std is not None
        return recording.replace(
            sensors={**recording.sensors, "gps": replace(gps, noise_std=gps.noise_std / 1.5)}
        ), truth

    assert not any(line.startswith("NIS of gps") for line in outside(run(short(), 8, workers=1).summary()))
    monkeypatch.setattr("sinan.experiments.monte_carlo.one_flight.simulate", boastful)
    assert any(line.startswith("NIS of gps") for line in outside(run(short(), 8, workers=1).summary()))


def test_the_result_is_the_same_for_two_workers(alone: MonteCarlo) -> None:
    assert json.dumps(run(short(), 24, seed=7, workers=2).summary()) == json.dumps(alone.summary())


def test_a_run_depends_on_its_number_alone(alone: MonteCarlo) -> None:
    assert fly(short(), 7, 5) == alone.flights[5]


def test_it_goes_on_where_it_was_killed(alone: MonteCarlo, tmp_path: Path) -> None:
    run(short(), 10, seed=7, workers=1, resume=tmp_path)
    (tmp_path / "run-000004.json").write_text('{"run": 4, "t": [1.0')  # as a kill without the rename would leave it
    told: list[tuple[int, int]] = []
    result = run(
        short(), 24, seed=7, workers=1, resume=tmp_path, progress=lambda done, total: told.append((done, total))
    )
    assert told[0] == (9, 24)
    assert told[-1] == (24, 24)
    assert json.dumps(result.summary()) == json.dumps(alone.summary())


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three finished runs."""
    folder = tmp_path_factory.mktemp("kept")
    run(short(), 3, seed=7, workers=1, resume=folder)
    return folder


@pytest.mark.parametrize("key", [f.name for f in fields(Score)])
def test_a_kept_run_with_a_key_missing_is_named(kept: Path, tmp_path: Path, key: str) -> None:
    table = json.loads((kept / "run-000001.json").read_text())
    del table[key]
    assert f"run-000001.json: no key {key}; expected run 1 as it was written" in resumed(kept, tmp_path, table)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"run": 2}, "key run is 2"),
        ({"run": "1"}, "key run is no whole number"),
        ({"t": [float("nan")] * 10}, "key t holds nan"),
        ({"t": 1.0}, "key t is no list of numbers"),
        ({"error": [[1.0], [1.0, 2.0]]}, "key error has rows of different length"),
        ({"error": [["a"]] * 10}, "key error is no list of numbers"),
        ({"sigma": [[1.0]] * 10}, "key sigma has 10 x 1 numbers"),
        ({"nees": {"overall": [1e300] * 10}}, "key nees.overall holds 1e+300"),
        ({"nees": {}}, "no key nees."),
        ({"nees": []}, "key nees is no table"),
        ({"nis": {"gps": [float("inf"), 3.0]}}, "key nis.gps holds inf"),
        ({"nis": {"gps": [3.0]}}, "key nis.gps has 1 numbers"),
        ({"nis": {}}, "other checkpoints, states or sensors"),
        ({"rejected": {"gps": None}}, "key rejected.gps is no number"),
        ({"blocks": [1]}, "key blocks is no list of names"),
        ({"more": 1}, "unknown key more"),
    ],
)
def test_a_kept_run_that_is_none_is_named(kept: Path, tmp_path: Path, change: dict[str, object], found: str) -> None:
    table = json.loads((kept / "run-000001.json").read_text()) | change
    assert found in resumed(kept, tmp_path, table)


def resumed(kept: Path, folder: Path, table: dict[str, object]) -> str:
    """The line that resuming says where a kept run holds a table."""
    for path in kept.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "run-000001.json").write_text(json.dumps(table))
    with pytest.raises(InputError) as caught:
        run(short(), 3, seed=7, workers=1, resume=folder)
    assert str(folder / "run-000001.json") in str(caught.value)
    return str(caught.value)


def test_another_scenario_cannot_go_on_in_the_same_folder(tmp_path: Path) -> None:
    Kept(tmp_path, short(), 7)
    with pytest.raises(InputError, match="seed"):
        Kept(tmp_path, short(), 8)
    with pytest.raises(InputError, match="digest"):
        Kept(tmp_path, short().replace(ground_down=0.5), 7)


def test_the_digest_sees_every_number() -> None:
    scenario = short()
    spec = replace(scenario.sensors["mag"].spec, noise_std=0.006)
    other = scenario.replace(sensors={**scenario.sensors, "mag": replace(scenario.sensors["mag"], spec=spec)})
    assert digest_of(other) != digest_of(scenario)


def test_the_summary_has_the_keys_of_the_format(alone: MonteCarlo) -> None:
    summary = alone.summary()
    assert {"format", "runs", "nees", "nis", "coverage"} <= set(summary)
    assert set(summary["nees"]["overall"]) >= {"mean_per_dof", "interval"}
    assert "accel bias" in summary["nees"]["blocks"]
    assert set(summary["coverage"]) == {"1", "2", "3"}
    json.dumps(summary, allow_nan=False)


def test_blocks_share_out_the_states(alone: MonteCarlo) -> None:
    assert sum(alone.size(name) for name in alone.blocks) == alone.size("overall") == alone.error.shape[2] == 22


def test_the_bound_is_not_above_the_sigma_that_reaches_it(alone: MonteCarlo) -> None:
    ratio = alone.summary()["bound_over_sigma"]
    assert all(0.9 < value < 1.1 for value in ratio.values())


def test_the_flight_of_the_bound_is_declared_as_noisy_as_ever() -> None:
    recording, _ = noiseless(short(), rng_of(0, 0))
    assert recording.spec("gps").noise_std == short().sensors["gps"].spec.noise_std


def test_the_interval_is_that_of_2200_degrees_of_freedom() -> None:
    """100 runs of 22 states: [0.942, 1.060]."""
    np.testing.assert_allclose(averaged(2200.0, 2200.0, 0.99)["interval"], [0.942, 1.060], atol=5e-4)


def test_a_sensor_without_readings_has_no_average() -> None:
    assert averaged(0.0, 0.0, 0.99)["mean_per_dof"] is None


def test_names_of_blocks() -> None:
    assert (label("b_accel"), label("position")) == ("accel bias", "position")


def test_poses_are_no_flights() -> None:
    with pytest.raises(InputError, match="a flight"):
        run("accel_poses", 2)


def test_no_runs_are_refused() -> None:
    with pytest.raises(InputError, match="at least 1"):
        run("hover", 0)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two worker processes on the loopback interface."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    options = {"cwd": ROOT, "env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *common]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", *common]
    started = [subprocess.Popen(scheduler, **options)]  # type: ignore[call-overload]
    try:
        started += [subprocess.Popen([*worker, "--host", "127.0.0.1"], **options) for _ in range(2)]  # type: ignore[call-overload]
        yield _address(file), started[1:]
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def _address(file: Path) -> str:
    """The scheduler's address, once both workers are there."""
    import time

    from distributed import Client

    for _ in range(300):
        if file.exists() and file.read_text().strip():
            break
        time.sleep(0.1)
    address = str(json.loads(file.read_text())["address"])
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    return address


def test_a_dask_cluster_that_loses_a_worker_gives_the_same(
    alone: MonteCarlo, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = cluster
    killed: list[int] = []

    def kill_one(done: int, total: int) -> None:
        if done >= 6 and not killed:
            workers[0].send_signal(signal.SIGKILL)
            killed.append(done)

    result = run(short(), 24, seed=7, dask=address, progress=kill_one)
    assert killed
    assert killed[0] < 24
    assert workers[0].wait(10) == -signal.SIGKILL
    assert json.dumps(result.summary()) == json.dumps(alone.summary())


def test_no_cluster_at_the_address_is_said() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="--dask"):
        run(short(), 2, dask="tcp://127.0.0.1:1")


def test_no_client_is_left_of_a_cluster_that_does_not_answer() -> None:
    """One left to the garbage collector waits for ever where it is collected while the next one starts its loop."""
    distributed = pytest.importorskip("distributed")
    gc.disable()
    try:
        with pytest.raises(InputError, match="--dask"):
            run(short(), 2, dask="tcp://127.0.0.1:1")
        assert not [thing for thing in gc.get_objects() if isinstance(thing, distributed.Client)]
    finally:
        gc.enable()
