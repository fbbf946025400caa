"""Which options stand: on a linear problem whose answer is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy import stats

from sinan.estimator.evidence.score import Evidence, statistic_of
from sinan.estimator.evidence.source import IMPLAUSIBLE, Fit, LocalFinding, Part, Source
from sinan.estimator.evidence.term import Term
from sinan.experiments.residual_loop import trials
from sinan.experiments.residual_loop.options import Offered, Option, option_of
from sinan.experiments.residual_loop.select import _Path, open_after
from sinan.experiments.residual_loop.trials import IMPOSSIBLE, Finding, Trial, best_of, likeliest, trial
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect
from tests.linear_source import Linear, in_blocks


class Line(Linear):
    """White noise and one candidate; size and sigma in plausible sizes, held to zero as in a flight."""

    def __init__(self, size: float, sigma: float, name: str = "baro.scale", n: int = 400) -> None:
        rng = np.random.default_rng(1)
        self._name, self._plausible = name, effect(name).parameters[0].plausible
        G = rng.standard_normal(n)
        self.W = (G / np.linalg.norm(G) / (sigma * self._plausible))[:, None]
        noise = rng.standard_normal(n)
        noise -= self.W[:, 0] * (self.W[:, 0] @ noise) / (self.W[:, 0] @ self.W[:, 0])
        self.white = self.W[:, 0] * size * self._plausible + noise

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Least squares with the prior of `FlightPasses`."""
        information = self.W.T @ self.W
        prior = (IMPLAUSIBLE * self._plausible) ** -2.0
        beta = np.linalg.solve(information + prior, self.W.T @ self.white) if terms else np.zeros(1)
        left = self.white - self.W @ beta
        std = 1.0 / np.sqrt(np.diag(information))
        return Fit(tuple(terms), dict.fromkeys(terms, beta), dict.fromkeys(terms, std), float(left @ left), part, left)

    def alone(self, fit: Fit, term: Term, evidence: Evidence) -> FloatArray:
        """Without the prior."""
        information = self.W.T @ self.W
        return np.asarray(np.linalg.solve(information, self.W.T @ self.white))

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """In ten blocks."""
        information, score = in_blocks(self.W, cast(FloatArray, fit.detail))
        return Evidence((self._name,), (1,), information, score, np.full(1, self._plausible))


def tried(size: float, sigma: float, name: str = "baro.scale") -> tuple[float | None, dict[str, str]]:
    """The estimate, in plausible sizes, where it is taken; and why it is not."""
    source = cast(Source, Line(size, sigma, name))
    fit, refused = source.fit(()), dict[str, str]()
    evidence = source.evidence(fit)
    options = [option_of(statistic_of(evidence, name), evidence, fit)]
    found = best_of(source, fit, options, np.log(1e-4), refused, most=3)
    return (None if found is None else float(found[1].beta[0]) / effect(name).parameters[0].plausible), refused


def test_what_holds_an_estimate_to_zero_does_not_make_it_plausible() -> None:
    """40 plausible sizes, known to 8: held to zero by ten it is 24, which might be 10; the readings say 40."""
    assert tried(40.0, 8.0) == (None, {"baro.scale": IMPOSSIBLE})


def test_a_plausible_one_is_taken_as_the_readings_have_it() -> None:
    taken, refused = tried(3.0, 0.3)
    assert taken == pytest.approx(3.0, rel=2e-3)
    assert refused == {}


@pytest.mark.parametrize("name", ["baro.lag", "sonar.beam_cone"])
def test_what_is_positive_is_not_found_negative(name: str) -> None:
    """A pressure port does not know the height in advance."""
    assert tried(-2.0, 0.1, name) == (None, {name: IMPOSSIBLE})
    taken, _ = tried(2.0, 0.1, name)
    assert taken == pytest.approx(2.0, rel=2e-3)


class Predicting:
    """Withheld readings say how much of the difference of two fits is there; the model believes a `scatter`th of their
    variance.
    """

    is_predicting = True
    alike: Sequence[frozenset[str]] = ()

    def __init__(self, share: float, std: float, left: float = 0.0, scatter: float = 50.0) -> None:
        self._share, self._std, self._left, self._scatter = share, std, left, scatter

    def weighed(self, fit: Fit, other: Fit, log_odds: Callable[[float], float]) -> float:
        """The share is that of the second over the first effect."""
        share = self._share if fit.terms[0].name == SECOND else 1.0 - self._share
        return log_odds(self._scatter) + (share - 0.5) / self._std**2

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """What is left for either effect once the other is in the model: 2 log odds."""
        own = fit.terms[0].name
        score = np.sqrt(self._left) * np.array([[0.0, 1.0]])
        return Evidence((own, FIRST if own == SECOND else SECOND), (1, 1), np.eye(2)[None], score, np.ones(2))


FIRST, SECOND = "accel.lever_arm", "gps.lever_arm"


def tried_alone(name: str, log_odds: float) -> Trial:
    """A trial of one effect."""
    term, one = Term(name), np.ones(1)
    found = Finding(term, one, one, -log_odds, -log_odds, log_odds, 2.0 * log_odds, 2.0 * log_odds, ())
    return Fit((term,), {term: one}, {term: one}, 0.0, "all", None), found


@pytest.mark.parametrize(
    ("share", "std", "left", "scatter", "name", "rivals"),
    [
        (0.99, 0.4, 0.0, 50.0, SECOND, (FIRST,)),  # the second predicts better, the first has the better odds
        (0.99, 0.1, 0.0, 50.0, SECOND, ()),
        (0.99, 0.4, 0.0, 1.0, FIRST, ()),  # seconds are predicted as well as the model believes: its odds count
        (0.60, 0.4, 0.0, 50.0, FIRST, (SECOND,)),
        (0.20, 0.1, 0.0, 50.0, FIRST, ()),
        (0.60, 0.4, 900.0, 50.0, FIRST, ()),  # both are there
        (0.99, 0.4, 900.0, 50.0, FIRST, ()),
    ],
)
def test_prediction_and_odds_together_tell_effects_apart(
    share: float, std: float, left: float, scatter: float, name: str, rivals: tuple[str, ...]
) -> None:
    """Log odds of 500 and 450 are far apart, by the noise that the model has; of noise 50 times as large 1."""
    source = cast(Source, Predicting(share, std, left, scatter))
    _, finding = likeliest(source, [tried_alone(FIRST, 500.0), tried_alone(SECOND, 450.0)], -9.0)
    assert (finding.term.name, finding.confused_with) == (name, rivals)


def test_what_no_log_tells_apart_is_as_likely_whatever_odds_and_prediction_say() -> None:
    """The second explains a fifth and predicts nothing: two forms of one quantity, one of them ill computed."""
    source = Predicting(0.0, 0.1)
    source.alike = [frozenset({FIRST, SECOND})]
    _, finding = likeliest(cast(Source, source), [tried_alone(FIRST, 500.0), tried_alone(SECOND, 100.0)], -9.0)
    assert (finding.term.name, finding.confused_with) == (FIRST, (SECOND,))


def test_what_no_log_tells_from_an_effect_of_the_model_is_not_offered() -> None:
    class Pair(Line):
        candidates = (effect("baro.scale"), effect("baro.lag"))
        is_predicting = True

        def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
            return Evidence(("baro.scale", "baro.lag"), (1, 1), np.eye(2)[None], np.ones((1, 2)), np.ones(2))

    for alike, offered in (([], ["baro.lag"]), ([frozenset({"baro.lag", "baro.scale"})], [])):
        source = Pair(1.0, 0.1)
        source.alike = alike
        fit = source.fit((Term("baro.scale"),))
        found = Offered(cast(Source, source), fit, intervals=False)
        assert [option.term.name for option in found.options] == offered


def test_intervals_are_offered_beside_what_lasts_and_stands() -> None:
    """However well all blocks agree on it: a step can have the better odds."""
    step = LocalFinding(Term("accel.step", (30.0, np.inf)), 400.0, 3, -190.0, np.array([0.5, 0.0, 0.0]), 4.0)

    class WithAStep(Line):
        candidates = (effect("baro.scale"),)
        is_predicting = False

        def local_findings(self, fit: Fit, intervals: bool = True) -> Sequence[LocalFinding]:
            return [step] if intervals else []

    source = cast(Source, WithAStep(3.0, 0.1))
    for intervals, names in ((True, ["baro.scale", "accel.step"]), (False, ["baro.scale"])):
        found = Offered(source, source.fit(()), intervals)
        assert [option.term.name for option in found.options] == names
        assert found.options[0].log_p < -100.0


def a_finding(name: str, interval: tuple[float, float] | None, *rivals: Finding) -> Finding:
    """A finding of which nothing but term and rivals is asked."""
    return Finding(Term(name, interval), np.ones(1), np.ones(1), -99.0, -99.0, 90.0, 200.0, 200.0, rivals)


@pytest.mark.parametrize(
    ("fallen", "name", "length", "may"),
    [
        (a_finding("accel.scale", None), "accel.step", 20.0, True),
        (a_finding("accel.scale", None), "accel.transient", 4.0, False),
        (a_finding("accel.scale", None, a_finding("accel.transient", (18.0, 22.0))), "accel.transient", 4.0, False),
        (a_finding("accel.scale", None, a_finding("accel.transient", (3.0, 7.0))), "accel.transient", 4.0, True),
        (a_finding("accel.scale", None, a_finding("accel.transient", (3.0, 7.0))), "gyro.transient", 4.0, False),
        (a_finding("accel.step", (10.0, 30.0)), "accel.step", 19.0, False),
    ],
)
def test_an_interval_comes_in_the_place_of_what_has_fallen(
    fallen: Finding, name: str, length: float, may: bool
) -> None:
    """Where withheld readings can speak against it too, or where it was as likely before they were asked."""
    assert open_after([fallen])(Term(name, (0.0, length))) == may


def test_an_estimate_beyond_where_the_derivatives_hold_is_no_start() -> None:
    """From there on the fit ends where the likelihood is less than without the effect; from zero on it is found."""

    class Curved(Line):
        def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
            fit = super().fit(terms, start, part)
            lost = any(np.any(np.abs(beta) > 4.0 * self._plausible) for beta in (start or {}).values())
            return replace(fit, beta=dict(start or {}), deviance=fit.deviance + 1e5) if lost else fit

    source = cast(Source, Curved(3.0, 0.3))
    fit = source.fit(())
    evidence = source.evidence(fit)
    option = option_of(statistic_of(evidence, "baro.scale"), evidence, fit)
    found = trial(source, fit, replace(option, beta=3.0 * option.beta))
    assert found is not None
    assert found[1].gain > 50.0
    assert found[1].beta[0] / effect("baro.scale").parameters[0].plausible == pytest.approx(3.0, rel=2e-3)


@pytest.mark.parametrize(("sigmas", "stays"), [(1.0, False), (4.0, True)])
def test_what_may_be_none_by_its_own_error_is_no_finding(sigmas: float, stays: bool) -> None:
    """Whatever the likelihood has gained with it: it has grown with the motion, then."""

    class One(Line):
        candidates = (effect("baro.scale"),)
        is_predicting = True

    source, term = cast(Source, One(sigmas, 1.0)), Term("baro.scale")
    fit = source.fit((term,))
    path = _Path(source, fit, -9.0, None)
    path.findings = [Finding(term, fit.beta[term], fit.std[term], -99.0, -99.0, 90.0, 200.0, 200.0, ())]
    path.drop_what_may_be_none(0.01)
    assert path.selection().names == (("baro.scale",) if stays else ())


@pytest.mark.parametrize(
    ("name", "size", "sigma", "stays"),
    [("baro.lag", -9.0, 1.0, False), ("baro.scale", -9.0, 1.0, True), ("baro.scale", 40.0, 8.0, False)],
)
def test_what_has_become_one_that_cannot_be_is_no_finding(name: str, size: float, sigma: float, stays: bool) -> None:
    """However sure it is: negative where nothing is, or far too large by the readings alone (40 plausible sizes, held
    to 24), when another effect has come into the model, or has left it.
    """

    class One(Line):
        candidates = (effect(name),)
        is_predicting = True

    source, term = cast(Source, One(size, sigma, name)), Term(name)
    fit = source.fit((term,))
    path = _Path(source, fit, -9.0, None)
    path.findings = [Finding(term, fit.beta[term], fit.std[term], -99.0, -99.0, 90.0, 200.0, 200.0, ())]
    path._offered = path._offer()
    found = path.selection()
    assert found.names == ((name,) if stays else ())
    assert found.refused == ({} if stays else {name: IMPOSSIBLE})


@pytest.mark.parametrize(("gone", "refused"), [(1, {}), (2, {"baro.lag": IMPOSSIBLE})])
def test_what_could_not_be_is_tried_again_with_another_effect_in_the_model(gone: int, refused: dict[str, str]) -> None:
    """What was not in the model may be why; but what has had to go from it twice stays out, so that this ends."""

    class One(Line):
        candidates = (effect("baro.scale"),)
        is_predicting = True

    source, term = cast(Source, One(2.0, 0.1)), Term("baro.scale")
    path = _Path(source, source.fit(()), -9.0, None)
    for _ in range(gone):
        path._drop(Term("baro.lag"), IMPOSSIBLE)
    fit = source.fit((term,))
    path.add(fit, Finding(term, fit.beta[term], fit.std[term], -99.0, -99.0, 90.0, 200.0, 200.0, ()))
    assert path._refused == refused


@pytest.mark.parametrize("prior_sigma", [np.inf, 2.0])
def test_what_only_a_size_explains_that_does_not_occur_goes_last(prior_sigma: float) -> None:
    """40 plausible sizes known to 4, ten sigma: held to zero with two, a fifth of that evidence is left."""

    class Held(Line):
        def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
            return replace(super().evidence(fit, own_terms_only), prior_sigma=prior_sigma)

    source = cast(Source, Held(40.0, 4.0))
    fit = source.fit(())
    evidence = source.evidence(fit)
    option = option_of(statistic_of(evidence, "baro.scale"), evidence, fit)
    left = 1.0 if np.isinf(prior_sigma) else 2.0**2 / (2.0**2 + 4.0**2)
    assert option.log_p_held == pytest.approx(float(stats.chi2.logsf(left * option.statistic, 1)), rel=1e-6)


def test_of_two_options_the_one_that_sizes_which_occur_explain_is_tried_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other has the better statistic, and no room is left on a shortlist of one."""
    source = cast(Source, Line(1.0, 0.1))
    huge = Option(Term("baro.scale"), 120.0, 1, -60.0, -60.0, 0.0, 0.0, np.ones(1), -12.0)
    late = Option(Term("baro.lag"), 45.0, 1, -22.0, -22.0, 0.0, 0.0, np.ones(1), -21.0)
    tried: list[str] = []
    monkeypatch.setattr(trials, "trial", lambda _source, _fit, option: tried.append(option.term.name))
    assert best_of(source, source.fit(()), [huge, late], -9.0, {}, most=1, rounds=1) is None
    assert tried == ["baro.lag"]


def test_what_passes_is_tried_however_strong_another_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """By noise with heavy tails the score at zero sees a sixth of what an effect gains."""
    source = cast(Source, Line(1.0, 0.1))
    wrong = Option(Term("mag.outliers"), 555.0, 1, -277.0, -277.0, 0.0, 0.0, np.ones(1), -277.0)
    warm = Option(Term("gyro.temperature"), 40.0, 3, -19.0, -19.0, 0.0, 0.0, np.ones(3), -18.0)
    gained = {"mag.outliers": 30.0, "gyro.temperature": 118.0}

    def refit(_source: Source, fit: Fit, option: Option) -> Trial:
        odds = gained[option.term.name]
        return fit, Finding(option.term, option.beta, option.beta, -odds, -odds, odds, 2.0 * odds, odds, ())

    monkeypatch.setattr(trials, "trial", refit)
    best = best_of(source, source.fit(()), [wrong, warm], -9.0, {}, most=6)
    assert best is not None
    assert best[1].term.name == "gyro.temperature"


@pytest.mark.parametrize(("gained", "taken"), [(5.0, 2.0), (-5.0, 1.0)])
def test_a_trial_is_refitted_from_where_it_may_be_likelier(gained: float, taken: float) -> None:
    """And is what it was where that is none."""

    class Comb(Line):
        """Its fit stays where it starts; the other tooth is a plausible size away."""

        def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
            found = super().fit(terms, start, part)
            if not terms:
                return found
            beta = dict(start or {})
            there = float(beta[terms[0]][0]) > 1.5 * self._plausible
            return replace(found, beta=beta, deviance=found.deviance - gained * there)

        def relocated(self, fit: Fit, term: Term) -> tuple[Term, FloatArray]:
            return term, np.full(1, 2.0 * self._plausible)

    source, plausible = Comb(1.0, 0.1), effect("baro.scale").parameters[0].plausible
    plain = source.fit(())
    evidence = source.evidence(plain)
    option = option_of(statistic_of(evidence, "baro.scale"), evidence, plain)
    found = trials.trial(cast(Source, source), plain, replace(option, beta=np.full(1, plausible)))
    assert found is not None
    assert found[1].beta[0] == pytest.approx(taken * plausible)
