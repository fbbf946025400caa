"""The readable engine: filterpy's Kalman filter on the error state, `predict()` then `update()`, step by step.

In a notebook: ``for moment in sinan.steps(recording): ...`` stops after every predict and every update, with everything
in sight.
filterpy 2.0's `predict_update` linearises before it predicts and keeps the old posterior as prior; so the two are
called.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from sinan.estimator.filter.error_dynamics import bias_rates, decay_over, process_noise, transition, with_axes
from sinan.estimator.filter.events import ACCEPTED, GATED, NO_PREDICTION, WITHHELD, is_form_only
from sinan.estimator.filter.inputs import RunInputs, RunOutputs, bias_block, outputs_for, raise_for
from sinan.estimator.filter.layout import B_GYRO, D_BIASES, D_MOTION, DTHETA, P_N, PV, Q_NB, V_N, X_BIASES
from sinan.estimator.filter.strapdown import strapdown_step
from sinan.sensors.arrays import FloatArray
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_log,
    quaternion_multiply,
    right_jacobian,
    skew,
)

LOG_2_PI = float(np.log(2.0 * np.pi))  # = log(2 pi), of the normal density


@dataclass(frozen=True)
class Moment:
    """Where the filter stands after a predict (`event` is -1; at an IMU sample, or at a reading before it is used) or
    after the update with a reading.
    """

    t: float
    sample: int
    event: int


@dataclass(frozen=True)
class Update:
    """What one reading did.

    Attributes
    ----------
    z, z_pred, nu : (m,) reading (less the offsets of effects), its prediction, and the difference
    H : (m, n) Jacobian of the prediction by the error state
    R, S : (m, m) covariance of the reading's noise, and of the innovation; R as used, S before any weight
    K : (n, m) gain; zeros where the reading was not used
    """

    z: FloatArray
    z_pred: FloatArray
    nu: FloatArray
    H: FloatArray
    R: FloatArray
    S: FloatArray
    K: FloatArray


class ReadableFilter:
    """The filter of a run; its estimate is `x` (nominal) and `ekf.P`, its error state is zero between updates."""

    def __init__(self, inputs: RunInputs, outputs: RunOutputs | None = None) -> None:
        self.inputs, self.outputs = inputs, outputs or outputs_for(inputs)
        self.model, n = inputs.model, inputs.model.layout.n
        self.x, self.t = inputs.x.copy(), float(inputs.imu.t[0])
        self.walk2, self.rate = bias_rates(self.model)
        self.freedom = inputs.events.freedom
        self.update: Update | None = None  # the last one
        self.ekf = ExtendedKalmanFilter(dim_x=n, dim_z=1)
        self.ekf.x = np.zeros((n, 1))
        self.ekf.P = 0.5 * (inputs.P + inputs.P.T)

    def steps(self) -> Iterator[Moment]:
        """Run, and stop after every predict and every reading; one that is not predicted leaves `update` None."""
        for i0, i1, x, P in self.inputs.stretches:
            self.x, self.t, self.ekf.P = x.copy(), float(self.inputs.imu.t[i0]), 0.5 * (P + P.T)
            yield from self._stretch(i0, i1)

    def _stretch(self, i: int, last: int) -> Iterator[Moment]:
        """The same from the first sample of a stretch to the last."""
        imu, events = self.inputs.imu, self.inputs.events
        k, end = self.inputs.events_of(i, last)
        self._log_sample(i)
        while k < end or i < last:
            if k < end and (i >= last or events.t[k] < imu.t[i + 1]):
                self.update = None
                if self.outputs.status[k] in (ACCEPTED, WITHHELD):
                    if events.t[k] > self.t:
                        self.advance(i, float(events.t[k]))
                        yield Moment(self.t, i, -1)
                    self.read(k)
                self.outputs.x_event[k, : len(self.x)] = self.x
                self.outputs.var_event[k, : len(self.x) - 1] = np.diag(self.ekf.P)
                k += 1
                yield Moment(self.t, i, k - 1)
            else:
                self.advance(i, float(imu.t[i + 1]))
                i += 1
                self._log_sample(i)
                yield Moment(self.t, i, -1)

    def _log_sample(self, i: int) -> None:
        stride = self.outputs.stride
        if i == 0 or (stride and i % stride == 0):
            self.outputs.x_imu[i // stride if stride else 0, : len(self.x)] = self.x
            self.outputs.var_imu[i // stride if stride else 0, : len(self.x) - 1] = np.diag(self.ekf.P)

    def advance(self, i: int, t_next: float) -> None:
        """Predict from now to t_next, inside the IMU interval that begins with sample i."""
        imu, model, h = self.inputs.imu, self.model, t_next - self.t
        if h <= 0.0:
            return
        span = imu.t[i + 1] - imu.t[i]
        a0, a1 = (self.t - imu.t[i]) / span, (t_next - imu.t[i]) / span
        if t_next == imu.t[i + 1]:
            a1 = 1.0
        if model.averaged:
            a0 = a1 = 1.0
        u0 = (1.0 - a0) * imu.u[i] + a0 * imu.u[i + 1]
        u1 = (1.0 - a1) * imu.u[i] + a1 * imu.u[i + 1]
        rate = 0.5 * (u0 + u1)[3:] - self.x[B_GYRO]
        u0, u1 = self._scaled(u0), self._scaled(u1)
        self.x, step = strapdown_step(self.x, u0, u1, h, model.g_n, model.w_ie_n, model.translation)
        phi, q = decay_over(h, self.walk2, self.rate)
        self.x[X_BIASES] *= phi[D_BIASES]
        self.ekf.F = transition(step, model.layout.n, model.translation, phi)
        if model.gyro.axes is not None:
            self.ekf.F = with_axes(self.ekf.F, model.layout.slice(model.gyro.axes.block), rate)
        self.ekf.Q = process_noise(h, imu.q_accel[i], imu.q_gyro[i], q, model.translation)
        self.ekf.predict()
        self.t = t_next

    def _scaled(self, u: FloatArray) -> FloatArray:
        """(6,) sample of the IMU less what the gyroscope's scale and axes err by."""
        axes = self.model.gyro.axes
        if axes is None:
            return u
        S = self.x[self.model.layout.nominal(axes.block)].reshape(3, 3)
        return np.concatenate([u[:3], u[3:] - S @ (u[3:] - self.x[B_GYRO])])

    def read(self, k: int) -> None:
        """One reading: predict it, judge it, update with it, and count the error from the new estimate on."""
        events, out, layout = self.inputs.events, self.outputs, self.model.layout
        name = events.sensors[events.sensor[k]]
        rows = slice(events.row[k], events.row[k + 1])
        if not (np.all(np.isfinite(self.x)) and np.all(np.isfinite(self.ekf.P))):
            raise_for(1, k, self.inputs)
        z_pred, H = self.prediction(name, k)
        if not np.all(np.isfinite(z_pred)):
            out.status[k] = NO_PREDICTION
            return
        R = np.diag(events.r[rows])
        nu, S = events.z[rows] - z_pred, H @ self.ekf.P @ H.T + R
        try:
            L = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            raise_for(2, k, self.inputs)
        white = np.linalg.solve(L, nu)
        nis = float(white @ white)
        out.nu[rows], out.white[rows], out.nis[k] = nu, white, nis
        out.S[out.S_row[k] : out.S_row[k + 1]] = S.ravel()
        unused = np.zeros((layout.n, len(nu)))
        self.update = Update(events.z[rows], z_pred, nu, H, R, S, unused)
        out.loglik[k] = -0.5 * (nis + 2.0 * float(np.sum(np.log(np.diag(L)))) + len(nu) * LOG_2_PI)
        if out.status[k] == WITHHELD:
            return
        dof = int(self.freedom[k])
        if nis > self.model.threshold(dof):
            out.status[k] = GATED
            return
        spread = float(self.model.spread(name, nis, dof, out.loglik[k]))
        if spread > 1.0:  # more noise, so that S grows so much
            out.weight[k] = 1.0 / spread
            R = R + (spread - 1.0) * S
        self.ekf.update(nu[:, None], lambda _: H, lambda _: np.zeros((len(nu), 1)), R=R)
        self.update = Update(events.z[rows], z_pred, nu, H, R, S, self.ekf.K.copy())
        dx = self.ekf.x[:, 0]
        self.x = layout.retract(self.x, dx)
        self.x[Q_NB] /= np.linalg.norm(self.x[Q_NB])
        reset = np.eye(layout.n)
        reset[DTHETA, DTHETA] = right_jacobian(dx[DTHETA])
        self.ekf.P = reset @ self.ekf.P @ reset.T
        self.ekf.P = 0.5 * (self.ekf.P + self.ekf.P.T)
        self.ekf.x = np.zeros((layout.n, 1))

    def prediction(self, name: str, k: int) -> tuple[FloatArray, FloatArray]:
        """Predicted reading (m,) and H (m, n), from the sensor's own model, with what effects add."""
        events, model, layout, x = self.inputs.events, self.model, self.model.layout, self.x
        sensor = model.sensors[name]
        m_n = model.m_n + x[layout.nominal("field")] if layout.has("field") else model.m_n
        motion = Motion(
            t=events.t[k : k + 1], p_n=x[None, P_N], v_n=x[None, V_N], q_nb=x[None, Q_NB], m_n=m_n[None, :],
            g_n=model.g_n, ground_down=model.ground_down,
        )  # fmt: skip
        z_pred, H = np.zeros(sensor.size), np.zeros((sensor.size, layout.n))
        if not is_form_only(name):
            z_pred += sensor.predict(motion)[0]
            for block, values in sensor.jacobian(motion).items():
                H[:, layout.slice(block)] = values[0]
        if name == "mag":
            replaced = events.has_form[events.sensor[k]] == 2  # linear about the reference in field and axes, too
            C_bn = matrix_from_quaternion(events.ref[k, Q_NB] if replaced else x[Q_NB]).T
            if layout.has("field"):
                H[:, layout.slice("field")] = C_bn
            if layout.has("s_mag"):
                H[:, layout.slice("s_mag")] = skew(C_bn @ m_n)
                z_pred += H[:, layout.slice("s_mag")] @ x[layout.nominal("s_mag")]
        for start, process in model.colour_of(name):
            part = slice(start, start + process.size) if process.size > 1 else slice(None)
            H[part, layout.slice(process.block)] = np.eye(process.size) if process.size > 1 else 1.0
            z_pred[part] += x[layout.nominal(process.block)]
        bias = bias_block(name)
        if layout.has(bias):
            z_pred += H[:, layout.slice(bias)] @ x[layout.nominal(bias)]
        if events.has_form[events.sensor[k]]:
            ref, D = events.ref[k], events.D[events.row[k] : events.row[k + 1]]
            turn = quaternion_log(quaternion_multiply(quaternion_conjugate(ref[Q_NB]), x[Q_NB]))
            if events.has_form[events.sensor[k]] == 2:  # linear about the reference: only the bias stays
                z_pred = H[:, D_BIASES] @ x[X_BIASES]
                H[:, D_MOTION] = 0.0
            z_pred += D @ np.concatenate([x[PV] - ref[PV], turn])
            H[:, PV] += D[:, PV]
            H[:, DTHETA] += D[:, DTHETA] @ np.linalg.inv(right_jacobian(turn))
        return z_pred, H


def run_readable(inputs: RunInputs, outputs: RunOutputs) -> tuple[FloatArray, FloatArray]:
    """The whole run; final state (n + 1,) and covariance (n, n)."""
    engine = ReadableFilter(inputs, outputs)
    for _ in engine.steps():
        pass
    if not np.all(np.isfinite(engine.x)):
        raise_for(1, len(inputs.events), inputs)
    return engine.x, engine.ekf.P
