"""Sensitivities to the steps of a grid, kept for every fit about which they are the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from experiments.residual_loop.onsets import Rows, Step
from sensors.arrays import FloatArray

#: Rows times columns that are kept.
_MOST_ELEMENTS = 3e7
#: Two motions whose attitudes differ by less than this have the same sensitivities, to this share [rad].
_SAME_ATTITUDE = 0.01


@dataclass
class StepColumns:
    """Columns by step, for one set of rows and one motion: a step's mark depends on a fit by the attitude alone.

    Attributes
    ----------
    grid : (m,) onsets whose columns are kept [s]
    """

    grid: FloatArray
    _rows: Rows | None = None
    _attitude: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    _columns: dict[Step, FloatArray] = field(default_factory=dict)

    def of(
        self,
        rows: Rows,
        attitude: FloatArray,
        steps: Sequence[Step],
        computed: Callable[[Sequence[Step]], Sequence[FloatArray]],
    ) -> FloatArray:
        """(r, .) sensitivities to the steps, in their order.

        Parameters
        ----------
        rows : of the fit; its `wanted` is not looked at
        attitude : (N, 4) of the fit's motion
        computed : gives what is not kept yet, (r, size) a step
        """
        if not self._are_of(rows, attitude):
            self._rows, self._attitude, self._columns = rows, attitude, {}
        missing = [step for step in steps if step not in self._columns]
        new = dict(zip(missing, computed(missing), strict=True)) if missing else {}
        for step, columns in new.items():
            if step[1] in self.grid and sum(c.size for c in self._columns.values()) + columns.size < _MOST_ELEMENTS:
                self._columns[step] = np.ascontiguousarray(columns)
        parts = [new[step] if step in new else self._columns[step] for step in steps]
        return np.hstack(parts) if parts else np.zeros((len(rows.white), 0))

    def _are_of(self, rows: Rows, attitude: FloatArray) -> bool:
        if self._rows is None or not np.array_equal(self._rows.t, rows.t) or len(self._attitude) != len(attitude):
            return False
        if not np.array_equal(self._rows.sensor, rows.sensor):
            return False
        cosines = np.abs(np.sum(self._attitude * attitude, axis=1))
        return bool(np.min(cosines, initial=1.0) > np.cos(0.5 * _SAME_ATTITUDE))
