"""The filter over a recording: effects in their exact form, readings refused for good, the engine that fits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sinan.estimator.filter.engine import Engine, run
from sinan.estimator.filter.events import ACCEPTED, GATED, is_form_only
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import prepare
from sinan.estimator.filter.journal import Journal
from sinan.sensors.arrays import FloatArray, IntArray

#: Share of a sensor's readings that a gate may refuse before it is the gate that is doubted: a quarter, where one in a
#: million should be, are refused if innovations are norm.isf(5e-7) / norm.isf(0.125) = 4.3 times as large as declared.
LOCKED_OUT = 0.25


def run_filter(
    flight: Flight,
    betas: Mapping[Any, FloatArray] | None = None,
    *,
    engine: Engine = "auto",
    stride: int = 1,
    passes: int = 6,
    tolerance: float = 1e-3,
) -> Journal:
    """Run the filter over a flight, with effects in the model where `betas` (or the recording) names them.

    Parameters
    ----------
    flight : readings and model
    betas : by effect (a name of the catalogue, or an `Effect`), its parameters; what the recording declares is added
    engine : "numba", "filterpy", or "auto": the compiled one where nobody has to wait for the compiler
    stride : IMU samples between two logged states; 0: none
    passes, tolerance : effects are evaluated along the smoothed motion of the pass before, until no whitened innovation
        moves by more than `tolerance` sigma

    Returns
    -------
    Journal

    Raises
    ------
    InputError : a state that is not finite, with time and sensor; effects that lack a covariate
    """
    from sinan.estimator.filter.effect_forms import Terms, declared_terms, run_with_effects
    from sinan.estimator.filter.relinearise import run_relinearised

    terms = Terms.of(betas or {}).joined(declared_terms(flight.recording))

    def once(flight: Flight) -> Journal:
        if flight.model.relinearise:
            return run_relinearised(flight, terms, engine=engine, stride=stride)
        if not terms and not any(map(is_form_only, flight.model.sensors)):
            return run(prepare(flight), engine, stride)
        return run_with_effects(flight, terms, engine=engine, stride=stride, passes=passes, tolerance=tolerance)

    return opened(once, flight)


def opened(once: Callable[[Flight], Journal], flight: Flight) -> Journal:
    """A run; where the gate refuses a sensor for good, another one that weighs what the gate would refuse.

    Readings that are wrong now and then are refused and done with. Readings that are refused for good may be those of
    a sensor that is wrong, or right ones that a lost filter no longer believes, and it would stay lost. A weight of
    threshold / NIS serves both: a hundred sigma off hardly move the state, ten sigma lead it back.
    """
    journal, model = once(flight), flight.model
    shares = refused_shares(journal)
    locked = {name: share for name, share in shares.items() if share > LOCKED_OUT}
    if not locked or model.gate_level is None:
        return journal
    said = [f"{name}: the gate refused {100 * share:.0f} % of the readings" for name, share in locked.items()]
    notes = (*model.notes, f"{', '.join(said)}; doubtful readings were given less weight instead")
    return once(flight.believing(gate_level=None, robust_level=model.robust_level or model.gate_level, notes=notes))


def refused_shares(journal: Journal) -> dict[str, float]:
    """Share of each sensor's judged readings that the gate refused."""
    judged = {name: journal.stream(name).status for name in journal.sensors}
    counts = {name: (np.sum(s == GATED), np.sum((s == GATED) | (s == ACCEPTED))) for name, s in judged.items()}
    return {name: float(refused / total) if total else 0.0 for name, (refused, total) in counts.items()}


def used(journal: Journal, sensor: str) -> IntArray:
    """Rows of a sensor's stream that the filter used."""
    stream = journal.stream(sensor)
    return stream.index[stream.status == ACCEPTED]
