"""Arguments of `sinan demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import require_place_for


def demo(
    out: Annotated[Path, typer.Argument(help="folder for the page and the figures")] = Path("sinan-demo"),
) -> None:
    """A demonstration: hides effects in a recording, finds them, and writes a page (about a minute the
    first time, then 7 s).
    """
    from sinan.experiments.commands.demo import run

    require_place_for(out)
    run(out)
