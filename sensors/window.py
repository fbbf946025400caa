"""A part of a recording: the same stretch of time of all its streams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.sensors.errors import InputError
from sinan.sensors.noise import walked
from sinan.sensors.recording import Initial, Recording, SensorSpec, Stream

#: A stream with fewer rows in a part is not in it.
LEAST_ROWS = 2
#: Seconds after the start of a log from which and up to which it is looked at; None: from its beginning, to its end.
Span = tuple[float | None, float | None]
WHOLE: Span = (None, None)
_CLOCKS = ("imu", "poses")
#: How the sentence about a clock that goes back begins.
GOES_BACK = "the clock goes back"
#: A part of a log that is shorter is nothing to go on with [s].
_WORTH_A_LOOK = 1.0
#: Stamps that differ by less are of one instant: the finest that logs write are microseconds, 1e-6 [s].
_ROUNDING = 1e-6
#: A clock that shows less at the first sample counts from there as well as words tell it: a tenth of a second is their
#: last digit from 100 s on [s].
NEAR_ZERO = 0.1
#: From here on words tell whole seconds: of the four digits that they have else, at most thousandths, the last would be
#: tens [s].
_LONG = 1e4


def start_of(recording: Recording) -> float:
    """What the recording's clock shows at its first IMU sample; of poses at the first pose, else at the first reading
    [s].
    """
    for name in _CLOCKS:
        if name in recording.streams:
            return float(recording.streams[name].t[0])
    return min(float(stream.t[0]) for stream in recording.streams.values())


def end_of(recording: Recording) -> float:
    """What the recording's clock shows at the last reading of the stream that `start_of` takes [s]."""
    for name in _CLOCKS:
        if name in recording.streams:
            return float(recording.streams[name].t[-1])
    return max(float(stream.t[-1]) for stream in recording.streams.values())


def told_from(recording: Recording) -> float:
    """What the recording's clock shows at the instant from which words and pages count, as `--from` and `--to` do: the
    first sample of the log, of which this may be a part; 0 where the clock shows about 0 there [s].
    """
    first = start_of(recording) if recording.first_sample is None else recording.first_sample
    return first if abs(first) > NEAR_ZERO else 0.0


def told_from_note(recording: Recording) -> list[str]:
    """A sentence that says from when words count, where that is not the recording's own clock."""
    zero = told_from(recording)
    said = f"times are told in seconds after the log's first sample, {zero:.3f} s on its own clock"
    return [f"{said}: `--from` and `--to` take them so"] if zero else []


def clock_warnings(recording: Recording) -> list[str]:
    """A sentence for each time that the log's clock goes back, with the parts of the log that avoid it."""
    zero, found = told_from(recording), list[str]()
    for begin, end in recording.goes_back:
        ways = " or ".join(_around(recording, begin, end))
        back, at = f"{second_words(end - begin)} s", second_words(end, zero)
        what = "what was logged before and after is put together there"
        found.append(f"{GOES_BACK} by {back} at {at} s: {what}{f': {ways} leaves it out' if ways else ''}")
    return found


def _around(recording: Recording, begin: float, end: float) -> list[str]:
    """The options, to a hundredth of a second, that leave some time out of a log; none of logs that are joined."""
    first = start_of(recording) if recording.first_sample is None else recording.first_sample
    to, after = np.floor(100.0 * (begin - first) + 1e-6) / 100.0, np.ceil(100.0 * (end - first) + 0.5) / 100.0
    ways = [f"`--to {to:.8g}`"] if begin - start_of(recording) > _WORTH_A_LOOK else []
    ways += [f"`--from {after:.8g}`"] if end_of(recording) - end > _WORTH_A_LOOK else []
    return [] if recording.breaks else ways


def second_words(t: float, zero: float = 0.0) -> str:
    """An instant in words [s].

    Parameters
    ----------
    t : on the recording's clock
    zero : `told_from` of it
    """
    after = t - zero
    return f"{round(after, 3) + 0.0:.4g}" if abs(after) < _LONG else f"{after:.0f}"


def time_in_log(recording: Recording, first: float, t: float) -> float:
    """Seconds from the first sample of the log that an instant is in; of logs that are joined each has its own."""
    return float(t - max([first, *(begin for begin in recording.breaks if begin <= t)]))


def between(recording: Recording, begin: float, end: float) -> Recording:
    """The rows with begin <= t < end [s] of every stream and of the truth.

    What is declared of the first state holds where nothing before is cut off; else it has to be found from the data,
    and a bias may have wandered since: its variance has grown by walk^2 t.

    Raises
    ------
    InputError : none of the streams has readings there
    """
    parts = {name: _rows(stream, begin, end) for name, stream in recording.streams.items()}
    streams = {name: part for name, part in parts.items() if len(part) >= LEAST_ROWS}
    start, stop = start_of(recording), end_of(recording)
    if not streams or ("imu" in recording.streams and "imu" not in streams):
        found = f"fewer than {LEAST_ROWS} samples from {begin - start:g} s to {end - start:g} s after the first"
        raise InputError(recording.where, found, f"a part of its {stop - start:.5g} s")
    still = tuple(one for one in recording.goes_back if begin <= one[1] and end > one[0] + _ROUNDING)
    recording = recording.replace(goes_back=still)
    truth = recording.truth
    if truth is not None:
        seen = _rows(truth.stream, begin, end)
        truth = replace(truth, stream=seen) if len(seen) else None
    if begin <= start:
        return recording.replace(streams=streams, truth=truth)
    elapsed = time_in_log(recording, start, begin)
    sensors = {name: _after(spec, elapsed) for name, spec in recording.sensors.items()}
    return recording.replace(streams=streams, truth=truth, sensors=sensors, initial=Initial())


def window(recording: Recording, span: Span) -> Recording:
    """The part of a recording that a user asks for by seconds of the log; its notes say what was cut.

    Parameters
    ----------
    span : see `Span`; counted from `start_of`

    Raises
    ------
    InputError : no such part
    """
    if span == WHOLE:
        return recording
    start, length = start_of(recording), end_of(recording) - start_of(recording)
    for option, value in zip(("--from", "--to"), span, strict=True):
        if value is not None and not np.isfinite(value):
            raise InputError(option, f"{value}", "seconds after the first sample of the log")
    begin, end = (fallback if value is None else value for value, fallback in zip(span, (0.0, np.inf), strict=True))
    if begin >= end:
        raise InputError("--from and --to", f"{begin:g} s and {end:g} s", "a --from before the --to")
    if begin > length or end <= 0.0:
        found = f"{span_words(span)} of a log of {length:.5g} s"
        raise InputError("--from and --to", found, f"a part from 0 to {length:.5g} s, counted from its first sample")
    part = between(recording, -np.inf if span[0] is None else start + begin, start + end)
    lost = [name for name in recording.streams if name not in part.streams]
    notes = [f"{span_words(span)} of the log, counted from its first sample"]
    notes += [f"{', '.join(lost)}: fewer than {LEAST_ROWS} readings in that part, left out"] if lost else []
    first = start if recording.first_sample is None else recording.first_sample
    return part.replace(notes=(*part.notes, *notes), first_sample=first)


def span_words(span: Span) -> str:
    """A part of a log in words: `from 10 s to 50 s`; empty for the whole."""
    begin, end = span
    words = [] if begin is None else [f"from {begin:g} s"]
    words += [] if end is None else [f"to {end:g} s"]
    return " ".join(words)


def _rows(stream: Stream, begin: float, end: float) -> Stream:
    return stream.rows((stream.t >= begin) & (stream.t < end))


def _after(spec: SensorSpec, elapsed: float) -> SensorSpec:
    """What is declared of an instrument, some time later."""
    if spec.bias_std is None or not spec.bias_walk:
        return spec
    return replace(spec, bias_std=walked(spec.bias_std, spec.bias_walk, elapsed))
