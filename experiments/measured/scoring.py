"""Errors of a traced flight against what its log was not shown: a reference, and fixes that were withheld."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.measured.flights import EVERY, FIRST, WITHHELD, by_age, rms
from experiments.measured.reference import QUATERNION, Mounted, attitude_error, mounted
from experiments.measured.withheld import predicted, windows
from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.source import Fit
from experiments.residual_loop.term import declaration
from sensors.recording import Recording, Stream


class AttitudeScore:
    """RMS of tilt, heading and total error against a mounted reference [rad], over everything or the held-out part."""

    def __init__(self, recording: Recording, reference: Stream) -> None:
        self.target: Mounted = mounted(recording, reference)

    def __call__(self, source: FlightSource, fit: Fit, held_out: bool = False) -> Mapping[str, float]:
        t, x = source.states(fit)
        if held_out:
            t, x = t[t > source.held_out_from], x[t > source.held_out_from]
        if len(t) < 2:
            return {}
        t, rows = np.unique(t, return_index=True)
        error = attitude_error(t, x[rows, 6:10], self.target)
        if not len(error.t):
            return {}
        if not self.target.reference.has(QUATERNION):
            return {"tilt": rms(error.tilt)}
        return {"attitude": rms(error.total), "tilt": rms(error.tilt), "heading": rms(error.heading)}


def withheld_errors(source: FlightSource, fit: Fit, held_out: bool = False) -> Mapping[float, float]:
    """RMS of position where fixes are withheld, by age of the last fix [s] -> [m]: of the model with the fit's effects.

    Parameters
    ----------
    held_out : only fixes of the held-out part count
    """
    recording, betas = source.recording, {declaration(term): fit.beta[term] for term in fit.in_mean}
    held = windows(recording.streams["gps"].t, WITHHELD, EVERY, FIRST)
    found = predicted(recording, source.model, "gps", held, betas)
    return {one.age: one.rms for one in by_age(found.rows(found.t > source.held_out_from) if held_out else found)}
