"""What a worker process needs in memory before it forks its like: modules, and the kernels from their cache.

One second of flight calls everything that a run calls, half a second of CPU that each worker would spend again. The
process that loads this, a fork server, leads a group of its own: one signal ends it and all that it has forked.
"""

from __future__ import annotations

import os

from sinan.experiments.monte_carlo.one_flight import fly
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.manoeuvres import Manoeuvre

if hasattr(os, "setpgrp"):
    os.setpgrp()
fly(load_scenario("hover").replace(manoeuvres=(Manoeuvre("hold", 1.0),)), seed=0, run=0)
