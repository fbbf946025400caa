"""C/A and P code: classes of receivers as they are declared, and both codes of measured RINEX."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from sinan.experiments.gnss.codes import CodeRow, classes, measured
from sinan.experiments.report.page import Page

HEAD = ["in metres", "code", "range", "epoch to epoch", "fix RMS", "its mean", "scatter", "PDOP"]


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """Simulate every class, solve what is measured where it is at hand, and write both tables."""
    simulated = classes()
    for row in simulated:
        say(f"{row.what} ({row.code}): {row.range_error:.2f} m RMS, declared {row.expected:.2f}")
    page = Page(
        "C/A code and P code",
        "The chips of the P code are ten times shorter, and with them the noise of its ranges. The lecture has 20 m "
        "and 2 m: course_ca and course_p. The other classes take the noise of the code loop.",
    )
    page.heading("Simulated classes of receivers")
    declared = [[*cells, f"{row.expected:.2f}"] for cells, row in zip(_cells(simulated), simulated, strict=True)]
    page.table([*HEAD, "declared range"], declared, range(2, len(HEAD) + 1))
    page.text(
        "A pseudorange's RMS error about the mean of its epoch; declared: noise and slow errors together. 900 s of "
        "slow errors that last a minute are some hundred draws: 10 % off is chance. A fix is worse by PDOP.", note=True,
    )  # fmt: skip
    page.heading("Measured, GPS alone")
    folder = Path(os.environ.get("SINAN_DATA", "")) / "gnss"
    rows = measured(folder) if os.environ.get("SINAN_DATA") else []
    for row in rows:
        say(f"{row.what} {row.code}: fix {row.position_rms:.2f} m RMS")
    if rows:
        page.table(HEAD, _cells(rows), range(2, len(HEAD)))
        page.text(
            "C2W: the P code of L2, where a receiver gives none of L1. C1W+C2W: free of the ionosphere, with three "
            "times the noise. Civil receivers track P(Y) without its code, and lose what its short chips would bring: "
            "on these logs the codes differ by decimetres, and orbits, air and multipath decide.", note=True,
        )  # fmt: skip
    else:
        page.text("No measured RINEX is at hand: SINAN_DATA names a folder that has `gnss/`.")
        say("no measured RINEX at hand: SINAN_DATA names no folder with gnss/")
    page.write(out / "codes.html")


def _cells(rows: Sequence[CodeRow]) -> list[list[str]]:
    return [
        [
            row.what, row.code, f"{row.range_error:.2f}", f"{row.noise:.2f}",
            f"{row.position_rms:.2f}", f"{row.bias:.2f}", f"{row.scatter:.2f}", f"{row.pdop:.1f}",
        ]
        for row in rows
    ]  # fmt: skip
