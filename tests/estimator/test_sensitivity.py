"""The fused sensitivity pass against a dense recursion, and against whole runs of the filter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sinan.estimator.evidence.sensitivity import (
    _inverse,
    candidate_streams,
    driver_regressors,
    sensitivity_pass,
    sensor_regressors,
)
from sinan.estimator.filter.effect_forms import Along, Terms, reference_motion
from sinan.estimator.filter.engine_filterpy import ReadableFilter
from sinan.estimator.filter.error_dynamics import transition
from sinan.estimator.filter.events import ACCEPTED
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import DP, DTHETA, DV
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.strapdown import strapdown_step
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import Effect, effect
from sinan.sensors.effects.transient import for_stream
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.rotation import right_jacobian
from tests.estimator.analytic_flight import fly

ROUNDING = 1e-9  # relative
CANDIDATES = (
    "accel.scale", "accel.lever_arm", "accel.cross_axis", "gyro.scale", "gyro.g_sensitivity", "gyro.cross_axis",
    "mag.scale", "mag.declination", "baro.scale", "laser.boresight", "laser.scale", "gps.lever_arm", "gps.latency",
)  # fmt: skip
#: Sixteen times three columns: two tiles at least have neither accelerometer nor gyroscope in them.
DISTURBANCES = tuple(for_stream("mag", 0.2 * k, 0.2 * k + 0.3) for k in range(16))
FLIGHTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "all aiding": ({}, {"gate_level": None}),
    "attitude only": ({"sensors": ("mag",)}, {"gate_level": None}),
    "gated and weighed down": ({}, {"gate_level": 0.3, "robust_level": 0.5}),
}


class DenseSensitivity(ReadableFilter):
    """The readable engine, carrying V with dense matrices."""

    def __init__(self, inputs: RunInputs, G_u: FloatArray, G_z: dict[str, FloatArray]) -> None:
        super().__init__(inputs)
        self.G_u, self.G_z, self.V = G_u, G_z, np.zeros((inputs.model.layout.n, G_u.shape[2]))
        self.W: list[FloatArray] = []

    def advance(self, i: int, t_next: float) -> None:
        t, h = self.inputs.imu.t, t_next - self.t
        if h <= 0.0:
            return
        a0, a1 = ((s - t[i]) / (t[i + 1] - t[i]) for s in (self.t, t_next))
        ends = [(1 - a) * self.G_u[i] + a * self.G_u[i + 1] for a in (a0, a1)]
        u = [(1 - a) * self.inputs.imu.u[i] + a * self.inputs.imu.u[i + 1] for a in (a0, a1)]
        _, step = strapdown_step(self.x, u[0], u[1], h, self.model.g_n, self.model.w_ie_n, self.model.translation)
        V = transition(step, len(self.V), self.model.translation) @ self.V
        turn = -h * right_jacobian(step.phi) @ (0.5 * (ends[0] + ends[1]))[3:]
        V[DTHETA] += turn
        skew = np.array([[0, -step.a1[2], step.a1[1]], [step.a1[2], 0, -step.a1[0]], [-step.a1[1], step.a1[0], 0]])
        push = -0.5 * h * (step.C0 @ ends[0][:3] + step.C1 @ ends[1][:3]) - 0.5 * h * skew @ step.C1 @ turn
        if self.model.translation:
            V[DV] += push
            V[DP] += 0.5 * h * push
        self.V = V
        super().advance(i, t_next)

    def read(self, k: int) -> None:
        events = self.inputs.events
        name = events.sensors[events.sensor[k]]
        _, H = self.prediction(name, k)
        P, before = self.ekf.P.copy(), self.x.copy()
        S = H @ P @ H.T + self.model.sensors[name].R
        super().read(k)
        if self.outputs.status[k] != ACCEPTED:
            return
        S = S / self.outputs.weight[k]
        S_beta = H @ self.V + self.G_z[name][events.index[k]]
        self.W.append(np.linalg.solve(np.linalg.cholesky(S), S_beta))
        self.V = self.V - P @ H.T @ np.linalg.solve(S, S_beta)
        turned = self.model.layout.difference(self.x, before)[DTHETA]
        self.V[DTHETA] = right_jacobian(turned) @ self.V[DTHETA]


def flown(case: str) -> tuple[Recording, FlightModel, Journal, Motion]:
    """A short flight, its model, its journal and the motion of that."""
    how, judged = FLIGHTS[case]
    recording, _ = fly(11, duration=4.0, **how)
    model = flight_model(recording, **judged)
    journal = run_filter(Flight(recording, model), engine="numba")
    return recording, model, journal, reference_motion(journal, Terms(), journal.run.imu)


def candidates(model: FlightModel) -> tuple[Effect, ...]:
    chosen = (*(effect(name) for name in CANDIDATES), *DISTURBANCES)
    return tuple(entry for entry in chosen if entry.stream in candidate_streams(model))


@pytest.mark.parametrize("case", FLIGHTS)
def test_fused_pass_is_the_dense_recursion(case: str) -> None:
    recording, model, journal, motion = flown(case)
    effects = candidates(model)
    _, found = sensitivity_pass(Flight(recording, model), effects, motion=motion, keep_rows=1)
    p, N, along = found.rows.shape[1], len(motion), Along(Flight(recording, model), Terms(), motion)
    G_u = np.zeros((N, 6, p))
    G_z = {name: np.zeros((len(journal.stream(name)), sensor.size, p)) for name, sensor in model.sensors.items()}
    for entry, columns in zip(effects, found.slices, strict=True):
        if entry.stream in ("accel", "gyro"):
            rows = slice(0, 3) if entry.stream == "accel" else slice(3, 6)
            G_u[:, rows, columns] = driver_regressors(along, entry.stream, [entry])
        else:
            G_z[entry.stream][:, :, columns] = sensor_regressors(along, entry.stream, [entry])
    dense = DenseSensitivity(along.inputs, G_u, G_z)
    for _ in dense.steps():
        pass
    W = np.concatenate(dense.W)
    assert np.all(np.abs(W - found.rows) <= ROUNDING * np.linalg.norm(W, axis=0))
    assert np.all(np.abs(dense.V - found.V) <= ROUNDING * np.linalg.norm(dense.V, axis=0))


def test_a_chunk_that_ends_between_two_readings_hands_on_the_whole_V() -> None:
    recording, model, journal, motion = flown("all aiding")
    effects, inner = candidates(model), journal.run.events.t
    _, one = sensitivity_pass(Flight(recording, model), effects, motion=motion, keep_rows=1, blocks=1)
    _, many = sensitivity_pass(Flight(recording, model), effects, motion=motion, keep_rows=1, blocks=20)
    assert not np.any(np.isin(many.edges[1:-1], inner))
    for a, b in ((one.rows, many.rows), (one.V, many.V)):
        assert np.all(np.abs(a - b) <= ROUNDING * np.linalg.norm(a, axis=0))


def test_a_column_is_the_same_in_any_company() -> None:
    """It is kept for whoever asks next, with others."""
    recording, model, _, motion = flown("all aiding")
    names = ("baro.time_offset", "baro.lag", "gps.lever_arm", "mag.time_offset", "accel.scale", "gps.latency")
    _, together = sensitivity_pass(Flight(recording, model), names, motion=motion, keep_rows=1)
    for name in names:
        _, alone = sensitivity_pass(Flight(recording, model), [name], motion=motion, keep_rows=1)
        one, other = alone.rows, together.rows[:, together.of(name)]
        assert np.all(np.abs(one - other) <= ROUNDING * np.linalg.norm(one, axis=0)), name


def test_a_lateness_does_not_move_the_edge_of_a_step() -> None:
    """Its slope is infinite where a reading is at the edge, as one is that an onset was found at."""
    recording, model, _, motion = flown("all aiding")
    late, flight = effect("gps.latency"), Flight(recording, model)
    bare = Along(flight, Terms(), motion)
    step = effect("gps.step").over(float(bare.at("gps").t[5]), np.inf)
    stepped = Along(flight, Terms.of([(step, step.plausible)]), motion)
    np.testing.assert_array_equal(sensor_regressors(stepped, "gps", [late]), sensor_regressors(bare, "gps", [late]))


def test_inverse_by_cofactors() -> None:
    """And one where an instrument shows nothing of a change."""
    M = np.eye(3) + 0.3 * np.random.default_rng(31).standard_normal((50, 3, 3))
    M[7, :, 1] = 0.0
    found = _inverse(M)
    sound = np.arange(50) != 7
    np.testing.assert_allclose(found[sound], np.linalg.inv(M[sound]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found[7], np.eye(3))
