"""Arguments that several commands take."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

_SHIPPED = sorted(p.stem for p in (Path(__file__).parents[2] / "scenarios").glob("[!_]*.toml"))


#: The most runs and processes that are asked for, and the most metres from the centre of the Earth.
MOST_RUNS, MOST_WORKERS, MOST_METRES = 1_000_000, 1024, 1e9


SCENARIOS = f"{', '.join(_SHIPPED)}; or a TOML file (docs/scenarios.md)"


class AxesForm(StrEnum):
    """Forms of the axes matrix T."""

    none = "none"
    triangular = "triangular"
    full = "full"


Input = Annotated[str, typer.Argument(help="recording folder, log file, or DATASET/FILE", metavar="INPUT")]


Inputs = Annotated[
    list[str],
    typer.Argument(
        help="recording folder, log file, or DATASET/FILE; several flights of one vehicle", metavar="INPUT..."
    ),
]


Map = Annotated[
    Path | None, typer.Option("--map", help="TOML file that says how to read the log (docs/formats.md)", metavar="FILE")
]


_MOST_OF_A_KIND, _MOST_BOOTS = 15, 1000


def _number(sensor: str) -> Any:
    """An option that says which of several sensors of a log is read."""
    text = f"which {sensor} of a ULog or an ArduPilot log with several, from 0"
    return typer.Option(help=text, min=0, max=_MOST_OF_A_KIND, metavar="N", show_default=False)


Imu = Annotated[int, _number("IMU")]


Mag = Annotated[int, _number("magnetometer")]


Baro = Annotated[int, _number("barometer")]


Gps = Annotated[int, _number("receiver")]


Boot = Annotated[
    int,
    typer.Option(help="which start of the autopilot in a .tlog with several, from 1; default: the longest", min=0,
                 max=_MOST_BOOTS, metavar="N", show_default=False),
]  # fmt: skip


Raw = Annotated[
    bool, typer.Option("--raw", help="take off the autopilot's own offsets, scales and compensation (docs/formats.md)")
]


OwnEffects = Annotated[
    list[Path] | None,
    typer.Option(
        "--effects", help="Python file that declares effects of your own (docs/face.md); may be given again",
        metavar="FILE.py",
    ),
]  # fmt: skip


LongestWork = Annotated[float, typer.Option("--time", help="the longest work on a log, s", min=1.0, max=1e6)]


MostMemory = Annotated[float, typer.Option("--memory", help="memory that a log may need, MB", min=1.0, max=1e7)]


Json = Annotated[Path | None, typer.Option("--json", help="file for the numbers, as JSON", metavar="FILE")]


Relinearise = Annotated[
    bool, typer.Option("--relinearise", help="readings linear about the smoothed motion: for a coarse first attitude")
]


Html = Annotated[Path | None, typer.Option("--html", help="file for a self-contained page", metavar="FILE")]


def _gravity(value: float | None) -> float | None:
    """What is no norm is said before the work, also where nothing would have asked for it."""
    if value is not None and not 0.0 < value < float("inf"):
        from sinan.sensors.errors import InputError

        raise InputError("--gravity", f"{value}", "a number above 0 [m/s^2]")
    return value


Gravity = Annotated[
    float | None,
    typer.Option(help="norm of gravity, m/s^2; else as declared, else 9.80665", callback=_gravity),
]


From = Annotated[
    float | None,
    typer.Option("--from", help="leave out what is before: s after the first IMU sample (of poses: pose)", metavar="S"),
]


To = Annotated[float | None, typer.Option("--to", help="leave out what is from then on: s, as --from", metavar="S")]


Seed = Annotated[
    int, typer.Option(help="of the random numbers: the same seed gives the same result", min=0, max=2**63 - 1)
]


Force = Annotated[bool, typer.Option("--force", help="replace a recording that sinan wrote there before")]


Out = Annotated[Path, typer.Argument(help="folder of the recording: new, empty, or with --force")]
