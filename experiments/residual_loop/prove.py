"""Prove a selection: errors on data that took no part in the fit, and rollback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.score import DETECTABLE_LAMBDA, predicted_lambda, project_out
from experiments.residual_loop.noise_left import noise_left
from experiments.residual_loop.select import Selection
from experiments.residual_loop.source import Fit, Source, StreamResidual
from experiments.residual_loop.term import Term
from sensors.arrays import FloatArray

_RESAMPLES = 1000
_BOOTSTRAP_BLOCKS = 20
#: An effect that is there lowers the held-out error in all but one of forty cases by more than what is foretold less so
#: many sigma.
_WOULD_SHOW = 2.0


@dataclass(frozen=True)
class Errors:
    """Residuals of one model on one part of the data.

    Attributes
    ----------
    rms, unit : of the stream in question
    nis_per_dof : over all streams
    interval : 95 % interval of the rms by block bootstrap
    sse : sum of squares of the stream in question
    """

    rms: float
    unit: str
    nis_per_dof: float
    interval: tuple[float, float]
    sse: float


@dataclass(frozen=True)
class Proof:
    """Errors before and after on held-out data.

    Attributes
    ----------
    stream : whose errors are compared
    before, after : held out
    in_sample_before, in_sample_after : on all data, fitted on all data
    nis_before, nis_after : per degree of freedom over all streams and all data
    untested : effects that act on no held-out reading, or whose size the rest cannot tell, so that only the evidence
        speaks for them
    fits : the plain and the final model as fitted on the fitting part
    """

    stream: str
    before: Errors
    after: Errors
    in_sample_before: Errors
    in_sample_after: Errors
    nis_before: float
    nis_after: float
    untested: tuple[Term, ...]
    fits: tuple[Fit, Fit]


def stream_in_question(source: Source, selection: Selection) -> str:
    """The stream that the first effect enters, if it has residuals; else the one with the largest NIS."""
    residuals = source.residuals(selection.plain)
    names = {r.stream for r in residuals}
    if selection.findings:
        entered = source.effect(selection.findings[0].term).stream
        if entered in names:
            return entered
    return max(residuals, key=lambda r: r.nis_per_dof).stream


def errors_of(residuals: Sequence[StreamResidual], stream: str, rng: np.random.Generator, noise: float = 1.0) -> Errors:
    """Errors of a set of residuals; `noise` is the variance by which undeclared noise is normalised."""
    one = next(r for r in residuals if r.stream == stream)
    squares = np.concatenate([r.whitened.ravel() ** 2 for r in residuals])
    row_squares = np.mean(one.residual**2, axis=1)
    return Errors(
        one.rms,
        one.unit,
        float(np.mean(squares)) / noise,
        rms_interval(row_squares, rng),
        float(np.sum(one.residual**2)),
    )


def rms_interval(squares: FloatArray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the root mean of `squares` (n,) in time order, by resampling contiguous blocks."""
    blocks = np.array_split(squares, min(_BOOTSTRAP_BLOCKS, len(squares)))
    sums, counts = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    draw = rng.integers(0, len(blocks), (_RESAMPLES, len(blocks)))
    rms = np.sqrt(sums[draw].sum(axis=1) / counts[draw].sum(axis=1))
    low, high = np.quantile(rms, [0.025, 0.975])
    return float(low), float(high)


def held_out(residuals: Sequence[StreamResidual]) -> list[StreamResidual]:
    """The held-out rows of each stream that has any."""
    return [r.rows(r.held_out) for r in residuals if np.any(r.held_out)]


def known_from_fitting(source: Source, selection: Selection) -> frozenset[Term]:
    """The terms whose size the fitting part of the data can tell: one in an interval may lie outside it."""
    terms = selection.final.terms
    inside = {term for term in terms if term.interval is not None and not _is_held_out(source, selection, term)}
    known = {term for term in terms if term.interval is None}
    if inside:
        part = source.evidence(replace(selection.final, part="fitting"), own_terms_only=True)
        for term in inside:
            others = [t.key for t in terms if t.in_mean and t != term]
            if predicted_lambda(part, term.key, selection.final.beta[term], others) > DETECTABLE_LAMBDA:
                known.add(term)
    return frozenset(known)


def tested(source: Source, selection: Selection, known: frozenset[Term]) -> list[Term]:
    """The effects in the mean that the fitting part knows and that touch held-out readings."""
    return [
        f.term
        for f in selection.findings
        if f.term.in_mean
        and f.term in known
        and (f.term.interval is None or any(np.any(r.held_out) for r in _inside(source, selection, f.term)))
    ]


def _is_held_out(source: Source, selection: Selection, term: Term) -> bool:
    """Whether every reading in the interval of an effect is held out."""
    return all(np.all(r.held_out) for r in _inside(source, selection, term))


def _inside(source: Source, selection: Selection, term: Term) -> list[StreamResidual]:
    """The readings in the interval of an effect: those of its own stream, or of all where it has none."""
    assert term.interval is not None
    t0, t1 = term.interval
    stream = source.effect(term).stream
    rows = [r for r in source.residuals(selection.plain) if r.stream == stream] or source.residuals(selection.plain)
    return [r.rows((r.t >= t0) & (r.t < t1)) for r in rows]


def prove(source: Source, selection: Selection, rng: np.random.Generator) -> Proof:
    """Fit on the fitting part, count on the held-out part, before and after; and the same in sample."""
    stream = stream_in_question(source, selection)
    known = known_from_fitting(source, selection)
    asked = tested(source, selection, known)
    untested = tuple(f.term for f in selection.findings if f.term.in_mean and f.term not in asked)
    terms = [t for t in selection.final.terms if t in known]
    fitting = source.fit(terms, {t: selection.final.beta[t] for t in terms}, "fitting")
    plain = source.fit((), part="fitting")
    noise = _noise(source, selection.final)
    before, after = held_out(source.residuals(plain)), held_out(source.residuals(fitting))
    all_before, all_after = source.residuals(selection.plain), source.residuals(selection.final)
    first, second, third, fourth = (errors_of(r, stream, rng, noise) for r in (before, after, all_before, all_after))
    nis = third.nis_per_dof, fourth.nis_per_dof
    return Proof(stream, first, second, third, fourth, *nis, untested, (plain, fitting))


def rolled_back(source: Source, selection: Selection) -> tuple[Term, ...]:
    """Effects that the held-out data that they act on do not bear out, the others in the model.

    Without such an effect the held-out error is no larger, though an effect of its size would have shown; or it is
    larger, but by far less than the same beta ought to make of it: then something else has taken the shape of the
    effect in the part that was fitted. An effect that the held-out part is too short to tell is left to its evidence.

    The last found is asked first: two effects that hide each other need each other. Readings in an interval of which
    the fitting part knows nothing are not counted.
    """
    known = known_from_fitting(source, selection)
    asked = tested(source, selection, known)
    model = {term: selection.final.beta[term] for term in selection.final.terms if term in known}
    unknown = [term for term in selection.final.terms if term.interval is not None and term not in known]

    def squares(fit: Fit) -> float:
        return float(sum(np.sum(r.whitened**2) for r in held_out(_outside(source, fit, unknown))))

    def fitted_without(*terms: Term) -> Fit:
        rest = [term for term in model if term not in terms]
        return source.fit(rest, {term: model[term] for term in rest}, "fitting")

    fitted = fitted_without()
    present = squares(fitted)
    dropped: list[Term] = []
    for term in reversed(asked):
        without = fitted_without(term, *dropped)
        gain = squares(without) - present
        unseen = gain <= 0.0 and _would_show(source, fitted, term)
        if unseen or gain <= _least_held_out_gain(source, fitted, term):
            dropped.append(term)
            fitted, present = without, present + gain
    return tuple(term for term in asked if term in dropped)


def _would_show(source: Source, fitted: Fit, term: Term) -> bool:
    """Whether an effect as it was fitted, if it is there, lowers the held-out error beyond what chance takes off that.

    With L_h and L_f the information of the held-out and of the fitting part, the error falls by beta' L_h beta less the
    share tr(L_h L_f^-1) that the error of the estimate gives back, and scatters by twice the root of their sum.
    """
    whole = source.fit(fitted.terms, fitted.beta)
    others = [t.key for t in fitted.terms if t.in_mean and t != term]
    of_all, of_part = (
        project_out(source.evidence(fit, own_terms_only=True), term.key, others)[0].sum(axis=0)
        for fit in (whole, fitted)
    )
    held, beta = of_all - of_part, fitted.beta[term]
    foretold = max(float(beta @ held @ beta), 0.0)
    given_back = max(float(np.trace(np.linalg.pinv(of_part, hermitian=True) @ held)), 0.0)
    return foretold - given_back > _WOULD_SHOW * 2.0 * float(np.sqrt(foretold + given_back))


def _least_held_out_gain(source: Source, fitted: Fit, term: Term) -> float:
    """Half of what the fitted beta predicts, lambda, less what chance takes off it: three times 2 sqrt(lambda noise).

    Least squares with an estimated noise level have no scale for it.
    """
    if not source.noise_known:
        return -np.inf
    part = source.evidence(fitted, own_terms_only=True)
    whole = source.evidence(replace(fitted, part="all"), own_terms_only=True)
    others = [t.key for t in fitted.terms if t.in_mean and t != term]
    beta, expected = fitted.beta[term], 0.0
    for evidence, sign in ((whole, 1.0), (part, -1.0)):
        expected += sign * predicted_lambda(evidence, term.key, beta, others)
    noise = noise_left(source, fitted, source.effect(term).stream, slow=False)
    expected = max(expected, 0.0)
    return 0.5 * expected - 6.0 * float(np.sqrt(expected * noise))


def _outside(source: Source, fit: Fit, local: Sequence[Term]) -> list[StreamResidual]:
    """The residuals that are in none of the intervals of effects on their stream, or on one that has no residuals."""
    found = []
    residuals = source.residuals(fit)
    streams = {r.stream for r in residuals}
    for r in residuals:
        keep = np.ones(len(r.t), dtype=bool)
        for term in local:
            assert term.interval is not None
            if source.effect(term).stream in (streams - {r.stream}):
                continue
            keep &= (r.t < term.interval[0]) | (r.t >= term.interval[1])
        found.append(r.rows(keep))
    return found


def _noise(source: Source, fit: Fit) -> float:
    """Variance of the whitened residual where the noise is not declared: that of the final model; else 1."""
    if not source.noise_known:
        return float(np.mean(np.concatenate([r.whitened.ravel() ** 2 for r in source.residuals(fit)])))
    return 1.0
