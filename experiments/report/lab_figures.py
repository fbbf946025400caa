"""Figures of the course's experiments: panels of curves and points beside or below each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

from sinan.experiments.report.figures import AFTER, BEFORE, CHANCE, SOFT, new_figure

#: Places along x and y of a curve.
Curve = tuple[NDArray[Any], NDArray[Any]]
#: Colours of curves in their order; grey is for what is known or expected.
COLOURS = (AFTER, BEFORE, CHANCE, "#6b8f3a", "#7a5195", "#1c2733")
#: Colours of what a calibration changes.
NAMED = {"before": BEFORE, "as it is": BEFORE, "after": AFTER, "calibrated": AFTER}


@dataclass(frozen=True)
class Panel:
    """One panel.

    Attributes
    ----------
    x_label, y_label : with units
    curves : name -> (x, y); a name that begins with `known` is drawn in grey under the others
    points : name -> (x, y), drawn as dots
    title : over the panel
    logarithmic : axes that are logarithmic: "", "x", "y" or "xy"
    """

    x_label: str
    y_label: str
    curves: Mapping[str, Curve] = field(default_factory=dict)
    points: Mapping[str, Curve] = field(default_factory=dict)
    title: str = ""
    logarithmic: str = ""


def panels(shown: Sequence[Panel], columns: int = 2, height: float = 3.0) -> Figure:
    """Panels in rows of `columns`, each with its legend."""
    columns = min(columns, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = new_figure(rows, columns, height)
    for one in axes.ravel()[len(shown) :]:
        one.set_visible(False)
    for one, panel in zip(axes.ravel(), shown, strict=False):
        colours = iter(COLOURS * 4)
        for name, (x, y) in panel.curves.items():
            known = name.startswith("known")
            colour = SOFT if known else NAMED.get(name) or next(colours)
            one.plot(x, y, label=name, color=colour, lw=3.2 if known else 1.4, alpha=0.6 if known else 1.0)
        for name, (x, y) in panel.points.items():
            size = 2.5 if len(x) > 100 else 5.0
            one.plot(x, y, "o", ms=size, mew=0, color=NAMED.get(name) or next(colours), label=name)
        if "x" in panel.logarithmic:
            one.set_xscale("log")
        if "y" in panel.logarithmic:
            one.set_yscale("log")
        one.set_xlabel(panel.x_label, fontsize=9)
        one.set_ylabel(panel.y_label, fontsize=9)
        one.set_title(panel.title, loc="left", fontsize=9)
        if len(panel.curves) + len(panel.points) > 1:
            one.legend(fontsize=8, framealpha=0.85, edgecolor="none")
    return figure
