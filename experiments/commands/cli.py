"""The command line: one function a command, each imports what it needs when it runs."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from sinan.experiments.labs import LABS
from sinan.experiments.student_labs import TITLES

if TYPE_CHECKING:
    from sinan.sensors.formats.choice import Choice

# The matrices are small: more threads only get in each other's way, and the last bits would depend on their number.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

app = typer.Typer(
    name="sinan",
    help="Find what is wrong with a vehicle's sensors from its log, prove it on withheld data, and say what to set.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    epilog="With a log: `sinan trace LOG --html page.html`. Without one: `sinan demo`. More: `sinan COMMAND --help`.",
)


_SHIPPED = sorted(p.stem for p in (Path(__file__).parents[1] / "scenarios").glob("[!_]*.toml"))
RANGE_SCENARIOS = ", ".join(sorted(p.stem for p in (Path(__file__).parents[1] / "gnss" / "scenarios").glob("*.toml")))
#: The most runs and processes that are asked for, and the most metres from the centre of the Earth.
MOST_RUNS, MOST_WORKERS, MOST_METRES = 1_000_000, 1024, 1e9
SCENARIOS = f"{', '.join(_SHIPPED)}; or a TOML file (docs/scenarios.md)"


class Sensor(StrEnum):
    """The three-axis sensors."""

    accel = "accel"
    gyro = "gyro"
    mag = "mag"


class Calibrand(StrEnum):
    """What can be calibrated."""

    accel = "accel"
    gyro = "gyro"
    mag = "mag"
    all = "all"


class Autopilot(StrEnum):
    """Whose parameters are written."""

    px4 = "px4"
    ardupilot = "ardupilot"


class Posed(StrEnum):
    """What is shown poses, held still."""

    accel = "accel"


class Turned(StrEnum):
    """What is turned round on its faces."""

    mag = "mag"


class AxesForm(StrEnum):
    """Forms of the axes matrix T."""

    none = "none"
    triangular = "triangular"
    full = "full"


class Language(StrEnum):
    """Of the labs for students."""

    en = "en"
    zh = "zh"


class Code(StrEnum):
    """Of pseudoranges."""

    ca = "ca"
    p = "p"
    p_two = "p_two"


class World(StrEnum):
    """How much of a blind recording's noise is as it declares."""

    declared = "declared"
    rough = "rough"
    mixed = "mixed"


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
_MOST_OF_A_KIND = 15


def _number(sensor: str) -> Any:
    """An option that says which of several sensors of a log is read."""
    text = f"which {sensor} of a ULog or an ArduPilot log with several, from 0"
    return typer.Option(help=text, min=0, max=_MOST_OF_A_KIND, metavar="N", show_default=False)


Imu = Annotated[int, _number("IMU")]
Mag = Annotated[int, _number("magnetometer")]
Baro = Annotated[int, _number("barometer")]
Gps = Annotated[int, _number("receiver")]
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


def _say(work: Callable[[], str], json: Path | None, html: Path | None, **written: Path | None) -> None:
    """Work whose files have a place to go, and go there together at its end; then the result, and every file."""
    from sinan.sensors.files import together

    def whole() -> str:
        with together():
            return work()

    _say_as_kept(whole, json, html, **written)


def _say_as_kept(work: Callable[[], str], json: Path | None, html: Path | None, **written: Path | None) -> None:
    """The same of work that keeps what is finished as it goes."""
    from sinan.experiments.report.files import require_place

    files = {what: path for what, path in {**written, "JSON": json, "page": html}.items() if path is not None}
    for path in files.values():
        require_place(path)
    _show(work())
    for what, path in files.items():
        _show(f"{what}: {path}")


def _show(text: str) -> None:
    """Print what may hold names out of a file, without the control characters that they may have."""
    from sinan.sensors.errors import printable

    typer.echo(printable(text, keep="\n\t"))


def _know(files: list[Path] | None) -> None:
    """Read effects of the user's own, for this process and its workers."""
    if files:
        from sinan.sensors.effects.own import read_file

        for file in files:
            read_file(file)


def _choice(imu: int, mag: int, baro: int, gps: int, raw: bool) -> Choice:
    """Which of several sensors of a log are read."""
    from sinan.sensors.formats.choice import Choice

    return Choice(imu, mag, baro, gps, raw)


def _require_place_for(folder: Path | None) -> None:
    """A folder that is written to lies in one that is there, or in one that is made with it."""
    from sinan.experiments.report.files import require_parent
    from sinan.sensors.errors import InputError

    if folder is not None:
        require_parent(folder.parent)
        if folder.exists() and not folder.is_dir():  # a name that no folder can have is an error here, too
            raise InputError(folder, "a file", "a folder: a new one, or one that is there")
        folder.parent.mkdir(exist_ok=True)
        if not os.access(folder if folder.is_dir() else folder.parent, os.W_OK):
            raise InputError(folder, "no permission to write there", "a folder that can be written")


def _version(wanted: bool) -> None:
    if wanted:
        from sinan.experiments.report.made import sinan_version

        typer.echo(f"sinan {sinan_version()}")
        raise typer.Exit


@app.callback()
def sinan(
    version: Annotated[
        bool, typer.Option("--version", help="show the version and exit", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Multi-sensor state estimation that traces a residual to the effect a model lacks."""


@app.command()
def demo(
    out: Annotated[Path, typer.Argument(help="folder for the page and the figures")] = Path("sinan-demo"),
) -> None:
    """A demonstration: hides effects in a recording, finds them, and writes a page (about a minute)."""
    from sinan.experiments.commands.demo import run

    _require_place_for(out)
    run(out)


@app.command()
def fetch(
    names: Annotated[
        list[str] | None, typer.Argument(help="data sets; all if none is named", metavar="[NAME]...")
    ] = None,
) -> None:
    """Download measured data sets and check their checksums; with SINAN_DATA=DIR, check a local mirror of them."""
    from sinan.experiments.datasets.fetch import fetch as fetch_sets
    from sinan.experiments.report.console import progress

    with progress("fetching") as step:
        folders = fetch_sets(names or [], lambda name, file, done, total: step(f"{name}/{file}", done, total))
    for name, folder in folders.items():
        typer.echo(f"{name}: {folder}")


@app.command()
def simulate(
    scenario: Annotated[str, typer.Argument(help=SCENARIOS)],
    out: Out,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect",
            help="NAME=B0[,B1...][@T0[:T1]], such as mag.current=0.003,0,0 or gps.transient=4,0,0@20:30 (s); "
            "may be given again; `sinan effects` lists the names",
        ),
    ] = None,
    declare: Annotated[bool, typer.Option("--declare", help="write the effects into the recording")] = False,
    sensors: Annotated[
        str,
        typer.Option(help="only these, such as accel,gyro,gps,camera; a flight may be given a camera"),
    ] = "",
    own_effects: OwnEffects = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Simulate a flight or poses into a recording with its truth; what is hidden in it is written beside it."""
    _know(own_effects)
    from sinan.experiments.report.console import note, working
    from sinan.experiments.scenarios import simulate_to_folder

    _require_place_for(out)
    names = [name.strip() for name in sensors.split(",") if name.strip()]
    with working("simulating"):
        answer = simulate_to_folder(scenario, out, effect or [], declare, seed, force, names, note)
    _show(f"recording: {out}\nanswer: {answer}")


@app.command()
def info(
    input: Input,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Say what is in a log: sensors, rates, gaps, units, firmware, parameters, and what a trace could find in it."""
    from sinan.experiments.commands.info import run

    span, choice = (start, stop), _choice(imu, mag, baro, gps, raw)
    _say(lambda: run(input, map, json, span, choice, html), json, html)


@app.command()
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
    force: Force = False,
) -> None:
    """Convert a log, or a part of it, to the plain format: a folder of CSV files."""
    from sinan.experiments.datasets import convert as convert_log
    from sinan.experiments.report.console import working
    from sinan.experiments.report.words import reference_words

    _require_place_for(out)
    with working("converting"):
        recording = convert_log(input, out, map, force, (start, stop), _choice(imu, mag, baro, gps, raw))
    _show(f"{recording.name}: {recording.kind} with {', '.join(recording.streams)} -> {out}")
    if recording.truth is not None:
        _show(f"truth.csv: {', '.join(recording.truth.known)} by {reference_words(recording.truth.kind)}")


@app.command()
def calibrate(
    sensor: Annotated[Calibrand, typer.Argument(help="which sensor of the log, or all")],
    input: Input,
    axes: Annotated[
        AxesForm | None, typer.Option(help="form of T, which turns and skews the axes; default none, gyro full")
    ] = None,
    gravity: Gravity = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    poses: Annotated[
        bool, typer.Option("--poses", help="an autopilot's log of a board turned by hand: its rests are the poses")
    ] = False,
    imu: Imu = 0,
    mag: Mag = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Calibrate a three-axis sensor from poses, or all that there are: T K (reading + b)."""
    from sinan.experiments.commands.calibrate import run
    from sinan.experiments.report.console import working

    def work() -> str:
        with working("calibrating"):
            form, choice = axes.value if axes else None, _choice(imu, mag, 0, 0, raw)
            return run(sensor.value, input, form, gravity, map, json, html, (start, stop), poses, choice)

    _say(work, json, html)


@app.command()
def estimate(
    input: Input,
    engine: Annotated[str, typer.Option(help="numba (compiled), filterpy (readable, slow) or auto")] = "auto",
    states: Annotated[Path | None, typer.Option(help="file for the states over time, as CSV", metavar="FILE")] = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    relinearise: Relinearise = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="also the fixed-interval smoother: states and errors given all readings")
    ] = False,
    own_effects: OwnEffects = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Run the filter on a flight: motion, biases with their uncertainty, consistency, errors against a reference."""
    _know(own_effects)
    from sinan.experiments.commands.estimate import run

    span, choice = (start, stop), _choice(imu, mag, baro, gps, raw)
    files = states, map, json, html
    _say(lambda: run(input, engine, *files, relinearise, span, choice, smooth), json, html, states=states)


@app.command()
def trace(
    inputs: Inputs,
    sensor: Annotated[Sensor | None, typer.Option(help="only this one, of a poses recording with several")] = None,
    alpha: Annotated[
        float, typer.Option(help="risk of any false alarm, over all candidates together", min=1e-6, max=0.5)
    ] = 0.01,
    gravity: Gravity = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    own_effects: OwnEffects = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Find what is wrong with the sensors of a log: each effect with its size, and the error with and without it."""
    _know(own_effects)
    from sinan.experiments.commands.trace import run

    only, span, choice = sensor.value if sensor else None, (start, stop), _choice(imu, mag, baro, gps, raw)
    _say(lambda: run(inputs, only, alpha, gravity, map, json, html, span, choice), json, html)


@app.command()
def params(
    input: Input,
    autopilot: Annotated[
        Autopilot | None, typer.Option("--for", help="whose parameters; default: of the autopilot that wrote the log")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--trace", help="what `sinan trace --json` wrote of this log", metavar="REPORT.json")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="file for the ground station; default: shown", metavar="FILE")
    ] = None,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
) -> None:
    """Write what a trace finds as parameters to load into the flight controller (PX4, ArduPilot)."""
    from sinan.experiments.commands.params import run

    name, span, choice = autopilot.value if autopilot else None, (start, stop), _choice(imu, mag, baro, gps, raw)
    _say(lambda: run(input, name, report, out, map, span, choice), None, None, parameters=out)


@app.command()
def gnss(
    observation: Annotated[Path, typer.Argument(help="RINEX observation file", metavar="OBS")],
    navigation: Annotated[list[Path], typer.Argument(help="RINEX navigation files", metavar="NAV...")],
    systems: Annotated[str, typer.Option(help="G GPS, E Galileo, J QZSS, C BeiDou, R GLONASS")] = "G,E,J,C",
    mask: Annotated[float, typer.Option(help="lowest elevation, deg", min=-90.0, max=90.0)] = 10.0,
    position: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="known position of a receiver at rest, ECEF, m", metavar="X Y Z"),
    ] = None,
    reference: Annotated[Path | None, typer.Option(help="known positions of a moving receiver")] = None,
    base: Annotated[Path | None, typer.Option(help="RINEX observation file of a base receiver")] = None,
    base_position: Annotated[
        tuple[float, float, float] | None, typer.Option(help="known position of the base, ECEF, m", metavar="X Y Z")
    ] = None,
    code: Annotated[
        Code, typer.Option(help="C/A and its like; P; P of both frequencies, without ionosphere")
    ] = Code.ca,
    link: Annotated[
        str | None,
        typer.Option(
            help="data link from the base, such as delay=5,interval=2,loss=0.1,run=3,content=raw (docs/gnss.md)"
        ),
    ] = None,
    solution: Annotated[Path | None, typer.Option(help="file for the fixes, as CSV", metavar="FILE")] = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Compute positions from pseudoranges (RINEX), and find which effects the ranges call for."""
    from sinan.experiments.commands.gnss import run

    places = position, reference, base, base_position
    _say(
        lambda: run(observation, navigation, systems, mask, *places, code.value, link, solution, json, html),
        json,
        html,
        fixes=solution,
    )


@app.command()
def ranges(
    scenario: Annotated[str, typer.Argument(help=f"{RANGE_SCENARIOS}; or a TOML file (docs/gnss.md)")],
    out: Annotated[Path | None, typer.Option(help="folder for RINEX files of rover, base and messages")] = None,
    seed: Seed = 0,
    json: Json = None,
    html: Html = None,
) -> None:
    """Simulate pseudoranges of C/A and P code receivers and a DGPS data link; errors over the corrections' age."""
    from sinan.experiments.commands.ranges import run

    _require_place_for(out)
    _say(lambda: run(scenario, out, seed, json, html), json, html)


@app.command()
def observability(
    input: Annotated[str, typer.Argument(help="recording, log, DATASET/FILE or scenario", metavar="INPUT|SCENARIO")],
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Say which biases a flight's motion and sensors can determine, and which manoeuvre would help."""
    from sinan.experiments.commands.observability import run

    _say(lambda: run(input, map, json, html, (start, stop), _choice(imu, mag, baro, gps, raw)), json, html)


@app.command()
def montecarlo(
    scenario: Annotated[str, typer.Argument(help=SCENARIOS)],
    runs: Annotated[int, typer.Option(help="number of flights", min=1, max=MOST_RUNS)] = 100,
    workers: Annotated[int | None, typer.Option(help="processes; default one a core", min=1, max=MOST_WORKERS)] = None,
    dask: Annotated[str | None, typer.Option(help="address of a running Dask scheduler")] = None,
    resume: Annotated[Path | None, typer.Option(help="folder that keeps finished runs")] = None,
    seed: Seed = 0,
    relinearise: Relinearise = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Fly a scenario many times and check the filter's errors against its own prediction."""
    from sinan.experiments.commands.monte_carlo import run

    _require_place_for(resume)
    _say_as_kept(lambda: run(scenario, runs, workers, dask, resume, seed, json, html, relinearise), json, html)


@app.command()
def batch(
    inputs: Annotated[list[str], typer.Argument(help="logs, recordings, or folders that hold them", metavar="LOG...")],
    out: Annotated[Path, typer.Option("--out", help="folder for pages and reports; what it holds is not done again")],
    own_effects: OwnEffects = None,
    workers: Annotated[int | None, typer.Option(help="processes; default one a core", min=1, max=MOST_WORKERS)] = None,
    dask: Annotated[str | None, typer.Option(help="address of a running Dask scheduler")] = None,
    time: LongestWork = 900.0,
    memory: MostMemory = 4096.0,
) -> None:
    """Trace many logs: a page for each, and one that ranks the vehicles by effect and shows what changed."""
    _know(own_effects)
    from sinan.experiments.commands.batch import run
    from sinan.experiments.workers.alone import Limits

    _require_place_for(out)
    _show(run(inputs, out, workers, dask, Limits(time, int(memory * 2**20))))
    _show(f"page: {out / 'index.html'}")


@app.command()
def serve(
    port: Annotated[int, typer.Option(help="on 127.0.0.1; 0: any that is free", min=0, max=65535)] = 8014,
    open_page: Annotated[bool, typer.Option("--open", help="open the page in the browser")] = False,
    size: Annotated[float, typer.Option(help="the largest log, MB", min=0.001, max=1e5)] = 500.0,
    time: LongestWork = 900.0,
    memory: MostMemory = 4096.0,
) -> None:
    """Trace in the browser: drop logs into a page that only this machine can reach, and read the verdicts."""
    from sinan.experiments.commands.serve import run
    from sinan.experiments.serve.jobs import Limits

    run(port, Limits(int(size * 2**20), time, int(memory * 2**20)), open_page, _show)


@app.command()
def capture(
    link: Annotated[
        str, typer.Option("--link", help="udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD")
    ],
    out: Annotated[Path, typer.Option("--out", help="folder of the recording: new or empty")],
    seconds: Annotated[
        float | None, typer.Option("--for", help="end after so many seconds; else Ctrl-C ends it well", min=0.1)
    ] = None,
    rate: Annotated[float, typer.Option(help="readings of the IMU to ask for, a second", min=1.0, max=1000.0)] = 50.0,
    poses: Annotated[
        Posed | None,
        typer.Option(help="the course's ten poses, 100 still readings each: calibrate and print parameters"),
    ] = None,
    faces: Annotated[
        Turned | None, typer.Option(help="six faces, turned round on each: calibrate and print parameters")
    ] = None,
    axes: Annotated[
        AxesForm | None, typer.Option(help="form of T; default: none of an accelerometer, triangular of a compass")
    ] = None,
    gravity: Gravity = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    mwlog: Annotated[
        Path | None, typer.Option("--mwlog", help="file for the same readings as the course's log", metavar="FILE")
    ] = None,
    params: Annotated[
        Path | None, typer.Option("--params", help="file of the parameters, for the ground station", metavar="FILE")
    ] = None,
    json: Json = None,
    html: Html = None,
) -> None:
    """Record a live vehicle over MAVLink, or calibrate its accelerometer or compass by poses."""
    from sinan.experiments.capture.session import Asked
    from sinan.experiments.commands.capture import Results, run
    from sinan.sensors.errors import InputError

    if poses and faces:
        raise InputError("--poses, --faces", "both", "one of them: each is a recording of its own")
    if not (poses or faces) and (params or json or html):
        raise InputError("--params, --json, --html", "without --poses or --faces", "a calibration to write")
    _require_place_for(out)
    asked = Asked(
        out, poses.value if poses else faces.value if faces else "flight", rate, seconds,
        _choice(imu, mag, baro, gps, False), gravity, mwlog,
    )  # fmt: skip
    results = Results(axes.value if axes else None, html, params, json)
    _say_as_kept(lambda: run(link, asked, results), json, html, parameters=params, mwlog=mwlog)


@app.command()
def camera(
    place: Annotated[
        Path, typer.Argument(help="folder of pictures, a table of corners; hand-eye or wand", metavar="INPUT")
    ],
    what: Annotated[
        Path | None, typer.Argument(help="hand-eye: pictures or corners; wand: a table", metavar="[INPUT]")
    ] = None,
    board: Annotated[
        str | None, typer.Option(help="inner corners of the chessboard, or squares of the ChArUco board", metavar="9x6")
    ] = None,
    square: Annotated[float, typer.Option(help="side of a square, m; without it, places are in squares")] = 1.0,
    marker: Annotated[float | None, typer.Option(help="ChArUco: side of a marker, in the unit of --square")] = None,
    dictionary: Annotated[str, typer.Option(help="ChArUco: OpenCV's name of the markers' dictionary")] = "DICT_5X5_100",
    legacy: Annotated[bool, typer.Option("--legacy", help="ChArUco: a board printed by OpenCV before 4.6")] = False,
    lens: Annotated[
        str, typer.Option(help="auto (held-out pictures decide), pinhole, k1, ..., fisheye, unified, omnidirectional")
    ] = "auto",
    corners: Annotated[Path | None, typer.Option(help="file for the corners that were found, as CSV")] = None,
    body: Annotated[
        Path | None, typer.Option(help="hand-eye: table image,qw,qx,qy,qz[,north,east,down]; with --gyro image,t")
    ] = None,
    gyro: Annotated[Path | None, typer.Option(help="hand-eye: a log whose gyroscope turned with the camera")] = None,
    along: Annotated[str, typer.Option(help="wand: distances of the markers from the first, m: 0,0.2,0.5")] = "",
    cameras: Annotated[str, typer.Option(help="wand: JSON of each camera, in order, commas between")] = "",
    json: Json = None,
    html: Html = None,
) -> None:
    """Calibrate a camera from pictures of a board: intrinsics, lens, error; its mounting: hand-eye; several: wand."""
    from sinan.experiments.commands.camera import board_of, run
    from sinan.sensors.errors import InputError

    target = board_of(board, square, marker, dictionary, legacy)
    if str(place) in ("hand-eye", "wand"):
        from sinan.experiments.commands.camera_rig import Beside, hand_eye, wand

        if html is not None or corners is not None:
            raise InputError("--html, --corners", f"with {place}", "--json: there is no page of a mounting")
        beside = Beside(body, gyro, along, cameras)
        if str(place) == "wand":
            _say(lambda: wand(what, beside, lens, json), json, None)
        else:
            _say(lambda: hand_eye(what, beside, target, lens, json), json, None)
        return
    if what is not None:
        raise InputError("camera", f"two inputs, {place} and {what}", "one; or hand-eye, or wand, before the second")
    _say(lambda: run(place, target, lens, corners, json, html), json, html, corners=corners)


@app.command()
def allan(
    input: Input,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Measure the noise of every sensor from a log at rest: Allan deviation, its terms, the keys to declare."""
    from sinan.experiments.commands.allan import run

    _say(lambda: run(input, map, json, html, (start, stop), _choice(imu, mag, baro, gps, raw)), json, html)


@app.command("map")
def map_command(
    input: Input,
    out: Annotated[Path, typer.Option("--out", help="folder for the cloud, the grids and the page")],
    cell: Annotated[float, typer.Option(help="side of a cell of the grids, m", min=0.01, max=1000.0)] = 0.5,
    declared: Annotated[
        bool, typer.Option("--declared", help="the mounting as the recording declares it, not as the strips show it")
    ] = False,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
) -> None:
    """Make a map from a flight with a scanning laser: point cloud, terrain, objects, error budget, strips compared."""
    from sinan.experiments.commands.map import run

    _require_place_for(out)
    choice = _choice(imu, mag, baro, gps, raw)
    _say(lambda: run(input, out, cell, not declared, map, json, (start, stop), choice), json, None)


@app.command()
def heights(
    input: Input,
    map: Map = None,
    start: From = None,
    stop: To = None,
    imu: Imu = 0,
    mag: Mag = 0,
    baro: Baro = 0,
    gps: Gps = 0,
    raw: Raw = False,
    json: Json = None,
    html: Html = None,
) -> None:
    """Compare heights of sonar, laser, barometer and GPS with each other and the filter; missing sonar echoes."""
    from sinan.experiments.commands.heights import run

    _say(lambda: run(input, map, json, html, (start, stop), _choice(imu, mag, baro, gps, raw)), json, html)


@app.command()
def lab(
    name: Annotated[
        str | None, typer.Argument(help=f"{', '.join(LABS)}; begin or check, for students; none: the list")
    ] = None,
    what: Annotated[
        str | None, typer.Argument(help=f"begin, check: {', '.join(TITLES)}", metavar="[LAB]", show_default=False)
    ] = None,
    answer: Annotated[
        Path | None, typer.Argument(help="check: answer.json, its data.csv beside it", show_default=False)
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for the page; begin: of the student")] = Path("sinan-lab"),
    student: Annotated[str, typer.Option(help="begin: number or name, from which the data are drawn")] = "",
    secret: Annotated[
        str, typer.Option(envvar="SINAN_LAB_SECRET", help="the teacher's, from which they are drawn too; check: by it")
    ] = "",
    key: Annotated[Path | None, typer.Option(help="begin: file for the teacher's key, not in --out")] = None,
    solved: Annotated[bool, typer.Option("--solved", help="begin: the solved notebook")] = False,
    seals: Annotated[bool, typer.Option(help="begin: so that the student can check too")] = True,
    language: Annotated[Language, typer.Option(help="begin, check: en or zh")] = Language.en,
) -> None:
    """Run the course's experiments, or a lab with data of your own: begin LAB, check LAB ANSWER."""
    if name in ("begin", "check"):
        from sinan.experiments.commands.lab import begin, check
        from sinan.experiments.student_labs.files import Kind

        words: Literal["en", "zh"] = "zh" if language is Language.zh else "en"
        if name == "begin":
            _require_place_for(out)
            _show(begin(what, student, out, Kind(words, solved, seals), secret, key))
        elif not check(what, answer, words, student, secret, _show):
            raise typer.Exit(1)
        return
    from sinan.experiments.labs import run

    if name is None:
        typer.echo("\n".join(f"{key:14} {text}" for key, text in LABS.items()))
    else:
        _require_place_for(out)
        run(name, out)


@app.command()
def effects(
    name: Annotated[
        str | None, typer.Argument(help="of an effect or a sensor; without one, all", metavar="[NAME]")
    ] = None,
    own_effects: OwnEffects = None,
) -> None:
    """List the effects that can be found, or explain one of them."""
    from sinan.experiments.commands.effects import run

    _know(own_effects)
    typer.echo(run(name))


@app.command()
def blind(
    out: Annotated[Path, typer.Argument(help="folder for recordings, answers, reports and rates", metavar="OUT")],
    runs: Annotated[int, typer.Option(help="number of recordings", min=1, max=MOST_RUNS)] = 100,
    seed: Seed = 0,
    world: Annotated[World, typer.Option(help="noise as declared, rough, or each half of the time")] = World.mixed,
    workers: Annotated[int, typer.Option(help="processes", min=1, max=MOST_WORKERS)] = 1,
    html: Html = None,
    measured: Annotated[bool, typer.Option("--measured", help="put effects into minutes of measured logs")] = False,
    logs: Annotated[
        list[str] | None, typer.Option(help="measured: one log, by its name or DATASET/FILE; may be given again")
    ] = None,
    table: Annotated[Path | None, typer.Option(help="measured: file for the page, Markdown", metavar="FILE")] = None,
) -> None:
    """Measure how often traces are right: recordings with hidden effects, answers opened afterwards."""
    _require_place_for(out)
    if measured:
        from sinan.experiments.blind.measured.command import run as run_measured

        _say_as_kept(lambda: run_measured(out, runs, seed, logs or [], workers, table), None, None, table=table)
        return
    from sinan.experiments.commands.blind import run

    _say_as_kept(lambda: run(out, runs, seed, world.value, workers, html), None, html)


def _require_whole_effects(arguments: list[str]) -> None:
    """An effect that a blank cuts in two would be one argument too many: say so as any other near miss."""
    for option, name, value in zip(arguments, arguments[1:], arguments[2:], strict=False):
        if option == "--effect" and "=" not in name and value.lstrip("-.")[:1].isdigit():
            from sinan.experiments.scenarios import parse_effect

            parse_effect(f"{name} {value}")


def _spread(arguments: list[str]) -> list[str]:
    """Positions as three arguments, however their numbers were separated: `X Y Z`, `X,Y,Z` or `"X, Y, Z"`."""
    from sinan.sensors.errors import InputError

    result: list[str] = []
    rest = list(arguments)
    while rest:
        option, equals, value = rest.pop(0).partition("=")
        if equals and option not in ("--position", "--base-position"):
            option, equals = f"{option}={value}", ""
        result.append(option)
        rest = [value, *rest] if equals else rest
        if result[-1] in ("--position", "--base-position"):
            numbers: list[str] = []
            while rest and len(numbers) < 3 and (more := _numbers(rest[0])):
                numbers += more
                rest.pop(0)
            if len(numbers) != 3:
                raise InputError(result[-1], " ".join(numbers) or "no number", "X Y Z: three numbers, ECEF, m")
            result += numbers
    return result


def _numbers(text: str) -> list[str]:
    """The numbers in a text with commas or blanks between; none where anything else is in it."""
    parts = text.replace(",", " ").split()
    try:
        return parts if all(abs(float(part)) < MOST_METRES for part in parts) else []
    except ValueError:
        return []


def _leave_warnings_to_developers() -> None:
    """Say no warning of a library, here or in a worker process, unless `python -W` or PYTHONWARNINGS ask for them."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"


def main() -> None:
    """Entry point: bad input ends with status 1 and one line, bad usage with 2, Ctrl-C with 130 and one line."""
    from sinan.experiments.workers.stopping import listening
    from sinan.sensors.errors import InputError
    from sinan.sensors.files import cannot_write

    _leave_warnings_to_developers()
    try:
        with listening():
            _require_whole_effects(sys.argv[1:])
            app(_spread(sys.argv[1:]))
    except InputError as error:
        _fail(error)
    except OSError as error:
        if error.filename is None:  # of no file: the text could not be written
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left of it would fail again at the end
            _fail(cannot_write("standard output", error, "an output that takes the text"))
        _fail(cannot_write(os.fsdecode(error.filename), error, "a path that can be used"))
    except MemoryError:
        _fail(InputError(" ".join(sys.argv[1:]), "more than the memory holds", "a shorter log, or more memory"))


def _fail(error: Exception) -> NoReturn:
    sys.stderr.write(f"sinan: {error}\n")
    raise SystemExit(1) from None
