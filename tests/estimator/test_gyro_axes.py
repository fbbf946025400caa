"""What a gyroscope's scale and axes err by as a state, by other derivations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from sinan.calibration.levels.levels import first_levels
from sinan.calibration.levels.sizes import TURNING, sizes_of
from sinan.estimator.evidence.level_scores import level_scores
from sinan.estimator.evidence.sensitivity import sensitivity_pass
from sinan.estimator.filter.effect_forms import Terms, reference_motion
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.error_dynamics import transition, with_axes
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.layout import B_GYRO, DTHETA
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion, smooth
from sinan.estimator.filter.strapdown import strapdown_step
from sinan.sensors.arrays import FloatArray
from sinan.sensors.bounds import Bounds
from sinan.sensors.effects import effect
from sinan.sensors.recording import GYRO, Recording, SensorSpec, Stream
from tests.estimator.analytic_flight import SPECS, fly
from tests.estimator.test_engines import AGREEMENT, ROUNDING, difference
from tests.estimator.test_sensitivity import DISTURBANCES
from tests.estimator.test_zero_rate import BIAS, seconds, turned
from tests.estimator.test_zero_rate import model_of as resting

S = np.array([[0.01, -0.004, 0.003], [0.002, -0.008, 0.006], [-0.005, 0.001, 0.007]])
STD = 0.01
#: What differences leave: a compass on a slope of the motion is not quite linear.
STEP, CURVED = 1e-3, 0.05


def crooked(duration: float, share: float = 1.0) -> Recording:
    """An attitude flight whose gyroscope reads w with w = (1 - share S) reading."""
    recording, _ = fly(21, duration=duration, sensors=("mag",))
    imu = recording.streams["imu"]
    read = imu.array(GYRO) @ np.linalg.inv(np.eye(3) - share * S).T
    columns = {**imu.columns, **dict(zip(GYRO, read.T, strict=True))}
    return recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)})


def model_of(recording: Recording, axes_std: float = STD) -> FlightModel:
    specs: dict[str, SensorSpec] = {"mag": replace(SPECS["mag"], bias_walk=0.0)}
    return flight_model(recording, specs=specs, bounds=Bounds(6.0, 4.0), gate_level=None, axes_std=axes_std)


def test_the_engines_agree() -> None:
    recording = crooked(5.0)
    model = model_of(recording)
    fast, slow = (run_filter(Flight(recording, model), engine=engine) for engine in ("numba", "filterpy"))
    assert difference(fast, slow) < AGREEMENT
    assert np.max(np.abs(fast.imu_x[-1, model.layout.nominal("s_gyro")])) > 1e-3


def test_phi_is_the_derivative_of_the_step() -> None:
    """But for the coning of the gyroscope's errors, which Phi leaves out."""
    recording = crooked(1.0)
    model = model_of(recording)
    layout, rng = model.layout, np.random.default_rng(1)
    x = prepare(Flight(recording, model)).x
    x[layout.nominal("s_gyro")] = S.ravel()
    u0, u1, h = rng.normal(size=6), rng.normal(size=6), 0.02

    x[B_GYRO] = 0.1, -0.2, 0.3

    def as_scaled(state: FloatArray) -> list[FloatArray]:
        axes = state[layout.nominal("s_gyro")].reshape(3, 3)
        return [np.concatenate([u[:3], u[3:] - axes @ (u[3:] - state[B_GYRO])]) for u in (u0, u1)]

    def stepped(state: FloatArray) -> FloatArray:
        return strapdown_step(state, *as_scaled(state), h, model.g_n, model.w_ie_n)[0]

    x1, step = strapdown_step(x, *as_scaled(x), h, model.g_n, model.w_ie_n)
    Phi = with_axes(transition(step, layout.n), layout.slice("s_gyro"), 0.5 * (u0 + u1)[3:] - x[B_GYRO])
    left_out = h * h / 12.0 * 2.0 * float(np.linalg.norm(u0[3:])) * float(np.linalg.norm(u1[3:]))
    for j in range(*layout.slice("s_gyro").indices(layout.n)):
        d = np.zeros(layout.n)
        d[j] = 1e-6
        plus, minus = (stepped(layout.retract(x, sign * d)) for sign in (1.0, -1.0))
        column = (layout.difference(plus, x1) - layout.difference(minus, x1)) / 2e-6
        assert np.max(np.abs(column - Phi[:, j])) < left_out + ROUNDING
        assert np.linalg.norm(Phi[:, j][DTHETA]) > 10.0 * left_out


def off_a_prior(found: Sequence[FloatArray], std: float) -> list[float]:
    """How far each of two informations (p, p) is off (L^-1 + std^2)^-1, L being the first, in its own units."""
    expected = np.linalg.inv(np.linalg.inv(found[0]) + std**2 * np.eye(len(found[0])))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    return [float(np.max(np.abs(one - expected) / scale)) for one in found]


def test_it_is_what_effects_with_a_prior_are() -> None:
    """Friedland's separate-bias filter: information of nine effects L without the state, (L^-1 + STD^2)^-1 with it."""
    recording = crooked(30.0)
    effects = [effect("gyro.scale"), effect("gyro.cross_axis")]
    without = Flight(recording, model_of(recording, 0.0))
    journal = run_filter(without, engine="numba")
    motion = reference_motion(journal, Terms(), journal.run.imu)
    found = []
    for std in (0.0, STD):
        _, one = sensitivity_pass(Flight(recording, model_of(recording, std)), effects, motion=motion)
        found.append(one.total[0])
    without_it, with_it = off_a_prior(found, STD)
    assert with_it < 0.03
    assert without_it > 1.0


def test_the_smoother_and_the_filter_end_at_one_estimate_which_is_right() -> None:
    recording = crooked(60.0)
    model = model_of(recording)
    journal = run_filter(Flight(recording, model), engine="numba")
    smoothed, place, part = smooth(journal, sigmas=True), model.layout.nominal("s_gyro"), model.layout.slice("s_gyro")
    assert np.ptp(smoothed.x[:, place], axis=0) == pytest.approx(0.0, abs=2e-5)
    assert smoothed.x[0, place] == pytest.approx(journal.imu_x[-1, place], abs=2e-5)
    wrong = (smoothed.x[0, place] - S.ravel()) / smoothed.sigma[0, part]
    assert np.max(np.abs(wrong)) < 4.0
    assert np.median(smoothed.sigma[0, part]) < 0.2 * STD
    rate = estimated_motion(journal, smoothed=smoothed).w_ib_b
    imu = recording.streams["imu"].array(GYRO)
    bias = smoothed.x[:, model.layout.nominal("b_gyro")]
    assert np.std(rate - (imu - bias) @ (np.eye(3) - S).T) < 0.25 * np.std(imu @ S.T)


def start_known(recording: Recording, std: float) -> RunInputs:
    """A run whose first attitude is known, so that it is linear in what is left."""
    inputs = prepare(Flight(recording, model_of(recording, std)))
    P = inputs.P.copy()
    P[DTHETA, :], P[:, DTHETA] = 0.0, 0.0
    P[DTHETA, DTHETA] = 1e-6 * np.eye(3)
    return replace(inputs, P=P)


def test_its_size_by_the_score_and_by_differences() -> None:
    """d log L / d log of the standard deviation: what goes backwards takes the state along."""
    recording, std = crooked(25.0, 0.2), 0.2 * STD
    inputs = start_known(recording, std)
    part = inputs.model.layout.slice("s_gyro")
    found = 2.0 * std**2 * float(np.trace(level_scores(inputs).start[part, part]))
    ends = [run(start_known(recording, std * np.exp(s * STEP)), "numba", 0).log_likelihood for s in (1.0, -1.0)]
    assert found == pytest.approx((ends[0] - ends[1]) / (2.0 * STEP), rel=CURVED)


def test_what_no_driver_moves_is_as_in_a_pass_of_its_own() -> None:
    """Two tiles of columns besides those of the gyroscope: all are carried step by step."""
    recording = crooked(4.0)
    flight = Flight(recording, model_of(recording))
    journal = run_filter(flight, engine="numba")
    motion = reference_motion(journal, Terms(), journal.run.imu)
    effects = (effect("gyro.scale"), effect("gyro.cross_axis"), *DISTURBANCES)
    _, together = sensitivity_pass(flight, effects, motion=motion)
    for entry, columns in list(zip(effects, together.slices, strict=True))[::5]:
        _, alone = sensitivity_pass(flight, (entry,), motion=motion)
        part = together.total[0][columns, columns]
        assert np.max(np.abs(part - alone.total[0])) <= 1e-9 * np.max(part)


def test_a_rest_says_nothing_of_it_however_large_the_bias() -> None:
    recording, _ = turned()
    imu = recording.streams["imu"]
    columns = {**imu.columns, **{name: imu[name] + 0.09 for name in GYRO}}
    recording = recording.replace(streams={**recording.streams, "imu": Stream(imu.t, columns)})
    model = resting(recording, zero_rate=seconds(0, 20), axes_std=STD)
    model = model.replace(gyro=replace(model.gyro, bias_std=0.1))
    journal = run_filter(Flight(recording, model), engine="numba")
    part, bias = model.layout.slice("s_gyro"), model.layout.nominal("b_gyro")
    at_rest, moved = (np.flatnonzero(journal.imu_t < t)[-1] for t in (20.0, 40.0))
    assert journal.imu_x[at_rest, bias] == pytest.approx(BIAS + 0.09, abs=2e-3)
    assert np.sqrt(journal.imu_var[at_rest, part]) == pytest.approx(np.full(9, STD), rel=0.02)
    assert np.sqrt(journal.imu_var[moved, part]).min() < 0.7 * STD


@pytest.mark.parametrize(
    ("streams", "gyro", "there"),
    [
        (("mag",), SensorSpec(), True),
        (("mag", "baro"), SensorSpec(), True),
        (("mag", "gps"), SensorSpec(), True),
        (("mag",), SensorSpec(noise_std=1e-3), False),
        (("mag",), SensorSpec(noise_density=1e-4), False),
    ],
)
def test_it_is_a_state_where_nobody_declares_the_noise_of_the_gyroscope(
    streams: tuple[str, ...], gyro: SensorSpec, there: bool
) -> None:
    recording, _ = fly(3, duration=5.0, sensors=streams)
    recording = recording.replace(sensors={"gyro": gyro})
    sizes = sizes_of(recording)
    levels = first_levels(recording, sizes, None, None)
    assert (levels.axes_std > 0.0) == there
    assert levels.flight(recording).model.layout.has("s_gyro") == there
    rates = [size.median for size in sizes if size.key == "rate"]
    assert rates == ([TURNING] if there else [])
