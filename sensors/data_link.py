"""The data link of differential GPS: what of a base reaches a user, when, and how old it is by then.

A message is made every `interval`, of what the base has measured until then. It is lost, or it arrives `delay` later
and is used until a younger one comes. It holds either

    corrections : a range correction and its rate for each satellite; the base has drawn the line through its own past
    raw         : the base's pseudoranges; the user makes the corrections from those that have reached it

Losses come in runs: a lost message is followed by another lost one so that runs are `run` messages long on average
(Gilbert, Bell System Tech. J. 39 (1960) 1253, with no loss in the good state). With a lost share p the mean age is

    delay + interval (1 / 2 + p run),  run = 1 / (1 - p) where losses are independent,

since the chain of losses is the same backwards in time.

Source of the correction message, its fields and their steps: RTCM 10402.3 (2001), types 1 and 18/19.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sinan.sensors import dgps
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.errors import InputError
from sinan.sensors.formats.rinex_navigation import Navigation
from sinan.sensors.formats.rinex_text import WEEK
from sinan.sensors.pseudorange import Pseudoranges

VALUE_STEP, RATE_STEP = 0.02, 0.002  # m, m/s: least steps of a correction message
CONTENTS = ("corrections", "raw")


@dataclass(frozen=True)
class DataLink:
    """A link from base to user.

    Attributes
    ----------
    content : `corrections` or `raw`
    interval : between messages [s]; the base's own where it is shorter
    delay : from measurement to use [s]
    loss : share of the messages that is lost
    run : messages that are lost in a row, on average; None: losses are independent
    rate : whether the rate is used to age a correction
    window : seconds of the past through which value and rate are a straight line
    seed : of the losses
    """

    content: str = "corrections"
    interval: float = 1.0
    delay: float = 0.0
    loss: float = 0.0
    run: float | None = None
    rate: bool = True
    window: float = dgps.SMOOTHING
    seed: int = 0

    def __post_init__(self) -> None:
        if self.content not in CONTENTS:
            raise InputError("data link", f"content `{self.content}`", " or ".join(CONTENTS))
        for name, value in (("interval", self.interval), ("delay", self.delay), ("window", self.window)):
            if not 0.0 <= value < 1e6:
                raise InputError("data link", f"{name} {value:g} s", "0 to a million seconds")
        if not 0.0 <= self.loss < 1.0:
            raise InputError("data link", f"loss {self.loss:g}", "a share from 0 to below 1")
        least = max(1.0, self.loss / (1.0 - self.loss))
        if self.run is not None and self.run < least:
            raise InputError("data link", f"runs of {self.run:g} messages", f"at least {least:.3g} at that loss")

    @property
    def mean_run(self) -> float:
        """Messages that are lost in a row, on average."""
        return 1.0 / (1.0 - self.loss) if self.run is None else self.run

    @property
    def mean_age(self) -> float:
        """Age of what is used, on average over all instants [s]."""
        return self.delay + self.interval * (0.5 + self.loss * self.mean_run)

    def arrived(self, t: FloatArray) -> IntArray:
        """Indices of the base's epochs whose message reaches the user.

        Parameters
        ----------
        t : (epochs,) of the base [s]
        """
        slots = np.floor((t - t[0]) / self.interval + 1e-6) if self.interval > 0.0 else np.arange(len(t))
        sent = np.flatnonzero(np.diff(slots, prepend=-1.0) > 0)
        if self.loss == 0.0:
            return sent
        draw = np.random.default_rng(self.seed).random(len(sent))
        stays, begins = 1.0 - 1.0 / self.mean_run, self.loss / (self.mean_run * (1.0 - self.loss))
        lost = np.zeros(len(sent), dtype=bool)
        for k in range(len(sent)):
            chance = self.loss if k == 0 else stays if lost[k - 1] else begins
            lost[k] = draw[k] < chance
        return sent[~lost]


def parse_link(text: str) -> DataLink:
    """A link from words such as `delay=5,loss=0.2,content=raw`.

    Raises
    ------
    InputError : a key or a value is wrong
    """
    known = {"content": str, "interval": float, "delay": float, "loss": float, "run": float}
    known |= {"window": float, "seed": int}
    found: dict[str, Any] = {}
    for part in filter(None, text.replace(" ", "").split(",")):
        key, _, value = part.partition("=")
        if key == "rate" and value in ("yes", "no"):
            found[key] = value == "yes"
            continue
        try:
            found[key] = known[key](value)
        except (KeyError, ValueError):
            expected = "content=corrections|raw, interval=S, delay=S, loss=SHARE, run=N, rate=yes|no, window=S"
            raise InputError("--link", f"`{part}`", expected) from None
    return DataLink(**found)


def received(
    base: Pseudoranges, position: FloatArray, link: DataLink, effects: tuple[str, ...]
) -> tuple[dgps.Corrections, BoolArray]:
    """The corrections that a user has, and (n,) which of their rows have reached it.

    Parameters
    ----------
    base : pseudoranges of the base, all epochs
    position : (3,) of the base, ECEF [m]
    link : what is sent and lost
    effects : names of the effects that are modelled at both ends
    """
    there = np.zeros(len(base.t), dtype=bool)
    there[link.arrived(base.t)] = True
    if link.content == "raw":
        given = dgps.corrections(base.rows(there[base.epoch]), position, effects, past=True, window=link.window)
        return given, np.ones(len(given.base), dtype=bool)
    given = dgps.corrections(base, position, effects, past=True, window=link.window)
    given = replace(
        given,
        value=np.round(given.value / VALUE_STEP) * VALUE_STEP,
        rate=np.round(given.rate / RATE_STEP) * RATE_STEP,
    )
    return given, there[given.base.epoch]


def apply_link(
    base: Pseudoranges,
    position: FloatArray,
    link: DataLink,
    rover: Pseudoranges,
    navigation: Navigation,
    effects: tuple[str, ...],
    longest_age: float = dgps.LONGEST_AGE,
) -> dgps.Applied:
    """The youngest correction that has arrived for each of the user's rows, aged by its rate to the row's own time.

    Parameters
    ----------
    base, position : of the base
    link : data link
    rover : pseudoranges of the user
    navigation : messages, for satellites of which the two have chosen different ones
    effects : names of the effects that are modelled at both ends
    longest_age : older corrections are not used [s]
    """
    given, there = received(base, position, link, effects)
    row, age = youngest(given, there, rover, link.delay)
    usable = (row >= 0) & (age <= longest_age + 1e-9)
    i = row[usable]
    value, total_age, variance = (np.full(len(rover), np.nan) for _ in range(3))
    ageing = given.rate[i] * age[usable] if link.rate else 0.0
    value[usable] = given.value[i] + ageing + dgps.other_message(given, i, rover, usable, navigation)
    total_age[usable] = age[usable]
    variance[usable] = given.variance[i] + dgps.growth(given, link.rate, longest_age).at(age[usable])
    return dgps.Applied(value, total_age, variance)


def youngest(
    given: dgps.Corrections, there: BoolArray, rover: Pseudoranges, delay: float
) -> tuple[IntArray, FloatArray]:
    """(n,) row of the youngest correction of the same satellite that has arrived, -1 for none; (n,) its age [s]."""
    row, age = np.full(len(rover), -1), np.full(len(rover), np.nan)
    t_base = given.base.time + (given.base.week - rover.week) * WEEK
    t_rover = rover.time
    for name in np.intersect1d(given.base.satellite, rover.satellite).tolist():
        theirs = np.flatnonzero((given.base.satellite == name) & there)
        mine = np.flatnonzero(rover.satellite == name)
        latest = np.searchsorted(t_base[theirs], t_rover[mine] - delay + 1e-6, side="right") - 1
        found = latest >= 0
        row[mine[found]] = theirs[latest[found]]
        age[mine[found]] = t_rover[mine[found]] - t_base[theirs[latest[found]]]
    return row, age
