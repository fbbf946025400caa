"""Figures of a trace: residuals, the error held out, each effect on its sensor, the evidence for every candidate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sinan.estimator.evidence.source import Signature, StreamResidual
from sinan.experiments.report.figures import AFTER, BAND, BEFORE, SOFT, axis_label, new_figure
from sinan.experiments.report.words import SENSORS, stream_unit
from sinan.experiments.residual_loop.prove import Errors
from sinan.sensors.arrays import BoolArray, FloatArray, runs_of

DISTURBED, LEFT = "#f2c14e", "#d98c2b"
_MOST_POINTS = 6000
#: p-values at the ticks of the axis of evidence, as -log10 p and as they are written
_TICKS = {
    0: "1",
    1: "0.1",
    2: "0.01",
    4: "10$^{-4}$",
    10: "10$^{-10}$",
    30: "10$^{-30}$",
    100: "10$^{-100}$",
    1000: "10$^{-1000}$",
}
_MOST_EVIDENCE = 3000.0


@dataclass(frozen=True)
class Bar:
    """Evidence for one candidate.

    Attributes
    ----------
    label : what stands beside the bar
    log10_p : logarithm of its p-value
    kind : found, left (passes, but was not accepted) or other
    """

    label: str
    log10_p: float
    kind: str


def residuals_over_time(
    before: StreamResidual, after: StreamResidual, held_out: str, intervals: Sequence[Sequence[float]] = ()
) -> Figure:
    """Residual of a stream over time, before and after; held-out stretches are shaded.

    Parameters
    ----------
    held_out : which they are, in words; empty: none is shaded, since readings all over are withheld in turn
    """
    zero, before, after = before.zero, _told(before).as_sure_as(after), _told(after)
    figure, axes = new_figure(2, 1, 2.3, sharex=True, sharey=True)
    for one, r, colour, label in (
        (axes[0, 0], before, BEFORE, "plain model"),
        (axes[1, 0], after, AFTER, "with the effects found"),
    ):
        if held_out:
            _shade(one, r.t, r.held_out, BAND)
        thin = _thin(len(r.t))
        for component in r.residual.T:
            one.plot(r.t[thin], component[thin], ".", ms=3.5, color=colour, alpha=0.7, lw=0)
        one.axhline(0.0, color=SOFT, lw=0.8)
        for start, end in intervals:
            one.axvspan(start - zero, end - zero, color=DISTURBED, alpha=0.35, lw=0)
        size = f"{r.weighed.rms:.3g} {stream_unit(r.stream, r.unit)}".strip()
        one.set_title(f"{label}: RMS {size} over all data", loc="left", fontsize=10)
        one.set_ylabel(
            axis_label(f"{SENSORS.get(r.stream, r.stream)}\nresidual", stream_unit(r.stream, r.unit)), fontsize=9
        )
    _limit(axes[0, 0], [before, after])
    note = f"shaded: {held_out}, not used in the proof's fit" if held_out else "no reading withheld"
    axes[1, 0].set_xlabel(_time_label(before.t, note), fontsize=9)
    return figure


def error_bars(all_data: tuple[Errors, Errors], held_out: tuple[Errors, Errors], part: str, stream: str) -> Figure:
    """RMS of a residual before and after, on all data and on those held out, with 95 % intervals."""
    figure, axes = new_figure(1, 1, 2.1)
    one = axes[0, 0]
    groups = ((f"{part},\nnot used in the fit", held_out, 1.0), ("all data,\nused in the fit", all_data, 0.0))
    for _, (before, after), y in groups:
        for error, colour, at in ((before, BEFORE, y + 0.2), (after, AFTER, y - 0.2)):
            low, high = error.interval
            one.barh(at, error.rms, color=colour, height=0.36)
            one.plot([low, high], [at, at], color="black", lw=1.2, marker="|", ms=7)
            one.text(max(high, error.rms), at, f"  {error.rms:.3g}", va="center", fontsize=9)
    one.set_yticks([y for *_, y in groups], [label for label, *_ in groups])
    longest = max(max(e.interval[1], e.rms) for pair in (all_data, held_out) for e in pair)
    one.set_xlim(0.0, 1.25 * longest)
    unit = stream_unit(stream, all_data[0].unit)
    one.set_xlabel(axis_label(f"RMS of the {SENSORS.get(stream, stream)} residual", unit), fontsize=9)
    handles, labels = _legend((("plain model", BEFORE), ("with the effects found", AFTER)))
    one.legend(handles, labels, frameon=False, fontsize=9, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def residual_against_effect(signature: Signature, name: str) -> Figure:
    """Residual of the model without an effect against what the effect predicts for it."""
    figure, axes = new_figure(1, 1, 3.2)
    one = axes[0, 0]
    thin = _thin(len(signature.residual))
    one.plot(signature.predicted[thin], signature.residual[thin], ".", ms=4, color=BEFORE, alpha=0.5)
    unit = stream_unit(signature.stream, signature.unit)
    low, high = float(np.min(signature.predicted)), float(np.max(signature.predicted))
    one.plot([low, high], [low, high], color=AFTER, lw=1.8)
    one.set_xlabel(axis_label(f"what {name} predicts for the {_sensor(signature)} residual", unit), fontsize=9)
    one.set_ylabel(axis_label(f"{_sensor(signature)} residual\nwithout the effect", unit), fontsize=9)
    one.yaxis.set_major_locator(MaxNLocator(6))
    return figure


def effect_over_time(before: StreamResidual, after: StreamResidual, name: str, interval: tuple[float, float]) -> Figure:
    """Residual around the interval of a time-localised effect, of the model without it and of the final one."""
    unit = stream_unit(before.stream, before.unit)
    start, end = interval[0] - before.zero, interval[1] - before.zero
    before, after = _told(before), _told(after)
    t0, t1 = max(start, before.t[0]), min(end, before.t[-1])
    step = (before.t[-1] - before.t[0]) / max(len(before.t), 1)
    around = max(1.5 * (t1 - t0), 12.0 * step)
    figure, axes = new_figure(1, 1, 3.0)
    one = axes[0, 0]
    one.axvspan(t0, t1, color=DISTURBED, alpha=0.35, lw=0)
    for r, colour, label in ((before, BEFORE, f"without {name}"), (after, AFTER, "with all effects found")):
        rows = np.flatnonzero((r.t >= t0 - around) & (r.t <= t1 + around))
        rows = rows[_thin(len(rows))]
        for k, component in enumerate(r.residual[rows].T):
            one.plot(r.t[rows], component, ".", ms=5, color=colour, alpha=0.6, label=label if k == 0 else None)
    one.axhline(0.0, color=SOFT, lw=0.8)
    near = [r.rows((r.t >= t0 - around) & (r.t <= t1 + around)) for r in (before.as_sure_as(after), after)]
    _limit(one, [r for r in near if len(r.t)])
    one.set_xlabel(_time_label(before.t, "yellow: when it acts"), fontsize=9)
    one.set_ylabel(axis_label(f"{SENSORS.get(before.stream, before.stream)} residual", unit), fontsize=9)
    one.legend(frameon=False, fontsize=9)
    return figure


def evidence_bars(bars: Sequence[Bar], needed: float) -> Figure:
    """The p-value of every candidate, on a logarithmic axis that grows to the right with the evidence."""
    values = [min(max(-bar.log10_p, 0.0), _MOST_EVIDENCE) for bar in bars]
    figure, axes = new_figure(1, 1, 0.27 * len(bars) + 0.9)
    one = axes[0, 0]
    colours = {"found": AFTER, "left": LEFT, "other": SOFT}
    y = np.arange(len(bars))[::-1]
    one.barh(y, values, color=[colours[bar.kind] for bar in bars], height=0.66)
    one.set_yticks(y, [bar.label for bar in bars])
    one.set_ylim(-0.6, len(bars) - 0.4)
    one.axvline(needed, color=BEFORE, lw=1.3, ls="--")
    one.set_xscale("symlog", linthresh=2.0, linscale=0.8)
    right = max([*values, 2.5 * needed]) * 1.25
    one.set_xlim(0.0, right)
    ticks = {k: text for k, text in _TICKS.items() if k < right}
    one.set_xticks(list(ticks), list(ticks.values()))
    one.minorticks_off()
    one.annotate(
        f"needed: p < {10.0**-needed:.2g}", (needed, 1.0), xycoords=("data", "axes fraction"), xytext=(4, 2),
        textcoords="offset points", fontsize=9, color=BEFORE,
    )  # fmt: skip
    one.set_xlabel("p-value: how often chance alone would show as much", fontsize=9)
    return figure


def residuals_like_noise(streams: Sequence[StreamResidual], scale: float) -> Figure:
    """Normalised residuals of every stream over time, and how they are distributed against a standard normal.

    Parameters
    ----------
    scale : standard deviation of one normalised residual: 1 where the noise is declared
    """
    figure, axes = new_figure(len(streams), 2, 1.7, gridspec_kw={"width_ratios": [3, 1]}, sharey="row")
    x = np.linspace(-4.0, 4.0, 161)
    normal = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)
    for (left, right), r in zip(axes, map(_told, streams), strict=True):
        z, told = np.where(r.tells, r.whitened / scale, np.nan), r.whitened[r.tells] / scale
        thin = _thin(len(r.t))
        left.axhspan(-2.0, 2.0, color=BAND, lw=0)
        for component in z.T:
            left.plot(r.t[thin], component[thin], ".", ms=3, color=AFTER, alpha=0.6, lw=0)
        left.set_title(f"{SENSORS.get(r.stream, r.stream)}: {told.size} residuals, mean square {np.mean(told**2):.3g}",
                       loc="left", fontsize=9)  # fmt: skip
        left.set_ylabel("residual / σ", fontsize=9)
        left.set_ylim(-4.5, 4.5)
        bins = int(np.clip(np.sqrt(told.size), 9, 60))
        right.hist(np.clip(told, -4.4, 4.4), bins, density=True, orientation="horizontal", color=AFTER, alpha=0.5)
        right.plot(normal, x, color="black", lw=1.2)
        right.set_xticks([])
    axes[-1, 0].set_xlabel(_time_label(_told(streams[0]).t, "grey: ± 2 σ, 95 % of pure noise"), fontsize=9)
    axes[-1, 1].set_xlabel("black: pure noise", fontsize=9)
    return figure


def _legend(entries: Sequence[tuple[str, str]]) -> tuple[list[object], list[str]]:
    from matplotlib.patches import Patch

    return [Patch(color=colour) for _, colour in entries], [label for label, _ in entries]


def _sensor(signature: Signature) -> str:
    return SENSORS.get(signature.stream, signature.stream)


def _told(r: StreamResidual) -> StreamResidual:
    """The same over the time that words tell."""
    return replace(r, t=r.t - r.zero, zero=0.0)


def _thin(n: int) -> slice:
    return slice(None, None, max(n // _MOST_POINTS, 1))


def _time_label(t: FloatArray, note: str) -> str:
    counted = np.array_equal(t, np.arange(len(t)))
    return f"{'reading' if counted else 'time / s'}    ({note})"


def _limit(one: Axes, residuals: Sequence[StreamResidual]) -> None:
    """Let the axis hold all but the wildest thousandth of what the model could predict: the first innovations of a
    filter would hide the rest. Readings that it doubts are shown.
    """
    weighed = [replace(r, weight=None).weighed.residual.ravel() for r in residuals]
    reach = 1.6 * float(np.quantile(np.abs(np.concatenate(weighed)), 0.998)) if weighed else 0.0
    if reach > 0.0 and max(np.max(np.abs(r.residual)) for r in residuals) > 2.0 * reach:
        one.set_ylim(-reach, reach)


def _shade(one: Axes, t: FloatArray, mask: BoolArray, colour: str) -> None:
    order = np.argsort(t, kind="stable")
    t, mask = t[order], mask[order]
    for first, last in runs_of(mask):
        one.axvspan(t[first], t[min(last, len(t) - 1)], color=colour, lw=0)
