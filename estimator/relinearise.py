"""The cure for a coarse start: the filter again, with every reading linear about the smoothed motion.

An extended filter linearises each reading at its estimate of that moment. While a heading is off by more than a tenth
of a radian, it so believes in information that is not there, and its covariance ends too small. Here the readings are
linear about the smoothed motion of the pass before: Gauss-Newton over the whole recording, whose covariance is that of
the solution. The process stays linear about the filter's own estimate.

Source: B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.effect_forms import Terms, declared_terms, stream_motion
from estimator.events import StreamForm, collect
from estimator.filter import Engine, prepare, run, run_filter
from estimator.flight_model import FlightModel
from estimator.imu import imu_table
from estimator.journal import Journal
from estimator.smoother import estimated_motion
from sensors.motion import Motion
from sensors.recording import Recording

PASSES = 5
TOLERANCE = 1e-2  # largest move of a whitened innovation at which the passes end


def linear_form(recording: Recording, model: FlightModel, name: str, motion: Motion) -> StreamForm:
    """Prediction and Jacobian of one sensor along a motion."""
    at, sensor = stream_motion(recording, model, name, Terms(), motion), model.sensors[name]
    D = np.zeros((len(at), sensor.size, 9))
    jacobian = sensor.jacobian(at)
    for place, block in enumerate(("position", "velocity", "attitude")):
        if block in jacobian:
            D[:, :, 3 * place : 3 * place + 3] = jacobian[block]
    return StreamForm(sensor.predict(at), D, np.concatenate([at.p_n, at.v_n, at.q_nb], axis=1), replaces=True)


def run_relinearised(
    recording: Recording, model: FlightModel, *, engine: Engine = "auto", stride: int = 1, passes: int = PASSES
) -> Journal:
    """Filter, smooth, and filter again about the smoothed motion until the innovations settle.

    Parameters
    ----------
    recording, model, engine, stride : as for `run_filter`; the gate judges the last passes, not the first
    passes : at most

    Raises
    ------
    ValueError : the recording declares effects, which this run would leave out
    """
    if declared_terms(recording):
        raise ValueError("`recording` declares effects; expected none: use `run_filter`")
    table = imu_table(recording, model)
    journal = run_filter(recording, model.replace(gate_level=None), engine=engine, stride=0)
    white = journal.white
    count = 1
    while count < passes:
        count += 1
        motion = estimated_motion(journal)
        forms = {name: linear_form(recording, model, name, motion) for name in model.sensors}
        inputs = prepare(recording, model, imu=table, events=collect(recording, model, forms))
        journal = run(inputs, engine, stride)
        if np.nanmax(np.abs(journal.white - white), initial=0.0) < TOLERANCE:
            break
        white = journal.white
    return replace(journal, iterations=count)
