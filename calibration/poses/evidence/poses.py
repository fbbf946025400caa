"""Accelerometer or magnetometer poses as a least-squares problem: the norm of the true reading is known.

reading = M u + b(t) + sum of effects(u) + noise,  M = diag(1 + s),  |u| = norm

The plain model is the textbook's diagonal scale and bias. With the model inverted for u, the residual is
r = |u| - norm, and with e = u / |u|, B = d reading / d u and a = B^-T e:  d r = -a' d(model), so that to first order
r = a' (d reading / d theta) d theta + a' noise, for every parameter theta of the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sinan.calibration.poses.evidence.bias_walk import bias_walk, estimated_walk
from sinan.calibration.poses.evidence.inversion import inverted
from sinan.calibration.poses.evidence.linear_problem import Rows
from sinan.calibration.poses.evidence.probes import probes_of_a_triad
from sinan.calibration.poses.triad import calibrate_norm, norm_jacobian
from sinan.estimator.evidence.source import NO_UNIT, FieldUnit
from sinan.estimator.evidence.term import (
    Term,
    declared_model,
    derivatives_wanted,
    effects_in_mean,
    pose_candidates,
    require_known,
    without_probes,
)
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import Effect
from sinan.sensors.motion import Motion


class NormPoses:
    """The `LinearProblem` of a triad whose true reading has a constant norm.

    Parameters
    ----------
    name : of the recording
    sensor : accel or mag
    t, reading : (n,) s, (n, 3)
    norm : of the true reading
    unit : of the norm
    sigma : (n,) white noise of one reading per axis; None: not declared
    walk : declared random walk of the bias; None or 0: constant
    covariates : (n,) or (n, k) each, at the instants of the readings
    declared : declared effects with their parameters
    where : how messages call the recording
    wanders : where the noise is not declared: whether the bias may wander, as far as the residuals show it
    faults : readings that are none, and are not among these: see `LinearProblem`
    field : unit of a magnetometer's readings
    """

    rows_are_readings = True

    def __init__(
        self,
        name: str,
        sensor: str,
        t: FloatArray,
        reading: FloatArray,
        norm: float,
        unit: str,
        sigma: FloatArray | None = None,
        walk: float | None = None,
        covariates: Mapping[str, FloatArray] | None = None,
        declared: Mapping[str, Sequence[float]] | None = None,
        where: str = "",
        wanders: bool = False,
        faults: Sequence[tuple[str, str, float, float]] = (),
        field: FieldUnit = NO_UNIT,
    ) -> None:
        self.faults, self.field = tuple(faults), field
        self.name, self.stream, self.unit = name, sensor, unit
        self.where = where or name
        self.reading, self.norm = reading, norm
        self._t, self._sigma = t, sigma
        self._covariates = dict(covariates or {})
        self._declared = declared_model(declared or {})
        plain = calibrate_norm(sensor, reading, norm, where=self.where)
        if sigma is None:
            walk = None
            if wanders:  # in units of the white noise, which is the unit of the residuals then
                e = plain.apply(reading) / norm
                white, found = estimated_walk(plain.fit.residual, norm_jacobian(plain.fit.x, reading), e * plain.K, t)
                walk = found / white if white > 0.0 else None
        self._walk = bias_walk(t, walk)
        self._start = np.concatenate([1.0 / plain.K - 1.0, -plain.offset, np.zeros(self._walk.size)])
        self.per_truth = float(np.mean(np.abs(1.0 / plain.K)))  # reading per true unit
        self._prior_t = self._walk.prior(np.zeros(self._walk.size))[2]
        motion = self._motion(np.zeros_like(reading) + norm / np.sqrt(3.0))
        require_known(self._declared, motion, self.where)
        self._candidates = pose_candidates(sensor, motion, self._declared)

    @property
    def t(self) -> FloatArray:
        """(rows,) s."""
        return np.concatenate([self._t, self._prior_t])

    @property
    def instants(self) -> FloatArray:
        """(n,) of the readings [s]."""
        return self._t

    @property
    def noise_known(self) -> bool:
        """Whether the noise is declared."""
        return self._sigma is not None

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """Effects of the sensor in poses whose covariates the recording has."""
        return self._candidates

    @property
    def covariates(self) -> Mapping[str, FloatArray]:
        """(rows,) each; priors have zero."""
        pad = np.zeros(len(self._prior_t))
        return {k: np.concatenate([v, pad]) for k, v in self._covariates.items() if v.ndim == 1}

    def probes(self, most: int) -> tuple[Effect, ...]:
        """Powers of each axis, direction, the reading before, time, and powers of the covariates."""
        u, _ = self.true_reading(self._start, {})
        return probes_of_a_triad(self.stream, self._motion(u), self.noise_known, most)

    def start(self) -> FloatArray:
        """s, b and the knots of the bias."""
        return self._start.copy()

    def plausible(self, entry: Effect) -> FloatArray:
        """Plausible sizes, per unit of reading."""
        size = entry.plausible * (self.norm if entry.in_field_units else 1.0)
        return size * self.per_truth

    def true_reading(self, x: FloatArray, model: Mapping[Term, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Invert the model for u by Newton's method: u (n, 3) and B = d reading / d u (n, 3, 3)."""
        scale, bias = 1.0 + x[:3], x[3:6] + self._walk.value(self._t, x[6:])
        y, others = without_probes(self.reading - bias, model, self._motion)
        pairs = effects_in_mean(self._declared, others)
        if not pairs:
            return y / scale, np.broadcast_to(np.diag(scale), (len(y), 3, 3)).copy()
        return inverted(y, scale, self.norm, lambda u: self._added(u, pairs))

    def rows(
        self, nuisance: FloatArray, model: Mapping[Term, FloatArray], wanted: Sequence[Effect], known: bool = False
    ) -> Rows:
        """Whitened residuals of the norm and their derivatives."""
        u, B = self.true_reading(nuisance, model)
        length = np.linalg.norm(u, axis=1)
        e = u / length[:, None]
        a = np.linalg.solve(np.swapaxes(B, 1, 2), e[..., None])[..., 0]
        raw = length - self.norm
        spread = np.ones(len(raw)) if self._sigma is None else self._sigma * np.linalg.norm(a, axis=1)
        a = a / spread[:, None]
        if known:
            u = self.norm * e
        motion = self._motion(u)
        N = np.hstack([a * u, a, self._walk.derivative(self._t, a)])
        prior_r, prior_N, _ = self._walk.prior(nuisance[6:])
        m = len(prior_r)
        columns: dict[str, FloatArray] = {}
        for key, entry, beta in derivatives_wanted(model, wanted):
            slope = entry.slope(u, beta, motion)
            columns[key] = np.vstack([np.einsum("ni,nip->np", a, slope), np.zeros((m, entry.size))])
        return Rows(
            residual=np.concatenate([raw / spread, prior_r]),
            nuisance=np.vstack([N, np.hstack([np.zeros((m, 6)), prior_N])]),
            effects=columns,
            offset=np.vstack([a, np.zeros((m, 3))]),
            measured=np.concatenate([np.ones(len(raw), dtype=bool), np.zeros(m, dtype=bool)]),
            raw=np.concatenate([raw, np.zeros(m)]),
        )

    def _added(self, u: FloatArray, pairs: list[tuple[Effect, FloatArray]]) -> FloatArray:
        """What the effects add to the reading at u."""
        motion = self._motion(u)
        return np.asarray(np.sum([entry.change(u, beta, motion) for entry, beta in pairs], axis=0))

    def _motion(self, u: FloatArray) -> Motion:
        return motion_seen(self.stream, self._t, u, self._covariates)


def motion_seen(sensor: str, t: FloatArray, u: FloatArray, covariates: Mapping[str, FloatArray]) -> Motion:
    """What the effects on a sensor may know of poses: its true reading u (n, 3) and the covariates."""
    if sensor == "accel":
        return Motion(t=t, f_b=u, covariates=covariates)
    return Motion(t=t, m_b=u, covariates=covariates)
