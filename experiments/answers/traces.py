"""`sinan.trace`: find the effects that the plain model of a recording lacks; an object with tables, figures, a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinan.calibration.levels.assumptions import as_rows
from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.flights.source import FlightSource
from sinan.estimator.evidence.source import Source
from sinan.estimator.filter.assumption import Assumption
from sinan.experiments.answers.asked import PLAIN, Answer, Asked
from sinan.experiments.refused import doubted_shares
from sinan.experiments.report.refused_words import refused
from sinan.experiments.report.verdict_words import Log, next_with_parameters, trace_summary, worded
from sinan.experiments.report.words import trace_call
from sinan.experiments.residual_loop.open_source import require_recording
from sinan.experiments.residual_loop.report import report
from sinan.experiments.residual_loop.run import trace_recording
from sinan.experiments.residual_loop.traced import Traced
from sinan.experiments.review.unseen import not_seen
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import Choice
from sinan.sensors.joining import joined
from sinan.sensors.recording import Recording
from sinan.sensors.window import clock_warnings, second_words, told_from, told_from_note

#: Below so many samples a second an IMU is said to be slow: a vehicle that turns to and fro 5 times a second, as the
#: attitude loop of a multicopter may, then has four samples a turn or fewer [Hz].
SLOW_IMU = 20.0
#: What is asked for in its place: the autopilots' own profiles for estimation log at this rate or above it [Hz].
FAST_IMU = 100.0

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Trace(Answer):
    """The result of a trace.

    Attributes
    ----------
    recording : the recording that was traced
    traced : the parts with their models before and after, and the verdict
    document : all numbers and texts, as `sinan trace --json` writes them
    """

    recording: Recording
    traced: Traced
    document: dict[str, Any]

    @property
    def verdict(self) -> str:
        """`no_effect`, `effects`, `ambiguous` or `unexplained`."""
        return str(self.document["verdict"])

    @property
    def headline(self) -> str:
        """What was found, in a sentence."""
        return str(self.document["headline"])

    @property
    def found(self) -> tuple[str, ...]:
        """Names of the effects that pass the test, in the order of discovery."""
        return tuple(effect["name"] for effect in self.document["effects"])

    def effects(self) -> pd.DataFrame:
        """The effects that pass the test.

        Returns
        -------
        a row a parameter; columns `effect`, `parameter`, `unit`, `value`, `sigma`, and `predicts`: whether the held-out
        data are predicted better with it
        """
        import pandas as pd

        rows = [
            (effect["name"], name, unit, value, float("nan") if std is None else std, effect["predicts"])
            for effect in self.document["effects"]
            for name, unit, value, std in zip(
                effect["parameters"], effect["unit"], effect["beta"], effect["std"], strict=True
            )
        ]
        return pd.DataFrame(rows, columns=["effect", "parameter", "unit", "value", "sigma", "predicts"])

    def errors(self) -> pd.DataFrame:
        """RMS residual and NIS a degree of freedom of the held-out data, with the plain model and with what was found.

        Returns
        -------
        rows `before`, `after`; columns `rms`, `unit`, `nis_per_dof`
        """
        import pandas as pd

        error = self.document["error"]
        rows = {part: [error[part][key] for key in ("rms", "unit", "nis_per_dof")] for part in ("before", "after")}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["rms", "unit", "nis_per_dof"])

    def candidates(self) -> pd.DataFrame:
        """Every effect that was tested about the plain model, the strongest first: `statistic`, `dof`, `p_value`."""
        import pandas as pd

        rows = [(one["name"], one["statistic"], one["dof"], one["p_value"]) for one in self.document["candidates"]]
        table = pd.DataFrame(rows, columns=["effect", "statistic", "dof", "p_value"])
        return table.sort_values("p_value", kind="stable", ignore_index=True)

    def summary(self) -> str:
        """What `sinan trace` prints: warnings, verdict, errors before and after, notes."""
        said = [f"warning: {warning}" for warning in self.document["warnings"]]
        return "\n".join([*said, trace_summary(self.document), *(f"  note: {note}" for note in self.document["notes"])])

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan trace --html`. Returns its path."""
        from sinan.experiments.report.trace_page import trace_page
        from sinan.experiments.review.drawing import drawn
        from sinan.experiments.review.of_answers import review_of_trace

        review = drawn(review_of_trace(self.recording, self.traced, self.document))
        trace_page(Path(path), self.traced, self.document, review=review)
        return Path(path)

    def plot_candidates(self) -> list[Axes]:
        """How strongly the data speak for each candidate. One axes."""
        from sinan.experiments.report import screen
        from sinan.experiments.report.trace_figures import evidence_bars
        from sinan.experiments.report.trace_page import evidence

        return screen.axes(lambda: evidence_bars(evidence(self.traced), self.document["p_value_needed"]))

    def plot_figures(self) -> dict[str, list[Axes]]:
        """All figures of the page by name: the residual before and after, each effect against its signature."""
        from sinan.experiments.report import screen
        from sinan.experiments.report.trace_page import trace_figures

        drawn: dict[str, list[Axes]] = {}

        def draw() -> None:
            for name, (figure, _) in trace_figures(self.traced, self.document).items():
                drawn[name] = [one for one in figure.axes if one.get_visible()]

        screen.on_screen(draw)
        return drawn


def trace(
    recording: Recording | Sequence[Recording],
    *,
    sensor: str | None = None,
    alpha: float = ALPHA,
    gravity: float | None = None,
    asked: Asked = PLAIN,
) -> Trace:
    """Find the effect that the plain model of a recording lacks, add it, and compare the errors on held-out data.

    Parameters
    ----------
    recording : of poses or of a flight; several flights of one vehicle are traced together
    sensor : of poses with several sensors, trace only this one: "accel", "gyro" or "mag"; default: all of them
    alpha : probability of any false alarm, over all candidates together; smaller: fewer effects are named
    gravity : norm of gravity for the accelerometer of poses [m/s^2]; default: as declared, else 9.80665
    asked : how a command was typed, for the texts of the report; a script leaves it out

    Returns
    -------
    Trace

    Raises
    ------
    InputError : nothing that can be traced; flights that cannot be of one vehicle

    Examples
    --------
    >>> import sinan
    >>> poses = sinan.simulate("mag_poses", seed=7, effects={"mag.cross_axis": [0.04, -0.015, 0.02]})
    >>> found = sinan.trace(poses)
    >>> found.verdict, found.found
    ('effects', ('mag.cross_axis',))
    >>> before, after = found.errors()["rms"]
    >>> after < 0.5 * before
    True
    """
    several = [recording] if isinstance(recording, (Recording, str, Path)) else list(recording)
    for log in several:
        require_recording(log)
    one = joined(several)
    traced = trace_recording(one, sensor, alpha, gravity)
    return Trace(one, traced, document_of(one, traced, asked))


def document_of(recording: Recording, traced: Traced, asked: Asked = PLAIN) -> dict[str, Any]:
    """The report of a trace with its words."""
    in_parts = recording.kind == "poses" and recording.environment.magnetic_field is None
    poses = recording.kind == "poses"
    log = Log(asked.input_of(recording), asked.map_file, asked.choice, in_parts, len(recording.breaks), poses)
    assumed = [row for part in traced.parts for row in as_rows(_assumptions(part.source))]
    document = worded({**report(traced), "assumptions": assumed}, asked.name_of(recording), log)
    document["window"] = asked.window
    taken = [note for part in traced.parts for note in taken_from_the_log(recording, part.source)]
    document["notes"] = [*taken, *told_from_note(recording)]
    doubted = [one for part in traced.parts for one in _not_believed(part.source)]
    document["warnings"] = [*clock_warnings(recording), *slow_imu(recording), *doubted]
    document["not_seen"] = not_seen(recording, document)
    document["choice"], document["magnetic_field"] = asdict(asked.choice), _field_of(traced)
    return document


def _assumptions(source: Source) -> tuple[Assumption, ...]:
    """What the model of a flight takes without being told; of poses nothing."""
    return source.model.assumptions if isinstance(source, FlightSource) else ()


def _field_of(traced: Traced) -> list[float] | None:
    """The Earth's field that a flight's filter knew, NED; None: none."""
    used = getattr(traced.parts[0].source, "recording", None)
    field_n = None if used is None else used.environment.magnetic_field
    return None if field_n is None else [float(one) for one in field_n]


def in_its_terms(
    document: Mapping[str, Any], recording: Recording, inputs: Sequence[str]
) -> tuple[dict[str, Any] | None, list[str]]:
    """The parameters that take out what was found, and lines that say so; None: nothing, of no autopilot's log, or of
    logs that were flown with different ones.
    """
    from sinan.experiments.autopilots.parameters import autopilot_of, facts_of_log, lines_of, params_of_document
    from sinan.experiments.datasets import log_of

    logs = [log_of(one) for one in inputs]
    if not document["effects"] or not all(log.is_file() for log in logs):
        return None, []
    facts = [facts_of_log(log) for log in logs]
    name = autopilot_of(facts[0])
    if not name:
        return None, []
    params = params_of_document(document, name, recording, logs[0])
    for one in params.settings:
        if any(own is None or own.parameters.get(one.name) != one.was for own in facts[1:]):
            return None, [f"  the logs were flown with different {one.name}: trace one for its parameters"]
    return params.as_table(), [f"  {line}" for line in lines_of(params)]


def tell_in_its_terms(
    document: dict[str, Any], recording: Recording, inputs: Sequence[str], called: str = ""
) -> list[str]:
    """Put the autopilot's parameters into the report, and into what to do next; lines that say so.

    Parameters
    ----------
    called : how the user calls the log, where it lies elsewhere
    """
    from sinan.experiments.autopilots.files import FILES

    document["autopilot"], lines = in_its_terms(document, recording, inputs)
    params = document["autopilot"]
    if params:
        span, choice = tuple(document["window"] or (None, None)), Choice(**document["choice"])
        traced = trace_call(called or inputs[0], None, None, span, choice)
        written = f"{traced.replace('sinan trace', 'sinan params', 1)} --out {FILES[params['autopilot']]}"
        params["call"] = written if params["parameters"] and len(inputs) == 1 else None
        document["next"] = next_with_parameters(document)
    return lines


def slow_imu(recording: Recording) -> list[str]:
    """A sentence where the IMU of a flight is logged too slowly for the motion between its samples to be known."""
    imu = recording.streams.get("imu")
    if recording.kind != "flight" or imu is None or len(imu) < 2:
        return []
    rate = 1.0 / imu.step
    if rate >= SLOW_IMU:
        return []
    return [
        f"the IMU was logged {rate:.3g} times a second, which misses motion between its samples: names and sizes are "
        f"doubtful. Log it at {FAST_IMU:g} Hz or more (PX4: `SDLOG_PROFILE`; ArduPilot: `LOG_BITMASK`)"
    ]


def _not_believed(source: Source) -> list[str]:
    """A sentence for each stream that the gated filter refuses; none of poses, or where that filter has no answer."""
    if not isinstance(source, FlightSource):
        return []
    try:
        return list(refused(doubted_shares(source.gated())).values())
    except InputError:
        return []


def taken_from_the_log(recording: Recording, source: Source) -> list[str]:
    """What a flight's preparation took from the log where the recording declares nothing, one line each."""
    used = getattr(source, "recording", recording)
    return [*used.notes[len(recording.notes) :], *_stretches(source)]


def _stretches(source: Source) -> list[str]:
    """Which stretches a flight has, where gaps that nothing bridges cut it into several."""
    if not isinstance(source, FlightSource) or len(found := source.stretches) < 2:
        return []
    zero = told_from(source.recording)
    spans = ", ".join(f"{second_words(start, zero)} to {second_words(end, zero)} s" for start, end in found)
    return [f"{len(found)} stretches, each with a first state and states of its own: {spans}"]


def what_is_done(recording: Recording) -> str:
    """What is being done: how long the flight is tells how long that takes."""
    if recording.kind != "flight" or "imu" not in recording.streams:
        return "tracing"
    t = recording.streams["imu"].t
    return f"tracing {t[-1] - t[0]:.0f} s of flight, {len(t)} IMU samples"
