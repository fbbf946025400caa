"""A lab on disk: data, notebook with gaps (or solved), seals, answer; the teacher's key apart from them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.lab import (
    Data,
    Language,
    Seals,
    Verdict,
    Words,
    check,
    drawn,
    lab_of,
    practice,
    root,
    seals_of,
    solutions_of,
)
from sinan.experiments.student_labs.seals import Seal
from sinan.sensors.errors import InputError
from sinan.sensors.files import resolved, together, write_text

DATA, ANSWER, SEALS = "data.csv", "answer.json", "seals.json"
#: A secret that is shorter is guessed sooner or later.
SHORTEST = 12
_HERE = Path(__file__).parent
_GAP = re.compile(r"^# gap\n", re.MULTILINE)


@dataclass(frozen=True)
class Kind:
    """What a student is given: language; the solved notebook; seals, without which only a teacher can check."""

    language: Language = "en"
    solved: bool = False
    sealed: bool = True


def notebook(name: str, language: Language = "en", solved: bool = False) -> str:
    """The notebook as jupytext's percent format: text of one language, gaps or what belongs there.

    In the source a line `# en:` or `# zh:` is of one language, `# gap` is a gap; `solutions` has what fills them.

    Raises
    ------
    InputError : no such lab; solved, in an installation without solutions
    """
    lab_of(name)
    source = (_HERE / "texts" / f"{name}.notebook").read_text(encoding="utf-8")
    other = "zh" if language == "en" else "en"
    kept = [line for line in source.splitlines() if not line.startswith(f"# {other}:")]
    text = "\n".join(re.sub(rf"^# {language}:", "#", line) for line in kept) + "\n"
    if not solved:
        return _GAP.sub(Words("...  # your code", "...  # 请填写")[language] + "\n", text)
    solutions_of(name)
    filled = iter((_HERE / "solutions" / f"{name}.notebook").read_text(encoding="utf-8").split("# %%\n"))
    return _GAP.sub(lambda _: next(filled), text)


def begin(name: str, student: str, out: Path, kind: Kind, secret: str = "", key: Path | None = None) -> str:
    """Write a student's data, notebook and seals into `out`; with `key` the teacher's key, which is nowhere in `out`.

    Raises
    ------
    InputError : no such lab, no student, a short secret, a key that would lie in `out`, or no solutions to seal
    """
    if not student.strip():
        raise InputError("--student", "no name", "the student's number or name")
    if key is not None and resolved(out) in resolved(key).parents:
        raise InputError(key, "in the student's folder", "a place apart from it")
    _require_long(secret)
    data, hidden = drawn(name, student, secret)
    with together():
        write_text(out / DATA, _as_csv(data))
        write_text(out / f"{name}.py", notebook(name, kind.language, kind.solved))
        if kind.sealed:
            write_text(out / SEALS, json.dumps(_sealed(name, student, secret, data), indent=1) + "\n")
        if key is not None:
            answers = {q: np.ravel(how.solve(data)).tolist() for q, how in solutions_of(name).items()}
            document = {"lab": name, "student": student, "drawn": dict(hidden), "answers": answers}
            write_text(key, json.dumps(document, indent=1) + "\n")
    return f"{TITLES[name][kind.language == 'zh']}: {out / DATA}, {out / (name + '.py')}"


def check_file(name: str, answer: Path, language: Language, student: str = "", secret: str = "") -> tuple[str, bool]:
    """What is right in an answer, in sentences; whether all of it is.

    By the data and seals beside the answer; with a secret by those that are drawn again, whatever lies there.

    Raises
    ------
    InputError : files that cannot be read, or of another lab
    """
    lab_of(name)
    given = _read_answer(answer)
    if secret:
        data, salt = drawn(name, student, secret)[0], ""
        seals = seals_of(name, data, salt)
    else:
        data = _read_data(answer.parent / DATA, tuple(drawn(name, "columns")[0]))
        seals, salt = _read_seals(answer.parent / SEALS, name)
    verdicts = check(name, data, seals, salt, given, language)
    return _in_words(verdicts, language), all(v.right for v in verdicts)


def practice_seals(name: str, number: int) -> Mapping[str, object]:
    """The seals of one set of data for practice, as in a file; needs the solutions."""
    student = next(str(k) for k in range(10_000) if practice(str(k)) == number)
    salt = sha256(f"practice {name} {number}".encode()).hexdigest()[:16]
    return _written(seals_of(name, drawn(name, student)[0], salt), salt)


def _sealed(name: str, student: str, secret: str, data: Data) -> Mapping[str, object]:
    """The document of the seals; without a secret those that are installed."""
    if not secret:
        table = json.loads((_HERE / "practice.json").read_text(encoding="utf-8"))
        return {"lab": name, **table[name][practice(student)]}
    salt = sha256(b"salt" + root(name, student, secret)).hexdigest()[:16]
    return {"lab": name, **_written(seals_of(name, data, salt), salt)}


def _written(seals: Seals, salt: str) -> Mapping[str, object]:
    return {"salt": salt, "seals": {q: [[*s.shift, s.mark] for s in each] for q, each in seals.items()}}


def _require_long(secret: str) -> None:
    if secret and len(secret) < SHORTEST:
        raise InputError("--secret", f"{len(secret)} characters", f"{SHORTEST} or more, of your own or drawn")


def _in_words(verdicts: list[Verdict], language: Language) -> str:
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


def _read_seals(path: Path, name: str) -> tuple[Seals, str]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        seals = {
            q: tuple(Seal(tuple(map(float, s[:-1])), str(s[-1])) for s in each) for q, each in document["seals"].items()
        }
        lab, salt = document["lab"], str(document["salt"])
    except OSError:
        raise InputError(path, "no seals", "without them only your teacher can check: --student and --secret") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(path, "no seals", f"the {SEALS} that `sinan lab begin` wrote") from None
    if lab != name:
        raise InputError(path, f"the lab `{lab}`", f"sinan lab check {lab}")
    return seals, salt


def _read_answer(path: Path) -> Mapping[str, object]:
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(path, "no JSON", "the answer.json that the notebook writes") from None
    if not isinstance(given, dict):
        raise InputError(path, "no entries", "one entry a question")
    return given
