"""What a lab for students is: data from a seed, questions, and for each the mistakes that are known."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import numpy as np

from sinan.experiments.student_labs import TITLES
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: An answer is taken for a known mistake's where each number is within this share of it.
_ALIKE = 0.05
Data = Mapping[str, FloatArray]
Level = Literal["basic", "analysis", "design"]
Language = Literal["en", "zh"]


@dataclass(frozen=True)
class Words:
    """A sentence in English and in Chinese."""

    en: str
    zh: str

    def __getitem__(self, language: Language) -> str:
        return self.zh if language == "zh" else self.en


@dataclass(frozen=True)
class Mistake:
    """A mistake that gives an answer of its own: how it comes about, and what to say of it."""

    answer: Callable[[Data], FloatArray]
    hint: Words


@dataclass(frozen=True)
class Question:
    """One entry of an answer.

    Attributes
    ----------
    name : its key in `answer.json`
    level : basic, analysis or design
    size : how many numbers
    solve : the data -> the right answer, from the data alone
    tolerance : largest error of each number
    hint : said of a wrong answer that no known mistake explains
    mistakes : known ones, the likeliest first
    accept : in place of `solve` where many answers are right: (data, answer) -> whether it is
    """

    name: str
    level: Level
    size: int
    tolerance: float
    hint: Words
    solve: Callable[[Data], FloatArray] | None = None
    mistakes: tuple[Mistake, ...] = ()
    accept: Callable[[Data, FloatArray], bool] | None = None


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


def drawn(name: str, student: str, secret: str = "") -> tuple[Data, Mapping[str, object]]:
    """The data of a student, and the key: the same for the same three words, unlike for any others.

    seed = HMAC-SHA256(secret, lab, student)

    Parameters
    ----------
    student : number or name, as it is
    secret : of the teacher; without it everyone can draw what everyone has
    """
    digest = hmac.new(secret.encode(), f"{name}\n{student}".encode(), hashlib.sha256).digest()
    return lab_of(name).make(np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest))))


def check(name: str, data: Data, answer: Mapping[str, object], language: Language = "en") -> list[Verdict]:
    """What is right in an answer, and a hint for what is not. The right answer is never in it."""
    return [_judged(question, data, answer.get(question.name), language) for question in lab_of(name).questions]


def _judged(question: Question, data: Data, given: object, language: Language) -> Verdict:
    name, level = question.name, question.level
    if given is None:
        return Verdict(name, level, False, Words("not answered", "未作答")[language])
    try:
        value = np.atleast_1d(np.asarray(given, dtype=np.float64)).ravel()
    except (TypeError, ValueError):
        return Verdict(name, level, False, Words("not a number", "不是数值")[language])
    if value.shape != (question.size,):
        text = Words(
            f"{value.size} numbers; expected {question.size}", f"有 {value.size} 个数；应为 {question.size} 个"
        )
        return Verdict(name, level, False, text[language])
    if not np.all(np.isfinite(value)):
        return Verdict(name, level, False, Words("not finite", "不是有限数")[language])
    if question.accept is not None:
        right = question.accept(data, value)
    else:
        assert question.solve is not None
        right = _close(value, question.solve(data), question.tolerance)
    if right:
        return Verdict(name, level, True, "")
    for mistake in question.mistakes:
        made = np.atleast_1d(mistake.answer(data)).ravel()
        if _close(value, made, np.minimum(question.tolerance or np.inf, _ALIKE * np.abs(made))):
            return Verdict(name, level, False, mistake.hint[language])
    return Verdict(name, level, False, question.hint[language])


def _close(value: FloatArray, expected: FloatArray, tolerance: FloatArray | float) -> bool:
    return bool(np.all(np.abs(value - np.atleast_1d(expected).ravel()) <= tolerance))
