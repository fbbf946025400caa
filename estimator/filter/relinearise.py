"""The cure for a coarse start: the filter again, with every reading linear about the smoothed motion.

An extended filter linearises each reading at its estimate of that moment. While a heading is off by more than a tenth
of a radian, it so believes in information that is not there, and its covariance ends too small. Here the readings are
linear about the smoothed motion of the pass before: Gauss-Newton over the whole recording, whose covariance is that of
the solution. The process stays linear about the filter's own estimate.

Source: B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994.
"""

from __future__ import annotations

import numpy as np

from sinan.estimator.filter.effect_forms import Terms, declared_terms, run_with_effects
from sinan.estimator.filter.engine import Engine, run
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import DTHETA
from sinan.sensors.arrays import FloatArray

__all__ = ["COARSE_ATTITUDE", "coarsest_attitude", "is_coarse", "run_relinearised"]

PASSES = 6  # at most; `TOLERANCE` ends them: bound of work (`bounds_of_work coarse`)
TOLERANCE = 1e-2  # largest move of a whitened innovation at which the passes end: to its variance it adds 0.01^2 = 1e-4
#: 1-sigma of the attitude about its worst axis above which the plain filter's covariance is not to be trusted
#: [rad]; docs/notes/filter_consistency.md has the study.
COARSE_ATTITUDE = 0.03


def is_coarse(flight: Flight) -> bool:
    """Whether the plain filter knows the attitude too coarsely to linearise, at its start or later on, after a gap."""
    inputs = prepare(flight.believing(gate_level=None, relinearise=False))
    return coarsest_attitude(run(inputs, stride=0)) > COARSE_ATTITUDE


def coarsest_attitude(journal: Journal) -> float:
    """Largest 1-sigma of the attitude about an axis, of the first state or after a reading [rad]."""
    inputs = journal.run
    assert isinstance(inputs, RunInputs)
    first = float(np.max(np.linalg.eigvalsh(inputs.P[DTHETA, DTHETA])))
    return float(np.sqrt(max(first, np.max(journal.var[journal.accepted, DTHETA], initial=0.0))))


def run_relinearised(
    flight: Flight,
    betas: Terms | None = None,
    *,
    engine: Engine = "auto",
    stride: int = 1,
    passes: int | None = None,
    first: tuple[FloatArray, FloatArray] | None = None,
) -> Journal:
    """Filter, smooth, and filter again about the smoothed motion until the innovations settle.

    Parameters
    ----------
    flight, engine, stride : as for `run_filter`; the gate judges the last passes, not the first
    betas : effects in the model, in their exact form; what the recording declares is added
    passes : at most; default: `PASSES`
    first : state and covariance to start from; default: those of `first_state`
    """
    terms = (betas or Terms()).joined(declared_terms(flight.recording))
    return run_with_effects(
        flight.believing(relinearise=True),
        terms,
        engine=engine,
        stride=stride,
        passes=PASSES if passes is None else passes,
        tolerance=TOLERANCE,
        first=first,
    )
