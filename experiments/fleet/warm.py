"""What the process of a log needs in memory before it is forked: what any process needs, readers, the trace, its page.

Two seconds of CPU that each log would spend again.
"""

from __future__ import annotations

import matplotlib.figure  # noqa: F401
import pandas  # noqa: F401

from sinan.experiments.answers import traces  # noqa: F401
from sinan.experiments.autopilots import findings  # noqa: F401
from sinan.experiments.datasets import inputs  # noqa: F401
from sinan.experiments.monte_carlo import warm  # noqa: F401
from sinan.experiments.report import trace_page  # noqa: F401
from sinan.experiments.residual_loop import run  # noqa: F401
from sinan.experiments.review import of_answers  # noqa: F401
