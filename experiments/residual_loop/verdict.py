"""What a trace says of a recording: one record, of which head line, sentences, figures and JSON are made.

An effect that passes its test on all data is found. It is in the head line, and in the model whose errors are reported,
if the error of the held-out data falls with it, or if no held-out reading can tell. Else it is said to pass the test on
all data but not to predict, with the errors that show it, and the model that is reported does not contain it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sinan.estimator.evidence.source import Fit, Source
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.manoeuvre import separating_manoeuvre
from sinan.experiments.residual_loop.prove import Change, Contribution, Proof, changes, prove
from sinan.experiments.residual_loop.remaining import Remaining
from sinan.experiments.residual_loop.select import Selection, updated
from sinan.experiments.residual_loop.trials import Finding, fit_without
from sinan.sensors.errors import InputError

#: Errors against a reference, by quantity: read after the decision, by whoever has the truth.
Score = Callable[[Fit], Mapping[str, float]]
#: The same of the plain model and of another.
BeforeAfter = tuple[Mapping[str, float], Mapping[str, float]]

#: Of the intervals' resampling, any date: another moves an end by sqrt(0.025 * 0.975 / 1000) / norm.pdf(1.96) = 0.08
#: sigma (`test_prove`).
_BOOTSTRAP_SEED = 20170707


@dataclass(frozen=True)
class Scores:
    """Errors against a reference.

    Attributes
    ----------
    on_all, held_out : of a fit on all data, and of one on the rest, counted on the held-out part
    reference : what the errors are against, for JSON
    """

    on_all: Score | None = None
    held_out: Score | None = None
    reference: Mapping[str, object] | None = None

    def of(self, selection: Selection, proof: Proof) -> tuple[BeforeAfter | None, BeforeAfter | None]:
        """Of the plain and the final model."""
        on_all = None if self.on_all is None else (self.on_all(selection.plain), self.on_all(selection.final))
        held = None if self.held_out is None else (self.held_out(proof.fits[0]), self.held_out(proof.fits[1]))
        return on_all, held


@dataclass(frozen=True)
class Named:
    """An effect that passes its test on all data.

    Attributes
    ----------
    finding : the effect, with its estimate in the model that is reported; of one that does not predict, in that with it
    contribution : what it does to the held-out error; None where no held-out reading can tell
    """

    finding: Finding
    contribution: Contribution | None

    @property
    def predicts(self) -> bool | None:
        """Whether the held-out error falls with it; None where no held-out reading can tell."""
        return None if self.contribution is None else self.contribution.falls


@dataclass(frozen=True)
class Twin:
    """One of several effects that explain the data equally well, and the errors of the model with it in their place.

    Attributes
    ----------
    named : the effect
    errors : held out, before and after, of every stream that one of them enters
    truth, truth_held_out : errors against a reference, plain and with it
    """

    named: Named
    errors: tuple[Change, ...]
    truth: BeforeAfter | None
    truth_held_out: BeforeAfter | None


@dataclass(frozen=True)
class Verdict:
    """The verdict and all that it rests on.

    Attributes
    ----------
    effects : that pass their test on all data, in order of discovery
    proof : errors before and after, of the model with those that are reported
    same_names : whether the fitting part alone chooses the same names; where no effect changes a mean, nothing is to be
        confirmed; None: not asked
    twins : where the first has rivals, itself and each of them
    rolled_back : effects that passed the test but that the held-out part speaks against
    remaining : what the model that is reported leaves
    truth, truth_held_out : errors against a reference, plain and of the model that is reported; None without one
    reference : what they are against, for JSON
    """

    effects: tuple[Named, ...]
    proof: Proof
    same_names: bool | None
    twins: tuple[Twin, ...]
    rolled_back: tuple[str, ...]
    remaining: tuple[Remaining, ...]
    truth: BeforeAfter | None
    truth_held_out: BeforeAfter | None
    reference: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        """Raise where the figures contradict the head line.

        Raises
        ------
        ValueError : the held-out data were asked, and their error does not fall
        """
        if self.proof.failing is not None:
            raise ValueError(f"{self.proof.failing.term.name} is reported, and its held-out error does not fall")

    @property
    def word(self) -> str:
        """The first that applies: ambiguous (the first effect has rivals), unexplained, ambiguous (a later one has),
        effects, no_effect.
        """
        if self.effects and self.effects[0].finding.rivals:
            return "ambiguous"
        if any(item.in_mean for item in self.remaining) or any(one.predicts is False for one in self.effects):
            return "unexplained"
        if self.doubtful is not None:
            return "ambiguous"
        return "effects" if self.effects else "no_effect"

    @property
    def doubtful(self) -> Finding | None:
        """The first of the effects that has rivals."""
        return next((one.finding for one in self.effects if one.finding.rivals), None)

    @property
    def reported(self) -> tuple[Finding, ...]:
        """The effects of the head line, which the model has whose errors are reported."""
        return tuple(one.finding for one in self.effects if one.predicts is not False)

    @cached_property
    def separates(self) -> str:
        """What would decide an ambiguous verdict; empty for the others."""
        if self.word != "ambiguous" or self.doubtful is None:
            return ""
        return separating_manoeuvre(self.doubtful.term.name, self.doubtful.confused_with)


@dataclass(frozen=True)
class Settled:
    """A selection after the held-out data were asked.

    Attributes
    ----------
    selection : everything that was found
    reported : the same without what does not predict
    proof : of that
    failed : what does not predict
    """

    selection: Selection
    reported: Selection
    proof: Proof
    failed: Mapping[Term, Contribution]

    @property
    def effects(self) -> tuple[Named, ...]:
        """All effects found, in order of discovery."""
        known = {one.term: one for one in self.proof.contributions} | dict(self.failed)
        reported = {finding.term: finding for finding in self.reported.findings}
        return tuple(Named(reported.get(f.term, f), known.get(f.term)) for f in self.selection.findings)


def settle(source: Source, selection: Selection) -> Settled:
    """Take out of the model that is reported what does not predict the held-out data, the last found first.

    One that has rivals gives its place to the first of them that does predict.
    """
    reported, failed = selection, dict[Term, Contribution]()
    while True:
        proof = proved(source, reported)
        failing = proof.failing
        if failing is None:
            return Settled(selection, reported, proof, failed)
        finding = next(f for f in reported.findings if f.term == failing.term)
        other = _rival_that_predicts(source, reported, finding)
        if other is not None:
            reported = in_place(source, reported, finding.term, other)
            selection = in_place(source, selection, finding.term, other)
        else:
            failed[failing.term] = failing
            reported = reported.with_final(fit_without(source, reported.final, failing.term))


def proved(source: Source, selection: Selection) -> Proof:
    """The proof of a selection, always with the same resampling."""
    return prove(source, selection, np.random.default_rng(_BOOTSTRAP_SEED))


def _rival_that_predicts(source: Source, reported: Selection, finding: Finding) -> Finding | None:
    """The likeliest rival of an effect that does predict; its own rivals are the others and that effect."""
    for rival in finding.rivals:
        others = (replace(finding, rivals=()), *(other for other in finding.rivals if other is not rival))
        one = replace(rival, rivals=others)
        try:
            failing = proved(source, in_place(source, reported, finding.term, one)).failing
        except InputError:  # no model follows from it
            continue
        if failing is None or failing.term != one.term:
            return one
    return None


def in_place(source: Source, selection: Selection, term: Term, finding: Finding) -> Selection:
    """The selection with an effect in the place of another, or given its effects where that is not among them."""
    terms = list(dict.fromkeys([finding.term if t == term else t for t in selection.final.terms] + [finding.term]))
    final = source.fit(terms, {**selection.final.beta, finding.term: finding.beta})
    found = {f.term: f for f in [finding if f.term == term else f for f in selection.findings] + [finding]}
    steps = [replace(step, term=finding.term) if step.term == term else step for step in selection.steps]
    evidence = source.evidence(final, own_terms_only=True)
    findings = tuple(updated(one, final, evidence) for one in found.values())
    return replace(selection, final=final, findings=findings, steps=tuple(steps))


def twins_of(source: Source, settled: Settled, scores: Scores) -> tuple[Twin, ...]:
    """The first effect and each of its rivals with the errors of the model that has it; none where it has no rival."""
    if not settled.selection.findings or not settled.selection.findings[0].rivals:
        return ()
    first = settled.selection.findings[0]
    models = []
    for one in (first, *first.rivals):
        try:
            model = in_place(source, settled.reported, first.term, one)
        except InputError:  # no model follows from it
            continue
        models.append((one.term, model, proved(source, model)))
    streams = list(dict.fromkeys(proof.stream for _, _, proof in models))
    twins = []
    for term, model, proof in models:
        named = Named(_found(model.findings, term), _contribution(proof, term))
        twins.append(Twin(named, changes(source, *proof.compared, streams), *scores.of(model, proof)))
    return tuple(twins)


def _found(findings: Iterable[Finding], term: Term) -> Finding:
    return next(finding for finding in findings if finding.term == term)


def _contribution(proof: Proof, term: Term) -> Contribution | None:
    failing = proof.failing
    if failing is not None and failing.term == term:
        return failing
    return next((one for one in proof.contributions if one.term == term), None)


def joint(verdicts: Sequence[Verdict]) -> Verdict:
    """The verdict on several parts of one recording: what was found with the most evidence comes first.

    The proof is that of the part of the first effect, else of the one with the largest NIS, with the NIS of all.
    """
    waiting = [list(one.effects) for one in verdicts]
    effects: list[Named] = []
    while any(waiting):
        best = max((queue for queue in waiting if queue), key=lambda queue: queue[0].finding.log_odds)
        effects.append(best.pop(0))
    first = max(verdicts, key=lambda one: one.proof.nis_before)
    for one in verdicts:
        if any(named is effects[0] for named in one.effects[:1]):
            first = one
    return Verdict(
        tuple(effects),
        first.proof.with_nis_of([one.proof for one in verdicts]),
        all(said) if (said := [one.same_names for one in verdicts if one.same_names is not None]) else None,
        first.twins,
        tuple(name for one in verdicts for name in one.rolled_back),
        tuple(item for one in verdicts for item in one.remaining),
        first.truth,
        first.truth_held_out,
        first.reference,
    )
