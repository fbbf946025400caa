"""Folders of recordings, and beside them the sealed folder of their answers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sinan.experiments.blind.maker.calibration_recording import make_hand, make_poses, make_turns
from sinan.experiments.blind.maker.catalogue import ACCEL, CAMERA, FLIGHT, HAND, KINDS, MAG, TURNS
from sinan.experiments.blind.maker.drawing import CLASSES, Made, Order, draw_order
from sinan.experiments.blind.maker.flight_recording import make_flight
from sinan.experiments.blind.maker.rough import WORLDS
from sinan.sensors.errors import InputError
from sinan.sensors.files import new_folder, together, write_text
from sinan.sensors.formats.plain import write_recording
from sinan.sensors.recording import Stream

INDEX_FILE, ANSWER_FILE, TRUTH_FILE = "index.json", "answer.json", "truth.csv"
MAKERS = {FLIGHT: make_flight, HAND: make_hand, ACCEL: make_poses, MAG: make_poses, TURNS: make_turns,
          CAMERA: make_flight}  # fmt: skip
#: How often each kind is drawn, where the caller does not say: flights with a camera on request alone.
KIND_SHARES: Mapping[str, float] = {FLIGHT: 0.64, HAND: 0.06, ACCEL: 0.1, MAG: 0.1, TURNS: 0.1, CAMERA: 0.0}
#: How often each class is drawn, where the caller does not say.
CLASS_SHARES: Mapping[str, float] = {"none": 0.4, "one": 0.3, "several": 0.15, "outside": 0.15}


def answers_folder(out: Path) -> Path:
    """Where the answers of the recordings in `out` are: beside it, never in it."""
    return out.parent / (out.name + ".answers")


def run_name(index: int) -> str:
    """Name of a recording, which says nothing but its number (from 1)."""
    return f"run-{index:04d}"


def make(
    out: Path,
    seed: int,
    runs: int,
    kinds: Sequence[str] | Mapping[str, float] | None = None,
    world: str = "declared",
    classes: Sequence[str] | Mapping[str, float] | None = None,
    first: int = 1,
) -> list[Path]:
    """Draw recordings `first` to `first + runs - 1` of a seed into `out`/run-0001 ..., answers into `out`.answers.

    Parameters
    ----------
    out : folder of the recordings; an `index.json` there says kind and sensor of each, which the tracer may know
    seed : of the random numbers; recording k of a seed is the same whatever `runs` and `first`
    kinds : of `catalogue.KINDS`, with or without shares; default `KIND_SHARES`
    world : "declared", "rough" or "mixed" (each half of the time)
    classes : of `drawing.CLASSES`, with or without shares; default `CLASS_SHARES`

    Returns
    -------
    the folders of the recordings

    Raises
    ------
    InputError : an unknown kind, world or class; a folder that cannot be written
    """
    kind_shares = shares("kinds", kinds, KIND_SHARES, KINDS)
    class_shares = shares("classes", classes, CLASS_SHARES, CLASSES)
    if world not in (*WORLDS, "mixed"):
        raise InputError("world", repr(world), ", ".join(WORLDS) + " or mixed")
    folders = []
    for index in range(first, first + runs):
        folders.append(make_one(Path(out), seed, index, kind_shares, world, class_shares))
    write_index(Path(out))
    return folders


def make_one(
    out: Path, seed: int, index: int, kinds: Mapping[str, float], world: str, classes: Mapping[str, float]
) -> Path:
    """Recording `index` of a seed: its folder and its answer."""
    rng = np.random.default_rng([seed, index])
    kind = str(rng.choice(list(kinds), p=normal(kinds)))
    what = str(rng.choice(list(classes), p=normal(classes)))
    rough = bool(rng.uniform() < 0.5) if world == "mixed" else world == "rough"
    order = draw_order(rng, kind, what, rough)
    made = MAKERS[kind](rng, order, run_name(index))
    folder = out / run_name(index)
    sealed = answers_folder(out) / run_name(index)
    with together():
        write_recording(made.recording, folder)
        write_answer(sealed, seed, index, what, order, made)
    return folder


def write_answer(sealed: Path, seed: int, index: int, what: str, order: Order, made: Made) -> None:
    """`answer.json` and, where something moves, `truth.csv`."""
    with new_folder(sealed, [TRUTH_FILE, ANSWER_FILE]) as beside:
        if made.truth is not None:
            write_table(beside / TRUTH_FILE, made.truth)
        content = json.dumps(answer(seed, index, what, order, made), indent=1)
        (beside / ANSWER_FILE).write_text(content, encoding="utf-8")


def answer(seed: int, index: int, what: str, order: Order, made: Made) -> dict[str, object]:
    """What the recording hides, as JSON."""
    ends = [stream.t[[0, -1]] for stream in made.recording.streams.values()]
    outside = made.outside
    return {
        "run": run_name(index),
        "seed": seed,
        "kind": order.kind,
        "sensor": order.sensor or None,
        "world": "rough" if order.rough else "declared",
        "class": what,
        "style": made.style,
        "duration": float(max(end[1] for end in ends) - min(end[0] for end in ends)),
        "effects": [
            {
                "name": effect.name,
                "beta": [float(b) for b in effect.beta],
                "interval": None if effect.interval is None else list(effect.interval),
                "wrong": list(effect.wrong),
            }
            for effect in made.hidden
        ],
        "outside": None if outside is None else {
            "name": outside.name,
            "streams": list(outside.streams),
            "acceptable": list(outside.acceptable),
            "intervals": [list(interval) for interval in outside.intervals],
            "strength": made.strength,
        },
        "also_true": list(made.also_true),
        "rough": {
            "noise_factor": dict(made.rough.factors),
            "outliers": dict(made.rough.outliers),
            "jitter": dict(made.rough.jitter),
            "gaps": {name: [list(gap) for gap in gaps] for name, gaps in made.rough.gaps.items()},
            "gps_colour": made.rough.colour,
        },
    }  # fmt: skip


def write_index(out: Path) -> None:
    """`index.json`: what the tracer is told, which is what a person with the recording in hand would know."""
    index = {}
    for path in sorted(answers_folder(out).glob(f"*/{ANSWER_FILE}")):
        found = json.loads(path.read_text(encoding="utf-8"))
        if (out / found["run"]).is_dir():
            index[found["run"]] = {"kind": "flight" if found["kind"] in (FLIGHT, HAND, CAMERA) else "poses",
                                   "sensor": found["sensor"]}  # fmt: skip
    write_text(out / INDEX_FILE, json.dumps(index, indent=1))


def write_table(path: Path, stream: Stream) -> None:
    """A stream as CSV, to nine decimals."""
    import pandas as pd

    pd.DataFrame({"t": stream.t, **stream.columns}).round(9).to_csv(path, index=False, lineterminator="\n")


def shares(
    where: str, asked: Sequence[str] | Mapping[str, float] | None, default: Mapping[str, float], known: Sequence[str]
) -> dict[str, float]:
    """Names with their shares; names alone have those of the default, so that a subset keeps its proportions."""
    if asked is None:
        return dict(default)
    found = dict(asked) if isinstance(asked, Mapping) else {name: default.get(name, 0.0) or 0.1 for name in asked}
    for name in found:
        if name not in known:
            raise InputError(where, repr(name), "of " + ", ".join(known))
    if not found or sum(found.values()) <= 0.0:
        raise InputError(where, "none", "at least one of " + ", ".join(known))
    return found


def normal(weights: Mapping[str, float]) -> list[float]:
    """Shares that add to one."""
    total = sum(weights.values())
    return [weight / total for weight in weights.values()]
