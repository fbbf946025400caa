"""`sinan blind`: recordings with sealed answers, traced and counted."""

from __future__ import annotations

from pathlib import Path

from sinan.experiments.blind.benchmark import run as run_benchmark
from sinan.experiments.blind.maker.catalogue import CAMERA
from sinan.experiments.blind.rates import as_json, text
from sinan.experiments.report.console import progress
from sinan.experiments.report.files import write_json
from sinan.sensors.files import together, write_bytes


def run(
    out: Path, runs: int, seed: int, world: str, workers: int | None, html: Path | None, camera: bool = False
) -> str:
    """Make, trace, count; the table for the terminal. Rates into `out`/rates.json, figures beside it.

    Parameters
    ----------
    out : folder for recordings, reports and rates
    html : page with the figures; default: `out`/blind.html
    camera : flights with a camera instead of the usual kinds
    """
    from sinan.experiments.blind.page import blind_page, confusion, identification
    from sinan.experiments.report.page import png

    with progress("recordings", flies=True) as tell:
        grades = run_benchmark(
            out, runs, seed, world, kinds=[CAMERA] if camera else None, workers=workers or 1, tell=tell
        )
    document = as_json(grades)
    with together():
        write_json(out / "rates.json", document)
        blind_page(html or out / "blind.html", grades, document)
        for name, draw in (("identification", identification), ("confusion", confusion)):
            write_bytes(out / f"{name}.png", png(draw(grades)))
    return text(document["rates"])
