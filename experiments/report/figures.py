"""Figures that several pages share. Each takes what was computed and draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.experiments.estimate import BiasCourse
from sinan.experiments.report.words import bias_unit, component_name, stage_names
from sinan.sensors.arrays import FloatArray

BEFORE, AFTER, SOFT, BAND, CHANCE = "#c8553d", "#0b6e99", "#8a97a5", "#e8eef3", "#d98c2b"


#: Room beyond the lowest and the highest curve, as a share of what they span.
_MARGIN = 0.08


#: Whether figures are for the screen, so that pyplot knows them; those of a page are not, and pyplot is not loaded.
ON_SCREEN: ContextVar[bool] = ContextVar("on_screen", default=False)


def blank(width: float, height: float) -> Figure:
    """An empty figure [inches], for a page or the screen."""
    if not ON_SCREEN.get():
        return Figure(figsize=(width, height), layout="constrained")
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width, height), layout="constrained")


def new_figure(rows: int = 1, columns: int = 1, height: float = 3.2, **options: Any) -> tuple[Figure, Any]:
    """A figure with axes in the house style."""
    figure = blank(9.0, height * rows)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for one in axes.ravel():
        one.spines[["top", "right"]].set_visible(False)
        one.tick_params(labelsize=9)
    return figure, axes


def norm_before_after(before: FloatArray, after: FloatArray, norm: float, unit: str) -> Figure:
    """Norm of each reading before and after a calibration, against the norm it should have."""
    figure, axes = new_figure(1, 1, 2.8)
    one = axes[0, 0]
    index = np.arange(len(before))
    one.axhline(norm, color=SOFT, lw=1.0)
    style = "." if len(before) > 60 else "o"
    one.plot(index, before, style, color=BEFORE, ms=4.5, label="before")
    one.plot(index, after, style, color=AFTER, ms=4.5, label="after")
    one.set_xlabel("reading, counted from 0", fontsize=9)
    one.set_ylabel(axis_label("norm", unit), fontsize=9)
    one.legend(frameon=False, fontsize=9, ncols=2, loc="upper left", bbox_to_anchor=(0.0, 1.14))
    return figure


def lines(x: FloatArray, curves: Mapping[str, FloatArray], x_label: str, y_label: str) -> Figure:
    """Several curves over one axis, named in a legend."""
    figure, axes = new_figure(1, 1, 3.2)
    one = axes[0, 0]
    styles = ("-", "--", "-.", ":")
    colours = (AFTER, BEFORE, "#6b8f3a", "#7a5195")
    for k, (name, y) in enumerate(curves.items()):
        one.plot(x, y, styles[k % 4], color=colours[k % 4], lw=1.6, label=name)
    one.set_xlabel(x_label, fontsize=9)
    one.set_ylabel(y_label, fontsize=9)
    one.legend(frameon=False, fontsize=9, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def biases_over_time(courses: Sequence[BiasCourse]) -> Figure:
    """Each component of each bias with its 3-sigma band, both broken at NaN, and the truth where it is known."""
    columns = max((course.value.shape[1] for course in courses), default=1)
    figure, axes = new_figure(max(len(courses), 1), columns, 1.6, sharex=True)
    for row, course in enumerate(courses):
        for k in range(columns):
            one = axes[row, k]
            if k >= course.value.shape[1]:
                one.set_visible(False)
                continue
            value, band = course.value[:, k], 3.0 * course.sigma[:, k]
            one.fill_between(course.t, value - band, value + band, color=AFTER, alpha=0.18, lw=0, label="± 3 sigma")
            one.plot(course.t, value, color=AFTER, lw=1.1, label="estimate")
            if course.truth.size:
                one.plot(course.t, course.truth[:, k], color="black", lw=0.9, label="truth")
            settled = slice(len(band) // 10, None)  # the first tenth, where the band is wide, would hide the rest
            shown = [value[settled] - 1.6 * band[settled], value[settled] + 1.6 * band[settled]]
            shown += [course.truth[:, k]] if course.truth.size else []
            low, high = min(map(np.nanmin, shown)), max(map(np.nanmax, shown))
            if high > low:  # a bias that is taken as known has no band
                one.set_ylim(low - _MARGIN * (high - low), high + _MARGIN * (high - low))
            axis = component_name(course.name, k, course.value.shape[1])
            title = f"{course.name} {axis}".rstrip() + f" / {bias_unit(course.name, course.field_unit)}"
            one.set_title(title, loc="left", fontsize=9)
            one.tick_params(labelsize=7)
    for column in axes.T:
        lowest = [one for one in column if one.get_visible()][-1]
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("time / s", fontsize=8)
    named = {
        label: handle for one in axes.ravel() for handle, label in zip(*one.get_legend_handles_labels(), strict=True)
    }
    if named:
        figure.legend(
            named.values(), named.keys(), loc="outside upper right", frameon=False, fontsize=9, ncols=len(named)
        )
    return figure


_DECADES = 1000.0  # between the largest and the least bar, from which on a linear axis shows one bar alone


def stage_bars(stages: Sequence[Mapping[str, Any]]) -> Figure:
    """Residual and position error after each stage of a model."""
    names = stage_names(stages)
    errors = [(s.get("position_error") or {}).get("mean") for s in stages]
    panels = 2 if any(e is not None for e in errors) else 1
    figure, axes = new_figure(1, panels, 0.4 * len(stages) + 1.1, sharey=True)
    panel = axes[0, 0]
    y = np.arange(len(stages))[::-1]
    panel.barh(y, [s["residual_rms"] for s in stages], color=AFTER, height=0.65)
    panel.set_yticks(y, names)
    panel.set_xlabel("RMS residual / m", fontsize=9)
    if panels == 2:
        axes[0, 1].barh(y, [e or 0.0 for e in errors], color=BEFORE, height=0.65)
        axes[0, 1].set_xlabel("mean position error / m", fontsize=9)
    for one, values in ((panel, [s["residual_rms"] for s in stages]), (axes[0, -1], errors)):
        sizes = [value for value in values if value]
        if sizes and max(sizes) > _DECADES * min(sizes):
            one.set_xscale("log")
    return figure


def averages_with_intervals(entries: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Averages that should be 1, as points, with the interval that they should lie in, as bars."""
    known = {name: e for name, e in entries.items() if e["mean_per_dof"] is not None}
    figure, axes = new_figure(1, 1, 0.28 * len(known) + 0.9)
    one = axes[0, 0]
    for y, entry in enumerate(reversed(known.values())):
        low, high = entry["interval"]
        one.plot([low, high], [y, y], color=BAND, lw=9, solid_capstyle="butt")
        inside = low <= entry["mean_per_dof"] <= high
        widest = entry.get("family_interval") or entry["interval"]
        chance = widest[0] <= entry["mean_per_dof"] <= widest[1]
        one.plot(entry["mean_per_dof"], y, "o", color=AFTER if inside else CHANCE if chance else BEFORE, ms=6)
    one.axvline(1.0, color=SOFT, lw=0.9)
    one.set_yticks(range(len(known)), list(reversed(known)))
    one.set_ylim(-0.6, len(known) - 0.4)
    one.set_xlabel("average a degree of freedom (grey: 95 % interval about 1)", fontsize=9)
    return figure


def axis_label(text: str, unit: str) -> str:
    """What an axis shows; a unit that is said in words follows a comma."""
    if unit in ("1", ""):
        return text
    return f"{text}, {unit}" if " " in unit else f"{text} / {unit}"
