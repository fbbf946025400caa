"""What withheld readings do not bear out, and what may come in its place: on a linear problem whose answer is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
import pytest
from scipy import stats

from sinan.estimator.evidence.flights.prediction import Share
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.score import Evidence
from sinan.estimator.evidence.source import Fit, Part, Source
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.experiments.residual_loop.select import select
from sinan.experiments.residual_loop.trace import _borne_out
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from tests.estimator.analytic_flight import fly
from tests.linear_source import Linear, in_blocks

TRUE, IMPOSTOR = "baro.scale", "baro.temperature"
ALPHA = 0.01


class Two(Linear):
    """White noise, an effect that is there, and one whose signature goes with it by 0.6.

    Parameters
    ----------
    better : whether withheld readings are predicted better with the true effect; surely they never are
    sizes : of both, in plausible sizes
    """

    is_predicting = True
    assumes_motion = False
    candidates = (effect(TRUE), effect(IMPOSTOR))
    families = 2

    def __init__(self, better: bool, sizes: tuple[float, float] = (2.0, 0.0)) -> None:
        self._better = better
        self._plausible = np.array([entry.parameters[0].plausible for entry in self.candidates])
        Q = np.linalg.qr(np.random.default_rng(1).standard_normal((400, 3)))[0]
        self._W = 10.0 * np.stack([Q[:, 0], 0.6 * Q[:, 0] + 0.8 * Q[:, 1]], axis=1) / self._plausible
        self._white = self._W @ (sizes * self._plausible) + 10.0 * Q[:, 2]

    def _columns(self, terms: Sequence[Term]) -> list[int]:
        return [(TRUE, IMPOSTOR).index(term.name) for term in terms]

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Least squares."""
        W = self._W[:, self._columns(terms)]
        beta = np.linalg.lstsq(W, self._white, rcond=None)[0]
        std = np.sqrt(np.diag(np.linalg.inv(W.T @ W)))
        left = self._white - W @ beta
        of = [{t: v[k : k + 1] for k, t in enumerate(terms)} for v in (beta, std)]
        return Fit(tuple(terms), of[0], of[1], float(left @ left), part, left)

    def alone(self, fit: Fit, term: Term, evidence: Evidence) -> FloatArray:
        """Nothing holds it."""
        return fit.beta[term]

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """In ten blocks."""
        own = self._columns(fit.terms)
        which = own if own_terms_only else [*own, *(k for k in (0, 1) if k not in own)]
        W = self._W[:, which]
        information, score = in_blocks(W, cast(FloatArray, fit.detail))
        names = tuple((TRUE, IMPOSTOR)[k] for k in which)
        return Evidence(names, (1,) * len(which), information, score, self._plausible[which])

    def predicts(self, fit: Fit, without: Fit, surely: bool = True) -> bool:
        """The impostor surely; the true one perhaps."""
        return IMPOSTOR in fit.keys or (self._better and not surely)

    def bears_out(self, fit: Fit, without: Fit, log_odds: Callable[[float], float], needed: float) -> bool:
        """The impostor's odds are enough."""
        return IMPOSTOR in fit.keys and log_odds(1.0) > needed

    def gain_assuming_less(self, fit: Fit, without: Fit) -> float:
        """Nothing is assumed."""
        return np.inf


class Hiding(Two):
    """Both are there, and withheld readings bear the second out while the first is in the model and only then, or only
    while it is not.
    """

    def __init__(self, better: bool, given: bool) -> None:
        super().__init__(better, (2.0, 3.0))
        self._given = given

    def bears_out(self, fit: Fit, without: Fit, log_odds: Callable[[float], float], needed: float) -> bool:
        """The second, with the first or without it."""
        return IMPOSTOR in fit.keys and IMPOSTOR not in without.keys and (TRUE in without.keys) == self._given

    def predicts(self, fit: Fit, without: Fit, surely: bool = True) -> bool:
        """Either perhaps."""
        return self._better and not surely


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("better", [True, False])
def test_what_has_fallen_but_may_be_so_is_in_the_model_in_which_others_are_asked_and_nothing_else(
    better: bool, given: bool
) -> None:
    """In the round in which it falls, and in the next, though not in the model that is reported."""
    names = (IMPOSTOR,) if better == given else ()
    source = cast(Source, Hiding(better, given))
    selection = select(source, ALPHA)
    assert selection.names == (IMPOSTOR, TRUE)
    found, _, fallen = _borne_out(source, selection, [], ALPHA)
    assert {term.name for term in fallen} == {TRUE, IMPOSTOR} - set(names)
    assert found.names == names
    assert {term.name for term in found.final.terms} == set(names)


@pytest.mark.parametrize(("better", "names"), [(True, ()), (False, (IMPOSTOR,))])
def test_nothing_comes_in_the_place_of_what_withheld_readings_are_not_sure_of(
    better: bool, names: tuple[str, ...]
) -> None:
    """The impostor would explain 36 % of what the true effect does; where that predicts nothing, it was none."""
    source = cast(Source, Two(better))
    selection = select(source, ALPHA)
    assert selection.names == (TRUE,)
    found, _, fallen = _borne_out(source, selection, [], ALPHA)
    assert [term.name for term in fallen] == [TRUE]
    assert found.names == names
    assert {term.name for term in found.final.terms} == set(names)


def share_of(value: float, squares: Sequence[float], off: Sequence[float]) -> Share:
    """A share of which each window's products are off by so much, of readings that err each by itself."""
    each = np.array(squares)
    return Share(value * each + np.array(off), each, each)


def odds_of(gain: float) -> Callable[[float], float]:
    """Odds of what gains so much where noise is as in the model, against an Occam's factor that is none of noise."""
    return lambda scatter: 0.5 * gain / scatter - 2.0


def of_windows(n: int) -> Share:
    """A share of one in so many windows, without a scatter."""
    return Share(np.ones(n), np.ones(n), np.ones(n))


def test_what_withheld_readings_say_is_the_ratio_of_two_laws_of_student() -> None:
    """Four windows with 36 where 16 is believed, and the belief as one more: 52 of five where 4 is believed of each."""
    share = share_of(0.8, [4.0] * 4, [3.0, -3.0, 3.0, -3.0])
    assert share.effective == 4.0
    assert share.scatter == pytest.approx((4.0 + 36.0) / 4.0 / 4.0)
    assert share.sigma**2 == pytest.approx(share.scatter * 16.0 / 16.0**2)
    one, none = (float(stats.t.logpdf(0.8, 4, loc, share.sigma)) for loc in (1.0, 0.0))
    assert share.log_ratio == pytest.approx(one - none)
    told = 12.0 / share.scatter - 2.0 + share.log_ratio
    assert share.bears_out(odds_of(24.0), told - 1e-9)
    assert not share.bears_out(odds_of(24.0), told + 1e-9)


def test_of_many_windows_the_belief_counts_for_little_and_their_scatter_is_what_it_is() -> None:
    """Products of four times the variance that is believed, in 4000 windows: the cluster-robust sigma."""
    squares = np.full(4000, 3.0)
    off = np.sqrt(4.0 * squares) * np.random.default_rng(7).standard_normal(4000)
    share = Share(squares + off, squares, squares)
    left = share.products - share.value * squares
    assert share.sigma == pytest.approx(float(np.sqrt(np.sum(left**2)) / np.sum(squares)), rel=1e-3)
    assert share.scatter == pytest.approx(4.0, rel=0.1)


def test_a_share_is_known_no_better_than_the_model_believes() -> None:
    share = share_of(0.9, [1.0] * 4, [0.1, -0.1, 0.1, -0.1])
    one, none = (float(stats.t.logpdf(0.9, 4, loc, 0.5)) for loc in (1.0, 0.0))
    assert share.log_ratio == pytest.approx(one - none)


def test_windows_that_tell_next_to_nothing_are_none() -> None:
    """One that tells, and nine with a thousand-millionth of it, are as good as one alone."""
    share = Share(np.full(10, 1e-7), np.full(10, 1e-7), np.full(10, 1e-7))
    share.products[0] = share.squares[0] = share.believed[0] = 100.0
    alone = Share(*(one[:1] for one in (share.products, share.squares, share.believed)))
    assert share.effective == pytest.approx(1.0)
    assert share.log_ratio == pytest.approx(alone.log_ratio, rel=1e-6)
    one, none = (float(stats.cauchy.logpdf(1.0, loc, 0.1)) for loc in (1.0, 0.0))
    assert share.log_ratio == pytest.approx(one - none)


def test_errors_of_seconds_that_the_model_knows_leave_the_odds_as_they_are() -> None:
    """The windows scatter twelve times as much as readings would that err each by itself."""
    products, squares = np.array([9.0, 1.0, 8.0, 2.0]), np.full(4, 4.0)
    known, unknown = (Share(products, squares, times * squares) for times in (20.0, 1.0))
    assert known.scatter == 1.0
    assert unknown.scatter == pytest.approx(0.25 + 50.0 / 16.0)
    for share in (known, unknown):
        assert share.weighed(odds_of(20.0)) - share.log_ratio == pytest.approx(10.0 / share.scatter - 2.0)


def test_what_the_model_believes_not_to_know_is_not_told_by_windows_that_happen_to_agree() -> None:
    squares = np.full(6, 4.0)
    share = Share(squares, squares, 24.0 * squares)
    assert share.sigma == pytest.approx(1.0)
    assert share.value == 1.0
    assert not share.is_there
    assert not share.bears_out(odds_of(1e4), 1.0)


def test_of_what_comes_and_goes_seconds_have_to_say_no_more_than_rather_yes() -> None:
    for value, is_told in ((0.6, True), (0.4, False)):
        share = share_of(value, [1.0] * 4, [0.6, -0.6, 0.6, -0.6])
        assert share.bears_out(odds_of(40.0), 8.0, lasts=False) == is_told
        assert not share.bears_out(odds_of(40.0), 8.0)


@pytest.mark.parametrize(("term", "is_told"), [(Term("baro.step", (10.0, 40.0)), True), (Term("baro.scale"), False)])
def test_a_flight_asks_more_of_what_lasts(term: Term, is_told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    recording, _ = fly(3, duration=20.0, sensors=("baro",))
    source = FlightSource(Flight.of(recording), recording)
    share = share_of(0.6, [1.0] * 4, [0.6, -0.6, 0.6, -0.6])
    monkeypatch.setattr(source._prediction, "share", lambda fit, without: share)
    fit, without = (Fit(terms, {}, {}, 0.0, "all", None) for terms in ((term,), ()))
    assert source.bears_out(fit, without, odds_of(40.0), 8.0) == is_told


def test_more_than_what_was_fitted_bears_nothing_out_the_better() -> None:
    """A share of 3 is none of an effect of that size either."""
    told = [
        [share_of(value, [4.0] * 4, [3.0, -3.0, 3.0, -3.0]).bears_out(odds_of(24.0), needed) for needed in range(20)]
        for value in (1.0, 3.0)
    ]
    assert told[0] == told[1]
    assert set(told[0]) == {False, True}


@pytest.mark.parametrize(
    "share",
    [
        share_of(0.4, [1.0] * 4, [0.0] * 4),
        share_of(0.7, [1.0] * 4, [0.6, -0.6, 0.6, -0.6]),
        of_windows(1),
        Share(np.zeros(0), np.zeros(0), np.zeros(0)),
        Share(np.zeros(4), np.zeros(4), np.zeros(4)),
    ],
)
def test_what_withheld_readings_do_not_speak_for_is_not_borne_out_by_any_odds(share: Share) -> None:
    """Worse with it; better, but by what an impostor may be; one window of one sigma; none; none that tells."""
    assert not share.bears_out(odds_of(1e4), 1.0)
    assert not share.is_there
    assert share.sigma > 0.0


@pytest.mark.parametrize("value", [0.4, -3.0])
def test_between_two_a_share_below_one_half_takes_off_what_one_above_adds(value: float) -> None:
    below, above = (share_of(one, [1.0] * 4, [0.1, -0.1, 0.1, -0.1]) for one in (value, 1.0 - value))
    assert below.weighed(odds_of(20.0)) + above.weighed(odds_of(20.0)) == pytest.approx(16.0)
    assert below.log_ratio < 0.0


def test_between_two_windows_that_tell_nothing_leave_the_odds() -> None:
    assert Share(np.zeros(4), np.zeros(4), np.zeros(4)).weighed(odds_of(1e4)) == odds_of(1e4)(1.0)
