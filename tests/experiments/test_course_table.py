"""docs/course.md: it names what there is, and leaves out no figure of the lecture."""

from __future__ import annotations

import re
from pathlib import Path

from typer.main import get_command

from sinan.experiments.commands.cli import app
from sinan.experiments.labs import LABS
from sinan.sensors.effects import effect

PAGE = (Path(__file__).parents[2] / "docs" / "course.md").read_text(encoding="utf-8")


def test_every_figure_of_the_lecture_is_in_the_table() -> None:
    lecture = PAGE.split("## Lab\n")[0]
    figures = {int(n) for row in lecture.splitlines() if row.startswith("|") for n in re.findall(r"7\.(\d+)", row)}
    assert figures == set(range(1, 20))


def test_every_command_lab_and_effect_of_the_table_exists() -> None:
    commands = set(get_command(app).commands)  # type: ignore[attr-defined]
    named = re.findall(r"`sinan (\w+)(?: ([\w.]+))?", PAGE)
    assert {command for command, _ in named} <= commands
    labs = {name for command, name in named if command == "lab" and name}
    assert labs - {"begin", "check"} == set(LABS)  # each experiment shows something of the course, and none is left out
    for command, name in named:
        if command == "effects" and name:
            assert effect(name).name == name
