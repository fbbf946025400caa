"""`sinan allan`: a log at rest -> Allan deviation, noise of each channel, keys to declare, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sinan.calibration.levels.rest import ChannelNoise, Rest, declared, noise_at_rest, walk_bound
from sinan.experiments.datasets import called, resolve
from sinan.experiments.report.allan_words import TERMS, summary
from sinan.experiments.report.console import tell_notes, working
from sinan.experiments.report.files import write_json
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.window import WHOLE, Span, start_of


def run(
    input: str, map_file: Path | None, json: Path | None, html: Path | None, span: Span = WHOLE, choice: Choice = FIRST
) -> str:
    """Find the part at rest, fit, write what is asked for, return the summary for the terminal."""
    recording = resolve(input, map_file, span, choice)
    tell_notes(recording)
    with working("fitting the Allan deviation"):
        rest = noise_at_rest(recording)
    document = as_json(rest, start_of(recording))
    document["called"] = called(input, recording, span)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.allan_page import allan_page

        allan_page(html, document["called"], rest, document)
    return summary(document)


def as_json(rest: Rest, begin: float = 0.0) -> dict[str, Any]:
    """Curves, terms with their sigmas and bounds, and the keys to declare.

    Parameters
    ----------
    begin : what the recording's clock shows at its start [s]
    """
    return {
        "format": 1,
        "rest": {"from": rest.start - begin, "to": rest.stop - begin, "found_by": rest.found or None},
        "channels": [_channel(channel) for channel in rest.channels],
        "left_out": dict(rest.left_out),
        "recording_toml": declared(rest),
        "toml": toml_of(rest),
    }


def _channel(channel: ChannelNoise) -> dict[str, Any]:
    fit = channel.fit
    return {
        "sensor": channel.sensor,
        "channel": channel.channel,
        "unit": channel.unit,
        "rate_hz": channel.rate,
        "readings": channel.count,
        "fitted_from": float(fit.tau[fit.first]),
        "terms": {
            name: {
                "value": fit.coefficients[k],
                "std": float(fit.std[k]),
                "seen": channel.seen(k),
                "below": channel.bound(k),
                "unit": channel.unit + unit,
            }
            for k, (name, unit) in enumerate(TERMS)
        },
        "one_sided_density": channel.one_sided,
        "white_noise_of_one_reading": channel.sample_std,
        "tau": fit.tau.tolist(),
        "deviation": fit.deviation.tolist(),
        "low": channel.low.tolist(),
        "high": channel.high.tolist(),
        "fit": fit.at(fit.tau).tolist(),
    }


def toml_of(rest: Rest) -> str:
    """The tables to paste into `recording.toml`; where no walk is seen its bound, as a comment."""
    lines: list[str] = []
    for sensor, keys in declared(rest).items():
        lines.append(f"[sensors.{sensor}]")
        lines += [f"{key} = {value:.3g}" for key, value in keys.items()]
        if "bias_walk" not in keys:
            length = rest.stop - rest.start
            lines.append(f"# bias_walk: not seen in {length:.3g} s; below {walk_bound(rest, sensor):.2g} (95 %)")
        lines.append("")
    return "\n".join(lines).rstrip()
