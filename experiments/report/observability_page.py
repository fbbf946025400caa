"""The page of an observability study: what is not seen, what shows it, what each manoeuvre and each sensor brings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sinan.experiments.bias_observability.directions import amount_of, name_of, shown
from sinan.experiments.bias_observability.document import (
    NAMES,
    advice,
    base_places,
    explained,
    flown_by,
    halved_in_words,
    headline,
    sensors_in_words,
    sigma_change,
)
from sinan.experiments.report import observability_figures as figures
from sinan.experiments.report.page import Page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinan.experiments.bias_observability.study import Study

#: Flights that are named as showing a direction.
_MOST_FLIGHTS = 3


def observability_figures(study: Study) -> dict[str, tuple[Figure, str]]:
    """The figures of a study by name, each with its caption."""
    made = {
        "curves": (
            figures.sigma_curves(study),
            f"Uncertainty of every bias over time; above, what is flown{explained(study)}. A fall is information, a "
            "rise is the bias's own random walk. The dashed line is half of what was known before the flight.",
        ),
        "singular values": (
            figures.singular_values(study),
            "What the readings alone know of each direction of the first state. On the dashed line they know three "
            "times as much as was known before, which halves sigma.",
        ),
        "sensors": (
            figures.subset_map(study),
            "Every set of the sensors, those that know least on the left: what it leaves of each bias's sigma.",
        ),
    }
    if len(study.case.segments) > 1:
        made["information"] = (
            figures.information_map(study),
            "What each manoeuvre brought: one bit halves a sigma. Roll, pitch and heading are angles about the body's "
            "axes, so a turn passes their uncertainty from one to the other.",
        )
    if any(weakness.sensors == study.case.aboard for weakness in study.weaknesses):
        made["weak directions"] = (
            figures.weak_parts(study),
            "What each direction that is not seen is made of, in units of each state's prior sigma. Moving these "
            "states together changes no reading, or hardly any.",
        )
    if study.catalogue is not None:
        made["catalogue"] = (
            figures.catalogue_map(study),
            "The same sensors and the same prior on every scenario of the catalogue that is a flight of its own, the "
            "best on the left (`sinan simulate NAME` flies it; docs/scenarios.md): per cent of the prior sigma that "
            f"{study.catalogue.horizon:.0f} s of it leave.",
        )
    if "base" in study.found.readings:
        made["base"] = (
            figures.base_curves(study),
            f"What a base receiver with {study.case.rates['base']:g} Hz adds: it reads the error that both share.",
        )
    return made


def observability_page(path: Path, study: Study) -> None:
    """Write the page of a study."""
    case, found = study.case, study.found
    sensors = ", ".join(NAMES[name] for name in case.aboard)
    duration = found.t[-1] - found.t[0]
    page = Page(f"{case.name}: {headline(study)}", f"{duration:.0f} s along the {case.along} motion with {sensors}.")
    page.text(
        "A state is seen if some reading changes with it. What changes no reading alone or only together with others "
        "is a direction that is not seen: a filter cannot find it, however long it runs. Sigma is the uncertainty of a "
        "state as the filter would state it; prior is what it knew before the flight.",
        note=True,
    )
    page.numbers(
        [
            (f"{study.rank} of {len(found.labels)}", "directions of which the readings say anything (rank)"),
            (f"{study.strong} of {len(found.labels)}", "directions whose sigma they halve"),
            (
                f"{sum(s.halved_after is not None for s in study.biases)} of {len(study.biases)}",
                "biases halved on the way",
            ),
        ]
    )
    made = observability_figures(study)
    _weak(page, study, made)
    page.heading("What each bias learns, and when")
    page.figure(*made["curves"])
    _bias_table(page, study)
    if "information" in made:
        page.heading("Which manoeuvre brought it")
        page.figure(*made["information"])
    if "catalogue" in made:
        page.heading("Which scenario to fly")
        page.figure(*made["catalogue"])
    page.heading("Which sensor shows what")
    page.figure(*made["sensors"])
    _sensor_table(page, study)
    if "base" in made:
        _base(page, study, made)
    page.heading("All directions")
    page.figure(*made["singular values"])
    for note in case.notes:
        page.text(note, note=True)
    page.write(path)


def _weak(page: Page, study: Study, made: dict[str, tuple[Figure, str]]) -> None:
    """What is not seen, why, and what would show it."""
    page.heading("What these readings do not tell apart")
    here = [w for w in study.weaknesses if w.sensors == study.case.aboard]
    for weakness in here:
        page.text(weakness.direction.sentence + ".")
    if not here:
        page.text("Nothing: every direction of the state is seen.")
    if "weak directions" in made:
        page.figure(*made["weak directions"])
    for line in advice(study):
        page.text(line + ".")
    fewer = [w for w in study.weaknesses if w.sensors != study.case.aboard]
    if not fewer:
        return
    page.text("With one sensor less, these are lost too:")
    rows = []
    for weakness in fewer:
        (missing,) = set(study.case.aboard) - set(weakness.sensors)
        flights = [name for name, _ in flown_by(weakness, study)][:_MOST_FLIGHTS]
        shows = sensors_in_words(weakness.removed_by)
        rows.append([NAMES[missing], weakness.direction.title, shows, ", ".join(flights) or "-"])
    page.table(["without", "not told apart", "what shows it", "scenarios that show it, all sensors aboard"], rows)


def _bias_table(page: Page, study: Study) -> None:
    rows = []
    for state in study.biases:
        other, correlation = state.confused_with
        rows.append(
            [
                name_of(state.label),
                sigma_change(state),
                f"{100.0 * state.left:.1f} %",
                halved_in_words(state),
                state.brought_by or "-",
                f"{name_of(other)} ({correlation:+.2f})",
            ]
        )
    head = [
        "bias",
        "σ at the start → end",
        "of the prior left",
        "halved after",
        "manoeuvre that brought most",
        "remaining error goes with",
    ]
    page.table(head, rows, numeric=(1, 2, 3))


def _sensor_table(page: Page, study: Study) -> None:
    imagined = " and ".join(NAMES[sensor.name] for sensor in study.case.imagined)
    only = f" ({imagined}: imagined, not aboard)" if imagined else ""
    page.text(f"The smallest sets of these sensors that halve the sigma of a state along this motion{only}:")
    page.table(["state", "seen with"], [[name_of(s.label), sensors_in_words(s.needs)] for s in study.states])


def _base(page: Page, study: Study, made: dict[str, tuple[Figure, str]]) -> None:
    """What the base receiver adds, in numbers."""
    page.heading("What the base receiver adds")
    without, with_base = base_places(study)
    aboard = "base" in study.case.aboard
    page.text(
        "GPS reads position plus bias: the two move together and no flight separates them. A receiver at a known place "
        "reads the bias alone." + ("" if aboard else " There is none in this recording; the figure imagines one.")
    )
    page.figure(*made["base"])
    rows = []
    for i, label in enumerate(study.found.labels):
        if label.startswith(("b_gps", "position")):
            before, after = (shown(label, float(study.course.sigma[k, -1, i])) for k in (without, with_base))
            rows.append([name_of(label), amount_of(label, before), amount_of(label, after), f"{after / before:.2f}"])
    page.table(["state", "σ at the end without", "with", "ratio"], rows, numeric=(1, 2, 3))
