"""`pseudorange.satellite_fault`: one satellite's range is off, and may walk away."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 2) one and the elapsed time [s] for the rows of the faulty satellite, zero for all others.

    The covariate `faulty` is (n,) 1 on those rows; `elapsed` counts from the first epoch of the recording.
    """
    faulty, elapsed = motion.covariates["faulty"], motion.covariates["elapsed"]
    return np.stack([faulty, faulty * elapsed], axis=-1)[:, None, :]


EFFECT = Effect(
    name="pseudorange.satellite_fault",
    stream="pseudorange",
    summary="The pseudoranges of one satellite are off by an offset that may grow with time.",
    enters="range of one satellite += offset + drift t",
    physics=(
        "A clock that jumps or drifts, a wrong upload or a reflected signal shifts one satellite against all others: "
        "range error b0 + b1 t. The satellite is searched. Errors within the accuracy that the satellite promises, and "
        "what the atmosphere leaves behind, are not called a fault."
    ),
    source="B. W. Parkinson, P. Axelrad, Navigation 35 (1988) 255; W. Baarda, NGC Publications on Geodesy 2-5 (1968)",
    parameters=(Parameter("offset", "m", 100.0), Parameter("drift", "m/s", 1.0)),
    needs=("faulty", "elapsed"),
    regressor=regressor,
    kinds=frozenset({"pseudoranges"}),
    separates="more satellites",
)
