"""The page of the blind benchmark: rates, who is taken for whom, and how identification goes with lambda."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA
from sinan.experiments.blind.grade import Grade
from sinan.experiments.blind.rates import clopper_pearson, shown
from sinan.experiments.report.figures import AFTER, BEFORE, CHANCE, SOFT, new_figure
from sinan.experiments.report.page import Page

_EDGES = (0.0, 3.0, 6.0, 12.0, 20.0, 30.0, 45.0, 100.0, 1000.0, np.inf)
_WORLDS = {"declared": "noise as declared", "rough": "rough: noise off by a third, colour, outliers, jitter, gaps"}
#: What the words of the tables mean.
_WORDS = (
    "In brackets: the exact 95 % interval of each rate (Clopper and Pearson).",
    f"An effect is detectable where its lambda is above {DETECTABLE_LAMBDA:g}: the mean gain in -2 log likelihood that "
    "its true size gives in that recording, less what the other effects hidden there could explain.",
    "Two effects are one class where that recording can hardly tell them apart: a name from the class of a hidden "
    "effect is not its own, but not a wrong one either.",
    "Some recordings hide a disturbance that no effect of the catalogue describes: there the right verdict is "
    "unexplained, or a name for its stretch in time. Only those count whose mark stands clear of the noise.",
)
#: Colours of the confusion: right, true besides, wrong, nothing.
_RIGHT, _BESIDES, _WRONG, _NOTHING = AFTER, SOFT, BEFORE, CHANCE


def blind_page(path: Path, grades: Sequence[Grade], document: Mapping[str, Any]) -> None:
    """Write the page."""
    page = Page(
        f"{len(grades)} recordings with sealed answers",
        "Each recording was traced without its answer; then the answers were opened and the names counted.",
    )
    for sentence in _WORDS:
        page.text(sentence, note=True)
    for world, rates in document["rates"].items():
        page.heading(f"World: {_WORLDS[world]}")
        page.table(["asked", "reached"], [[what, shown(entry)] for what, entry in rates.items()])
    page.heading("An effect is found where its evidence allows it")
    page.figure(
        identification(grades),
        "Share of the hidden effects of all worlds that were named, by the lambda that their size and the recording "
        "give; bars are 95 % intervals, grey numbers say of how many. Left of the dashed line silence is right: the "
        "recording does not hold the evidence.",
    )
    page.heading("What is named, by what is hidden")
    page.figure(
        confusion(grades),
        "Recordings with one effect whose class is detectable: how often (the number) what is hidden in the row was "
        "named as the column. Blue, on the diagonal: right. Red: wrong. Orange: nothing was named. Grey: another name "
        "that is true too, such as the wrong readings that a rough recording has. Two names count in two columns.",
    )
    page.write(path)


def identification(grades: Sequence[Grade]) -> Figure:
    """Share of hidden effects named, by predicted lambda."""
    pairs = [
        (x, name in g.named)
        for g in grades if g.what in ("one", "several")
        for name, x in zip(g.hidden, g.information, strict=True)
    ]  # fmt: skip
    figure, axes = new_figure(1, 1, 3.4)
    one = axes[0, 0]
    labels = []
    for k, (low, high) in enumerate(pairwise(_EDGES)):
        inside = [named for x, named in pairs if low <= x < high]
        labels.append(f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}")
        if inside:
            rate = np.mean(inside)
            a, b = clopper_pearson(int(np.sum(inside)), len(inside))
            one.errorbar(k, rate, [[rate - a], [b - rate]], fmt="o", color=AFTER, capsize=3)
            one.annotate(f"{len(inside)}", (k, 1.04), ha="center", fontsize=8, color=SOFT)
    one.axvline(_EDGES.index(DETECTABLE_LAMBDA) - 0.5, color=BEFORE, lw=1.0, ls="--")
    one.annotate("detectable from here", (_EDGES.index(DETECTABLE_LAMBDA) - 0.45, 0.05), fontsize=9, color=BEFORE)
    one.set_xticks(range(len(labels)), labels, fontsize=8, rotation=20)
    one.set_ylim(-0.03, 1.12)
    one.set_xlabel("predicted lambda of the hidden effect (grey: how many)", fontsize=9)
    one.set_ylabel("share named", fontsize=9)
    return figure


def confusion(grades: Sequence[Grade]) -> Figure:
    """Hidden against named, recordings with one detectable effect."""
    clear = [g for g in grades if g.what == "one" and g.class_detectable]
    rows = sorted({g.hidden[0] for g in clear})
    columns = [*rows, *sorted({n for g in clear for n in g.named} - set(rows)), "nothing"]
    counts = Counter((g.hidden[0], name, _colour(g, name)) for g in clear for name in g.named or ("nothing",))
    figure, axes = new_figure(1, 1, max(3.0, 0.2 * len(rows) + 1.6))
    one = axes[0, 0]
    cells: dict[tuple[str, str], list[tuple[str, int]]] = {}
    for (hidden, name, colour), count in sorted(counts.items()):
        cells.setdefault((hidden, name), []).append((colour, count))
    for (hidden, name), parts in cells.items():
        for k, (colour, count) in enumerate(parts):
            j = columns.index(name) + 0.5 * (k - 0.5 * (len(parts) - 1))
            one.text(j, rows.index(hidden), str(count), ha="center", va="center", fontsize=7, color="white",
                     bbox={"boxstyle": "round,pad=0.25", "fc": colour, "lw": 0})  # fmt: skip
    if not rows:
        one.text(0.0, -0.5, "no recording with one detectable effect", ha="center", fontsize=9, color=SOFT)
    one.set_xlim(-0.7, len(columns) - 0.3)
    one.set_ylim(len(rows) - 0.3, -0.7)
    one.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    one.set_yticks(range(len(rows)), rows, fontsize=7)
    one.grid(color=SOFT, lw=0.2)
    one.set_xlabel("named", fontsize=9)
    one.set_ylabel("hidden", fontsize=9)
    return figure


def _colour(g: Grade, name: str) -> str:
    """Of a name: right, true besides, wrong, or none given."""
    if name == "nothing":
        return _NOTHING
    if name in g.hidden:
        return _RIGHT
    return _WRONG if name in g.wrong else _BESIDES
