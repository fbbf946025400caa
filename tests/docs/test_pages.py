"""What the site is made of: figures for every effect that can have one, numbers with their comments, symbols, links."""

from __future__ import annotations

import inspect
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "docs" / "make"))

import check_links  # noqa: E402
import commands_page  # noqa: E402
import constants_page  # noqa: E402
import effect_figures  # noqa: E402
import effect_pages  # noqa: E402
import face_page  # noqa: E402
import residual_figures  # noqa: E402

import sinan  # noqa: E402
from sinan.experiments.benchmarks import bounds_of_work  # noqa: E402
from sinan.experiments.benchmarks.bounds_of_work import BOUNDS, CHOICES  # noqa: E402


def test_a_page_says_which_of_its_links_are_of_the_site_alone() -> None:
    """A clone has no `_generated`: the words before the first such link of a paragraph say where it leads."""
    for path in sorted((ROOT / "docs").rglob("*.md")):
        if path.is_relative_to(ROOT / "docs" / "_generated"):
            continue
        for paragraph in re.split(r"\n\n|\n(?=- )", path.read_text(encoding="utf-8")):
            before, link, _ = paragraph.partition("](_generated/")
            told = "on the site" in before.replace("\n", " ") or before.endswith("[Parameters")  # as face.md says above
            assert not link or told, f"{path.name}: {paragraph[:200]}"


def test_a_plot_is_shown_in_a_script() -> None:
    for name in ("README.md", "docs/ten_minutes.md"):
        for code in re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.DOTALL):
            drawn, _, after = code.rpartition(".plot_")
            assert not drawn or "plt.show()" in after, f"{name}: {code}"


def test_every_effect_has_its_figure() -> None:
    numbers = json.loads(effect_figures.NUMBERS.read_text(encoding="utf-8"))
    assert set(numbers) == set(effect_figures.CATALOGUE) == {path.stem for path in effect_figures.FOLDER.glob("*.png")}


def test_an_effect_in_the_model_takes_its_residual_away() -> None:
    numbers = json.loads(effect_figures.NUMBERS.read_text(encoding="utf-8"))
    for name, known in numbers.items():
        if len(known.get("nis_per_dof", ())) == 2:
            before, after = known["nis_per_dof"]
            assert before > after, name
            assert after < 1.25, name
        if "rms" in known:
            before, after = known["rms"]
            assert after < 0.6 * before, name


def test_the_page_of_every_effect_shows_its_figure() -> None:
    pages = "".join(effect_pages.pages().values())
    for name in effect_figures.CATALOGUE:
        assert f"figures/effects/{name}.png)" in pages, name


def test_a_figure_of_ranges_is_what_its_script_draws() -> None:
    kept = json.loads(effect_figures.NUMBERS.read_text(encoding="utf-8"))
    for name in ("pseudorange.troposphere", "pseudorange.satellite_fault"):
        drawn = residual_figures.ranges(name)
        assert drawn.beta == kept[name]["beta"]
        assert drawn.rms == pytest.approx(kept[name]["rms"], rel=0.01)


def test_residuals_with_the_effect_are_the_noise_that_was_simulated() -> None:
    """Of a camera 0.7 pixels; of the specific force 0.002 m/s^2 / sqrt(Hz) over 0.1 s."""
    kept = json.loads(effect_figures.NUMBERS.read_text(encoding="utf-8"))
    for name, known in kept.items():
        if name.startswith("camera."):
            assert known["rms"][1] == pytest.approx(0.7, rel=0.05), name
        if name.startswith("motion."):
            assert known["rms"][1] == pytest.approx(0.002 / 0.1**0.5, rel=0.05), name


def test_a_figure_is_what_its_script_draws() -> None:
    kept = json.loads(effect_figures.NUMBERS.read_text(encoding="utf-8"))["sonar.mount_offset"]
    effect = effect_figures.CATALOGUE["sonar.mount_offset"]
    stream, journal, beta = effect_figures._sized(effect, effect_figures.load_scenario(effect.scenario))
    assert (stream, beta) == (kept["stream"], kept["beta"])
    assert effect_figures._nis(journal.stream(stream)) == pytest.approx(kept["nis_per_dof"][0], rel=0.02)


def test_a_constant_is_read_with_its_comment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        "#: Chosen by the course, 2017.\nAA = 3.0\nBB = 4  # seen in logs: docs/notes/speed.md\n"
        "#: One of it.\nCC, DD = 3, 4\nEE = 0.5\n\nNAMES = ('a',)\nFF = 7\n"
        "\n#: Length of what a log has: of it.\nGG = 8\n#: A choice.\nHH = 9\n"
        "#: Share: a choice; twice moves it (`bounds_of_work few`).\nII = 10\n"
        "#: What is far: it is near to any of them, and no more; a choice.\nJJ = 11\n"
        "#: Readings that nobody has measured, since they are few [m/s^2].\nKK = 12\n"
        "#: Of four the sigma is known to a third, since two are left.\nLL = 13\nMM = 14\n"
        "#: Of a normal law norm.sf(3) is more.\nNN = 15\n#: Share: a choice; half moves it (`test_pages`).\nOO = 16\n"
    )
    (tmp_path / "part.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(constants_page, "ROOT", tmp_path)
    monkeypatch.setattr(constants_page, "FOLDERS", (".",))
    found = {c.name: c.origin for c in constants_page.constants()}
    none = dict.fromkeys(("CC, DD", "EE", "FF", "GG", "HH", "JJ", "KK", "MM"), "no origin")
    said = {"LL": "derived", "NN": "derived", "II": "choice", "OO": "choice"}
    assert found == {"AA": "cited", "BB": "measured", **none, **said}


def test_every_constant_has_an_origin() -> None:
    found = constants_page.constants()
    assert len(found) > 200
    assert [f"{c.module}.{c.name}" for c in found if c.origin == "no origin"] == []


def test_the_share_of_choices_is_as_the_page_of_limits_says() -> None:
    origins = [c.origin for c in constants_page.constants()]
    page = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
    said = re.search(r"[Aa]bout one in (\w+) of\s+the\s+constants", page)
    words = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    assert said is not None
    assert said[1] == words[round(len(origins) / origins.count("choice")) - 2]


def test_a_bound_of_work_or_a_choice_is_one_that_was_halved_and_doubled() -> None:
    """By the command, in a case that the comment names, or by a test that it names, which knows the constant."""
    tried = {
        (f"{module.removeprefix('sinan.')}.{name}", case)
        for case, constants in (*BOUNDS.items(), *CHOICES.items())
        for module, names in constants.items()
        for name in names
    }
    tests = {path.stem: path.read_text(encoding="utf-8") for path in (constants_page.ROOT / "tests").rglob("test_*.py")}
    for c in constants_page.constants():
        if c.origin not in ("bound of work", "choice"):
            continue
        said = set(re.findall(r"`(?:bounds_of_work )?(\w+)`", c.comment))
        where = c.module.replace("/", ".")
        for name in c.name.split(", "):
            by_test = any(re.search(rf"\b{name}\b", tests[one]) for one in said & tests.keys())
            assert by_test or any((f"{where}.{name}", case) in tried for case in said), (where, name, said)


def test_half_and_twice_of_a_bound_are_given_and_taken_back(capsys: pytest.CaptureFixture[str]) -> None:
    found = bounds_of_work.main(["camera"])
    assert max(max(moves) for moves in found.values()) < 1e-3
    usual = bounds_of_work.CASES["camera"]()
    assert bounds_of_work.moved("camera", "sinan.calibration.cameras.damped", "_ROUNDS", 0.01, usual) > 1e-3
    assert bounds_of_work.moved("camera", "sinan.calibration.cameras.damped", "_ROUNDS", 1.0, usual) == 0.0


def test_every_command_and_option_is_on_the_page_of_the_command_line() -> None:
    page = commands_page.page()
    assert "## sinan trace" in page
    assert "| `--alpha NUMBER` | risk of any false alarm, over all candidates together | `0.01` |" in page
    assert re.search(r"\| `calibrate`|sinan calibrate", page)


def test_every_name_of_the_face_is_on_its_page_with_every_parameter() -> None:
    sections = dict(re.findall(r"^## `([\w.]+)`$(.*?)(?=^## |\Z)", face_page.page(), re.MULTILINE | re.DOTALL))
    assert "**Type** `str`" in sections["sinan.__version__"]
    for name in sinan.__all__:
        if name == "testing":
            assert {f"sinan.testing.{one}" for one in sinan.testing.__all__} <= set(sections)
            continue
        what = getattr(sinan, name)
        text = sections[f"sinan.{name}"].partition("\n### ")[0]
        has_fields = inspect.isclass(what) and name not in ("SensorModel", "InputError")
        given = inspect.signature(what).parameters if inspect.isfunction(what) or has_fields else {}
        for parameter in given:
            (meaning,) = re.findall(rf"^\| `{parameter}` \|.* \| ([^|]*) \|$", text, re.MULTILINE)
            assert meaning.strip(), (name, parameter)


def test_no_parameter_of_the_face_is_without_a_meaning() -> None:
    """Methods too; of an answer's `to_html` and a model's `predict` what the interface says."""
    assert face_page.undocumented() == []


def test_a_docstring_is_read_part_by_part() -> None:
    said = face_page.read(
        """What it does.

        z = H x

        Parameters
        ----------
        a, b : of both [m];
            and more
        *rest : others

        Neglects drag.

        Returns
        -------
        (n,) m

        Raises
        ------
        InputError : wrong
        """
    )
    assert said.text.split("\n\n") == ["What it does.", "z = H x", "\nNeglects drag."]
    assert said.parameters == {"a": "of both [m]; and more", "b": "of both [m]; and more", "rest": "others"}
    assert (said.returns, said.tables["Raises"]) == ("(n,) m", {"InputError": "wrong"})


def test_the_vocabulary_names_files_that_are_there() -> None:
    text = (ROOT / "docs" / "vocabulary.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:sensors|estimator|calibration|experiments)/[\w/]+\.py)`", text)
    assert len(named) > 30
    assert not [path for path in named if not (ROOT / path).is_file()]


def test_the_mathematics_names_modules_that_are_there() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "maths").glob("*.md"))
    named = re.findall(r"`((?:sensors|estimator|calibration|experiments)/[\w/]+\.py)`", text)
    assert len(named) > 15
    assert not [path for path in named if not (ROOT / path).is_file()]


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a href="b.html#here">x</a><a href="https://x.org">y</a>', encoding="utf-8")
    (tmp_path / "b.html").write_text('<p id="there"></p><img src="https://x.org/i.png">', encoding="utf-8")
    wrong, elsewhere = check_links.check(tmp_path)
    assert len(wrong) == 2
    assert elsewhere == ["https://x.org"]
