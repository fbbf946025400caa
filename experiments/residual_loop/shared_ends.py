"""Two offsets of one stream that share an end are one, where the data do not notice: a step that was found late is told
as a step from an earlier time on and a transient that takes back its beginning.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from estimator.score import log_p_of_deviance
from experiments.residual_loop.options import Option
from experiments.residual_loop.source import Fit, Source
from experiments.residual_loop.term import Term
from experiments.residual_loop.trials import Finding, fit_without, trial

#: Ends are shared where they differ by less than this share of the shorter interval.
_SHARED = 0.1


def told_as_one(
    source: Source, fit: Fit, findings: Sequence[Finding], threshold: float
) -> tuple[Fit, Fit, Finding, tuple[Term, Term]] | None:
    """The first two offsets that one explains as well: with it in their place a second would not be found.

    Parameters
    ----------
    threshold : logarithm of the p-value below which an effect is found

    Returns
    -------
    the fit without the two, that with the one, its finding, and the two; None where there are none such
    """
    local = [finding for finding in findings if finding.term.interval is not None]
    for first, second in combinations(local, 2):
        term = _between(first.term, second.term)
        if term is None:
            continue
        both = (first.term, second.term)
        without = fit_without(source, fit, *both)
        longer = max(first, second, key=lambda finding: _length(finding.term))
        search, size = max(first.search, second.search), len(longer.beta)
        tried = trial(source, without, Option(term, 0.0, size, 0.0, 0.0, search, search, fit.beta[longer.term]))
        if tried is None or tried[1].log_p >= threshold:
            continue
        lost = log_p_of_deviance(source.evidence(tried[0], own_terms_only=True), tried[0].deviance - fit.deviance, size)
        if lost + search > threshold:
            return without, *tried, both
    return None


def _length(term: Term) -> float:
    assert term.interval is not None
    return term.interval[1] - term.interval[0]


def _between(first: Term, second: Term) -> Term | None:
    """An offset of their stream between the ends that two do not share; None where they share none, or all."""
    stream = first.name.split(".")[0]
    if second.name.split(".")[0] != stream or first.interval is None or second.interval is None:
        return None
    near = _SHARED * min(_length(first), _length(second))
    (a, b), (c, d) = first.interval, second.interval
    apart = {(0, 0): (b, d), (1, 1): (a, c), (0, 1): (b, c), (1, 0): (a, d)}
    ends = [apart[i, j] for i in range(2) for j in range(2) if abs(first.interval[i] - second.interval[j]) < near]
    if len(ends) != 1:
        return None
    begin, end = sorted(ends[0])
    lasts = [term.interval[1] for term in (first, second) if term.name.endswith(".step") and term.interval]
    return Term(f"{stream}.{'step' if end in lasts else 'transient'}", (begin, end))
