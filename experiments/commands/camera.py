"""`sinan camera`: pictures of a board, or a table of corners -> intrinsics, as text, JSON and a page."""

from __future__ import annotations

from pathlib import Path

from sinan.calibration.cameras.views import Board, views_of, write_corners
from sinan.experiments.camera.study import as_json, study, summary
from sinan.experiments.report.console import progress, working
from sinan.experiments.report.files import write_json
from sinan.sensors.errors import InputError


def board_of(text: str | None, square: float, marker: float | None, dictionary: str, legacy: bool) -> Board | None:
    """The board that the options say.

    Raises
    ------
    InputError : not two numbers, or sizes that no board has
    """
    if text is None:
        return None
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() and 3 <= int(part) <= 100 for part in parts):
        raise InputError("--board", text, "columns x rows of inner corners, 3 to 100 each, such as 9x6")
    if not 0.0 < square < float("inf"):
        raise InputError("--square", f"{square:g}", "the side of a square in metres")
    if marker is not None and not 0.0 < marker < square:
        raise InputError("--marker", f"{marker:g}", "the side of a marker in metres, less than that of a square")
    return Board(int(parts[0]), int(parts[1]), square, marker, dictionary, legacy)


def run(place: Path, board: Board | None, lens: str, corners: Path | None, json: Path | None, html: Path | None) -> str:
    """Calibrate, write what is asked for, return the summary for the terminal."""
    with progress("looking for corners") as step:
        views = views_of(place, board, step)
    if corners is not None:
        write_corners(corners, views.views, views.size)
    with working("calibrating"):
        done = study(views, lens)
    document = as_json(done)
    if json is not None:
        write_json(json, document)
    if html is not None:
        from sinan.experiments.report.camera_page import camera_page

        camera_page(html, place.name, done, document)
    return "\n".join(summary(document))
