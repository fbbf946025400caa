"""How the innovations answer to each effect's beta: one further pass for all candidates together.

An effect on the IMU reads u_meas = u + G beta, one on another sensor z = h(x) + G beta. With V the sensitivity
of the state error (true minus estimate), Friedland's recursion (IEEE Trans. Automatic Control 14(4), 1969)

    step:     V <- Phi V - B G            B = d x / d u of the step
    reading:  S_beta = H V + G,  V <- J (V - K S_beta)

gives E[nu] = S_beta beta. Information and score are taken over all candidates together, block of time by block of time:

    Lambda = sum S_beta' S^-1 S_beta,   b = sum S_beta' S^-1 nu.

A filter whose state is augmented by beta has the same answer: with a prior P_beta,
beta = (Lambda + P_beta^-1)^-1 b and the state x + V beta.

Regressors are those of the catalogue, taken along the reference motion (that of the pass before, smoothed): on the IMU
along what of it is signal, on another sensor along what of it that sensor follows, whatever else is asked. Where a beta
is not zero, they are the slope of the exact form there; that of a lateness is of all that is in its stream's model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from sinan.estimator.evidence.score import BLOCKS
from sinan.estimator.filter.compiled import TILE, Columns, CompiledRun
from sinan.estimator.filter.effect_forms import (
    Along,
    Terms,
    at_its_instant,
    declared_terms,
    effects_on,
    is_lateness,
    is_of_own_reading,
    low_passed_in,
    over_time,
    reference_motion,
    run_with_effects,
    with_covariates,
)
from sinan.estimator.filter.engine import journal_of, run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import DRIVERS, FlightModel
from sinan.estimator.filter.imu import ImuTable, imu_table
from sinan.estimator.filter.inputs import RunInputs, outputs_for, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import CAPACITY
from sinan.sensors.arrays import FloatArray, IntArray, zero_unless_finite
from sinan.sensors.effects import Effect, effect
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.rotation import cross

#: Below this determinant of d e(f) / df, near one of sound instruments, one counts as showing nothing: bound of work
#: (`bounds_of_work brief`).
_BLIND = 1e-3
#: d e(f) / df is one, but for the rounding of its differences: bound of work (`bounds_of_work flight`).
_AS_ONE = 1e-9


@dataclass(frozen=True)
class Sensitivity:
    """Information and score of all candidates, by block of time.

    Attributes
    ----------
    effects : the candidates; `slices` : their columns, p in all
    edges : (blocks + 1,) s
    information : (blocks, p, p); score : (blocks, p); none of 0 blocks
    V : (n, p) sensitivity of the state error at the end
    rows, white, event : (r, p) L^-1 S_beta, (r,) L^-1 nu and (r,) place in the journal of each component that was used,
        every `keep_rows`-th reading; empty unless asked for
    """

    effects: tuple[Effect, ...]
    slices: tuple[slice, ...]
    edges: FloatArray
    information: FloatArray
    score: FloatArray
    V: FloatArray
    rows: FloatArray
    white: FloatArray
    event: IntArray

    @property
    def total(self) -> tuple[FloatArray, FloatArray]:
        """(p, p) information and (p,) score over all blocks."""
        return self.information.sum(axis=0), self.score.sum(axis=0)

    def of(self, name: str) -> slice:
        """Columns of a candidate by name; the first of that name."""
        return next(s for e, s in zip(self.effects, self.slices, strict=True) if e.name == name)


def sensitivity_pass(
    flight: Flight,
    candidates: Sequence[Effect | str],
    betas: Mapping[Any, FloatArray] | None = None,
    *,
    motion: Motion | None = None,
    blocks: int = BLOCKS,
    keep_rows: int = 0,
    stride: int = 1,
    table: ImuTable | None = None,
) -> tuple[Journal, Sensitivity]:
    """The filter and, in the same pass, the sensitivity of its innovations to every candidate.

    Parameters
    ----------
    flight : readings and model
    candidates : effects, or their names
    betas : effects that are in the model, with their parameters; the sensitivities are those there
    motion : reference at the samples of the IMU table, from `reference_motion`; default: found by `run_filter`'s passes
    blocks : of equal length over the recording; 0: neither information nor score, which the rows have in them
    keep_rows : keep the whitened rows of every so many readings; 0: none
    stride : IMU samples between two logged states; 0: none
    table : of the flight's IMU, where it is known

    Raises
    ------
    InputError : a candidate whose stream or covariate the recording lacks
    """
    terms = Terms.of(betas or {}).joined(declared_terms(flight.recording))
    table = imu_table(flight) if table is None else table
    if motion is None:
        if terms or flight.model.relinearise:
            settled = run_with_effects(flight, terms, engine="numba", stride=0)
        else:
            settled = run(prepare(flight, imu=table), "numba", 0)
        motion = reference_motion(settled, terms, table)
    return pass_along(Along(flight, terms, motion, table), candidates, blocks, keep_rows, stride)


def pass_along(
    along: Along, candidates: Sequence[Effect | str], blocks: int, keep_rows: int, stride: int
) -> tuple[Journal, Sensitivity]:
    """The same with the effects, and along the motion, of `along`."""
    effects = tuple(effect(c) if isinstance(c, str) else c for c in candidates)
    columns, order, slices = pack(along, effects)
    return accumulate(along.inputs, effects, slices, columns, order, blocks, keep_rows, stride)


def accumulate(
    inputs: RunInputs, effects: tuple[Effect, ...], slices: tuple[slice, ...], columns: Columns, order: IntArray,
    blocks: int, keep_rows: int, stride: int,
) -> tuple[Journal, Sensitivity]:  # fmt: skip
    """Run block by block, 0 for one without information; `order` (p,) is the packed column of each of the answer's."""
    from sinan.estimator.filter.engine_numba import Whitened

    outputs = outputs_for(inputs, stride)
    engine = CompiledRun(inputs, outputs, columns)
    t, last = inputs.imu.t, len(inputs.imu) - 1
    inner = np.searchsorted(t, np.linspace(t[0], t[-1], max(blocks, 1) + 1)[1:-1])
    firsts, chunks = {}, list[tuple[int, int]]()
    for first, end, x, P in inputs.stretches:
        firsts[first] = x, P
        chunks += pairwise(np.unique([first, *inner[(inner > first) & (inner < end)], end]).tolist())
    p = len(order)
    summed = len(chunks) if blocks else 0
    information, score, kept = np.zeros((summed, p, p)), np.zeros((summed, p)), []
    row = inputs.events.row
    spans = [inputs.events_of(i0, i1) for i0, i1 in chunks]
    longest = max((int(row[k1] - row[k0]) for k0, k1 in spans), default=0)
    W, white = np.zeros((longest + 1, columns.tiles * TILE)), np.zeros(longest + 1)
    packed = int(order.max(initial=-1)) + 1
    event = np.zeros(longest + 1, dtype=np.int64)
    for block, (i0, i1) in enumerate(chunks):
        if i0 in firsts:
            engine.start(i0, *firsts[i0])
        count = engine.chunk(i0, i1, whitened=Whitened(W, white, event))
        part = W[:count, :packed]
        if blocks:
            information[block] = (part.T @ part).take(order, axis=0).take(order, axis=1)
            score[block] = (white[:count] @ part)[order]
        if keep_rows:
            chosen = event[:count] % keep_rows == 0 if keep_rows > 1 else slice(None)
            kept.append((part[chosen][:, order], white[:count][chosen].copy(), event[:count][chosen].copy()))
    x, P = engine.result()
    n = inputs.model.layout.n
    V = engine.V.reshape(-1, CAPACITY, TILE).transpose(1, 0, 2).reshape(CAPACITY, -1)[:n, order]
    rows = (
        [np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in zip(*kept, strict=True)]
        if kept
        else [np.empty((0, p)), np.empty(0), np.empty(0, int)]
    )
    edges = t[[*(i0 for i0, _ in chunks), last]]
    found = Sensitivity(effects, slices, edges, information, score, V, rows[0], rows[1], rows[2])
    return journal_of(inputs, outputs, x, P), found


def pack(along: Along, effects: tuple[Effect, ...]) -> tuple[Columns, IntArray, tuple[slice, ...]]:
    """Regressors of all candidates as the kernels take them.

    Returns
    -------
    columns : accelerometer's effects first, then the gyroscope's, then sensor after sensor; a gap before
        the gyroscope's where they fill a tile less so
    order : (p,) packed column of every column of the candidates in their own order
    slices : columns of each candidate
    """
    sensors = along.inputs.events.sensors
    unknown = [entry.name for entry in effects if entry.stream not in (*DRIVERS, *sensors)]
    if unknown:
        found = f"no stream for {', '.join(unknown)}"
        raise InputError(along.recording.where, found, "candidates of streams that are there")
    ends = np.cumsum([entry.size for entry in effects], dtype=np.int64).tolist()
    slices = tuple(slice(end - entry.size, end) for end, entry in zip(ends, effects, strict=True))
    order = np.zeros(ends[-1] if ends else 0, dtype=np.int64)
    of, place = dict[str, _Packed](), 0
    for stream in (*DRIVERS, *sensors):
        mine = [i for i, entry in enumerate(effects) if entry.stream == stream]
        width = sum(effects[i].size for i in mine)
        if stream in DRIVERS:
            place = _start(place, width)
        of[stream] = _Packed(tuple(effects[i] for i in mine), place, width)
        for i in mine:
            order[slices[i]] = place + np.arange(effects[i].size)
            place += effects[i].size
    accel, gyro = (of[stream] for stream in DRIVERS)
    rates = driver_regressors(along, "gyro", gyro.effects) if gyro.width else np.zeros((len(along.table), 3, 0))
    if "zero_rate" in sensors:  # reads the gyroscope, and what its effects add
        of["zero_rate"] = gyro
    Gz, at = _of_readings(along, of, rates)
    columns = Columns(
        -(-place // TILE), accel.tiles, gyro.first_tile, gyro.tiles,
        _of_samples(accel, driver_regressors(along, "accel", accel.effects) if accel.width else None),
        _of_samples(gyro, rates if gyro.width else None), Gz, at,
        np.array([of[name].first for name in sensors], dtype=np.int64),
        np.array([of[name].width for name in sensors], dtype=np.int64),
    )  # fmt: skip
    return columns, order, slices


@dataclass(frozen=True)
class _Packed:
    """The effects of one stream side by side: their first column, and how many they are."""

    effects: tuple[Effect, ...]
    first: int
    width: int

    @property
    def first_tile(self) -> int:
        return self.first // TILE

    @property
    def tiles(self) -> int:
        """How many tiles have some of the columns."""
        return -(-(self.first + self.width) // TILE) - self.first_tile if self.width else 0


def _of_samples(packed: _Packed, regressors: FloatArray | None) -> FloatArray:
    """(N tiles, 48) regressors of a driver at the samples of the IMU, three rows of 16 columns; of none (1, 48)."""
    if regressors is None:
        return np.zeros((1, 3 * TILE))
    G = np.zeros((len(regressors), 3, packed.tiles * TILE))
    at = packed.first - packed.first_tile * TILE
    G[:, :, at : at + packed.width] = regressors
    return G.reshape(len(G), 3, -1, TILE).transpose(0, 2, 1, 3).reshape(-1, 3 * TILE)


def _of_readings(along: Along, of: Mapping[str, _Packed], rates: FloatArray) -> tuple[FloatArray, IntArray]:
    """Flat regressors of the readings of all sensors, and (K,) where those of each reading begin.

    Parameters
    ----------
    rates : (N, 3, p) of the gyroscope's effects at the samples of the IMU
    """
    events = along.inputs.events
    base, parts, start = 0, [], np.zeros(max(len(events), 1), dtype=np.int64)
    for s, name in enumerate(events.sensors):
        if not of[name].effects:
            continue
        G = along.at_zero_rate(rates) if name == "zero_rate" else sensor_regressors(along, name, of[name].effects)
        of_sensor = events.sensor == s
        start[of_sensor] = base + events.index[of_sensor] * (G.shape[1] * G.shape[2])
        parts.append(G.ravel())
        base += G.size
    return np.concatenate(parts) if parts else np.zeros(1), start


def _start(place: int, width: int) -> int:
    """The next tile's first column where `width` columns from there end in the same tile as from `place`."""
    fresh = -(-place // TILE) * TILE
    return fresh if width and -(-(fresh + width) // TILE) == -(-(place + width) // TILE) else place


def _missing(recording: Recording, entry: Effect, motion: Motion) -> None:
    lacking = entry.missing(motion)
    if lacking:
        raise InputError(recording.where, f"no {', '.join(lacking)} for {entry.name}", "candidates whose needs are met")


def driver_regressors(along: Along, stream: str, effects: Sequence[Effect]) -> FloatArray:
    """(N, 3, p) d u / d beta of accelerometer or gyroscope effects at the samples of the IMU table.

    Along what of force and rate is signal: see `estimator.filter.wiener`.

    Where effects are in the model already, the sample that the filter integrates is f = e^-1(u - b), so that
    df / dbeta = -(de / df)^-1 de / dbeta: the regressor is divided by what the effects do to a change of f.
    """
    motion = with_covariates(along.recording, stream, along.of_signal)
    plain = motion.f_b if stream == "accel" else motion.w_ib_b
    parts = []
    for entry in effects:
        _missing(along.recording, entry, motion)
        beta = along.terms.beta(entry)
        G = entry.slope(plain, beta, motion) if np.any(beta) else entry.rows(motion, 3)
        parts.append(G if is_of_own_reading(entry) else low_passed_in(along.flight, along.table, G, stream))
    G = np.concatenate(parts, axis=2)
    name, step = ("f_b", 1e-3) if stream == "accel" else ("w_ib_b", 1e-5)
    present = [(e, b) for e, b in along.terms.of_stream(stream) if is_of_own_reading(e)]
    if not present:
        return G
    response = np.tile(np.eye(3), (len(motion), 1, 1))
    for axis in range(3):
        d = np.zeros(3)
        d[axis] = step
        for sign in (1.0, -1.0):
            changed = _with(motion, name, plain + sign * d)
            for entry, beta in present:
                response[:, :, axis] += entry.change(plain + sign * d, beta, changed) * (sign / (2.0 * step))
    if np.max(np.abs(response - np.eye(3))) < _AS_ONE:
        return G
    return np.asarray(_inverse(response) @ G, dtype=np.float64)


def _inverse(response: FloatArray) -> FloatArray:
    """(N, 3, 3) inverses by cofactors; one where an instrument shows nothing, which only a trial gone astray has."""
    first, second, third = np.moveaxis(response, -1, 0)
    adjugate = np.stack([cross(second, third), cross(third, first), cross(first, second)], axis=1)
    determinant = np.einsum("ni,ni->n", first, adjugate[:, 0])
    blind = np.abs(determinant) < _BLIND
    adjugate[blind], determinant[blind] = np.eye(3), 1.0
    return np.asarray(adjugate / determinant[:, None, None])


def _with(motion: Motion, name: str, value: FloatArray) -> Motion:
    return replace(motion, **{name: value})  # type: ignore[arg-type]


def sensor_regressors(along: Along, name: str, effects: Sequence[Effect]) -> FloatArray:
    """(k, m, p) d z / d beta of effects on one sensor at its readings; none where the motion predicts no reading."""
    along = along.seen_by(name)
    at, sensor = along.at(name), along.model.sensors[name]
    plain = sensor.predict(at)
    parts = []
    for entry in effects:
        _missing(along.recording, entry, at)
        beta = along.terms.beta(entry)
        if is_lateness(entry):
            G = at_its_instant(sensor, entry.rows(at, sensor.size))
            parts.append(G + _slope_of_the_others(along, name, entry, beta))
        elif entry.exact is None or not np.any(beta):
            parts.append(at_its_instant(sensor, entry.rows(at, sensor.size)))
        elif entry.other_instants:
            parts.append(entry.differences(partial(over_time, along, name, entry), beta))
        else:
            parts.append(entry.slope(plain, beta, at, sensor))
    return zero_unless_finite(np.concatenate(parts, axis=2))


def _slope_of_the_others(along: Along, name: str, entry: Effect, beta: FloatArray) -> FloatArray | float:
    """(k, m, 1) what a lateness does to what the other effects of its stream add, which is of the same instant."""
    # what needs nothing of the motion has no slope, but that of a step is infinite at its edge
    others = tuple((e, b) for e, b in along.terms.of_stream(name) if e.needs)
    if not others:
        return 0.0

    def added(late: FloatArray) -> FloatArray:
        return effects_on(replace(along, terms=Terms(((entry, late), *others))), name)

    return entry.differences(added, beta)


def candidate_streams(model: FlightModel) -> tuple[str, ...]:
    """The streams whose effects can be candidates in a run: the drivers and the sensors that update."""
    return (*DRIVERS, *model.sensors)
