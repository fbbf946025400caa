"""The noise of a log at rest in words: a line a channel, and each term with its sigma or its bound."""

from __future__ import annotations

from typing import Any

import numpy as np

from sinan.calibration.levels.rest import SEEN
from sinan.experiments.report.words import SENSORS, number

#: N, B, w, R: name, and what their unit is beside the channel's
TERMS = (
    ("noise_density", "/sqrt(Hz)"),
    ("instability", ""),
    ("bias_walk", "/s/sqrt(Hz)"),
    ("ramp", "/s"),
)


def summary(document: dict[str, Any]) -> str:
    """A line a channel, then the keys."""
    rest = document["rest"]
    found = f"found by {rest['found_by']}" if rest["found_by"] else "taken to be at rest: no IMU tells"
    length = rest["to"] - rest["from"]
    lines = [f"{document['called']}: {length:.4g} s at rest, from {rest['from']:.4g} s on ({found})"]
    cells: list[tuple[str, ...]] = [("", "N /sqrt(Hz)", "B", "w /s/sqrt(Hz)", "R /s", "fitted from")]
    for one in document["channels"]:
        name = " ".join(part for part in (SENSORS.get(one["sensor"], one["sensor"]), one["channel"]) if part)
        name += f" [{one['unit']}]" if one["unit"] else ""
        cells.append((name, *(term_words(one["terms"][key]) for key, _ in TERMS), f"{one['fitted_from']:.3g} s"))
    widths = [max(len(cell[k]) for cell in cells) for k in range(6)]
    lines += ["  " + "  ".join(f"{c:{w}}" if k == 0 else f"{c:>{w}}" for k, (c, w) in enumerate(zip(cell, widths,
              strict=True))) for cell in cells]  # fmt: skip
    lines.append(
        f"  <: not seen ({SEEN:.0f} sigma), 95 % bound. N is two-sided as in recording.toml; data sheets: sqrt(2) N"
    )
    lines += [f"  left out: {name}, {why}" for name, why in document["left_out"].items()]
    return "\n".join([*lines, "", document["toml"]])


def term_words(term: dict[str, Any]) -> str:
    """`0.0021 ± 0.0001`, or `< 0.003` where it is not seen."""
    if not term["seen"]:
        return f"< {term['below']:.2g}"
    digits = max(0, int(np.ceil(np.log10(max(term["value"] / max(term["std"], 1e-300), 1.0)))) + 1)
    sigma = number(float(f"{term['std']:.1g}"))
    return f"{term['value']:.{min(max(digits, 2), 5)}g} ± {sigma}"
