"""A camera calibrated as the course's pinhole: its residual field shows the lens, and the loop adds it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sinan.calibration.cameras.camera import CameraFit
from sinan.calibration.cameras.views import read_corners
from sinan.experiments.camera.loop import document as trace_document
from sinan.experiments.camera.study import as_json, study, trace_words, value_words
from sinan.experiments.report.camera_page import loop_section, of_each_picture
from sinan.experiments.report.page import Page

CORNERS = Path(__file__).parents[1] / "camera" / "opencv_left.csv"
#: Size of a pixel [mm] that makes the focal length one in millimetres: the course's dX = dY, of a 1/4 inch sensor
PIXEL = 0.0056


def run(out: Path, say: Callable[[str], None] = print) -> None:
    """OpenCV's own pictures: pinhole, the picture that does not fit, the effect, the error held out."""
    done = study(read_corners(CORNERS), "k1 k2 p1 p2")
    document = as_json(done)
    assert done.looped is not None
    plain, found = done.looped.before, done.found
    for name, rms in done.aside:
        say(f"{name} does not fit: {rms:.2f} pixels RMS")
    say(f"pinhole: {plain.rms:.3f} pixels RMS; with {found.form.name}: {found.rms:.3f} pixels RMS")
    say(trace_words(trace_document(done.looped)))
    page = Page(
        "A camera of the course",
        "A point of the world is turned into the camera (M2), drawn onto the picture at the focal length, and counted "
        "in pixels (M1 with f, dX, dY, u0, v0). Thirteen pictures of a chessboard, which OpenCV ships, tell M1.",
    )
    page.numbers(
        [
            (f"{done.looped.held_out[0]:.2f} → {done.looped.held_out[1]:.2f}", "held-out pictures, pixels RMS"),
            *((name, f"does not fit: {rms:.2f} pixels RMS, set aside") for name, rms in done.aside),
        ]
    )
    page.heading("M1")
    page.table(["", *("",) * 3], [[f"{value:.2f}" for value in row] for row in found.intrinsics.M1], (0, 1, 2, 3))
    f = PIXEL * found.intrinsics.f
    page.text(
        f"With pixels of dX = dY = {PIXEL} mm the focal length is {f[0]:.3f} mm by columns and {f[1]:.3f} mm by rows. "
        "The pictures tell f / dX and f / dY alone: a lens twice as long with pixels twice as large shows the same."
    )
    loop_section(page, done.looped, document)
    rows = [
        [name, *value_words(name, value, std), *value_words(name, value_plain, std_plain)]
        for name, value, std, value_plain, std_plain in _of_both(found, plain)
    ]
    page.heading("What a pinhole gets wrong")
    off = abs(plain.parameters[0] - found.parameters[0]) / plain.std[0]
    page.text(f"Its own 1 sigma knows nothing of the lens: the focal length is {off:.0f} times that off.")
    page.table(["", "with the lens", "1 sigma", "as a pinhole", "1 sigma"], rows, (1, 2, 3, 4))
    page.heading("Each picture")
    page.figure(of_each_picture(document), "RMS error of each picture; red: set aside, its corners fit no flat board.")
    page.text(
        "`sinan camera FOLDER --board 9x6` does the same with pictures of your own, and compares fisheye and "
        "omnidirectional lenses too."
    )
    page.write(out / "camera.html")


def _of_both(found: CameraFit, plain: CameraFit) -> list[tuple[str, float, float, float, float]]:
    """The four parameters that both have, with their standard deviations."""
    columns = found.parameters[:4], found.std[:4], plain.parameters[:4], plain.std[:4]
    return [(name, *row) for name, row in zip(found.form.names[:4], zip(*columns, strict=True), strict=True)]
