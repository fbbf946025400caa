"""The command line: its commands in the order in which `sinan --help` lists them, and what holds for all of them.

A command is a file in `arguments/` and a line in `_COMMANDS`; its work is imported when it runs.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import Annotated, NoReturn

import typer

from sinan.experiments.commands.arguments import (
    allan,
    batch,
    blind,
    calibrate,
    camera,
    capture,
    convert,
    demo,
    effects,
    estimate,
    fetch,
    gnss,
    heights,
    info,
    lab,
    map_log,
    montecarlo,
    observability,
    params,
    ranges,
    schema,
    serve,
    simulate,
    trace,
)
from sinan.experiments.commands.arguments.shared import MOST_METRES
from sinan.experiments.commands.usage import Command

# The matrices are small: more threads only get in each other's way, and the last bits would depend on their number.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

app = typer.Typer(
    name="sinan",
    help="Find what is wrong with a vehicle's sensors from its log, prove it on withheld data, and say what to set.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    epilog="With a log: `sinan trace LOG --html page.html`. Without one: `sinan demo`. More: `sinan COMMAND --help`.",
)


def _version(wanted: bool) -> None:
    if wanted:
        from sinan.experiments.report.made import sinan_version

        typer.echo(f"sinan {sinan_version()}")
        raise typer.Exit


@app.callback()
def sinan(
    version: Annotated[
        bool, typer.Option("--version", help="show the version and exit", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Multi-sensor state estimation that traces a residual to the effect a model lacks."""


_COMMANDS = (
    demo.demo,
    fetch.fetch,
    simulate.simulate,
    info.info,
    convert.convert,
    calibrate.calibrate,
    estimate.estimate,
    trace.trace,
    params.params,
    gnss.gnss,
    ranges.ranges,
    observability.observability,
    montecarlo.montecarlo,
    batch.batch,
    serve.serve,
    capture.capture,
    camera.camera,
    allan.allan,
    map_log.map_log,
    heights.heights,
    lab.lab,
    effects.effects,
    schema.schema,
    blind.blind,
)
for _command in _COMMANDS:
    app.command("map" if _command is map_log.map_log else None, cls=Command)(_command)


def _require_whole_effects(arguments: list[str]) -> None:
    """An effect that a blank cuts in two would be one argument too many: say so as any other near miss."""
    for option, name, value in zip(arguments, arguments[1:], arguments[2:], strict=False):
        if option == "--effect" and "=" not in name and value.lstrip("-.")[:1].isdigit():
            from sinan.experiments.scenarios import parse_effect

            parse_effect(f"{name} {value}")


def _spread(arguments: list[str]) -> list[str]:
    """Positions as three arguments, however their numbers were separated: `X Y Z`, `X,Y,Z` or `"X, Y, Z"`."""
    from sinan.sensors.errors import InputError

    result: list[str] = []
    rest = list(arguments)
    while rest:
        option, equals, value = rest.pop(0).partition("=")
        if equals and option not in ("--position", "--base-position"):
            option, equals = f"{option}={value}", ""
        result.append(option)
        rest = [value, *rest] if equals else rest
        if result[-1] in ("--position", "--base-position"):
            numbers: list[str] = []
            while rest and len(numbers) < 3 and (more := _numbers(rest[0])):
                numbers += more
                rest.pop(0)
            if len(numbers) != 3:
                raise InputError(result[-1], " ".join(numbers) or "no number", "X Y Z: three numbers, ECEF, m")
            result += numbers
    return result


def _numbers(text: str) -> list[str]:
    """The numbers in a text with commas or blanks between; none where anything else is in it."""
    parts = text.replace(",", " ").split()
    try:
        return parts if all(abs(float(part)) < MOST_METRES for part in parts) else []
    except ValueError:
        return []


def _leave_warnings_to_developers() -> None:
    """Say no warning of a library, here or in a worker process, unless `python -W` or PYTHONWARNINGS ask for them."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"


def main() -> None:
    """Entry point: bad input ends with status 1 and one line, bad usage with 2, Ctrl-C with 130 and one line."""
    from sinan.experiments.workers.stopping import listening
    from sinan.sensors.errors import InputError
    from sinan.sensors.files import cannot_write

    _leave_warnings_to_developers()
    try:
        with listening():
            _require_whole_effects(sys.argv[1:])
            app(_spread(sys.argv[1:]))
    except InputError as error:
        _fail(error)
    except OSError as error:
        if error.filename is None:  # of no file: the text could not be written
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left of it would fail again at the end
            _fail(cannot_write("standard output", error, "an output that takes the text"))
        _fail(cannot_write(os.fsdecode(error.filename), error, "a path that can be used"))
    except MemoryError:
        _fail(InputError(" ".join(sys.argv[1:]), "more than the memory holds", "a shorter log, or more memory"))


def _fail(error: Exception) -> NoReturn:
    sys.stderr.write(f"sinan: {error}\n")
    raise SystemExit(1) from None
