"""The first heading of a log without a magnetometer: the one that makes its flight likeliest.

A start in a manoeuvre shows it already (`estimator.filter.alignment_in_motion`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import collect
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.sensors.recording import Recording, SensorSpec
from sinan.sensors.rotation import quaternion_multiply

#: Headings that are tried and the step of the second round [rad]: a filter started within 20 / 2 = 10 deg finds home.
#: Half and twice of the second move a heading by a step: bound of work (`bounds_of_work headings`).
COARSE, FINE = np.deg2rad(20.0), np.deg2rad(4.0)
#: 1-sigma of a first attitude that needs no search [rad]: 2 * 5 = 10 deg is within `COARSE` / 2.
KNOWN = np.deg2rad(5.0)
#: What the search leaves, about each axis [rad]: steps of `FINE` leave less, and what needs no search as much.
LEFT = KNOWN
#: Readings with a smaller tail probability of their NIS weigh less, as far from the right heading most of them do: a
#: choice, half and twice of which move no heading (`bounds_of_work headings`).
OUTLIER_LEVEL = 1e-3


def with_heading(recording: Recording, specs: Mapping[str, SensorSpec]) -> Recording:
    """The recording with the first attitude that its GPS and IMU agree on best; unchanged where a compass shows it, or
    the first seconds do.

    The filter runs once for each of 18 headings about the vertical of the first second, and again about the best one.
    Its linearisation does not find the way from a heading that is half a circle off.

    Parameters
    ----------
    recording : a flight with GPS
    specs : noise levels
    """
    initial = recording.initial
    if "mag" in recording.streams or "gps" not in recording.streams or initial.quaternion is not None:
        return recording
    flight = Flight.of(recording, specs=specs, gate_level=None, robust_level=OUTLIER_LEVEL)
    x, P = first_state(flight)
    if np.linalg.eigvalsh(P[DTHETA, DTHETA])[-1] < KNOWN**2:
        return recording
    events = collect(flight)

    def turned(heading: float) -> Recording:
        turn = np.array([np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)])
        first = replace(initial, quaternion=quaternion_multiply(turn, x[Q_NB]), attitude_std=LEFT)
        return recording.replace(initial=first)

    def surprise(heading: float) -> float:
        """Bounded NIS and log |S|; the readings that `OUTLIER_LEVEL` calls outliers count with a logarithm."""
        journal = run(prepare(flight.reading(turned(heading)), events=events), "numba", stride=0)
        limit = flight.model.robust_threshold(journal.freedom)
        over = np.maximum(journal.nis / limit, 1.0)
        bounded = np.where(over > 1.0, limit * (1.0 + np.log(over)), journal.nis)
        return float(np.sum((bounded - journal.nis - 2.0 * journal.loglik)[journal.accepted]))

    best = min(np.arange(0.0, 2.0 * np.pi, COARSE), key=surprise)
    best = min(best + np.arange(-0.5 * COARSE, 0.5 * COARSE + 1e-9, FINE), key=surprise)
    found = turned(float(best))
    note = f"heading: {np.rad2deg(best) % 360.0:.0f} deg about the first vertical is the likeliest"
    return found.replace(notes=(*recording.notes, note))
