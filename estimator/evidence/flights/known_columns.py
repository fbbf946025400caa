"""Sensitivities to effects that are not in a fit, kept for the fits that were asked last."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import numpy as np

from sinan.estimator.evidence.source import Fit
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import Effect

#: Fits whose columns are kept, and rows times columns of each that are: 8 bytes each = 80 MB a fit.
_MOST_FITS, _MOST_ELEMENTS = 3, 1e7


class KnownColumns:
    """Columns by effect of the last fits.

    They are those of one fit alone: effects in it change the attitude, the filter's gains and, as a slope of the ground
    does, the derivative of a reading by the state.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[Fit, dict[Hashable, FloatArray]]] = []

    def of(
        self,
        fit: Fit,
        grid: FloatArray,
        effects: Sequence[Effect],
        computed: Callable[[Sequence[Effect]], Sequence[FloatArray]],
    ) -> list[FloatArray]:
        """(r, size) sensitivities to each of the effects.

        Parameters
        ----------
        grid : (m,) onsets at which those of an effect over an interval are kept [s]
        computed : gives what is not kept
        """
        kept, keys = self._columns_of(fit), [_key(entry) for entry in effects]
        missing = {key: entry for key, entry in zip(keys, effects, strict=True) if key not in kept}
        new = dict(zip(missing, computed(list(missing.values())), strict=True)) if missing else {}
        for key, columns in new.items():
            interval = missing[key].interval
            lasting = interval is None or interval[0] in grid
            if lasting and sum(c.size for c in kept.values()) + columns.size < _MOST_ELEMENTS:
                kept[key] = np.ascontiguousarray(columns)
        return [new[key] if key in new else kept[key] for key in keys]

    def _columns_of(self, fit: Fit) -> dict[Hashable, FloatArray]:
        for known, columns in self._kept:
            if known.is_that_of(fit):
                return columns
        self._kept = [(fit, {}), *self._kept[: _MOST_FITS - 1]]
        return self._kept[0][1]


def _key(entry: Effect) -> Hashable:
    """What tells an effect from others about one fit: probes, and effects over an interval, are declared anew each
    time.
    """
    return entry.name, entry.interval
