"""Figures of the bias-observability laboratory. Each takes a finished study and draws it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from sinan.experiments.bias_observability.directions import HALVED, NOTHING, block_of, name_of, shown, unit_in_words
from sinan.experiments.bias_observability.document import NAMES, base_places
from sinan.experiments.bias_observability.segments import MOST_SEGMENTS
from sinan.experiments.report.figures import AFTER, BEFORE, SOFT, blank, new_figure
from sinan.sensors.arrays import FloatArray

if TYPE_CHECKING:
    from sinan.experiments.bias_observability.study import Study

#: Blue: known; white: sigma halved; red: not known. And of information: red lost, blue gained.
_KNOWN = LinearSegmentedColormap.from_list("known", [AFTER, "#ffffff", BEFORE])
_GAINED = LinearSegmentedColormap.from_list("gained", [BEFORE, "#ffffff", AFTER])
#: Kinds of motion: light where little happens.
_KIND_COLOURS = ("#dfe5ea", "#0b6e99", "#c8553d", "#f2c14e", "#6b8f3a", "#7a5195", "#1c2733")
_AXIS_COLOURS = (AFTER, BEFORE, "#6b8f3a")
_LEAST_LEFT = 0.01  # share of the prior sigma that is shown in the darkest blue
_MOST_BITS = 5.0
_DEEPEST = 1e-3  # share of the prior sigma at the foot of the curves


def singular_values(study: Study) -> Figure:
    """What the readings know of each direction of the first state, in units of what the prior knows."""
    foot, top = 1e-2 * NOTHING, 10.0 * float(study.singular_values.max())
    values = np.maximum(study.singular_values, foot)
    figure, axes = new_figure(1, 1, 3.0)
    one = axes[0, 0]
    place, seen = np.arange(1, len(values) + 1), values >= HALVED
    one.vlines(place, foot, values, color=SOFT, lw=1.0)
    one.plot(place[seen], values[seen], "o", color=AFTER, ms=6, label="seen")
    one.plot(place[~seen], values[~seen], "o", color=BEFORE, ms=6, label="not seen", clip_on=False, zorder=5)
    one.axhline(HALVED, color="black", lw=0.8, ls="--")
    one.text(1.0, 1.3 * HALVED, "halves the prior σ", fontsize=8.5, ha="right", transform=one.get_yaxis_transform())
    one.set_yscale("log")
    one.set_ylim(foot, top)
    one.minorticks_off()
    ticks = [10.0**k for k in range(-6, 14, 2) if 10.0**k <= top]
    one.set_yticks([foot, *ticks], ["nothing", *[f"$10^{{{round(np.log10(tick))}}}$" for tick in ticks]])
    one.set_xticks(place)
    one.set_xlim(0.4, len(values) + 0.6)
    one.set_xlabel("direction of the first state, the best known first", fontsize=9)
    one.set_ylabel("information / prior information", fontsize=9)
    one.legend(frameon=False, fontsize=9, loc="upper right", ncols=2)
    return figure


def weak_parts(study: Study) -> Figure:
    """Which states make up each weak direction of all sensors together: a heat map direction x state."""
    weak = [w.direction for w in study.weaknesses if w.sensors == study.case.aboard]
    used = [i for i in range(len(study.found.labels)) if any(abs(d.v[i]) >= 0.02 for d in weak)]
    values = np.array([[d.v[i] / np.max(np.abs(d.v)) for i in used] for d in weak])
    values *= np.array([[np.sign(d.amounts[d.states[0]])] for d in weak])
    figure, axes = new_figure(1, 1, 0.36 * len(weak) + 1.6)
    one = axes[0, 0]
    image = one.imshow(values, cmap="RdBu", vmin=-1.0, vmax=1.0, aspect="auto")
    _write(one, values, lambda v: "" if abs(v) < 0.02 else _part(v), np.abs(values) > 0.7)
    _axes_of(one, [d.title for d in weak], [name_of(study.found.labels[i]) for i in used])
    figure.colorbar(image, ax=one, pad=0.01).set_label("part, in prior sigmas", fontsize=9)
    return figure


def sigma_curves(study: Study) -> Figure:
    """Sigma of every bias over time as a share of its prior, block by block, the manoeuvres above."""
    blocks: dict[str, list[int]] = {}
    for i, label in enumerate(study.found.labels):
        if label.startswith("b_"):
            blocks.setdefault(block_of(label), []).append(i)
    t, sigma = study.course.t - study.course.t[0], study.course.sigma[0]
    figure = blank(9.0, 1.5 * len(blocks) + 0.5)
    ratios = {"height_ratios": [0.22, *[1.0] * len(blocks)]}
    band, *axes = figure.subplots(1 + len(blocks), 1, sharex=True, gridspec_kw=ratios)
    _manoeuvre_band(band, study)
    most = 1.15 * max(float(np.max(sigma[:, i] / sigma[0, i])) for places in blocks.values() for i in places)
    least = 0.7 * min(float(np.min(sigma[:, i] / sigma[0, i])) for places in blocks.values() for i in places)
    for one, (block, places) in zip(axes, blocks.items(), strict=True):
        for k, i in enumerate(places):
            name = study.found.labels[i].rpartition("_")[2] if len(places) > 1 else ""
            one.plot(t, sigma[:, i] / sigma[0, i], color=_AXIS_COLOURS[k], lw=1.6, label=name)
        one.axhline(0.5, color="black", lw=0.8, ls="--")
        one.set_yscale("log")
        one.set_ylim(max(_DEEPEST, least), max(most, 1.6))
        one.set_yticks([1.0, 0.1, 0.01], ["100 %", "10 %", "1 %"])
        one.minorticks_off()
        one.spines[["top", "right"]].set_visible(False)
        one.tick_params(labelsize=9)
        start = shown(study.found.labels[places[0]], float(sigma[0, places[0]]))
        unit = unit_in_words(study.found.labels[places[0]])
        one.set_title(
            f"{_block_name(block)}: σ as a share of the prior {start:.2g} {unit}".rstrip(), loc="left", fontsize=10
        )
        if len(places) > 1:
            one.legend(frameon=False, fontsize=9, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.95), borderpad=0)
        _shade(one, study)
        one.text(1.005, 0.5, "½", fontsize=10, va="center", transform=one.get_yaxis_transform())
    axes[-1].set_xlabel("time / s", fontsize=9)
    axes[-1].set_xlim(0.0, t[-1])
    return figure


def information_map(study: Study) -> Figure:
    """Information that each manoeuvre brought about each state: bits, log2(sigma before / sigma after)."""
    names = list(study.states[0].bits)
    values = np.array([[state.bits[name] for name in names] for state in study.states])
    figure, axes = new_figure(1, 1, 0.27 * len(values) + 1.8)
    one = axes[0, 0]
    image = one.imshow(values, cmap=_GAINED, vmin=-_MOST_BITS, vmax=_MOST_BITS, aspect="auto")
    _write(
        one,
        values,
        lambda v: "" if abs(v) < 0.1 else f"{v:.1f}",
        np.abs(values) > 0.7 * _MOST_BITS,
    )
    _axes_of(one, [name_of(state.label) for state in study.states], names)
    _rule_between(one, [block_of(state.label) for state in study.states])
    figure.colorbar(image, ax=one, pad=0.01).set_label("bits gained (red: lost)", fontsize=9)
    return figure


def catalogue_map(study: Study) -> Figure:
    """What each flight of the catalogue leaves of each prior sigma after the same time; the best flight first."""
    catalogue = study.catalogue
    assert catalogue is not None
    figure, axes = new_figure(1, 1, 0.27 * len(catalogue.labels) + 1.9)
    order = np.argsort(np.sum(np.log(catalogue.left), axis=1))
    _left_map(figure, axes[0, 0], catalogue.left[order].T, catalogue.labels, [catalogue.names[k] for k in order])
    return figure


def subset_map(study: Study) -> Figure:
    """What every subset of the sensors leaves of each bias, and below which sensors it has."""
    names = list(study.found.readings)
    rows = [i for i, label in enumerate(study.found.labels) if label.startswith("b_")]
    order = sorted(range(len(study.subsets)), key=lambda k: (_seen_in(study, k, rows), len(study.subsets[k])))
    figure = blank(9.0, 0.27 * len(rows) + 0.24 * len(names) + 1.2)
    top, below = figure.subplots(
        2, 1, sharex=True, gridspec_kw={"height_ratios": [len(rows), 0.9 * len(names)], "hspace": 0.03}
    )
    labels = [study.found.labels[i] for i in rows]
    _left_map(figure, top, study.left[np.ix_(order, rows)].T, labels, None)
    used = np.array([[name in study.subsets[k] for k in order] for name in names])
    for y, row in enumerate(used):
        below.plot(np.flatnonzero(row), np.full(int(row.sum()), y), "o", ms=5, color="black")
        below.plot(np.flatnonzero(~row), np.full(int((~row).sum()), y), "o", ms=5, color="#dfe5ea")
    imagined = {sensor.name for sensor in study.case.imagined}
    below.set_yticks(
        range(len(names)), [f"{NAMES[name]} (imagined)" if name in imagined else NAMES[name] for name in names]
    )
    below.set_ylim(len(names) - 0.5, -0.5)
    below.tick_params(labelsize=9, length=0)
    below.set_xticks([])
    below.spines[:].set_visible(False)
    here = order.index(0)
    for one, height in ((top, len(rows)), (below, len(names))):
        one.add_patch(_frame(here, height))
    below.set_xlabel("one column a set of sensors (black: used); framed: what is aboard", fontsize=9)
    return figure


def base_curves(study: Study) -> Figure:
    """Sigma of the GPS bias and of the position over time, without and with a base receiver."""
    without, with_base = base_places(study)
    t = study.course.t - study.course.t[0]
    pairs = (("GPS bias", "b_gps"), ("position", "position"))
    figure, axes = new_figure(1, 2, 2.8, sharey=True)
    for one, (title, block) in zip(axes[0], pairs, strict=True):
        for k, colour, width, text in (
            (without, "#e9a99b", 3.6, "without base receiver"),  # wide, so that the other shows where both agree
            (with_base, AFTER, 1.5, "with base receiver"),
        ):
            for axis, style in (("north", "-"), ("down", ":")):
                label = f"{block}_{axis}"
                if label in study.found.labels:
                    i = study.found.index(label)
                    one.plot(t, study.course.sigma[k, :, i], style, color=colour, lw=width, label=f"{text}, {axis}")
        one.set_yscale("log")
        one.set_title(title, loc="left", fontsize=10)
        one.set_xlabel("time / s", fontsize=9)
    axes[0, 0].set_ylabel("σ / m", fontsize=9)
    handles, labels = axes[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, fontsize=9, loc="outside lower center", ncols=4)
    return figure


def _seen_in(study: Study, k: int, rows: Sequence[int]) -> float:
    """Sorts subsets: those that know most last."""
    return -float(np.sum(np.log(study.left[k, rows])))


def _left_map(
    figure: Figure, one: Axes, left: FloatArray, labels: Sequence[str], columns: Sequence[str] | None
) -> None:
    """Heat map of posterior over prior: blue where known, white where halved, red where not."""
    shown_left = np.log2(np.clip(left, _LEAST_LEFT, 1.0))
    norm = TwoSlopeNorm(vmin=np.log2(_LEAST_LEFT), vcenter=-1.0, vmax=0.0)
    image = one.imshow(shown_left, cmap=_KNOWN, norm=norm, aspect="auto")
    if columns is not None:
        _write(one, 100.0 * left, lambda v: f"{v:.0f}" if v >= 0.95 else f"{v:.1f}", (left < 0.04) | (left > 0.9))
    _axes_of(one, [name_of(label) for label in labels], columns)
    _rule_between(one, [block_of(label) for label in labels])
    ticks = [share for share in (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01) if share >= _LEAST_LEFT]
    bar = figure.colorbar(image, ax=one, pad=0.01, ticks=np.log2(ticks))
    bar.ax.set_yticklabels([f"{100 * share:.0f} %" for share in ticks], fontsize=8.5)
    bar.set_label("of the prior sigma left", fontsize=9)


def _axes_of(one: Axes, rows: Sequence[str], columns: Sequence[str] | None) -> None:
    one.set_yticks(range(len(rows)), rows)
    if columns is None:
        one.set_xticks([])
    else:
        one.set_xticks(range(len(columns)), columns, rotation=35, ha="right", rotation_mode="anchor")
    one.tick_params(labelsize=9, length=0)
    one.spines[:].set_visible(False)


def _write(one: Axes, values: FloatArray, text: Any, dark: Any) -> None:
    """Numbers into the cells, white on dark ones; none where there are too many columns to read them."""
    if values.shape[1] > 24:
        return
    for (y, x), value in np.ndenumerate(values):
        ink = "white" if dark[y, x] else "#1c2733"
        cell = one.text(x, y, text(value), ha="center", va="center", fontsize=8, color=ink)
        cell.set_in_layout(False)  # it lies inside the axes: measuring it would take as long as drawing it


def _part(value: float) -> str:
    """`+1`, `-.74`: short enough for a narrow cell."""
    return f"{value:+.0f}" if abs(value) > 0.995 else f"{value:+.2f}".replace("0.", ".")


def _rule_between(one: Axes, blocks: Sequence[str]) -> None:
    """A white line between blocks of states."""
    for k, (before, after) in enumerate(pairwise(blocks)):
        if before != after:
            one.axhline(k + 0.5, color="#8a97a5", lw=1.0)


def _frame(column: int, height: int) -> Any:
    return Rectangle((column - 0.5, -0.5), 1.0, height, fill=False, ec="black", lw=1.6, clip_on=False, zorder=5)


def _shade(one: Axes, study: Study) -> None:
    """Every other manoeuvre shaded, where they are few enough to be followed."""
    start = study.course.t[0]
    if len(study.case.segments) > MOST_SEGMENTS:
        return
    for segment in study.case.segments[1::2]:
        one.axvspan(segment.start - start, segment.stop - start, color="#e8eef3", lw=0, zorder=0)


def _manoeuvre_band(one: Axes, study: Study) -> None:
    """A strip that says what is flown when: by number and name, or by colour where there are many stretches."""
    start, span = study.course.t[0], study.course.t[-1] - study.course.t[0]
    one.set_axis_off()
    one.set_ylim(0.0, 1.0)
    segments = study.case.segments
    if len(segments) > MOST_SEGMENTS:
        kinds = {
            name: _KIND_COLOURS[k % len(_KIND_COLOURS)]
            for k, name in enumerate(dict.fromkeys(s.name for s in segments))
        }
        for segment in segments:
            one.axvspan(segment.start - start, segment.stop - start, color=kinds[segment.name], lw=0)
        handles = [Patch(color=colour, label=name) for name, colour in kinds.items()]
        one.legend(
            handles=handles, ncols=len(kinds), fontsize=9, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0)
        )
        return
    _shade(one, study)
    for k, segment in enumerate(segments):
        wide = (segment.stop - segment.start) / span
        text = f"{k + 1} {segment.name}"
        if wide < 0.0105 * len(text):
            text = str(k + 1) if wide > 0.012 * len(str(k + 1)) else ""
        one.text(0.5 * (segment.start + segment.stop) - start, 0.45, text, fontsize=8.5, ha="center", va="center")


def _block_name(block: str) -> str:
    return name_of(block) if block in ("b_baro", "b_sonar", "b_laser") else f"{NAMES_OF_BLOCKS[block]} bias"


NAMES_OF_BLOCKS = {"b_accel": "accelerometer", "b_gyro": "gyroscope", "b_mag": "magnetometer", "b_gps": "GPS"}
