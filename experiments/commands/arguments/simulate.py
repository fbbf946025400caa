"""Arguments of `sinan simulate`."""

from __future__ import annotations

from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import know, require_place_for, show
from sinan.experiments.commands.arguments.shared import SCENARIOS, Force, Out, OwnEffects, Seed


def simulate(
    scenario: Annotated[str, typer.Argument(help=SCENARIOS)],
    out: Out,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect",
            help="NAME=B0[,B1...][@T0[:T1]], such as mag.current=0.003,0,0 or gps.transient=4,0,0@20:30 (s); "
            "may be given again; `sinan effects` lists the names",
        ),
    ] = None,
    declare: Annotated[bool, typer.Option("--declare", help="write the effects into the recording")] = False,
    sensors: Annotated[
        str,
        typer.Option(help="only these, such as accel,gyro,gps,camera; a flight may be given a camera"),
    ] = "",
    own_effects: OwnEffects = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Simulate a flight or poses into a recording with its truth; what is hidden in it is written beside it."""
    know(own_effects)
    from sinan.experiments.report.console import note, working
    from sinan.experiments.scenarios import simulate_to_folder

    require_place_for(out)
    names = [name.strip() for name in sensors.split(",") if name.strip()]
    with working("simulating"):
        answer = simulate_to_folder(scenario, out, effect or [], declare, seed, force, names, note)
    show(f"recording: {out}\nanswer: {answer}")
