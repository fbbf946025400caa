"""How well the model believes to know a share of withheld readings: against covariances written down in full."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.flights.prediction import _own_part, _sums
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from tests.estimator.analytic_flight import fly

#: Readings in a window, its white noise [unit^2], and how much its walk grows from one to the next [unit^2].
N, WHITE, WALK = 60, 0.3, 0.05


def believed_of_walk(start: float, walk: float, d: np.ndarray) -> tuple[float, float, float]:
    """Variance of the product of whitened errors and changes d in a window that begins with a variance: what the model
    believes, what it is, and what readings would have that err each by itself.
    """
    k = np.arange(1, N + 1)
    state = start + walk * np.minimum(k[:, None], k)
    S = np.diag(state) + WHITE
    a = d / np.sqrt(S)
    C = (state + WHITE * np.eye(N)) / np.sqrt(np.outer(S, S))
    own = _own_part(S[:, None, None], np.full((N, 1), WHITE))
    _, squares, believed = _sums(np.zeros((N, 1)), a[:, None], np.ones((N, 1)), own, np.array([0]))
    return float(believed[0]), float(a @ C @ a), float(squares[0])


@pytest.mark.parametrize("shape", ["same", "grows"])
def test_what_is_the_same_through_a_window_is_believed_to_be(shape: str) -> None:
    d = np.ones(N) if shape == "same" else np.linspace(0.0, 2.0, N)
    believed, exact, alone = believed_of_walk(2.0, 0.0, d)
    assert believed == pytest.approx(exact, rel=1e-12)
    assert exact > 30.0 * alone


def test_of_a_walk_no_less_is_believed_and_less_than_twice_as_much() -> None:
    believed, exact, alone = believed_of_walk(0.0, WALK, np.ones(N))
    assert exact < believed < 1.6 * exact
    assert exact > 15.0 * alone


def test_readings_that_err_each_by_itself_are_believed_to() -> None:
    believed, exact, alone = believed_of_walk(0.0, 0.0, np.linspace(-1.0, 1.0, N))
    assert believed == pytest.approx(exact, rel=1e-12)
    assert believed == pytest.approx(alone, rel=1e-12)


def test_windows_stand_each_by_itself_and_a_doubted_reading_counts_for_less() -> None:
    """A weight of one quarter is noise of twice the sigma."""
    rng = np.random.default_rng(4)
    e, d = rng.standard_normal((2, 20, 2))
    own, weight = rng.uniform(size=(20, 2)), np.repeat([[1.0], [0.25]], 10, axis=0)
    both = _sums(e, d, weight, own, np.array([0, 10]))
    for of, rows in enumerate((slice(0, 10), slice(10, 20))):
        alone = _sums(e[rows], d[rows], weight[rows], own[rows], np.array([0]))
        assert [one[of] for one in both] == pytest.approx([one[0] for one in alone])
    white = _sums(e, d, weight, np.ones((20, 2)), np.array([0, 10]))[2]
    assert white[1] == pytest.approx(float(np.sum((0.5 * d[10:]) ** 2)))


def test_white_noise_of_a_reading_is_a_part_of_what_is_off_of_each_component() -> None:
    rng = np.random.default_rng(5)
    A = rng.standard_normal((7, 3, 3))
    state, r = A @ A.transpose(0, 2, 1), rng.uniform(0.1, 2.0, (7, 3))
    S = state + r[:, :, None] * np.eye(3)
    L_inv = np.linalg.inv(np.linalg.cholesky(S))
    left = np.diagonal(L_inv @ state @ L_inv.transpose(0, 2, 1), axis1=1, axis2=2)
    np.testing.assert_allclose(_own_part(S, r), 1.0 - left, atol=1e-12)


def test_shares_of_what_is_not_there_are_off_by_as_much_as_the_model_believes() -> None:
    """A minute with its own noise and nothing hidden: each effect fitted, and what withheld readings say of it.

    Whoever took readings of one window for independent would find them sigmas off.
    """
    recording, _ = fly(3, duration=60.0, sensors=("mag", "baro", "gps"))
    source = FlightSource(Flight.of(recording), recording)
    plain, off, alone = source.fit(()), [], []
    for name in ("accel.scale", "gyro.cross_axis", "mag.scale", "mag.misalignment", "baro.scale", "gps.lever_arm",
                 "gps.latency", "mag.time_offset"):  # fmt: skip
        share = source._prediction.share(source.fit([Term(name)]), plain)
        off.append(share.value / share.sigma)
        alone.append(share.value * np.sqrt(np.sum(share.squares)))
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.4
    assert np.sqrt(np.mean(np.square(alone))) > 2.0


def test_without_effects_as_much_is_known_of_the_biases_as_with_them() -> None:
    """An effect of no size at all changes nothing of what is predicted."""
    recording, _ = fly(4, duration=40.0, sensors=("gps",))
    source = FlightSource(Flight.of(recording), recording)
    plain, none = source.fit(()), source.fit([Term("accel.vibration")])
    assert not np.any(none.beta[Term("accel.vibration")])
    assert np.sqrt(np.sum(source._prediction.share(none, plain).squares)) < 1e-3
