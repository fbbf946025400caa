"""Where the error of a plain model goes: into effects, noise, and what has no name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.weighing import in_weight
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Budget:
    """Mean squares of one stream's innovations, over what the final model predicts of each reading, as shares of those
    of the plain model; they sum to one and none but that of the effects is negative.

    Attributes
    ----------
    stream, unit : of the innovations
    rms : of the plain model's one-step innovations of position where the stream has one, doubtful readings with their
        weight, each in the weight of what is predicted of it: the first, from which a zero is found, hardly counts
    effects : what the effects found have taken off
    white, colour : what the model predicts of the readings' noise, and of its colour after the reading before
    motion : what it predicts of the states that it has at that moment: position, attitude, biases
    unnamed : what is left beyond that; where less is left than the model predicts, none, and its parts share what is
    predicted : what the final model predicts of the mean square, over what is left of it
    """

    stream: str
    unit: str
    rms: float
    effects: float
    white: float
    colour: float
    motion: float
    unnamed: float
    predicted: float


def budget_of(stream: str, unit: str, plain: Journal, final: Journal) -> Budget | None:
    """Of one stream of a flight, from the innovations of the plain and of the final model; None without readings.

    Doubtful readings count with the weight that their heavy tail gives them. Neglects that the colour has decayed, and
    grown again, since the reading before.
    """
    before, after = plain.stream(stream), final.stream(stream)
    had, has = before.accepted, after.accepted
    if not np.any(had) or not np.any(has):
        return None
    inputs, model = final.run, final.model
    assert isinstance(inputs, RunInputs)

    def mean(nu: FloatArray, S: FloatArray, weight: FloatArray, tells: BoolArray) -> float:
        return float(np.mean(weight[:, None] * nu**2 / np.diagonal(S, axis1=1, axis2=2), where=tells))

    predicted, tells = np.diagonal(after.S[has], axis1=1, axis2=2), after.tells[has]
    _, same, there = np.intersect1d(before.index[had], after.index[has], return_indices=True)
    weight = before.weight[had][same]
    total = mean(before.nu[had][same], after.S[has][there], weight, tells[there])
    left = mean(after.nu[has], after.S[has], after.weight[has], tells)
    rows = inputs.events.row[after.events[has]][:, None] + np.arange(after.dof)
    white = float(np.mean(inputs.events.r[rows] / predicted, where=tells))
    colour = 0.0
    for start, process in model.colour_of(stream):
        part = slice(start, start + process.size) if process.size > 1 else slice(None)
        var = final.var[after.events[has]][:, model.layout.slice(process.block)]
        colour += float(np.sum(var / predicted[:, part], where=tells[:, part]) / np.sum(tells))
    total, left = max(total, 1e-300), max(left, 1e-300)
    colour = min(colour, 1.0 - white)  # with which the states go, the other way
    share = min(left, 1.0) / total
    first = slice(0, 3)  # of a fix the position
    known = tells[there][:, first]
    weighed = in_weight(before.nu[had][same][:, first], predicted[there][:, first], known, weight)
    rms = float(np.sqrt(np.mean(weighed**2, where=known)))
    return Budget(
        stream, unit, rms, effects=1.0 - left / total, white=share * white, colour=share * colour,
        motion=share * (1.0 - white - colour), unnamed=max(left - 1.0, 0.0) / total, predicted=1.0 / left,
    )  # fmt: skip
