"""Options refitted in exact form: which of them stand, and which of those is the best; pairs of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sinan.estimator.evidence.flights.prediction import can_be_predicted
from sinan.estimator.evidence.noise_left import noise_left
from sinan.estimator.evidence.score import (
    CONFUSED,
    Evidence,
    gain_of_ratio,
    log_bayes_factor,
    log_p_of_deviance,
    log_p_value,
    predicted_lambda,
    statistic_of,
)
from sinan.estimator.evidence.source import IMPLAUSIBLE, LEAST_SPARE, LINEAR, Fit, Source
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight_model import DRIVERS
from sinan.experiments.residual_loop.options import Option, alike_to, blind_spots, option_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: Refits of the shortlist, which cost a few passes each: bound of work (`bounds_of_work poses`).
SHORTLIST = 6
#: So many are tried with it that the score prefers though their blocks scatter too much to pass before a refit:
#: bound of work (`bounds_of_work turns`, `flight`).
_AHEAD = 2
#: Where nothing on a shortlist stands its refit, the next is tried, so many at a step: bound of work (`bounds_of_work
#: poses`).
SHORTLISTS = 2
#: A localised effect, or a lateness, is looked for again about its own fit, so often at most: bound of work
#: (`bounds_of_work flight`).
_RELOCATIONS = 3
#: Why an option did not stand: the refit left no evidence; nor did it where the blocks had scattered too much before;
#: chance would not do it, but an offset in an interval is less likely still; it cannot be. It was not tried, behind a
#: shortlist of which nothing stood.
NO_EVIDENCE, SCATTERED, UNLIKELY = "no evidence", "scattered", "unlikely"
IMPOSSIBLE, UNTRIED = "impossible", "untried"
#: Why an effect that had been chosen was dropped: it does not stand out given an error that is in no catalogue; the
#: held-out part does not bear it out, and it is not tried again.
GIVEN_ERROR, ROLLED_BACK = "given an error", "rolled back"


@dataclass(frozen=True)
class Finding:
    """An effect that was accepted.

    Attributes
    ----------
    term, beta, std : the effect and its estimate in the final model
    log_p : logarithm of the p-value of the exact refit, corrected for scatter and search; 0 of an interval that is less
        likely than none
    log_p_raw : the same without the scatter
    log_odds : logarithm of the Bayes factor against no effect, less that of the search: by it effects are compared
    gain : drop of -2 log L that it brought
    information : beta' Lambda beta, the others projected out
    rivals : the other effects that are as likely, each as it was found in its place
    spread : factor that is in `std`: the root of the scatter of the block scores, where noise is larger than declared
    at_least : whether `beta` is the least of all that do as well: larger, it changes no reading
    search : what the search over intervals adds to the logarithm of the p-value
    """

    term: Term
    beta: FloatArray
    std: FloatArray
    log_p: float
    log_p_raw: float
    log_odds: float
    gain: float
    information: float
    rivals: tuple[Finding, ...]
    spread: float = 1.0
    at_least: bool = False
    search: float = 0.0

    @property
    def confused_with(self) -> tuple[str, ...]:
        """Names of the rivals."""
        return tuple(rival.term.name for rival in self.rivals)


#: A refit with one more effect, and what it found.
Trial = tuple[Fit, Finding]


def best_of(
    source: Source,
    fit: Fit,
    options: Sequence[Option],
    threshold: float,
    refused: dict[str, str],
    most: int,
    rounds: int = SHORTLISTS,
) -> Trial | None:
    """Refit the shortlist and take the likeliest that is plausible and passes; None where nothing does.

    The scatter of the block scores decides what passes, the odds what is taken: two strong effects inflate each other's
    scatter, and an interval, which has none, must not go before them for that. Nor must an effect go before one that
    the score prefers, whose blocks scatter until it is in the model. Those come first that sizes which occur explain
    most with. `refused` learns by key what did not stand, and why.
    """
    unseen = blind_spots(source, fit, options, refused)
    seen = [o for o in options if o.term.key not in refused and o.term not in {other.term for other in unseen}]
    passing = [o for o in seen if o.log_p < threshold]
    if not passing:
        passing = [o for o in seen if o.log_p_raw < threshold and o.term.interval is None]
    if not passing and not unseen:
        return None
    passing.sort(key=lambda o: o.log_p_held)
    shortlist = passing[:most]
    if passing:
        first = passing[0].log_p_held
        ahead = [o for o in seen if o.term.interval is None and o not in passing and o.log_p_held < first]
        shortlist += sorted(ahead, key=lambda o: o.log_p_held)[:_AHEAD]
    shortlist += unseen
    same = alike_to(source, {o.term.name for o in shortlist})
    shortlist += [o for o in seen if o.term.name in same]
    tried = {o.term.key: trial(source, fit, o) for o in shortlist}
    trials = [one for one in tried.values() if one is not None and one[1].log_p < threshold]
    trials.sort(key=lambda one: -one[1].log_odds)
    if trials:
        return likeliest(source, trials, threshold)
    for option in shortlist:
        key = option.term.key
        refused[key] = _why(option, tried[key], threshold)
    return best_of(source, fit, options, threshold, refused, most, rounds - 1) if rounds > 1 else None


def _is_asked(source: Source, refit: Fit, finding: Finding) -> bool:
    """Whether withheld readings can tell of a trial."""
    return finding.term.in_mean and source.is_predicting and refit.part == "all" and can_be_predicted(finding.term)


def _are_asked(source: Source, first: Trial, other: Trial) -> bool:
    """Whether withheld readings can tell of both."""
    return _is_asked(source, *first) and _is_asked(source, *other)


def _is_left(source: Source, first: Trial, other: Trial, threshold: float) -> bool:
    """Whether an effect would pass its test given another one: it is there too then, and none of its rivals."""
    evidence = source.evidence(first[0])
    key = other[1].term.key
    return key in evidence.names and statistic_of(evidence, key, first[0].keys).log_p_corrected < threshold


def likeliest(source: Source, trials: Sequence[Trial], threshold: float) -> Trial:
    """The likeliest of several trials, with those that are as likely as its rivals.

    Odds count what the model holds for noise; where that is found from the log, an impostor may have the better ones.
    So where readings can be withheld they count too, and the odds for less where seconds are predicted worse than the
    model believes. What no log with these instruments tells apart is as likely whatever the odds, which say how well
    each form is computed.
    """
    first, *others = trials
    for other in others:
        outweighs = _are_for_one_place(first, other) and _over(source, first, other) < 0.0
        if outweighs and not _is_left(source, first, other, threshold):
            first = other
    rivals = [one for one in trials if one is not first and _is_as_likely(source, first, one, threshold)]
    same = alike_to(source, {finding.term.name for _, finding in (first, *rivals)})
    rivals += [one for one in trials if one[1].term.name in same]
    return first[0], replace(first[1], rivals=tuple(finding for _, finding in rivals))


def _are_for_one_place(first: Trial, other: Trial) -> bool:
    """Whether two trials are of different effects, either of which could take the place of the other."""
    return first[1].term.in_mean and other[1].term.in_mean and first[1].term.name != other[1].term.name


def _over(source: Source, first: Trial, other: Trial) -> float:
    """Logarithm of the odds for a trial over another, by withheld readings too where they can tell of both."""
    if not _are_asked(source, first, other):
        return first[1].log_odds - other[1].log_odds

    def log_odds(scatter: float) -> float:
        one, two = (log_odds_of(source, fit, found, found.gain, scatter) for fit, found in (first, other))
        return one - two

    return source.weighed(first[0], other[0], log_odds)


def log_odds_of(source: Source, fit: Fit, finding: Finding, gain: float, scatter: float) -> float:
    """Of what was found in a fit, of what it gains there, where noise is so many times as large as the model has it."""
    evidence, term = source.evidence(fit, own_terms_only=True), finding.term
    factor = log_bayes_factor(evidence, term.key, fit.beta[term], gain, fit.keys_given(term), scatter)
    return factor - finding.search


def _is_as_likely(source: Source, first: Trial, other: Trial, threshold: float) -> bool:
    """Whether an effect is a rival of another: the odds do not tell it from that, nor do both together explain more."""
    if not _are_for_one_place(first, other) or 2.0 * _over(source, first, other) >= CONFUSED:
        return False
    return not (source.is_predicting and _is_left(source, first, other, threshold))


def _why(option: Option, tried: Trial | None, threshold: float) -> str:
    """Why an option that was tried did not stand."""
    if tried is None:
        return IMPOSSIBLE
    if tried[1].term.interval is not None and tried[1].log_odds < 0.0 and tried[1].log_p_raw < threshold:
        return UNLIKELY
    return SCATTERED if option.log_p >= threshold else NO_EVIDENCE


def best_pair(source: Source, fit: Fit, evidence: Evidence, threshold: float) -> tuple[Fit, list[Trial]] | None:
    """The likeliest pair of lasting effects, in a calibration whose noise is estimated with the fit: with one of them
    alone, the other is part of the noise. The pair has to pass among all pairs, and in the refit each of them given the
    other. None of a flight, whose noise is given by then.

    Returns
    -------
    the fit with both, and of each the fit without it and the finding
    """
    if evidence.noise_known:
        return None
    names = [entry.name for entry in source.candidates if entry.name not in {term.name for term in fit.terms}]
    pairs = []
    for first, second in combinations(names, 2):
        one, other = statistic_of(evidence, first, fit.keys), statistic_of(evidence, second, [*fit.keys, first])
        gain = sum(gain_of_ratio(s.statistic, evidence.noise_dof) for s in (one, other))
        pairs.append((log_p_value(gain, one.dof + other.dof, evidence.noise_dof), one, other))
    if not pairs:
        return None
    log_p, one, other = min(pairs, key=lambda pair: pair[0])
    searched = float(np.log(len(pairs)))
    if log_p + searched > threshold:
        return None
    terms = Term(one.name), Term(other.name)
    found = []
    try:
        both = source.fit((*fit.terms, *terms), {**fit.beta, terms[1]: other.beta}, fit.part)
        for term, rest in (terms, terms[::-1]):
            without = fit_without(source, both, term)
            about = source.evidence(without)
            s = statistic_of(about, term.name, [*fit.keys, rest.key])
            alone = trial(source, without, option_of(s, about, without))
            if alone is None or alone[1].log_p + searched > threshold:
                return None
            found.append((without, alone[1]))
    except InputError:  # no model follows from the two
        return None
    return both, found


def trial(source: Source, fit: Fit, option: Option) -> Trial | None:
    """Refit with one more effect; None where it cannot be: the estimate of one that lasts or is on the IMU is far
    outside its plausible size, or negative where nothing is, no model follows from it, or hardly a reading is left that
    could say otherwise.
    """
    term = option.term
    try:
        refit = source.fit((*fit.terms, term), {**fit.beta, term: option.beta}, fit.part)
        if term.in_mean and refit.deviance > fit.deviance:  # the estimate lay beyond where the derivatives hold
            refit = source.fit((*fit.terms, term), fit.beta, fit.part)
    except InputError:  # no state or covariance that could be: this is not what happened
        return None
    for _ in range(_RELOCATIONS):
        moved, start = source.relocated(refit, term)
        if moved == term and np.array_equal(start, refit.beta[term]):
            break
        again = source.fit((*fit.terms, moved), {**refit.beta, moved: start}, fit.part)
        if again.deviance >= refit.deviance:
            break
        refit, term = again, moved
    gain = fit.deviance - refit.deviance
    if not term.in_mean:
        return refit, Finding(
            term, refit.beta[term], refit.std[term], option.log_p, option.log_p_raw, most_odds_of(option.log_p_raw),
            gain, option.statistic, (),
        )  # fmt: skip
    evidence = source.evidence(refit, own_terms_only=True)
    beta, std = refit.beta[term], refit.std[term]
    if evidence.spare < LEAST_SPARE:  # nearly as many parameters as readings fit whatever there is
        return None
    if cannot_be(source, refit, term, evidence):
        return None
    is_local = term.interval is not None
    others = refit.keys_given(term)
    information = predicted_lambda(evidence, term.key, beta, others)
    linear = information > LINEAR * gain  # else the derivative says nothing of it, and its whole gain alone counts
    scatter = 1.0 if is_local or not linear else statistic_of(evidence, term.key, others).scatter
    if evidence.noise_known:  # and perhaps too small
        scatter = max(scatter, noise_left(source, refit, term.effect.stream, slow=False))
    plain = log_p_of_deviance(evidence, gain, option.dof)
    log_p_raw = min(plain + option.search_raw, 0.0)
    log_p = min(log_p_of_deviance(evidence, gain, option.dof, scatter) + option.search_raw, 0.0)
    if is_local:  # what slow noise of its stream took off the evidence, and the noise that the refit leaves
        log_p = max(log_p, plain + option.search)
    log_odds = log_bayes_factor(evidence, term.key, beta, gain, others) - option.search_raw
    if is_local and log_odds < 0.0:
        log_p = 0.0
    return refit, Finding(term, beta, std, log_p, log_p_raw, log_odds, gain, information, (), search=option.search_raw)


def most_odds_of(log_p: float) -> float:
    """Logarithm of the largest Bayes factor for an effect that a p-value allows: -1 / (e p log p) below p = 1 / e, 1
    above (T. Sellke, M. J. Bayarri, J. O. Berger, Am. Stat. 55(1), 2001, 62).
    """
    return -log_p - 1.0 - float(np.log(-log_p)) if log_p < -1.0 else 0.0


def cannot_be(source: Source, fit: Fit, term: Term, evidence: Evidence) -> bool:
    """Whether a term of a fit is negative where nothing is, or, of one that lasts or is on the IMU, far outside its
    plausible size by what the readings alone have for it, by the evidence of the fit's own terms.
    """
    if not term.effect.exists(fit.beta[term]):
        return True
    if term.interval is not None and term.effect.stream not in DRIVERS:
        return False
    most = IMPLAUSIBLE * evidence.plausible[evidence.columns(term.key)] + 2.0 * fit.std[term]
    return bool(np.any(np.abs(source.alone(fit, term, evidence)) > most))


def fit_without(source: Source, fit: Fit, *dropped: Term) -> Fit:
    """The fit of the same part without some of its terms, from where the others are."""
    rest = [term for term in fit.terms if term not in dropped]
    return source.fit(rest, {term: fit.beta[term] for term in rest}, fit.part)


def with_besides(source: Source, fit: Fit, besides: Mapping[Term, FloatArray]) -> tuple[Fit, tuple[Term, ...]]:
    """A fit with further terms in its model, and which those are: none where no model follows from all of them."""
    if not besides:
        return fit, ()
    try:
        return source.fit((*fit.terms, *besides), {**fit.beta, **besides}, fit.part), tuple(besides)
    except InputError:
        return fit, ()


def refitted(source: Source, fit: Fit) -> Fit:
    """The same fit of the readings that are left: some may have been set aside since."""
    return source.fit(fit.terms, fit.beta, fit.part)
