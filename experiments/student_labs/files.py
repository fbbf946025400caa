"""A lab on disk: data, notebook with gaps (or solved), answer; the teacher's key apart from them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.lab import Data, Language, Verdict, Words, check, drawn, lab_of
from sinan.sensors.errors import InputError
from sinan.sensors.files import together, write_text

DATA, ANSWER = "data.csv", "answer.json"
_TEXTS = Path(__file__).parent / "texts"
_SOLUTION = re.compile(r"^# solution\n(.*?)^# end\n", re.MULTILINE | re.DOTALL)


def notebook(name: str, language: Language = "en", solved: bool = False) -> str:
    """The notebook as jupytext's percent format: text of one language, gaps in place of the solution.

    In the source a line `# en:` or `# zh:` is of one language; what is between `# solution` and `# end` is a gap.
    """
    lab_of(name)
    source = (_TEXTS / f"{name}.notebook").read_text(encoding="utf-8")
    other = "zh" if language == "en" else "en"
    kept = [line for line in source.splitlines() if not line.startswith(f"# {other}:")]
    text = "\n".join(re.sub(rf"^# {language}:", "#", line) for line in kept) + "\n"
    gap = Words("...  # your code", "...  # 请填写")[language] + "\n"
    return _SOLUTION.sub(lambda found: found[1] if solved else gap, text)


def begin(name: str, student: str, out: Path, language: Language, secret: str, key: Path | None, solved: bool) -> str:
    """Write a student's data and notebook into `out`; with `key` the teacher's key, which is nowhere in `out`.

    Raises
    ------
    InputError : no such lab, no student, or a key that would lie in `out`
    """
    if not student.strip():
        raise InputError("--student", "no name", "the student's number or name")
    if key is not None and out.resolve() in key.resolve().parents:
        raise InputError(key, "in the student's folder", "a place apart from it")
    data, hidden = drawn(name, student, secret)
    with together():
        write_text(out / DATA, _as_csv(data))
        write_text(out / f"{name}.py", notebook(name, language, solved))
        if key is not None:
            write_text(key, json.dumps({"lab": name, "student": student, "drawn": dict(hidden)}, indent=1) + "\n")
    return f"{TITLES[name][language == 'zh']}: {out / DATA}, {out / (name + '.py')}"


def check_file(name: str, answer: Path, language: Language) -> tuple[str, bool]:
    """What is right in an answer beside its data, in sentences; whether all of it is.

    Raises
    ------
    InputError : files that cannot be read
    """
    lab_of(name)
    given = _read_answer(answer)
    data = _read_data(answer.parent / DATA, tuple(drawn(name, "columns")[0]))
    verdicts = check(name, data, given, language)
    return _told(verdicts, language), all(v.right for v in verdicts)


def _told(verdicts: list[Verdict], language: Language) -> str:
    levels = {
        "basic": Words("basic", "基础实验"),
        "analysis": Words("analysis", "分析实验"),
        "design": Words("design", "设计实验"),
    }
    right = Words("right", "正确")[language]
    lines = [f"{levels[v.level][language]:10} {v.name:14} {right if v.right else v.hint}" for v in verdicts]
    count = sum(v.right for v in verdicts)
    total = Words(f"{count} of {len(verdicts)} are right", f"{len(verdicts)} 题中 {count} 题正确")[language]
    return "\n".join([*lines, total])


def _as_csv(data: Data) -> str:
    rows = np.stack(list(data.values()), axis=1)
    return "\n".join([",".join(data), *(",".join(f"{x:.10g}" for x in row) for row in rows)]) + "\n"


def _read_data(path: Path, columns: tuple[str, ...]) -> Data:
    try:
        head, *rows = path.read_text(encoding="utf-8").splitlines()
        values = np.array([[float(x) for x in row.split(",")] for row in rows])
        assert values.ndim == 2
    except (OSError, ValueError, AssertionError):
        raise InputError(
            path, "no table of numbers", "the data.csv that `sinan lab begin` wrote beside the answer"
        ) from None
    names = tuple(head.split(","))
    if names != columns:
        raise InputError(path, f"columns {head}", ",".join(columns))
    return {name: values[:, k] for k, name in enumerate(names)}


def _read_answer(path: Path) -> Mapping[str, object]:
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(path, "no JSON", "the answer.json that the notebook writes") from None
    if not isinstance(given, dict):
        raise InputError(path, "no entries", "one entry a question")
    return given
