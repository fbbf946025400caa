"""The two engines hold the same equations; the compiled one keeps its covariance symmetric and positive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.filter import engine_numba, layout, smoother_numba
from sinan.estimator.filter.compiled import CompiledRun
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.error_dynamics import transition
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import Stray, flight_model
from sinan.estimator.filter.inputs import outputs_for, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import P_N
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.strapdown import strapdown_step
from sinan.experiments.measured.engines import nominal_sigma
from sinan.sensors.bounds import Bounds
from sinan.sensors.recording import SensorSpec, Stream
from tests.estimator.analytic_flight import RATES, SPECS, fly

AGREEMENT = 1e-9  # of sigma + |value|
ROUNDING = 1e-7  # of central differences
TRIOS = {
    "all aiding": {},
    "heights only": {"sensors": ("mag", "sonar", "baro"), "rates": {**RATES, "sonar": 20.0}},
    "attitude only": {"sensors": ("mag",)},
    "range biases": {
        "sensors": ("mag", "laser", "gps"),
        "specs": {**SPECS, "laser": SensorSpec(noise_std=0.02, bias_std=0.1, bias_walk=1e-3)},
    },
}  # fmt: skip


COLOURED = {
    "gps": replace(SPECS["gps"], colour_std=0.4, velocity_colour_std=0.2, colour_time=1.5),
    "mag": replace(SPECS["mag"], colour_std=0.02, colour_time=3.0),
    "baro": replace(SPECS["baro"], colour_std=0.5, colour_time=4.0),
    "laser": replace(SPECS["laser"], colour_std=0.05, colour_time=0.7),
}


def difference(a: Journal, b: Journal) -> float:
    """Largest difference of states in units of sigma + |value|."""
    worst = 0.0
    for x, y, var in ((a.x, b.x, a.var), (a.imu_x, b.imu_x, a.imu_var)):
        worst = max(worst, float(np.max(np.abs(x - y) / (nominal_sigma(var) + np.abs(x)))))
    return worst


@pytest.mark.parametrize("case", TRIOS)
def test_engines_agree(case: str) -> None:
    recording, _ = fly(5, duration=5.0, **TRIOS[case])
    model = flight_model(recording, robust_level=1e-2, gate_level=1e-3)
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT
    assert np.array_equal(fast.status, slow.status)


def test_engines_agree_with_colour_tails_and_an_unsure_field() -> None:
    recording, _ = fly(11, duration=5.0)
    model = flight_model(recording, specs=COLOURED, gate_level=None, tail=4.0, field=0.1 * np.diag([1.0, 2.0, 3.0]))
    assert model.layout.n == 22 + 11 + 3
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    assert np.any(fast.weight < 1.0)
    assert difference(fast, slow) < AGREEMENT


def test_engines_agree_where_a_laser_answers_something_else() -> None:
    recording, _ = fly(13, duration=5.0)
    laser = recording.streams["laser"]
    wrong = (laser.t > 2.0) & (laser.t < 3.0)
    z = np.where(wrong, 4.0 + 0.1 * np.sin(40.0 * laser.t), laser["range"])
    recording = recording.replace(streams={**recording.streams, "laser": Stream(laser.t, {"range": z})})
    model = flight_model(recording, gate_level=None, tail=4.0, stray={"laser": Stray(0.05, 12.0)})
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    weight = fast.stream("laser").weight
    assert np.all(weight[wrong] < 0.01)
    assert np.mean(weight[~wrong] > 0.5) > 0.9
    assert difference(fast, slow) < AGREEMENT


def test_engines_agree_under_bounds() -> None:
    recording, _ = fly(12, duration=5.0, sensors=("mag",))
    model = flight_model(recording, bounds=Bounds(0.5, 1.0), specs={"mag": COLOURED["mag"]})
    assert {"place", "speed"} <= set(model.sensors)
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT


def test_engines_agree_with_effects_and_earth_rotation() -> None:
    recording, _ = fly(6, duration=3.0)
    environment = replace(recording.environment, earth_rotation=True)
    recording = recording.replace(environment=environment, origin=(40.0, 116.0, 50.0))
    betas = {"accel.scale": [0.02, 0.0, 0.01], "gps.lever_arm": [0.3, 0.1, -0.2], "laser.boresight": [0.03, -0.02]}
    fast, slow = (run_filter(Flight.of(recording), betas, engine=e, passes=2) for e in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT


def test_phi_is_the_derivative_of_the_step() -> None:
    """But for the derivative of the coning term by the gyroscope's bias, which Phi leaves out."""
    recording, _ = fly(7, duration=1.0)
    model = flight_model(recording)
    layout, rng = model.layout, np.random.default_rng(1)
    x = prepare(Flight(recording, model)).x
    u0, u1, h = rng.normal(size=6), rng.normal(size=6), 0.02
    x1, step = strapdown_step(x, u0, u1, h, model.g_n, model.w_ie_n)
    Phi = transition(step, layout.n)
    left_out = h * h / 12.0 * float(np.linalg.norm(u0[3:] - u1[3:]))
    for j in range(layout.n):
        d = np.zeros(layout.n)
        d[j] = 1e-6
        ends = [strapdown_step(layout.retract(x, s * d), u0, u1, h, model.g_n, model.w_ie_n)[0] for s in (1.0, -1.0)]
        column = (layout.difference(ends[0], x1) - layout.difference(ends[1], x1)) / 2e-6
        assert np.max(np.abs(column - Phi[:, j])) < (left_out if 12 <= j < 15 else 0.0) + ROUNDING


@pytest.mark.parametrize("axes_std", [0.0, 0.005])
def test_covariance_stays_symmetric_and_positive(axes_std: float) -> None:
    """A million steps and readings: the same flight again and again, the covariance carried on."""
    recording, _ = fly(8, duration=60.0)
    inputs = prepare(Flight.of(recording, gate_level=None, axes_std=axes_std))
    outputs, P, steps = outputs_for(inputs, 0), inputs.P, 0
    while steps < 1_000_000:
        _, P = CompiledRun(replace(inputs, P=P), outputs).all()
        steps += len(inputs.imu) + len(inputs.events)
    assert np.array_equal(P, P.T)
    scale = 1.0 / np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P * np.outer(scale, scale)).min() > 0.0


def test_cutting_an_interval_leaves_the_noise_alone() -> None:
    """Readings of no weight cut the IMU's intervals; the covariance at the end is that of the uncut run."""
    specs = {**SPECS, "baro": SensorSpec(noise_std=1e9, bias_std=2.0, bias_walk=0.02)}
    recording, _ = fly(9, duration=4.0, specs=specs)
    cut = run_filter(Flight.of(recording), engine="numba")
    whole = run_filter(Flight.of(recording, use=("gps", "mag", "laser")), engine="numba")
    ratio = np.diag(cut.P_end)[:21] / np.diag(whole.P_end)[:21]
    assert np.max(np.abs(ratio - 1.0)) < 1e-4


def test_chunks_give_the_same_bits() -> None:
    recording, _ = fly(10, duration=4.0)
    inputs = prepare(Flight.of(recording))
    whole, outputs = run(inputs, "numba"), outputs_for(inputs)
    engine = CompiledRun(inputs, outputs)
    for i0, i1 in ((0, 123), (123, 500), (500, len(inputs.imu) - 1)):
        engine.chunk(i0, i1)
    assert np.array_equal(engine.result()[0], whole.x_end)


def test_noise_free_flight_has_no_innovations() -> None:
    recording, truth = fly(3, duration=20.0, noise=0.0)
    journal = run_filter(Flight.of(recording), engine="numba")
    assert np.max(np.abs(journal.white)) < 0.02
    assert np.max(np.abs(journal.imu_x[-1, P_N] - truth[-1, P_N])) < 1e-3


def test_every_file_of_kernels_has_the_capacity_of_the_layout() -> None:
    """Each says it itself: a kernel that was kept with another would read and write beside its arrays."""
    assert engine_numba.CAP == smoother_numba.CAP == layout.CAPACITY
