"""How well the model believes to know a share of withheld readings: against covariances written down in full."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.flights.prediction import (
    EVERY,
    POSITIVE,
    SURELY_TOLD,
    WINDOW,
    Share,
    _sums,
    _variance_by_colour,
    _variance_of_sum,
)
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import statistic_of
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.effect_forms import Terms
from sinan.estimator.filter.flight import Flight
from sinan.sensors.noise import colour
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
    return _sums(np.zeros((N, 1)), a[:, None], np.ones(N), whitening, P, np.zeros(N), ())[2], float(a @ C @ a)


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


@pytest.mark.parametrize("doubted", [False, True])
def test_a_window_of_fixes_against_its_covariance_in_full(doubted: bool) -> None:
    """Twenty readings of three components that err together, some of twice to ten times the variance."""
    rng = np.random.default_rng(5)
    A, d, e = rng.standard_normal((3, 3)), rng.standard_normal((20, 3)), rng.standard_normal((20, 3))
    p, r = np.cumsum(rng.uniform(0.0, 0.3, 20)), rng.uniform(0.1, 2.0, (20, 3))
    weight = 1.0 / rng.uniform(2.0, 10.0, 20) if doubted else np.ones(20)
    P = p[:, None, None] * (A @ A.T)
    S = P + r[:, :, None] * np.eye(3)
    L = np.linalg.cholesky(S)
    full = np.minimum(p[:, None], p)[:, None, :, None] * (A @ A.T)[:, None, :]  # (k, i, l, j)
    for k in range(20):
        full[k, :, k, :] = S[k] / weight[k]
    g = np.stack([weight[k] * np.linalg.solve(L[k].T, d[k]) for k in range(20)]).ravel()
    product, square, believed = _sums(e, d, weight, np.linalg.inv(L), P, np.zeros(20), ())
    assert believed == pytest.approx(float(g @ full.reshape(60, 60) @ g))
    assert product == pytest.approx(sum(w * float(a @ b) for w, a, b in zip(weight, e, d, strict=True)))
    assert square == pytest.approx(sum(w * float(a @ a) for w, a in zip(weight, d, strict=True)))


@pytest.mark.parametrize("tau", [0.02, 1.0, 3.0, 1e3])
@pytest.mark.parametrize("shape", list(SHAPES))
def test_first_order_noise_is_forgotten_within_a_window(shape: str, tau: float) -> None:
    """Known to be zero when the window begins; the readings do not come evenly."""
    since = np.sort(np.random.default_rng(6).uniform(0.0, WINDOW, N))
    g, noise = np.stack([SHAPES[shape], SHAPES["same"]], axis=1), colour("c_baro", 2, 0.7, tau)
    earlier = np.minimum(since[:, None], since)
    C = 0.7**2 * np.exp(-np.abs(since[:, None] - since) / tau) * -np.expm1(-2.0 * earlier / tau)
    exact = sum(float(column @ C @ column) for column in g.T)
    assert _variance_by_colour(g, since, noise) == pytest.approx(exact, rel=1e-9)


def test_colour_and_what_else_errs_are_told_apart() -> None:
    """A baro with first-order noise beside a height that is off by the same all the time."""
    since, d = np.linspace(0.1, WINDOW, N), SHAPES["turns three times"]
    noise = colour("c_baro", 1, 0.7, 1.0)
    earlier = np.minimum(since[:, None], since)
    state = 0.2 + 0.7**2 * np.exp(-np.abs(since[:, None] - since)) * -np.expm1(-2.0 * earlier)
    S = np.diag(state) + WHITE
    a = d / np.sqrt(S)
    exact = float(a @ ((state + WHITE * np.eye(N)) / np.sqrt(np.outer(S, S))) @ a)
    whitening, P = 1.0 / np.sqrt(S)[:, None, None], np.diag(state)[:, None, None]
    parts = np.zeros((N, 1)), a[:, None], np.ones(N), whitening, P, since
    assert _sums(*parts, [(0, noise)])[2] == pytest.approx(exact)
    assert _sums(*parts, ())[2] < 0.7 * exact


@pytest.mark.parametrize("late", [0.0, 0.3])
def test_readings_are_in_the_windows_in_which_they_were_withheld(late: float) -> None:
    """Whatever the stamps are late, and though a log begins at no round number."""
    recording, _ = fly(3, duration=40.0, sensors=("gps",))
    streams = {name: replace(one, t=one.t + 63.696) for name, one in recording.streams.items()}
    recording = recording.replace(streams=streams)
    source = FlightSource(Flight.of(recording).believing(latency={"gps": late}), recording)
    held = source._prediction._of(source.fit(()))[0]
    stamps = recording.streams["gps"].t[held.residual.row]
    first = recording.streams["imu"].t[0] + WINDOW
    assert np.array_equal(held.window, np.floor((stamps - first + 1e-6) / EVERY))
    assert np.all((held.since > -1e-6) & (held.since < WINDOW))
    assert set(held.window) == set(range(4))


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
        off.append(share.value * np.sum(share.squares) / np.sqrt(np.sum(share.believed)))
        assert len(share.squares) == 7  # windows of three streams at one time are one
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


def test_a_share_of_that_sigma_is_positive_evidence_nine_times_in_ten() -> None:
    rng, squares = np.random.default_rng(8), np.full(400, 2.0)
    believed = np.full(400, (SURELY_TOLD * 2.0) ** 2 * 400.0)
    told = [
        Share(squares + np.sqrt(believed) * rng.standard_normal(400), squares, believed).log_ratio > POSITIVE
        for _ in range(4000)
    ]
    assert np.mean(told) == pytest.approx(0.9, abs=0.03)


def test_what_is_called_detectable_is_told_over_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what withheld readings hardly tell a larger size is; of what they tell well, and of noise, the same."""
    recording, _ = fly(4, duration=40.0, sensors=("mag", "gps"))
    source = FlightSource(Flight.of(recording), recording)
    plain = source.fit(())
    evidence = source.evidence(plain)
    every = {name: statistic_of(evidence, name, []) for name in evidence.names}
    before = {name: s for name, s in every.items() if np.all(np.isfinite(s.detectable_from))}
    monkeypatch.setattr(FlightSource, "is_predicting", True)
    changed = []
    for name, s in before.items():
        after = source._as_seconds_tell(plain, [s])[0]
        times = after.detectable_from / s.detectable_from
        assert times == pytest.approx(np.full(len(times), times[0]))
        if times[0] > 1.0:
            changed.append(name)
            best = np.argmin(s.detectable_from / Term(name).effect.plausible_in(source._passes.plain_motion))
            beta = np.where(np.arange(len(times)) == best, after.detectable_from, 0.0)
            share = source._prediction.share_if_there(plain, Terms.of({Term(name).effect: beta}))
            assert share.sigma == pytest.approx(SURELY_TOLD, rel=0.1)
    assert "gyro.g_sensitivity" in changed
    assert set(changed) < set(before) - {"accel.vibration"}
