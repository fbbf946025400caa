"""Two offsets of one stream that share an end are one, where the data do not notice: a step that was found late is told
as a step from an earlier time on and a transient that takes back its beginning.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sinan.estimator.evidence.score import log_p_of_deviance
from sinan.estimator.evidence.source import Fit, Source
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop.options import Option
from sinan.experiments.residual_loop.trials import Finding, fit_without, trial

#: Ends are shared where they differ by less than this share of the shorter interval, as the fit of one moves the
#: other's; the likelihood judges then. A choice: half and twice change nothing of the poses (`bounds_of_work poses`).
_SHARED_WITHIN = 0.1


@dataclass(frozen=True)
class OneOffset:
    """An offset in the place of two.

    Attributes
    ----------
    without, fit : fits of neither of the two, and of the one in their place
    finding : the one
    parts : the two
    """

    without: Fit
    fit: Fit
    finding: Finding
    parts: tuple[Finding, Finding]


def merged(
    source: Source, fit: Fit, findings: Sequence[Finding], threshold: float, apart: set[frozenset[Term]]
) -> OneOffset | None:
    """The first two offsets that one explains as well: with it in their place a second would not be found.

    Parameters
    ----------
    threshold : logarithm of the p-value below which an effect is found
    apart : pairs that are two, which are not tried again; those found so are added

    Returns
    -------
    None where there are none such
    """
    local = [finding for finding in findings if finding.term.interval is not None]
    for first, second in combinations(local, 2):
        term, pair = _between(first.term, second.term), frozenset((first.term, second.term))
        if term is None or pair in apart:
            continue
        apart.add(pair)
        without = fit_without(source, fit, first.term, second.term)
        longer = max(first, second, key=lambda finding: _length(finding.term))
        searches = first.search, second.search
        both_steps = first.term.name == second.term.name == f"{_stream(term)}.step"  # then two ends of the one are new
        search = sum(searches) if both_steps else max(searches)
        size = len(longer.beta)
        tried = trial(source, without, Option(term, 0.0, size, 0.0, 0.0, search, search, fit.beta[longer.term], 0.0))
        if tried is None or tried[1].log_p >= threshold:
            continue
        lost = tried[0].deviance - fit.deviance
        if log_p_of_deviance(source.evidence(fit, own_terms_only=True), lost, size) + min(searches) > threshold:
            rivals = {
                rival.term.name: rival for rival in (*second.rivals, *first.rivals) if rival.term.name != term.name
            }
            finding = replace(tried[1], rivals=tuple(rivals.values()))
            return OneOffset(without, tried[0], finding, (first, second))
    return None


def _stream(term: Term) -> str:
    return term.name.split(".")[0]


def _length(term: Term) -> float:
    assert term.interval is not None
    return term.interval[1] - term.interval[0]


def _between(first: Term, second: Term) -> Term | None:
    """An offset of their stream between the ends that two do not share; None where they share none, or all."""
    if _stream(first) != _stream(second) or first.interval is None or second.interval is None:
        return None
    near = _SHARED_WITHIN * min(_length(first), _length(second))
    (a, b), (c, d) = first.interval, second.interval
    apart = {(0, 0): (b, d), (1, 1): (a, c), (0, 1): (b, c), (1, 0): (a, d)}
    ends = [apart[i, j] for i in range(2) for j in range(2) if abs(first.interval[i] - second.interval[j]) < near]
    if len(ends) != 1:
        return None
    begin, end = sorted(ends[0])
    if end - begin <= near:
        return None
    lasts = max((last for term, last in ((first, b), (second, d)) if term.name.endswith(".step")), default=np.inf)
    return Term(f"{_stream(first)}.{'step' if end >= lasts else 'transient'}", (begin, end))
