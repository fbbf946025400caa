"""Where the error of a plain model goes, against what was put into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.estimator.evidence.budget import Budget
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.flight import Flight
from sinan.experiments.report.trace_figures import effect_over_time, residuals_over_time
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.simulate import simulate

CURRENT = "mag.current=0.006,0,0.002"


def budgets(*effects: str) -> dict[str, Budget]:
    """Of a figure of eight with effects, all of which are in the final model."""
    present = [parse_effect(one) for one in effects]
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(31), present)
    source = FlightSource(Flight.of(recording))
    final = source.fit([Term(one.split("=")[0]) for one in effects])
    return {one.stream: one for one in source.budget(source.fit(()), final)}


def test_without_an_effect_all_of_it_is_predicted() -> None:
    found = budgets()
    assert set(found) == {"mag", "baro", "sonar", "laser", "gps"} & set(found)
    for one in found.values():
        assert one.effects == 0.0
        assert one.effects + one.white + one.colour + one.motion + one.unnamed == pytest.approx(1.0)
        assert abs(one.unnamed) < 0.15
        assert one.white > 0.3


def test_an_effect_takes_its_share_and_no_name_is_left_over() -> None:
    plain, found = budgets()["mag"], budgets(CURRENT)["mag"]
    assert found.effects == pytest.approx(1.0 - plain.rms**2 / found.rms**2, abs=0.1)
    assert found.effects > 0.5
    assert abs(found.unnamed) < 0.05
    assert found.white / (1.0 - found.effects) == pytest.approx(plain.white, abs=0.1)


def test_noise_believed_too_large_is_said_and_its_parts_share_what_is_there() -> None:
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(31))
    spec = recording.spec("mag")
    assert spec.noise_std is not None
    louder = recording.replace(sensors={**recording.sensors, "mag": replace(spec, noise_std=3.0 * spec.noise_std)})
    found, plain = _budget_of(louder, "mag"), _budget_of(recording, "mag")
    assert found.predicted == pytest.approx(9.0, rel=0.15)
    assert plain.predicted == pytest.approx(1.0, rel=0.1)
    assert found.unnamed == 0.0
    assert found.white + found.colour + found.motion == pytest.approx(1.0)
    assert found.rms == pytest.approx(plain.rms, rel=0.1)


def test_the_first_reading_from_which_a_zero_is_found_counts_as_little_as_it_is_known() -> None:
    """A barometer's zero of 180 m is in its first innovation alone."""
    near, off = (_budget_of(one, "baro").rms for one in (_with_a_zero_of(0.0), _with_a_zero_of(180.0)))
    assert off == pytest.approx(near, rel=0.05)


def test_a_figure_of_residuals_tells_the_rms_of_the_budget_and_is_drawn_as_large() -> None:
    """Not that of the first innovation, 180 m."""
    source = FlightSource(Flight.of(_with_a_zero_of(180.0)))
    plain = source.fit(())
    baro = next(one for one in source.residuals(plain) if one.stream == "baro")
    budget = next(one for one in source.budget(plain, plain) if one.stream == "baro")
    assert baro.rms > 5.0 * budget.rms
    assert baro.weighed.rms == pytest.approx(budget.rms, rel=1e-9)
    upper, _ = residuals_over_time(baro, baro, "").axes
    assert f"RMS {budget.rms:.3g} m over" in upper.get_title(loc="left")
    assert upper.get_ylim()[1] < 10.0 * budget.rms
    begin = float(baro.t[0])
    (around,) = effect_over_time(baro, baro, "baro.transient", (begin, begin + 3.0)).axes
    assert around.get_ylim()[1] < 10.0 * budget.rms


def test_a_model_that_predicts_little_is_weighed_as_the_other_where_both_have_a_reading() -> None:
    source = FlightSource(Flight.of(_with_a_zero_of(0.0)))
    baro = next(one for one in source.residuals(source.fit(())) if one.stream == "baro")
    assert baro.variance is not None
    known = np.arange(len(baro.t)) > 0
    bolder = replace(baro.rows(known), variance=4.0 * baro.variance[known])
    taken = baro.as_sure_as(bolder).variance
    assert taken == pytest.approx(baro.variance * np.where(known, 4.0, 1.0)[:, None])


def _with_a_zero_of(metres: float) -> Recording:
    """A figure of eight whose barometer may have any zero."""
    recording, _ = simulate(load_scenario("figure_eight"), np.random.default_rng(31))
    baro = recording.streams["baro"]
    far = Stream(baro.t, {**baro.columns, "height": baro["height"] + metres})
    sensors = {**recording.sensors, "baro": replace(recording.spec("baro"), bias_std=200.0)}
    return recording.replace(sensors=sensors, streams={**recording.streams, "baro": far})


def _budget_of(recording: Recording, stream: str) -> Budget:
    source = FlightSource(Flight.of(recording))
    fit = source.fit(())
    return next(one for one in source.budget(fit, fit) if one.stream == stream)
