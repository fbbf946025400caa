"""Whether a filter knows how wrong it is: NIS of every sensor and NEES of every state, over several flights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from sinan.estimator.evidence.consistency import block_dof, chi_square, nees_by_block
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.answers.estimates import Estimate
from sinan.experiments.estimate import true_states
from sinan.sensors.window import between

#: Risk of any false alarm, over all sensors and blocks of states together.
FALSE_ALARM = 1e-3


def assert_consistent(
    estimates: Estimate | Iterable[Estimate], *, false_alarm: float = FALSE_ALARM, states: bool = True
) -> None:
    """Assert that innovations and errors are as large as the filter expects.

    NIS, nu' S^-1 nu, is summed over the readings of each sensor that were used, and NEES, e' P^-1 e, over the flights
    for each block of states at the last stamp of the truth. Of a filter whose model is right both are chi-square, so
    that their mean a degree of freedom lies about 1 in an interval that follows from their number. Innovations of one
    flight are independent of each other only if the model is right; states of one flight at different instants never
    are, so that of each flight the end alone counts.

    Parameters
    ----------
    estimates : of flights with different seeds; the more there are, the smaller an error is found
    false_alarm : risk of failing where all is well, over everything that is asked together
    states : also ask the errors of the states; needs flights with a truth

    Raises
    ------
    AssertionError : names each sensor and block outside its interval, and which way
    ValueError : no flight, or one without a truth of all states

    Examples
    --------
    >>> import sinan
    >>> flights = [sinan.simulate("square", seed=seed) for seed in range(3)]
    >>> sinan.testing.assert_consistent([sinan.estimate(flight) for flight in flights])
    """
    flights = [estimates] if isinstance(estimates, Estimate) else list(estimates)
    if not flights:
        raise ValueError("`estimates` is empty; expected one or more results of `sinan.estimate`")
    sums = {f"NIS of {name}": pair for name, pair in _innovations(flights).items()}
    if states:
        sums |= {f"NEES of {name}": pair for name, pair in _errors(flights).items()}
    level = 1.0 - false_alarm / len(sums)
    wrong = []
    for name, (total, dof) in sums.items():
        found = chi_square(total, dof, level)
        if dof and not found.consistent:
            low, high = found.interval
            which = "larger" if found.mean > high else "smaller"
            wrong.append(
                f"{name}: {found.mean:.3f} a degree of freedom (of {dof}); expected {low:.3f} to {high:.3f}: "
                f"{'innovations' if name.startswith('NIS') else 'errors'} are {which} than the filter expects"
            )
    if wrong:
        raise AssertionError("\n".join(wrong))


def _innovations(flights: list[Estimate]) -> dict[str, tuple[float, int]]:
    """Sum of NIS and of the components that tell something by sensor, over the readings that were used."""
    sums: dict[str, tuple[float, int]] = {}
    for flight in flights:
        journal = flight.journal
        for s, name in enumerate(journal.sensors):
            mine = journal.accepted & (journal.sensor == s)
            total, dof = sums.get(name, (0.0, 0))
            sums[name] = total + float(np.sum(journal.nis[mine])), dof + int(np.sum(journal.freedom[mine]))
    return sums


def _errors(flights: list[Estimate]) -> dict[str, tuple[float, int]]:
    """Sum of NEES at the last stamp of the truth and of degrees of freedom by block of states."""
    sums: dict[str, tuple[float, int]] = {}
    for flight in flights:
        found = _nees(flight)
        dofs = block_dof(flight.model.layout, flight.model.translation)
        for name, value in found.items():
            total, dof = sums.get(name, (0.0, 0))
            sums[name] = total + value, dof + dofs[name]
    return sums


def _nees(flight: Estimate) -> Mapping[str, float]:
    """NEES by block at the last stamp of the truth, where the filter is stopped again: a journal has the covariance of
    its end alone.

    Raises
    ------
    ValueError : no truth in the flight's own axes, or one that does not know every state
    """
    truth, layout, translation = flight.reference, flight.model.layout, flight.model.translation
    expected = "expected a simulated flight, or `states=False`"
    if truth is None or not truth.same_north or not len(truth.reference):
        raise ValueError(f"{flight.recording.name}: no truth; {expected}")
    last = truth.reference.rows(slice(-1, None))
    asked = {name for name in layout.names if translation or name not in ("position", "velocity")}
    true, known = true_states(flight.journal, last)
    if not asked <= known:
        raise ValueError(
            f"{flight.recording.name}: the truth does not know {', '.join(sorted(asked - known))}; {expected}"
        )
    inputs = flight.journal.run
    assert isinstance(inputs, RunInputs)
    part = between(inputs.recording, -np.inf, float(np.nextafter(last.t[0], np.inf)))
    stopped = run_filter(Flight(part, flight.model), engine=flight.document["engine"])
    return nees_by_block(layout.difference(true[0], stopped.x_end), stopped.P_end, layout, translation)
