"""Which engine runs, one pass of it, and the journal of that pass."""

from __future__ import annotations

from typing import Literal

from sinan.estimator.filter.inputs import RunInputs, RunOutputs, outputs_for
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import FloatArray

Engine = Literal["auto", "numba", "filterpy"]
#: One IMU sample and its share of readings cost this long in the readable engine, compiling the other this long [s]
#: (measured: docs/notes/speed.md); both give the same (`test_engines`).
READABLE_STEP, COMPILATION = 500e-6, 10.0


def choose_engine(engine: Engine, inputs: RunInputs) -> Literal["numba", "filterpy"]:
    """`auto`: the compiled engine where it is compiled already or pays for its compilation, else the readable one."""
    if engine != "auto":
        return engine
    try:
        from sinan.estimator.filter.compiled import is_compiled
    except ImportError:
        return "filterpy"
    return "numba" if is_compiled() or READABLE_STEP * len(inputs.imu) > COMPILATION else "filterpy"


def run(inputs: RunInputs, engine: Engine = "auto", stride: int = 1) -> Journal:
    """One pass of the filter over prepared inputs."""
    outputs = outputs_for(inputs, stride)
    if choose_engine(engine, inputs) == "numba":
        from sinan.estimator.filter.compiled import CompiledRun

        x, P = CompiledRun(inputs, outputs).all()
    else:
        from sinan.estimator.filter.engine_filterpy import run_readable

        x, P = run_readable(inputs, outputs)
    return journal_of(inputs, outputs, x, P)


def journal_of(inputs: RunInputs, outputs: RunOutputs, x: FloatArray, P: FloatArray) -> Journal:
    """The journal of a finished run."""
    model, events, n = inputs.model, inputs.events, inputs.model.layout.n
    step = outputs.stride or len(inputs.imu)
    return Journal(
        model=model, sensors=events.sensors, t=events.t, sensor=events.sensor, index=events.index, row=events.row,
        freedom=events.freedom, nu=outputs.nu, white=outputs.white, S_row=outputs.S_row, S=outputs.S,
        nis=outputs.nis, loglik=outputs.loglik, weight=outputs.weight, status=outputs.status,
        x=outputs.x_event[:, : n + 1], var=outputs.var_event[:, :n],
        imu_t=inputs.imu.t[::step], imu_x=outputs.x_imu[:, : n + 1], imu_var=outputs.var_imu[:, :n],
        x_end=x, P_end=P, t_start=float(inputs.imu.t[0]), t_end=float(inputs.imu.t[-1]),
        notes=(*model.notes, *inputs.imu.notes, *events.notes), run=inputs,
    )  # fmt: skip
