"""The page of a log at rest: Allan deviation of every channel with its fit, the terms, what to declare."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from sinan.calibration.levels.rest import ChannelNoise, Rest
from sinan.experiments.report.allan_words import TERMS, term_words
from sinan.experiments.report.figures import AFTER, BEFORE, SOFT, axis_label, new_figure
from sinan.experiments.report.page import Page
from sinan.experiments.report.words import SENSORS

_COLOURS = (AFTER, BEFORE, "#6b8f3a")


def allan_page(path: Path, name: str, rest: Rest, document: Mapping[str, Any]) -> None:
    """Write the page."""
    length = rest.stop - rest.start
    page = Page(
        f"{name}: noise at rest",
        f"{length:.4g} s at rest"
        + (f", found by {rest.found}." if rest.found else "; no IMU tells whether it was, all of the log is taken."),
    )
    page.text(
        "N is white noise, B the flicker floor (bias instability), w the random walk of the bias, R a steady ramp: "
        "σ^2(τ) = N^2 / τ + 0.441 B^2 + w^2 τ / 3 + R^2 τ^2 / 2. A reading at rate f has the standard deviation N √f. "
        "N is two-sided; the density of data sheets is one-sided, √2 times as large."
    )
    for sensor in rest.sensors:
        channels = rest.of(sensor)
        page.heading(SENSORS.get(sensor, sensor).capitalize() if sensor != "gps" else "GPS")
        page.figure(
            curves(channels),
            "Overlapping Allan deviation with its 95 % interval, and the fit; grey: averaging times that a filter in "
            "the sensor or the rounding has changed, not fitted.",
        )
        own = [one for one in document["channels"] if one["sensor"] == sensor]
        rows = [
            [
                one["channel"] or sensor,
                *(term_words(one["terms"][key]) for key, _ in TERMS),
                f"{one['fitted_from']:.3g}",
            ]
            for one in own
        ]
        unit = channels[0].unit
        head = ["", *(f"{letter} / {unit}{of}" for letter, (_, of) in zip("NBwR", TERMS, strict=True)), "from τ / s"]
        page.table(head, rows, (1, 2, 3, 4, 5))
    for sensor, why in rest.left_out.items():
        page.text(f"Left out: {SENSORS.get(sensor, sensor)}, {why}.", note=True)
    page.heading("To declare")
    page.text(
        "Into `recording.toml`, or `[sensors]` of a map; root mean square over the axes. Where no walk is seen "
        "none is given: minutes show noise, a bias's walk takes an hour. A receiver's noise at rest is not given "
        "either: it smooths its fixes, and its errors take hours to come and go.", note=True,
    )  # fmt: skip
    rows = [
        [f"[sensors.{s}]", key, f"{v:.3g}"] for s, keys in document["recording_toml"].items() for key, v in keys.items()
    ]
    page.table(["table", "key", "value"], rows, (2,))
    page.write(path)


def curves(channels: tuple[ChannelNoise, ...]) -> Figure:
    """Every channel of a sensor on logarithmic axes."""
    figure, axes = new_figure(1, 1, 3.6)
    one = axes[0, 0]
    for channel, colour in zip(channels, _COLOURS, strict=False):
        fit, first = channel.fit, channel.fit.first
        for rows, ink in ((slice(None, first), SOFT), (slice(first, None), colour)):
            tau, deviation = fit.tau[rows], fit.deviation[rows]
            span = [deviation - channel.low[rows], channel.high[rows] - deviation]
            one.errorbar(tau, deviation, span, fmt="o", ms=3.5, lw=0.9, color=ink, capsize=2)
        one.plot(
            fit.tau[first:], fit.at(fit.tau[first:]), color=colour, lw=1.4, label=channel.channel or channel.sensor
        )
    one.set_xscale("log")
    one.set_yscale("log")
    one.set_xlabel("averaging time τ / s", fontsize=9)
    one.set_ylabel(axis_label("Allan deviation", channels[0].unit), fontsize=9)
    one.grid(True, which="both", color="#e8eef3", lw=0.6)
    one.legend(frameon=False, fontsize=9)
    return figure
