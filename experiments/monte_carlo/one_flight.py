"""One simulated flight through the filter, scored against its truth: what Monte Carlo repeats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.layout import StateLayout
from sinan.estimator.filter.relinearise import run_relinearised
from sinan.sensors.arrays import FloatArray
from sinan.sensors.recording import LARGEST_READING, POSITION, VELOCITY, Recording, SensorSpec, Stream
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import BIAS_COLUMNS, simulate

CHECKPOINTS = 10  # instants, evenly over the flight, at which errors are taken; the last is the end
WHISPER = 1e-6  # share of the declared noise with which the bound is linearised: Jacobians move by as little
QUATERNION = ("qw", "qx", "qy", "qz")


@dataclass(frozen=True)
class Score:
    """The score of one flight.

    Attributes
    ----------
    run : its number
    t : (c,) checkpoints [s]
    blocks : the state blocks that are estimated, in order
    error, sigma : (c, n) true minus estimate, and the filter's own 1-sigma
    nees : by block and "overall", (c,) normalised squares (not divided by dof)
    nis : by sensor, (sum over the readings that were used, sum of their dof)
    rejected : by sensor, readings that the gate refused
    """

    run: int
    t: list[float]
    blocks: list[str]
    error: list[list[float]]
    sigma: list[list[float]]
    nees: dict[str, list[float]]
    nis: dict[str, list[float]]
    rejected: dict[str, int]

    def as_table(self) -> dict[str, Any]:
        """As plain lists and numbers, which JSON gives back bit by bit."""
        return asdict(self)


def flight_from(table: Mapping[str, Any]) -> Score:
    """The score of `as_table`, checked: what a file holds may be anybody's.

    Raises
    ------
    ValueError : names the key, and says what is wrong with it
    """
    for entry in fields(Score):
        if entry.name not in table:
            raise ValueError(f"no key {entry.name}")
    if further := set(table) - {entry.name for entry in fields(Score)}:
        raise ValueError(f"unknown key {min(further)}")
    flight = Score(**table)
    if not isinstance(flight.run, int) or isinstance(flight.run, bool):
        raise ValueError("key run is no whole number")
    checkpoints = _checked("t", flight.t, (None,))[0]
    states = _checked("error", flight.error, (checkpoints, None))[1]
    _checked("sigma", flight.sigma, (checkpoints, states))
    if not isinstance(flight.blocks, list) or not all(isinstance(name, str) for name in flight.blocks):
        raise ValueError("key blocks is no list of names")
    for key, each, shape in (("nees", flight.nees, (checkpoints,)), ("nis", flight.nis, (2,)),
                             ("rejected", flight.rejected, ())):  # fmt: skip
        if not isinstance(each, dict):
            raise ValueError(f"key {key} is no table")
        for name, value in each.items():
            _checked(f"{key}.{name}", value, shape)
    if missing := {"overall", *flight.blocks} - set(flight.nees):
        raise ValueError(f"no key nees.{min(missing)}")
    return flight


def _checked(key: str, value: object, shape: tuple[int | None, ...]) -> tuple[int, ...]:
    """The shape of a list of finite numbers, which fits the one expected; None: any length."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"key {key} has rows of different length") from None
    if array.dtype.kind not in "fi" or len(array.shape) != len(shape):
        raise ValueError(f"key {key} is no list of numbers" if shape else f"key {key} is no number")
    within = np.abs(array) <= LARGEST_READING
    if not np.all(within):
        raise ValueError(f"key {key} holds {array[~within][0]}")
    if any(wanted not in (None, found) for wanted, found in zip(shape, array.shape, strict=True)):
        raise ValueError(f"key {key} has {' x '.join(map(str, array.shape))} numbers")
    return array.shape


def rng_of(seed: int, run: int) -> np.random.Generator:
    """The random numbers of one run; they depend on nothing but the seed and its number."""
    return np.random.default_rng(np.random.SeedSequence([seed, run]))


def estimated_blocks(model: FlightModel) -> list[str]:
    """The blocks whose errors mean something: an attitude estimator has no position and velocity."""
    hidden = () if model.translation else ("position", "velocity")
    return [name for name in model.layout.names if name not in hidden]


def fly(scenario: Scenario, seed: int, run: int, relinearise: bool = False) -> Score:
    """Simulate a flight, run the filter, score it at the checkpoints; `relinearise` as of `FlightModel`."""
    recording, truth = simulate(scenario.replace(truth_rate=0.0), rng_of(seed, run))
    return scored(inputs_of(Flight.of(recording, relinearise=relinearise)), truth, run)


def inputs_of(flight: Flight, first: tuple[FloatArray, FloatArray] | None = None) -> RunInputs:
    """What the filter's last pass runs on."""
    if not flight.model.relinearise:
        return prepare(flight, first=first)
    inputs = run_relinearised(flight, engine="numba", stride=0, first=first).run
    assert isinstance(inputs, RunInputs)
    return inputs


def scored(inputs: RunInputs, truth: Stream, run: int = 0) -> Score:
    """Run the filter, score it at the checkpoints."""
    model = inputs.model
    states, journal_nis, rejected = filtered(inputs)
    layout, blocks = model.layout, estimated_blocks(model)
    rows = np.concatenate([np.arange(layout.n)[layout.slice(name)] for name in blocks])
    errors, sigmas, nees = [], [], {name: [] for name in ("overall", *blocks)}  # type: ignore[var-annotated]
    for t, x, P in states:
        error = layout.difference(true_state(layout, truth, t), x)
        errors.append(error[rows].tolist())
        sigmas.append(np.sqrt(np.diag(P))[rows].tolist())
        nees["overall"].append(normalised_square(error[rows], P[np.ix_(rows, rows)]))
        for name in blocks:
            s = layout.slice(name)
            nees[name].append(normalised_square(error[s], P[s, s]))
    return Score(run, [t for t, _, _ in states], blocks, errors, sigmas, nees, journal_nis, rejected)


def filtered(
    inputs: RunInputs,
) -> tuple[list[tuple[float, FloatArray, FloatArray]], dict[str, list[float]], dict[str, int]]:
    """Run the compiled engine from checkpoint to checkpoint: (t, x, P) at each, NIS and refused readings by sensor."""
    from sinan.estimator.filter.compiled import CompiledRun
    from sinan.estimator.filter.engine import journal_of
    from sinan.estimator.filter.inputs import outputs_for

    outputs = outputs_for(inputs, stride=0)
    engine = CompiledRun(inputs, outputs)
    ends = np.unique(np.round(np.linspace(0, len(inputs.imu) - 1, CHECKPOINTS + 1)).astype(np.int64))
    states = []
    for first, last in pairwise(ends.tolist()):
        engine.chunk(first, last)
        states.append((float(engine.clock[0]), *engine.result()))
    journal = journal_of(inputs, outputs, *engine.result())
    nis = {}
    for name in journal.sensors:
        stream = journal.stream(name)
        used = stream.accepted
        nis[name] = [float(np.sum(stream.nis[used])), float(stream.dof * np.sum(used))]
    return states, nis, {name: int(count) for name, count in journal.rejected().items()}


def true_state(layout: StateLayout, truth: Stream, t: float) -> FloatArray:
    """(n + 1,) the nominal state at t, from the truth's nearest row (truth is at every IMU sample)."""
    row = int(np.argmin(np.abs(truth.t - t)))
    parts = [truth.array(POSITION)[row], truth.array(VELOCITY)[row], truth.array(QUATERNION)[row]]
    for name in layout.names[3:]:
        columns = BIAS_COLUMNS[name.removeprefix("b_")]
        parts.append(truth.array(columns)[row])
    return np.concatenate(parts)


def normalised_square(error: FloatArray, P: FloatArray) -> float:
    """e' P^-1 e."""
    return float(error @ np.linalg.solve(P, error))


def cramer_rao(scenario: Scenario, seed: int) -> FloatArray:
    """(c, n) square root of the diagonal of the posterior Cramer-Rao bound at the checkpoints.

    The bound is the covariance recursion with Jacobians at the true states: the same filter over a flight whose
    instruments, biases and first state err by next to nothing while the declared noise stays, so that it linearises at
    the truth.

    Source: P. Tichavsky, C. H. Muravchik, A. Nehorai, IEEE Trans. Signal Processing 46(5), 1998, for process noise that
    does not depend on the state; the trajectory is given.
    """
    recording, truth = noiseless(scenario, rng_of(seed, 0))
    flight = Flight.of(recording)
    inputs, model = prepare(flight), flight.model
    layout = model.layout
    first = true_state(layout, truth, float(inputs.imu.t[0]))
    states, _, _ = filtered(prepare(flight, first=(first, inputs.P)))
    rows = np.concatenate([np.arange(layout.n)[layout.slice(name)] for name in estimated_blocks(model)])
    return np.array([np.sqrt(np.diag(P))[rows] for _, _, P in states])


def noiseless(scenario: Scenario, rng: np.random.Generator) -> tuple[Recording, Stream]:
    """The scenario flown with instruments that err by next to nothing, declaring the noise that they usually have.

    Not by nothing at all: a sensor at rest would repeat itself to the last bit and be taken for a frozen one.
    """
    whisper = {name: replace(entry, spec=_scaled(entry.spec, WHISPER)) for name, entry in scenario.sensors.items()}
    still = replace(scenario.vibration, amplitude=(0.0, 0.0, 0.0))
    recording, truth = simulate(scenario.replace(sensors=whisper, vibration=still, truth_rate=0.0), rng)
    declared = {
        name: replace(entry.spec, base_position=recording.spec(name).base_position)
        for name, entry in scenario.sensors.items()
    }
    return recording.replace(sensors=declared), truth


def _scaled(spec: SensorSpec, factor: float) -> SensorSpec:
    """The same kinds of noise and bias, `factor` times as large."""
    sizes = ("noise_density", "noise_std", "velocity_noise_std", "bias_walk", "bias_std")
    found = {key: getattr(spec, key) for key in sizes}
    return replace(spec, **{key: value * factor for key, value in found.items() if value is not None})
