"""Errors of a traced flight against fixes that were withheld."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.flights.withheld import predicted, windows
from sinan.estimator.evidence.source import Fit
from sinan.estimator.filter.flight import Flight
from sinan.experiments.measured.flights import EVERY, FIRST, WITHHELD, by_age


def withheld_errors(
    source: FlightSource, fit: Fit, held_out: bool = False, like: Fit | None = None
) -> Mapping[float, float]:
    """RMS of position where fixes are withheld, by age of the last fix [s] -> [m]: of the model with the fit's effects.

    Parameters
    ----------
    held_out : only fixes of the held-out part count
    like : the fit with which it is compared, whose other effects are in the model and zero: so both are run alike
    """
    recording = source.recording
    betas = {} if like is None else {term.effect: np.zeros_like(like.beta[term]) for term in like.in_mean}
    betas |= {term.effect: fit.beta[term] for term in fit.in_mean}
    held = windows(recording.streams["gps"].t, WITHHELD, EVERY, FIRST)
    found = predicted(Flight(recording, source.model), "gps", held, betas)
    return {one.age: one.rms for one in by_age(found.rows(found.t > source.held_out_from) if held_out else found)}
