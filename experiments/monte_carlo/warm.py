"""What a worker process needs in memory before it forks its like: modules, and the kernels from their cache.

One second of flight calls everything that a run calls, half a second of CPU that each worker would spend again.
"""

from __future__ import annotations

from sinan.experiments.monte_carlo.one_flight import fly
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.manoeuvres import Manoeuvre

fly(load_scenario("hover").replace(manoeuvres=(Manoeuvre("hold", 1.0),)), seed=0, run=0)
