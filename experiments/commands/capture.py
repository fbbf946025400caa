"""`sinan capture`: a link to a vehicle -> a recording; with poses or faces its calibration and its parameters too."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from sinan.calibration.poses.triad import Calibration
from sinan.experiments.answers.calibrations import calibrate
from sinan.experiments.autopilots.calibrated import calibration_params
from sinan.experiments.autopilots.files import as_file
from sinan.experiments.autopilots.parameter_set import ParameterSet
from sinan.experiments.autopilots.parameters import lines_of
from sinan.experiments.calibrate import Calibrated
from sinan.experiments.capture.display import share_lost, shown
from sinan.experiments.capture.link import open_link
from sinan.experiments.capture.session import Asked, Session
from sinan.experiments.report.files import write_json
from sinan.experiments.report.made import made
from sinan.sensors.errors import InputError
from sinan.sensors.files import write_text
from sinan.sensors.formats.mavlink_streams import AUTOPILOTS
from sinan.sensors.formats.plain import read_recording

#: The account of a capture, beside its recording.
ACCOUNT = "capture.json"


@dataclass(frozen=True)
class Results:
    """Where what a calibration gives is written.

    Attributes
    ----------
    axes : form of T; None: the identity
    html, params, json : files, or None
    """

    axes: str | None = None
    html: Path | None = None
    params: Path | None = None
    json: Path | None = None


def run(link: str, asked: Asked, results: Results) -> str:
    """Capture until it is complete, its time is over or Ctrl-C ends it; return what there is, and the calibration."""
    way = open_link(link)
    with _ended_well() as stopped, shown() as (say, show):
        session = Session(way, asked, say)
        session.go(stopped, show)
    write_json(asked.out / ACCOUNT, session.as_json())
    lines = [_account(session)]
    if asked.shown != "flight":
        lines += _calibration(session, results)
    return "\n".join(lines)


@contextmanager
def _ended_well() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C, or the system, has asked for the end; a second time ends it at once, as elsewhere."""
    asked: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        for one, handler in before.items():
            signal.signal(one, handler)

    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    before = {one: handler for one, handler in before.items() if handler is not signal.SIG_IGN}
    for one in before:
        signal.signal(one, hear)
    try:
        yield lambda: bool(asked)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _account(session: Session) -> str:
    """What was captured."""
    recording = session.recording
    rows = ", ".join(f"{name} {count}" for name, count in recording.rows.items())
    text = f"{recording.folder}: {session.elapsed:.1f} s, rows: {rows}; lost {share_lost(session)}"
    left = sum(recording.left_out.values())
    text += f"; {left} rows left out (time not rising, or no number)" if left else ""
    return text + (f"; the vehicle's clock jumped {session.clock.jumps} times" if session.clock.jumps else "")


def _calibration(session: Session, results: Results) -> list[str]:
    """What the poses or faces give: T, K and b, a page, and the autopilot's parameters; or what they lack."""
    sensor = session.asked.shown
    watch = session.poses or session.faces
    if watch is not None and not session.complete:
        return [f"not calibrated, ended too early: {watch.line}"]
    recording = read_recording(session.recording.folder)
    axes = results.axes or ("triangular" if sensor == "mag" else "none")  # what autopilots have parameters for
    answer = calibrate(recording, sensor, axes=axes, gravity=session.asked.gravity)
    done = answer[sensor]
    params = _parameters(session, done)
    lines = [answer.summary(), *([params] if isinstance(params, str) else lines_of(params))]
    if results.params is not None and not isinstance(params, str):
        write_text(results.params, as_file(params, f"{made()}: {sensor} calibrated"))
    if results.json is not None:
        answer.to_json(results.json)
    if results.html is not None:
        from sinan.experiments.report.calibration_page import calibration_page

        settings = () if isinstance(params, str) else params.settings
        calibration_page(results.html, recording.name, [done], {}, settings)
    return lines


def _parameters(session: Session, done: Calibrated) -> ParameterSet | str:
    """The parameters to type in, with those that the autopilot has now taken into account; or why there are none."""
    name = AUTOPILOTS.get(session.vehicle.autopilot, "").lower()
    if not name:
        return "whose autopilot it is was not said: no parameters"
    choice = session.asked.choice
    number = choice.imu if done.sensor == "accel" else choice.mag
    assert isinstance(done.result, Calibration)
    try:
        return calibration_params(name, done.sensor, done.result, session.streams.parameters, number)
    except InputError as error:
        return f"no parameters: {error}"
