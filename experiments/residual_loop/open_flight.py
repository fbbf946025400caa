"""From a flight to the source that the loop asks: its noise levels, declared or estimated, and its filter."""

from __future__ import annotations

from sinan.experiments.residual_loop.flight import FlightSource
from sinan.sensors.recording import Recording


def flight_source(recording: Recording, slow_error: bool = True) -> FlightSource:
    """The source of a flight; what the recording does not declare of noise, field and heading is taken from the log.

    The preparation is that of `sinan estimate`, but that this leaves out what the loop is to explain, readings of a
    magnetometer about another hard iron; what it took is in the notes of the source's recording. From a coarse first
    attitude readings are linear about the smoothed motion: a filter that linearises at its own estimates would
    blame `mag.declination` (docs/notes/filter_consistency.md).

    Parameters
    ----------
    slow_error : see `FlightSource`
    """
    from sinan.calibration.levels.preparation import as_declared, is_declared, prepared
    from sinan.estimator.filter.relinearise import is_coarse

    declared = is_declared(recording)
    if declared:
        ready = as_declared(recording)
        model = ready.model
    else:
        ready = prepared(recording, late=False)
        model = ready.model
        slow_error = False
    coarse = is_coarse(ready.recording, model)
    return FlightSource(ready.recording, model.replace(relinearise=coarse), slow_error, None if declared else recording)
