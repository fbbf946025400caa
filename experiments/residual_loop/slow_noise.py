"""Whether an effect explains more than slow noise of a stream, of which nobody told, would."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats
from scipy.linalg import block_diag

from sinan.estimator.evidence.score import log_p_value
from sinan.sensors.arrays import BoolArray, FloatArray

#: Time constants of the noise that are tried: cells of the grid.
_TIME_CONSTANTS = (0.5, 1.0, 2.0, 4.0, 16.0, 64.0)
#: Variances that are tried, in units of one over the largest information of a cell: bound of work (`bounds_of_work
#: flight`).
_VARIANCES = np.logspace(-1.0, 6.0, 15)
#: Rounds in which law and white noise are found: bound of work (`bounds_of_work flight`).
_ROUNDS = 2
#: The noise is there where it gains more than this of 2 log L: the 5 % point of chi-square for its two parameters.
_NEEDED = 6.0
#: Directions of an offset that are seen: share of the information of the best.
_FLOOR = 1e-3


@dataclass(frozen=True)
class SlowNoise:
    """White innovations plus the mark of an offset that is a stationary first-order Markov process on cells of time.

    With V the sensitivities to an offset in each cell, z ~ N(0, s^2 (I + V K V')), K_ij = v exp(-|t_i - t_j| / tau).
    v and tau are those of the largest likelihood, once with the effect (an interval's offset, or any other) in the mean
    and once without, s is what the best with it leaves, at least 1; the difference of 2 log likelihood is what the
    effect explains given the noise. It is judged by F, since the law of the noise is known from a number of cells
    alone. Where the data do not call for such noise once the effect is in the mean, neither with the declared white
    noise nor with that which is left, there is none; but for an offset of a stream that drifts by nature, unless the
    offset alone is much likelier than the noise alone.

    Neglects what the noise changes within a cell.

    Attributes
    ----------
    parts : of each stream that may have such noise, alone or with the others, (m,) middles of the cells in spacings of
        the grid, and (r, m * size) sensitivities of the whitened innovations, all components of a cell together
    white : (r,) whitened innovations
    size : components of the offset
    mine : (r,) the rows whose mean square is the noise
    """

    parts: tuple[tuple[FloatArray, FloatArray], ...]
    white: FloatArray
    size: int
    mine: BoolArray

    @cached_property
    def _V(self) -> FloatArray:
        return np.hstack([columns for _, columns in self.parts])

    @cached_property
    def _information(self) -> FloatArray:
        return np.asarray(self._V.T @ self._V)

    @cached_property
    def _score(self) -> FloatArray:
        return np.asarray(self._V.T @ self.white)

    def log_p_given(self, column: FloatArray, dof: int, lead: float = -np.inf) -> float:
        """Logarithm of the p-value of an offset with sensitivities `column` (r, size), `dof` directions of it seen;
        for `lead` see `gain_given`.
        """
        gain, cells = self.gain_given(column, lead)
        if dof == 0 or cells == 0:
            return log_p_value(gain, dof)
        return float(stats.f.logsf(gain / dof, dof, cells))

    def gain_given(self, column: FloatArray, lead: float = -np.inf) -> tuple[float, int]:
        """What the offset explains of -2 log L given the noise, and from how many offsets the law of that is known:
        0 where the data do not call for it.

        Parameters
        ----------
        column : (r, size) sensitivities to the offset
        lead : of -2 log L, by which the offset alone has to be ahead of the noise alone, or the noise is there
        """
        V = self._V
        b, x = self._score, V.T @ column
        values, vectors = np.linalg.eigh(column.T @ column)
        seen = vectors[:, values > _FLOOR * max(float(values[-1]), 1e-300)]
        x, own, score = x @ seen, seen.T @ (column.T @ column) @ seen, seen.T @ (column.T @ self.white)
        given_laws = [law.jointly(b, x, own, score) for law in self._laws]
        offset_alone = np.linalg.solve(own, score)
        s2, gain, needed = 1.0, 0.0, False
        for _ in range(_ROUNDS):
            offset = offset_alone
            alone = float(score @ offset) / s2
            without, jointly = 0.0, alone
            at_best: FloatArray = np.zeros(len(b))
            for one in given_laws:
                noise = one.explained / s2 - one.log_det
                rest = one.score / s2
                estimate = np.linalg.solve(one.information / s2, rest[:, :, None])[:, :, 0]
                both = noise + np.sum(rest * estimate, axis=1)
                without = max(without, float(np.max(noise)))
                best = int(np.argmax(both))
                if both[best] > jointly:
                    jointly, offset = float(both[best]), estimate[best]
                    at_best = one.most_likely(best, offset)
            needed |= jointly - alone > _NEEDED  # with the offset in the model
            needed |= alone - without < lead
            gain = jointly - without if needed else alone
            residual = self.white - V @ at_best - column @ (seen @ offset)
            s2 = max(1.0, float(np.mean(residual[self.mine] ** 2)))
        return gain, x.shape[0] if needed else 0

    @cached_property
    def _laws(self) -> list[_Law]:
        """Of every time constant, all parts together and each alone."""
        L = self._information
        unit = float(np.max(np.diag(L)))
        if unit <= 0.0:
            return []
        ends = np.cumsum([V.shape[1] for _, V in self.parts])
        found = []
        for tau in _TIME_CONSTANTS:
            blocks = [np.kron(_root(t, tau), np.eye(self.size)) for t, _ in self.parts]
            whole = block_diag(*blocks) / np.sqrt(unit)
            for root in [whole, *np.split(whole, ends[:-1], axis=1)] if len(blocks) > 1 else [whole]:
                information, directions = np.linalg.eigh(root.T @ L @ root)
                found.append(_Law(root @ directions, np.maximum(information, 0.0)))
        return found


@dataclass(frozen=True)
class _Law:
    """A covariance s^2 v R R' of the offsets, v one of `_VARIANCES`, with R turned so that its information is diagonal.

    Attributes
    ----------
    root : (m size, k) R
    information : (k,) diagonal of R' V' V R
    """

    root: FloatArray
    information: FloatArray

    def jointly(self, b: FloatArray, x: FloatArray, own: FloatArray, score: FloatArray) -> _Given:
        """An offset given noise of this law.

        Parameters
        ----------
        b : (m size,) score of the offsets in the cells
        x, own, score : (m size, d), (d, d), (d,) V' W, W' W and W' z, W the sensitivities to the one offset
        """
        y = self.root.T @ np.column_stack([b, x])  # along the law's own directions
        known = 1.0 + self.information * _VARIANCES[:, None]
        shrunk = _VARIANCES[:, None] / known
        return _Given(
            self.root,
            y,
            shrunk,
            explained=shrunk @ y[:, 0] ** 2,
            log_det=np.sum(np.log(known), axis=1),
            information=own - np.einsum("ki,vk,kj->vij", y[:, 1:], shrunk, y[:, 1:]),
            score=score - np.einsum("ki,vk,k->vi", y[:, 1:], shrunk, y[:, 0]),
        )


@dataclass(frozen=True)
class _Given:
    """An offset of the stream given noise of one law, for each of `_VARIANCES`, in units of s^2.

    Attributes
    ----------
    root : (m size, k) of the law
    y : (k, 1 + d) score of the law's directions, and their products with the sensitivities to the offset
    shrunk : (v, k) variances of the law's directions, given the innovations
    explained : (v,) what the noise alone explains
    log_det : (v,) logarithm of the determinant of I + V K V'
    information, score : (v, d, d), (v, d) of the offset, given the noise
    """

    root: FloatArray
    y: FloatArray
    shrunk: FloatArray
    explained: FloatArray
    log_det: FloatArray
    information: FloatArray
    score: FloatArray

    def most_likely(self, variance: int, offset: FloatArray) -> FloatArray:
        """(m size,) the noise in the cells, of one of the variances, with the offset taken off."""
        return np.asarray(self.root @ (self.shrunk[variance] * (self.y[:, 0] - self.y[:, 1:] @ offset)))


def _root(t: FloatArray, tau: float) -> FloatArray:
    return np.linalg.cholesky(np.exp(-np.abs(np.subtract.outer(t, t)) / tau))
