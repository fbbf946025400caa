"""Figures of a trace and of a calibration. Each takes what was computed and draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from experiments.estimate import BiasCourse
from experiments.report.words import BIAS_UNITS, component_name, stage_names
from experiments.residual_loop.source import StreamResidual
from sensors.arrays import FloatArray

BEFORE, AFTER, SOFT, BAND = "#c8553d", "#0b6e99", "#8a97a5", "#e8eef3"
_MOST_POINTS = 6000


def new_figure(rows: int = 1, columns: int = 1, height: float = 3.2, **options: Any) -> tuple[Figure, Any]:
    """A figure with axes in the house style."""
    figure = Figure(figsize=(9.0, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for one in axes.ravel():
        one.spines[["top", "right"]].set_visible(False)
        one.tick_params(labelsize=9)
    return figure, axes


def residuals_over_time(
    before: StreamResidual, after: StreamResidual, intervals: Sequence[Sequence[float]] = ()
) -> Figure:
    """Residual of a stream over time, before and after; held-out stretches are shaded."""
    figure, axes = new_figure(2, 1, 2.3, sharex=True, sharey=True)
    for one, r, colour, label in (
        (axes[0, 0], before, BEFORE, "plain model"),
        (axes[1, 0], after, AFTER, "with the effects found"),
    ):
        _shade_held_out(one, r)
        thin = slice(None, None, max(len(r.t) // _MOST_POINTS, 1))
        for component in r.residual.T:
            one.plot(r.t[thin], component[thin], ".", ms=3.5, color=colour, alpha=0.7, lw=0)
        one.axhline(0.0, color=SOFT, lw=0.8)
        for start, end in intervals:
            one.axvspan(start, end, color="#f2c14e", alpha=0.35, lw=0)
        one.set_title(f"{label}: RMS {r.rms:.3g} {'' if r.unit == '1' else r.unit}", loc="left", fontsize=10)
        one.set_ylabel(_axis_label("residual", r.unit), fontsize=9)
    counted = np.array_equal(before.t, np.arange(len(before.t)))
    axes[1, 0].set_xlabel("reading" if counted else "time / s", fontsize=9)
    return figure


def candidates_bars(candidates: Sequence[Mapping[str, Any]], found: Sequence[str], threshold: float) -> Figure:
    """-log10 p of every candidate about the plain model; found ones in colour, the threshold as a line."""
    rows = sorted(candidates, key=lambda c: c["p_value"], reverse=True)
    values = [min(-np.log10(max(c["p_value"], 1e-300)), 300.0) for c in rows]
    figure, axes = new_figure(1, 1, 0.26 * len(rows) + 0.9)
    one = axes[0, 0]
    colours = [AFTER if c["name"] in found else SOFT for c in rows]
    one.barh([c["name"] for c in rows], values, color=colours, height=0.65)
    one.axvline(threshold, color=BEFORE, lw=1.2, ls="--")
    one.set_xscale("symlog", linthresh=1.0)
    one.set_xlim(0, max([*values, 2 * threshold]) * 1.3)
    one.set_xlabel("evidence against the plain model, −log$_{10}$ p (dashed: needed)", fontsize=9)
    return figure


def error_bars(before: Mapping[str, Any], after: Mapping[str, Any]) -> Figure:
    """RMS on held-out data before and after, with 95 % intervals."""
    figure, axes = new_figure(1, 1, 1.5)
    one = axes[0, 0]
    for y, (error, colour) in enumerate(((after, AFTER), (before, BEFORE))):
        low, high = error["interval"]
        one.barh(y, error["rms"], color=colour, height=0.6)
        one.plot([low, high], [y, y], color="black", lw=1.6, marker="|", ms=9)
    one.set_yticks([1, 0], ["before", "after"])
    one.set_xlim(left=0.0)
    one.set_xlabel(_axis_label("RMS on held-out data", before["unit"]), fontsize=9)
    return figure


def residual_against_suspect(predicted: FloatArray, residual: FloatArray, name: str, unit: str) -> Figure:
    """Plain residual against what the effect predicts for it: the effect is right where the points follow the line."""
    figure, axes = new_figure(1, 1, 3.4)
    one = axes[0, 0]
    thin = slice(None, None, max(len(residual) // _MOST_POINTS, 1))
    one.plot(predicted[thin], residual[thin], ".", ms=4, color=BEFORE, alpha=0.6)
    low, high = float(np.min(predicted)), float(np.max(predicted))
    one.plot([low, high], [low, high], color=AFTER, lw=1.6)
    one.set_xlabel(_axis_label(f"predicted by {name}", unit), fontsize=9)
    one.set_ylabel(_axis_label("residual of the plain model", unit), fontsize=9)
    one.yaxis.set_major_locator(MaxNLocator(6))
    return figure


def norm_before_after(before: FloatArray, after: FloatArray, norm: float, unit: str) -> Figure:
    """Norm of each reading before and after a calibration, against the norm it should have."""
    figure, axes = new_figure(1, 1, 2.8)
    one = axes[0, 0]
    index = np.arange(1, len(before) + 1)
    one.axhline(norm, color=SOFT, lw=1.0)
    style = "." if len(before) > 60 else "o"
    one.plot(index, before, style, color=BEFORE, ms=4.5, label="before")
    one.plot(index, after, style, color=AFTER, ms=4.5, label="after")
    one.set_xlabel("reading", fontsize=9)
    one.set_ylabel(_axis_label("norm", unit), fontsize=9)
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
    one.legend(frameon=False, fontsize=9)
    return figure


def biases_over_time(courses: Sequence[BiasCourse]) -> Figure:
    """Each component of each bias with its 3-sigma band, and the truth where it is known."""
    columns = max((course.value.shape[1] for course in courses), default=1)
    figure, axes = new_figure(max(len(courses), 1), columns, 1.6, sharex=True)
    for row, course in enumerate(courses):
        for k in range(columns):
            one = axes[row, k]
            if k >= course.value.shape[1]:
                one.set_visible(False)
                continue
            value, band = course.value[:, k], 3.0 * course.sigma[:, k]
            one.fill_between(course.t, value - band, value + band, color=AFTER, alpha=0.18, lw=0)
            one.plot(course.t, value, color=AFTER, lw=1.1)
            if course.truth.size:
                one.plot(course.t, course.truth[:, k], color="black", lw=0.9)
            settled = slice(len(band) // 10, None)  # the first tenth, where the band is wide, would hide the rest
            shown = [value[settled] - 1.6 * band[settled], value[settled] + 1.6 * band[settled]]
            shown += [course.truth[:, k]] if course.truth.size else []
            one.set_ylim(min(map(np.min, shown)), max(map(np.max, shown)))
            axis = component_name(course.name, k, course.value.shape[1])
            one.set_title(f"{course.name} {axis} / {BIAS_UNITS.get(course.name, 'm')}", loc="left", fontsize=9)
            one.tick_params(labelsize=7)
    for one in axes[-1]:
        one.set_xlabel("time / s", fontsize=8)
    return figure


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
    panel.set_xlabel("residual / m", fontsize=9)
    if panels == 2:
        axes[0, 1].barh(y, [e or 0.0 for e in errors], color=BEFORE, height=0.65)
        axes[0, 1].set_xlabel("mean position error / m", fontsize=9)
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
        one.plot(entry["mean_per_dof"], y, "o", color=AFTER if inside else BEFORE, ms=6)
    one.axvline(1.0, color=SOFT, lw=0.9)
    one.set_yticks(range(len(known)), list(reversed(known)))
    one.set_xlabel("average per degree of freedom (grey: 95 % interval about 1; red: outside)", fontsize=9)
    return figure


def _axis_label(text: str, unit: str) -> str:
    return text if unit in ("1", "") else f"{text} / {unit}"


def _shade_held_out(one: Axes, r: StreamResidual) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], r.held_out, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        one.axvspan(r.t[first], r.t[min(last, len(r.t) - 1)], color=BAND, lw=0)
