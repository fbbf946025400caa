"""Decide which effects the evidence calls for: forward selection with exact refits, one effect at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.flights.prediction import can_be_predicted
from sinan.estimator.evidence.score import (
    Evidence,
    Statistic,
    log_p_of_deviance,
    log_p_of_estimate,
    log_p_value,
    predicted_lambda,
    statistic_of,
)
from sinan.estimator.evidence.source import Fit, LocalFinding, Part, Source, log_p_needed
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.options import Offered, Option
from sinan.experiments.residual_loop.shared_ends import merged
from sinan.experiments.residual_loop.trials import (
    IMPOSSIBLE,
    NO_EVIDENCE,
    ROLLED_BACK,
    SCATTERED,
    SHORTLIST,
    UNTRIED,
    Finding,
    Trial,
    best_of,
    best_pair,
    cannot_be,
    fit_without,
    refitted,
    with_besides,
)
from sinan.sensors.arrays import FloatArray

#: Effects beyond this number are not looked for, and what then remains is reported as unexplained: bound of work
#: (`bounds_of_work poses`).
MOST_EFFECTS = 6
#: The same given an error that is in no catalogue: bound of work (`bounds_of_work flight`).
MOST_GIVEN_ERROR = 3
#: Length of the shortlist given an error that is in no catalogue: half of `SHORTLIST`, since in its model a pass costs
#: several times as much.
SHORTLIST_GIVEN_ERROR = 3
#: Intervals beyond this number patch up an error that has no name, and stay in what remains: bound of work
#: (`bounds_of_work poses`).
MOST_LOCAL = 3

#: Times that readings are set aside for what would have been a disturbance of one or two: bound of work
#: (`bounds_of_work flight`).
_MOST_ROUNDS = 3
#: Share of what the information predicts that the loss of an effect costs at least, whatever its form; where that is
#: enough, no refit asks: bound of work (`bounds_of_work weak`).
_PREDICTED = 0.1


@dataclass(frozen=True)
class Step:
    """One step of the selection: the model before it, and the effect that was then added; of a pair, each given the
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
    plain_local : the best interval of each time-localised family about the plain model
    final_statistics : of every candidate that was not accepted, about the final model
    left : options that pass the test about the final model but were not accepted, strongest first
    steps : every effect that was added, with the model without it, in order; one may have been dropped since
    last_options : everything that was not in the model at the last step, about the model of that step
    refused : of those that pass the test, by key, why they were not accepted
    dropped : effects that were chosen and then did not stand, each with the reason
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
    refused: Mapping[str, str] = field(default_factory=dict)
    dropped: tuple[tuple[Finding, str], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects found, each once."""
        return tuple(dict.fromkeys(finding.term.name for finding in self.findings))

    def with_final(self, final: Fit) -> Selection:
        """The selection with another final model, and the estimates there of those of its effects that are in it."""
        findings = []
        for f in self.findings:
            if f.term in final.beta:
                std = f.spread * final.std[f.term]
                unseen = ~np.isfinite(f.std) & (not f.at_least)
                bound = f.term.in_mean and bool(np.all(np.isinf(std)))
                std = np.where(unseen, np.inf, std)
                findings.append(replace(f, beta=final.beta[f.term], std=std, at_least=bound))
        return replace(self, final=final, findings=tuple(findings))


def select(
    source: Source,
    alpha: float = ALPHA,
    part: Part = "all",
    given: Mapping[Term, FloatArray] | None = None,
    intervals: bool = True,
) -> Selection:
    """Forward selection: take the best effect that passes, refit, repeat until nothing earns its place.

    1. All candidates are scored about the present fit, the effects already in it projected out, and the intervals.
    2. Those that pass at family-wise error alpha form the shortlist; where none does because strong effects inflate
       each other's scatter, those that pass without it are tried, and have to pass with it after the refit.
    3. The shortlist, and what the score does not see, is refitted in exact form; the likeliest plausible one is
       accepted, an interval only where it is likelier than none, and readings that it had hidden and that are wrong are
       set aside. So are the readings of an interval too short for a disturbance, which is not accepted.
    4. An effect that another has made superfluous is dropped, and two offsets of one stream that share an end are
       reported as one where the data do not notice.
    5. Where nothing stands alone in a calibration whose noise is estimated with the fit, so that each of two effects is
       noise to the other, pairs are tried; in flights never.
    6. What the final model cannot tell from none, with the very error that is reported of it, is dropped.

    Parameters
    ----------
    alpha : family-wise error over all candidates
    part : the data that may be used
    given : terms that are in the model from the start and stay there, with a first estimate
    intervals : whether they are searched; else wrong readings alone are
    """
    most, shortlist = (MOST_GIVEN_ERROR, SHORTLIST_GIVEN_ERROR) if given else (MOST_EFFECTS, SHORTLIST)
    fit, threshold = source.fit(tuple(given or ()), given, part), log_p_needed(source, alpha)
    path = _Path(source, fit, threshold, (lambda _: True) if intervals else None)
    path.take_on(most, shortlist)
    path.drop_what_may_be_none(alpha)
    return path.selection()


def select_further(
    source: Source, alpha: float, start: Selection, fallen: Sequence[Finding], besides: Mapping[Term, FloatArray]
) -> Selection:
    """The selection gone on with, from its final model, without what the held-out part does not bear out.

    What lasts may have stood in the place of an interval. Most of those are too short to be asked of withheld readings,
    and must not take the place of what those have spoken against but where they were as likely (`open_after`).

    Parameters
    ----------
    alpha : family-wise error over all candidates
    start : a selection on all data, with no term given
    fallen : what is not tried again; of intervals none of that name is
    besides : terms that are in the model while others are chosen, with a first estimate
    """
    barred, is_open = frozenset(f.term.key for f in fallen), open_after(fallen)
    fit, beside = with_besides(source, start.final, besides)
    threshold = log_p_needed(source, alpha)
    path = _Path(source, fit, threshold, is_open, start, barred)
    path.take_on(MOST_EFFECTS, SHORTLIST)
    if beside:  # what is said is said of the model without them
        found = path.selection()
        path = _Path(source, fit_without(source, found.final, *beside), threshold, is_open, found, barred)
    path.drop_what_may_be_none(alpha)
    return replace(
        path.selection(),
        plain=refitted(source, start.plain),
        plain_statistics=start.plain_statistics,
        plain_local=start.plain_local,
        dropped=start.dropped,
    )


def open_after(fallen: Sequence[Finding]) -> Callable[[Term], bool]:
    """Which intervals may come in the place of what has fallen: those that withheld readings can be asked of, and those
    that were as likely, by name and where they overlap; none of a name that has fallen.
    """
    in_vain = {f.term.name for f in fallen if f.term.interval is not None}
    as_likely = [rival.term for f in fallen for rival in f.rivals]
    return lambda term: (
        term.name not in in_vain
        and (can_be_predicted(term) or any(one.name == term.name and _overlap(one, term) for one in as_likely))
    )


def _overlap(one: Term, other: Term) -> bool:
    """Whether the intervals of two terms have a time in common."""
    if one.interval is None or other.interval is None:
        return False
    return max(one.interval[0], other.interval[0]) < min(one.interval[1], other.interval[1])


class _Path:
    """A selection as it goes: the model so far, what is offered to it, and what did not stand.

    Attributes
    ----------
    is_open : which intervals may be taken; None: they are not searched
    findings : effects in the model, in order of discovery
    """

    def __init__(
        self,
        source: Source,
        fit: Fit,
        threshold: float,
        is_open: Callable[[Term], bool] | None,
        start: Selection | None = None,
        barred: frozenset[str] = frozenset(),
    ) -> None:
        self._source, self._threshold, self._is_open = source, threshold, is_open
        self._plain = self._fit = fit
        self.findings: list[Finding] = [] if start is None else list(start.findings)
        self._steps: list[Step] = [] if start is None else list(start.steps)
        self._barred = dict.fromkeys(barred, ROLLED_BACK)
        self._refused = dict(self._barred)  # by key what did not stand, and why
        self._ousted: list[str] = []  # keys of what could not be any longer once something else was in the model
        self._rounds = self._unions = 0
        self._apart: set[frozenset[Term]] = set()  # offsets that one does not explain
        self._first = self._offered = self._offer()

    def _offer(self) -> Offered:
        """What may be added to the present fit, once it has no effect in it that cannot be as it is now."""
        for term in [f.term for f in self.findings if f.term.in_mean]:
            evidence = self._source.evidence(self._fit, own_terms_only=True)
            if cannot_be(self._source, self._fit, term, evidence):
                self._drop(term, IMPOSSIBLE)
        offered = Offered(self._source, self._fit, self._is_open is not None)
        if self._is_open is not None:
            offered.options = [o for o in offered.options if o.term.interval is None or self._is_open(o.term)]
        return offered

    def _drop(self, term: Term, why: str) -> None:
        """Take an effect out of the model."""
        self._fit = fit_without(self._source, self._fit, term)
        self.findings = [f for f in self.findings if f.term != term]
        self._refused[term.key] = why
        if why == IMPOSSIBLE:
            self._ousted.append(term.key)

    def take_on(self, most: int, shortlist: int) -> None:
        """One effect after the other, until nothing earns its place or there are `most`."""
        while len(self.findings) < most:
            best = self.best(shortlist)
            if best is None:
                pair = self.best_pair() if len(self.findings) + 2 <= most else None
                if pair is None:
                    break
                self.add_pair(*pair)
            elif not self.set_aside_instead(*best):
                self.add(*best)

    def drop_what_may_be_none(self, alpha: float) -> None:
        """Drop effects whose estimate may be zero by its own error: by b' Lambda b over the scatter of its blocks, one
        hypothesis each, as they have been found; the weakest first.

        A likelihood that grows with what changes hardly a reading has grown because the motion is another one.
        """
        while True:
            told = [updated(f, self._fit, self._offered.evidence) for f in self.findings if f.term.in_mean]
            evidence = self._offered.evidence
            doubts = [
                (log_p_of_estimate(evidence, f.information / f.spread**2, len(f.beta)), f.term)
                for f in told if not f.at_least
            ]  # fmt: skip
            log_p, term = max(doubts, key=lambda one: one[0], default=(-np.inf, None))
            if term is None or log_p < np.log(alpha):
                return
            self._drop(term, NO_EVIDENCE)
            self._offered = self._offer()

    def best(self, shortlist: int) -> Trial | None:
        """The best that stands of what is offered, with its fit."""
        full = sum(finding.term.interval is not None for finding in self.findings) >= MOST_LOCAL
        options = self._offered.open_to(full)
        return best_of(self._source, self._fit, options, self._threshold, self._refused, shortlist)

    def best_pair(self) -> tuple[Fit, list[Trial]] | None:
        """See `trials.best_pair`."""
        return best_pair(self._source, self._fit, self._offered.evidence, self._threshold)

    def add(self, fit: Fit, finding: Finding) -> None:
        """Take an effect, then set aside what it had hidden and drop what it makes superfluous."""
        unchanged = fit.deviance == self._fit.deviance
        self._steps.append(Step(self._fit, finding.term))
        self._fit = fit
        self.findings.append(finding)
        self._refused = {key: why for key, why in self._refused.items() if not self._is_open_again(key, why)}
        if unchanged:  # readings that were set aside beforehand now have a name
            self._offered.drop(finding.term)
            return
        if fit.part == "all" and self._source.set_aside(fit):  # readings that the effect had hidden
            self._refit()
        self._fit, self.findings = _prune(self._source, self._fit, self.findings, self._threshold)
        self._tell_as_one()
        self._offered = self._offer()

    def _is_open_again(self, key: str, why: str) -> bool:
        """Whether an option did not stand by what the model lacked; what has gone from it twice for that stays out."""
        return why in (SCATTERED, IMPOSSIBLE) and self._ousted.count(key) < 2

    def _tell_as_one(self) -> None:
        """Put one offset in the place of two that share an end; not without end, as more may be found again."""
        while self._unions < MOST_LOCAL:
            one = merged(self._source, self._fit, self.findings, self._threshold, self._apart)
            if one is None:
                break
            self._unions += 1
            self._fit = one.fit
            self._steps.append(Step(one.without, one.finding.term))
            self.findings = [one.finding if f is one.parts[0] else f for f in self.findings if f is not one.parts[1]]

    def add_pair(self, fit: Fit, both: Sequence[Trial]) -> None:
        """Take two effects, each with the fit without it."""
        self._fit = fit
        self._steps += [Step(before, finding.term) for before, finding in both]
        self.findings += [finding for _, finding in both]
        self._refused = dict(self._barred)
        self._offered = self._offer()

    def set_aside_instead(self, fit: Fit, finding: Finding) -> bool:
        """Set the readings of an effect aside that lasts too short for a disturbance; whether it was one."""
        if fit.part != "all" or self._rounds >= _MOST_ROUNDS or not self._source.set_aside_within(fit, finding.term):
            return False
        self._rounds += 1
        self._refit()
        self._refused = dict(self._barred)
        self._offered = self._offer()
        if not self.findings:
            self._first = self._offered
        return True

    def _refit(self) -> None:
        """The plain and the present fit of the readings that are left."""
        self._plain, self._fit = refitted(self._source, self._plain), refitted(self._source, self._fit)

    def selection(self) -> Selection:
        """All of it, the findings as the present fit has them."""
        return Selection(
            self._plain,
            self._fit,
            findings=tuple(updated(finding, self._fit, self._offered.evidence) for finding in self.findings),
            plain_statistics=self._first.statistics,
            plain_local=tuple(self._first.local),
            final_statistics=self._offered.statistics,
            left=self._left(),
            steps=tuple(self._steps),
            last_options=tuple(self._offered.options),
            refused={option.term.key: self._refused.get(option.term.key, UNTRIED) for option in self._passing()},
        )

    def _passing(self) -> list[Option]:
        """Options that pass the test about the present fit."""
        return [option for option in self._offered.options if option.log_p < self._threshold]

    def _left(self) -> tuple[Option, ...]:
        """What passes but was not accepted, strongest first: what lost its evidence in the refit is nothing; what could
        not be that effect still is something.
        """
        still = [option for option in self._passing() if self._refused.get(option.term.key, IMPOSSIBLE) == IMPOSSIBLE]
        return tuple(sorted(still, key=lambda option: option.log_p))


def _prune(source: Source, fit: Fit, findings: list[Finding], threshold: float) -> tuple[Fit, list[Finding]]:
    """Drop an earlier effect whose removal the data would not notice now that a later one is in the model."""
    if len(findings) < 2:
        return fit, findings
    evidence = source.evidence(fit, own_terms_only=True)
    for finding in findings[:-1]:
        term, dof = finding.term, len(finding.beta)
        if not term.in_mean:
            continue
        predicted = predicted_lambda(evidence, term.key, fit.beta[term], fit.keys_given(term))
        if evidence.noise_known and log_p_value(_PREDICTED * predicted, dof) < threshold:
            continue  # a refit would not find otherwise
        without = fit_without(source, fit, term)
        if log_p_of_deviance(evidence, without.deviance - fit.deviance, dof) > threshold:
            return _prune(source, without, [f for f in findings if f.term != term], threshold)
    return fit, findings


def updated(finding: Finding, fit: Fit, evidence: Evidence) -> Finding:
    """The finding with its estimate in the final model."""
    term = finding.term
    beta = fit.beta[term]
    information, spread, std = finding.information, 1.0, fit.std[term]
    if term.in_mean:
        others = fit.keys_given(term)
        information = predicted_lambda(evidence, term.key, beta, others)
        s = statistic_of(evidence, term.key, others)
        spread = float(np.sqrt(max(s.scatter, 1.0)))
        std = np.where(np.isfinite(s.std), std, np.inf)
    bound = term.in_mean and bool(np.all(np.isinf(fit.std[term])))
    std = np.full(len(beta), np.inf) if bound else spread * std
    return replace(finding, beta=beta, std=std, information=information, spread=spread, at_least=bound)
