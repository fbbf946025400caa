"""Labs for students: the solved notebook is right, known mistakes are told apart, and nothing gives the key."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.files import ANSWER, begin, check_file, notebook
from sinan.experiments.student_labs.lab import check, drawn, lab_of
from sinan.sensors.errors import InputError

STUDENTS = ("20260001", "张三", "a b")


@pytest.mark.parametrize("name", TITLES)
def test_the_solved_notebook_is_right_for_every_student(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k, student in enumerate(STUDENTS):
        folder = tmp_path / str(k)
        begin(name, student, folder, "zh" if k else "en", "", tmp_path / "key.json", solved=True)
        monkeypatch.chdir(folder)
        exec(compile((folder / f"{name}.py").read_text(encoding="utf-8"), name, "exec"), {})
        told, right = check_file(name, folder / ANSWER, "en")
        assert right, told


@pytest.mark.parametrize("name", TITLES)
def test_both_languages_have_the_same_code_and_as_many_texts(name: str) -> None:
    cells = [re.split(r"^# %%(.*)\n", notebook(name, language), flags=re.MULTILINE) for language in ("en", "zh")]
    code = [[text for head, text in zip(c[1::2], c[2::2], strict=True) if not head] for c in cells]
    assert [re.sub("your code|请填写", "", text) for text in code[0]] == [
        re.sub("your code|请填写", "", text) for text in code[1]
    ]
    assert len(cells[0]) == len(cells[1])
    assert not re.search(r"[\u4e00-\u9fff]", notebook(name, "en"))
    assert not re.search(r"# (en|zh):|^# (solution|end)$", notebook(name, "zh", True), re.MULTILINE)
    compile(notebook(name, "en"), name, "exec")


@pytest.mark.parametrize("name", TITLES)
def test_the_chinese_is_in_the_terms_of_the_course(name: str) -> None:
    """Common words of other books for what the course has its own words for (docs/course_terms.md)."""
    told = notebook(name, "zh") + "".join(
        words["zh"] for q in lab_of(name).questions for words in (q.hint, *(m.hint for m in q.mistakes))
    )
    others = ("磁强计", "比例因子", "标度因数", "零偏", "参考站", "超声波传感器", "代价函数", "航向")
    assert not [word for word in others if word in told]


@pytest.mark.parametrize("name", TITLES)
def test_a_known_mistake_has_its_hint_and_no_hint_tells_the_answer(name: str) -> None:
    data, _ = drawn(name, "someone")
    for question in lab_of(name).questions:
        far = [7.2e8] * question.size  # as angles: level
        (wrong,) = (v for v in check(name, data, {question.name: far}) if v.name == question.name)
        assert not wrong.right
        assert wrong.hint == question.hint["en"]
        assert question.hint["zh"] != question.hint["en"]
        for mistake in question.mistakes:
            given = mistake.answer(data).ravel().tolist()
            (found,) = (v for v in check(name, data, {question.name: given}) if v.name == question.name)
            assert not found.right
            assert found.hint == mistake.hint["en"], question.name
            if question.solve is not None:  # no number of the answer stands in a hint
                shown = {f"{abs(x):.3g}" for x in np.atleast_1d(question.solve(data)).ravel() if abs(x) > 10.0}
                assert not shown & set(re.findall(r"[\d.]+", mistake.hint["en"] + question.hint["en"]))


@pytest.mark.parametrize("name", TITLES)
def test_each_student_has_data_of_their_own(name: str) -> None:
    one, again, other, secret = (drawn(name, *who)[0] for who in (("1",), ("1",), ("2",), ("1", "chalk")))
    last = next(iter(one))
    assert all(np.array_equal(one[c], again[c], equal_nan=True) for c in one)
    column = "pressure" if name == "heights" else "wz" if name == "gyroscope" else last
    assert not np.array_equal(one[column], other[column])
    assert not np.array_equal(one[column], secret[column])


def test_the_key_lies_apart_and_bad_input_is_said(tmp_path: Path) -> None:
    folder, key = tmp_path / "student", tmp_path / "key.json"
    begin("gps", "1", folder, "en", "chalk", key, False)
    assert sorted(p.name for p in folder.iterdir()) == ["data.csv", "gps.py"]
    assert "clock" in json.loads(key.read_text())["drawn"]
    with pytest.raises(InputError, match="student's folder"):
        begin("gps", "1", folder, "en", "", folder / "key.json", False)
    with pytest.raises(InputError, match="no JSON"):
        check_file("gps", folder / ANSWER, "en")
    (folder / ANSWER).write_text('{"clock": "late", "position": [1, 2], "satellite": null}')
    told, right = check_file("gps", folder / ANSWER, "zh")
    assert not right
    assert all(words in told for words in ("不是数值", "应为 3 个", "未作答", "4 题中 0 题正确"))
    (folder / "data.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="columns a,b"):
        check_file("gps", folder / ANSWER, "en")
