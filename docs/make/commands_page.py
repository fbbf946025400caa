"""The command line, from the declarations that `--help` is made of."""

from __future__ import annotations

from enum import Enum
from typing import Any

import typer

from sinan.experiments.commands.cli import app

HEAD = """# Command line

Made of the same declarations as `sinan COMMAND --help`. `python -m sinan` is the same command. Exit status: 0 done;
1 bad input, with one line that names file, place, what was found and what was expected; 2 usage.

| command | what it does |
| --- | --- |
"""


def page() -> str:
    """An overview, then a section a command."""
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    rows = [f"| [`sinan {name}`](#sinan-{name}) | {_first_line(command)} |" for name, command in commands.items()]
    return HEAD + "\n".join(rows) + "\n" + "".join(_section(name, command) for name, command in commands.items())


def _first_line(command: Any) -> str:
    return " ".join(command.help.split("\n\n")[0].split())


def _section(name: str, command: Any) -> str:
    arguments = [p for p in command.params if type(p).__name__.endswith("Argument")]
    options = [p for p in command.params if p not in arguments]
    words = " ".join(p.metavar or p.name.upper() for p in arguments)
    usage = " ".join(part for part in (f"sinan {name}", words, "[OPTIONS]" if options else "") if part)
    text = "\n\n".join(" ".join(part.split()) for part in command.help.split("\n\n"))
    lines = ["", f"## sinan {name}", "", text, "", "```", usage, "```", ""]
    rows = [_row(p.metavar or p.name.upper(), p) for p in arguments] + [_row(_names(p), p) for p in options]
    if rows:
        lines += ["| argument or option | meaning | default |", "| --- | --- | --- |", *rows]
    return "\n".join(lines) + "\n"


def _names(option: Any) -> str:
    value = "" if option.is_flag else f" {option.metavar or _kind(option)}"
    return ", ".join([*option.opts, *option.secondary_opts]) + value


def _kind(parameter: Any) -> str:
    annotation = parameter.type_descriptor.annotation
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return "|".join(str(member.value) for member in annotation)
    return {int: "INTEGER", float: "NUMBER"}.get(annotation, "TEXT")


def _row(name: str, parameter: Any) -> str:
    default = parameter.default
    shown = default is not None and default is not False and default != () and parameter.show_default
    if isinstance(default, Enum):
        default = default.value
    text = " ".join((parameter.help or "").split()).replace("|", "\\|")
    return f"| `{name}` | {text} | {f'`{default}`' if shown and not callable(default) else ''} |".replace(
        name, name.replace("|", "\\|"), 1
    )
