"""What an offset explains of readings that the filter doubts.

Squares at the weights that readings have without an offset are a lower bound of what it explains: a reading of weight
w = (nu + m) / (nu + NIS) counts for at most nu + m of them, however far it is off. By its law it counts for

    rho(NIS) - rho(NIS_b),    NIS_b = |y - W b|^2 / w,    y, W the whitened innovation and sensitivity at weight w

(`tails.deviance_of`), and the offset is found by weights that are those with it: each round of them raises the
likelihood (K. Lange, R. Little, J. Taylor, J. Am. Stat. Assoc. 84(408), 1989, 881).

Neglects that the filter too would follow those readings more, which an exact refit does not; and that readings which
are believed would be doubted with the offset: an interval that has right ones among those that are off explains less
here than by the law, one that begins and ends with them as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.score import gain_of
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.tails import NORMAL, deviance_of, spread_of, stray_over_centre
from sinan.sensors.arrays import FloatArray, IntArray

#: Readings with at least this weight keep it, and count by squares: bound of work (`bounds_of_work doubted`).
_BELIEVED = 0.5
#: Rounds of weights: bound of work (`bounds_of_work doubted`).
_ROUNDS = 4


@dataclass(frozen=True)
class Doubted:
    """Readings that the filter believes to less than half.

    Attributes
    ----------
    row : (d,) their rows in those of a pass, reading by reading
    first : (k,) place in `row` of the first component of each
    weight : (k,) that they have
    dof : (k,) components that tell something
    tail, stray : (k,) of their law (`tails`)
    """

    row: IntArray
    first: IntArray
    weight: FloatArray
    dof: IntArray
    tail: FloatArray
    stray: FloatArray

    def deviance(self, nis: FloatArray) -> FloatArray:
        """(n,) what of -2 log density goes with the NIS (n, k) of all of them."""
        return np.asarray(np.sum(deviance_of(nis, self.dof, self.tail, self.stray), axis=1))

    def nis(self, white: FloatArray) -> FloatArray:
        """(n, k) of whitened innovations (n, d) at their weights."""
        return np.asarray(np.add.reduceat(white**2, self.first, axis=1) / self.weight)

    def new_weight(self, nis: FloatArray) -> FloatArray:
        """(n, d) weight of each row by an NIS (n, k), over that which it has."""
        ratio = 1.0 / (self.weight * spread_of(nis, self.dof, self.tail, self.stray))
        return np.repeat(ratio, np.diff(np.append(self.first, len(self.row))), axis=1)


def doubted_in(journal: Journal, event: IntArray) -> Doubted | None:
    """Of rows whose readings have these places in the journal, (r,) in runs; None where all are believed."""
    first = np.flatnonzero(np.diff(event, prepend=-1))
    reading = event[first]
    if not np.any(journal.weight[reading] < _BELIEVED):
        return None
    name = journal.sensor[reading]
    tail = np.array([journal.model.tail_of(sensor) or NORMAL for sensor in journal.sensors])[name]
    stray = np.array([journal.model.stray_of(sensor) for sensor in journal.sensors])[name]
    over = stray_over_centre(stray, journal.loglik[reading], journal.nis[reading])
    components = np.diff(np.append(first, len(event)))
    return doubted_among(journal.weight[reading], journal.freedom[reading], tail, over, components)


def doubted_among(
    weight: FloatArray, dof: IntArray, tail: FloatArray, stray: FloatArray, components: IntArray | None = None
) -> Doubted:
    """Of all readings of a pass, in order.

    Parameters
    ----------
    weight, dof, tail, stray : (n,) as of `Doubted`
    components : (n,) rows of each; default: `dof`
    """
    rows = dof if components is None else components
    there = weight < _BELIEVED
    row, kept = np.flatnonzero(np.repeat(there, rows)), rows[there]
    return Doubted(row, np.cumsum(kept) - kept, weight[there], dof[there], tail[there], stray[there])


def explained(
    information: FloatArray, score: FloatArray, W: FloatArray, white: FloatArray, doubted: Doubted, floor: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """By how much -2 log L drops with each of n offsets of k parameters, of doubted readings by their law.

    Parameters
    ----------
    information, score : (n, k, k), (n, k) of all readings, at their weights
    W, white : (n, d, k), (d,) sensitivities and innovations of those that are doubted, at their weights
    floor : above which eigenvalue of the information a direction counts as seen (`score.gain_of`)

    Returns
    -------
    (n,) drop, (n,) directions seen at the weights with it, (n, k) estimate
    """
    rest = information - np.einsum("ndi,ndj->nij", W, W), score - np.einsum("ndi,d->ni", W, white)
    none = doubted.deviance(doubted.nis(white[None]))

    def solved(ratio: FloatArray) -> tuple[IntArray, FloatArray]:
        weighted = W * ratio[:, :, None]
        A, b = rest[0] + np.einsum("ndi,ndj->nij", weighted, W), rest[1] + np.einsum("ndi,d->ni", weighted, white)
        return gain_of(A, b, lambda _: floor)[1:]

    def drop(beta: FloatArray) -> tuple[FloatArray, FloatArray]:
        nis = doubted.nis(white - np.einsum("ndi,ni->nd", W, beta))
        squares = 2.0 * np.einsum("ni,ni->n", beta, rest[1]) - np.einsum("ni,nij,nj->n", beta, rest[0], beta)
        return squares + none - doubted.deviance(nis), nis

    believed = doubted.new_weight(np.zeros((len(score), len(doubted.first))))
    best, gain, dof = np.zeros_like(score), np.full(len(score), -np.inf), np.zeros(len(score), dtype=np.int64)
    for start in (np.ones_like(believed), believed):
        seen, beta = solved(start)
        found, nis = drop(beta)
        for _ in range(_ROUNDS):
            seen, beta = solved(doubted.new_weight(nis))
            found, nis = drop(beta)
        better = found > gain
        best[better], gain[better], dof[better] = beta[better], found[better], seen[better]
    return gain, dof, best
