"""What is drawn over a common axis: curves with their peaks kept, panels of them, events, and a path on a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinan.sensors.arrays import FloatArray

#: A step of a clock that is so many times its median, and this share of the log, breaks a curve.
_BREAK, _BREAK_SHARE = 5.0, 0.002
#: Kinds of lines: what was estimated or read; what it is compared with; the bounds it should stay within; readings.
LINE, COMPARED, BOUND, DOTS = "line", "compared", "bound", "dots"


@dataclass(frozen=True)
class Curve:
    """A quantity over an axis.

    Attributes
    ----------
    name : in the legend; that of a bound is not shown
    x, y : (n,) rising abscissa, and values in the unit of the panel; NaN breaks the line
    kind : LINE, COMPARED, BOUND or DOTS
    colour : number of its colour: components of one vector have 0, 1, 2 in every panel
    """

    name: str
    x: FloatArray
    y: FloatArray
    kind: str = LINE
    colour: int = 0


@dataclass(frozen=True)
class Panel:
    """Curves of one unit.

    Attributes
    ----------
    title, unit : what is shown, in which unit
    curves : drawn in this order
    axis : "time", "reading" or "frequency": panels of one axis are zoomed together
    note : a sentence beneath; empty: none
    logarithmic : both axes are decades, x and y are log10 of what they stand for
    robust : a few values far outside are not in the first view
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    axis: str = "time"
    note: str = ""
    logarithmic: bool = False
    robust: bool = False


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes
    ----------
    kind : the row that it is in, such as "armed"
    start, stop : s; equal for an instant
    label : in words
    """

    kind: str
    start: float
    stop: float
    label: str


@dataclass(frozen=True)
class Plan:
    """A path as it is seen from above.

    Attributes
    ----------
    t, north, east : (n,) s, m, m of the estimate; NaN where it is interrupted
    fixes : (k, 2) north and east of the readings of position [m]
    compared : (j, 2) the same of a reference, or empty
    reference : what that is, in words
    """

    t: FloatArray
    north: FloatArray
    east: FloatArray
    fixes: FloatArray
    compared: FloatArray
    reference: str = ""


@dataclass(frozen=True)
class Section:
    """Panels under one heading."""

    title: str
    panels: tuple[Panel, ...]
    note: str = ""


@dataclass(frozen=True)
class Review:
    """All that is drawn of a log.

    Attributes
    ----------
    span : first and last instant [s], or number of the reading
    axis : "time" or "reading"
    """

    span: tuple[float, float]
    sections: tuple[Section, ...]
    events: tuple[Event, ...] = ()
    plan: Plan | None = None
    axis: str = "time"

    @property
    def panels(self) -> tuple[Panel, ...]:
        """Of all sections."""
        return tuple(panel for section in self.sections for panel in section.panels)

    def counted_from(self, zero: float) -> Review:
        """The same with `zero` [s] as the origin of time."""
        if self.axis != "time" or not zero:
            return self
        plan = None if self.plan is None else replace(self.plan, t=self.plan.t - zero)
        events = tuple(replace(one, start=one.start - zero, stop=one.stop - zero) for one in self.events)
        sections = tuple(replace(one, panels=tuple(_later(p, zero) for p in one.panels)) for one in self.sections)
        return replace(self, span=(self.span[0] - zero, self.span[1] - zero), sections=sections, events=events,
                       plan=plan)  # fmt: skip


def _later(panel: Panel, zero: float) -> Panel:
    curves = tuple(replace(curve, x=curve.x - zero) for curve in panel.curves)
    return replace(panel, curves=curves) if panel.axis == "time" else panel


def broken(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A curve with NaN in every gap of its clock, so that no line is drawn across it."""
    if len(x) < 3:
        return x, y
    step = np.diff(x)
    after = np.flatnonzero(step > max(_BREAK * float(np.median(step)), _BREAK_SHARE * float(x[-1] - x[0]))) + 1
    if 3 * len(after) > len(x):  # readings that come in bursts, or single ones
        return x, y
    return np.insert(x, after, x[after - 1]), np.insert(y, after, np.nan)


def thinned(x: FloatArray, y: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """A curve of at most about 2 `most` points that has every peak: the least and the largest value of each piece, in
    the order in which they come. Pieces have equally many points and do not reach across a NaN.
    """
    n = len(x)
    if n <= 2 * most:
        return x, y
    gone = np.flatnonzero(np.isnan(y))
    even = np.linspace(0, n, most, endpoint=False).astype(np.int64)
    first = np.unique(np.concatenate([even, gone, np.minimum(gone + 1, n - 1)]))
    size = np.diff(np.append(first, n))
    low, high = np.fmin.reduceat(y, first), np.fmax.reduceat(y, first)
    piece = np.repeat(np.arange(len(first)), size)
    at = np.arange(n)
    at_low = np.minimum.reduceat(np.where(y == low[piece], at, n), first)
    at_high = np.minimum.reduceat(np.where(y == high[piece], at, n), first)
    falls = at_high < at_low
    values = np.stack([np.where(falls, high, low), np.where(falls, low, high)], axis=1)
    stamps = np.stack([x[first], x[first + size // 2]], axis=1)
    keep = np.stack([np.ones(len(first), dtype=bool), size > 1], axis=1)
    return stamps[keep], values[keep]


def vector_curves(
    t: FloatArray, values: FloatArray, names: Sequence[str], kind: str = LINE, note: str = ""
) -> tuple[Curve, ...]:
    """A curve for each component.

    Parameters
    ----------
    values : (n, k)
    names : k, of the components
    note : before each name
    """
    found = []
    for k, name in enumerate(names):
        x, y = (t, values[:, k]) if kind == DOTS else broken(t, values[:, k])
        found.append(Curve(f"{note}{name}", x, y, kind, k))
    return tuple(found)
