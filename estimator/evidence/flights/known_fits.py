"""Fits of a flight that were asked before: each costs a dozen filter passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sinan.estimator.evidence.flights.passes import Fitted
from sinan.estimator.evidence.source import Part
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import Effect
from sinan.sensors.recording import Recording

#: Fits that are kept, and the IMU samples of all of them together, each of which costs some 1,900 bytes:
#: 5e5 * 1900 = 950 MB.
_MOST_FITS, _MOST_SAMPLES = 8, 5e5


@dataclass(frozen=True)
class Question:
    """Terms, with the probes behind them, first values and part of a fit."""

    terms: tuple[tuple[Term, Effect | None], ...]
    first: bytes
    part: Part

    @staticmethod
    def of(terms: Sequence[Term], first: FloatArray, part: Part) -> Question:
        """What is asked by terms with the first values of their parameters (p,)."""
        return Question(tuple((term, term.probe) for term in terms), first.tobytes(), part)


class KnownFits:
    """The fits that were asked last, each with the questions to which it is the answer; those of other readings go."""

    def __init__(self) -> None:
        self._kept: list[tuple[tuple[Question, Question], Fitted]] = []

    def of(self, asked: Question, recording: Recording) -> Fitted | None:
        """The fit of these very readings, if it is known."""
        for place, (questions, fit) in enumerate(self._kept):
            if asked in questions and fit.recording is recording:
                self._kept.insert(0, self._kept.pop(place))
                return fit
        return None

    def add(self, asked: Question, again: Question, fit: Fitted) -> None:
        """Keep a fit as the answer to what was asked, and to itself asked again from its own estimate on."""
        most = max(1, min(_MOST_FITS, int(_MOST_SAMPLES / max(len(fit.motion), 1))))
        same = [one for one in self._kept if one[1].recording is fit.recording]
        self._kept = [((asked, again), fit), *same][:most]
