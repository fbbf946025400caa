"""What became of every candidate: the p-value by which it was judged, and why it is not among the effects found."""

from __future__ import annotations

from dataclasses import dataclass

from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.select import Selection


@dataclass(frozen=True)
class Judged:
    """One candidate that was not found.

    Attributes
    ----------
    term : the effect
    log_p : logarithm of the p-value by which it was judged: about the last model; of one that was chosen and dropped
        again, at the step at which it was chosen
    why : it passes its test, but did not stand: a reason of `trials`; else empty
    """

    term: Term
    log_p: float
    why: str


def judged(selection: Selection) -> list[Judged]:
    """Every candidate that was not found and that the data could show, the strongest first."""
    dropped = [Judged(finding.term, finding.log_p, why) for finding, why in selection.dropped]
    known = {one.term.key for one in dropped}
    offered = [
        Judged(option.term, option.log_p, selection.refused.get(option.term.key, ""))
        for option in selection.last_options
        if option.dof > 0 and option.term.key not in known
    ]
    return sorted([*dropped, *offered], key=lambda one: one.log_p)
