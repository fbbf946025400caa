"""Monte Carlo: many simulated flights through the filter, and whether its own covariance tells the truth.

The runs depend on nothing but the seed and their number, so the result is the same for any number of workers, on a
cluster, and after a resumed kill.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from sinan.experiments.monte_carlo.one_flight import Score, cramer_rao, flight_from, fly
from sinan.experiments.scenarios import load_scenario
from sinan.experiments.workers.cluster import cluster
from sinan.experiments.workers.processes import in_processes
from sinan.experiments.workers.stopping import going_on
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text
from sinan.sensors.scenario import Scenario

LEVEL = 0.95  # of the interval beside each average
#: Probability that, the model being right, no average of a table is outside its wider interval.
FAMILY_LEVEL = 0.99
BATCHES_PER_WORKER = 4  # tasks a worker gets: few enough to cost nothing, enough to even out the end
LARGEST_BATCH = 16  # runs of a cluster between two signs of progress and two files

_LOADED = f"{__package__}.warm"

Progress = Callable[[int, int], None]
Take = Callable[[Iterable[Score]], None]


@dataclass(frozen=True)
class MonteCarlo:
    """The result of many runs.

    Attributes
    ----------
    scenario, seed : what was run
    flights : one a run, in the order of their numbers
    bound : (c, n) posterior Cramer-Rao bound at the checkpoints, 1-sigma
    """

    scenario: str
    seed: int
    flights: tuple[Score, ...]
    bound: FloatArray

    @property
    def blocks(self) -> list[str]:
        """State blocks, in order."""
        return self.flights[0].blocks

    @property
    def t(self) -> FloatArray:
        """(c,) checkpoints [s]."""
        return np.array(self.flights[0].t)

    @property
    def error(self) -> FloatArray:
        """(runs, c, n) true minus estimate."""
        return np.array([flight.error for flight in self.flights])

    @property
    def sigma(self) -> FloatArray:
        """(runs, c, n) the filter's own 1-sigma."""
        return np.array([flight.sigma for flight in self.flights])

    def nees(self, block: str) -> FloatArray:
        """(runs, c) normalised squares of a block or of all states ("overall"), not divided by their dof."""
        return np.array([flight.nees[block] for flight in self.flights])

    def size(self, block: str) -> int:
        """Number of states of a block."""
        if block == "overall":
            return len(self.flights[0].error[0])
        return 1 if block in ("b_baro", "b_sonar", "b_laser") else 3

    def summary(self) -> dict[str, Any]:
        """The result as JSON has it: averages with the chi-square interval of their own degrees of freedom.

        NEES are those at the end of the flights, where runs are independent, with their course over time beside them.
        NIS are those of all readings, whose innovations are independent if all is well.
        """
        sensors = list(self.flights[0].nis)
        family = 1.0 - (1.0 - FAMILY_LEVEL) / (1 + len(self.blocks) + len(sensors))
        nees = {name: self._nees_of(name, family) for name in ("overall", *self.blocks)}
        return {
            "format": 1,
            "scenario": self.scenario,
            "seed": self.seed,
            "runs": len(self.flights),
            "level": LEVEL,
            "family_level": FAMILY_LEVEL,
            "nees": {"overall": nees.pop("overall"), "blocks": {label(name): value for name, value in nees.items()}},
            "nis": {name: self._nis_of(name, family) for name in sensors},
            "coverage": {str(k): float(np.mean(np.abs(self.error) < k * self.sigma)) for k in (1, 2, 3)},
            "t": self.t.tolist(),
            "rms_error": {label(name): self._rms(self.error[:, -1], name) for name in self.blocks},
            "rms_sigma": {label(name): self._rms(self.sigma[:, -1], name) for name in self.blocks},
            "bound_over_sigma": {label(name): self._bound_over_sigma(name) for name in self.blocks},
            "rejected": {name: sum(flight.rejected.get(name, 0) for flight in self.flights) for name in sensors},
        }

    def _nees_of(self, name: str, family: float) -> dict[str, Any]:
        runs, dof = len(self.flights), self.size(name)
        values = self.nees(name)
        return {
            **averaged(float(np.sum(values[:, -1])), runs * dof, family),
            "over_time": (np.sum(values, axis=0) / (runs * dof)).tolist(),
        }

    def _nis_of(self, name: str, family: float) -> dict[str, Any]:
        total = sum(flight.nis[name][0] for flight in self.flights)
        return averaged(total, sum(flight.nis[name][1] for flight in self.flights), family)

    def _columns(self, name: str) -> slice:
        start = sum(self.size(other) for other in self.blocks[: self.blocks.index(name)])
        return slice(start, start + self.size(name))

    def _rms(self, value: FloatArray, name: str) -> float:
        return float(np.sqrt(np.mean(value[..., self._columns(name)] ** 2)))

    def _bound_over_sigma(self, name: str) -> float:
        """Root mean square of the bound over that of the filter's sigma, at the end; 1: nothing is given away."""
        return self._rms(self.bound[-1], name) / self._rms(self.sigma[:, -1], name)


def label(block: str) -> str:
    """A block's name in words: b_accel -> accel bias."""
    return f"{block.removeprefix('b_')} bias" if block.startswith("b_") else block


def averaged(total: float, dof: float, family: float) -> dict[str, Any]:
    """A sum of squares over its dof, with the chi-square intervals at `LEVEL` and at the family-wise level."""
    from scipy.special import chdtri

    if dof == 0:
        return {"mean_per_dof": None, "dof": 0, "interval": None, "family_interval": None}
    ends = [[float(chdtri(dof, 1.0 - q) / dof) for q in ((1.0 - p) / 2.0, (1.0 + p) / 2.0)] for p in (LEVEL, family)]
    return {"mean_per_dof": total / dof, "dof": int(dof), "interval": ends[0], "family_interval": ends[1]}


def run(
    scenario: str | Path | Scenario,
    runs: int,
    *,
    seed: int = 0,
    workers: int | None = None,
    dask: str | None = None,
    resume: Path | None = None,
    progress: Progress | None = None,
    relinearise: bool = False,
) -> MonteCarlo:
    """Run a scenario many times.

    Parameters
    ----------
    scenario : name, TOML file, or a `Scenario`; a flight
    runs : number of runs
    seed : of all runs
    workers : processes; None: one a core
    dask : address of the scheduler of a running Dask cluster, in place of processes here
    resume : folder in which finished runs are kept, and from which they are taken
    progress : called with (runs done, runs in all)
    relinearise : as of `FlightModel`

    Raises
    ------
    InputError : not a flight; a folder to resume from that holds other runs; no cluster at the address
    """
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if runs < 1:
        raise InputError("--runs", f"{runs}", "at least 1")
    if scenario.kind != "flight":
        raise InputError(f"scenario {scenario.name}", f'kind = "{scenario.kind}"', "a flight")
    kept = Kept(resume, scenario, seed, relinearise) if resume is not None else None
    done = {} if kept is None else kept.flights(runs)
    taken, missing = list(done), [k for k in range(runs) if k not in done]
    report = progress or (lambda done, total: None)

    def take(flights: Iterable[Score]) -> None:
        for flight in flights:
            if kept is not None:
                kept.keep(flight)
            done[flight.run] = flight
        report(len(done), runs)

    def how_to_go_on() -> str:
        finished = len(done) if kept is None else kept.count(runs)  # a run may be kept and not yet counted
        far = f" after {finished} of {runs} flights"
        if kept is not None or not done:
            return f"{far}: the same command {'goes on' if finished else 'begins again'}"
        folder = _keep_elsewhere(done.values(), scenario, seed, relinearise)
        return f"{far}, kept: the same command with --resume {folder} goes on"

    report(len(done), runs)
    with going_on(how_to_go_on):
        _fly_all(Plan(scenario, seed, relinearise), missing, workers, dask, take)
    if kept is not None:
        kept.require_alike(taken, done)
    return MonteCarlo(scenario.name, seed, tuple(done[k] for k in range(runs)), cramer_rao(scenario, seed))


@dataclass(frozen=True)
class Plan:
    """What every run has in common: see `run`."""

    scenario: Scenario
    seed: int
    relinearise: bool = False


def fly_batch(plan: Plan, batch: Sequence[int]) -> list[Score]:
    """Several runs, in one task."""
    return [fly(plan.scenario, plan.seed, run, plan.relinearise) for run in batch]


def _keep_elsewhere(flights: Iterable[Score], scenario: Scenario, seed: int, relinearise: bool) -> Path:
    """A new folder with runs that were flown without one to keep them in."""
    kept = Kept(Path(mkdtemp(prefix=f"sinan-{scenario.name}-")), scenario, seed, relinearise)
    for flight in flights:
        kept.keep(flight)
    return kept.folder


def _fly_all(plan: Plan, missing: list[int], workers: int | None, dask: str | None, take: Take) -> None:
    """The missing flights, in the order in which they get done."""
    count = min(workers or os.cpu_count() or 1, len(missing))
    if dask is not None and missing:
        _on_cluster(plan, missing, dask, take)
    elif count <= 1:
        for k in missing:
            take(fly_batch(plan, [k]))
    else:
        take(fly_batch(plan, missing[:1]))  # compiles what is not compiled: the workers find it in the cache
        in_processes(
            partial(fly_batch, plan), [[k] for k in missing[1:]], count, lambda _, flights: take(flights), _LOADED
        )


def _on_cluster(plan: Plan, missing: list[int], address: str, take: Take) -> None:
    """A running Dask cluster; tasks of a worker that dies are given to another by its scheduler."""
    with cluster(address) as client:
        from distributed import as_completed

        workers = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        tasks = [client.submit(fly_batch, plan, batch, pure=False) for batch in _batches(missing, workers)]
        for task in as_completed(tasks):
            take(task.result())


def _batches(missing: Sequence[int], workers: int) -> list[list[int]]:
    size = max(1, min(LARGEST_BATCH, len(missing) // (BATCHES_PER_WORKER * workers)))
    return [list(missing[k : k + size]) for k in range(0, len(missing), size)]


class Kept:
    """Finished runs in a folder: `plan.json` says of what, `run-000012.json` holds one.

    Parameters
    ----------
    folder : made where it does not exist
    scenario, seed, relinearise : what the runs are of

    Raises
    ------
    InputError : the folder holds runs of something else
    """

    def __init__(self, folder: Path, scenario: Scenario, seed: int, relinearise: bool = False) -> None:
        self.folder = Path(folder)
        plan = {"format": 1, "scenario": scenario.name, "seed": seed, "digest": digest_of(scenario)}
        if relinearise:
            plan["relinearise"] = True
        file = self.folder / "plan.json"
        if file.exists():
            found = _read(file)
            if found != plan:
                differing = ", ".join(k for k in {**plan, **(found or {})} if (found or {}).get(k) != plan.get(k))
                raise InputError(file, f"runs of another {differing}", "the same scenario and seed, or an empty folder")
        else:
            write_text(file, json.dumps(plan))

    def flights(self, runs: int) -> dict[int, Score]:
        """What is finished, of the first `runs` runs; a file that a kill left incomplete counts for nothing.

        Raises
        ------
        InputError : a file that is whole but holds no run, or another one
        """
        found = ((k, _read(self._file(k))) for k in range(runs) if self._file(k).exists())
        return {k: self._flight(k, table) for k, table in found if table is not None}

    def _flight(self, run: int, table: dict[str, Any]) -> Score:
        try:
            flight = flight_from(table)
            if flight.run != run:
                raise ValueError(f"key run is {flight.run}")
        except ValueError as error:
            raise self._error(run, str(error)) from None
        return flight

    def _error(self, run: int, found: str) -> InputError:
        return InputError(self._file(run), found, f"run {run} as it was written; without the file it is flown again")

    def require_alike(self, kept: Iterable[int], done: dict[int, Score]) -> None:
        """Raise an `InputError` for a kept run whose checkpoints, states or sensors are not those of the others."""
        flown = [flight for k, flight in done.items() if k not in set(kept)] or list(done.values())
        for k in kept:
            if _kinds(done[k]) != _kinds(flown[0]):
                raise self._error(k, "other checkpoints, states or sensors than the other runs have")

    def count(self, runs: int) -> int:
        """How many of the first `runs` runs are kept."""
        return sum(self._file(run).exists() for run in range(runs))

    def keep(self, flight: Score) -> None:
        """Write one run."""
        write_text(self._file(flight.run), json.dumps(flight.as_table()))

    def _file(self, run: int) -> Path:
        return self.folder / f"run-{run:06d}.json"


def _kinds(flight: Score) -> tuple[object, ...]:
    """What the flights of one scenario have in common."""
    return len(flight.t), flight.blocks, len(flight.error[0]), set(flight.nees), set(flight.nis)


def digest_of(scenario: Scenario) -> str:
    """A fingerprint of everything that a scenario says."""
    return hashlib.sha256(repr(_plain(asdict(scenario))).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in sorted(value.items())}
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _read(file: Path) -> dict[str, Any] | None:
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return table if isinstance(table, dict) else None


def outside(summary: dict[str, Any]) -> Iterable[str]:
    """The averages that lie outside their family-wise interval, as sentences."""
    averages = {"NEES overall": summary["nees"]["overall"]}
    averages |= {f"NEES of {name}": value for name, value in summary["nees"]["blocks"].items()}
    averages |= {f"NIS of {name}": value for name, value in summary["nis"].items()}
    for name, value in averages.items():
        if value["family_interval"] is None:
            continue
        low, high = value["family_interval"]
        if not low <= value["mean_per_dof"] <= high:
            yield f"{name} is {value['mean_per_dof']:.3f} per dof, outside {low:.3f} to {high:.3f}"
