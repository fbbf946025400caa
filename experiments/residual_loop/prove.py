"""Prove a selection: errors on data that took no part in the fit, and rollback."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.flights.prediction import can_be_predicted
from sinan.estimator.evidence.noise_left import noise_left, slow_streams
from sinan.estimator.evidence.score import (
    BLOCKS,
    DETECTABLE_LAMBDA,
    predicted_lambda,
    project_out,
)
from sinan.estimator.evidence.source import Fit, Part, Source, StreamResidual, log_p_needed
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.select import Selection
from sinan.experiments.residual_loop.trials import Finding, fit_without, log_odds_of, with_besides
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import ASSUMED
from sinan.sensors.errors import InputError

#: Draws of the bootstrap: its 2.5 % points are known to sqrt(0.025 * 0.975 / 1000) = 0.5 % of probability.
_RESAMPLES = 1000
#: An effect that changes the squares of the held-out residuals by less than this times the noise is not seen there:
#: by chance alone one parameter changes them by as much, the mean of chi-square with one degree = 1.
_NOTHING = 1.0


@dataclass(frozen=True)
class Errors:
    """Residuals of one model on one part of the data.

    Attributes
    ----------
    rms, unit : of the stream in question
    nis_per_dof : over all streams
    interval : 95 % interval of the rms by block bootstrap
    sse : sum of squares of the stream in question
    values : number of residuals, each component one, over all streams
    """

    rms: float
    unit: str
    nis_per_dof: float
    interval: tuple[float, float]
    sse: float
    values: int


@dataclass(frozen=True)
class Change:
    """RMS of the held-out residual of a stream, before and after."""

    stream: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True)
class Contribution:
    """What one effect does to the held-out error, given all others that are in the model.

    Attributes
    ----------
    term : the effect
    error : of its own stream, or where that has no residuals of the one with the largest NIS, without and with it
    gain : by how much the squares of the whitened residuals of all streams are less with it
    """

    term: Term
    error: Change
    gain: float

    @property
    def falls(self) -> bool:
        """Whether the held-out error is less with the effect: in that stream, and over all."""
        return self.error.after < self.error.before and self.gain > 0.0


@dataclass(frozen=True)
class Proof:
    """Errors before and after on held-out data, without readings in an interval of which the rest knows nothing.

    Attributes
    ----------
    stream : whose errors are compared
    before, after : held out
    in_sample_before, in_sample_after : on all data, fitted on all data, each reading in its weight
    untested : effects that act on no held-out reading, or whose size the rest cannot tell, so that only the evidence
        speaks for them
    compared : the plain and the final model whose held-out errors these are
    fits : the same as fitted to what is before the last third, where a reference is asked
    contributions : of every effect that is tested, in order of discovery
    """

    stream: str
    before: Errors
    after: Errors
    in_sample_before: Errors
    in_sample_after: Errors
    untested: tuple[Term, ...]
    compared: tuple[Fit, Fit]
    fits: tuple[Fit, Fit]
    contributions: tuple[Contribution, ...]

    @property
    def nis_before(self) -> float:
        """Of the plain model, per degree of freedom over all streams and all data."""
        return self.in_sample_before.nis_per_dof

    @property
    def nis_after(self) -> float:
        """Of the final model."""
        return self.in_sample_after.nis_per_dof

    @property
    def falls(self) -> bool:
        """Whether the held-out error is less with the effects than without them."""
        return self.after.rms < self.before.rms

    @property
    def failing(self) -> Contribution | None:
        """The last effect found that does not predict the held-out data: the error does not fall with it, or, where it
        does with each, not with all of them.
        """
        late = self.contributions[::-1]
        failing = next((one for one in late if not one.falls), None)
        if failing is None and late and not self.falls:
            of_all = Change(self.stream, self.before.unit, self.before.rms, self.after.rms)
            return replace(late[0], error=of_all)
        return failing

    def with_nis_of(self, proofs: Sequence[Proof]) -> Proof:
        """The proof with the NIS of all residuals of several proofs."""

        def mean(of: Callable[[Proof], Errors]) -> float:
            total = sum(of(one).nis_per_dof * of(one).values for one in proofs)
            return total / sum(of(one).values for one in proofs)

        return replace(
            self,
            before=replace(self.before, nis_per_dof=mean(lambda one: one.before)),
            after=replace(self.after, nis_per_dof=mean(lambda one: one.after)),
            in_sample_before=replace(self.in_sample_before, nis_per_dof=mean(lambda one: one.in_sample_before)),
            in_sample_after=replace(self.in_sample_after, nis_per_dof=mean(lambda one: one.in_sample_after)),
        )


def stream_in_question(source: Source, selection: Selection, names: Collection[str]) -> str:
    """The stream that the first effect enters, if it is among `names`; else that of them with the largest NIS.

    Raises
    ------
    InputError : there is none
    """
    residuals = [r for r in source.residuals(selection.plain) if r.stream in names]
    if not residuals:
        expected = "a stream that the model predicts from beginning to end"
        raise InputError(source.name, "no stream with readings left to fit and to prove by", expected)
    if selection.findings:
        entered = selection.findings[0].term.effect.stream
        if entered in names:
            return entered
    return max(residuals, key=lambda r: r.nis_per_dof).stream


def errors_of(residuals: Sequence[StreamResidual], stream: str, rng: np.random.Generator, noise: float = 1.0) -> Errors:
    """Errors of a set of residuals; `noise` is the variance by which undeclared noise is normalised."""
    one = next(r for r in residuals if r.stream == stream)
    squares = np.concatenate([r.whitened[r.tells] ** 2 for r in residuals])
    row_squares = np.sum(one.residual**2, axis=1) / np.mean(one.dof)
    return Errors(
        one.rms,
        one.unit,
        float(np.mean(squares)) / noise,
        rms_interval(row_squares, rng),
        float(np.sum(one.residual**2)),
        len(squares),
    )


def rms_interval(squares: FloatArray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the root mean of `squares` (n,) in time order, by resampling contiguous blocks."""
    blocks = np.array_split(squares, min(BLOCKS, len(squares)))
    sums, counts = np.array([b.sum() for b in blocks]), np.array([len(b) for b in blocks])
    draw = rng.integers(0, len(blocks), (_RESAMPLES, len(blocks)))
    rms = np.sqrt(sums[draw].sum(axis=1) / counts[draw].sum(axis=1))
    low, high = np.quantile(rms, [0.025, 0.975])
    return float(low), float(high)


def known_from_fitting(source: Source, selection: Selection) -> frozenset[Term]:
    """The terms whose size the fitting part of the data can tell: one in an interval may lie outside it; or the rest of
    a log, where each part is predicted by the others.
    """
    terms = selection.final.terms
    if source.is_predicting:
        return frozenset(term for term in terms if can_be_predicted(term))
    inside = {term for term in terms if term.interval is not None and not _is_held_out(source, selection, term)}
    known = {term for term in terms if term.interval is None}
    if inside:
        part = source.evidence(replace(selection.final, part="fitting"), own_terms_only=True)
        for term in inside:
            others = selection.final.keys_given(term)
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
        and (
            f.term.interval is None
            or source.is_predicting
            or any(np.any(r.held_out) for r in _inside(source, selection, f.term))
        )
    ]


def _is_held_out(source: Source, selection: Selection, term: Term) -> bool:
    """Whether every reading in the interval of an effect is held out."""
    return all(np.all(r.held_out) for r in _inside(source, selection, term))


def _inside(source: Source, selection: Selection, term: Term) -> list[StreamResidual]:
    """The readings in the interval of an effect: those of its own stream, or of all where it has none."""
    residuals = source.residuals(selection.plain)
    concerned = _concerned(term, residuals)
    return [r.rows(term.covers(r.t)) for r in residuals if r.stream in concerned]


def _concerned(term: Term, residuals: Sequence[StreamResidual]) -> set[str]:
    """The stream of an effect, or all where it has no residuals."""
    stream, names = term.effect.stream, {r.stream for r in residuals}
    return {stream} if stream in names else names


def _fitted_on_the_rest(source: Source, selection: Selection, known: frozenset[Term]) -> Fit:
    """The known effects, fitted to what is not held out: where readings are withheld, that is seen to when they are."""
    terms = [term for term in selection.final.terms if term in known]
    part: Part = "all" if source.is_predicting else "fitting"
    return source.fit(terms, {term: selection.final.beta[term] for term in terms}, part)


def prove(source: Source, selection: Selection, rng: np.random.Generator) -> Proof:
    """Fit on the fitting part, count on the held-out part, before and after; and the same in sample."""
    known = known_from_fitting(source, selection)
    asked = tested(source, selection, known)
    untested = tuple(f.term for f in selection.findings if f.term.in_mean and f.term not in asked)
    fitting = _fitted_on_the_rest(source, selection, known)
    plain = _fitted_on_the_rest(source, selection, frozenset())
    noise = _noise(source, selection.final)
    unknown = _unknown(selection, known)
    before, after = (_known(unknown, source.held_out(fit)) for fit in (plain, fitting))
    all_before, all_after = source.residuals(selection.plain), source.residuals(selection.final)
    sure = {r.stream: r for r in all_after}
    all_before = [r.as_sure_as(sure.get(r.stream, r)).weighed for r in all_before]
    of_all = before, after, all_before, [r.weighed for r in all_after]
    stream = stream_in_question(source, selection, set.intersection(*({r.stream for r in part} for part in of_all)))
    first, second, third, fourth = (errors_of(r, stream, rng, noise) for r in of_all)
    contributions = tuple(
        _contribution(source, selection, known, fitting, finding)
        for finding in selection.findings
        if finding.term in asked
    )
    fits = plain, fitting
    if source.is_predicting:  # a reference is asked on the last third
        fits = source.fit((), part="fitting"), source.fit(fitting.terms, fitting.beta, "fitting")
    return Proof(stream, first, second, third, fourth, untested, (plain, fitting), fits, contributions)


def _contribution(
    source: Source, selection: Selection, known: frozenset[Term], fitted: Fit, finding: Finding
) -> Contribution:
    """Of one effect: the model of the fitting part with and without it."""
    without, unknown = _fitted_on_the_rest(source, selection, known - {finding.term}), _unknown(selection, known)
    before, after = (_known(unknown, source.held_out(fit)) for fit in (without, fitted))
    names = {r.stream for r in before} & {r.stream for r in after}
    stream = stream_in_question(source, replace(selection, findings=(finding,)), names)
    first, second = (next(r for r in part if r.stream == stream) for part in (before, after))
    gain, _ = _held_out_gain(source, fitted, without, unknown)
    return Contribution(finding.term, Change(stream, first.unit, first.rms, second.rms), gain)


def changes(source: Source, plain: Fit, fitted: Fit, streams: Sequence[str]) -> tuple[Change, ...]:
    """Held-out RMS of streams by two models of the fitting part, where both predict them."""
    before, after = ({r.stream: r for r in source.held_out(fit)} for fit in (plain, fitted))
    both = [(before[name], after[name]) for name in streams if name in before and name in after]
    return tuple(Change(first.stream, first.unit, first.rms, second.rms) for first, second in both)


def _unknown(selection: Selection, known: frozenset[Term]) -> list[Term]:
    """The intervals of which the fitting part knows nothing."""
    return [term for term in selection.final.terms if term.interval is not None and term not in known]


def _known(unknown: Sequence[Term], residuals: Sequence[StreamResidual]) -> list[StreamResidual]:
    """The residuals without the readings in intervals of which the fitting part knows nothing; all of a stream of which
    none would be left.
    """
    known = []
    for r in residuals:
        keep = np.ones(len(r.t), dtype=bool)
        for term in unknown:
            if r.stream in _concerned(term, residuals):
                keep &= ~term.covers(r.t)
        known.append(r.rows(keep) if np.any(keep) else r)
    return known


def rolled_back(
    source: Source,
    selection: Selection,
    alpha: float = ALPHA,
    besides: Mapping[Term, FloatArray] = MappingProxyType({}),
) -> dict[Term, bool]:
    """Effects that the held-out data that they act on do not bear out, all that the fitting part knows in the model,
    and of each whether withheld readings are predicted better with it all the same, if by what may be chance.

    The last found is asked first: two effects that hide each other need each other. Readings in an interval of which
    the fitting part knows nothing are not counted.

    Parameters
    ----------
    alpha : family-wise error, with which withheld readings of all parts and the odds together bear an effect out
    besides : what has fallen before though withheld readings of all parts are predicted better with it: in the model in
        which others are asked, with a first estimate
    """
    if source.is_predicting:
        fit, _ = with_besides(source, selection.final, besides)
        return _not_predicted(source, selection, fit, -log_p_needed(source, alpha))
    known = known_from_fitting(source, selection)
    asked = tested(source, selection, known)
    fitted = _fitted_on_the_rest(source, selection, known)
    unknown = _unknown(selection, known)
    dropped: list[Term] = []
    for term in reversed(asked):
        without = _fitted_on_the_rest(source, selection, known - {term, *dropped})
        if not _is_borne_out(source, fitted, without, term, unknown):
            dropped.append(term)
            fitted = without
    return dict.fromkeys(reversed(dropped), False)


def _not_predicted(source: Source, selection: Selection, fit: Fit, needed: float) -> dict[Term, bool]:
    """See `rolled_back`: effects without which withheld readings are predicted as well, or of which they and the odds
    together say too little; of one that is soon over the odds alone, where a motion is assumed.

    What an effect gains is what it did when it was found, does in the fit without what has fallen before, or does there
    with less assumed, whichever is least. What has fallen though readings are predicted better with it stays in the
    model in which the others are asked: nobody has said that it is not so.
    """
    fallen = dict[Term, bool]()
    for finding in reversed(selection.findings):
        term = finding.term
        is_brief = not can_be_predicted(term)
        if not term.in_mean or (is_brief and not source.assumes_motion):
            continue
        without = fit_without(source, fit, term)
        gain = min(without.deviance - fit.deviance, finding.gain, source.gain_assuming_less(fit, without))
        log_odds = partial(log_odds_of, source, fit, finding, gain)
        if not (log_odds(1.0) > 0.0 if is_brief else source.bears_out(fit, without, log_odds, needed)):
            fallen[term] = source.predicts(fit, without, surely=False)
            fit = fit if fallen[term] else without
    return dict(reversed(fallen.items()))


def _is_borne_out(source: Source, fitted: Fit, without: Fit, term: Term, unknown: Sequence[Term]) -> bool:
    """Whether the held-out error is larger without an effect, and by what the same beta ought to make of it.

    With d the change of the whitened held-out residuals e when the effect is taken out, the gain is G = d'd + 2 d'e.
    The estimate errs by N(0, L_f^-1), L_f and L_h the information of the fitting and of the held-out part in units of
    the noise left; the error is in d and in e. So a true effect has about the mean d'd - 2 tr(L_h L_f^-1) and a
    variance of at most 4 d'd (1 + m), m the largest eigenvalue of L_h L_f^-1. Where the gain is less than half of its
    mean, and by more than three sigma, something else has taken the shape of the effect in the part that was fitted;
    where it is none, though its mean is three sigma, the effect would have shown. Where the mean is less, the held-out
    part cannot speak for or against the effect, and the test that it has passed decides; but not where the noise is
    slow, whose chances nobody knows: there the gain has to be one, unless nothing could have shown at all.
    """
    gain, change = _held_out_gain(source, fitted, without, unknown)
    if source.noise_known:
        noise = noise_left(source, fitted, term.effect.stream, slow=False)
    else:
        noise = _noise_of_part(source, fitted)
    gain, change = gain / noise, change / noise
    if gain > 0.5 * change:
        return True
    errors = _errors_given_back(source, fitted, term)
    mean, sigma = change - 2.0 * float(np.sum(errors)), 2.0 * np.sqrt(change * (1.0 + float(np.max(errors))))
    if gain < 0.5 * mean - 3.0 * sigma:
        return False
    return gain > 0.0 or (mean < 3.0 * sigma and (change < _NOTHING or not _is_slow(source, fitted, term)))


def _is_slow(source: Source, fitted: Fit, term: Term) -> bool:
    """Whether the residual of an effect's stream is slow; of one without residuals, that of any."""
    residuals, stream = source.residuals(fitted), term.effect.stream
    mine = [r for r in residuals if r.stream == stream] or [r for r in residuals if r.stream not in ASSUMED]
    return bool(slow_streams(mine))


def _errors_given_back(source: Source, fitted: Fit, term: Term) -> FloatArray:
    """Eigenvalues of L_h L_f^-1 of an effect, the others projected out of the whole and of the fitting part."""
    others = fitted.keys_given(term)
    of_all = _information(source, replace(fitted, part="all"), term, others)
    of_part = _information(source, fitted, term, others)
    ratio = np.linalg.pinv(of_part, rcond=1e-12, hermitian=True) @ (of_all - of_part)
    return np.maximum(np.real(np.linalg.eigvals(ratio)), 0.0)


def _information(source: Source, fit: Fit, term: Term, others: Sequence[str]) -> FloatArray:
    """(size, size) of a term, in the unit of the whitened residuals."""
    evidence = source.evidence(fit, own_terms_only=True)
    noise = 1.0 if source.noise_known else _noise_of_part(source, fit)
    return np.asarray(noise * project_out(evidence, term.key, others)[0].sum(axis=0))


def _held_out_gain(source: Source, fitted: Fit, without: Fit, unknown: Sequence[Term]) -> tuple[float, float]:
    """By how much the squares of the held-out readings that both fits have are larger without an effect, and the square
    of the change of their residuals; intervals that are not known are left out.
    """
    gain, change = 0.0, 0.0
    residuals = source.held_out(fitted)
    concerned = {term: _concerned(term, residuals) for term in unknown}
    both = {r.stream: r for r in residuals}  # a model may predict no reading of a stream
    for one in source.held_out(without):
        other = both.get(one.stream)
        if other is None:
            continue
        _, mine, same = np.intersect1d(one.row, other.row, return_indices=True)  # a lateness moves all stamps
        held = np.ones(len(mine), dtype=bool)
        for term in unknown:
            if one.stream in concerned[term]:
                held &= ~term.covers(one.t[mine])
        before, after = one.whitened[mine[held]], other.whitened[same[held]]
        gain += float(np.sum(before**2) - np.sum(after**2))
        change += float(np.sum((before - after) ** 2))
    return gain, change


def _noise(source: Source, fit: Fit) -> float:
    """Variance of the whitened residual where the noise is not declared: that of the final model; else 1."""
    if not source.noise_known:
        return float(np.mean(np.concatenate([r.whitened[r.tells] ** 2 for r in source.residuals(fit)])))
    return 1.0


def _noise_of_part(source: Source, fit: Fit) -> float:
    """Variance of the whitened residuals of a fit's part, for their degrees of freedom."""
    freedom = source.evidence(fit, own_terms_only=True).noise_dof
    mine = [r.rows((fit.part == "all") | ~r.held_out) for r in source.residuals(fit)]
    rows = np.concatenate([r.whitened[r.tells] for r in mine])
    return float(np.sum(rows**2)) / max(min(freedom, len(rows)), 1.0)
