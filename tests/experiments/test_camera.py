"""`sinan camera` and the loop on a camera's residual field."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest
from typer.testing import CliRunner

from sinan.calibration.cameras.camera import fit, form
from sinan.calibration.cameras.views import View, Views, read_corners, write_corners
from sinan.experiments.camera.loop import CameraTrace, document, evidence, trace
from sinan.experiments.camera.study import as_json, study
from sinan.experiments.commands.camera import board_of
from sinan.experiments.commands.cli import app
from sinan.experiments.labs import run as run_lab
from sinan.sensors.camera import Intrinsics
from sinan.sensors.errors import InputError
from tests.calibration.test_camera import LEFT, SIZE, simulated

NOISE = 0.15
PINHOLE = Intrinsics(np.array([420.0, 424.0]), np.array([325.0, 243.0]))
BENT = replace(PINHOLE, k=np.array([-0.2, 0.08, 2e-3, -1e-3]))


@cache
def looped(k1: float, seed: int) -> CameraTrace:
    """The loop on ten simulated pictures."""
    return trace(simulated(replace(PINHOLE, k=np.array([k1])), 10, seed, NOISE), SIZE)


def test_a_pinhole_shows_nothing() -> None:
    """No name on 20 cameras without distortion; alpha is 1 % over all candidates together."""
    assert [looped(0.0, seed).verdict for seed in range(20)] == ["no_effect"] * 20


def test_p_values_of_a_pinhole_are_uniform() -> None:
    """Of each candidate, over 60 cameras without distortion, by Kolmogorov and Smirnov at one in a thousand."""
    found = [evidence(fit(simulated(PINHOLE, 6, 500 + seed, NOISE), form("pinhole"), SIZE)) for seed in range(60)]
    for column in zip(*found, strict=True):
        assert kstest([one.p_value for one in column], "uniform").pvalue > 1e-3, column[0].candidate.name


def test_distortion_is_named_and_held_out_pictures_are_predicted_to_the_noise() -> None:
    found = trace(simulated(BENT, 10, 3, NOISE), SIZE)
    assert found.verdict == "effects"
    assert found.named is not None
    assert found.named.candidate.name == "camera.distortion"
    assert np.all(np.abs(found.named.beta - BENT.k[:4]) < 4.0 * found.named.std)
    before, after = found.held_out
    assert after == pytest.approx(NOISE * np.sqrt(2.0), rel=0.1)
    assert before > 3.0 * after
    assert found.gain > 5.0 * found.error
    assert document(found)["remaining"] == []


def test_a_small_distortion_is_found_to_first_order() -> None:
    """The score's beta is that of the refit where the effect is small."""
    views = simulated(replace(PINHOLE, k=np.array([-0.001])), 10, 4, 0.02)
    first = evidence(fit(views, form("pinhole"), SIZE))[0]
    exact = fit(views, form("k1 k2 p1 p2"), SIZE)
    assert np.all(np.abs(first.beta - exact.parameters[4:]) < 0.05 * exact.std[4:])
    np.testing.assert_allclose(first.std, exact.std[4:], rtol=0.1)


def test_a_bent_board_is_no_lens() -> None:
    """A board that sags by 0.5 mm at 0.12 m: the residual has structure, and no name of the catalogue."""
    views = []
    for view in simulated(PINHOLE, 10, 6, 0.0):
        x, y, _ = view.points.T
        found = fit([view, *simulated(PINHOLE, 3, 90, 0.0)], form("pinhole"), SIZE, PINHOLE)
        sagged = view.points + np.column_stack([0.0 * x, 0.0 * y, 0.035 * (x * x + y * y)])
        views.append(View(view.name, view.points, PINHOLE.pixels(found.poses[0].points(sagged))))
    rng = np.random.default_rng(1)
    noisy = [View(v.name, v.points, v.pixels + 0.05 * rng.standard_normal(v.pixels.shape)) for v in views]
    found = trace(noisy, SIZE)
    assert found.verdict == "unexplained"
    assert max(found.first, key=lambda one: one.statistic).candidate.name == "a board that is bent"


@cache
def of_opencv() -> dict[str, object]:
    return json.loads(json.dumps(as_json(study(read_corners(LEFT))), allow_nan=False))


def test_opencvs_pictures() -> None:
    """One picture set aside, tangential distortion called for, and the error of held-out pictures 1.63 -> 0.24."""
    told = of_opencv()
    assert [one["name"] for one in told["set_aside"]] == ["left02.jpg"]
    assert told["form"] == "k1 k2 p1 p2"
    assert told["rms"] == pytest.approx(0.234, abs=0.002)
    looped = told["trace"]
    assert (looped["verdict"], looped["effects"][0]["name"]) == ("effects", "camera.distortion")
    assert looped["error"]["before"]["rms"] == pytest.approx(1.63, abs=0.02)
    assert looped["error"]["after"]["rms"] == pytest.approx(0.239, abs=0.003)
    assert {one["form"] for one in told["compared"]} >= {"pinhole", "k1", "fisheye", "unified", "omnidirectional"}
    assert min(one["held_out_rms"] for one in told["compared"]) > 0.2


def test_few_pictures_get_a_usual_lens() -> None:
    views = simulated(BENT, 2, 0, NOISE)
    done = study(Views("few", tuple(views[:1]), {}, SIZE))
    assert (done.found.form.name, done.compared, done.looped) == ("k1 k2", [], None)


def test_eight_corners_of_one_picture_are_no_traceback() -> None:
    view = simulated(PINHOLE, 1, 0, NOISE)[0]
    done = study(Views("one", (view.rows(np.array([0, 3, 7, 17, 20, 28, 33, 40])),), {}, SIZE))
    assert (done.found.form.name, done.looped) == ("k1 k2", None)


def test_corners_without_noise() -> None:
    """Of a table that was computed: everything is exact, nothing divides by zero, and the numbers are JSON."""
    done = study(Views("exact", tuple(simulated(BENT, 6, 0, 0.0)), {}, SIZE), "k1 k2 p1 p2")
    np.testing.assert_allclose(done.found.parameters[:4], BENT.values[:4], atol=1e-3)
    told = json.loads(json.dumps(as_json(done), allow_nan=False))
    assert told["trace"]["verdict"] == "effects"
    assert as_json(study(Views("exact", tuple(simulated(PINHOLE, 6, 0, 0.0)), {}, SIZE)))["form"] == "pinhole"


def test_the_lens_that_is_asked_for_is_taken() -> None:
    done = study(Views("table", tuple(simulated(BENT, 4, 1, NOISE)), {}, SIZE), "fisheye")
    assert done.found.form.name == "fisheye"
    assert done.compared == []
    assert done.looped is None


def test_the_command_writes_numbers_corners_and_page(tmp_path: Path) -> None:
    write_corners(tmp_path / "run.csv", simulated(BENT, 6, 2, NOISE), SIZE)
    files = [str(tmp_path / name) for name in ("again.csv", "run.json", "run.html")]
    called = ["camera", str(tmp_path / "run.csv"), "--lens", "k1 k2 p1 p2", "--corners", files[0]]
    result = CliRunner().invoke(app, [*called, "--json", files[1], "--html", files[2]])
    assert result.exit_code == 0, result.output
    assert "a lens with k1 k2 p1 p2: 6 pictures" in result.output
    assert "without distortion the residual shows `camera.distortion`" in result.output
    told = json.loads(Path(files[1]).read_text())
    assert told["values"]["f_x"] == pytest.approx(420.0, abs=5.0 * told["std"]["f_x"])
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "run.csv").read_text()
    page = Path(files[2]).read_text()
    assert page.count("<img") == 3
    assert "camera.distortion" in page


@pytest.mark.parametrize(
    ("text", "square", "marker", "says"),
    [
        ("9", 1.0, None, "--board: 9"),
        ("2x6", 1.0, None, "3 to 100"),
        ("9x6", 0.0, None, "--square"),
        ("9x6", 1.0, 1.5, "--marker"),
    ],
)
def test_a_board_that_is_none(text: str, square: float, marker: float | None, says: str) -> None:
    with pytest.raises(InputError, match=says):
        board_of(text, square, marker, "DICT_5X5_100", False)


def test_a_board_in_words() -> None:
    board = board_of("9x6", 0.025, None, "DICT_5X5_100", False)
    assert board is not None
    assert (board.columns, board.rows, board.square, board.marker) == (9, 6, 0.025, None)
    assert board_of(None, 1.0, None, "DICT_5X5_100", False) is None


def test_an_unknown_lens_is_an_error() -> None:
    with pytest.raises(InputError, match="mirror"):
        study(read_corners(LEFT), "mirror")


def test_the_lab_says_what_the_loop_found(tmp_path: Path) -> None:
    said: list[str] = []
    run_lab("camera", tmp_path, said.append)
    assert said[0] == "left02.jpg does not fit: 0.96 pixels RMS"
    assert said[2].startswith("without distortion the residual shows `camera.distortion`: 1.629 -> 0.239")
    assert (tmp_path / "camera.html").read_text().count("<img") == 3
