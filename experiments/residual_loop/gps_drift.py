"""A slow error of the GPS that no reading shows alone and nobody declared, as part of the noise of every pass.

A receiver's position errs by what lasts seconds (reflections, its own filter) besides what the model has of it. The
filter takes that for motion, and the innovations of all streams are coloured. With V the sensitivities of the whitened
innovations to the values u of that error at nodes of time, linear between them, z = V u + n with u ~ N(0, K) and n
white. The innovations of the same filter with u in its state are L^-1 z with L L' = I + V K V', found node by node;
sensitivities go the same way. It is what Friedland's two filters do for a constant, in the order of time.

K_ij = v exp(-|t_i - t_j| / tau), each axis alike; v and tau have the largest likelihood in what no lasting candidate
explains, and the error has to be there in what the place does not explain either: no effect and no reflection is taken
for noise.

Neglects what the error does between two nodes, a hundredth of a log at best, what fits other than the plain one change
of V, and that a base receiver may share it. The law is found about the plain model, and again given what is found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from sinan.estimator.evidence.score import CONFUSED
from sinan.estimator.evidence.sensitivity import Sensitivity
from sinan.estimator.filter.events import ACCEPTED
from sinan.estimator.filter.journal import Journal
from sinan.experiments.residual_loop.probes import offsets, probe
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect
from sinan.sensors.motion import Motion

#: Nodes of the error, and elements of V that are kept: a log longer than that has nodes that are farther apart.
_MOST_NODES, _MOST_ELEMENTS = 100, 1e7
_LEAST_NODES = 12
_AXES = 3
#: Spacings of the nodes in one time constant, where those of the search are closer; readings in so many orders or
#: selections that are kept ready.
_SPACINGS, _MOST_KNOWN = 3.0, 3
#: Time constants that are tried, in spacings of the nodes, and variances, over one over the largest information: a
#: ratio of 1.5 to 2.5 and of 1.8, less than what one log tells (`_ALIKE`).
_TIME_CONSTANTS = (1.5, 2.5, 4.0, 6.0, 10.0, 16.0, 40.0)
_VARIANCES = np.logspace(-1.0, 6.0, 29)
#: The error is there where it gains this of 2 log L, and in two thirds of the log at least this: a step shows in one.
_NEEDED, _NEEDED_IN_THIRD = 12.0, 4.0
#: And where no third of a third is exp(5) times likelier without it, which one law in exp(5) would be by chance: what
#: comes and goes, as a reflection does, has no law.
_PARTS, _AGAINST = 9, -CONFUSED
#: Ratio of two variances or time constants that one log hardly tells: more than between any two that are tried.
_ALIKE = 3.0
#: Rows that are made white at a time; rounds in which law and white noise are found.
_ROWS, _ROUNDS = 128, 2


def nodes_for(start: float, end: float, rows: int) -> FloatArray:
    """(m,) s, of the error in a log with so many components of innovations; few: it could not be told from motion."""
    m = int(min(_MOST_NODES, _MOST_ELEMENTS / (_AXES * max(rows, 1)), 1.0 + (end - start)))
    return np.linspace(start, end, m) if m >= _LEAST_NODES else np.zeros(0)


def error_at_nodes(nodes: FloatArray) -> Effect:
    """The error by its values at the nodes, node after node: a hat about each."""

    def hats(motion: Motion) -> FloatArray:
        spacing = nodes[1] - nodes[0]
        return offsets(np.maximum(1.0 - np.abs(motion.t[:, None] - nodes) / spacing, 0.0), _AXES)

    return probe("gps", "a slow error", _AXES * len(nodes), hats)


@dataclass(frozen=True)
class Law:
    """Of the slow error: a stationary first-order Markov process on each axis.

    Attributes
    ----------
    nodes : (m,) s, at which it has values, and is linear between them
    tau, sigma : time constant [s] and standard deviation [m]
    noise : variance of the white innovations of the GPS besides it, at least 1; `covariance` is in units of that
    """

    nodes: FloatArray
    tau: float
    sigma: float
    noise: float = 1.0

    def is_like(self, other: Law) -> bool:
        """Whether another is the same as far as one log tells: variance over the white noise, and time constant."""
        shares = [law.sigma**2 / law.noise for law in (self, other)]
        ratios = shares[0] / shares[1], self.tau / other.tau
        return all(1.0 / _ALIKE < ratio < _ALIKE for ratio in ratios)

    @property
    def covariance(self) -> FloatArray:
        """(3 m, 3 m) of its values at the nodes [m^2]."""
        return np.asarray(np.kron(self.sigma**2 / self.noise * _correlation(self.nodes, self.tau), np.eye(_AXES)))


@dataclass(frozen=True)
class GpsDrift:
    """The slow error as noise of the passes over one set of readings.

    Attributes
    ----------
    law : of the error
    V : (r, 3 m) sensitivities of the whitened innovations to its values at the nodes
    component : (r,) which component each row is of, in rising order; see `components_of`
    """

    law: Law
    V: FloatArray
    component: IntArray
    _known: dict[bytes, Whitening] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, law: Law, journal: Journal, at_nodes: Sensitivity) -> GpsDrift:
        """From a pass with the sensitivities to the error's values at the nodes."""
        component = components_of(journal)[rows_of(journal)]
        order = np.argsort(component)
        return cls(law, at_nodes.rows[order], component[order])

    def taken_off(self, journal: Journal, sensitivity: Sensitivity) -> tuple[Journal, Sensitivity]:
        """The pass that a filter with the error in its state would have made: whitened innovations, their likelihood
        and their sensitivities.

        The innovations in metres stay those of the filter as it is.
        """
        rows = rows_of(journal)
        whitening = self._of(components_of(journal)[rows])
        found = whitening.of(np.column_stack([sensitivity.white, sensitivity.rows]))
        white = journal.white.copy()
        white[rows] = found[:, 0]
        event = np.repeat(np.arange(len(journal)), journal.dof)[rows]
        more = 0.5 * (sensitivity.white**2 - found[:, 0] ** 2) - whitening.log_root
        loglik = journal.loglik + np.bincount(event, more, len(journal))
        return (
            replace(journal, white=white, loglik=loglik),
            replace(sensitivity, rows=found[:, 1:], white=found[:, 0]),
        )

    def _of(self, component: IntArray) -> Whitening:
        """Of these components in this order, which an effect on the stamps changes."""
        key = component.tobytes()
        if key in self._known:
            self._known[key] = self._known.pop(key)  # the one that was asked last goes last
            return self._known[key]
        place = np.minimum(np.searchsorted(self.component, component), len(self.component) - 1)
        V = np.where((self.component[place] == component)[:, None], self.V[place], 0.0)
        if len(self._known) == _MOST_KNOWN:
            del self._known[next(iter(self._known))]
        self._known[key] = Whitening(V, self.law.covariance)
        return self._known[key]


class Whitening:
    """L^-1 with L L' = I + V K V', found a few rows at a time: V K V' itself would have a row for every reading.

    Parameters
    ----------
    V : (r, k) rows in the order of time, those of the first without what comes later; K : (k, k)
    """

    def __init__(self, V: FloatArray, K: FloatArray) -> None:
        self.log_root, self._parts = np.zeros(len(V)), list[tuple[slice, slice, FloatArray, FloatArray, FloatArray]]()
        P = K.copy()
        for first in range(0, len(V), _ROWS):
            here = slice(first, min(first + _ROWS, len(V)))
            reached = np.flatnonzero(np.any(V[here] != 0.0, axis=0))
            if not len(reached):
                continue
            some = slice(0, int(reached[-1]) + 1)
            seen = V[here, some]
            gain = P[:, some] @ seen.T
            one = np.eye(len(seen))
            root = cholesky(one + seen @ gain[some], lower=True, check_finite=False)
            inverse = solve_triangular(root, one, lower=True, check_finite=False)
            gain = gain @ inverse.T
            P -= gain @ gain.T
            self.log_root[here] = np.log(np.diag(root))
            self._parts.append((here, some, inverse, inverse @ seen, gain))
        self._k = len(K)

    def of(self, rows: FloatArray) -> FloatArray:
        """(r, c) L^-1 rows."""
        found, M = rows.copy(), np.zeros((self._k, rows.shape[1]))
        for here, some, inverse, seen, gain in self._parts:
            found[here] = inverse @ rows[here] - seen @ M[some]
            M += gain @ found[here]
        return found


def rows_of(journal: Journal) -> BoolArray:
    """(components,) those that the filter used."""
    return np.repeat(journal.status == ACCEPTED, journal.dof)


def components_of(journal: Journal) -> IntArray:
    """(components,) a number for each component of each reading, the same in every pass over a recording."""
    dof = journal.dof
    first = np.repeat(journal.row[:-1], dof)
    within = np.arange(len(first)) - first
    reading = journal.index * len(journal.sensors) + journal.sensor
    return np.asarray(np.repeat(reading, dof) * int(dof.max(initial=1)) + within)


def law_of(nodes: FloatArray, journal: Journal, at_nodes: Sensitivity, explained: FloatArray) -> Law | None:
    """The slow error that the innovations about a fit call for; None where they do not.

    Parameters
    ----------
    nodes : (m,) s
    journal, at_nodes : a pass with the sensitivities to the error's values at them
    explained : (r, p) sensitivities to what is no such error: the effects in the fit, all lasting candidates, and what
        else it may follow
    """
    used = rows_of(journal)
    t, sensor = np.repeat(journal.t, journal.dof)[used], np.repeat(journal.sensor, journal.dof)[used]
    rest = _Rest(at_nodes.rows, at_nodes.white, explained, sensor == journal.sensors.index("gps"))
    gain, law = rest.likeliest(nodes)
    if gain < _NEEDED:
        return None
    whitening = Whitening(rest.V, law.covariance)
    gains = (rest.z**2 - whitening.of(rest.z[:, None])[:, 0] ** 2) / law.noise - 2.0 * whitening.log_root
    part = np.minimum((_PARTS * (t - nodes[0]) / (nodes[-1] - nodes[0])).astype(int), _PARTS - 1)
    by_part = np.bincount(part, gains, _PARTS)
    if np.sort(by_part.reshape(3, -1).sum(axis=1))[1] < _NEEDED_IN_THIRD or np.min(by_part) < _AGAINST:
        return None
    spacing = max(float(nodes[1] - nodes[0]), law.tau / _SPACINGS)
    count = int(np.ceil((nodes[-1] - nodes[0]) / spacing)) + 1
    return replace(law, nodes=np.linspace(nodes[0], nodes[-1], count))


def _correlation(t: FloatArray, tau: float) -> FloatArray:
    return np.asarray(np.exp(-np.abs(np.subtract.outer(t, t)) / tau))


class _Rest:
    """What nothing else explains: innovations and sensitivities with that projected out.

    Parameters
    ----------
    mine : (r,) rows of the GPS, whose mean square is the white noise
    """

    def __init__(self, V: FloatArray, z: FloatArray, explained: FloatArray, mine: BoolArray) -> None:
        unit = explained / np.maximum(np.linalg.norm(explained, axis=0), 1e-300)
        values, vectors = np.linalg.eigh(unit.T @ unit)
        seen = values > 1e-10 * max(float(values.max(initial=0.0)), 1e-300)
        Q = unit @ (vectors[:, seen] / np.sqrt(values[seen]))
        self.V, self.z, self._mine = V - Q @ (Q.T @ V), z - Q @ (Q.T @ z), mine
        self._information, self._score = self.V.T @ self.V, self.V.T @ self.z

    def likeliest(self, nodes: FloatArray) -> tuple[float, Law]:
        """Gain of 2 log L over white noise as large, and the law."""
        spacing = float(nodes[1] - nodes[0])
        roots = {}
        for tau in _TIME_CONSTANTS:
            root = np.kron(np.linalg.cholesky(_correlation(nodes, tau * spacing)), np.eye(_AXES))
            information, directions = np.linalg.eigh(root.T @ self._information @ root)
            roots[tau] = np.maximum(information, 0.0), root @ directions
        noise, found = 1.0, (-np.inf, Law(nodes, spacing, 0.0))
        for _ in range(_ROUNDS):
            found, left = (-np.inf, found[1]), self.z
            for tau, (information, root) in roots.items():
                y = root.T @ self._score
                v = _VARIANCES[:, None] / max(float(information[-1]), 1e-300)  # over the noise
                shrunk = v / (1.0 + v * information)
                gain = shrunk @ y**2 / noise - np.sum(np.log(1.0 + v * information), axis=1)
                k = int(np.argmax(gain))
                if gain[k] > found[0]:
                    law = Law(nodes, tau * spacing, float(np.sqrt(v[k, 0] * noise)), noise)
                    found, left = (float(gain[k]), law), self.z - self.V @ (root @ (shrunk[k] * y))
            noise = max(1.0, float(np.mean(left[self._mine] ** 2)))
        return found
