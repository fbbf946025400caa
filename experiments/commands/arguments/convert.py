"""Arguments of `sinan convert`."""

from __future__ import annotations

from sinan.experiments.commands.arguments.saying import choice_of, require_place_for, show
from sinan.experiments.commands.arguments.shared import Baro, Boot, Force, From, Gps, Imu, Input, Mag, Map, Out, Raw, To


def convert(
    input: Input,
    out: Out,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    boot: Boot = 0,
    force: Force = False,
) -> None:
    """Convert a log, or a part of it, to the plain format: a folder of CSV files."""
    from sinan.experiments.datasets import convert as convert_log
    from sinan.experiments.report.console import working
    from sinan.experiments.report.words import reference_words

    require_place_for(out)
    with working("converting"):
        recording = convert_log(input, out, map, force, (start, stop), choice_of(imu, mag, baro, gps, raw, boot))
    show(f"{recording.name}: {recording.kind} with {', '.join(recording.streams)} -> {out}")
    if recording.truth is not None:
        show(f"truth.csv: {', '.join(recording.truth.known)} by {reference_words(recording.truth.kind)}")
