"""A slow error of the GPS that no reading shows alone and nobody declared, as part of the noise of every pass.

A receiver's position errs by what lasts seconds (reflections, its own filter) besides what the model has of it. The
filter takes that for motion, and the innovations of all streams are coloured. With V the sensitivities of the whitened
innovations to the values u of that error at nodes of time, linear between them, z = V u + n with u ~ N(0, K) and n
white. The innovations of the same filter with u in its state are L^-1 z with L L' = I + V K V', found node by node;
sensitivities go the same way. It is what Friedland's two filters do for a constant, in the order of time.

K_ij = v exp(-|t_i - t_j| / tau), each axis alike; v and tau have the largest likelihood in what no lasting candidate
explains, so that an effect is not taken for noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from estimator.events import ACCEPTED
from estimator.journal import Journal
from estimator.sensitivity import Sensitivity
from experiments.residual_loop.probes import offsets, probe
from sensors.arrays import BoolArray, FloatArray, IntArray
from sensors.effects import Effect
from sensors.motion import Motion

#: Nodes of the error, and elements of V that are kept: a log longer than that has nodes that are farther apart.
_MOST_NODES, _MOST_ELEMENTS = 100, 1e7
_LEAST_NODES = 12
_AXES = 3
#: Spacings of the nodes in one time constant, where those of the search are closer; readings in so many orders or
#: selections that are kept ready.
_SPACINGS, _MOST_KNOWN = 3.0, 3
#: Time constants that are tried, in spacings of the nodes, and variances, over one over the largest information.
_TIME_CONSTANTS = (1.5, 2.5, 4.0, 6.0, 10.0, 16.0, 40.0)
_VARIANCES = np.logspace(-1.0, 6.0, 29)
#: The error is there where it gains this of 2 log L, and the last of these in two thirds of the log at least: a step
#: or a disturbance shows in one.
_NEEDED, _PARTS, _NEEDED_IN_PART = 12.0, 3, 4.0


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
class GpsDrift:
    """The noise of a slow error of the GPS.

    Attributes
    ----------
    nodes : (m,) s
    covariance : (3 m, 3 m) K of its values at the nodes [m^2]
    V : (r, 3 m) sensitivities of the whitened innovations to them
    component : (r,) which component each row is of, in rising order; see `components_of`
    tau, sigma : time constant [s] and size [m], for the report
    """

    nodes: FloatArray
    covariance: FloatArray
    V: FloatArray
    component: IntArray
    tau: float
    sigma: float

    _known: dict[bytes, Whitening] = field(default_factory=dict, repr=False, compare=False)

    def taken_off(self, journal: Journal, sensitivity: Sensitivity) -> tuple[Journal, Sensitivity]:
        """The pass that a filter with the error in its state would have made: whitened innovations, their likelihood
        and their sensitivities.

        The innovations in metres stay those of the filter as it is.
        """
        rows = rows_of(journal)
        whitening = self._of(components_of(journal)[rows], np.repeat(journal.t, journal.dof)[rows])
        found = whitening.of(np.column_stack([journal.white[rows], sensitivity.rows]))
        white = journal.white.copy()
        white[rows] = found[:, 0]
        event = np.repeat(np.arange(len(journal)), journal.dof)[rows]
        more = 0.5 * (journal.white[rows] ** 2 - found[:, 0] ** 2) - whitening.log_root
        loglik = journal.loglik + np.bincount(event, more, len(journal))
        return (
            replace(journal, white=white, loglik=loglik),
            replace(sensitivity, rows=found[:, 1:], white=found[:, 0]),
        )

    def _of(self, component: IntArray, t: FloatArray) -> Whitening:
        """Of these components in this order; a reading that was not there has no sensitivity."""
        key = component.tobytes()
        if key not in self._known:
            place = np.minimum(np.searchsorted(self.component, component), len(self.component) - 1)
            V = np.where((self.component[place] == component)[:, None], self.V[place], 0.0)
            if len(self._known) == _MOST_KNOWN:
                del self._known[next(iter(self._known))]
            self._known[key] = Whitening(V, self.covariance, np.searchsorted(self.nodes, t))
        return self._known[key]


class Whitening:
    """L^-1 with L L' = I + V K V', found chunk by chunk.

    Parameters
    ----------
    V : (r, k); K : (k, k)
    chunk : (r,) rising number of the chunk that a row is in
    """

    def __init__(self, V: FloatArray, K: FloatArray, chunk: IntArray) -> None:
        self.log_root, self._parts = np.zeros(len(V)), list[tuple[slice, slice, FloatArray, FloatArray, FloatArray]]()
        P = K.copy()
        for part in np.split(np.arange(len(V)), np.flatnonzero(np.diff(chunk)) + 1) if len(V) else []:
            here = slice(int(part[0]), int(part[-1]) + 1)
            reached = np.flatnonzero(np.any(V[here] != 0.0, axis=0))
            if not len(reached):
                continue
            some = slice(0, int(reached[-1]) + 1)
            seen = V[here, some]
            gain = P[:, some] @ seen.T
            root = cholesky(np.eye(len(part)) + seen @ gain[some], lower=True, check_finite=False)
            inverse = solve_triangular(root, np.eye(len(part)), lower=True, check_finite=False)
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


def gps_drift(
    nodes: FloatArray, journal: Journal, at_nodes: Sensitivity, candidates: FloatArray
) -> GpsDrift | None:
    """The slow error that the innovations of the plain model call for; None where they do not.

    Parameters
    ----------
    nodes : (m,) s
    journal, at_nodes : a pass with the sensitivities to the error's values at them
    candidates : (r, p) sensitivities to all lasting candidates
    """
    rows = rows_of(journal)
    t = np.repeat(journal.t, journal.dof)[rows]
    sensor = np.repeat(journal.sensor, journal.dof)[rows]
    mine = sensor == journal.sensors.index("gps")
    rest = _Rest(at_nodes.rows, at_nodes.white, candidates)
    spacing = float(nodes[1] - nodes[0])
    best: tuple[float, FloatArray, float, float] | None = None
    for tau in _TIME_CONSTANTS:
        R = _correlation(nodes, tau * spacing)
        gain, v = rest.likeliest(np.kron(np.linalg.cholesky(R), np.eye(_AXES)), mine)
        if best is None or gain > best[0]:
            best = gain, v * np.kron(R, np.eye(_AXES)), tau * spacing, float(np.sqrt(v))
    assert best is not None
    gain, covariance, tau, sigma = best
    if gain < _NEEDED:
        return None
    whitening = Whitening(rest.V, covariance, np.searchsorted(nodes, t))
    gains = rest.z**2 - whitening.of(rest.z[:, None])[:, 0] ** 2 - 2.0 * whitening.log_root
    third = np.minimum((_PARTS * (t - nodes[0]) / (nodes[-1] - nodes[0])).astype(int), _PARTS - 1)
    if np.sort(np.bincount(third, gains, _PARTS))[1] < _NEEDED_IN_PART:
        return None
    component = components_of(journal)[rows]
    order = np.argsort(component)
    every = max(int(tau / (_SPACINGS * spacing)), 1)
    coarse = nodes[0] + np.arange(0.0, nodes[-1] - nodes[0] + (every - 1e-9) * spacing, every * spacing)
    hats = np.maximum(1.0 - np.abs(nodes[:, None] - coarse) / (every * spacing), 0.0)
    V = at_nodes.rows[order] @ np.kron(hats, np.eye(_AXES))
    return GpsDrift(coarse, sigma**2 * np.kron(_correlation(coarse, tau), np.eye(_AXES)), V, component[order], tau, sigma)


def _correlation(t: FloatArray, tau: float) -> FloatArray:
    return np.exp(-np.abs(np.subtract.outer(t, t)) / tau)


class _Rest:
    """What no candidate explains: innovations and sensitivities with the candidates projected out."""

    def __init__(self, V: FloatArray, z: FloatArray, candidates: FloatArray) -> None:
        unit = candidates / np.maximum(np.linalg.norm(candidates, axis=0), 1e-300)
        values, vectors = np.linalg.eigh(unit.T @ unit)
        seen = values > 1e-10 * max(float(values.max(initial=0.0)), 1e-300)
        Q = unit @ (vectors[:, seen] / np.sqrt(values[seen]))
        self.V, self.z = V - Q @ (Q.T @ V), z - Q @ (Q.T @ z)

    @cached_property
    def _information(self) -> FloatArray:
        return np.asarray(self.V.T @ self.V)

    @cached_property
    def _score(self) -> FloatArray:
        return np.asarray(self.V.T @ self.z)

    def likeliest(self, root: FloatArray, mine: BoolArray) -> tuple[float, float]:
        """Gain of 2 log L and variance of the likeliest law v root root', beside the white noise that it leaves the GPS
        where that is larger than declared.
        """
        information, directions = np.linalg.eigh(root.T @ self._information @ root)
        information = np.maximum(information, 0.0)
        y = directions.T @ (root.T @ self._score)
        v = _VARIANCES[:, None] / max(float(information[-1]), 1e-300)
        s2 = 1.0
        for _ in range(2):
            shrunk = v / (1.0 + v * information / s2)
            gain = shrunk @ y**2 / s2**2 - np.sum(np.log(1.0 + v * information / s2), axis=1)
            k = int(np.argmax(gain))
            left = self.z - self.V @ (root @ (directions @ (shrunk[k] * y / s2)))
            s2 = max(1.0, float(np.mean(left[mine] ** 2)))
        return float(gain[k]), float(v[k, 0])
