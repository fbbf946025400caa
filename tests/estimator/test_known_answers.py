"""What was asked of a flight before is known, and for no longer than anybody can ask for it."""

from __future__ import annotations

import gc
from weakref import ref

import pytest

from sinan.estimator.evidence.flights.passes import FlightPasses
from sinan.estimator.evidence.flights.prediction import Prediction
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.source import Fit
from sinan.estimator.filter.effect_forms import Terms
from sinan.estimator.filter.flight import Flight
from tests.estimator.analytic_flight import fly


@pytest.fixture(scope="module")
def source() -> FlightSource:
    return FlightSource(Flight.of(fly(11, duration=16.0)[0]))


def test_suspects_of_a_fit_are_computed_once(source: FlightSource, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are declared anew each time."""
    plain, passes = source.fit(()), list[object]()
    first = source.suspects(plain)
    run = FlightPasses.run
    monkeypatch.setattr(FlightPasses, "run", lambda *asked, **how: passes.append(asked) or run(*asked, **how))
    again = source.suspects(plain)
    assert [one.statistic for _, one in again] == [one.statistic for _, one in first]
    assert len(first) > 1
    assert not passes


def test_a_prediction_keeps_no_fit_that_nobody_has(source: FlightSource) -> None:
    """Each is whole passes of the filter."""
    prediction = Prediction(source._passes, [("gps", "m")])
    fit = Fit((), {}, {}, 0.0, "all", source._passes.fitted(Terms.of([]), "all"))
    assert prediction._of(fit) is prediction._of(fit)
    kept = ref(fit.detail)
    del fit
    gc.collect()
    assert kept() is None
    prediction.of(source.fit(()))
    assert len(prediction._known) == 1
