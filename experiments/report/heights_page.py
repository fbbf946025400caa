"""The page of heights: the courses, their differences from the filter, where the sonar failed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.experiments.heights import Heights
from sinan.experiments.report.figures import AFTER, BEFORE, CHANCE, SOFT, new_figure
from sinan.experiments.report.heights_words import causes, difference_words
from sinan.experiments.report.page import Page
from sinan.experiments.report.words import SENSORS

_COLOURS = {"sonar": BEFORE, "laser": "#6b8f3a", "baro": "#7a5195", "gps": CHANCE}


def heights_page(path: Path, name: str, found: Heights, document: Mapping[str, Any]) -> None:
    """Write the page."""
    names = ", ".join(SENSORS.get(sensor, sensor) for sensor in found.courses)
    page = Page(f"{name}: heights", f"Heights of {names}" + (" against the filter's." if found.motion else "."))
    if found.motion is None:
        page.text("There is no IMU: ranges are taken as heights, and there is no filter to compare with.")
    page.figure(
        courses(found),
        "Heights with the tilt taken out; of barometer and GPS less their median difference from the filter. "
        "Black: the smoothed height; grey stretches: the sonar has no echo; crosses: its echo is wrong.",
    )
    rows = [
        [f"{SENSORS.get(sensor, sensor)} less filter", difference_words(one["against_filter"])]
        for sensor, one in document["sensors"].items()
        if one["against_filter"]
    ]
    for pair in document["pairs"]:
        a, b = (SENSORS.get(sensor, sensor) for sensor in pair["sensors"])
        rows.append([f"{a} less {b}", difference_words(pair)])
    page.table(["", "median, robust scatter, slope"], rows)
    page.text("A slope off one is a wrong speed of sound, scale or lapse; `sinan trace` names it.", note=True)
    if found.motion is not None:
        page.heading("Less the filter's height")
        page.figure(differences(found), "Each sensor's height less the filter's, its median taken off.")
    if document["sonar"] is not None:
        page.heading("Where the sonar failed")
        failures = document["sonar"]["failures"]
        if not failures:
            page.text("Every echo came back, and none is wrong.")
        else:
            page.table(["what", "echoes"], [[what, str(count)] for what, count in causes(failures).items()], (1,))
            page.text(
                "Beyond its range or beam angle: further off, nearer or more askew than echoes came back from in this "
                "log. Soft target: upright and within range, and nothing came.", note=True,
            )  # fmt: skip
            stretches = [
                [f"{one['from']:.2f}", f"{one['to']:.2f}", str(one["readings"]), one["kind"], one["cause"]]
                for one in failures
            ]
            with page.folded(f"{len(stretches)} stretches"):
                page.table(["from / s", "to / s", "echoes", "echo", "cause"], stretches, (0, 1, 2))
    page.write(path)


def courses(found: Heights) -> Figure:
    """All heights over time."""
    figure, axes = new_figure(1, 1, 4.0)
    one = axes[0, 0]
    begin = min(float(course.t[0]) for course in found.courses.values())
    for failure in found.failures:
        if failure.kind == "none":
            one.axvspan(failure.start - begin, failure.stop - begin, color="#d9e0e7", lw=0.6)
    for name, course in found.courses.items():
        shift = course.against_filter[0] if course.against_filter and name in ("baro", "gps") else 0.0
        height = course.height - shift
        label, used = SENSORS.get(name, name), course.used
        one.plot(course.t[used] - begin, height[used], ".", ms=2.5, color=_COLOURS[name], label=label, alpha=0.7)
        one.plot(course.t[~used] - begin, height[~used], "x", ms=4, color=_COLOURS[name])
    if found.motion is not None:
        step = max(1, len(found.motion) // 4000)
        one.plot(found.motion.t[::step] - begin, found.motion.height[::step], color="black", lw=0.9, label="filter")
    shown = np.concatenate([c.height[c.used] - (c.against_filter or (0.0,))[0] for c in found.courses.values()])
    low, high = np.quantile(shown, [0.001, 0.999])
    one.set_ylim(low - 0.1 * (high - low) - 0.1, high + 0.1 * (high - low) + 0.1)
    one.set_xlabel("time / s", fontsize=9)
    one.set_ylabel("height / m", fontsize=9)
    one.legend(frameon=False, fontsize=9, ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.1))
    return figure


def differences(found: Heights) -> Figure:
    """A panel a sensor."""
    figure, axes = new_figure(len(found.courses), 1, 1.5, sharex=True)
    begin = min(float(course.t[0]) for course in found.courses.values())
    for one, (name, course) in zip(axes[:, 0], found.courses.items(), strict=True):
        compared = course.against_filter
        assert compared is not None
        off = course.height - course.filtered - compared[0]
        one.axhline(0.0, color=SOFT, lw=0.8)
        one.plot(course.t[course.used] - begin, off[course.used], ".", ms=2, color=AFTER)
        one.plot(course.t[~course.used] - begin, off[~course.used], "x", ms=4, color=BEFORE)
        reach = 6.0 * max(compared[1], 0.01)
        one.set_ylim(-reach, reach)
        one.set_title(f"{SENSORS.get(name, name)} / m", loc="left", fontsize=9)
    axes[-1, 0].set_xlabel("time / s", fontsize=9)
    return figure
