"""The page of a Monte-Carlo study: every average with its interval, NEES over time, coverage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.report.figures import averages_with_intervals, lines
from experiments.report.page import Page
from experiments.report.words import number


def monte_carlo_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write the page."""
    overall = document["nees"]["overall"]
    low, high = overall["interval"]
    inside = low <= overall["mean_per_dof"] <= high
    verdict = "lies within" if inside else "leaves"
    page = Page(
        f"{document['scenario']}: the filter {'knows' if inside else 'does not know'} how wrong it is",
        f"{document['runs']} flights: the mean squared error over its predicted variance is "
        f"{overall['mean_per_dof']:.3f}, which {verdict} its 95 % interval {low:.3f} to {high:.3f}.",
    )
    page.numbers([(f"{100 * share:.1f} %", f"errors within {k} sigma") for k, share in document["coverage"].items()])
    nees = {"all states": overall, **document["nees"]["blocks"]}
    page.heading("Errors of the states (NEES at the end)")
    page.figure(
        averages_with_intervals(nees), "Mean squared error over predicted variance; bar: 95 % interval about 1."
    )
    page.figure(
        lines(
            np.array(document["t"]),
            {name: np.array(e["over_time"]) for name, e in list(nees.items())[:4]},
            "time / s",
            "NEES a state",
        ),
        "The same over time, for all states and the first blocks.",
    )
    page.heading("Innovations (NIS over the whole flights)")
    page.figure(averages_with_intervals(document["nis"]), "Mean squared innovation over predicted variance.")
    page.heading("Size of the errors")
    rows = [
        [name, number(document["rms_error"][name]), number(document["rms_sigma"][name]), number(ratio)]
        for name, ratio in document["bound_over_sigma"].items()
    ]
    page.table(["state", "RMS error", "predicted", "bound over predicted"], rows, numeric=(1, 2, 3))
    page.write(path)
