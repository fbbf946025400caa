"""Errors of a traced flight against what its log was not shown: a reference, and fixes that were withheld."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator.filter import run_filter
from experiments.measured.flights import AGES, rms, withheld
from experiments.measured.reference import QUATERNION, Mounted, attitude_error, mounted
from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.source import Fit
from experiments.residual_loop.term import declaration
from sensors.arrays import FloatArray
from sensors.recording import POSITION, Recording, Stream

#: A withheld fix is shown this far off [m], and only a gate that nothing else can meet refuses it: its innovation, less
#: this, is what the model with all its effects would have missed it by.
FAR, NOTHING_ELSE = 1e6, 1e-200


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
    gps, imu = source.recording.streams["gps"], source.recording.streams["imu"].t
    hidden = withheld(gps.t) & (gps.t > imu[0]) & (gps.t < imu[-1])
    columns = {name: gps[name] + (FAR * hidden if name in POSITION else 0.0) for name in gps.columns}
    shown = source.recording.replace(streams={**source.recording.streams, "gps": Stream(gps.t, columns)})
    betas = {declaration(term): fit.beta[term] for term in fit.in_mean}
    model = source.model.replace(gate_level=NOTHING_ELSE, relinearise=False)  # whose first pass has no gate for them
    journal = run_filter(shown, model, betas, engine="numba", stride=0)
    one = journal.stream("gps")
    asked = hidden[one.index] & np.isfinite(one.nis)
    if held_out:
        asked &= one.t > source.held_out_from
    missed = np.linalg.norm(one.nu[asked, :3] - FAR, axis=1)
    given = np.sort(gps.t[~hidden])
    age = gps.t[one.index[asked]] - given[np.searchsorted(given, gps.t[one.index[asked]]) - 1]
    return _by_age(age, missed)


def _by_age(age: FloatArray, missed: FloatArray) -> Mapping[float, float]:
    near = {wanted: np.abs(age - wanted) < 0.5 * min(1.0, wanted) for wanted in AGES}
    return {wanted: rms(missed[rows]) for wanted, rows in near.items() if np.any(rows)}
