"""docs/notes/separation.md, made from the table of `experiments.separation.study`.

python -m sinan.experiments.separation.page [OUT.md]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from sinan.experiments.residual_loop.manoeuvre import (
    AS_GOOD,
    CLASS_BOUND,
    SEEN_FROM,
    Look,
    alike,
    apart,
    deciding,
    in_digits,
    most_alike,
    scenes,
)
from sinan.sensors.files import write_text

PAGE = Path(__file__).parents[2] / "docs" / "notes" / "separation.md"

HEAD = f"""# What looks alike, and what tells it apart

Made by `python -m sinan.experiments.separation.study` (the table, shipped as
`experiments/residual_loop/separation.json`) and `python -m sinan.experiments.separation.page` (this page). An
ambiguous verdict of `sinan trace` takes its advice from the same table.

Every scenario of the catalogue is flown once, with nothing missing, and all candidates are scored jointly. Two
candidates are compared by r², the largest squared canonical correlation of their signatures in the innovations, with
nothing else given. The right name leads the wrong one by lambda (1 - r²) in 2 log L, where lambda is the evidence for
the effect; models within 10 are not told apart.

**The class bound is {CLASS_BOUND:g}.** There the lead of 10 is reached at lambda = 50, an effect 1.3 times as large
as one that is just detectable (lambda = 30). At r² = 0.98 it takes lambda = 500, an effect four times as large. Pairs
above the bound in some scenario are listed here.

**A scenario decides** if r² is at most {CLASS_BOUND:g} and it would detect both effects, each with the other one
allowed for, at {SEEN_FROM:g} plausible size (the median over the components). A low r² in a flight that sees neither
effect decides nothing. Among scenarios whose r² is within {AS_GOOD:g} of the lowest, the one that sees both from the
smallest size on is named. Where none decides, one that shows one effect and not the other will do: a calibration of
the one sensor by itself, or a vehicle that does not shake.

One set of sensors for all: accelerometer, gyroscope, magnetometer, barometer, sonar, laser, GPS. `no_aiding_flight`
lacks some of them; it is flown as it is, with a declared rotor drag (which `motion.wind` needs), and with the whole
set. `no_aiding` is in the hand and stays as it is. `base_receiver` has a reference receiver besides, and in
`vibration` the motors shake the frame: both are in the table, neither is given as advice.

Neglected: time-localised effects, whose signature depends on their interval, and outliers. The figures are those of
one draw of the noise; another moves r² by some hundredths where it is near neither 0 nor 1. `accel.vibration` and
`accel.scale_nonlinearity` are one piece of physics where the frame shakes, since the mean of the square of a shaken
force is that of the slow force plus the vibration's variance. `baro.lag` and `baro.time_offset` are the same to first
order; only a lag longer than the changes of climb rate differs, which no first-order table shows.
"""


def page() -> str:
    """The page: what decides each pair, and r² of every pair in every scenario."""
    return "\n".join([HEAD, *_decisions(), "", *_matrix(), ""])


def _decisions() -> list[str]:
    lines = [
        "## What decides",
        "",
        "| pair | most alike | r² | decides | r² there | both seen from (plausible sizes) |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for first, other in alike():
        worst = most_alike(first, other)
        cells = [f"`{first}`, `{other}`", worst.scene.key, in_digits(worst.r2), *_answer(first, other)]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _answer(first: str, other: str) -> Sequence[str]:
    found = deciding(first, other)
    if found:
        best = found[0]
        return f"`{best.scene.key}`", in_digits(best.r2), f"{best.sees_both_from:.2g}"
    alone = apart(first, other)
    if alone is not None:
        scene, shown = alone
        hidden = other if shown == first else first
        return f"`{scene.key}` shows `{shown}`, not `{hidden}`", "", f"{scene.sees[shown]:.2g}"
    return "no scenario of the catalogue", "", ""


def _matrix() -> list[str]:
    columns = list(scenes().values())
    lines = [
        "## r² in every scenario",
        "",
        "An empty cell: one of the two is not seen or no candidate.",
        "",
        *(f"- {_letter(k)}: `{scene.key}`" for k, scene in enumerate(columns)),
        "",
        "| pair | " + " | ".join(_letter(k) for k in range(len(columns))) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for (first, other), found in alike().items():
        by_key = {look.scene.key: look for look in found}
        cells = [_cell(by_key.get(scene.key)) for scene in columns]
        lines.append(f"| `{first}`, `{other}` | " + " | ".join(cells) + " |")
    return lines


def _letter(k: int) -> str:
    return chr(ord("A") + k)


def _cell(look: Look | None) -> str:
    return "" if look is None else f"{min(look.r2, 0.999):.3f}".lstrip("0")


def main(arguments: list[str]) -> None:
    """Write the page, by default where it is kept."""
    out = Path(arguments[0]) if arguments else PAGE
    write_text(out, page())
    sys.stdout.write(f"{out}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
