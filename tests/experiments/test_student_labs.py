"""Labs for students: the solved notebook is right, known mistakes are told apart, and nothing gives the key."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.student_labs import TITLES, seals
from sinan.experiments.student_labs.files import ANSWER, Kind, begin, check_file, notebook
from sinan.experiments.student_labs.lab import check, drawn, lab_of, practice, seals_of, solutions_of
from sinan.sensors.errors import InputError

STUDENTS = ("20260001", "张三", "a b")
SECRET = "chalk and sponge"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seals that are cheap to make: what they let through does not depend on their cost."""
    monkeypatch.setattr(seals, "_TRY", 2)
    monkeypatch.setattr(seals, "_SECRET", 2)


def solve(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the notebook in its folder."""
    monkeypatch.chdir(folder)
    exec(compile((folder / f"{name}.py").read_text(encoding="utf-8"), name, "exec"), {})


@pytest.mark.parametrize("name", TITLES)
def test_the_solved_notebook_is_right_for_every_student(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    for k, student in enumerate(STUDENTS):
        folder = tmp_path / str(k)
        begin(name, student, folder, Kind("zh" if k else "en", solved=True), SECRET, tmp_path / "key.json")
        solve(name, folder, monkeypatch)
        told, right = check_file(name, folder / ANSWER, "en")
        assert right, told
        assert check_file(name, folder / ANSWER, "en", student, SECRET)[1]  # by the secret, whatever lies in the folder
        assert not check_file(name, folder / ANSWER, "en", "someone else", SECRET)[1]


@pytest.mark.parametrize("name", TITLES)
def test_the_seals_that_are_installed_are_those_of_the_labs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(name, "20260001", tmp_path, Kind(solved=True))
    solve(name, tmp_path, monkeypatch)
    told, right = check_file(name, tmp_path / ANSWER, "en")
    assert right, told


@pytest.mark.parametrize("name", TITLES)
def test_the_notebook_names_what_is_to_be_answered(name: str) -> None:
    for language in ("en", "zh"):
        text = notebook(name, language)
        assert not [q.name for q in lab_of(name).questions if f"`{q.name}`" not in text]


@pytest.mark.parametrize("name", TITLES)
def test_both_languages_have_the_same_code_and_as_many_texts(name: str) -> None:
    cells = [re.split(r"^# %%(.*)\n", notebook(name, language), flags=re.MULTILINE) for language in ("en", "zh")]
    code = [[text for head, text in zip(c[1::2], c[2::2], strict=True) if not head] for c in cells]
    assert [re.sub("your code|请填写", "", text) for text in code[0]] == [
        re.sub("your code|请填写", "", text) for text in code[1]
    ]
    assert len(cells[0]) == len(cells[1])
    assert not re.search(r"[\u4e00-\u9fff]", notebook(name, "en"))
    assert not re.search(r"# (en|zh):|^# gap$", notebook(name, "zh", True), re.MULTILINE)
    compile(notebook(name, "en"), name, "exec")


@pytest.mark.parametrize("name", TITLES)
def test_a_known_mistake_has_its_hint_and_no_hint_tells_the_answer(name: str, quick: None) -> None:
    data, _ = drawn(name, "someone")
    sealed, solutions = seals_of(name, data, ""), solutions_of(name)

    def told(question: str, answer: object) -> tuple[bool, str]:
        (found,) = (v for v in check(name, data, sealed, "", {question: answer}) if v.name == question)
        return found.right, found.hint

    for question in lab_of(name).questions:
        assert told(question.name, [7.2e8 + 90.0] * question.size) == (False, question.hint.en)
        assert question.hint.zh != question.hint.en
        if question.accept is not None:
            continue
        how = solutions[question.name]
        answer = np.atleast_1d(how.solve(data)).ravel()
        assert told(question.name, (answer + 0.99 * question.tolerance).tolist())[0]
        assert not told(question.name, (answer + 1.01 * question.tolerance).tolist())[0]
        shown = {f"{abs(x):.3g}" for x in answer if abs(x) > 10.0}
        for made, mistake in zip(how.mistakes, question.mistakes, strict=True):
            assert told(question.name, np.ravel(made(data)).tolist()) == (False, mistake.hint.en), question.name
            assert not shown & set(re.findall(r"[\d.]+", mistake.hint.en + question.hint.en))


@pytest.mark.parametrize("name", TITLES)
def test_each_student_has_data_of_their_own(name: str, quick: None) -> None:
    assert practice("1") != practice("2")
    one, again, *others = (
        drawn(name, *who)[0] for who in (("1",), ("1",), ("2",), ("1", SECRET), ("2", SECRET), ("1", SECRET + "s"))
    )
    assert all(np.array_equal(one[c], again[c], equal_nan=True) for c in one)
    column = max(one, key=lambda c: np.sum(one[c] != others[0][c]))
    tables = [one[column], *(other[column] for other in others)]
    assert all(not np.array_equal(a, b) for k, a in enumerate(tables) for b in tables[:k])


def test_the_key_lies_apart_and_bad_input_is_said(tmp_path: Path, quick: None) -> None:
    folder, key = tmp_path / "student", tmp_path / "key.json"
    begin("gps", "1", folder, Kind(), SECRET, key)
    assert sorted(p.name for p in folder.iterdir()) == ["data.csv", "gps.py", "seals.json"]
    told = json.loads(key.read_text())
    assert "clock" in told["drawn"]
    digits = {f"{abs(x):.6g}" for answer in told["answers"].values() for x in answer if abs(x) > 10.0}
    assert not any(number in (folder / "seals.json").read_text() for number in digits)
    with pytest.raises(InputError, match="student's folder"):
        begin("gps", "1", folder, Kind(), key=folder / "key.json")
    with pytest.raises(InputError, match="12 or more"):
        begin("gps", "1", folder, Kind(), "chalk")
    with pytest.raises(InputError, match="no JSON"):
        check_file("gps", folder / ANSWER, "en")
    (folder / ANSWER).write_text('{"clock": "late", "position": [1, 2], "satellite": null}')
    said, right = check_file("gps", folder / ANSWER, "zh")
    assert not right
    assert all(words in said for words in ("不是数值", "应为 3 个", "未作答", "4 题中 0 题正确"))
    with pytest.raises(InputError, match="the lab `gps`"):
        check_file("loop", _with_columns(folder, "loop"), "en")
    (folder / "data.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="columns a,b"):
        check_file("gps", folder / ANSWER, "en")


def _with_columns(folder: Path, name: str) -> Path:
    """The answer, with a table of another lab's columns beside it."""
    columns = list(drawn(name, "1")[0])
    (folder / "data.csv").write_text(",".join(columns) + "\n" + ",".join("1" for _ in columns) + "\n")
    return folder / ANSWER


def test_without_seals_or_without_solutions_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    begin("gps", "1", tmp_path / "exam", Kind(sealed=False), SECRET)
    (tmp_path / "exam" / ANSWER).write_text("{}")
    with pytest.raises(InputError, match="only your teacher can check"):
        check_file("gps", tmp_path / "exam" / ANSWER, "en")
    monkeypatch.setitem(sys.modules, "sinan.experiments.student_labs.solutions.gps", None)
    begin("gps", "1", tmp_path / "practice", Kind())  # data, gaps and seals are installed
    for how in (Kind(solved=True), Kind()):
        with pytest.raises(InputError, match="without solutions"):
            begin("gps", "1", tmp_path / "more", how, "" if how.solved else SECRET)
