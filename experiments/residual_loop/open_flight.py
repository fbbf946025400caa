"""From a flight to the source that the loop asks: its noise levels, declared or estimated, and its filter."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sinan.estimator.evidence.flights.open_levels import OpenLevels
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.filter.flight import Flight
from sinan.sensors.recording import Recording


def flight_source(recording: Recording, slow_gps: bool = True) -> FlightSource:
    """The source of a flight; what the recording does not declare of noise, field and heading is taken from the log.

    The preparation is that of `sinan estimate`, but that sizes of the noise are those beside effects, that stamps are
    not taken to be late, which the loop is to find, and that a receiver may err for seconds though its noise is
    declared. From a coarse first attitude readings are linear about the smoothed motion: a filter that linearises at
    its own estimates would blame `mag.declination` (docs/notes/filter_consistency.md).

    Parameters
    ----------
    slow_gps : see `as_declared`
    """
    from sinan.calibration.levels.openness import open_levels
    from sinan.calibration.levels.preparation import as_declared, is_declared, near_level_or_a_place, prepared

    declared = is_declared(recording)
    if not declared:
        ready = prepared(recording, late=False, effects=lambda flight: source_of(flight, recording).explained_by_all)
    elif "gps" in recording.streams:
        ready = as_declared(recording, slow_gps)
    else:
        ready = near_level_or_a_place(recording)
    return source_of(ready.flight, None if declared else recording, partial(open_levels, ready.levels, ready.flight))


def source_of(
    flight: Flight, logged: Recording | None, open_levels: Callable[[], OpenLevels | None] | None = None
) -> FlightSource:
    """The source of a flight whose levels are known; see `FlightSource`."""
    from sinan.estimator.filter.relinearise import is_coarse

    return FlightSource(flight.believing(relinearise=is_coarse(flight)), logged, open_levels)
