"""Decide which effects the evidence calls for: forward selection with exact refits, one effect at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from estimator.score import (
    Evidence,
    Statistic,
    gain_of_ratio,
    log_bayes_factor,
    log_p_of_deviance,
    log_p_value,
    predicted_lambda,
    statistic_of,
)
from experiments.residual_loop.noise_left import noise_left
from experiments.residual_loop.options import (
    Offered,
    Option,
    blind_spots,
    not_slow_noise,
    option_of,
)
from experiments.residual_loop.source import LEAST_SPARE, Fit, LocalFinding, Part, Source, log_p_needed
from experiments.residual_loop.term import Term
from sensors.arrays import FloatArray
from sensors.errors import InputError

#: Effects beyond this number are not looked for: what then remains is reported as unexplained.
MOST_EFFECTS = 6
#: The same beside an error that is in no catalogue.
MOST_BESIDE = 3
#: Refits of the shortlist cost a pass each; a candidate below a quarter of the best statistic was never the best after
#: it.
SHORTLIST, SHORTLIST_SHARE = 6, 0.25
#: Where nothing on a shortlist stands its refit, the next is tried: so many at a step.
SHORTLISTS = 2
#: Length of the shortlist beside an error that is in no catalogue, in whose model a pass costs several times as much.
SHORTLIST_BESIDE = 3
#: Intervals beyond this number patch up an error that has no name: they stay in what remains.
MOST_LOCAL = 3
#: Two models whose odds differ by a factor of less than exp(5) are not told apart (Kass and Raftery 1995: 2 log of the
#: Bayes factor above 10 is "very strong" evidence).
CONFUSED = 10.0
#: An estimate beyond this many plausible sizes is not accepted as that effect: plausible sizes are one sigma of what is
#: sold, and ten of them is another instrument.
IMPLAUSIBLE = 10.0


#: Times that readings are set aside for what would have been a disturbance of one or two.
_MOST_ROUNDS = 3
#: A localised effect is looked for again about its own fit, so often at most.
_RELOCATIONS = 3
#: Why an option did not stand: slow noise of a stream explains it; the refit left no evidence; it cannot be.
SLOW_NOISE, NO_EVIDENCE, IMPOSSIBLE = "slow noise", "no evidence", "impossible"
#: Share of what the information foretells that the loss of an effect costs at least, whatever its form.
_FORETOLD = 0.1


@dataclass(frozen=True)
class Finding:
    """An effect that was accepted.

    Attributes
    ----------
    term, beta, std : the effect and its estimate in the final model
    log_p : logarithm of the p-value of the exact refit, corrected for scatter and search
    log_p_raw : the same without the scatter
    log_odds : logarithm of the Bayes factor against no effect, less that of the search: by it effects are compared
    gain : drop of -2 log L that it brought
    information : beta' Lambda beta, the others projected out
    confused_with : names of effects that are as likely
    spread : factor that is in `std`: the root of the scatter of the block scores, where noise is larger than declared
    """

    term: Term
    beta: FloatArray
    std: FloatArray
    log_p: float
    log_p_raw: float
    log_odds: float
    gain: float
    information: float
    confused_with: tuple[str, ...]
    spread: float = 1.0


@dataclass(frozen=True)
class Step:
    """One step of the selection: the model before it, and the effect that was then added; of a pair, each beside the
    other.
    """

    before: Fit
    term: Term


@dataclass(frozen=True)
class Selection:
    """The path from the plain model to the final one.

    Attributes
    ----------
    plain, final : without and with the effects, both of the readings that are left in the end
    findings : what was accepted, in order of discovery
    plain_statistics : of every candidate, about the plain model
    plain_local : the best interval of each time-localised family about the plain model, where they were searched
    final_statistics : of every candidate that was not accepted, about the final model
    left : options that pass the test about the final model but were not accepted, strongest first
    steps : every effect that was added, with the model without it, in order; one may have been dropped since
    last_options : everything that was not in the model at the last step, about the model of that step
    """

    plain: Fit
    final: Fit
    findings: tuple[Finding, ...]
    plain_statistics: tuple[Statistic, ...]
    plain_local: tuple[LocalFinding, ...]
    final_statistics: tuple[Statistic, ...]
    left: tuple[Option, ...]
    steps: tuple[Step, ...] = ()
    last_options: tuple[Option, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects found, each once."""
        return tuple(dict.fromkeys(finding.term.name for finding in self.findings))


def select(
    source: Source, alpha: float = 0.01, part: Part = "all", given: Mapping[Term, FloatArray] | None = None
) -> Selection:
    """Forward selection: take the best effect that passes, refit, repeat until nothing earns its place.

    1. All candidates are scored about the present fit, the effects already in it projected out; where none of them
       stands, the intervals too.
    2. Those that pass at family-wise error alpha form the shortlist; where none does because strong effects inflate
       each other's scatter, those that pass without it are tried, and have to pass with it after the refit. What slow
       noise of a stream explains is not tried.
    3. The shortlist, and what the score does not see, is refitted in exact form; the strongest plausible one is
       accepted, and readings that it had hidden and that are wrong are set aside. So are the readings of an interval
       too short for a disturbance, which is not accepted.
    4. An effect that another has made superfluous is dropped.
    5. Where nothing stands alone and the noise is estimated, so that each of two effects is noise to the other, pairs
       are tried.

    Parameters
    ----------
    alpha : family-wise error over all candidates
    part : the data that may be used
    given : terms that are in the model from the start and stay there, with a first estimate
    """
    threshold = log_p_needed(source, alpha)
    most, shortlist = (MOST_BESIDE, SHORTLIST_BESIDE) if given else (MOST_EFFECTS, SHORTLIST)
    plain = fit = source.fit(tuple(given or ()), given, part)
    evidence = source.evidence(fit)
    findings: list[Finding] = []
    steps: list[Step] = []
    refused: dict[str, str] = {}
    rounds = 0
    first = offered = Offered(source, fit, evidence, threshold, refused)
    while len(findings) < most:
        full = sum(f.term.interval is not None for f in findings) >= MOST_LOCAL
        accepted = _best(source, fit, offered.open_to(full), threshold, refused, shortlist)
        if accepted is None and not offered.searched:  # what was to come before any interval did not stand
            offered.search()
            continue
        if accepted is None:
            pair = _pair(source, fit, evidence, threshold) if len(findings) + 2 <= most else None
            if pair is None:
                break
            fit, both = pair
            steps += [Step(before, finding.term) for before, finding in both]
            findings += [finding for _, finding in both]
            refused.clear()
            evidence = source.evidence(fit)
            offered = Offered(source, fit, evidence, threshold, refused)
            continue
        if part == "all" and rounds < _MOST_ROUNDS and source.set_aside_within(accepted[0], accepted[1].term):
            rounds += 1  # what lasted so short was no disturbance
            plain, fit = source.fit(plain.terms, plain.beta, part), source.fit(fit.terms, fit.beta, part)
            evidence, refused = source.evidence(fit), {}
            offered = Offered(source, fit, evidence, threshold, refused)
            if not findings:
                first = offered
            continue
        steps.append(Step(fit, accepted[1].term))
        unchanged = accepted[0].deviance == fit.deviance
        fit, finding = accepted
        findings.append(finding)
        refused = {key: why for key, why in refused.items() if why != SLOW_NOISE}  # of that model
        if unchanged:  # readings that were set aside beforehand now have a name
            offered.options = [option for option in offered.options if option.term != finding.term]
            continue
        if part == "all" and source.set_aside(fit):  # readings that the effect had hidden
            plain, fit = source.fit(plain.terms, plain.beta, part), source.fit(fit.terms, fit.beta, part)
        fit, findings = _prune(source, fit, findings, threshold)
        evidence = source.evidence(fit)
        offered = Offered(source, fit, evidence, threshold, refused)
    found = tuple(_updated(finding, fit, evidence) for finding in findings)
    # what lost its evidence in the refit is nothing; what could not be that effect still is something
    passing = (o for o in offered.options if o.log_p < threshold and refused.get(o.term.key, IMPOSSIBLE) == IMPOSSIBLE)
    left = tuple(sorted(passing, key=lambda o: o.log_p))
    path = tuple(steps), tuple(offered.options)
    return Selection(plain, fit, found, first.statistics, tuple(first.local), offered.statistics, left, *path)


def _best(
    source: Source,
    fit: Fit,
    options: Sequence[Option],
    threshold: float,
    refused: dict[str, str],
    most: int,
    rounds: int = SHORTLISTS,
) -> tuple[Fit, Finding] | None:
    """Refit the shortlist and take the likeliest that is plausible and passes; None where nothing does.

    The scatter of the block scores decides what passes, the odds what is taken: two strong effects inflate each other's
    scatter, and an interval, which has none, must not go before them for that. `refused` learns by key what did not
    stand, and why.
    """
    unseen = blind_spots(source, fit, options, refused)
    seen = [o for o in options if o.term.key not in refused and o.term not in {other.term for other in unseen}]
    passing = [o for o in seen if o.log_p < threshold]
    if not passing:
        passing = [o for o in seen if o.log_p_raw < threshold and o.term.interval is None]
    if not passing and not unseen:
        return None
    passing.sort(key=lambda o: o.log_p_raw)
    shortlist = [o for o in passing if o.statistic >= SHORTLIST_SHARE * passing[0].statistic][:most]
    to_try = [*not_slow_noise(source, fit, shortlist, threshold), *unseen]
    shortlist += unseen
    tried = {o.term.key: _trial(source, fit, o) for o in to_try}
    trials = [trial for trial in tried.values() if trial is not None and trial[1].log_p < threshold]
    if not trials:
        for option in shortlist:
            key = option.term.key
            refused[key] = SLOW_NOISE if key not in tried else IMPOSSIBLE if tried[key] is None else NO_EVIDENCE
        return _best(source, fit, options, threshold, refused, most, rounds - 1) if rounds > 1 else None
    trials.sort(key=lambda trial: -trial[1].log_odds)
    chosen, finding = trials[0]
    rivals = tuple(
        other.term.name
        for _, other in trials[1:]
        if finding.term.in_mean
        and other.term.in_mean
        and 2.0 * (finding.log_odds - other.log_odds) < CONFUSED
        and other.term.name != finding.term.name
    )
    return chosen, replace(finding, confused_with=rivals)


def _pair(
    source: Source, fit: Fit, evidence: Evidence, threshold: float
) -> tuple[Fit, list[tuple[Fit, Finding]]] | None:
    """The likeliest pair of lasting effects, where the noise is estimated: with one of them alone, the other is part of
    the noise. The pair has to pass among all pairs, and in the refit each of them beside the other.

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
            s = statistic_of(source.evidence(without), term.name, [*fit.keys, rest.key])
            trial = _trial(source, without, option_of(s))
            if trial is None or trial[1].log_p + searched > threshold:
                return None
            found.append((without, trial[1]))
    except InputError:  # no model follows from the two
        return None
    return both, found


def _trial(source: Source, fit: Fit, option: Option) -> tuple[Fit, Finding] | None:
    """Refit with one more effect; None where it cannot be: its estimate is far outside its plausible size, no model
    follows from it, or hardly a reading is left that could say otherwise.
    """
    term = option.term
    try:
        refit = source.fit((*fit.terms, term), {**fit.beta, term: option.beta}, fit.part)
    except InputError:  # no state or covariance that could be: this is not what happened
        return None
    for _ in range(_RELOCATIONS if term.interval is not None else 0):
        moved = source.relocated(refit, term)
        if moved == term:
            break
        start = {**fit.beta, moved: refit.beta[term]}
        again = source.fit((*fit.terms, moved), start, fit.part)
        if again.deviance >= refit.deviance:
            break
        refit, term = again, moved
    gain = fit.deviance - refit.deviance
    if not term.in_mean:
        return refit, Finding(
            term, refit.beta[term], refit.std[term], option.log_p, option.log_p_raw, -option.log_p_raw, gain,
            option.statistic, (),
        )  # fmt: skip
    evidence = source.evidence(refit, own_terms_only=True)
    beta, std = refit.beta[term], refit.std[term]
    plausible = evidence.plausible[evidence.columns(term.key)]
    if evidence.spare < LEAST_SPARE:  # nearly as many parameters as readings fit whatever there is
        return None
    if np.any(np.abs(beta) - 2.0 * std > IMPLAUSIBLE * plausible):
        return None
    others = refit.keys_beside(term)
    is_local = term.interval is not None
    scatter = 1.0 if is_local else statistic_of(evidence, term.key, others).scatter
    if evidence.noise_known:  # and perhaps too small
        scatter = max(scatter, noise_left(source, refit, source.effect(term).stream, slow=False))
    plain = log_p_of_deviance(evidence, gain, option.dof)
    log_p_raw = min(plain + option.search_raw, 0.0)
    log_p = min(log_p_of_deviance(evidence, gain, option.dof, scatter) + option.search_raw, 0.0)
    if is_local:  # what slow noise of its stream took off the evidence, and the noise that the refit leaves
        log_p = max(log_p, plain + option.search)
    log_p = min(max(log_p, source.log_p_beside_slow_noise(refit, [term])[0] + option.search_raw), 0.0)
    log_odds = log_bayes_factor(evidence, term.key, beta, gain, others) - option.search_raw
    information = predicted_lambda(evidence, term.key, beta, others)
    return refit, Finding(term, beta, std, log_p, log_p_raw, log_odds, gain, information, ())


def fit_without(source: Source, fit: Fit, *dropped: Term) -> Fit:
    """The fit of the same part without some of its terms, from where the others are."""
    rest = [term for term in fit.terms if term not in dropped]
    return source.fit(rest, {term: fit.beta[term] for term in rest}, fit.part)


def _prune(source: Source, fit: Fit, findings: list[Finding], threshold: float) -> tuple[Fit, list[Finding]]:
    """Drop an earlier effect whose removal the data would not notice now that a later one is in the model."""
    if len(findings) < 2:
        return fit, findings
    evidence = source.evidence(fit, own_terms_only=True)
    for finding in findings[:-1]:
        term, dof = finding.term, len(finding.beta)
        if not term.in_mean:
            continue
        foretold = predicted_lambda(evidence, term.key, fit.beta[term], fit.keys_beside(term))
        if evidence.noise_known and log_p_value(_FORETOLD * foretold, dof) < threshold:
            continue  # a refit would not find otherwise
        without = fit_without(source, fit, term)
        if log_p_of_deviance(evidence, without.deviance - fit.deviance, dof) > threshold:
            return _prune(source, without, [f for f in findings if f.term != term], threshold)
    return fit, findings


def _updated(finding: Finding, fit: Fit, evidence: Evidence) -> Finding:
    """The finding with its estimate in the final model."""
    term = finding.term
    beta = fit.beta[term]
    information, spread, std = finding.information, 1.0, fit.std[term]
    if term.in_mean:
        others = fit.keys_beside(term)
        information = predicted_lambda(evidence, term.key, beta, others)
        s = statistic_of(evidence, term.key, others)
        spread = float(np.sqrt(max(s.scatter, 1.0)))
        std = np.where(np.isfinite(s.std), std, np.inf)
    return replace(finding, beta=beta, std=spread * std, information=information, spread=spread)
