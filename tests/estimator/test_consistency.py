"""The filter's covariance tells the truth on flights whose noise is as declared."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.consistency import BLOCK_NAMES, chi_square, nees
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import flight_model
from sinan.estimator.filter.layout import DP, DTHETA, DV, V_N, blocks
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import estimated_motion, joint_covariance, smooth
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import POSITION, VELOCITY, Recording, Stream
from tests.estimator.analytic_flight import SPECS, fly

RUNS = 30
FALSE_ALARM = 0.001  # of each statistical test below; seeds are fixed


@pytest.fixture(scope="module")
def flights() -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Error, covariance, NIS and dof by reading, smoothed error over sigma, of independent flights."""
    results = []
    for seed in range(RUNS):
        recording, truth = fly(1000 + seed, duration=20.0)
        model = flight_model(recording)
        journal = run_filter(Flight(recording, model), engine="numba")
        states = smooth(journal, sigmas=True)
        rows = np.searchsorted(states.t, states.t_sigma)
        ratio = model.layout.difference(truth[rows], states.x[rows])[5] / states.sigma[5]
        error = model.layout.difference(truth[-1:], journal.x_end[None])[0]
        results.append((error, journal.P_end, journal.nis, journal.dof, ratio))
    return results


def test_every_block_of_states_has_a_name() -> None:
    assert set(BLOCK_NAMES) == set(blocks())
    assert len(set(BLOCK_NAMES.values())) == len(BLOCK_NAMES)


def test_nees_of_all_states(flights) -> None:
    total = sum(nees(error, P) for error, P, *_ in flights)
    statistic = chi_square(total, 22 * RUNS, 1.0 - FALSE_ALARM)
    assert statistic.consistent, statistic


def test_nis_of_all_readings(flights) -> None:
    total, dof = sum(float(f[2].sum()) for f in flights), sum(int(f[3].sum()) for f in flights)
    statistic = chi_square(total, dof, 1.0 - FALSE_ALARM)
    assert statistic.consistent, statistic


def test_smoothed_errors_are_as_large_as_their_sigma(flights) -> None:
    """Attitude and velocity at one instant of every flight; other states vary too little to count twice."""
    ratios = np.stack([f[4] for f in flights])
    statistic = chi_square(float(np.sum(ratios[:, 3:9] ** 2)), 6 * RUNS, 1.0 - 1e-6)  # components are correlated
    assert statistic.consistent, statistic


def test_smoother_does_not_depend_on_its_stretches() -> None:
    recording, _ = fly(1, duration=6.0)
    journal = run_filter(Flight.of(recording), engine="numba")
    assert np.max(np.abs(smooth(journal, part=100).x - smooth(journal, part=1200).x)) < 1e-9


def test_the_covariance_of_two_instants_is_what_fixes_at_one_tell_of_the_other() -> None:
    """Fixes more at one instant take C_jk H' (H C_kk H' + R)^-1 H C_kj from the covariance at another."""
    recording, _ = fly(5, duration=12.0)
    model, fixes, part = flight_model(recording), 100, 200
    states = np.r_[DP, DV, DTHETA, model.layout.slice("b_gps")]
    journal = run_filter(Flight(recording, model), engine="numba")
    t, C = joint_covariance(journal, states, part)
    before = smooth(journal, sigmas=True, part=part).sigma[:, states]
    assert np.allclose(np.sqrt(np.einsum("jaja->ja", C)), before, rtol=1e-9)
    k = len(t) // 2
    crowded = with_fixes(recording, t[k], fixes)
    after = smooth(run_filter(Flight.of(crowded), engine="numba"), sigmas=True, part=part).sigma[:, states]
    H = np.zeros((6, 12))
    H[:3, DP] = H[:3, 9:] = H[3:, DV] = np.eye(3)
    R = np.diag(np.repeat([SPECS["gps"].noise_std, SPECS["gps"].velocity_noise_std], 3)) ** 2 / fixes
    seen = np.einsum("jab,cb->jac", C[:, :, k], H)
    taken = np.einsum("jac,cd,jad->ja", seen, np.linalg.inv(H @ C[k, :, k] @ H.T + R), seen)
    assert np.min(after / before) < 0.7
    assert np.min(after[[k - 1, k + 1]] / before[[k - 1, k + 1]]) < 0.95
    assert np.max(np.abs(np.sqrt(before**2 - taken) / after - 1.0)) < 0.02  # the states differ a little too


def with_fixes(recording: Recording, instant: float, number: int) -> Recording:
    """The fix nearest to an instant again, `number` times within two milliseconds after it."""
    gps = recording.streams["gps"]
    near = int(np.argmin(np.abs(gps.t - instant)))
    v = np.stack([gps[name][near] for name in VELOCITY])
    again = instant + 2e-3 * (np.arange(number) + 0.5) / number
    columns = {name: np.full(number, values[near]) for name, values in gps.columns.items()}
    for name, speed in zip(POSITION, v, strict=True):
        columns[name] = columns[name] + speed * (again - gps.t[near])
    order = np.argsort(np.concatenate([gps.t, again]))
    joined = {name: np.concatenate([values, columns[name]])[order] for name, values in gps.columns.items()}
    stream = Stream(np.concatenate([gps.t, again])[order], joined)
    return recording.replace(streams={**recording.streams, "gps": stream})


def test_smoothed_end_is_the_filtered_end() -> None:
    recording, _ = fly(2, duration=3.0)
    journal = run_filter(Flight.of(recording), engine="numba")
    assert np.max(np.abs(smooth(journal).x[-1] - journal.x_end)) < 1e-9


def test_smoothed_motion_is_nearer_to_the_truth() -> None:
    recording, truth = fly(4, duration=20.0)
    journal = run_filter(Flight.of(recording), engine="numba")
    middle = slice(1000, 3000)
    errors = [
        np.std(m.v_n[middle] - truth[middle, V_N])
        for m in (estimated_motion(journal), estimated_motion(journal, smoothed=False))
    ]
    assert errors[0] < errors[1]
