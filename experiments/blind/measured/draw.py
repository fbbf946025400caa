"""What is put into a measured minute, drawn whatever a tracer says; how large it is, the report of the control says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.estimator.filter.effect_forms import is_lateness
from sinan.experiments.blind.maker.catalogue import (
    CATALOGUE,
    LOCAL_STREAMS,
    OUTLIER_SHARE,
    Hidden,
    draw_interval,
    log_uniform,
)
from sinan.experiments.blind.maker.turning import random_direction
from sinan.experiments.blind.measured.minute import Minute, lasting, local, wander_of
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import effect as effect_of
from sinan.sensors.effects.streams import STREAMS

#: Sizes of lasting effects in units of what the control's report says is detectable.
SIZES = (0.5, 1.0, 2.0, 4.0)
#: A step or transient of size one is so many times as far off as its stream wanders while it lasts.
OF_WANDER = 10.0
#: How often the effect is a lasting one.
LASTING = 0.6
#: Offsets of more than so many plausible sizes of their stream (`sensors.effects.streams`) do not occur.
OCCURS = 3.0
#: What became of a draw: an effect was put in; the control's report says that no size of it is visible, or does not ask
#: for it; the size is beyond that of a bad or badly mounted instrument (the upper bound of `blind.maker.catalogue`), or
#: of an offset that occurs; with what the control has of the same effect it adds up to less than would be found.
PUT, NOT_VISIBLE, BEYOND, UNDONE = "put", "not visible", "beyond what occurs", "undoing what the log has"


@dataclass(frozen=True)
class Order:
    """One effect for one minute.

    Attributes
    ----------
    run : number of the draw
    name : of the effect
    size : of `SIZES`
    direction : (parameters,) of beta, of norm one; of outliers their share
    interval : (from, to) [s] of a time-localised effect, else None
    """

    run: int
    name: str
    size: float
    direction: FloatArray
    interval: tuple[float, float] | None

    @property
    def is_lasting(self) -> bool:
        """Whether it acts all the time."""
        return self.name in CATALOGUE


def draw(seed: int, run: int, minute: Minute) -> Order:
    """Effect, size, direction and interval of draw `run` of a seed for a minute."""
    rng = np.random.default_rng([seed, run])
    names = lasting(minute) if rng.uniform() < LASTING else local(minute)
    name, size = str(rng.choice(names)), float(rng.choice(SIZES))
    if name in CATALOGUE:
        direction = random_direction(rng, CATALOGUE[name].parameters)
        return Order(run, name, size, np.abs(direction) if CATALOGUE[name].positive else direction, None)
    stream, what = name.split(".")
    interval = draw_interval(rng, what, minute.begin, minute.end, poses=False)
    if what == "outliers":
        return Order(run, name, size, np.array([log_uniform(rng, *OUTLIER_SHARE)]), interval)
    return Order(run, name, size, random_direction(rng, LOCAL_STREAMS[stream][0]), interval)


def sized(order: Order, minute: Minute, control: Mapping[str, Any]) -> tuple[Hidden | None, str]:
    """The effect at its size, or None and why not.

    Lasting: beta = size u min_i(d_i / |u_i|) with d_i from what size on the control's report says that component i
    would be found: of the component that is seen best it is `size` times that. Steps and transients: 10 size w_i u_i,
    w_i the wander of component i over the length. Outliers: their share, as it was drawn. A lasting effect that the
    control names too, and that what is put in undoes, is none to be named, and is not put in.

    Parameters
    ----------
    control : report of the trace of the untouched minute
    """
    if order.name.endswith(".outliers"):
        return Hidden(order.name, order.direction, order.interval), PUT
    stream = order.name.split(".")[0]
    if order.interval is None:
        beta, largest = order.size * lasting_unit(order, control), CATALOGUE[order.name].high
    else:
        unit = OF_WANDER * wander_of(minute, stream, order.interval[1] - order.interval[0])
        beta, largest = order.size * unit * order.direction, OCCURS * STREAMS[stream].plausible
    if not np.all(np.isfinite(beta)) or not np.any(beta):
        return None, NOT_VISIBLE
    of_field = CATALOGUE[order.name].of_field if order.is_lasting else stream == "mag"
    if np.linalg.norm(beta) > largest * (float(np.linalg.norm(minute.around.field_n)) if of_field else 1.0):
        return None, BEYOND
    if order.is_lasting and _undoes(order.name, beta, minute, control):
        return None, UNDONE
    return Hidden(order.name, beta, order.interval), PUT


def _undoes(name: str, beta: FloatArray, minute: Minute, control: Mapping[str, Any]) -> bool:
    """Whether no component of what is put in and what the minute has of that effect together would be found: by name in
    the control, or how late the stream is by the log's likelihood, named or not.
    """
    own = [np.array(effect["beta"]) for effect in control["effects"] if effect["name"] == name]
    stream = name.split(".")[0]
    if not own and is_lateness(effect_of(name)) and stream in minute.ready.model.latency:
        own = [np.array([minute.ready.model.latency[stream]])]
    return bool(own) and bool(np.all(np.abs(beta + own[0]) < detectable(control)[name]))


def lasting_unit(order: Order, control: Mapping[str, Any]) -> FloatArray:
    """(parameters,) beta of an effect that is just detectable in its direction; infinite where it is not visible."""
    least = detectable(control).get(order.name)
    if least is None:
        return np.full(len(order.direction), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(order.direction * np.min(least / np.abs(order.direction)))


def detectable(control: Mapping[str, Any]) -> dict[str, FloatArray]:
    """By lasting effect, (parameters,) from what size on each component would be found; infinite where it is not."""
    asked = [c for c in control.get("candidates", ()) if c["detectable_from"]]
    sizes = {c["name"]: np.array(c["detectable_from"], dtype=np.float64) for c in asked}
    return {name: np.where(np.isfinite(size), size, np.inf) for name, size in sizes.items()}
