"""The page of a Monte-Carlo study: every average with its interval, NEES over time, coverage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.report.figures import averages_with_intervals, lines
from sinan.experiments.report.page import Page
from sinan.experiments.report.words import state_size


def monte_carlo_page(path: Path, document: Mapping[str, Any]) -> None:
    """Write the page."""
    overall = document["nees"]["overall"]
    low, high = overall["interval"]
    inside = low <= overall["mean_per_dof"] <= high
    verdict = "lies within" if inside else "leaves"
    page = Page(
        f"{document['scenario']}: the filter {'knows' if inside else 'does not know'} how wrong it is",
        f"{document['runs']} flights: the mean squared error over the variance that the filter predicts is "
        f"{overall['mean_per_dof']:.3f}. For a filter that is right it is 1; this {verdict} the 95 % interval "
        f"{low:.3f} to {high:.3f} about it.",
    )
    normal = {"1": "68.3 %", "2": "95.4 %", "3": "99.7 %"}
    page.numbers(
        [
            (f"{100 * share:.1f} %", f"of the errors within {k} sigma (right: {normal[k]})")
            for k, share in document["coverage"].items()
        ]
    )
    nees = {"all states": overall, **document["nees"]["blocks"]}
    page.heading("Errors of the states (NEES at the end)")
    page.figure(
        averages_with_intervals(nees),
        "Squared error over the variance that the filter predicts, averaged over flights and states. Right of the bar: "
        "the filter believes too much in itself; left: too little. One in twenty leaves its bar by chance (orange); "
        "red: more than chance does.",
    )
    page.figure(
        lines(
            np.array(document["t"]),
            {name: np.array(e["over_time"]) for name, e in list(nees.items())[:4]},
            "time / s",
            "squared error over variance",
        ),
        "The same at other instants of the flights, for all states, position, velocity and attitude.",
    )
    page.heading("Innovations (NIS over the whole flights)")
    page.figure(
        averages_with_intervals(document["nis"]),
        "Squared innovation (reading minus prediction) over the variance that the filter expects of it, all readings.",
    )
    page.heading("Size of the errors")
    rows = [
        [
            name,
            state_size(name, document["rms_error"][name]),
            state_size(name, document["rms_sigma"][name]),
            f"{ratio:.2f}",
        ]
        for name, ratio in document["bound_over_sigma"].items()
    ]
    page.table(["state", "RMS error at the end", "predicted by the filter", "bound ÷ predicted"], rows, (1, 2, 3))
    page.text(
        "Bound: the sigma that no unbiased estimator can beat (Cramér and Rao). 1: the filter gives nothing away.",
        note=True,
    )
    page.write(path)
