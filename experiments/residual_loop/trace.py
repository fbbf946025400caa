"""The loop from beginning to end: detect, trace, decide, add, prove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.noise_left import noise_left
from sinan.estimator.evidence.score import CONFUSED, DETECTABLE_LAMBDA, Statistic, statistic_of
from sinan.estimator.evidence.source import Fit, LocalFinding, Source
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.prove import rolled_back
from sinan.experiments.residual_loop.remaining import patches, remaining, stands_out
from sinan.experiments.residual_loop.select import Selection, select, select_further
from sinan.experiments.residual_loop.trials import GIVEN_ERROR, ROLLED_BACK, Finding, fit_without, refitted
from sinan.experiments.residual_loop.verdict import Scores, Verdict, settle, twins_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError

#: Probes that may be in a model at once: bound of work (`bounds_of_work poses`).
MOST_SUSPECTS = 3
#: How many times better than every effect a probe has to be to be taken first: a choice, half and twice of which change
#: nothing of the poses (`bounds_of_work poses`).
OBVIOUS = 2.0
#: Times that the selection goes on, at most, without what withheld readings have spoken against: bound of work
#: (`bounds_of_work flight`).
_MOST_FALLS = 3


@dataclass(frozen=True)
class Trace:
    """What the loop found in one recording.

    Attributes
    ----------
    recording, alpha : name, family-wise error
    verdict : what is said of the recording
    selection : everything that was found, and the evidence
    final : the model whose errors are reported: without what does not predict the held-out data
    """

    recording: str
    alpha: float
    verdict: Verdict
    selection: Selection
    final: Fit


def trace(source: Source, alpha: float = ALPHA, scores: Scores | None = None) -> Trace:
    """Run the loop on a source.

    Parameters
    ----------
    alpha : family-wise error over all candidates
    scores : errors against a reference; called after the decision
    """
    selection, suspects = _select_given_suspects(source, alpha)
    selection, suspects, dropped = _borne_out(source, selection, suspects, alpha)
    settled, scores = settle(source, selection), scores or Scores()
    verdict = Verdict(
        settled.effects,
        settled.proof,
        _is_confirmed(source, settled.selection, suspects, alpha),
        twins_of(source, settled, scores),
        tuple(term.name for term in dropped),
        tuple(remaining(source, settled.reported.final, selection.left, suspects, alpha)),
        *scores.of(settled.reported, settled.proof),
        scores.reference,
    )
    return Trace(source.name, alpha, verdict, settled.selection, settled.reported.final)


def _borne_out(
    source: Source, selection: Selection, suspects: list[tuple[Term, Statistic]], alpha: float
) -> tuple[Selection, list[tuple[Term, Statistic]], tuple[Term, ...]]:
    """The selection without what the held-out data speak against, the probes needed besides, and what has fallen.

    What falls may have stood in the place of something else. Where noise is found and not declared, and withheld
    readings can be asked of any model, the selection goes on without it. But where it has predicted them better, only
    not surely, what comes in its place has to be called for besides it.
    """
    fallen: tuple[Finding, ...] = ()
    besides: dict[Term, FloatArray] = {}
    for round_ in range(_MOST_FALLS + 1):
        dropped = rolled_back(source, selection, alpha, besides) if selection.findings else {}
        if not dropped:
            break
        fallen += tuple(f for f in selection.findings if f.term in dropped)
        final, selection = selection.final, _without(source, selection, tuple(dropped), ROLLED_BACK)
        if not source.is_predicting:
            break
        if round_ < _MOST_FALLS:
            besides |= {term: final.beta[term] for term, better in dropped.items() if better}
            further = select_further(source, alpha, selection, fallen, besides)
            if {f.term for f in further.findings} != {f.term for f in selection.findings}:
                selection = further
                suspects = [one for one in suspects if _is_needed(source, further.final, *one)]
    return selection, suspects, tuple(f.term for f in fallen)


def _is_confirmed(
    source: Source, selection: Selection, suspects: Sequence[tuple[Term, Statistic]], alpha: float
) -> bool | None:
    """Whether the fitting part alone chooses the same names; so where no effect changes a mean. None where withheld
    readings of all parts are the proof, each predicted without the part that it is in.
    """
    if source.is_predicting:
        return None
    if not any(finding.term.in_mean for finding in selection.findings):
        return True
    given = {term: s.beta for term, s in suspects}
    chosen = (*selection.findings, *(finding for finding, _ in selection.dropped))
    intervals = any(finding.term.interval is not None for finding in chosen)
    return set(select(source, alpha, "fitting", given, intervals).names) == set(selection.names)


def _select_given_suspects(source: Source, alpha: float) -> tuple[Selection, list[tuple[Term, Statistic]]]:
    """The selection; where something remains that follows a thing of no catalogue, the selection given that.

    An error that the catalogue does not know takes the shape of what it knows. Once a probe for it is in the model from
    the start, only what the data call for besides is chosen. The final model has the effects alone, with the estimates
    that they have given the probe.
    """
    plain = _Plain(source)
    strongest = _passing(source, plain.fit, alpha)[:1]
    suspects = strongest if strongest and _is_obvious(plain, strongest[0][1]) else []
    selection = _given(source, alpha, suspects)
    alone = None if suspects else selection
    if not suspects and selection.plain.deviance != plain.fit.deviance:  # readings or noise are others now
        plain = _Plain(source)
        strongest = _passing(source, plain.fit, alpha)[:1]
    if not suspects and strongest and _explains_more(source, *strongest[0], selection):
        suspects = strongest
        selection = _given(source, alpha, suspects)
    fit, more = _more_suspects(source, selection.final, suspects, alpha)
    if len(more) > len(suspects):
        suspects = more
        jointly = _given(source, alpha, suspects)
        selection = _better(jointly, replace(selection, final=refitted(source, fit)))
    if not suspects:
        cut_out = patches(source, selection.final, selection.findings, alpha)
        return _without(source, selection, cut_out, GIVEN_ERROR) if cut_out else selection, suspects
    suspects, joint = _needed(source, selection, suspects)
    if not suspects:
        return _of_what_is_left(source, alone) if alone else select(source, alpha), []
    findings = tuple(f for f in selection.findings if stands_out(source, joint, f, suspects, alpha))
    terms = [finding.term for finding in findings]
    final = source.fit(terms, {term: joint.beta[term] for term in terms})
    final = replace(final, beta={t: joint.beta[t] for t in terms}, std={t: joint.std[t] for t in terms})
    jointly = replace(
        selection,
        plain=source.fit(()),  # of the readings that are left
        findings=findings,
        plain_statistics=plain.statistics,
        plain_local=plain.local,
        dropped=_dropped(selection, findings, GIVEN_ERROR),
    )
    return jointly.with_final(final), suspects


def _more_suspects(
    source: Source, fit: Fit, suspects: Sequence[tuple[Term, Statistic]], alpha: float
) -> tuple[Fit, list[tuple[Term, Statistic]]]:
    """The fit with every further probe that the data would miss, the strongest first; and all probes then."""
    more, in_vain = list(suspects), set[Term]()
    waiting = _passing(source, fit, alpha) if len(more) < MOST_SUSPECTS else []
    while waiting and len(more) < MOST_SUSPECTS:
        term, s = waiting.pop(0)
        with_it = _with(source, fit, term, s) if term not in in_vain else None
        if with_it is None or not _is_missed(source, with_it, fit, term, s):
            in_vain.add(term)
            continue
        fit = with_it
        more.append((term, s))
        if len(more) < MOST_SUSPECTS:
            waiting = _passing(source, fit, alpha)
    return fit, more


def _given(source: Source, alpha: float, suspects: Sequence[tuple[Term, Statistic]]) -> Selection:
    return select(source, alpha, given={term: s.beta for term, s in suspects})


def _with(source: Source, fit: Fit, term: Term, s: Statistic) -> Fit | None:
    """The fit with a probe as well; None where no model follows from it."""
    try:
        return source.fit((*fit.terms, term), {**fit.beta, term: s.beta}, fit.part)
    except InputError:
        return None


def _of_what_is_left(source: Source, selection: Selection) -> Selection:
    return replace(selection, plain=refitted(source, selection.plain)).with_final(refitted(source, selection.final))


def _better(jointly: Selection, found: Selection) -> Selection:
    """The selection given all probes; or what was found without some of them, with them added, where that explains as
    much, to what can be told apart, by Akaike's count of parameters and has other names: a probe can contain an
    effect's own functions.
    """
    if set(found.names) <= set(jointly.names) or _price(jointly.final) + CONFUSED < _price(found.final):
        return jointly
    return found


def _price(fit: Fit) -> float:
    """Akaike's criterion."""
    return fit.deviance + 2.0 * sum(len(beta) for term, beta in fit.beta.items() if term.in_mean)


class _Plain:
    """The plain fit, and what the catalogue makes of it: found when it is asked for, and once."""

    def __init__(self, source: Source) -> None:
        self._source, self.fit = source, source.fit(())

    @cached_property
    def statistics(self) -> tuple[Statistic, ...]:
        """Of every candidate."""
        evidence = self._source.evidence(self.fit)
        return tuple(statistic_of(evidence, entry.name) for entry in self._source.candidates)

    @cached_property
    def local(self) -> tuple[LocalFinding, ...]:
        """The best interval of each time-localised family."""
        return tuple(self._source.local_findings(self.fit))


def _is_obvious(plain: _Plain, suspect: Statistic) -> bool:
    """Whether a probe explains the plain residual far better than any effect of the catalogue.

    The intervals, which are searched, are asked last.
    """
    if suspect.statistic <= OBVIOUS * max((one.statistic for one in plain.statistics), default=0.0):
        return False
    return suspect.statistic > OBVIOUS * max((found.statistic for found in plain.local), default=0.0)


def _explains_more(source: Source, term: Term, suspect: Statistic, selection: Selection) -> bool:
    """Whether a probe alone explains more than all effects found together, by Akaike's count of parameters, and more
    than the noise that it leaves.

    The true effects leave nothing that could be explained, so nothing explains more than they do; where the two are not
    told apart, the effects stay.
    """
    gain = selection.plain.deviance - selection.final.deviance
    parameters = sum(len(finding.beta) for finding in selection.findings)
    if suspect.statistic - 2.0 * suspect.dof <= gain - 2.0 * parameters + CONFUSED:
        return False
    return _is_needed(source, selection.plain, term, suspect)


def _is_needed(source: Source, fit: Fit, term: Term, s: Statistic) -> bool:
    """Whether a probe that a fit has not is missed there."""
    with_it = _with(source, fit, term, s)
    return with_it is not None and _is_missed(source, with_it, fit, term, s)


def _passing(source: Source, fit: Fit, alpha: float) -> list[tuple[Term, Statistic]]:
    """Probes that pass their test about a fit and are strong enough to be seen by it always, the strongest first."""
    found = source.suspects(fit)
    passing = [
        (term, s)
        for term, s in found
        if s.log_p_corrected < np.log(alpha / len(found))
        and s.statistic / max(s.scatter, 1.0) - s.dof > DETECTABLE_LAMBDA
    ]
    return sorted(passing, key=lambda one: one[1].log_p)


def _needed(
    source: Source, selection: Selection, suspects: list[tuple[Term, Statistic]]
) -> tuple[list[tuple[Term, Statistic]], Fit]:
    """The probes that the data would miss given the effects found, and the fit with those alone."""
    fit = selection.final
    for term, s in list(suspects):
        without = fit_without(source, fit, term)
        if not _is_missed(source, fit, without, term, s):
            suspects = [one for one in suspects if one[0] != term]
            fit = without
    return suspects, fit


def _is_missed(source: Source, fit: Fit, without: Fit, term: Term, s: Statistic) -> bool:
    """Whether a probe explains more than noise would: it predicts withheld readings better, or where they cannot be
    asked explains more than the noise that it leaves.
    """
    gain = without.deviance - fit.deviance
    if source.is_predicting:
        return gain - s.dof >= DETECTABLE_LAMBDA and source.predicts(fit, without)
    noise = max(s.scatter, noise_left(source, fit, term.effect.stream, slow=True))
    return gain / noise - s.dof >= DETECTABLE_LAMBDA


def _without(source: Source, selection: Selection, dropped: tuple[Term, ...], why: str) -> Selection:
    left = selection.with_final(fit_without(source, selection.final, *dropped))
    return replace(left, dropped=_dropped(selection, left.findings, why))


def _dropped(selection: Selection, kept: Sequence[Finding], why: str) -> tuple[tuple[Finding, str], ...]:
    """What was dropped before, and the findings of a selection that are not kept now."""
    terms = {finding.term for finding in kept}
    return (*selection.dropped, *((finding, why) for finding in selection.findings if finding.term not in terms))
