"""Several logs of one vehicle as one recording: what is in the instruments is in all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinan.sensors.errors import InputError
from sinan.sensors.formats.geodetic import to_ned
from sinan.sensors.recording import Recording, Stream, tells_height
from sinan.sensors.window import between, end_of, second_words, start_of, told_from

#: Stamps of each log begin at a multiple of this many seconds after those of the first, past the end of the one before.
ROUND = 1000.0


def joined(recordings: Sequence[Recording]) -> Recording:
    """Logs one after the other, each a stretch of its own: no state passes from one to the next.

    A stream is read where a log has it, with the columns that all who have it share. What is declared has to agree.
    Positions are about each log's own origin, so a height above it starts anew. The first state that a log after the
    first declares, and every reference, are left out.

    Parameters
    ----------
    recordings : flights of one vehicle, in the same axes and units, from one region of the Earth's magnetic field

    Raises
    ------
    InputError : no flight; declared sensors, effects or field that differ
    """
    first = recordings[0]
    if len(recordings) == 1:
        return first
    for one in recordings:
        if one.kind != "flight" or "imu" not in one.streams:
            raise InputError(one.where, f'kind = "{one.kind}"', "a flight: poses are traced one log at a time")
        for what, mine, its in (
            ("[sensors]", first.sensors, one.sensors),
            ("[effects]", first.effects, one.effects),
            ("[environment]", _environment(first), _environment(one)),
        ):
            if mine != its:
                raise InputError(one.where, f"{what} is not that of {first.where}", "the same in all logs of a vehicle")
    shifts, begin = list[float](), 0.0
    for one in recordings:
        shifts.append(begin - start_of(one) + start_of(first))
        begin += ROUND * float(np.ceil((end_of(one) - start_of(one) + 1.0) / ROUND))
    parts = [_in_ned(between(one, start_of(one), float(np.nextafter(end_of(one), np.inf)))) for one in recordings]
    parts = _with_what_tells_no_height(parts)
    shifted = list(zip(parts, shifts, strict=True))
    names = dict.fromkeys(name for streams in parts for name in streams)
    streams = {
        name: _concatenated([(streams[name], shift) for streams, shift in shifted if name in streams]) for name in names
    }
    breaks = [float(streams["imu"].t[0] + shift) for streams, shift in shifted]
    places = zip(recordings, breaks, strict=True)
    zero = told_from(first)
    notes = [f"log {k + 1}, {one.where}: from {second_words(at, zero)} s" for k, (one, at) in enumerate(places)]
    own = [note for one in recordings for note in one.notes]
    return first.replace(
        name=f"{first.name} and {len(recordings) - 1} more",
        streams=streams,
        truth=None,
        breaks=tuple(breaks[1:]),
        log_start=None,
        goes_back=tuple(
            (a + shift, b + shift) for one, shift in zip(recordings, shifts, strict=True) for a, b in one.goes_back
        ),
        notes=tuple(dict.fromkeys([*own, *notes])),
    )


def _environment(recording: Recording) -> object:
    field = recording.environment.magnetic_field
    return replace(recording.environment, magnetic_field=None), None if field is None else tuple(field)


def _in_ned(recording: Recording) -> dict[str, Stream]:
    """The streams, fixes about the recording's own origin."""
    return to_ned(recording.where, recording.streams, recording.origin)[0]


def _with_what_tells_no_height(parts: list[dict[str, Stream]]) -> list[dict[str, Stream]]:
    """The streams of several logs; where fixes of one tell no height, those of all have the `epv` that says so: 0 of a
    receiver that says nothing.
    """
    if all(np.all(tells_height(streams["gps"])) for streams in parts if "gps" in streams):
        return parts
    return [
        {
            name: Stream(one.t, {**one.columns, "epv": one["epv"] if "epv" in one else np.zeros(len(one))})
            if name == "gps"
            else one
            for name, one in streams.items()
        }
        for streams in parts
    ]


def _concatenated(parts: Sequence[tuple[Stream, float]]) -> Stream:
    """Streams of several logs with their stamps shifted [s], and the columns that all have."""
    shared = [name for name in parts[0][0].columns if all(name in stream.columns for stream, _ in parts)]
    columns = {name: np.concatenate([stream[name] for stream, _ in parts]) for name in shared}
    return Stream(np.concatenate([stream.t + shift for stream, shift in parts]), columns)
