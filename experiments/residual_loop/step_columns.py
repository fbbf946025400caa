"""Sensitivities to the steps of a grid, kept for the fits that were asked last."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from experiments.residual_loop.onsets import Step
from experiments.residual_loop.source import Fit
from sensors.arrays import FloatArray

#: Fits whose columns are kept, and rows times columns of each that are.
_MOST_FITS, _MOST_ELEMENTS = 3, 1e7


class StepColumns:
    """Columns by step of the last fits.

    They are those of one fit alone: effects in it change the attitude, the filter's gains and, as a slope of the ground
    does, the derivative of a reading by the state.
    """

    def __init__(self) -> None:
        self._kept: list[tuple[Fit, dict[Step, FloatArray]]] = []

    def of(
        self,
        fit: Fit,
        grid: FloatArray,
        steps: Sequence[Step],
        computed: Callable[[Sequence[Step]], Sequence[FloatArray]],
    ) -> list[FloatArray]:
        """(r, size) sensitivities to each of the steps.

        Parameters
        ----------
        grid : (m,) onsets whose columns are kept [s]
        computed : gives what is not kept
        """
        kept = self._columns_of(fit)
        missing = [step for step in steps if step not in kept]
        new = dict(zip(missing, computed(missing), strict=True)) if missing else {}
        for step, columns in new.items():
            if step[1] in grid and sum(c.size for c in kept.values()) + columns.size < _MOST_ELEMENTS:
                kept[step] = np.ascontiguousarray(columns)
        return [new[step] if step in new else kept[step] for step in steps]

    def _columns_of(self, fit: Fit) -> dict[Step, FloatArray]:
        for known, columns in self._kept:
            if known.is_that_of(fit):
                return columns
        self._kept = [(fit, {}), *self._kept[: _MOST_FITS - 1]]
        return self._kept[0][1]
