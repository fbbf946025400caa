"""How log L goes with each size, from the exact derivatives by the variances that it makes."""

from __future__ import annotations

import numpy as np

from sinan.calibration.levels.levels import Levels
from sinan.calibration.levels.sizes import Size
from sinan.estimator.evidence.level_scores import LevelScores
from sinan.estimator.filter.alignment import ALIGNING, first_state, with_first_motion
from sinan.estimator.filter.events import stamp_variances, white_shares
from sinan.estimator.filter.flight_model import InStep
from sinan.estimator.filter.imu import in_step_accel, in_step_gyro
from sinan.estimator.filter.inputs import RunInputs
from sinan.sensors.arrays import FloatArray, IntArray

_ROWS = {"noise_std": slice(0, 3), "velocity_noise_std": slice(3, 6)}


def slopes(inputs: RunInputs, scores: LevelScores, levels: Levels, size: Size) -> FloatArray:
    """(parts,) d log L / d log of a size, of the readings of each part; what the first state says is the first's."""
    model, imu, events = inputs.model, inputs.imu, inputs.events
    layout, first = model.layout, scores.first_interval
    if size.sensor in ("accel", "gyro") and size.key == "noise_density":
        q, by = (imu.q_accel, scores.q_accel) if size.sensor == "accel" else (imu.q_gyro, scores.q_gyro)
        return 2.0 * sums_from(by * np.minimum(levels.value(size) ** 2, q), first)
    if size.sensor == "in_step":
        u, only = imu.u, InStep(**{size.key: levels.value(size)})
        if size.key == "accel":
            return sums_from(scores.q_accel * in_step_accel(imu.t, u, only), first)
        factor = 2.0 if size.key == "rate" else 1.0
        return factor * sums_from(scores.q_gyro * in_step_gyro(imu.t, u, only), first)
    if size.sensor in ("bounds", "stamps") or size.key in _ROWS:
        name = size.sensor if size.key in _ROWS else size.key
        if name not in events.sensors:
            return np.zeros(len(first))
        k = np.flatnonzero(events.sensor == events.sensors.index(name))
        width = model.sensors[name].size
        columns = np.arange(width)[_ROWS.get(size.key, slice(None))] if name == "gps" else np.arange(width)
        if size.sensor == "stamps":
            grown = stamp_variances(inputs.flight)[:, None]
        else:
            grown = levels.value(size) ** 2 * white_shares(inputs.flight, name)[:, columns]
        of_reading = np.zeros(len(events))
        of_reading[k] = np.sum(grown[events.index[k]] * scores.r[events.row[k][:, None] + columns], axis=1)
        found = 2.0 * sums_from(of_reading, scores.first_reading)
        if name == "gps":  # of whose first fix the first state is
            found[0] += _slope_of_start(inputs, scores, levels, size)
        return found
    if size.key == "colour_time":
        blocks = [block for block in (f"c_{size.sensor}", f"c_{size.sensor}_velocity") if layout.has(block)]
        each = [np.sum(scores.time_of_part[:, layout.slice(block)], axis=1) for block in blocks]
        return np.sum(each, axis=0) if each else np.zeros(len(first))
    kinds = {"colour_std": "c_", "velocity_colour_std": "c_", "bias_std": "b_", "bias_walk": "b_"}
    block = kinds[size.key] + size.sensor
    block += "_velocity" if size.key == "velocity_colour_std" else ""
    if not layout.has(block):
        return np.zeros(len(first))
    walks = 2.0 * np.sum(scores.bias_of_part[:, layout.slice(block)], axis=1) if size.key != "bias_std" else 0.0
    start = 0.0 if size.key == "bias_walk" else _slope_of_start(inputs, scores, levels, size, layout.slice(block))
    return walks + np.eye(len(first))[0] * start


def _slope_of_start(
    inputs: RunInputs, scores: LevelScores, levels: Levels, size: Size, block: slice | None = None
) -> float:
    """What the first state and its covariance contribute: by the block itself, where there is one, and by a difference
    where the first attitude, position or velocity is found from the sensor.
    """
    aligning = size.sensor in ALIGNING or size.key == "velocity_noise_std"
    own = 0.0
    if block is not None and not aligning:
        own = 2.0 * levels.value(size) ** 2 * float(np.trace(scores.start[block, block]))
        if size.key != "velocity_colour_std":
            return own
    other = levels.with_size(size, levels.value(size) * 1.01).flight(inputs.recording)
    x, P = first_state(other) if aligning else with_first_motion(other, inputs.x, inputs.P)
    moved = inputs.model.layout.difference(x, inputs.x)
    return own + float((np.sum((P - inputs.P) * scores.start) + moved @ scores.start_x) / np.log(1.01))


def sums_from(values: FloatArray, first: IntArray) -> FloatArray:
    """Sums of what begins at each of `first` and ends before the next; 0 of a part that is empty."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.diff(total[np.append(first, len(values))])
