"""`sinan heights`: heights of sonar, laser, barometer and GPS against each other and the filter: text, JSON, a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sinan.experiments.datasets import called, resolve
from sinan.experiments.heights import Heights, SonarFailure, heights_of
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.experiments.report.words import SENSORS, counted
from sinan.sensors.arrays import finite_or_none
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span, start_of

#: Failures that the summary names; the JSON has all.
_MOST = 8


def run(
    input: str, map_file: Path | None, json: Path | None, html: Path | None, span: Span = WHOLE, choice: Choice = FIRST
) -> str:
    """Compare, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    with working("running the filter", flies=True):
        found = heights_of(recording)
    told = as_json(found, start_of(recording))
    told["called"] = called(input, recording, span)
    if json is not None:
        write_json(json, told)
    if html is not None:
        from sinan.experiments.report.heights_page import heights_page

        heights_page(html, told["called"], found, told)
    return summary(told)


def as_json(found: Heights, begin: float = 0.0) -> dict[str, Any]:
    """Differences and failures; times from the recording's start.

    Parameters
    ----------
    begin : what the recording's clock shows at its start [s]
    """

    def three(values: tuple[float, float, float] | None) -> dict[str, float | None] | None:
        names = ("offset", "scatter", "slope")
        return None if values is None else {n: finite_or_none(v) for n, v in zip(names, values, strict=True)}

    sonar = None
    if "sonar" in found.courses:
        low, high, tilt = (finite_or_none(value) for value in found.heard)
        sonar = {
            "readings": len(found.courses["sonar"].t),
            "heard": {"from": low, "to": high, "tilt": tilt},
            "failures": [_failure(failure, begin) for failure in found.failures],
        }
    return {
        "format": 1,
        "tilt_compensated": found.motion is not None,
        "sensors": {
            name: {"readings": len(course.t), "against_filter": three(course.against_filter)}
            for name, course in found.courses.items()
        },
        "pairs": [{"sensors": list(pair), **(three(values) or {})} for pair, values in found.pairs.items()],
        "sonar": sonar,
    }


def _failure(failure: SonarFailure, begin: float) -> dict[str, Any]:
    return {
        "from": failure.start - begin,
        "to": failure.stop - begin,
        "readings": failure.lost,
        "kind": failure.kind,
        "cause": failure.cause,
    }


def summary(told: dict[str, Any]) -> str:
    """A line a comparison, then the sonar's failures."""
    lines = [f"{told['called']}: heights of " + ", ".join(SENSORS.get(name, name) for name in told["sensors"])]
    if not told["tilt_compensated"]:
        lines.append("  no IMU: ranges are taken as heights, and there is no filter to compare with")
    for name, one in told["sensors"].items():
        if one["against_filter"]:
            lines.append(f"  {SENSORS.get(name, name)} less filter: {difference_words(one['against_filter'])}")
    for pair in told["pairs"]:
        a, b = (SENSORS.get(name, name) for name in pair["sensors"])
        lines.append(f"  {a} less {b}: {difference_words(pair)}")
    if told["sonar"] is not None:
        lines += _sonar_lines(told["sonar"])
    return "\n".join(lines)


def difference_words(one: dict[str, Any]) -> str:
    """`0.02 m ± 0.03 m, slope 1.00`."""
    slope = "" if one["slope"] is None else f", slope {one['slope']:.3f}"
    return f"{one['offset']:+.3f} m, scatter {one['scatter']:.3f} m{slope}"


def _sonar_lines(sonar: dict[str, Any]) -> list[str]:
    failures = sonar["failures"]
    if not failures:
        return ["  sonar: every echo came back, none is wrong"]
    lost = sum(one["readings"] for one in failures)
    heard = sonar["heard"]
    bounds = "" if heard["from"] is None else f"; heard from {heard['from']:.2g} to {heard['to']:.2g} m"
    bounds += "" if heard["tilt"] is None else f", to {np.rad2deg(heard['tilt']):.0f} deg of tilt"
    lines = [f"  sonar: {counted(lost, 'echo').replace('echos', 'echoes')} missing or wrong{bounds}"]
    for cause, count in causes(failures).items():
        lines.append(f"    {cause}: {count}")
    longest = sorted(failures, key=lambda one: -one["readings"])[:_MOST]
    for one in sorted(longest, key=lambda one: one["from"]):
        what = "no echo" if one["kind"] == "none" else "wrong echo"
        lines.append(f"    {one['from']:.2f} to {one['to']:.2f} s: {what}, {one['readings']}, {one['cause']}")
    return lines


def causes(failures: list[dict[str, Any]]) -> dict[str, int]:
    """Echoes by what took them, most first."""
    counts: dict[str, int] = {}
    for one in failures:
        name = ("no echo, " if one["kind"] == "none" else "wrong echo, ") + one["cause"]
        counts[name] = counts.get(name, 0) + one["readings"]
    return dict(sorted(counts.items(), key=lambda item: -item[1]))
