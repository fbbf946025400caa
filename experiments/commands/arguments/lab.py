"""Arguments of `sinan lab`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from sinan.experiments.commands.arguments.saying import require_place_for, show
from sinan.experiments.labs import LABS
from sinan.experiments.student_labs import TITLES


class Language(StrEnum):
    """Of the labs for students."""

    en = "en"
    zh = "zh"


def lab(
    name: Annotated[
        str | None, typer.Argument(help=f"{', '.join(LABS)}; begin or check, for students; none: the list")
    ] = None,
    what: Annotated[
        str | None, typer.Argument(help=f"begin, check: {', '.join(TITLES)}", metavar="[LAB]", show_default=False)
    ] = None,
    answer: Annotated[
        Path | None, typer.Argument(help="check: answer.json, its data.csv beside it", show_default=False)
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for the page; begin: of the student")] = Path("sinan-lab"),
    student: Annotated[str, typer.Option(help="begin: number or name, from which the data are drawn")] = "",
    secret: Annotated[
        str, typer.Option(envvar="SINAN_LAB_SECRET", help="the teacher's, from which they are drawn too; check: by it")
    ] = "",
    key: Annotated[Path | None, typer.Option(help="begin: file for the teacher's key, not in --out")] = None,
    solved: Annotated[bool, typer.Option("--solved", help="begin: the solved notebook")] = False,
    seals: Annotated[bool, typer.Option(help="begin: so that the student can check too")] = True,
    language: Annotated[Language, typer.Option(help="begin, check: en or zh")] = Language.en,
) -> None:
    """Run the course's experiments, or a lab with data of your own: begin LAB, check LAB ANSWER."""
    if name in ("begin", "check"):
        from sinan.experiments.commands.lab import begin, check
        from sinan.experiments.student_labs.files import Kind

        words: Literal["en", "zh"] = "zh" if language is Language.zh else "en"
        if name == "begin":
            require_place_for(out)
            show(begin(what, student, out, Kind(words, solved, seals), secret, key))
        elif not check(what, answer, words, student, secret, show):
            raise typer.Exit(1)
        return
    from sinan.experiments.labs import run

    if name is None:
        typer.echo("\n".join(f"{key:14} {text}" for key, text in LABS.items()))
        typer.echo("\nWith data of your own: sinan lab begin LAB --student NUMBER --out FOLDER")
        typer.echo(f"LAB: {', '.join(TITLES)}")
    else:
        require_place_for(out)
        run(name, out)
