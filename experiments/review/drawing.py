"""A review as part of a page: drawings that stand without a script, and the data with which one zooms them.

Labels are text of the page, placed in per cent beside drawings that are stretched to its width: so they are as large
on a telephone as elsewhere, and the left edges of all panels lie above each other.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from math import ceil, floor, log10
from pathlib import Path

import numpy as np

from sinan.experiments.report.page import Drawn
from sinan.experiments.report.words import counted
from sinan.experiments.review.curves import BOUND, DOTS, Curve, Event, Panel, Plan, Review, thinned
from sinan.sensors.arrays import FloatArray

_HERE = Path(__file__).parent
#: Units of a drawing, whatever its size on the screen.
WIDTH, HEIGHT = 1000.0, 200.0
#: Pieces of a curve in a drawing; in the data as many as make the data of all curves so large, within bounds [bytes].
_DRAWN = 260
_DATA, _LEAST, _MOST = 1_100_000, 200, 3000
_BYTES_A_PIECE = 4 * 2 * 4 / 3 * 1.15
#: A number that stands for NaN, and the one that stands for the largest value of a curve.
_GONE, _LARGEST = 65535, 65534
#: A panel that is robust reaches in its first view so many times as far as this share of its readings, or as its bounds
#: do in the middle.
_INSIDE, _ROOM = 0.97, 1.5
_MARGIN = 0.06
_PLAN_POINTS = 2500
#: Rows of the table of events.
_TOLD = 60
#: Kinds of events that are marked in every panel.
_MARKED = ("found", "faults", "gaps, IMU")
#: Further to the right is the unit.
_ENDS = 0.965
_AXES = {"time": "s", "reading": "", "frequency": "Hz"}


def drawn(review: Review) -> Drawn:
    """The review for a page: drawings, how they look, and what zooms and reads them out."""
    style, script = ((_HERE / f"review.{end}").read_text(encoding="utf-8") for end in ("css", "js"))
    return Drawn(review_html(review), style, script)


def review_html(review: Review) -> str:
    """The review, sections and all, with its data."""
    pieces = pieces_for(review)
    numbers = {id(panel): k for k, panel in enumerate(review.panels)}
    parts = [f'<div class="review" data-axis="{review.axis}">']
    if review.plan is not None:
        parts.append(_plan(review.plan))
    if review.events:
        parts.append(_events(review))
    for section in review.sections:
        parts.append(f"<h3>{escape(section.title)}</h3>")
        parts += [f'<p class="note">{escape(section.note)}</p>'] if section.note else []
        parts += [_panel(review, panel, numbers[id(panel)]) for panel in section.panels]
    parts.append(f'<script type="application/json" class="data">{_data(review, pieces)}</script></div>')
    return "\n".join(parts)


def pieces_for(review: Review) -> int:
    """Of how many pieces a curve is in the data: as many as there is room for."""
    curves = sum(len(panel.curves) for panel in review.panels)
    return int(np.clip(_DATA / max(curves, 1) / _BYTES_A_PIECE, _LEAST, _MOST))


# ---- data


class _Packed:
    """Numbers as base64; clocks that several curves share are kept once."""

    def __init__(self) -> None:
        self.clocks: list[str] = []
        self._known: dict[str, int] = {}

    def clock(self, x: FloatArray) -> int:
        text = _base64(x.astype("<f4"))
        if text not in self._known:
            self._known[text] = len(self.clocks)
            self.clocks.append(text)
        return self._known[text]

    @staticmethod
    def values(y: FloatArray) -> dict[str, object]:
        """16 bits between the least and the largest value."""
        good = np.isfinite(y)
        low, high = (float(np.min(y[good])), float(np.max(y[good]))) if np.any(good) else (0.0, 1.0)
        scale = (high - low) / _LARGEST or 1.0
        parts = np.where(good, np.rint((np.where(good, y, low) - low) / scale), _GONE)
        return {"low": low, "scale": scale, "y": _base64(parts.astype("<u2"))}


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()


def _data(review: Review, pieces: int) -> str:
    """All curves as JSON that can stand within a page."""
    packed, panels = _Packed(), []
    for panel in review.panels:
        curves = []
        for curve in panel.curves:
            x, y = thinned(curve.x, curve.y, pieces)
            curves.append({"x": packed.clock(x - _origin(review, panel)), **packed.values(y), "kind": curve.kind,
                           "pairs": len(x) < len(curve.x)})  # fmt: skip
        panels.append({"axis": panel.axis, "log": panel.logarithmic, "robust": panel.robust, "curves": curves,
                       "span": list(_span(review, panel)), "origin": _origin(review, panel)})  # fmt: skip
    document: dict[str, object] = {"panels": panels}
    if review.plan is not None:
        kept, (x0, y0, scale) = _plan_path(review.plan), _plan_frame(review.plan)
        values = np.stack([kept[0] - review.span[0], (kept[2] - x0) * scale, (y0 - kept[1]) * scale])
        document["plan"] = [_base64(np.ascontiguousarray(one).astype("<f4")) for one in values]
    document["events"] = [[e.kind, e.start, e.stop, e.label] for e in review.events]
    document["clocks"] = packed.clocks
    return json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _origin(review: Review, panel: Panel) -> float:
    """What is taken off an abscissa so that single precision holds it."""
    return 0.0 if panel.axis == "frequency" else review.span[0]


def _span(review: Review, panel: Panel) -> tuple[float, float]:
    """What an axis shows at first."""
    if panel.axis != "frequency":
        return review.span
    same = [other for other in review.panels if other.axis == "frequency"]
    return (min(float(c.x[0]) for p in same for c in p.curves), max(float(c.x[-1]) for p in same for c in p.curves))


# ---- drawings


def _panel(review: Review, panel: Panel, number: int) -> str:
    x_span, y_span = _span(review, panel), values_span(panel)
    along, up = _scale(x_span, WIDTH), _scale(y_span, HEIGHT, down=True)
    marks = [e for e in review.events if e.kind in _MARKED] if panel.axis != "frequency" else []
    y_ticks = decades(*y_span, 6) if panel.logarithmic else ticks(*y_span, 5)
    x_ticks = decades(*x_span, 6) if panel.logarithmic else ticks(*x_span, 6)
    lines = "".join(f'<path class="grid" d="M0 {_n(float(up(v)))}H{_n(WIDTH)}"/>' for v, _ in y_ticks)
    bands = "".join(_band(e, along, HEIGHT) for e in marks)
    paths = "".join(
        f'<path class="{curve.kind} c{curve.colour}" d="{_path(curve, along, up)}"/>' for curve in panel.curves
    )
    unit = f" <i>{escape(panel.unit)}</i>" if panel.unit else ""
    note = f'<p class="note">{escape(panel.note)}</p>' if panel.note else ""
    return (
        f'<figure class="panel" data-panel="{number}"><figcaption><b>{escape(panel.title)}</b>{unit} '
        f'<span class="keys">{_keys(panel)}</span></figcaption>'
        f'<div class="plot"><div class="ys" aria-hidden="true">{_labels(y_ticks, up, HEIGHT, "top")}</div>'
        f'<svg class="area" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(described(panel, x_span))}"><g class="bands">{bands}</g><g class="lines">{lines}</g>'
        f"{paths}</svg></div>"
        f'<div class="xs" aria-hidden="true">{_labels(x_ticks, along, WIDTH, "left")}'
        f'<span class="unit">{_AXES[panel.axis]}</span></div>{note}</figure>'
    )


def _keys(panel: Panel) -> str:
    """The legend; a script puts values beside the names."""
    keys = [
        f'<span class="key" data-curve="{k}"><i class="{c.kind} c{c.colour}"></i>{escape(c.name)}</span>'
        for k, c in enumerate(panel.curves)
        if c.kind != BOUND
    ]
    bounds = any(c.kind == BOUND for c in panel.curves)
    return " ".join([*keys, *(['<span class="key"><i class="bound c4"></i>95 % bounds</span>'] if bounds else [])])


def described(panel: Panel, x_span: tuple[float, float]) -> str:
    """A panel in words, for those who do not see it."""
    unit = f" in {panel.unit}" if panel.unit else ""
    if panel.logarithmic:
        low, high = (10.0**v for v in x_span)
        parts = [
            f"{c.name} highest {10.0 ** float(np.max(c.y)):.3g} at {10.0 ** float(c.x[int(np.argmax(c.y))]):.3g} Hz"
            for c in panel.curves
        ]
        return f"{panel.title}{unit}, {low:.3g} to {high:.3g} Hz: {', '.join(parts)}"
    parts = [
        f"{c.name} {float(np.nanmin(c.y)):.4g} to {float(np.nanmax(c.y)):.4g}"
        for c in panel.curves
        if c.kind != BOUND and np.any(np.isfinite(c.y))
    ]
    over = f"{x_span[0]:.4g} to {x_span[1]:.4g} {_AXES[panel.axis]}".rstrip()
    return f"{panel.title}{unit} over {panel.axis} {over}: {', '.join(parts)}"


def values_span(panel: Panel) -> tuple[float, float]:
    """Lowest and highest value of the first view, with some room."""
    values = _finite(c for c in panel.curves)
    if not len(values):
        return 0.0, 1.0
    low, high = float(np.min(values)), float(np.max(values))
    if panel.robust:
        bounds, others = (_finite(c for c in panel.curves if (c.kind == BOUND) == which) for which in (True, False))
        reach = _ROOM * float(np.quantile(np.abs(others), _INSIDE)) if len(others) else 0.0
        reach = max(reach, _ROOM * float(np.median(np.abs(bounds)))) if len(bounds) else reach
        low, high = max(low, -reach), min(high, reach)
    if not high > low:
        room = abs(high) * 0.1 or 1.0
        return low - room, high + room
    return low - _MARGIN * (high - low), high + _MARGIN * (high - low)


def _finite(curves: Iterable[Curve]) -> FloatArray:
    """All values of curves that are numbers."""
    return np.concatenate([np.zeros(0), *(c.y[np.isfinite(c.y)] for c in curves)])


def _path(curve: Curve, along: _Scale, up: _Scale) -> str:
    """The line of a curve; of dots, a point each."""
    x, y = thinned(curve.x, curve.y, _DRAWN)
    u, v = along(x), np.clip(up(y), -HEIGHT, 2.0 * HEIGHT)
    good = np.isfinite(v)
    if curve.kind == DOTS and len(x) < len(curve.x):  # too many for single ones: from the least to the largest
        pairs = list(_rounded(u, v))
        return "".join(f"M{a} {b}V{c}" for (a, b), (_, c) in zip(pairs[::2], pairs[1::2], strict=False))
    if curve.kind == DOTS:
        return "".join(f"M{a} {b}h0" for a, b in _rounded(u[good], v[good]))
    starts = good & ~np.concatenate([[False], good[:-1]])
    parts = []
    for begins, (a, b) in zip(starts[good].tolist(), _rounded(u[good], v[good]), strict=True):
        parts.append(f"M{a} {b}" if begins else f"L{a} {b}")
    return "".join(parts)


def _rounded(u: FloatArray, v: FloatArray) -> Iterator[tuple[str, str]]:
    return zip(map(_n, u.tolist()), map(_n, v.tolist()), strict=True)


def _n(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


class _Scale:
    """From values to a drawing's units."""

    def __init__(self, span: tuple[float, float], size: float, down: bool = False) -> None:
        self._low, self._factor, self._down, self._size = span[0], size / (span[1] - span[0]), down, size

    def __call__(self, value: FloatArray | float) -> FloatArray:
        scaled = (np.asarray(value, dtype=np.float64) - self._low) * self._factor
        return self._size - scaled if self._down else scaled


def _scale(span: tuple[float, float], size: float, down: bool = False) -> _Scale:
    return _Scale(span, size, down)


def _labels(at: Sequence[tuple[float, str]], scale: _Scale, size: float, edge: str) -> str:
    return "".join(
        f'<span style="{edge}:{_n(100.0 * float(scale(value)) / size)}%">{text}</span>'
        for value, text in at
        if -1e-9 <= float(scale(value)) / size <= (_ENDS if edge == "left" else 1.0 + 1e-9)
    )


def ticks(low: float, high: float, about: int) -> list[tuple[float, str]]:
    """Round values within a span, about so many, and how they are written: 1, 2 or 5 and zeros apart."""
    rough = (high - low) / about
    power = 10.0 ** floor(log10(rough))
    step = next(k for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough * 0.999) * power
    first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
    values = [k * step for k in range(first, last + 1)]
    digits = max(0, -floor(log10(step) + 1e-9))
    large = max(map(abs, values), default=0.0)
    if digits > 4 or large >= 1e5:
        return [(v, _minus(f"{v:.3g}")) for v in values]
    return [(v, _minus(f"{v:.{digits}f}")) for v in values]


def decades(low: float, high: float, about: int) -> list[tuple[float, str]]:
    """The same of logarithms: powers of ten, and where there are few, 2 and 5 times those."""
    span = high - low
    if span > about:
        every = ceil(span / about)
        whole = [float(k) for k in range(ceil(low), floor(high) + 1) if k % every == 0]
    else:
        parts = (0.0, log10(2.0), log10(5.0)) if 3.0 * span <= about + 1.0 else (0.0,)
        whole = [k + part for k in range(floor(low), floor(high) + 1) for part in parts]
    return [(v, f"{10.0**v:.0e}".replace("e-0", "e-") if v < -3.0 else f"{10.0**v:.3g}")
            for v in whole if low - 1e-9 <= v <= high + 1e-9]  # fmt: skip


def _minus(text: str) -> str:
    return text.replace("-", "−")


# ---- events


def _band(event: Event, along: _Scale, height: float) -> str:
    kind = _class(event.kind)
    a, b = float(along(event.start)), float(along(event.stop))
    return f'<path class="{kind}" d="M{_n(a)} 0H{_n(max(b, a))}V{_n(height)}H{_n(a)}Z"/>'


def _class(kind: str) -> str:
    return f"e-{kind.split(',')[0]}"


def _events(review: Review) -> str:
    """A row a kind, on the axis of the panels; and a table."""
    along = _scale(review.span, WIDTH)
    kinds = list(dict.fromkeys(event.kind for event in review.events))
    rows = "".join(_row(kind, [e for e in review.events if e.kind == kind], along) for kind in kinds)
    x_ticks = ticks(*review.span, 6)
    return (
        '<figure class="panel events"><figcaption><b>Events</b> <output></output></figcaption>'
        f"{rows}"
        f'<div class="xs" aria-hidden="true">{_labels(x_ticks, along, WIDTH, "left")}'
        f'<span class="unit">{_AXES[review.axis]}</span></div></figure>{_events_table(review)}'
    )


def _row(kind: str, events: Sequence[Event], along: _Scale) -> str:
    bands = "".join(_band(e, along, 10.0) for e in events)
    names = ""
    if kind in ("mode", "stretches", "found"):
        for e in events:
            a, b = (float(np.clip(along(one), 0.0, WIDTH)) / 10.0 for one in (e.start, e.stop))
            names += f'<span style="left:{_n(a)}%;width:{_n(max(b - a, 0.0))}%">{escape(e.label)}</span>'
    said = f"{kind}: {counted(len(events), 'time')}"
    return (
        f'<div class="row"><span class="kind">{escape(kind)}</span><div class="plot"><div class="ys"></div>'
        f'<svg class="area" viewBox="0 0 {WIDTH:g} 10" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(said)}"><g class="bands">{bands}</g></svg>'
        f'<div class="names" aria-hidden="true">{names}</div></div></div>'
    )


def _events_table(review: Review) -> str:
    single = [e for e in review.events if e.kind != "refused"]
    refused: dict[str, list[Event]] = {}
    for e in review.events:
        if e.kind == "refused":
            refused.setdefault(e.label, []).append(e)
    rows = [(e.start, e.stop, e.label if e.kind != "mode" else f"mode: {e.label}") for e in single]
    rows += [(es[0].start, es[-1].stop, f"{es[0].label}: {counted(len(es), 'time')}") for es in refused.values()]
    rows.sort()
    cells = "".join(
        f'<tr><td class="n">{a:.2f}</td><td class="n">{"-" if b == a else f"{b:.2f}"}</td><td>{escape(text)}</td></tr>'
        for a, b, text in rows[:_TOLD]
    )
    more = f'<p class="note">And {counted(len(rows) - _TOLD, "more event")}.</p>' if len(rows) > _TOLD else ""
    return (
        f"<details><summary>{counted(len(rows), 'event')} in words</summary>"
        '<div class="wide"><table><thead><tr><th scope="col" class="n">from / s</th>'
        '<th scope="col" class="n">to / s</th>'
        f'<th scope="col">what</th></tr></thead><tbody>{cells}</tbody></table></div>{more}</details>'
    )


# ---- plan


def _plan_path(plan: Plan) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Every so many-th instant."""
    step = max(1, len(plan.t) // _PLAN_POINTS)
    return plan.t[::step], plan.north[::step], plan.east[::step]


def _plan_bounds(plan: Plan) -> tuple[float, float, float, float]:
    """Least and largest east and north, no side less than a third of the other."""
    points = [np.stack([plan.north, plan.east], axis=1), plan.fixes, plan.compared]
    every = np.concatenate([one[np.all(np.isfinite(one), axis=1)] for one in points if len(one)])
    middle = 0.5 * (np.min(every, axis=0) + np.max(every, axis=0))
    half = 0.54 * np.maximum(np.ptp(every, axis=0), 0.5)
    half = np.maximum(half, np.max(half) / 3.0)
    return middle[1] - half[1], middle[1] + half[1], middle[0] - half[0], middle[0] + half[0]


def _plan_frame(plan: Plan) -> tuple[float, float, float]:
    """Left, top, and the drawing's units a metre."""
    left, right, _, top = _plan_bounds(plan)
    return left, top, WIDTH / (right - left)


def _plan(plan: Plan) -> str:
    left, right, bottom, top = _plan_bounds(plan)
    tall = WIDTH * (top - bottom) / (right - left)
    along, up = _scale((left, right), WIDTH), _scale((bottom, top), tall, down=True)
    _, north, east = _plan_path(plan)
    good = np.isfinite(north)
    starts = (good & ~np.concatenate([[False], good[:-1]]))[good].tolist()
    pairs = list(_rounded(along(east[good]), up(north[good])))
    line = "".join(f"{'M' if s else 'L'}{a} {b}" for s, (a, b) in zip(starts, pairs, strict=True))
    step = max(1, len(plan.fixes) // 1500)
    dots = "".join(f"M{a} {b}h0" for a, b in _rounded(along(plan.fixes[::step, 1]), up(plan.fixes[::step, 0])))
    step = max(1, len(plan.compared) // _PLAN_POINTS)
    compared = "L".join(f"{a} {b}" for a, b in _rounded(along(plan.compared[::step, 1]), up(plan.compared[::step, 0])))
    about = 5 if tall <= WIDTH else 4
    x_ticks, y_ticks = ticks(left, right, about), ticks(bottom, top, max(3, round(about * tall / WIDTH)))
    grid = "".join(f'<path class="grid" d="M{_n(float(along(v)))} 0V{_n(tall)}"/>' for v, _ in x_ticks)
    grid += "".join(f'<path class="grid" d="M0 {_n(float(up(v)))}H{WIDTH:g}"/>' for v, _ in y_ticks)
    ends = f'<circle class="start" cx="{pairs[0][0]}" cy="{pairs[0][1]}" r="9"/>' if pairs else ""
    ends += f'<path class="stop" d="M{pairs[-1][0]} {pairs[-1][1]}m-8 -8h16v16h-16z"/>' if pairs else ""
    keys = '<span class="key"><i class="line c0"></i>filter</span>'
    keys += '<span class="key"><i class="dots c1"></i>GPS</span>' if len(plan.fixes) else ""
    keys += f'<span class="key"><i class="compared c5"></i>{escape(plan.reference)}</span>' if compared else ""
    said = f"Path from above: {right - left:.3g} m from west to east, {top - bottom:.3g} m from south to north"
    return (
        '<figure class="panel plan"><figcaption><b>Path from above</b> <i>m, north is up</i> '
        f'<span class="keys">{keys} '
        '<span class="key"><i class="ring"></i>begins</span> <span class="key"><i class="square"></i>ends</span></span>'
        f'</figcaption><div class="frame" style="max-width:{_n(min(36.0, 26.0 * WIDTH / tall))}rem"><div class="plot">'
        f'<div class="ys" aria-hidden="true">{_labels(y_ticks, up, tall, "top")}</div>'
        f'<svg class="area" viewBox="0 0 {WIDTH:g} {_n(tall)}" role="img" aria-label="{escape(said)}">{grid}'
        f'<path class="compared c5" d="{"M" + compared if compared else ""}"/><path class="dots c1" d="{dots}"/>'
        f'<path class="line c0" d="{line}"/><path class="line zoomed" d=""/>{ends}'
        '<circle class="here" r="0"/></svg></div>'
        f'<div class="xs" aria-hidden="true">{_labels(x_ticks, along, WIDTH, "left")}<span class="unit">m</span></div>'
        "</div></figure>"
    )
