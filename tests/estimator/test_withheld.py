"""Readings that are withheld: predicted and journaled, never used."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.estimator.evidence.flights.prediction import Prediction
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.flights.withheld import predicted
from sinan.estimator.filter.events import ACCEPTED, STATUS, WITHHELD
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel, flight_model
from sinan.estimator.filter.layout import PV
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.recording import NO_HEIGHT, POSITION, VELOCITY, Recording, Stream
from tests.estimator.analytic_flight import fly

AGREEMENT = 1e-9  # of the engines
SETTLED = 1e-3  # of a sigma: where passes end
CUT_INTERVALS = 2e-3  # of a sigma: a reading that is predicted cuts an interval of the IMU in two
WINDOWS = ((2.0, 4.0), (6.0, 7.0))


@pytest.fixture(scope="module")
def flight() -> Recording:
    return fly(11, duration=9.0)[0]


def withholding(recording: Recording) -> FlightModel:
    """Its model without the fixes of some windows."""
    return flight_model(recording).replace(withheld={"gps": WINDOWS})


def inside(t: np.ndarray) -> np.ndarray:
    """Which stamps are in a window."""
    return np.any([(t >= begin) & (t < end) for begin, end in WINDOWS], axis=0)


@pytest.mark.parametrize("engine", ["numba", "filterpy"])
def test_withheld_fixes_move_nothing(flight: Recording, engine: str) -> None:
    """The states are those of a log in which they are not."""
    gps = flight.streams["gps"]
    thinned = flight.replace(streams={**flight.streams, "gps": gps.rows(~inside(gps.t))})
    held = run_filter(Flight(flight, withholding(flight)), engine=engine)
    without = run_filter(Flight.of(thinned), engine=engine)
    sigma = np.sqrt(without.imu_var[:, PV])
    assert np.max(np.abs(held.imu_x[:, PV] - without.imu_x[:, PV]) / sigma) < CUT_INTERVALS
    assert np.allclose(held.imu_var, without.imu_var, rtol=CUT_INTERVALS)


def test_withheld_fixes_are_predicted_with_their_density(flight: Recording) -> None:
    """Innovation and its covariance about the predicted state, and log N(nu; 0, S)."""
    gps = flight.streams["gps"]
    one = (journal := run_filter(Flight(flight, withholding(flight)), engine="numba")).stream("gps")
    held = one.status == WITHHELD
    assert np.array_equal(held, inside(gps.t[one.index]))
    assert np.array_equal(one.accepted, ~held)
    layout = journal.model.layout
    states = journal.x[one.events[held]]  # after the reading, which has not moved it
    expected = gps.array((*POSITION, *VELOCITY))[one.index[held]] - states[:, PV]
    expected[:, :3] -= states[:, layout.nominal("b_gps")]
    assert np.allclose(one.nu[held], expected)
    nu, S = one.nu[held], one.S[held]
    nis = np.einsum("ki,kij,kj->k", nu, np.linalg.inv(S), nu)
    density = -0.5 * (nis + np.linalg.slogdet(2.0 * np.pi * S)[1])
    assert journal.loglik[one.events[held]] == pytest.approx(density)
    assert one.nis[held] == pytest.approx(nis)


def test_engines_agree_on_withheld_readings(flight: Recording) -> None:
    fast, slow = (run_filter(Flight(flight, withholding(flight)), engine=engine) for engine in ("numba", "filterpy"))
    assert np.array_equal(fast.status, slow.status)
    assert np.allclose(fast.white, slow.white, rtol=AGREEMENT, atol=AGREEMENT)


def test_withheld_readings_are_counted_by_their_name(flight: Recording) -> None:
    journal = run_filter(Flight(flight, withholding(flight)), engine="numba")
    held = int(np.sum(inside(flight.streams["gps"].t)))
    assert journal.counts()["gps"][STATUS[WITHHELD]] == held
    assert np.sum(journal.accepted) == np.sum(journal.status == ACCEPTED)


def test_a_lateness_leaves_the_same_fixes_withheld(flight: Recording) -> None:
    """Windows are of stamps, whatever instant a fix belongs to."""
    gps = flight.streams["gps"]
    one = run_filter(Flight(flight, withholding(flight)), {"gps.latency": [0.15]}, engine="numba").stream("gps")
    assert np.array_equal(one.status == WITHHELD, inside(gps.t[one.index]))


def test_withheld_fixes_are_in_no_pass_of_a_coarse_start(flight: Recording) -> None:
    """Far off, they would be seen anywhere."""
    gps = flight.streams["gps"]
    far = {**gps.columns, "north": gps["north"] + 1e6 * inside(gps.t)}
    moved = flight.replace(streams={**flight.streams, "gps": type(gps)(gps.t, far)})
    model = withholding(flight).replace(relinearise=True)
    here, there = (
        run_filter(Flight(log, model), {"gps.lever_arm": [0.3, 0.0, 0.0]}, engine="numba") for log in (flight, moved)
    )
    sigma = np.sqrt(np.diag(here.P_end))
    assert np.max(np.abs(here.model.layout.difference(here.x_end, there.x_end)) / sigma) < SETTLED


def test_an_age_counts_from_the_last_fix_that_was_used(flight: Recording) -> None:
    """The gate refuses those that are far off."""
    gps = flight.streams["gps"]
    begin = WINDOWS[0][0]
    far = (gps.t >= begin - 0.5) & (gps.t < begin)
    off = Stream(gps.t, {**gps.columns, "north": gps["north"] + 1e4 * far})
    found = predicted(Flight.of(flight.replace(streams={**flight.streams, "gps": off})), "gps", WINDOWS)
    assert found.age[0] == pytest.approx(found.t[0] - gps.t[~far & (gps.t < begin)][-1])


def test_what_stands_in_the_place_of_a_height_is_no_error() -> None:
    """Of fixes in two dimensions, 500 m off: in no residual, no prediction and no budget; others count as they did."""
    recording, _ = fly(2, duration=16.0, sensors=("gps", "mag", "baro"))
    gps = recording.streams["gps"]
    for flat in (np.ones(len(gps), dtype=bool), np.arange(len(gps)) % 2 == 0):
        down, epv = np.where(flat, 500.0, gps["down"]), np.where(flat, NO_HEIGHT, 0.5)
        fixes = Stream(gps.t, {**gps.columns, "down": down, "epv": epv})
        flown = recording.replace(streams={**recording.streams, "gps": fixes})
        source = FlightSource(Flight.of(flown))
        plain = source.fit(())
        (seen,) = (one for one in source.residuals(plain) if one.stream == "gps")
        assert not np.any(seen.residual[flat[seen.row], 2])
        assert np.sqrt(np.mean(seen.residual[:, :2] ** 2)) == pytest.approx(0.5, rel=0.1)
        (budget,) = (one for one in source.budget(plain, plain) if one.stream == "gps")
        assert budget.rms == pytest.approx(0.5, rel=0.1)  # of the position, as of the residual
        assert budget.predicted == pytest.approx(1.0, abs=0.12)
        assert np.array_equal(seen.dof, np.where(flat[seen.row], 5, 6))
        assert seen.nis_per_dof == pytest.approx(1.0, abs=0.12)
        (asked,) = Prediction(source._passes, [("gps", "m")]).of(plain)
        assert 0.2 < asked.rms < 1.5
        two = np.sqrt(np.mean(asked.residual[flat[asked.row], :2] ** 2))
        three = np.sqrt(np.mean(asked.residual[:, :2] ** 2))
        assert two == pytest.approx(three, rel=0.2)
        assert np.all(predicted(Flight.of(flown), "gps", WINDOWS).distance < 20.0)
