"""Rates over many graded recordings, each with its Clopper-Pearson interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from sinan.experiments.blind.grade import SIGMAS, Grade

#: What is asked of the tracer, in the words of the report.
ONE, SEVERAL, CLASS, ONE_JOINTLY, SEVERAL_JOINTLY, WRONG, ALARM, OUTSIDE, BETA, HELD_OUT, TIME = (
    "right effect alone, one hidden, detectable",
    "right effects alone, two or three hidden, detectable",
    "right within the class",
    "right effect alone, one hidden, other candidates not projected out",
    "right effects alone, two or three hidden, only those projected out",
    "wrong name",
    "named where there is none",
    "outside the catalogue: unexplained, or a true local name",
    "beta inside 3 sigma",
    "held-out error over that of the model that knew: 90 % below",
    "CPU seconds a minute of recording: 90 % below",
)
#: A disturbance outside the catalogue counts where its mark in the plain readings has this chi-square: a tenth of it
#: would be ten times what makes an effect of the catalogue detectable.
STRONG = 3000.0


def clopper_pearson(k: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a rate from k of n.

    Source: C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404.
    """
    from scipy.stats import beta

    tail = 0.5 * (1.0 - level)
    low = 0.0 if k == 0 else float(beta.ppf(tail, k, n - k + 1))
    high = 1.0 if k == n else float(beta.ppf(1.0 - tail, k + 1, n - k))
    return low, high


def table(grades: Sequence[Grade]) -> dict[str, dict[str, Any]]:
    """The rates by world: {"declared": {what is asked: {"k", "n", "rate", "interval"} or {"value", "n"}}}."""
    return {
        world: _of_world([g for g in grades if g.world == world])
        for world in ("declared", "rough")
        if any(g.world == world for g in grades)
    }


def _of_world(grades: Sequence[Grade]) -> dict[str, Any]:
    hidden = [g for g in grades if g.what in ("one", "several")]
    of_class = [g for g in hidden if g.class_detectable]
    joint = [g for g in hidden if g.jointly_detectable]
    z = [abs(z) for g in joint for z in g.z]
    ratios = [g.held_out_ratio for g in joint if np.isfinite(g.held_out_ratio)]
    pace = [60.0 * g.seconds / g.duration for g in grades if g.kind in ("flight", "hand")]
    outside = [g for g in grades if g.what == "outside" and g.strength > STRONG]
    return {
        ONE: _rate([g for g in hidden if g.detectable and g.what == "one"], right),
        SEVERAL: _rate([g for g in hidden if g.detectable and g.what == "several"], right),
        CLASS: _rate(of_class, lambda g: not g.wrong_outside_class and not g.missing_outside_class),
        ONE_JOINTLY: _rate([g for g in joint if g.what == "one"], right),
        SEVERAL_JOINTLY: _rate([g for g in joint if g.what == "several"], right),
        WRONG: _rate(hidden, lambda g: bool(g.wrong_outside_class)),
        ALARM: _rate([g for g in grades if g.what == "none"], lambda g: bool(g.wrong)),
        OUTSIDE: _rate(outside, lambda g: g.verdict == "unexplained" or (bool(g.named) and not g.wrong)),
        BETA: count(sum(value < SIGMAS for value in z), len(z)),
        HELD_OUT: {"value": float(np.quantile(ratios, 0.9)) if ratios else None, "n": len(ratios)},
        TIME: {"value": float(np.quantile(pace, 0.9)) if pace else None, "n": len(pace)},
    }


def right(g: Grade) -> bool:
    """Exactly the hidden names."""
    return not g.wrong and not g.missing


def _rate(grades: Sequence[Grade], holds: Callable[[Grade], bool]) -> dict[str, Any]:
    return count(sum(holds(g) for g in grades), len(grades))


def count(k: int, n: int) -> dict[str, Any]:
    """k of n as a rate with its interval."""
    if n == 0:
        return {"k": 0, "n": 0, "rate": None, "interval": None}
    return {"k": int(k), "n": n, "rate": k / n, "interval": list(clopper_pearson(int(k), n))}


def as_json(grades: Sequence[Grade]) -> dict[str, Any]:
    """Rates and every grade; NaN is null."""
    rows = []
    for g in grades:
        row = asdict(g)
        rows.append({k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in row.items()})
    return {"format": 1, "recordings": len(grades), "rates": table(grades), "grades": rows}


def text(rates: dict[str, dict[str, Any]]) -> str:
    """The table for the terminal."""
    names = {"declared": "as declared", "rough": "rough"}
    lines = []
    for world, asked in rates.items():
        lines.append(f"world {names[world]}")
        lines += [f"  {what:66} {shown(entry)}" for what, entry in asked.items()]
    return "\n".join(lines)


def shown(entry: dict[str, Any]) -> str:
    """One rate or value in words."""
    if "value" in entry:
        return "-" if entry["value"] is None else f"{entry['value']:.3g}  (of {entry['n']})"
    if entry["rate"] is None:
        return "-"
    low, high = entry["interval"]
    return f"{entry['k']} of {entry['n']}, {100 * entry['rate']:.1f} %  [{100 * low:.1f}, {100 * high:.1f}]"
