"""What a trace of a measured minute costs, and whether a change of the code has left its answer alone.

    python -m sinan.experiments.benchmarks.trace_speed [NAME ...] [--save FILE.json] [--against FILE.json]

Each minute, and some simulated flights, is prepared and traced; seconds are CPU time of this process, kernels compiled
beforehand. `--save` keeps the reports and the times, `--against` compares them with kept ones: the ratio of the times
and the largest relative difference of two numbers of the reports; words must be the same.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from sinan.experiments.datasets import resolve
from sinan.experiments.report.files import write_json
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording
from sinan.sensors.simulate import simulate

MINUTE = 60.0  # s
_PHANTOM = "phantom4_xsens_dot/Xsens DOT1_D422CD003EBC_20220707_111438.csv"


def minute(log: str, start: float) -> Callable[[], Recording]:
    """What reads a minute of a measured log, from `start` on, s after its first IMU sample."""

    def read() -> Recording:
        recording = resolve(log)
        first = recording.streams["imu"].t[0] + start
        cut = {n: s.rows((s.t >= first) & (s.t < first + MINUTE)) for n, s in recording.streams.items()}
        return recording.replace(streams={name: stream for name, stream in cut.items() if len(stream)})

    return read


def flown(scenario: str, seed: int, **effects: tuple[float, ...]) -> Callable[[], Recording]:
    """What simulates a scenario with effects that its recording does not declare; `mag_current` is mag.current."""
    hidden = {name.replace("_", ".", 1): beta for name, beta in effects.items()}
    return lambda: simulate(load_scenario(scenario), np.random.default_rng(seed), hidden)[0]


CASES: dict[str, Callable[[], Recording]] = {
    "quad, 14 m/s, 100 s": minute("inertialnav_quads/quad106.zip", 100.0),
    "quad, 14 m/s, 400 s": minute("inertialnav_quads/quad106.zip", 400.0),
    "quad, slow, 300 s": minute("inertialnav_quads/quad123.zip", 300.0),
    "quad, laser, 300 s": minute("inertialnav_quads/quadOptFlowLogData.zip", 300.0),
    "F450, 60 s": minute("inertialnav_quads/f450_glitch_log.zip", 60.0),
    "PX4, IMU at 10 Hz": minute("px4_esc_lidar_flight/esc_status_log.ulg", 0.0),
    "walk, 60 s": minute("boulder_walk_imu_2025/gnss_1730.ubx", 60.0),
    "Phantom, 60 s": minute(_PHANTOM, 60.0),
    "Phantom, RTK, 60 s": minute(f"{_PHANTOM}#rtk", 60.0),
    "hand, undisturbed, 60 s": minute("broad_orientation/02_undisturbed_slow_rotation_B.mat", 60.0),
    "hand, magnet, 60 s": minute("broad_orientation/32_disturbed_attached_magnet_1cm.mat", 60.0),
    "robot, LSM9DS0": minute("robot_arm_marg/eV50p/Sequencia1/LSM9DS0.mat", 0.0),
    "figure_eight, mag.current": flown("figure_eight", 1, mag_current=(0.003, 0.0, 0.001)),
    "square, gps.latency": flown("square", 2, gps_latency=(0.2,)),
    "low_pass, sonar.terrain_slope": flown("low_pass", 3, sonar_terrain_slope=(0.05, 0.03)),
    "aerobatics, gyro.scale": flown("aerobatics", 4, gyro_scale=(0.01, 0.01, -0.01)),
}


def traced(read: Callable[[], Recording]) -> dict[str, Any]:
    """CPU seconds of preparing and tracing one recording, and what the report of it says."""
    recording, start = read(), process_time()
    try:
        found = trace_recording(recording)
        seconds = process_time() - start
        document = json.loads(json.dumps(report(found)))
    except InputError as error:
        return {"seconds": process_time() - start, "report": str(error)}
    return {"seconds": seconds, "report": document}


def leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and word of a document, with where it stands."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, f"{place}/{key}")
    else:
        yield place, value


def difference(first: Any, second: Any) -> tuple[float, str]:
    """Largest relative difference of two numbers at the same place, and where; infinite where words differ."""
    one, two = dict(leaves(first)), dict(leaves(second))
    worst = (0.0, "")
    for place in one.keys() | two.keys():
        a, b = one.get(place), two.get(place)
        if a != b:
            if isinstance(a, float) and isinstance(b, float):
                worst = max(worst, (abs(a - b) / max(abs(a), abs(b)), place))
            else:
                worst = max(worst, (np.inf, place))
    return worst


def verdict(document: Any) -> str:
    """Verdict and names of a report, or why there is none."""
    if isinstance(document, str):
        return document
    return f"{document['verdict']}: {', '.join(effect['name'] for effect in document['effects']) or '-'}"


def main(names: Sequence[str] = (), save: Path | None = None, against: Path | None = None) -> dict[str, Any]:
    """Measure and print; returns seconds and report by case."""
    before = json.loads(against.read_text(encoding="utf-8")) if against is not None else {}
    traced(flown("hover", 1))  # compiles
    found: dict[str, Any] = {}
    for name in names or CASES:
        found[name] = traced(CASES[name])
        seconds, line = found[name]["seconds"], verdict(found[name]["report"])
        if name in before:
            apart, place = difference(before[name]["report"], found[name]["report"])
            line += f" | before {before[name]['seconds']:.1f} s, ratio {before[name]['seconds'] / seconds:.2f}"
            line += f" | apart by {apart:.1g} {place}"
        print(f"{name:30} {seconds:7.1f} s  {line}", flush=True)
        if save is not None:
            write_json(save, found)
    print(f"{'median':30} {np.median([one['seconds'] for one in found.values()]):7.1f} s")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[[], *CASES])
    parser.add_argument("--save", type=Path)
    parser.add_argument("--against", type=Path)
    given = parser.parse_args()
    main(given.names, given.save, given.against)
