"""What an effect leaves in the innovations, and that it is gone once it is in the model.

`python docs/make/effect_figures.py [NAME ...]`; without a name all. Each effect is put into the scenario that shows it
(seed 1) at twice its plausible size, or a quarter of that, and so on, where the figure could not show it. The filter
runs without it and with it in its model, and the whitened innovations of the stream that shows it most are drawn, of a
camera in its picture. What innovations do not show is drawn as `residual_figures.py` says.
Figures and their numbers are kept in `docs/figures/effects`; the pages of the site show them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from drawing import AFTER, BAND, BEFORE, keep, panels
from matplotlib.figure import Figure
from residual_figures import DRAWN, pictures

from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.journal import Journal, StreamJournal
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios import load_scenario, parse_effect, with_sensors
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate

FOLDER = Path(__file__).parents[1] / "figures" / "effects"
NUMBERS = FOLDER / "numbers.json"
SIZE = 2.0  # plausible sizes, their signs in turn
FLIGHT = "aerobatics"  # for what only poses show else
ONSET, LENGTH = 20.0, 6.0  # s
ONSET_LOW = 60.0  # s, of a sonar: until then the flight is mostly above its range
LARGEST = 60.0  # NIS a degree of freedom that a figure can show
#: The square with a camera: what `sinan simulate square flight --sensors accel,gyro,mag,baro,gps,camera` flies.
WITH_CAMERA = ("accel", "gyro", "mag", "baro", "gps", "camera")
_SIGNS = (1.0, -1.0) * 5
STREAMS = ("mag", "gps", "baro", "sonar", "laser", "base")
CAMERA = "camera"


def draw(name: str) -> dict[str, object]:
    """Draw one effect; what its caption says."""
    effect = CATALOGUE[name]
    if name in DRAWN:
        drawn = DRAWN[name](name)
        keep(drawn.figure, FOLDER / f"{name}.png")
        rms = [float(f"{value:.3g}") for value in drawn.rms]
        return {"beta": drawn.beta, "scenario": drawn.scenario, "rms": rms, "unit": drawn.unit, **drawn.more}
    scenario = _scenario(effect)
    stream, plain, beta = _sized(effect, scenario)
    recording = plain.run.recording  # type: ignore[attr-defined]
    journals = [plain]
    if not name.endswith(".outliers"):
        there = effect.over(*_interval(effect)) if effect.localised is not None else effect
        journals.append(run_filter(Flight.of(recording), {there: np.array(beta)}))
    parts = [journal.stream(stream) for journal in journals]
    nis = [float(f"{_nis(part):.3g}") for part in parts]
    if stream == CAMERA:
        figure, rms = pictures(effect, np.array(beta), *_flown(effect, scenario, beta))
        keep(figure, FOLDER / f"{name}.png")
        return {
            "beta": beta, "scenario": scenario.name, "stream": stream, "nis_per_dof": nis,
            "rms": [float(f"{value:.3g}") for value in rms], "unit": "pixel",
        }  # fmt: skip
    component = int(np.argmax(np.nanmean(_seen(parts[0]) ** 2, axis=0)))
    keep(_figure(parts, component), FOLDER / f"{name}.png")
    return {
        "beta": beta, "scenario": scenario.name, "stream": stream, "component": component, "nis_per_dof": nis,
    }  # fmt: skip


def _sized(effect: Effect, scenario: Scenario) -> tuple[str, Journal, list[float]]:
    """The stream that shows it, the plain filter's journal, beta: halved until the figure can show it."""
    size = SIZE
    while True:
        beta = [float(f"{size * p.plausible * sign:.3g}") for p, sign in zip(effect.parameters, _SIGNS, strict=False)]
        recording, _ = _flown(effect, scenario, beta)
        journal = run_filter(Flight.of(recording))
        stream = _stream(effect, journal)
        if _nis(journal.stream(stream)) < LARGEST:
            return stream, journal, beta
        size /= 4.0


def _flown(effect: Effect, scenario: Scenario, beta: list[float]) -> tuple[Recording, Stream]:
    """The scenario with the effect in it, and its truth."""
    start, end = _interval(effect)
    onset = "" if effect.localised is None else f"@{start:g}" + (f":{end:g}" if np.isfinite(end) else "")
    present = parse_effect(f"{effect.name}={','.join(map(str, beta))}{onset}")
    return simulate(scenario, np.random.default_rng(1), [present])


def _interval(effect: Effect) -> tuple[float, float]:
    """From when to when, of what does not last."""
    start = ONSET_LOW if effect.stream == "sonar" else ONSET
    return start, start + LENGTH if effect.name.endswith(".transient") else float("inf")


def _nis(part: StreamJournal) -> float:
    return float(np.nanmean(_seen(part) ** 2))


def _scenario(effect: Effect) -> Scenario:
    if effect.stream == CAMERA:
        return with_sensors(load_scenario("square"), WITH_CAMERA)
    return load_scenario(FLIGHT if load_scenario(effect.scenario).kind == "poses" else effect.scenario)


def _stream(effect: Effect, journal: Journal) -> str:
    """The effect's own, or of what enters the IMU that which suffers most from its absence."""
    if effect.stream == CAMERA:
        return CAMERA
    there = [name for name in STREAMS if name in journal.sensors]
    if effect.stream in there:
        return effect.stream
    return max(there, key=lambda name: _nis(journal.stream(name)))


def _seen(part: StreamJournal) -> np.ndarray:
    return part.white[np.isfinite(part.nis)]


def _figure(parts: list[StreamJournal], component: int) -> Figure:
    figure, axes = panels(len(parts), sharey=True)
    axes = axes[0]
    titles = ("without the effect in the model", "with it")
    for one, part, colour, title in zip(axes, parts, (BEFORE, AFTER), titles, strict=False):
        seen = np.isfinite(part.nis)
        one.axhspan(-2.0, 2.0, color=BAND, lw=0)
        one.plot(part.t[seen], part.white[seen, component], ".", ms=2.5, color=colour)
        one.set_title(title, fontsize=9, loc="left")
        one.set_xlabel("time [s]")
    most = float(np.nanmax(np.abs(parts[0].white[:, component])))
    axes[0].set_ylim(-max(1.05 * min(most, 40.0), 5.0), max(1.05 * min(most, 40.0), 5.0))
    axes[0].set_ylabel("innovation [sigma]")
    return figure


def main(names: list[str]) -> None:
    """Draw those, or all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.exists() else {}
    for name in names or CATALOGUE:
        numbers[name] = draw(name)
        sys.stdout.write(f"{name}: {numbers[name]}\n")
        sys.stdout.flush()
        kept = {key: numbers[key] for key in CATALOGUE if key in numbers}
        NUMBERS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
