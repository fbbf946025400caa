"""The filter's border: orders events in time, runs an engine over them, journals; no algebra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from estimator.alignment import first_state
from estimator.events import ACCEPTED, FORM_ONLY, GATED, OUTSIDE, Events, collect, with_variances
from estimator.flight_model import FlightModel
from estimator.imu import ImuTable, imu_table
from estimator.journal import Journal
from estimator.layout import CAPACITY
from sensors.arrays import FloatArray, IntArray
from sensors.errors import InputError
from sensors.recording import Recording
from sensors.window import between

Engine = Literal["auto", "numba", "filterpy"]
#: What a sensor is to the kernels: their code of its equations.
KIND = {"gps": 0, "base": 1, "mag": 2, "baro": 3, "sonar": 4, "laser": 4, "level": 5, "place": 0, "speed": 6}
KIND["camera"] = KIND["base"]  # which predicts nothing: all of a camera's reading is a form
#: The state block that a sensor's own equations add to its reading.
BIAS_BLOCK = {"gps": "b_gps", "base": "b_gps", "level": "b_accel"}
#: One IMU sample and its share of readings cost this long in the readable engine, compiling the other this long [s].
READABLE_STEP, COMPILATION = 150e-6, 10.0
#: Share of a sensor's readings that a gate may refuse before it is the gate that is doubted.
LOCKED_OUT = 0.25


@dataclass(frozen=True)
class RunInputs:
    """What an engine runs on, and what it starts from.

    Attributes
    ----------
    recording, model, imu, events : see there
    x, P : (n + 1,), (n, n) the first state
    later : the same of each stretch after the first
    """

    recording: Recording
    model: FlightModel
    imu: ImuTable
    events: Events
    x: FloatArray
    P: FloatArray
    later: tuple[tuple[FloatArray, FloatArray], ...] = ()

    @property
    def stretches(self) -> list[tuple[int, int, FloatArray, FloatArray]]:
        """First and last sample of each stretch, and what it starts from."""
        firsts = ((self.x, self.P), *self.later)
        return [(i0, i1, x, P) for (i0, i1), (x, P) in zip(self.imu.stretches, firsts, strict=True)]

    def events_of(self, i0: int, i1: int) -> tuple[int, int]:
        """Readings with t_i0 <= t < t_i1, and where a stretch ends with i1 all before the next; those outside of any
        ride along.
        """
        t, imu = self.events.t, self.imu
        k0 = int(np.searchsorted(t, imu.t[i0], side="left")) if i0 > 0 else 0
        if i1 == len(imu) - 1:
            return k0, len(t)
        return k0, int(np.searchsorted(t, imu.t[i1 + 1 if imu.last_of(i1) else i1], side="left"))


@dataclass
class RunOutputs:
    """What an engine fills in: see `Journal` for the meaning and `engine_numba.run_chunk` for the places."""

    nu: FloatArray
    white: FloatArray
    S_row: IntArray
    S: FloatArray
    nis: FloatArray
    loglik: FloatArray
    weight: FloatArray
    status: IntArray
    x_event: FloatArray
    var_event: FloatArray
    x_imu: FloatArray
    var_imu: FloatArray
    stride: int
    extra: dict[str, Any] = field(default_factory=dict)


def prepare(
    recording: Recording,
    model: FlightModel,
    *,
    imu: ImuTable | None = None,
    events: Events | None = None,
    first: tuple[FloatArray, FloatArray] | None = None,
    aligned: Recording | None = None,
) -> RunInputs:
    """Everything an engine needs, from a recording and its model.

    Parameters
    ----------
    imu, events, first : where they are known
    aligned : the recording from whose readings each stretch is aligned; default: itself
    """
    imu = imu_table(recording, model) if imu is None else imu
    events = collect(recording, model) if events is None else with_variances(events, recording, model)
    aligned = recording if aligned is None else aligned
    x, P = first_state(aligned, model) if first is None else first
    if len(imu.starts) == 1:
        return RunInputs(recording, model, imu, events, x, P)
    status, later = events.status.copy(), []
    for (_, end), (i0, i1) in pairwise(imu.stretches):
        status[(events.t > imu.t[end]) & (events.t < imu.t[i0])] = OUTSIDE
        later.append(first_state(between(aligned, float(imu.t[i0]), float(np.nextafter(imu.t[i1], np.inf))), model))
    return RunInputs(recording, model, imu, replace(events, status=status), x, P, tuple(later))


def outputs_for(inputs: RunInputs, stride: int = 1) -> RunOutputs:
    """Empty arrays for a run; `stride` IMU samples between logged states, 0: none."""
    events, K = inputs.events, len(inputs.events)
    sizes = np.diff(events.row)
    S_row = np.concatenate([[0], np.cumsum(sizes**2)]).astype(np.int64)
    rows, logged = int(events.row[-1]), 1 + (len(inputs.imu) - 1) // stride if stride else 1
    return RunOutputs(
        nu=np.full(rows, np.nan), white=np.full(rows, np.nan), S_row=S_row, S=np.full(S_row[-1], np.nan),
        nis=np.full(K, np.nan), loglik=np.full(K, np.nan), weight=np.ones(K), status=events.status.copy(),
        x_event=np.zeros((K, CAPACITY + 1)), var_event=np.zeros((K, CAPACITY)),
        x_imu=np.zeros((logged, CAPACITY + 1)), var_imu=np.zeros((logged, CAPACITY)), stride=stride,
    )  # fmt: skip


def choose_engine(engine: Engine, inputs: RunInputs) -> Literal["numba", "filterpy"]:
    """`auto`: the compiled engine where it is compiled already or pays for its compilation, else the readable one."""
    if engine != "auto":
        return engine
    try:
        from estimator.compiled import is_compiled
    except ImportError:
        return "filterpy"
    return "numba" if is_compiled() or READABLE_STEP * len(inputs.imu) > COMPILATION else "filterpy"


def run(inputs: RunInputs, engine: Engine = "auto", stride: int = 1) -> Journal:
    """One pass of the filter over prepared inputs."""
    outputs = outputs_for(inputs, stride)
    if choose_engine(engine, inputs) == "numba":
        from estimator.compiled import CompiledRun

        x, P = CompiledRun(inputs, outputs).all()
    else:
        from estimator.engine_filterpy import run_readable

        x, P = run_readable(inputs, outputs)
    return journal_of(inputs, outputs, x, P)


def journal_of(inputs: RunInputs, outputs: RunOutputs, x: FloatArray, P: FloatArray) -> Journal:
    """The journal of a finished run."""
    model, events, n = inputs.model, inputs.events, inputs.model.layout.n
    step = outputs.stride or len(inputs.imu)
    return Journal(
        model=model, sensors=events.sensors, t=events.t, sensor=events.sensor, index=events.index, row=events.row,
        nu=outputs.nu, white=outputs.white, S_row=outputs.S_row, S=outputs.S, nis=outputs.nis,
        loglik=outputs.loglik, weight=outputs.weight, status=outputs.status,
        x=outputs.x_event[:, : n + 1], var=outputs.var_event[:, :n],
        imu_t=inputs.imu.t[::step], imu_x=outputs.x_imu[:, : n + 1], imu_var=outputs.var_imu[:, :n],
        x_end=x, P_end=P, t_start=float(inputs.imu.t[0]), t_end=float(inputs.imu.t[-1]),
        notes=(*model.notes, *inputs.imu.notes, *events.notes), run=inputs,
    )  # fmt: skip


def raise_for(status: int, event: int, inputs: RunInputs) -> None:
    """Turn a kernel's status into the error that names time and sensor."""
    if status == 0:
        return
    events = inputs.events
    last = min(event, len(events) - 1)
    at = f"t = {events.t[last]:.3f} s, sensor {events.sensors[events.sensor[last]]}" if last >= 0 else "the end"
    found = "the state is not finite" if status == 1 else "the covariance of the innovation is not positive"
    raise InputError(inputs.recording.where, found, "noise levels and a first state that fit the readings", at)


def run_filter(
    recording: Recording,
    model: FlightModel,
    betas: Mapping[Any, FloatArray] | None = None,
    *,
    engine: Engine = "auto",
    stride: int = 1,
    passes: int = 6,
    tolerance: float = 1e-3,
) -> Journal:
    """Run the filter over a recording, with effects in the model where `betas` (or the recording) names them.

    Parameters
    ----------
    recording : a flight
    model : from `flight_model`
    betas : by effect (a name of the catalogue, or an `Effect`), its parameters; what the recording declares is added
    engine : "numba", "filterpy", or "auto": the compiled one where nobody has to wait for the compiler
    stride : IMU samples between two logged states; 0: none
    passes, tolerance : effects are evaluated along the smoothed motion of the pass before, until no whitened innovation
        moves by more than `tolerance` sigma

    Returns
    -------
    Journal

    Raises
    ------
    InputError : a state that is not finite, with time and sensor; effects that lack a covariate
    """
    from estimator.effect_forms import Terms, declared_terms, run_with_effects
    from estimator.relinearise import run_relinearised

    terms = Terms.of(betas or {}).joined(declared_terms(recording))

    def once(model: FlightModel) -> Journal:
        if model.relinearise:
            return run_relinearised(recording, model, terms, engine=engine, stride=stride)
        if not terms and not set(FORM_ONLY) & set(model.sensors):
            return run(prepare(recording, model), engine, stride)
        return run_with_effects(
            recording, model, terms, engine=engine, stride=stride, passes=passes, tolerance=tolerance
        )

    return opened(once, model)


def opened(once: Callable[[FlightModel], Journal], model: FlightModel) -> Journal:
    """A run; where the gate refuses a sensor for good, another one that weighs what the gate would refuse.

    Readings that are wrong now and then are refused and done with. Readings that are refused for good may be those of
    a sensor that is wrong, or right ones that a lost filter no longer believes, and it would stay lost. A weight of
    threshold / NIS serves both: a hundred sigma off hardly move the state, ten sigma lead it back.
    """
    journal = once(model)
    shares = refused_shares(journal)
    locked = {name: share for name, share in shares.items() if share > LOCKED_OUT}
    if not locked or model.gate_level is None:
        return journal
    said = [f"{name}: the gate refused {100 * share:.0f} % of the readings" for name, share in locked.items()]
    notes = (*model.notes, f"{', '.join(said)}; doubtful readings were given less weight instead")
    return once(model.replace(gate_level=None, robust_level=model.robust_level or model.gate_level, notes=notes))


def refused_shares(journal: Journal) -> dict[str, float]:
    """Share of each sensor's judged readings that the gate refused."""
    judged = {name: journal.stream(name).status for name in journal.sensors}
    counts = {name: (np.sum(s == GATED), np.sum((s == GATED) | (s == ACCEPTED))) for name, s in judged.items()}
    return {name: float(refused / total) if total else 0.0 for name, (refused, total) in counts.items()}


def used(journal: Journal, sensor: str) -> IntArray:
    """Rows of a sensor's stream that the filter used."""
    stream = journal.stream(sensor)
    return stream.index[stream.status == ACCEPTED]
