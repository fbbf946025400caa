"""Heights against each other in words: a line a comparison, then the sonar's failures."""

from __future__ import annotations

from typing import Any

import numpy as np

from sinan.experiments.report.words import SENSORS, counted

#: Failures that the summary names; the JSON has all.
_MOST = 8


def summary(document: dict[str, Any]) -> str:
    """A line a comparison, then the sonar's failures."""
    lines = [f"{document['called']}: heights of " + ", ".join(SENSORS.get(name, name) for name in document["sensors"])]
    if not document["tilt_compensated"]:
        lines.append("  no IMU: ranges are taken as heights, and there is no filter to compare with")
    for name, one in document["sensors"].items():
        if one["against_filter"]:
            lines.append(f"  {SENSORS.get(name, name)} less filter: {difference_words(one['against_filter'])}")
    for pair in document["pairs"]:
        a, b = (SENSORS.get(name, name) for name in pair["sensors"])
        lines.append(f"  {a} less {b}: {difference_words(pair)}")
    if document["sonar"] is not None:
        lines += _sonar_lines(document["sonar"])
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
