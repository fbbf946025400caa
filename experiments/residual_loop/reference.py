"""Errors of a flight's estimate against a reference, read after the decision."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.residual_loop.flight import FlightSource
from experiments.residual_loop.source import Fit
from experiments.residual_loop.verdict import Score
from sensors.arrays import BoolArray, FloatArray
from sensors.recording import POSITION, VELOCITY, Stream
from sensors.rotation import (
    quaternion_conjugate,
    quaternion_interpolate,
    quaternion_log,
    quaternion_multiply,
    rpy_from_quaternion,
)

_QUATERNION = ("qw", "qx", "qy", "qz")


def score_against(reference: Stream, source: FlightSource, held_out: bool = False) -> Score:
    """RMS errors of the filter's states: position and height [m], velocity [m/s], attitude and heading [rad].

    Readings in gaps of the reference longer than three of its steps, and outside it, do not count; `held_out` counts
    the held-out part alone.
    """

    def score(fit: Fit) -> Mapping[str, float]:
        t, x = source.states(fit)
        inside = _covered(t, reference.t)
        if held_out:
            inside = inside & (t > source.held_out_from)
        t, x = t[inside], x[inside]
        errors: dict[str, float] = {}
        if len(t) == 0:
            return errors
        if reference.has(POSITION) and source.model.translation:
            away = x[:, 0:3] - _interpolated(t, reference, POSITION)
            errors["position_rms"], errors["height_rms"] = _rms(away), _rms(away[:, 2:])
        if reference.has(VELOCITY) and source.model.translation:
            errors["velocity_rms"] = _rms(x[:, 3:6] - _interpolated(t, reference, VELOCITY))
        if reference.has(_QUATERNION):
            q = quaternion_interpolate(t, reference.t, reference.array(_QUATERNION))
            errors["attitude_rms"] = _rms(quaternion_log(quaternion_multiply(quaternion_conjugate(q), x[:, 6:10])))
            heading = rpy_from_quaternion(x[:, 6:10])[:, 2] - rpy_from_quaternion(q)[:, 2]
            errors["heading_rms"] = float(np.sqrt(np.mean(np.angle(np.exp(1j * heading)) ** 2)))
        return errors

    return score


def _rms(error: FloatArray) -> float:
    """Root of the mean squared length."""
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _interpolated(t: FloatArray, reference: Stream, names: tuple[str, ...]) -> FloatArray:
    return np.stack([np.interp(t, reference.t, reference[name]) for name in names], axis=1)


def _covered(t: FloatArray, known: FloatArray) -> BoolArray:
    after = np.clip(np.searchsorted(known, t), 1, len(known) - 1)
    gap = known[after] - known[after - 1]
    inside = (t >= known[0]) & (t <= known[-1]) & (gap <= 3.0 * np.median(np.diff(known)))
    return np.asarray(inside)
