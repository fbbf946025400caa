"""A gyroscope between static poses as a least-squares problem: turns carry directions, at rest the rate is zero.

reading = w + b(t) + sum of effects(w, f, T) + noise

The plain model is a bias that wanders. With the model inverted for w along the whole log, each turn gives two residuals
(the direction it carries against the one that the accelerometer shows, across it) and each pose three (the mean rate).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from sinan.calibration.poses.evidence.bias_walk import BiasWalk, estimated_walk
from sinan.calibration.poses.evidence.directions import direction_covariance
from sinan.calibration.poses.evidence.inversion import inverse, inverted
from sinan.calibration.poses.evidence.linear_problem import Rows
from sinan.calibration.poses.evidence.probes import probes_of_turns
from sinan.calibration.poses.gyro import GyroLog, Turns, calibrate_gyro, integrate_turns, noise_of_turns
from sinan.estimator.evidence.source import NO_UNIT
from sinan.estimator.evidence.term import (
    Term,
    declared_model,
    derivatives_wanted,
    effects_in_mean,
    pose_candidates,
    require_known,
    without_probes,
)
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.effects import Effect
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import cross

#: Parts of a rest whose means are kept, as what begins within a rest enters its mean by its share: bound of work
#: (`bounds_of_work turns`).
_PARTS = 16


class GyroTurns:
    """The `LinearProblem` of a gyroscope turned between static poses.

    Parameters
    ----------
    name : of the recording
    log : from `calibration.poses.gyro.read_turns`
    noise_known : whether the white noise of gyroscope and accelerometer is declared
    walk : declared random walk of the gyroscope's bias; None or 0: constant
    covariates : (n,) each, at the rows of the log
    declared : declared effects with their parameters
    earth_rotation : the log says that the rate of the Earth is in it
    where : how messages call the recording
    accel_walk : declared random walk of the accelerometer's bias
    faults : stretches in which a sensor did not measure: turns and rests with one are in no row
    """

    stream = "gyro"
    unit = "rad"
    field = NO_UNIT
    rows_are_readings = False

    def __init__(
        self,
        name: str,
        log: GyroLog,
        noise_known: bool,
        walk: float | None = None,
        covariates: Mapping[str, FloatArray] | None = None,
        declared: Mapping[str, Sequence[float]] | None = None,
        earth_rotation: bool = False,
        where: str = "",
        accel_walk: float | None = None,
        faults: Sequence[tuple[str, str, float, float]] = (),
    ) -> None:
        self.where = where or name
        self.faults = tuple(faults)
        self._lost_turns, self._lost_rests = _lost(log, self.faults)
        self.name, self.log, self.noise_known = name, log, noise_known
        self._declared = declared_model(declared or {})
        self._bias = np.median(log.poses.mean[:, 3:], axis=0)
        _, self._sigma_rest = noise_of_turns(log, earth_rotation)
        self._covariance = direction_covariance(log, accel_walk if noise_known else None)
        begin, end = log.turn_times
        self._sigma_rate = log.gravity * log.density * np.sqrt(end - begin)
        self._factor = 1.0
        if not noise_known:
            walk = self._scale_noise()
        self._walk = BiasWalk(_ends(log) if walk else log.poses.t[:1], walk or 0.0)
        self._add_what_knots_leave()
        self._take_rows(covariates or {})
        turn_t = 0.5 * (begin + end)
        self._rows_t = np.concatenate(
            [np.repeat(turn_t[~self._lost_turns], 2), np.repeat(log.poses.t[~self._lost_rests], 3)]
        )
        self._t = np.concatenate([self._rows_t, self._walk.prior(np.zeros(self._walk.size))[2]])
        motion = self._motion(self._reading)
        require_known(self._declared, motion, self.where)
        self._candidates = pose_candidates("gyro", motion, self._declared)

    def _take_rows(self, covariates: Mapping[str, FloatArray]) -> None:
        """Keep the rows of the turns, turn after turn, then means of parts of each pose: all that the residuals use."""
        log = self.log
        turns = log.turns
        ends = np.cumsum([turn.stop - turn.start for turn in turns])
        self._turn_rows = tuple(slice(int(b - (t.stop - t.start)), int(b)) for t, b in zip(turns, ends, strict=True))
        self._n_turning = int(ends[-1])
        lengths = log.poses.stop - log.poses.start
        parts = int(np.clip(np.min(lengths), 1, _PARTS))
        edges = log.poses.start[:, None] + lengths[:, None] * np.arange(parts + 1) // parts
        self._shares = np.diff(edges, axis=1) / lengths[:, None]

        def kept(values: FloatArray) -> FloatArray:
            rests = [values[a:b].mean(axis=0)[None] for row in edges for a, b in pairwise(row)]
            return np.concatenate([*(values[turn] for turn in turns), *rests])

        self._row_t, self._reading, self._f_b = kept(log.t), kept(log.reading), kept(log.f_b)
        self._weights = self._walk.weights(self._row_t)
        self._covariates = {name: kept(value) for name, value in covariates.items()}
        self._log_covariates = {name: value for name, value in covariates.items() if value.ndim == 1}

    def _scale_noise(self) -> float:
        """Undeclared noise: the turns are weighted by what the richest linear model leaves of them, the rests by the
        white part of how their means scatter; the other part is the walk of the bias, which is returned.
        """
        self._factor = float(calibrate_gyro(self.log, "full", self.where).weights[0])
        n = len(self.log.poses.t)
        offset = np.tile(np.eye(3), (n, 1)) / np.repeat(self._sigma_rest, 3)[:, None]
        residual = (self.log.poses.mean[:, 3:] - self._bias).ravel() / np.repeat(self._sigma_rest, 3)
        white, walk = estimated_walk(residual, offset, offset, np.repeat(self.log.poses.t, 3))
        self._sigma_rest = self._sigma_rest * max(white, 1.0)
        return walk

    def _add_what_knots_leave(self) -> None:
        """Between two knots a walk leaves the straight line: its mean by walk^2 T / 12, its integral by T^3 / 12."""
        log, walk = self.log, self._walk.walk
        begin, end = log.turn_times
        lasting = log.t[log.poses.stop - 1] - log.t[log.poses.start]
        self._sigma_rest = np.hypot(self._sigma_rest, walk * np.sqrt(lasting / 12.0))
        self._sigma_rate = np.hypot(self._sigma_rate, log.gravity * walk * np.sqrt((end - begin) ** 3 / 12.0))

    @property
    def t(self) -> FloatArray:
        """(rows,) s."""
        return self._t

    @property
    def instants(self) -> FloatArray:
        """(n,) of the samples [s]."""
        return self.log.t

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """Effects of the gyroscope in poses whose covariates the recording has."""
        return self._candidates

    @property
    def covariates(self) -> Mapping[str, FloatArray]:
        """(rows,) each; interpolated to the rows' times."""
        return {name: np.interp(self._t, self.log.t, value) for name, value in self._log_covariates.items()}

    def probes(self, most: int) -> tuple[Effect, ...]:
        """Powers of the rate and of the specific force, time, and powers of the covariates."""
        return probes_of_turns(self.log.gravity, self._motion(self._reading - self._bias), self.noise_known, most)

    def start(self) -> FloatArray:
        """b and the knots of its walk."""
        return np.concatenate([self._bias, np.zeros(self._walk.size)])

    def plausible(self, entry: Effect) -> FloatArray:
        """Plausible sizes as declared."""
        return entry.plausible

    def true_rate(self, x: FloatArray, model: Mapping[Term, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Invert the model for w by Newton's method: w (n, 3) and B = d reading / d w (n, 3, 3)."""
        y, others = without_probes(self._reading - x[:3] - self._walk.value(self._row_t, x[3:]), model, self._motion)
        pairs = effects_in_mean(self._declared, others)
        if not pairs:
            return y, np.broadcast_to(np.eye(3), (len(y), 3, 3))
        return inverted(y, np.ones(3), 1.0, lambda w: self._added(w, pairs))

    def rows(
        self, nuisance: FloatArray, model: Mapping[Term, FloatArray], wanted: Sequence[Effect], known: bool = False
    ) -> Rows:
        """Whitened residuals of turns and rests, and their derivatives."""
        w, B = self.true_rate(nuisance, model)
        motion = self._motion(w)
        by_bias = inverse(np.asarray(B))  # -d w / d bias
        columns = [by_bias]
        names: list[str] = []
        for key, entry, beta in derivatives_wanted(model, wanted):
            columns.append(by_bias @ entry.slope(w, beta, motion))
            names.append(key)
        residual, J, raw = self._project(w, np.concatenate(columns, axis=2))
        prior_r, prior_N, _ = self._walk.prior(nuisance[3:])
        m, size = len(prior_r), len(nuisance)
        J = np.vstack([J, np.zeros((m, J.shape[1]))])
        J[len(residual) :, 3:size] = prior_N
        effects, column = {}, size
        for key, part in zip(names, columns[1:], strict=True):
            effects[key] = J[:, column : column + part.shape[2]]
            column += part.shape[2]
        return Rows(
            residual=np.concatenate([residual, prior_r]),
            nuisance=J[:, :size],
            effects=effects,
            offset=J[:, :3].copy(),
            measured=np.concatenate([np.ones(len(residual), dtype=bool), np.zeros(m, dtype=bool)]),
            raw=np.concatenate([raw, np.zeros(m)]),
        )

    def _project(self, w: FloatArray, D: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals of the turns across the direction, then of the rests; whitened, with J = -d residual / d theta.

        D (n, 3, m) begins with the derivative by the bias; that by the knots of its walk is put in behind it.
        Neighbouring turns share a pose, whose direction noise enters both: their covariance is block tridiagonal.
        """
        turns = integrate_turns(self._row_t, self._turn_rows, self.log.direction[:-1], w)
        miss = turns.predicted - self.log.direction[1:]
        across = _tangents(self.log.direction[1:])
        g = self.log.gravity
        r_turn = np.einsum("kai,ki->ka", across, miss).ravel()
        moved = np.concatenate(
            [turns.derivative(D[:, :, :3]), self._by_knots(turns, D), turns.derivative(D[:, :, 3:])], 2
        )
        J_turn = np.einsum("kai,kim->kam", across, moved).reshape(len(r_turn), -1)
        seen, rests = np.repeat(~self._lost_turns, 2), np.repeat(~self._lost_rests, 3)
        L = np.linalg.cholesky(self._turn_covariance(turns.rotation, across)[np.ix_(seen, seen)])
        r_turn, J_turn = r_turn[seen], J_turn[seen]
        poses = self.log.poses
        r_rest, at_rest = self._over_rests(w), self._over_rests(D)
        knots = self._walk.derivative(poses.t, at_rest[:, :, :3])
        J_rest = np.concatenate([at_rest[:, :, :3], knots, at_rest[:, :, 3:]], axis=2)
        sigma = np.repeat(self._sigma_rest, 3)
        at_rests = (J_rest.reshape(len(sigma), -1) / sigma[:, None])[rests]
        residual = np.concatenate([np.linalg.solve(L, r_turn), (r_rest.ravel() / sigma)[rests]])
        J = np.concatenate([np.linalg.solve(L, J_turn), at_rests])
        # rests are shown as the angle they would make over their own turn, so that both have one unit
        time = np.repeat(np.median(np.diff(poses.t)), len(sigma))
        return residual, J, np.concatenate([r_turn / g, (r_rest.ravel() * time)[rests]])

    def _over_rests(self, values: FloatArray) -> FloatArray:
        """(poses, ...) means over the rests."""
        parts = values[self._n_turning :].reshape(*self._shares.shape, *values.shape[1:])
        return np.asarray(np.einsum("pk,pk...->p...", self._shares, parts))

    def _by_knots(self, turns: Turns, D: FloatArray) -> FloatArray:
        """(turns, 3, 3 (knots - 1)) derivative of the predicted directions by the knots of the bias's walk."""
        J = np.zeros((len(turns.rows), 3, self._weights.shape[1], 3))
        for k, (response, rows) in enumerate(zip(turns.sensitivity, turns.rows, strict=True)):
            near = np.flatnonzero(np.any(self._weights[rows] != 0.0, axis=0))
            by_bias = response @ D[rows, :, :3]
            J[k][:, near] = np.einsum("nj,nim->ijm", self._weights[rows][:, near], by_bias)
        return J.reshape(len(turns.rows), 3, -1)

    def _turn_covariance(self, rotation: FloatArray, across: FloatArray) -> FloatArray:
        """(2 turns, 2 turns) covariance of the residuals across the directions [(m/s^2)^2].

        Turn k misses R_k e_k - e_k+1 of the errors e of the directions, and what the noise of the rate adds up to.
        """
        n = len(across)
        by_pose = np.zeros((n, 2, n + 1, 3))
        for k in range(n):
            by_pose[k, :, k, :] = across[k] @ rotation[k]
            by_pose[k, :, k + 1, :] = -across[k]
        F = by_pose.reshape(2 * n, 3 * (n + 1))
        covariance = F @ self._covariance @ F.T + np.diag(np.repeat(self._sigma_rate, 2) ** 2)
        return np.asarray(self._factor**2 * covariance)

    def _added(self, w: FloatArray, pairs: list[tuple[Effect, FloatArray]]) -> FloatArray:
        motion = self._motion(w)
        return np.sum([entry.change(w, beta, motion) for entry, beta in pairs], axis=0)

    def _motion(self, w: FloatArray) -> Motion:
        return Motion(t=self._row_t, w_ib_b=w, f_b=self._f_b, covariates=self._covariates)


def _lost(log: GyroLog, faults: Sequence[tuple[str, str, float, float]]) -> tuple[BoolArray, BoolArray]:
    """(turns,), (poses,) which turns and which rests the faults leave nothing of; a direction that is lost ends two."""

    def hit(begin: FloatArray, end: FloatArray, sensors: tuple[str, ...]) -> BoolArray:
        inside = [(begin <= stop) & (end >= start) for sensor, _, start, stop in faults if sensor in sensors]
        return np.any(inside, axis=0) if inside else np.zeros(len(begin), dtype=bool)

    rest = log.t[log.poses.start], log.t[log.poses.stop - 1]
    direction = hit(*rest, ("accel", "imu"))
    turns = hit(*log.turn_times, ("gyro", "imu")) | direction[:-1] | direction[1:]
    return turns, hit(*rest, ("gyro", "imu"))


def _ends(log: GyroLog) -> FloatArray:
    """(2 poses,) beginning and end of each rest [s]."""
    ends = np.stack([log.t[log.poses.start], log.t[log.poses.stop - 1]], axis=1)
    return np.asarray(ends.ravel())


def _tangents(direction: FloatArray) -> FloatArray:
    """(n, 2, 3) two unit vectors across each direction."""
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    least = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
    first = cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, cross(unit, first)], axis=1)
