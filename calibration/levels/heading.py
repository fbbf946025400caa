"""The first heading of a log that no magnetometer shows: the one that makes its flight likeliest.

There is none, or its hard iron may be as large as the field. A start in a manoeuvre shows the heading already
(`estimator.filter.alignment_in_motion`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sinan.estimator.filter.alignment import first_state
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.events import collect
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import UNBRIDGED
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.layout import DTHETA, Q_NB
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
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

    def surprise(heading: float) -> float:
        """Bounded NIS and log |S|; the readings that `OUTLIER_LEVEL` calls outliers count with a logarithm."""
        try:
            journal = run(prepare(flight.reading(_turned(recording, x, heading)), events=events), "numba", stride=0)
        except InputError:  # no state follows from such a heading
            return np.inf
        limit = flight.model.robust_threshold(journal.freedom)
        over = np.maximum(journal.nis / limit, 1.0)
        bounded = np.where(over > 1.0, limit * (1.0 + np.log(over)), journal.nis)
        return float(np.sum((bounded - journal.nis - 2.0 * journal.loglik)[journal.accepted]))

    best = min(np.arange(0.0, 2.0 * np.pi, COARSE), key=surprise)
    best = min(best + np.arange(-0.5 * COARSE, 0.5 * COARSE + 1e-9, FINE), key=surprise)
    return _noted(_turned(recording, x, float(best)), float(best))


def beside_iron(flight: Flight) -> Recording:
    """The recording with the first attitude that all its readings agree on best, where its magnetometer tells the first
    heading worse than a linear filter can bear (`UNBRIDGED`); else unchanged.

    As `with_heading` for a compass that was never calibrated. What the log tells the heading to is the spread of the
    coarse headings by their likelihood.

    Parameters
    ----------
    flight : with GPS and magnetometer, at levels and field that are believed beforehand
    """
    recording = flight.recording
    if not {"mag", "gps"} <= set(recording.streams) or recording.initial.quaternion is not None:
        return recording
    x, P = first_state(flight)
    if np.linalg.eigvalsh(P[DTHETA, DTHETA])[-1] < UNBRIDGED**2:
        return recording
    events = collect(flight)

    def log_likelihood(heading: float) -> float:
        reading = flight.reading(_turned(recording, x, heading))
        try:
            return run(prepare(reading, events=events), "numba", stride=0).log_likelihood
        except InputError:  # no state follows from such a heading
            return -np.inf

    headings = np.arange(0.0, 2.0 * np.pi, COARSE)
    each = np.array([log_likelihood(float(heading)) for heading in headings])
    if not np.any(np.isfinite(each)):
        return recording
    off = np.angle(np.exp(1j * (headings - headings[np.argmax(each)])))
    share = np.exp(each - np.max(each))
    std = float(np.clip(np.sqrt(np.sum(share * off**2) / np.sum(share)), LEFT, UNBRIDGED))
    fine = headings[np.argmax(each)] + np.arange(-0.5 * COARSE, 0.5 * COARSE + 1e-9, FINE)
    best = max(fine.tolist(), key=log_likelihood)
    return _noted(_turned(recording, x, best, std), best)


def _turned(recording: Recording, x: FloatArray, heading: float, std: float = LEFT) -> Recording:
    """The recording that begins with the attitude of a state turned about the vertical, known to `std` [rad]."""
    turn = np.array([np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)])
    first = replace(recording.initial, quaternion=quaternion_multiply(turn, x[Q_NB]), attitude_std=std)
    return recording.replace(initial=first)


def _noted(found: Recording, heading: float) -> Recording:
    """With a note on the heading that was found."""
    note = f"heading: {np.rad2deg(heading) % 360.0:.0f} deg about the first vertical is the likeliest"
    return found.replace(notes=(*found.notes, note))
