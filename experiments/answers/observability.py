"""`sinan.observability`: which biases a motion and its sensors show, as an object with tables, figures and a page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinan.experiments.answers.asked import Answer
from sinan.experiments.bias_observability.case import Case, case_of_recording, case_of_scenario
from sinan.experiments.bias_observability.document import document, summary
from sinan.experiments.bias_observability.study import Study, study
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import FIRST, Choice
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario
from sinan.sensors.window import WHOLE, Span, span_words

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Observability(Answer):
    """What a motion with its sensors tells of each state.

    Attributes
    ----------
    study : information, weak directions, what other sensors and flights would bring
    """

    study: Study

    @cached_property
    def document(self) -> dict[str, Any]:  # type: ignore[override]
        """The numbers, as `sinan observability --json` writes them."""
        return document(self.study)

    def states(self) -> pd.DataFrame:
        """Every state.

        Returns
        -------
        index: its name, `b_gyro_x` ...; columns `prior`, `posterior`: 1-sigma at the start and at the end (SI, angles
        rad), `left`: posterior over what the prior would be at the end without a reading, `halved_after` [s],
        `brought_by`: the manoeuvre that brought most
        """
        import pandas as pd

        states = self.study.states
        return pd.DataFrame(
            {
                "prior": [one.prior for one in states],
                "posterior": [one.posterior for one in states],
                "left": [one.left for one in states],
                "halved_after": [float("nan") if one.halved_after is None else one.halved_after for one in states],
                "brought_by": [one.brought_by for one in states],
            },
            index=pd.Index([one.label for one in states], name="state"),
        )

    def summary(self) -> str:
        """What `sinan observability` prints: weak directions, biases, advice."""
        return summary(self.study)

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan observability --html`. Returns its path."""
        from sinan.experiments.report.observability_page import observability_page

        observability_page(Path(path), self.study)
        return Path(path)

    def plot_sigmas(self) -> list[Axes]:
        """Sigma of every bias over time as a share of its prior, with the manoeuvres above."""
        from sinan.experiments.report import observability_figures, screen

        return screen.axes(lambda: observability_figures.sigma_curves(self.study))


def observability(flown: Recording | Scenario | str | Path) -> Observability:
    """Which biases a motion with its sensors shows, which it does not, and which sensor or flight would.

    Parameters
    ----------
    flown : a recording of a flight, or a scenario: its name, TOML file or `Scenario`

    Returns
    -------
    Observability

    Raises
    ------
    InputError : no flight; noise that nobody declared

    Examples
    --------
    >>> import sinan
    >>> found = sinan.observability("hover")
    >>> states = found.states()
    >>> bool(states.loc["b_gyro_x", "left"] < 0.1 < states.loc["b_gps_north", "left"])
    True
    """
    if isinstance(flown, Recording):
        return Observability(study(case_of_recording(flown)))
    if isinstance(flown, Scenario):
        return Observability(study(case_of_scenario(flown)))
    return Observability(study(case_of(str(flown))))


def case_of(text: str, map_file: Path | None = None, span: Span = WHOLE, choice: Choice = FIRST) -> Case:
    """A scenario where the text names one (or is a TOML file without a map), else a recording; or a part of it.

    Raises
    ------
    InputError : neither; a recording that is no flight; noise that nobody declared
    """
    from sinan.experiments.scenarios import load_scenario, scenario_names

    if map_file is None and (
        text in scenario_names() or (text.endswith(".toml") and Path(text).name != "recording.toml")
    ):
        scenario = load_scenario(text)
        if scenario.kind != "flight":
            raise InputError(f"scenario {text}", f'kind = "{scenario.kind}"', "a flight: poses show no filter's biases")
        case = case_of_scenario(scenario, span=span)
        return replace(case, name=f"{case.name} {span_words(span)}".rstrip())
    from sinan.experiments.datasets import called, resolve

    if map_file is None and "/" not in text and not Path(text).exists():
        names = ", ".join(scenario_names())
        raise InputError(text, "no such scenario, file or folder", f"a log, DATASET/FILE, or one of {names}")
    recording = resolve(text, map_file, span, choice)
    return replace(case_of_recording(recording), name=called(text, recording, span))
