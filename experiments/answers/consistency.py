"""`sinan.monte_carlo`: does the filter know how wrong it is? As an object with tables, figures and a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinan.experiments.answers.asked import Answer
from sinan.experiments.monte_carlo.study import MonteCarlo
from sinan.experiments.monte_carlo.study import run as fly
from sinan.sensors.scenario import Scenario

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Consistency(Answer):
    """Many flights of one scenario, their errors set against what the filter predicts of them.

    Attributes
    ----------
    flights : errors and sigmas of every run
    """

    flights: MonteCarlo

    @cached_property
    def document(self) -> dict[str, Any]:  # type: ignore[override]
        """The numbers, as `sinan montecarlo --json` writes them."""
        return self.flights.summary()

    def nees(self) -> pd.DataFrame:
        """Squared errors of the states over their predicted variance, a degree of freedom, at the end of the flights.

        Returns
        -------
        a row a block of states, `all states` first; columns `mean`, and `low`, `high`: its 95 % interval about 1
        """
        nees = self.document["nees"]
        return _table({"all states": nees["overall"], **nees["blocks"]}, "states")

    def nis(self) -> pd.DataFrame:
        """The same of the innovations, whole flights: a row a sensor."""
        return _table(self.document["nis"], "sensor")

    def summary(self) -> str:
        """What `sinan montecarlo` prints: NEES, NIS, errors, coverage."""
        from sinan.experiments.report.monte_carlo_words import summary

        return summary(self.document)

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan montecarlo --html`. Returns its path."""
        from sinan.experiments.report.monte_carlo_page import monte_carlo_page

        monte_carlo_page(Path(path), self.document)
        return Path(path)

    def plot_nees(self) -> list[Axes]:
        """The averages of `nees` with their intervals. One axes."""
        from sinan.experiments.report import figures, screen

        nees = self.document["nees"]
        entries = {"all states": nees["overall"], **nees["blocks"]}
        return screen.axes(lambda: figures.averages_with_intervals(entries))


def _table(entries: Mapping[str, Mapping[str, Any]], name: str) -> pd.DataFrame:
    import pandas as pd

    nan = float("nan")
    rows = {
        key: (nan, nan, nan) if one["mean_per_dof"] is None else (one["mean_per_dof"], *one["interval"])
        for key, one in entries.items()
    }
    table = pd.DataFrame.from_dict(rows, orient="index", columns=["mean", "low", "high"])
    return table.rename_axis(name)


def monte_carlo(
    scenario: str | Path | Scenario,
    runs: int = 100,
    *,
    seed: int = 0,
    workers: int | None = 1,
    dask: str | None = None,
    resume: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    relinearise: bool = False,
) -> Consistency:
    """Fly a scenario many times and set the filter's errors against its own prediction.

    Parameters
    ----------
    scenario : of a flight: its name, TOML file or `Scenario`
    runs : number of flights
    seed : of all runs; the same seed gives the same result, with however many workers
    workers : processes; None: one a core. With more than one, a script needs its `if __name__ == "__main__":`
    dask : address of the scheduler of a running cluster, in place of processes here
    resume : folder that keeps finished runs: called again with it, only those that lack are flown
    progress : called with (runs done, runs in all)
    relinearise : linearise the readings about the smoothed motion, as `sinan.estimate` does

    Returns
    -------
    Consistency

    Raises
    ------
    InputError : not a flight; a folder that holds other runs; no cluster at the address

    Examples
    --------
    >>> import sinan
    >>> study = sinan.monte_carlo("square", runs=4, seed=3)
    >>> bool(study.nees().loc["all states", "mean"] < 2.0)
    True
    """
    return Consistency(
        fly(
            scenario, runs, seed=seed, workers=workers, dask=dask, resume=resume, progress=progress,
            relinearise=relinearise,
        )
    )  # fmt: skip
