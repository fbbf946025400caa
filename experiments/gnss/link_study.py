"""`sinan ranges`: a simulated rover, a base and a data link; what the age of a correction does, against theory.

A corrected range is wrong by what both receivers see and what has changed since, and by the noise of both:

    v(a) = Var[e(t + a) - sum_k w_k e(t - b_k)] + w' (K_m + s_b^2 1) w + s_m^2 + s_r^2

with w the weights of the straight line that the base draws through its past, K_m of the base's slow errors, s_m and s_r
slow error and noise of the rover. Every term is Gaussian with a known autocovariance, so the sum is exact; the mean of
an epoch goes into the clock. A fix has the covariance G diag(v) G', G = (A' W A)^-1 A' W.

Neglected in v: how the delays of the two places differ from their models' difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sinan.estimator.positioning.location import Location, locate
from sinan.experiments.gnss.reference import position_error
from sinan.experiments.gnss.simulated import RangeScenario, SimulatedRanges, as_json, simulate
from sinan.sensors import dgps
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.code_receiver import CodeReceiver
from sinan.sensors.data_link import RATE_STEP, VALUE_STEP, DataLink, apply_link
from sinan.sensors.pseudorange import L1, L2, MODELLED, Pseudoranges, line_of_sight, modelled
from sinan.sensors.range_error import RangeError, aged_variance, line_weights

AGES = (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0)  # s
MASK = np.deg2rad(10.0)
EVERYTHING = tuple(MODELLED)
TWO = (1.0 + (L1 / L2) ** 4) / ((L1 / L2) ** 2 - 1.0) ** 2  # variance of the combination of two codes
LONGEST = 1e4  # s: in a study no correction is too old


def study(scenario: RangeScenario, seed: int = 0, ages: Sequence[float] = AGES) -> dict[str, Any]:
    """Simulate, fix alone and over the link, and compare the error at each age with what theory says.

    Returns
    -------
    what `--json` writes; ages in s, errors in m
    """
    simulated = simulate(scenario, seed)
    return document_of(simulated, seed, ages)


def document_of(simulated: SimulatedRanges, seed: int = 0, ages: Sequence[float] = AGES) -> dict[str, Any]:
    """The same of what has been simulated; ages for which the scenario is too short are left out."""
    scenario = simulated.scenario
    rover, base = simulated.ranges()
    truth = simulated.position
    alone = locate(rover, mask=MASK, exclude=False)  # no satellite is faulty there
    used = alone.fixes.used
    linked, applied = over_link(simulated, rover, base, replace(scenario.link, seed=seed))
    age = applied.age[linked.fixes.used]
    noise = {"rover": scenario.rover, "base": scenario.base}
    longest = max(0.5 * (scenario.seconds - scenario.link.window), 0.0)
    return {
        "format": 1,
        "seed": seed,
        "scenario": as_json(scenario),
        "epochs": len(rover.t),
        "satellites": float(np.bincount(rover.epoch[used], minlength=len(rover.t)).mean()),
        "receivers": {
            name: {
                "class": one.name,
                "codes": list(one.codes),
                "noise": float(np.sqrt(np.mean(white_variance(one, rover)[used]))),
                "drift": float(np.sqrt(np.mean(slow_variance(one, alone.elevation)[used]))),
                "rate_hz": one.rate,
            }
            for name, one in noise.items()
        },
        "alone": position_error(alone.fixes.position, truth),
        "link": {
            "expected_age": expected_age(scenario),
            "age": {"mean": float(np.mean(age)) if len(age) else None, "max": float(age.max()) if len(age) else None},
            "epochs": int(linked.fixes.solved.sum()),
            "position_error": position_error(linked.fixes.position, truth),
        },
        "ages": [entry_at(simulated, rover, base, float(a)) for a in ages if a <= longest],
    }


def expected_age(scenario: RangeScenario) -> float:
    """Mean age of what is used [s], over the rover's epochs instead of over all instants."""
    link = scenario.link
    return link.mean_age - 0.5 * min(link.interval, 1.0 / scenario.rover.rate)


def over_link(
    simulated: SimulatedRanges,
    rover: Pseudoranges,
    base: Pseudoranges,
    link: DataLink,
    longest: float = dgps.LONGEST_AGE,
) -> tuple[Location, dgps.Applied]:
    """Fixes from corrected ranges, each as heavy as two receivers' noise allows."""
    applied = apply_link(base, simulated.base_position, link, rover, simulated.navigation, EVERYTHING, longest)
    return locate(rover, EVERYTHING, mask=MASK, correction=applied.value, variance=weights(simulated, rover),
                  exclude=False), applied  # fmt: skip


def weights(simulated: SimulatedRanges, rover: Pseudoranges) -> FloatArray:
    """(n,) variance of the rover's own errors [m^2], by which a corrected range is weighed."""
    elevation = elevations(simulated, rover)
    receiver = simulated.scenario.rover
    return white_variance(receiver, rover) + slow_variance(receiver, elevation)


def elevations(simulated: SimulatedRanges, rover: Pseudoranges) -> FloatArray:
    """(n,) elevation over the true place, of a round Earth [rad]."""
    r = simulated.position[rover.epoch]
    _, direction = line_of_sight(rover.position, r)
    return np.asarray(np.arcsin(-np.sum(direction * r, axis=1) / np.linalg.norm(r, axis=1)))


def white_variance(receiver: CodeReceiver, ranges: Pseudoranges) -> FloatArray:
    """(n,) of the white noise of what is solved [m^2]."""
    return receiver.sigma(ranges.strength + receiver.losses) ** 2 * (TWO if len(receiver.codes) > 1 else 1.0)


def slow_variance(receiver: CodeReceiver, elevation: FloatArray) -> FloatArray:
    """(n,) of the slow errors of what is solved [m^2]."""
    return receiver.slow(elevation) ** 2 * (TWO if len(receiver.codes) > 1 else 1.0)


def entry_at(simulated: SimulatedRanges, rover: Pseudoranges, base: Pseudoranges, age: float) -> dict[str, Any]:
    """Ranges and fixes with corrections of one age: what they are wrong by, and what theory says of it."""
    entry: dict[str, Any] = {"age": age}
    window = simulated.scenario.link.window
    for name, rate in (("with_rate", True), ("without_rate", False)):
        link = DataLink(interval=0.0, delay=age, rate=rate, window=window)
        location, applied = over_link(simulated, rover, base, link, LONGEST)
        begin = min(age + window, 0.8 * simulated.scenario.seconds)
        keep = location.fixes.used & (rover.time - rover.t[0] >= begin)
        variance = expected_variance(simulated, rover, age, link)
        left = range_error(simulated, rover, applied)
        entry[name] = {
            "range": measured_rms(left, rover, keep),
            "range_expected": float(np.sqrt(np.mean(variance[keep]))),
            "position": position_rms(location, simulated.position, keep),
            "position_expected": expected_position(location, rover, variance, keep),
        }
    return entry


def range_error(simulated: SimulatedRanges, rover: Pseudoranges, applied: dgps.Applied) -> FloatArray:
    """(n,) corrected range minus true distance [m]: with the receiver's clock."""
    distance, _ = line_of_sight(rover.position, simulated.position[rover.epoch])
    left = rover.value - distance - applied.value
    return np.asarray(left - modelled(rover, simulated.position, EVERYTHING))


def measured_rms(left: FloatArray, rover: Pseudoranges, keep: BoolArray) -> float:
    """RMS about the mean of each epoch, which the clock takes, by n - 1."""
    epoch, left = rover.epoch[keep], left[keep]
    count = np.bincount(epoch, minlength=len(rover.t))
    mean = np.bincount(epoch, left, minlength=len(rover.t)) / np.maximum(count, 1)
    freedom = float(np.sum(np.maximum(count - 1, 0)))
    return float(np.sqrt(np.sum((left - mean[epoch]) ** 2) / max(freedom, 1.0)))


def expected_variance(simulated: SimulatedRanges, rover: Pseudoranges, age: float, link: DataLink) -> FloatArray:
    """(n,) v(a) of each row [m^2]; the base sees each satellite as high as the rover does."""
    scenario = simulated.scenario
    elevation = elevations(simulated, rover)
    back = np.arange(0.0, link.window + 1e-6, 1.0 / scenario.base.rate)
    w = line_weights(back, age, link.rate)
    slow = aged_variance((RangeError(1.0, scenario.base.drift_time),), 0.0, back, w, 1e9) - 1.0  # w' K w
    steps = (VALUE_STEP**2 + (age * RATE_STEP * link.rate) ** 2) / 12.0
    white_b = white_variance(scenario.base, rover)
    total = aged_variance(scenario.errors, 0.0, back, w, age) + steps + slow * slow_variance(scenario.base, elevation)
    total = total + float(w @ w) * white_b + white_variance(scenario.rover, rover)
    return np.asarray(total + slow_variance(scenario.rover, elevation))


def position_rms(location: Location, truth: FloatArray, keep: BoolArray) -> float:
    """RMS distance from the truth [m] over the epochs that are kept."""
    epochs = np.unique(location.ranges.epoch[keep])
    error = location.fixes.position[epochs] - truth[epochs]
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=1))))


def expected_position(location: Location, rover: Pseudoranges, variance: FloatArray, keep: BoolArray) -> float:
    """RMS distance that v(a) leads to [m]: trace of the first three of G diag(v) G', on average over the epochs."""
    weight = np.where(location.fixes.used, 1.0 / location.variance, 0.0)
    _, direction = line_of_sight(rover.position, location.fixes.position[rover.epoch])
    A = np.nan_to_num(np.hstack([direction, np.ones((len(rover), 1))]))
    total, count = 0.0, 0
    for epoch in np.unique(rover.epoch[keep])[::10].tolist():
        rows = np.flatnonzero((rover.epoch == epoch) & location.fixes.used)
        WA = A[rows] * weight[rows, None]
        G = np.linalg.solve(A[rows].T @ WA, WA.T)
        total += float(np.sum(G[:3] ** 2 * variance[rows]))
        count += 1
    return float(np.sqrt(total / max(count, 1)))
