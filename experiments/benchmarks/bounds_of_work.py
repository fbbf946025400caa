"""Whether answers depend on what only bounds the work: numbers of rounds, lengths of lists, steps of differences.

    python -m sinan.experiments.benchmarks.bounds_of_work [CASE ...]

Each constant is halved and doubled by itself, its case is answered again, and both answers are compared with the first:
whether the words are the same, and by how much a number has moved, in its own sigma where it has one, else relative
to itself. A list of numbers is halved and doubled as a whole. What one small case shows it shows of that case.

So are choices: numbers that decide and that nothing gives. Their cases have examples on both sides of them, in words,
and what half and twice say otherwise is printed below.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from importlib import import_module
from sys import modules
from time import process_time
from typing import Any

import numpy as np

from sinan.experiments.benchmarks.bounds_cases import CASES, Answer
from sinan.sensors.bounds import Bounds
from sinan.sensors.errors import InputError

_LOOP = "sinan.experiments.residual_loop."
_POSES = "sinan.calibration.poses.evidence."
_EVIDENCE = "sinan.estimator.evidence."
_INTERVALS = _EVIDENCE + "intervals."
_FLIGHTS = _EVIDENCE + "flights."
_LEVELS = "sinan.calibration.levels."
_RANGES = "sinan.estimator.positioning."
_FILTER = "sinan.estimator.filter."
_CAMERAS = "sinan.calibration.cameras."
#: What is halved and doubled, by case: a module and its names.
BOUNDS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "poses": {
        _POSES + "inversion": ("_MOST_PASSES", "_STEP", "_SETTLED"),
        _POSES + "bias_walk": ("_MOST_KNOTS",),
        _POSES + "gauss_newton": ("_MOST_STEPS", "_MOST_HALVINGS", "_SETTLED"),
        _POSES + "source": ("_ROWS_A_BLOCK", "_WORTH_LEAVING_OUT"),
        _POSES + "wrong_poses": ("_MOST_SHARE", "_ALL_PAIRS"),
        _INTERVALS + "localise": ("_GRID",),
        _INTERVALS + "left_out": ("_RIDGE",),
        _LOOP + "select": ("_MOST_ROUNDS", "MOST_EFFECTS", "MOST_LOCAL"),
        _LOOP + "trace": ("MOST_SUSPECTS",),
        _LOOP + "trials": ("_RELOCATIONS", "SHORTLIST", "SHORTLISTS"),
    },
    "turns": {
        _POSES + "inversion": ("_MOST_PASSES", "_STEP", "_SETTLED"),
        _POSES + "turns": ("_PARTS",),
        "sinan.calibration.poses.least_squares": ("_MOST_EVALUATIONS",),
        _LOOP + "trials": ("_AHEAD",),
    },
    "flight": {
        _FLIGHTS + "passes": ("_MOST_STEPS", "_MOST_HALVINGS"),
        _FLIGHTS + "source": ("_RELOCATION",),
        _EVIDENCE + "noise_left": ("_LAGS",),
        _INTERVALS + "onsets": ("_ONSETS", "_FINER", "_FURTHER", "_WORTH_REFINING"),
        _EVIDENCE + "probes": ("_PLACES", "_FEW", "_PLAYS"),
        _EVIDENCE + "score": ("_TAILS", "_LEAST_GAIN"),
        _INTERVALS + "sudden": ("_MOST", "_SHORTEST_ANSWER"),
        _LOOP + "trace": ("_MOST_FALLS",),
        _LOOP + "trials": ("_AHEAD", "_RELOCATIONS"),
        _LOOP + "select": ("MOST_GIVEN_ERROR", "_MOST_ROUNDS"),
        _EVIDENCE + "sensitivity": ("_AS_ONE",),
        _FILTER + "effect_forms": ("INVERTED",),
    },
    "camera": {
        _CAMERAS + "camera": ("_LONGEST", "_PLAUSIBLE"),
        _CAMERAS + "damped": ("_ROUNDS", "_SETTLED", "_DAMPING", "_LEAST", "_MOST"),
    },
    "lenses": {_CAMERAS + "camera": ("_HALF_ANGLES",)},
    "mounting": {_CAMERAS + "hand_eye": ("_ROUNDS", "_SETTLED", "REACH", "_TURN", "_ARM", "_DELAY", "_BIAS")},
    "ranges": {
        _RANGES + "pseudorange_trace": ("MOST_FAULTS",),
        _RANGES + "pseudoranges": ("SHORTLIST",),
        _RANGES + "location": ("MOST_PASSES", "MOST_EXCLUDED", "COARSE"),
        _RANGES + "integrity": ("LEAST_REDUNDANCY",),
        _RANGES + "point_positioning": ("MOST_ITERATIONS",),
        _RANGES + "steady_fault": ("SHORTLIST",),
    },
    "law": {_RANGES + "noise_fit": ("NEAREST", "FARTHEST", "MOST_EPOCHS")},
    "coarse": {_FILTER + "relinearise": ("PASSES",)},
    "moving": {_FILTER + "alignment_in_motion": ("ROUNDS", "ENOUGH", "HEADINGS", "APART")},
    "outliers": {_INTERVALS + "outliers": ("_NEAR", "_USUAL", "_LEAST_USUAL", "_FACTOR")},
    "doubted": {_INTERVALS + "doubted": ("_BELIEVED", "_ROUNDS")},
    "observability": {_EVIDENCE + "observability": ("SHARED", "SMALL", "PROBES", "BATCH", "MOST_CELLS")},
    "levels": {_LEVELS + "problem": ("MOST",)},
    "sizes": {
        _LEVELS + "problem": ("MOST", "GAINED", "SETTLED", "PARTS", "HALVED", "ROUNDS"),
        _EVIDENCE + "comb": ("FIRST_MOVE",),
    },
    "beside": {_LEVELS + "beside_effects": ("_MOST_STEPS", "_GAINED", "_ON")},
    "long": {_LEVELS + "problem": ("SETTLING",)},
    "slow": {_LEVELS + "fit": ("TRIED",)},
    "shock": {_LEVELS + "upsets": ("IN_A_ROW",)},
    "headings": {_LEVELS + "heading": ("COARSE", "FINE")},
    "brief": {
        _FLIGHTS + "passes": ("_SETTLED", "_SETTLED_DEVIANCE", "_ALIKE", "_BOUND_KNOWN", "_LONGEST_STEP"),
        _EVIDENCE + "sensitivity": ("_BLIND",),
        _FILTER + "effect_forms": ("STEPS", "PROBES", "AT_ONCE"),
    },
    "weak": {_LOOP + "select": ("_PREDICTED",)},
    "walk": {_POSES + "bias_walk": ("_WALKS",)},
    "left": {_LOOP + "remaining": ("_LEAST_BLOCKS", "_LEAST_READINGS", "_LAGS")},
}  # fmt: skip
#: Choices, by case.
CHOICES: Mapping[str, Mapping[str, Sequence[str]]] = {
    "brief": {
        _EVIDENCE + "noise_left": ("_SLOW",),
        _EVIDENCE + "source": ("LINEAR",),
        _FILTER + "smoother": ("RATE_WINDOW",),
        _FILTER + "journal": ("MOST_OF_A_SPAN",),
        _FLIGHTS + "passes": ("_AT_ENDS",),
    },
    "poses": {
        _POSES + "source": ("_PROBE_SHARE",),
        _POSES + "wrong_poses": ("_LEAST_OWN_SHARE",),
        _INTERVALS + "localise": ("_LEAST_PEERS",),
        _EVIDENCE + "score": ("WIDEST_DIRECTION",),
        _LOOP + "shared_ends": ("_SHARED_WITHIN",),
        _LOOP + "trace": ("OBVIOUS",),
    },
    "weak": {_EVIDENCE + "score": ("_PRIOR_DOF",)},
    "sizes": {_LEVELS + "sizes": ("TURNING",)},
    "long": {_LEVELS + "excerpts": ("EXCERPTS", "SECONDS", "MISSING")},
    "turns": {"sinan.calibration.poses.segments": ("MARGIN", "STILL_FACTORS")},
    "flight": {_FLIGHTS + "prediction": ("WINDOW", "EVERY"), _INTERVALS + "onsets": ("_EDGE",)},
    "sold": {_FLIGHTS + "source": ("SOLD",)},
    "assumed": {_FLIGHTS + "source": ("_LESS",)},
    "misfits": {_CAMERAS + "camera": ("_FAR", "_LEAST_VIEWS")},
    "fields": {_LEVELS + "fields": ("BESIDE_STEEL", "ELSEWHERE", "FIELD_STD")},
    "iron": {_LEVELS + "fields": ("NEVER_CALIBRATED",)},
    "kinds": {_LEVELS + "fields": ("INSTANT",)},
    "zeros": {_LEVELS + "levels": ("SAME_ZERO",)},
    "beyond": {_LEVELS + "levels": ("STRAY",)},
    "slow": {_LEVELS + "fit": ("AS_DECLARED",)},
    "hand": {
        _LEVELS + "sizes": ("OF_THE_MOTION",),
        _LEVELS + "levels": ("AXES_STD", "TURNED_STD"),
        _LEVELS + "fit": ("HAND", "WIDER"),
        _FILTER + "imu": ("ROUGH",),
    },
    "headings": {_LEVELS + "heading": ("OUTLIER_LEVEL",)},
    "magnet": {_LEVELS + "preparation": ("MAG_RATE",)},
    "rest": {_LEVELS + "rest": ("SCATTER", "TURN", "MOVED", "FLOOR")},
    "shock": {_LEVELS + "upsets": ("RATE", "ATTITUDE", "VELOCITY", "FIRST", "DOUBTED", "STEPS")},
    "clipped": {_FILTER + "imu": ("_SLOPE", "_SEEN")},
    "gap": {_FILTER + "imu": ("UNBRIDGED",)},
    "unaided": {
        _FILTER + "alignment": ("UNKNOWN_POSITION", "UNKNOWN_VELOCITY"),
        _FILTER + "flight_model": ("LEVEL_SIGMA",),
    },
    "shaky": {_FILTER + "alignment": ("AT_REST",)},
    "moving": {_FILTER + "alignment_in_motion": ("SCALE",)},
    "shaken": {_FILTER + "wiener": ("VEHICLE_BANDWIDTH",)},
    "frozen": {_LOOP + "remaining": ("_LEAST_FAULT",)},
    "left": {_LOOP + "remaining": ("GROSS", "_BURST", "_BLOCKS", "_LEFT_BY_PROBES")},
    "start": {_INTERVALS + "localise": ("_START_UP",)},
    "few": {_INTERVALS + "outliers": ("_LEAST",)},
    "outliers": {_INTERVALS + "outliers": ("_ALONE",)},
    "ranges": {_RANGES + "pseudoranges": ("CHANGING_NOISE", "MULTIPATH_TIME", "MULTIPATH")},
    "steady": {_RANGES + "steady_fault": ("SIZES",)},
}  # fmt: skip


def scaled(value: Any, factor: float) -> Any:
    """A number, or a tuple or table of numbers, times a factor; a count stays a count, of one at least."""
    if isinstance(value, Mapping):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, Bounds):
        return Bounds(factor * value.place, factor * value.speed)
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def answered(case: str, module: str, name: str, factor: float) -> Answer | None:
    """What a case says with one constant scaled; None: no answer could be given."""
    place = import_module(module)
    value = getattr(place, name)
    # modules that import a float by its name have the same object
    places = [one for one in modules.values() if isinstance(value, float) and vars(one).get(name) is value] or [place]
    for one in places:
        setattr(one, name, scaled(value, factor))
    try:
        return CASES[case]()
    except (InputError, IndexError, ValueError):
        return None
    finally:
        for one in places:
            setattr(one, name, value)


def moved(case: str, module: str, name: str, factor: float, usual: Answer) -> float:
    """How far an answer moves with one constant scaled; NaN: none could be given."""
    return _apart(usual, answered(case, module, name, factor))


def _apart(usual: Answer, other: Answer | None) -> float:
    return np.nan if other is None else usual.apart(other)


def main(cases: Sequence[str] = ()) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Print a line a constant; returns the moves at half and at twice the value."""
    found = {}
    for case in cases or CASES:
        CASES[case]()  # compiles
        start = process_time()
        usual = CASES[case]()
        print(
            f"{case}: {', '.join(usual.words)}; {len(usual.values)} numbers, {process_time() - start:.1f} s", flush=True
        )
        for table in (BOUNDS, CHOICES):
            for module, names in table.get(case, {}).items():
                for name in names:
                    others = [answered(case, module, name, factor) for factor in (0.5, 2.0)]
                    half, twice = (_apart(usual, other) for other in others)
                    found[case, module, name] = half, twice
                    at = f"{module.removeprefix('sinan.')}.{name}"
                    print(f"    {at:60} halved {half:.1e}, doubled {twice:.1e}", flush=True)
                    for word, other in zip(("halved", "doubled"), others, strict=True):
                        if other is not None and other.words != usual.words:
                            print(f"        {word}: {', '.join(other.words)}", flush=True)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", choices=[[], *CASES])
    main(parser.parse_args().cases)
