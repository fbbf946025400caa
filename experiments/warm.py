"""What a worker process needs in memory before it forks its like: imports alone, no work."""

from __future__ import annotations

import estimator.compiled
import estimator.engine_numba
import experiments.monte_carlo
import experiments.one_flight

__all__ = ["estimator", "experiments"]
