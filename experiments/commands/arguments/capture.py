"""Arguments of `sinan capture`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import choice_of, require_place_for, say_as_kept
from sinan.experiments.commands.arguments.shared import AxesForm, Baro, Gps, Gravity, Html, Imu, Json, Mag


class Posed(StrEnum):
    """What is shown poses, held still."""

    accel = "accel"


class Turned(StrEnum):
    """What is turned round on its faces."""

    mag = "mag"


def capture(
    link: Annotated[
        str, typer.Option("--link", help="udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD")
    ],
    out: Annotated[Path, typer.Option("--out", help="folder of the recording: new or empty")],
    seconds: Annotated[
        float | None, typer.Option("--for", help="end after so many seconds; else Ctrl-C ends it well", min=0.1)
    ] = None,
    rate: Annotated[float, typer.Option(help="readings of the IMU to ask for, a second", min=1.0, max=1000.0)] = 50.0,
    poses: Annotated[
        Posed | None,
        typer.Option(help="the course's ten poses, 100 still readings each: calibrate and print parameters"),
    ] = None,
    faces: Annotated[
        Turned | None, typer.Option(help="six faces, turned round on each: calibrate and print parameters")
    ] = None,
    axes: Annotated[
        AxesForm | None, typer.Option(help="form of T; default: none of an accelerometer, triangular of a compass")
    ] = None,
    gravity: Gravity = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    mwlog: Annotated[
        Path | None, typer.Option("--mwlog", help="file for the same readings as the course's log", metavar="FILE")
    ] = None,
    params: Annotated[
        Path | None, typer.Option("--params", help="file of the parameters, for the ground station", metavar="FILE")
    ] = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Record a live vehicle over MAVLink, or calibrate its accelerometer or compass by poses."""
    from sinan.experiments.capture.session import Asked
    from sinan.experiments.commands.capture import Results, run
    from sinan.sensors.errors import InputError

    if poses and faces:
        raise InputError("--poses, --faces", "both", "one of them: each is a recording of its own")
    if not (poses or faces) and (params or json or html):
        raise InputError("--params, --json, --html", "without --poses or --faces", "a calibration to write")
    require_place_for(out)
    asked = Asked(
        out, poses.value if poses else faces.value if faces else "flight", rate, seconds,
        choice_of(imu, mag, baro, gps, False), gravity, mwlog,
    )  # fmt: skip
    results = Results(axes.value if axes else None, html, params, json)
    say_as_kept(lambda: run(link, asked, results), json, html, parameters=params, mwlog=mwlog)
