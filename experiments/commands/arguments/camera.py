"""Arguments of `sinan camera`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sinan.experiments.commands.arguments.saying import say
from sinan.experiments.commands.arguments.shared import Html, Json


def camera(
    place: Annotated[
        Path, typer.Argument(help="folder of pictures, a table of corners; hand-eye or wand", metavar="INPUT")
    ],
    what: Annotated[
        Path | None, typer.Argument(help="hand-eye: pictures or corners; wand: a table", metavar="[INPUT]")
    ] = None,
    board: Annotated[
        str | None, typer.Option(help="inner corners of the chessboard, or squares of the ChArUco board", metavar="9x6")
    ] = None,
    square: Annotated[float, typer.Option(help="side of a square, m; without it, places are in squares")] = 1.0,
    marker: Annotated[float | None, typer.Option(help="ChArUco: side of a marker, in the unit of --square")] = None,
    dictionary: Annotated[str, typer.Option(help="ChArUco: OpenCV's name of the markers' dictionary")] = "DICT_5X5_100",
    legacy: Annotated[bool, typer.Option("--legacy", help="ChArUco: a board printed by OpenCV before 4.6")] = False,
    lens: Annotated[
        str, typer.Option(help="auto (held-out pictures decide), pinhole, k1, ..., fisheye, unified, omnidirectional")
    ] = "auto",
    corners: Annotated[Path | None, typer.Option(help="file for the corners that were found, as CSV")] = None,
    body: Annotated[
        Path | None, typer.Option(help="hand-eye: table image,qw,qx,qy,qz[,north,east,down]; with --gyro image,t")
    ] = None,
    gyro: Annotated[Path | None, typer.Option(help="hand-eye: a log whose gyroscope turned with the camera")] = None,
    along: Annotated[str, typer.Option(help="wand: distances of the markers from the first, m: 0,0.2,0.5")] = "",
    cameras: Annotated[str, typer.Option(help="wand: JSON of each camera, in order, commas between")] = "",
    json: Json = None,
    html: Html = None,
) -> None:
    """Calibrate a camera from pictures of a board: intrinsics, lens, error; its mounting: hand-eye; several: wand."""
    from sinan.experiments.commands.camera import board_of, run
    from sinan.sensors.errors import InputError

    target = board_of(board, square, marker, dictionary, legacy)
    if str(place) in ("hand-eye", "wand"):
        from sinan.experiments.commands.camera_rig import Given, hand_eye, wand

        if html is not None or corners is not None:
            raise InputError("--html, --corners", f"with {place}", "--json: there is no page of a mounting")
        given = Given(body, gyro, along, cameras)
        if str(place) == "wand":
            say(lambda: wand(what, given, lens, json), json, None)
        else:
            say(lambda: hand_eye(what, given, target, lens, json), json, None)
        return
    if what is not None:
        raise InputError("camera", f"two inputs, {place} and {what}", "one; or hand-eye, or wand, before the second")
    say(lambda: run(place, target, lens, corners, json, html), json, html, corners=corners)
