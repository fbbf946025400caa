"""The result as JSON has it, and in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sinan.experiments.bias_observability.directions import (
    amount_of,
    block_of,
    figures,
    listed,
    name_of,
    shown,
    unit_in_words,
    unit_of,
)
from sinan.experiments.bias_observability.segments import MOST_SEGMENTS
from sinan.experiments.bias_observability.study import BiasStudy, Study, Weakness
from sinan.sensors.arrays import FloatArray
from sinan.sensors.registry import BySensor

#: A further sensor is advised where it leaves at most this share of the sigma of a state at the end.
WORTH = 0.7
#: Instants of the curves in the JSON.
MOST_INSTANTS = 200
NAMES = BySensor(lambda entry: entry.title, after={"level": "level assumption", "zero_rate": "rest"})


def document(study: Study) -> dict[str, Any]:
    """The whole result, SI units (angles rad), states by the labels of the estimator."""
    found, case = study.found, study.case
    rows = np.unique(np.linspace(0, len(study.course.t) - 1, MOST_INSTANTS).astype(np.int64))
    return {
        "format": 1,
        "recording": case.name,
        "linearised_along": f"{case.along} motion",
        "duration": float(found.t[-1] - found.t[0]),
        "readings": {name: found.counts[name] for name in case.aboard},
        "imagined": [sensor.name for sensor in case.imagined],
        "states": list(found.labels),
        "rank": study.rank,
        "halved_directions": study.strong,
        "singular_values": {
            "prior": study.singular_values.tolist(),
            "physical": study.physical_values.tolist(),
            "physical_units": {label: unit_of(label) or "1" for label in found.labels},
        },
        "weak_directions": [weakness_of(weakness, study) for weakness in study.weaknesses],
        "biases": {state.label: state_of(state) for state in study.biases},
        "other_states": {state.label: state_of(state) for state in study.states if state not in study.biases},
        "manoeuvres": [{"name": s.name, "start": s.start, "stop": s.stop} for s in case.segments],
        "curves": {
            "t": study.course.t[rows].tolist(),
            "sigma": {label: study.course.sigma[0, rows, i].tolist() for i, label in enumerate(found.labels)},
        },
        "subsets": [
            {"sensors": list(subset), "posterior_over_prior": by_label(found.labels, study.left[k])}
            for k, subset in enumerate(study.subsets)
        ],
        "base_receiver": base_of(study),
        "catalogue": catalogue_of(study),
        "advice": advice(study),
        "notes": list(case.notes),
    }


def by_label(labels: Sequence[str], values: FloatArray) -> dict[str, float]:
    """Values by the label of their state."""
    return {label: float(value) for label, value in zip(labels, values, strict=True)}


def weakness_of(weakness: Weakness, study: Study) -> dict[str, Any]:
    """One weak direction."""
    direction = weakness.direction
    return {
        "states": list(direction.states),
        "title": direction.title,
        "sentence": direction.sentence,
        "sensors": list(weakness.sensors),
        "information": direction.information,
        "posterior_over_prior": direction.left,
        "components": by_label(study.found.labels, direction.v),
        "removed_by_sensors": [list(subset) for subset in weakness.removed_by],
        "removed_by_flying": [name for name, _ in flown_by(weakness, study)],
    }


def state_of(state: BiasStudy) -> dict[str, Any]:
    """One state."""
    return {
        "prior": state.prior,
        "prior_at_end": state.carried,
        "posterior": state.posterior,
        "posterior_over_prior": state.left,
        "halved_after": state.halved_after,
        "bits": dict(state.bits),
        "brought_by": state.brought_by,
        "confused_with": {"state": state.confused_with[0], "correlation": state.confused_with[1]},
        "seen_with": [list(subset) for subset in state.needs],
    }


def base_of(study: Study) -> dict[str, Any] | None:
    """What the base receiver adds: sigma of GPS bias and position at the end without it and with it."""
    if "base" not in study.found.readings:
        return None
    without, with_base = base_places(study)
    sigma = study.course.sigma[:, -1]
    touched = [i for i, label in enumerate(study.found.labels) if block_of(label) in ("b_gps", "position")]
    return {
        "aboard": "base" in study.case.aboard,
        "rate": study.case.rates["base"],
        "sigma": {
            study.found.labels[i]: {"without": float(sigma[without, i]), "with": float(sigma[with_base, i])}
            for i in touched
        },
    }


def base_places(study: Study) -> tuple[int, int]:
    """Rows of the subsets with all other sensors, without and with the base receiver."""
    others = tuple(name for name in study.case.aboard if name != "base")
    return study.place_of(others), study.place_of((*others, "base"))


def catalogue_of(study: Study) -> dict[str, Any] | None:
    """What the flights of the catalogue leave."""
    catalogue = study.catalogue
    if catalogue is None:
        return None
    return {
        "horizon": catalogue.horizon,
        "posterior_over_prior": {
            name: by_label(catalogue.labels, catalogue.left[k]) for k, name in enumerate(catalogue.names)
        },
        "best": {label: catalogue.best(label)[0] for label in catalogue.labels if label.startswith("b_")},
    }


def flown_by(weakness: Weakness, study: Study) -> tuple[tuple[str, float], ...]:
    """Flights of the catalogue that show a direction with the sensors aboard."""
    return () if study.catalogue is None else study.catalogue.shows(weakness.direction.v)


def sensors_in_words(sets: Sequence[Sequence[str]]) -> str:
    """`GPS with laser, or GPS with sonar`; what the sets share comes once where it can."""
    if not sets:
        return "no set of these sensors"
    if all(len(one) == 0 for one in sets):
        return "any"
    texts = [" with ".join(NAMES[name] for name in one) for one in sets]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} or {texts[-1]}"


def advice(study: Study) -> list[str]:
    """For each weak direction of all sensors together: which sensor or which flight removes it."""
    lines = []
    for weakness in study.weaknesses:
        if weakness.sensors != study.case.aboard:
            continue
        title, flown, sensor = weakness.direction.title, flown_by(weakness, study), sensor_that_removes(weakness, study)
        if sensor is not None:
            lines.append(f"{title}: {sensor}")
        elif flown:
            name, left = flown[0]
            assert study.catalogue is not None
            here = 100.0 * weakness.direction.left
            share = f"leave {100.0 * left:.1f} % of the prior sigma along it, this flight {here:.0f} %"
            what = study.catalogue.summaries[study.catalogue.names.index(name)].rstrip(".")
            what = what if what[1:2].isupper() else f"{what[0].lower()}{what[1:]}"
            flight = f"fly as in the scenario `{name}` ({what})"
            lines.append(f"{title}: {flight}; {study.catalogue.horizon:.0f} s of that {share}")
        elif "gps" not in study.case.aboard and all(
            block_of(label) in ("position", "velocity") for label in weakness.direction.main
        ):
            lines.append(f"{title}: needs a GPS, there is none aboard")
        else:
            verb = "separates them" if len(weakness.direction.main) > 1 else "shows it"
            lines.append(f"{title}: none of these sensors and no flight of the catalogue {verb}")
    return lines


def sensor_that_removes(weakness: Weakness, study: Study) -> str | None:
    """Which imagined sensor removes a direction, and what it does to a state in it; None: none, or to little use."""
    aboard, found = study.case.aboard, study.found
    best: tuple[float, str] | None = None
    for more in {tuple(sorted(set(subset) - set(aboard))) for subset in weakness.removed_by}:
        k = study.place_of((*aboard, *more))
        for label in weakness.direction.main:
            before, after = (float(study.course.sigma[row, -1, found.index(label)]) for row in (0, k))
            change = f"from {amount_of(label, shown(label, before))} to {amount_of(label, shown(label, after))}"
            names = listed([NAMES[name] for name in more])
            text = f"needs {names}; it takes the sigma of {name_of(label)} at the end {change}"
            if after <= WORTH * before and (best is None or after / before < 0.99 * best[0]):
                best = (after / before, text)
    return None if best is None else best[1]


def headline(study: Study) -> str:
    """How many directions are known and what is not, in one line."""
    n = len(study.found.labels)
    weak = [w.direction.title for w in study.weaknesses if w.sensors == study.case.aboard]
    if not weak:
        return f"All {n} directions of the state are seen"
    return f"{study.strong} of {n} directions of the state are seen; {len(weak)} are not: {weak[0]}" + (
        f" and {len(weak) - 1} more" if len(weak) > 1 else ""
    )


def summary(study: Study) -> str:
    """The result in a few lines for the terminal."""
    found = study.found
    sensors = ", ".join(NAMES[name] for name in study.case.aboard)
    lines = [
        f"{study.case.name}: {headline(study)}",
        f"  {found.t[-1] - found.t[0]:.0f} s along the {study.case.along} motion with {sensors}; rank {study.rank} of "
        f"{len(found.labels)}, {study.strong} directions narrowed to half their prior sigma or less",
    ]
    lines += [f"  weak: {w.direction.sentence}" for w in study.weaknesses if w.sensors == study.case.aboard]
    flown = ", ".join(study.states[0].bits)
    lines.append(f"  flown: {flown}{explained(study)}")
    lines.append("  bias             sigma at the start → at the end, half of it after, manoeuvre that brought most")
    for state in study.biases:
        lines.append(
            f"    {name_of(state.label):16} {sigma_change(state)}, {halved_in_words(state)}, {state.brought_by or '-'}"
        )
    lines += [f"  advice: {line}" for line in advice(study)]
    lines += [f"  note: {note}" for note in study.case.notes]
    return "\n".join(lines)


def explained(study: Study) -> str:
    """What the numbers of the manoeuvres are, and what a hold is, where one is flown."""
    said = ["the number is the manoeuvre's place in the flight"] if len(study.case.segments) <= MOST_SEGMENTS else []
    said += ["a hold stands still in the air"] if any(s.name == "hold" for s in study.case.segments) else []
    return f" ({'; '.join(said)})" if said else ""


def sigma_change(state: BiasStudy) -> str:
    """`0.1 → 0.0026 m/s²`."""
    before, after = (shown(state.label, value) for value in (state.prior, state.posterior))
    return f"{figures(before)} → {figures(after)} {unit_in_words(state.label)}"


def halved_in_words(state: BiasStudy) -> str:
    """When sigma was half the prior."""
    if state.halved_after is None:
        return "never"
    return "at once" if state.halved_after == 0.0 else f"{state.halved_after:.1f} s"
