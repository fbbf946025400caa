"""Figures of effects that whitened innovations alone do not show, each without the effect in the model and with it.

Pictures by their reprojection residuals, pseudoranges by their residuals at a known place, what tilts `level` by the
specific force, wrong samples of an IMU by their distance from their neighbours.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from drawing import AFTER, BAND, BEFORE, SOFT, panels
from matplotlib.figure import Figure

from sinan.estimator.evidence.alpha import ALPHA
from sinan.estimator.evidence.intervals.outliers import wrong_among
from sinan.estimator.positioning.location import locate
from sinan.estimator.positioning.pseudorange_trace import find_faults
from sinan.estimator.positioning.pseudoranges import FAULT, Candidate, full_sizes, seen_by
from sinan.experiments.gnss.simulated import load, simulate
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.covariates import camera_of, covariates_for
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.motion import Motion
from sinan.sensors.pseudorange import MODELLED, Pseudoranges, circumstances, line_of_sight, sum_of
from sinan.sensors.recording import ACCEL, GYRO, POSITION, QUATERNION, VELOCITY, Recording, Stream
from sinan.sensors.simulate import simulate as fly

TITLES = ("without the effect in the model", "with it")
LONGEST_ARROW = 70.0  # pixels of the figure's picture, for the 95th percentile of the residuals
ARROWS = 350  # of a picture, so that single ones are seen
MASK = np.deg2rad(10.0)  # of the receiver, as `sinan gnss` has it
#: Two hours, so that the satellites move; a receiver at rest on a known place; the broadcast ionosphere is right.
RANGES = """like = "static_p"
seconds = 6900
[rover]
rate = 0.0333
[base]
rate = 0.0333
[air]
ionosphere = 1.0
"""
FAULTY = """[[fault]]
satellite = "G05"
offset = 8.0       # m
drift = 0.002      # m/s
onset = 2400.0     # s
"""
#: Residuals so many times smaller with the effect have an axis of their own.
OWN_AXIS = 30.0
DRAG = 0.25  # 1/s, of the scenarios' vehicle
WIND = (5.0, -5.0)  # m/s to the north and to the east: plausible ones
WINDOW = 0.1  # s of a mean of the specific force, as `level` takes it
NEIGHBOURS = 7  # samples, the one itself among them
SHARE = 0.005  # of wrong samples, so that single ones are seen
SPAN = (20.0, 30.0)  # s of the flight that is drawn
SEED = 1


@dataclass(frozen=True)
class Drawn:
    """A figure and what its caption says.

    Attributes
    ----------
    figure : without and with the effect
    beta : of the effect
    scenario : that was simulated
    rms : without, with
    unit : of rms
    more : for the caption
    """

    figure: Figure
    beta: list[float]
    scenario: str
    rms: tuple[float, float]
    unit: str
    more: dict[str, object] = field(default_factory=dict)


def pictures(effect: Effect, beta: FloatArray, recording: Recording, truth: Stream) -> tuple[Figure, list[float]]:
    """Reprojection residuals, read less predicted from the true pose, as arrows in the picture; their RMS [pixels].

    Those of late stamps follow the turns of the flight, and are drawn over time.
    """
    stream, camera = recording.streams["camera"], camera_of(recording)
    motion = _true_motion(recording, truth, stream.t, "camera")
    place = np.column_stack([stream["u"], stream["v"]])
    plain = camera.predict(motion)
    if effect.other_instants:  # rows of one picture have one stamp, between which no motion can be found
        earlier = _true_motion(recording, truth, stream.t - beta[0], "camera").with_covariates(**motion.covariates)
        full = camera.predict(earlier)
    else:
        full = effect.apply(plain, beta, motion, camera)
    residuals = [place - plain, place - full]
    draw = _over_time if effect.name == "camera.time_offset" else _arrows
    return draw(stream.t, place, residuals), [float(np.sqrt(np.nanmean(r**2))) for r in residuals]


def _arrows(t: FloatArray, place: FloatArray, residuals: list[FloatArray]) -> Figure:
    scale = LONGEST_ARROW / float(np.nanquantile(np.hypot(*residuals[0].T), 0.95))
    unit = next(x for x in (100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0) if x * scale < 1.5 * LONGEST_ARROW)
    some = np.arange(0, len(t), max(1, len(t) // ARROWS))
    as_drawn = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004, "headwidth": 4.0}
    figure, axes = panels(2, height=3.1, sharey=True)
    for one, r, colour, title in zip(axes[0], residuals, (BEFORE, AFTER), TITLES, strict=True):
        one.plot([0, 640, 640, 0, 0], [0, 0, 480, 480, 0], color=BAND, lw=1)
        one.quiver(*place[some].T, *(scale * r[some].T), color=colour, **as_drawn)
        one.quiver(20, 540, scale * unit, 0, color="black", **as_drawn)
        one.text(30 + scale * unit, 540, f"{unit:g} pixel{'s' if unit > 1 else ''}", fontsize=8, va="center")
        one.set(xlim=(-40, 680), ylim=(570, -40), aspect="equal", xlabel="u [pixel]")
        one.set_title(title, fontsize=9, loc="left")
    axes[0, 0].set_ylabel("v [pixel]")
    return figure


def _over_time(t: FloatArray, place: FloatArray, residuals: list[FloatArray]) -> Figure:
    figure, axes = panels(2, sharey=True)
    for one, r, colour, title in zip(axes[0], residuals, (BEFORE, AFTER), TITLES, strict=True):
        one.plot(t, r[:, 0], ".", ms=2.5, color=colour)
        one.set_title(title, fontsize=9, loc="left")
        one.set_xlabel("time [s]")
    axes[0, 0].set_ylabel("residual of u [pixel]")
    return figure


def ranges(name: str) -> Drawn:
    """Range residuals at a known position, one receiver clock an epoch taken off, over elevation or time."""
    text = RANGES + (FAULTY if name == FAULT.name else "")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rover.toml"
        path.write_text(text, encoding="utf-8")
        simulated = simulate(load(str(path)), SEED)
    rover, _ = simulated.ranges()
    motion = circumstances(rover, simulated.position)
    kept = np.asarray(motion.covariates["elevation"] > MASK)
    others = [one for one in MODELLED if one != name]
    if name == FAULT.name:
        beta, own, satellite = _fault(rover, motion)
    else:
        beta, own, satellite = full_sizes(locate(rover), simulated.position)[name], sum_of(motion, [name]), ""
    distance, _ = line_of_sight(rover.position, simulated.position[rover.epoch])
    plain = rover.value - distance - sum_of(motion, others)
    residuals = [_without_clock(rover, r, kept) for r in (plain, plain - own)]
    over_elevation = name in ("pseudorange.troposphere", "pseudorange.ionosphere")
    x = np.rad2deg(motion.covariates["elevation"]) if over_elevation else (rover.time - rover.t[0]) / 60.0
    label = "elevation [deg]" if over_elevation else "time [min]"
    figure = _of_ranges(x[kept], [r[kept] for r in residuals], label, rover.satellite[kept] == satellite, satellite)
    rms = [float(np.sqrt(np.mean(r[kept] ** 2))) for r in residuals]
    more: dict[str, object] = {"satellite": satellite} if satellite else {}
    return Drawn(figure, [float(f"{b:.3g}") for b in beta], "static_p", (rms[0], rms[1]), "m", more)


def _fault(rover: Pseudoranges, motion: Motion) -> tuple[FloatArray, FloatArray, str]:
    """Size, range error and satellite of the fault that the trace finds."""
    fault = find_faults(rover, MASK, ALPHA)[0][0]
    assert fault.interval is not None
    seen = seen_by(Candidate(FAULT.name, fault.satellite, fault.interval[0]), rover, motion)
    return fault.full, np.asarray(FAULT.regressor(seen)[:, 0] @ fault.full), str(fault.satellite)


def _without_clock(rover: Pseudoranges, residual: FloatArray, kept: BoolArray) -> FloatArray:
    """Less the mean of its epoch's rows that are kept."""
    total = np.bincount(rover.epoch[kept], residual[kept], len(rover.t))
    count = np.bincount(rover.epoch[kept], minlength=len(rover.t))
    return np.asarray(residual - (total / np.maximum(count, 1))[rover.epoch])


def _of_ranges(x: FloatArray, residuals: list[FloatArray], label: str, marked: BoolArray, satellite: str) -> Figure:
    sizes = [float(np.max(np.abs(r))) for r in residuals]
    shared = sizes[0] < OWN_AXIS * sizes[1]
    figure, axes = panels(2, sharey=shared)
    for one, r, colour, title, size in zip(axes[0], residuals, (BEFORE, AFTER), TITLES, sizes, strict=True):
        in_km = size > 3000.0
        one.axhline(0.0, color=BAND, lw=1)
        one.plot(x[~marked], r[~marked] / (1000.0 if in_km else 1.0), ".", ms=2.5, color=colour)
        if marked.any():
            one.plot(x[marked], r[marked], "x", ms=3.5, mew=0.8, color="black", label=satellite)
            one.legend(frameon=False, fontsize=8, loc="upper left")
        one.set_title(title, fontsize=9, loc="left")
        one.set_xlabel(label)
        if one is axes[0, 0] or not shared:
            one.set_ylabel(f"range residual [{'km' if in_km else 'm'}]")
    return figure


def specific_force(name: str) -> Drawn:
    """Horizontal specific force in the body less what the model says, along the true motion of a flight."""
    effect = CATALOGUE[name]
    of_speed = name == "motion.rotor_drag"
    beta = np.array([DRAG]) if of_speed else np.array(WIND)
    scenario = load_scenario(effect.scenario)
    present = parse_effect(f"{name}={','.join(f'{b:g}' for b in beta)}")
    recording, truth = fly(scenario, np.random.default_rng(SEED), [present])
    imu = recording.streams["imu"]
    motion = _true_motion(recording.replace(effects={"motion.rotor_drag": (DRAG,)}), truth, imu.t)
    calm = motion.with_covariates(wind=np.zeros((len(motion), 2)))
    through_calm_air = CATALOGUE["motion.rotor_drag"].regressor(calm)[:, :, 0]  # minus the speed along body x and y
    bias = np.stack([np.interp(imu.t, truth.t, truth[f"bias_accel_{axis}"]) for axis in "xyz"], axis=1)
    plain = imu.array(ACCEL) - bias - (0.0 if of_speed else DRAG * through_calm_air)
    left = [_means(imu, r) for r in (plain, plain - effect.regressor(motion) @ beta)]
    x = -_means(imu, through_calm_air)[:, 0] if of_speed else _means(imu, imu.t)[:, 0]
    figure, axes = panels(2, sharey=True)
    for one, r, colour, title in zip(axes[0], left, (BEFORE, AFTER), TITLES, strict=True):
        one.axhline(0.0, color=BAND, lw=1)
        one.plot(x, r[:, 0], ".", ms=2.5, color=colour)
        one.set_title(title, fontsize=9, loc="left")
        one.set_xlabel("speed ahead [m/s]" if of_speed else "time [s]")
    axes[0, 0].set_ylabel("residual of f$_x$ [m/s$^2$]")
    rms = [float(np.sqrt(np.mean(r[:, :2] ** 2))) for r in left]
    return Drawn(figure, beta.tolist(), scenario.name, (rms[0], rms[1]), "m/s^2")


def _true_motion(recording: Recording, truth: Stream, t: FloatArray, stream: str = "level") -> Motion:
    """Of the simulation at some instants, with what the effects of a stream need."""
    motion = Motion(t=truth.t, p_n=truth.array(POSITION), v_n=truth.array(VELOCITY), q_nb=truth.array(QUATERNION))
    return motion.at(t).with_covariates(**covariates_for(recording, stream, t))


def _means(imu: Stream, values: FloatArray) -> FloatArray:
    """Over windows of `WINDOW`."""
    window = round(WINDOW / float(np.median(np.diff(imu.t))))
    count = len(imu.t) // window
    return np.asarray(values[: count * window].reshape(count, window, -1).mean(axis=1))


def wrong_samples(name: str) -> Drawn:
    """Samples of the IMU less the median of their neighbours, and without those that are called wrong."""
    from scipy.ndimage import median_filter

    sensor, scenario = name.split(".")[0], CATALOGUE[name].scenario
    columns, unit = (ACCEL, "m/s^2") if sensor == "accel" else (GYRO, "rad/s")
    recording, _ = fly(load_scenario(scenario), np.random.default_rng(SEED), [parse_effect(f"{name}={SHARE}")])
    right, _ = fly(load_scenario(scenario), np.random.default_rng(SEED))
    t, read = recording.streams["imu"].t, recording.streams["imu"].array(columns)
    truly = np.flatnonzero(np.any(read != right.streams["imu"].array(columns), axis=1))
    found = wrong_among(read)
    assert found is not None
    away = read - median_filter(read, size=(NEIGHBOURS, 1), mode="nearest")
    is_wrong = np.isin(np.arange(len(read)), found.row)
    drawn = (t > SPAN[0]) & (t < SPAN[1])
    figure, axes = panels(2, sharey=True)
    for one, rows, colour, title in zip(
        axes[0], (drawn & ~is_wrong,) * 2, (SOFT, AFTER), ("as read", "without what is called wrong"), strict=True
    ):
        one.plot(t[rows], away[rows, 0], ".", ms=1.5, color=colour)
        one.set_title(title, fontsize=9, loc="left")
        one.set_xlabel("time [s]")
    axes[0, 0].plot(t[drawn & is_wrong], away[drawn & is_wrong, 0], "x", ms=5, color=BEFORE)
    axes[0, 0].set_ylabel(f"x, less its neighbours [{_in_text(unit)}]")
    rms = [float(np.sqrt(np.mean(part**2))) for part in (away, away[~is_wrong])]
    more: dict[str, object] = {
        "samples": len(read), "wrong": len(truly), "called": len(found.row),
        "both": len(np.intersect1d(found.row, truly)),
    }  # fmt: skip
    return Drawn(figure, [SHARE], scenario, (rms[0], rms[1]), unit, more)


def _in_text(unit: str) -> str:
    return unit.replace("^2", "$^2$")


DRAWN: dict[str, Callable[[str], Drawn]] = {
    **{name: ranges for name in CATALOGUE if name.startswith("pseudorange.")},
    "motion.rotor_drag": specific_force,
    "motion.wind": specific_force,
    "accel.outliers": wrong_samples,
    "gyro.outliers": wrong_samples,
}
