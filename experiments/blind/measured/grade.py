"""The grade of one minute: what was put in against what is named, compared with the control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.experiments.blind.grade import deviation, effects_of, is_same, names_of
from sinan.experiments.blind.maker.catalogue import Hidden


@dataclass(frozen=True)
class MinuteGrade:
    """One minute with an effect in it.

    Attributes
    ----------
    named, control : names that the report of the minute has, and that of its control
    verdict, control_verdict : of both
    right : the effect is named; of a time-localised one at its time; where the control names it too, its beta is nearer
        to that with what was put in than to the control's
    in_class : it is right, or said to be confused with what is named
    known : the control names it too
    further : names that are neither the effect nor in the control
    further_left_out : those that the control does not call confused with one of its names either
    lost : names of the control that are gone
    z : |beta less the control's, less what was put in| in sigma, as a normal number; None where it is not named or has
        no sigma, and of outliers
    seconds : CPU time a minute
    """

    named: tuple[str, ...]
    control: tuple[str, ...]
    verdict: str
    control_verdict: str
    right: bool
    in_class: bool
    known: bool
    further: tuple[str, ...]
    further_left_out: tuple[str, ...]
    lost: tuple[str, ...]
    z: float | None
    seconds: float


def grade(hidden: Hidden, document: Mapping[str, Any], control: Mapping[str, Any], seconds: float) -> MinuteGrade:
    """Compare a report with what was put in and with the control's report.

    Parameters
    ----------
    document, control : reports of the traces of the minute with the effect and of the untouched one
    seconds : CPU time a minute
    """
    found, before = effects_of(document), effects_of(control)
    names, names_before = names_of(found), names_of(before)
    own = next((e for e in found if is_same(hidden.name, hidden.interval, e)), None)
    own_before = next((e for e in before if is_same(hidden.name, hidden.interval, e)), None)
    confused, confused_before = _confused(document), _confused(control)
    further = tuple(name for name in names if name not in {*names_before, hidden.name})
    z, right = None, own is not None
    if own is not None:
        more = own[2] - (0.0 if own_before is None else own_before[2])
        right = own_before is None or bool(np.linalg.norm(more - hidden.beta) < np.linalg.norm(more))
        z = None if hidden.name.endswith(".outliers") else deviation(more, hidden.beta, own[3])
    return MinuteGrade(
        named=names,
        control=names_before,
        verdict=str(document["verdict"]),
        control_verdict=str(control["verdict"]),
        right=right,
        in_class=right or hidden.name in confused,
        known=own_before is not None,
        further=further,
        further_left_out=tuple(name for name in further if name not in confused_before),
        lost=tuple(name for name in names_before if name not in names),
        z=z,
        seconds=seconds,
    )


def _confused(document: Mapping[str, Any]) -> set[str]:
    """Names that a report gives as the rivals of its own."""
    return {name for effect in document["effects"] for name in effect["confused_with"]}
