"""Arguments of `sinan ranges`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import require_place_for, say
from sinan.experiments.commands.arguments.shared import Html, Json, Seed

RANGE_SCENARIOS = ", ".join(sorted(p.stem for p in (Path(__file__).parents[2] / "gnss" / "scenarios").glob("*.toml")))


def ranges(
    scenario: Annotated[str, typer.Argument(help=f"{RANGE_SCENARIOS}; or a TOML file (docs/gnss.md)")],
    out: Annotated[Path | None, typer.Option(help="folder for RINEX files of rover, base and messages")] = None,
    seed: Seed = 0,
    json: Json = None,
    html: Html = None,
) -> None:
    """Simulate pseudoranges of C/A and P code receivers and a DGPS data link; errors over the corrections' age."""
    from sinan.experiments.commands.ranges import run

    require_place_for(out)
    say(lambda: run(scenario, out, seed, json, html), json, html)
