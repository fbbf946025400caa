"""How well the model believes to know a share of withheld readings: against covariances written down in full."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.flights.prediction import EVERY, WINDOW, Prediction, _sums, _variance_of_sum
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from tests.estimator.analytic_flight import fly

#: Readings in a window, its white noise [unit^2], and how much its walk grows from one to the next [unit^2].
N, WHITE, WALK = 60, 0.3, 0.05
SHAPES = {
    "same": np.ones(N),
    "grows": np.linspace(0.0, 2.0, N),
    "changes sign": np.linspace(-1.0, 1.0, N),
    "turns three times": np.sin(np.linspace(0.0, 6.0 * np.pi, N)),
}


def believed_and_exact(d: np.ndarray, state: np.ndarray) -> tuple[float, float]:
    """Variance of the product of whitened errors and changes d, by the model and by the covariance (N, N) of the state
    written down in full.
    """
    S = np.diag(state) + WHITE
    a = d / np.sqrt(S)
    C = (state + WHITE * np.eye(N)) / np.sqrt(np.outer(S, S))
    whitening, P = 1.0 / np.sqrt(S)[:, None, None], np.diag(state)[:, None, None]
    return _sums(np.zeros((N, 1)), a[:, None], np.ones(N), whitening, P)[2], float(a @ C @ a)


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize(("start", "walk"), [(0.0, 0.0), (2.0, 0.0), (0.0, WALK), (2.0, WALK)])
def test_of_a_walk_that_begins_anywhere_the_model_knows_what_a_window_errs(
    start: float, walk: float, shape: str
) -> None:
    k = np.arange(1, N + 1)
    believed, exact = believed_and_exact(SHAPES[shape], start + walk * np.minimum(k[:, None], k))
    assert believed == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("shape", list(SHAPES))
def test_of_a_constant_that_others_estimate_better_and_better_too(shape: str) -> None:
    """Another stream reads it along with each reading that is withheld: the error of the estimate by k of them."""
    k = np.arange(1, N + 1)
    errors = np.tril(np.ones((N, N))) / k[:, None]  # of the mean of k readings of unit variance
    believed, exact = believed_and_exact(SHAPES[shape], errors @ errors.T)
    assert believed == pytest.approx(exact, rel=1e-12)


def test_readings_that_have_their_errors_in_common_do_not_count_as_many() -> None:
    """By a shape that stays an average of all errs 30 times as much as if they erred each by itself."""
    d = np.ones(N)
    assert believed_and_exact(d, np.full((N, N), 2.0))[0] > 30.0 * np.sum(d**2 / (2.0 + WHITE))


def test_components_that_err_together_are_no_more_than_one() -> None:
    """A covariance of correlation 0.95 that is the same through a window, and its square root at every instant."""
    P = np.array([[1.0, 0.95], [0.95, 1.0]])
    g = np.random.default_rng(2).standard_normal((N, 2))
    total = np.sum(g, axis=0)
    assert _variance_of_sum(g, np.repeat(P[None], N, axis=0)) == pytest.approx(float(total @ P @ total))


def test_of_whitened_components_the_state_has_what_white_noise_has_not() -> None:
    """One reading of three components: what its product errs is the variance that its error has, the square of d."""
    rng = np.random.default_rng(5)
    A, r, d = rng.standard_normal((3, 3)), rng.uniform(0.1, 2.0, 3), rng.standard_normal((1, 3))
    whitening = np.linalg.inv(np.linalg.cholesky(A @ A.T + np.diag(r)))
    _, square, believed = _sums(d, d, np.ones(1), whitening[None], (A @ A.T)[None])
    assert square == pytest.approx(float(np.sum(d**2)))
    assert believed == pytest.approx(square)


@pytest.mark.parametrize("state", [0.0, 0.5, 0.99])
def test_of_a_doubted_reading_it_is_the_noise_that_is_larger(state: float) -> None:
    """A weight of one quarter is an innovation of four times the variance: the product, w d e, has w d^2."""
    d = np.array([[1.5]])
    _, square, believed = _sums(d, d, np.array([0.25]), np.ones((1, 1, 1)), np.full((1, 1, 1), state))
    assert square == pytest.approx(0.25 * 1.5**2)
    assert believed == pytest.approx(square)


def test_a_reading_told_late_is_in_the_window_in_which_it_was_withheld() -> None:
    """And one of an instant that rounding puts before the window begins."""
    prediction = Prediction.__new__(Prediction)
    begins = np.arange(63.696 + WINDOW, 123.7 - WINDOW, EVERY)
    prediction._windows = [(float(begin), float(begin) + WINDOW) for begin in begins]
    t = np.concatenate([begin + np.linspace(0.0, WINDOW, 51)[:-1] for begin in begins])
    for late in (-0.3, -1e-12, 0.0, 0.02, 0.3):
        assert np.array_equal(prediction._window_at(t - late), np.repeat(np.arange(len(begins)), 50))


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
        assert len(share.squares) == 7  # windows of three streams at one time are one
        assert 1.0 <= share.windows <= 7.0
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
