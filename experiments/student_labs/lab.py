"""What a lab for students is: data from a seed, questions, and for each the mistakes that are known.

What is here, and in the module of each lab, is in every installation. How to solve a question is in `solutions`, which
is left out of the wheel: the check needs none of it, only the seals that were made with it (`seals`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import numpy as np

from sinan.experiments.student_labs import TITLES
from sinan.experiments.student_labs.seals import Seal, opens, sealed, stretched
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

Data = Mapping[str, FloatArray]
Level = Literal["basic", "analysis", "design"]
Language = Literal["en", "zh"]
#: By question: the seal of the right answer, then those of the known mistakes in their order.
Seals = Mapping[str, tuple[Seal, ...]]
#: Without a teacher's secret a student has one of so many sets of data; their seals are in `practice.json`.
PRACTICE = 16


@dataclass(frozen=True)
class Words:
    """A sentence in English and in Chinese."""

    en: str
    zh: str

    def __getitem__(self, language: Language) -> str:
        return self.zh if language == "zh" else self.en


@dataclass(frozen=True)
class Mistake:
    """What is said of a mistake that gives an answer of its own, and how near to that an answer is taken for it."""

    hint: Words
    within: float = np.inf


@dataclass(frozen=True)
class Question:
    """One entry of an answer.

    Attributes
    ----------
    name : its key in `answer.json`
    level : basic, analysis or design
    size : how many numbers
    tolerance : largest error of each number
    hint : said of a wrong answer that no known mistake explains
    mistakes : known ones, the likeliest first
    accept : where many answers are right: (data, answer) -> whether it is; there is no seal then
    """

    name: str
    level: Level
    size: int
    tolerance: float
    hint: Words
    mistakes: tuple[Mistake, ...] = ()
    accept: Callable[[Data, FloatArray], bool] | None = None

    def width(self, k: int) -> float:
        """Width of the cells of the right answer (k = 0), or of mistake k, counted from 1."""
        return 2.0 * (self.tolerance if k == 0 else min(self.tolerance, self.mistakes[k - 1].within))


@dataclass(frozen=True)
class Lab:
    """A lab: what it draws for a student, and what it asks.

    Attributes
    ----------
    make : (rng) -> the data, columns of one length; the key, what was drawn
    questions : in the order of the notebook
    """

    make: Callable[[np.random.Generator], tuple[Data, Mapping[str, object]]]
    questions: tuple[Question, ...]


@dataclass(frozen=True)
class Solution:
    """How a question is solved, from the data alone; and what each of its known mistakes gives, in their order."""

    solve: Callable[[Data], FloatArray]
    mistakes: tuple[Callable[[Data], FloatArray], ...] = ()


@dataclass(frozen=True)
class Verdict:
    """What the check says of one entry."""

    name: str
    level: Level
    right: bool
    hint: str


def lab_of(name: str) -> Lab:
    """A lab by its name.

    Raises
    ------
    InputError : there is none
    """
    if name not in TITLES:
        raise InputError("lab", f"no lab for students `{name}`", "one of " + ", ".join(TITLES))
    lab: Lab = import_module(f"sinan.experiments.student_labs.{name}").LAB
    return lab


def solutions_of(name: str) -> Mapping[str, Solution]:
    """How the questions of a lab are solved; those with `accept` are not in it.

    Raises
    ------
    InputError : no such lab, or an installation without solutions
    """
    lab_of(name)
    try:
        module = import_module(f"sinan.experiments.student_labs.solutions.{name}")
    except ModuleNotFoundError:
        raise InputError(
            "lab", "an installation without solutions", "a clone of the project: that is for teachers"
        ) from None
    found: Mapping[str, Solution] = module.SOLUTIONS
    return found


def practice(student: str) -> int:
    """Which of the sets of data a student has who has no teacher."""
    return int.from_bytes(hashlib.sha256(student.encode()).digest()[:8]) % PRACTICE


def root(name: str, student: str, secret: str = "") -> bytes:
    """What all that is drawn for a student comes from: the same for the same three words.

    scrypt(secret; lab, student); without a secret SHA-256(lab, number of the set), which everyone can draw
    """
    if secret:
        return stretched(secret, f"{name}\n{student}")
    return hashlib.sha256(f"{name}\n{practice(student)}".encode()).digest()


def drawn(name: str, student: str, secret: str = "") -> tuple[Data, Mapping[str, object]]:
    """The data of a student, as they are in the file, and the key: what was drawn."""
    data, key = lab_of(name).make(
        np.random.default_rng(np.random.SeedSequence(int.from_bytes(root(name, student, secret))))
    )
    return {c: np.array([float(f"{x:.10g}") for x in column]) for c, column in data.items()}, key


def seals_of(name: str, data: Data, salt: str) -> Seals:
    """The seals of the right answers and of the known mistakes; needs the solutions."""
    found, solutions = dict[str, tuple[Seal, ...]](), solutions_of(name)
    for question in lab_of(name).questions:
        if question.accept is None:
            entry = solutions[question.name]
            values = [np.atleast_1d(how(data)).ravel() for how in (entry.solve, *entry.mistakes)]
            found[question.name] = tuple(
                sealed(value, question.width(k), f"{salt} {question.name} {k}") for k, value in enumerate(values)
            )
    return found


def check(
    name: str, data: Data, seals: Seals, salt: str, answer: Mapping[str, object], language: Language = "en"
) -> list[Verdict]:
    """What is right in an answer, and a hint for what is not. The right answer is never in it."""
    verdicts = []
    for question in lab_of(name).questions:
        right, hint = _judged(question, data, seals.get(question.name, ()), salt, answer.get(question.name))
        verdicts.append(Verdict(question.name, question.level, right, "" if right else hint[language]))
    return verdicts


_NO_HINT = Words("", "")


def _judged(question: Question, data: Data, seals: tuple[Seal, ...], salt: str, given: object) -> tuple[bool, Words]:
    """Whether an entry is right, and what to say of it if not."""
    if given is None:
        return False, Words("not answered", "未作答")
    try:
        value = np.atleast_1d(np.asarray(given, dtype=np.float64)).ravel()
    except (TypeError, ValueError):
        return False, Words("not a number", "不是数值")
    if value.shape != (question.size,):
        en, zh = f"{value.size} numbers; expected {question.size}", f"有 {value.size} 个数；应为 {question.size} 个"
        return False, Words(en, zh)
    if not np.all(np.isfinite(value)):
        return False, Words("not finite", "不是有限数")
    if question.accept is not None:
        return question.accept(data, value), question.hint
    for k, seal in enumerate(seals):
        if opens(seal, value, question.width(k), f"{salt} {question.name} {k}"):
            return (True, _NO_HINT) if k == 0 else (False, question.mistakes[k - 1].hint)
    return False, question.hint
