"""The grade of one report: opened answer against named effects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import DETECTABLE_LAMBDA, Evidence, predicted_lambda, squared_correlation
from sinan.estimator.evidence.source import LEAST_SPARE, Fit, Source
from sinan.estimator.evidence.term import Term
from sinan.experiments.blind.maker.make import ANSWER_FILE, answers_folder
from sinan.experiments.datasets import resolve
from sinan.experiments.residual_loop.manoeuvre import CLASS_BOUND
from sinan.experiments.residual_loop.open_flight import flight_source
from sinan.experiments.residual_loop.open_source import pose_source
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: Verdict on a recording that the tracer cannot read.
REFUSED = "refused"
#: An estimate counts as right within so many of its sigma, per degree of freedom as for one normal number.
SIGMAS = 3.0
#: A reading counts as wrong from 6 sigma on; its own noise takes 2 off that at most.
BEYOND_DOUBT = 8.0


@dataclass(frozen=True)
class Grade:
    """One recording, graded.

    Attributes
    ----------
    run, kind, world, what : of the recording; `what` is none, one, several or outside
    hidden : names of the effects in it; of an effect outside the catalogue its own name
    named : names that the tracer gave
    verdict : of the tracer
    information : predicted lambda of each hidden effect, all other lasting candidates and the hidden effects projected
        out; zero: not seen at all
    class_information : the same, but for the candidates of its class, which are not projected out
    joint_information : the same with the other hidden effects alone projected out
    missing : hidden effects that were not named
    wrong : names that are not true
    wrong_outside_class : those that are not in a class with a hidden effect either
    missing_outside_class : hidden effects of which not even the class was named
    z : |error of beta| in sigma of each hidden effect that was named, in normal equivalents
    held_out_ratio : held-out error over that of the model that knew the effects; NaN where there is none
    strength : of an effect outside the catalogue, how many sigma its mark is in the plain readings
    seconds : CPU time
    duration : of the recording [s]
    """

    run: str
    kind: str
    world: str
    what: str
    hidden: tuple[str, ...]
    named: tuple[str, ...]
    verdict: str
    information: tuple[float, ...]
    class_information: tuple[float, ...]
    joint_information: tuple[float, ...]
    missing: tuple[str, ...]
    wrong: tuple[str, ...]
    wrong_outside_class: tuple[str, ...]
    missing_outside_class: tuple[str, ...]
    z: tuple[float, ...]
    held_out_ratio: float
    strength: float
    seconds: float
    duration: float

    @property
    def detectable(self) -> bool:
        """Whether every hidden effect can be told from all other candidates."""
        return _all_above(self.information)

    @property
    def class_detectable(self) -> bool:
        """Whether the class of every hidden effect can be told from all other candidates."""
        return _all_above(self.class_information)

    @property
    def jointly_detectable(self) -> bool:
        """Whether every hidden effect could be found by one who knows that there is none but these."""
        return _all_above(self.joint_information)


def _all_above(information: Sequence[float]) -> bool:
    return bool(information) and min(information) > DETECTABLE_LAMBDA


def grade(runs: Path, name: str, document: Mapping[str, Any]) -> Grade:
    """Open the answer and compare.

    Parameters
    ----------
    runs : folder of the recordings
    name : of the recording
    document : report of the trace
    """
    answer = json.loads((answers_folder(runs) / name / ANSWER_FILE).read_text(encoding="utf-8"))
    named = effects_of(document)
    names = names_of(named)
    hidden = tuple(e["name"] for e in answer["effects"])
    allowed = {*hidden, *answer["also_true"]}
    outside = answer["outside"]
    if outside is not None:
        allowed |= set(outside["acceptable"])
    lambdas: list[_Lambda] = []
    ratio = np.nan
    z: tuple[float, ...] = ()
    wrong = tuple(n for n in names if n not in allowed)
    missing = tuple(n for n in hidden if n not in names)
    wrong_outside, missing_outside = wrong, missing
    if hidden and document["verdict"] == REFUSED:  # no model, no evidence
        lambdas = [_Lambda.alone(0.0) for _ in hidden]
    elif hidden:
        truth = _Truth(runs / name, answer)
        lambdas = truth.lambdas()
        wrong_terms = [_term(e[0], e[1]) for e in named if e[0] in wrong]
        related = truth.related(wrong_terms)
        wrong_outside = tuple(n for n in wrong if not related.get(n))
        covered = {own for n in wrong for own in related.get(n, ())}
        missing_outside = tuple(n for n in missing if n not in covered)
        z = truth.deviations(named)
        ratio = truth.held_out_ratio(document["error"])
    return Grade(
        name, answer["kind"], answer["world"], answer["class"],
        hidden if outside is None else (outside["name"],), names, str(document["verdict"]),
        tuple(x.of_all for x in lambdas), tuple(x.of_other_classes for x in lambdas),
        tuple(x.of_hidden for x in lambdas), missing, wrong, wrong_outside, missing_outside, z, ratio,
        np.nan if outside is None else float(outside["strength"]), float(document["cpu_seconds"]),
        float(answer["duration"]),
    )  # fmt: skip


#: An effect as a report names it: name, interval, beta, std.
Named = tuple[str, Sequence[float] | None, FloatArray, FloatArray]


def effects_of(document: Mapping[str, Any]) -> list[Named]:
    """The effects of a report, in order of discovery."""
    return [
        (e["name"], e["interval"], np.array(e["beta"]), np.array(e["std"], dtype=float)) for e in document["effects"]
    ]


def names_of(named: Sequence[Named]) -> tuple[str, ...]:
    """Their names, each once."""
    return tuple(dict.fromkeys(e[0] for e in named))


def is_same(name: str, interval: Sequence[float] | None, other: Named) -> bool:
    """Whether a named effect is the one that is asked for: the same name, at the same time where it has one."""
    local = interval is not None and not name.endswith(".outliers")
    return other[0] == name and (not local or _overlap(interval or (), other[1]))


def deviation(estimate: FloatArray, truth: FloatArray, std: FloatArray) -> float | None:
    """|estimate - truth| as a normal number of the same p-value; None where the estimate has no sigma."""
    from scipy import stats

    seen = np.isfinite(std) & (std > 0)
    if not np.any(seen):
        return None
    z = float(np.max(np.abs(estimate - truth)[seen] / std[seen], initial=0.0))
    p = 1.0 - (1.0 - 2.0 * stats.norm.sf(z)) ** max(int(np.sum(seen)), 1)
    return float(stats.norm.isf(p / 2.0)) if p > 0 else z


def _term(name: str, interval: Sequence[float] | None) -> Term:
    local = interval is not None and not name.endswith(".outliers")
    return Term(name, (float(interval[0]), float(interval[1])) if local and interval is not None else None)


@dataclass(frozen=True)
class _Lambda:
    """beta' Lambda beta of one hidden effect with others projected out: all candidates; those of other classes; the
    hidden ones.
    """

    of_all: float
    of_other_classes: float
    of_hidden: float

    @classmethod
    def alone(cls, value: float) -> _Lambda:
        """Of an effect that no other resembles."""
        return cls(value, value, value)


def _in_one_class(evidence: Evidence, first: str, second: str) -> bool:
    return squared_correlation(evidence, first, second) > CLASS_BOUND


class _Truth:
    """The model that knows what is in a recording."""

    def __init__(self, folder: Path, answer: Mapping[str, Any]) -> None:
        recording = resolve(str(folder), None)
        flight, sensor = recording.kind == "flight", answer["sensor"]
        self.sums = answer["kind"] == "gyro_turns"
        # lambda by the declared noise: a slow error of the GPS is not counted
        self.source: Source = flight_source(recording, False) if flight else pose_source(recording, sensor)
        self.terms = {_term(e["name"], e["interval"]): np.array(e["beta"], dtype=float) for e in answer["effects"]}
        self.wrong = {_term(e["name"], e["interval"]): np.array(e["wrong"], dtype=float) for e in answer["effects"]}
        if answer["sensor"] == "mag" and not flight:
            from sinan.experiments.residual_loop.open_source import triad_readings

            divisor = triad_readings(recording, "mag").normalised_by
            self.terms = {t: b / divisor if t.in_mean and t.effect.in_field_units else b for t, b in self.terms.items()}
        self.in_mean, self.fit = self._modelled({t: b for t, b in self.terms.items() if t.in_mean and self._can(t)})

    def _can(self, term: Term) -> bool:
        return term.interval is not None or any(e.name == term.name for e in self.source.candidates)

    def _modelled(self, terms: dict[Term, FloatArray]) -> tuple[dict[Term, FloatArray], Fit]:
        """The terms that the model can have, and its fit with them: it may have left out the stream of a local one."""
        try:
            return terms, self.source.fit(tuple(terms), terms)
        except InputError:
            possible = {t: b for t, b in terms.items() if self._has_stream_of(t)}
            return possible, self.source.fit(tuple(possible), possible)

    def _has_stream_of(self, term: Term) -> bool:
        try:
            self.source.fit((term,), {term: self.terms[term]})
        except InputError:
            return False
        return True

    def lambdas(self) -> list[_Lambda]:
        """Of each hidden effect that the model can have, else 0; outliers: their chi-square.

        A model that has as many parameters as there are readings leaves nothing to tell its effects by.
        """
        evidence = self.source.evidence(self.fit)
        fits_anything = evidence.spare < LEAST_SPARE
        keys = [t.key for t in self.in_mean]
        found = []
        for term, beta in self.terms.items():
            if not term.in_mean:
                found.append(_Lambda.alone(self._of_outliers(term)))
            elif term in self.in_mean and not fits_anything:
                others = [key for key in evidence.names if key != term.key]
                apart = [key for key in others if not _in_one_class(evidence, term.key, key)]
                hidden = [key for key in keys if key != term.key]
                found.append(_Lambda(*(predicted_lambda(evidence, term.key, beta, x) for x in (others, apart, hidden))))
            else:
                found.append(_Lambda.alone(0.0))
        return found

    def _of_outliers(self, term: Term) -> float:
        """The chi-square of the readings that are wrong beyond doubt; none where readings are no residuals: turns and
        rests are sums over hundreds.
        """
        stream = term.effect.stream
        if self.sums or all(r.stream != stream for r in self.source.residuals(self.fit)):
            return 0.0
        return float(np.sum(self.wrong[term][self.wrong[term] > BEYOND_DOUBT] ** 2))

    def related(self, wrong: Sequence[Term]) -> dict[str, tuple[str, ...]]:
        """For each wrong name the hidden effects with which it is in one class."""
        found: dict[str, tuple[str, ...]] = {}
        for term in wrong:
            if not term.in_mean:
                continue
            try:
                both = self.source.fit((*self.in_mean, term), {**self.in_mean})
            except (ValueError, np.linalg.LinAlgError):
                continue
            evidence = self.source.evidence(both, own_terms_only=True)
            found[term.name] = tuple(own.name for own in self.in_mean if _in_one_class(evidence, own.key, term.key))
        return found

    def deviations(self, named: Sequence[Named]) -> tuple[float, ...]:
        """|beta - truth| of each hidden effect that was named, as a normal number of the same p-value."""
        found = []
        for term, beta in self.terms.items():
            same = next((e for e in named if term.in_mean and is_same(term.name, term.interval, e)), None)
            z = None if same is None else deviation(same[2], beta, same[3])
            found += [] if z is None else [z]
        return tuple(found)

    def held_out_ratio(self, error: Mapping[str, Any]) -> float:
        """Held-out error of the report over that of the model with the hidden effects, of the same stream."""
        knew = self.source.fit(tuple(self.in_mean), self.in_mean, "fitting")
        if self.source.set_aside(knew):
            knew = self.source.fit(knew.terms, knew.beta, "fitting")
        rows = [r for r in self.source.held_out(knew) if r.stream == error["stream"]]
        return float(error["after"]["rms"] / rows[0].rms) if rows and rows[0].rms > 0.0 else float("nan")


def _overlap(first: Sequence[float], second: Sequence[float] | None) -> bool:
    return second is not None and max(first[0], second[0]) < min(first[1], second[1])
