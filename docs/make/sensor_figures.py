"""A figure a sensor: `python docs/make/sensor_figures.py [NAME ...]`, kept in `docs/figures/sensors`.

Each is drawn from the models themselves, with simulated recordings of seed 1 where noise is in it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from drawing import AFTER, BEFORE, SOFT, keep, panels
from matplotlib.figure import Figure

from sinan.calibration.levels.allan import allan_deviation, fit_allan
from sinan.calibration.poses.triad import calibrate_norm
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.scenarios import load_scenario, parse_effect
from sinan.sensors.atmosphere import height_from_pressure, pressure_from_height
from sinan.sensors.effects import sonar_beam_cone
from sinan.sensors.effects.pseudorange_ionosphere import obliquity
from sinan.sensors.effects.pseudorange_troposphere import mapping, zenith_delay
from sinan.sensors.laser import course_scan_error
from sinan.sensors.lenses import bend
from sinan.sensors.motion import Motion
from sinan.sensors.noise import BiasProcess, random_walk
from sinan.sensors.ranging import slant_range
from sinan.sensors.recording import Recording, Stream
from sinan.sensors.rotation import quaternion_from_rpy
from sinan.sensors.simulate import simulate

FOLDER = Path(__file__).parents[1] / "figures" / "sensors"


def _recording(scenario: str, *effects: str) -> tuple[Recording, SimpleNamespace]:
    present = [parse_effect(text) for text in effects]
    recording, truth = simulate(load_scenario(scenario), np.random.default_rng(1), present)
    return recording, SimpleNamespace(t=truth.t, **truth.columns)


def _triad(stream: Stream, name: str) -> np.ndarray:
    return np.stack([stream.columns[f"{name}_{axis}"] for axis in "xyz"], axis=-1)


def accelerometer() -> Figure:
    """The norm of poses before and after the course's calibration."""
    recording, _ = _recording("accel_poses", "accel.cross_axis=0.02,0,-0.015")
    reading = _triad(recording.streams["poses"], "accel")
    figure, axes = panels(2, sharey=True)
    norm = 9.80665
    for one, form, title in zip(axes[0], ("none", "triangular"), ("scale and offset", "and crooked axes"), strict=True):
        found = calibrate_norm("accel", reading, norm, form)
        calibrated = (reading + found.offset) * found.K @ found.T_seen.T
        one.axhline(norm, color=SOFT, lw=1)
        one.plot(np.linalg.norm(reading, axis=1), ".", ms=3, color=BEFORE, label="as read")
        one.plot(np.linalg.norm(calibrated, axis=1), ".", ms=3, color=AFTER, label="calibrated")
        one.set_xlabel("reading")
        one.set_title(title, loc="left", fontsize=9)
    axes[0, 0].set_ylabel("norm [m/s$^2$]")
    axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def gyroscope() -> Figure:
    """Allan deviation of an hour at rest, and what is read off it."""
    rate, density, walk = 100.0, 2e-4, 2e-5
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 3600.0, 1.0 / rate)
    bias = random_walk(t, BiasProcess("b_gyro", 1, 0.0, walk), rng)[:, 0]
    w = bias + density * np.sqrt(rate) * rng.standard_normal(len(t))
    tau, deviation, error = allan_deviation(w, rate)
    fit = fit_allan(w, rate)
    figure, axes = panels(height=3.0)
    one = axes[0, 0]
    one.errorbar(tau, deviation, 2 * error, fmt="o", ms=3, color=AFTER, lw=1, label="simulated, two sigma")
    one.loglog(tau, density / np.sqrt(tau), "--", color=BEFORE, lw=1, label="white noise  N / sqrt(tau)")
    one.loglog(tau, walk * np.sqrt(tau / 3), ":", color="black", lw=1, label="random walk  w sqrt(tau / 3)")
    one.set(xlabel="averaging time tau [s]", ylabel="Allan deviation [rad/s]")
    one.set_title(f"found N = {fit.noise_density:.3g} of {density:g}, w = {fit.bias_walk:.2g} of {walk:g}", fontsize=9)
    one.legend(frameon=False, fontsize=8)
    return figure


def magnetometer() -> Figure:
    """What two calibrations leave of the norm of a turned magnetometer."""
    recording, _ = _recording("mag_poses", "mag.cross_axis=0.08,0,0")
    reading = _triad(recording.streams["mag"], "mag")
    norm = float(np.linalg.norm(recording.environment.magnetic_field))
    figure, axes = panels(2, height=3.2)
    forms = (("none", "hard iron and scale taken off"), ("triangular", "and soft iron"))
    for one, (form, title) in zip(axes[0], forms, strict=True):
        found = calibrate_norm("mag", reading, norm, form)
        calibrated = (reading + found.offset) * found.K @ found.T_seen.T
        left = np.linalg.norm(calibrated, axis=1) - norm
        one.hist(left, 24, color=AFTER)
        one.set_title(f"{title}: {np.std(left):.4f}", loc="left", fontsize=9)
        one.set_xlabel("norm less that of the field [field]")
    axes[0, 0].set_ylabel("readings")
    return figure


def _tilted(angles: np.ndarray, height: float) -> Motion:
    zero = np.zeros_like(angles)
    p_n = np.tile([0.0, 0.0, -height], (len(angles), 1))
    q_nb = quaternion_from_rpy(np.stack([angles, zero, zero], axis=-1))
    return Motion(t=np.arange(len(angles), dtype=float), p_n=p_n, v_n=np.zeros((len(angles), 3)), q_nb=q_nb)


def sonar() -> Figure:
    """Range over the tilt: along the axis, and of the nearest point of a cone."""
    angles = np.deg2rad(np.linspace(0, 35, 200))
    motion = _tilted(angles, 2.0)
    axis = slant_range(motion)
    figure, axes = panels()
    one = axes[0, 0]
    one.plot(np.rad2deg(angles), axis, color=AFTER, label="plain model: along the axis, h / cos(tilt)")
    for half, style in ((0.2, "-"), (0.4, "--")):
        cone = sonar_beam_cone.exact(axis[:, None], np.array([half]), motion)[:, 0]
        one.plot(np.rad2deg(angles), cone, style, color=BEFORE, label=f"nearest point of a cone of {half} rad")
    one.set(xlabel="tilt [deg]", ylabel="range [m], 2 m above the ground")
    one.legend(frameon=False, fontsize=8)
    return figure


def barometer() -> Figure:
    """A reading less the true height: bias that wanders, and white noise."""
    recording, truth = _recording("figure_eight")
    baro = recording.streams["baro"]
    height = np.interp(baro.t, truth.t, -truth.down)
    pressure = pressure_from_height(np.linspace(0, 3000, 50))
    figure, axes = panels(2)
    axes[0, 0].plot(baro.t, baro.columns["height"].ravel() - height, ".", ms=1.5, color=AFTER, label="reading - truth")
    axes[0, 0].plot(truth.t, truth.bias_baro.ravel(), color="black", lw=1.2, label="its bias")
    axes[0, 0].set(xlabel="time [s]", ylabel="[m]")
    axes[0, 0].legend(frameon=False, fontsize=8)
    for change, colour in ((-500.0, AFTER), (500.0, BEFORE)):
        wrong = height_from_pressure(pressure + change) - height_from_pressure(pressure)
        axes[0, 1].plot(np.linspace(0, 3000, 50), wrong, color=colour, label=f"weather {change / 100:+.0f} hPa")
    axes[0, 1].set(xlabel="height [m]", ylabel="error of the height [m]")
    axes[0, 1].legend(frameon=False, fontsize=8)
    return figure


def laser() -> Figure:
    """The course's mean over a scan against the roll."""
    roll = np.deg2rad(np.linspace(-25, 25, 200))
    figure, axes = panels()
    for half, colour in ((15, SOFT), (30, AFTER), (45, BEFORE)):
        angles = np.deg2rad(np.linspace(-half, half, 61))
        error = 100 * course_scan_error(angles, roll)
        axes[0, 0].plot(np.rad2deg(roll), error, color=colour, label=f"scan of +-{half} deg")
    axes[0, 0].set(xlabel="roll [deg]", ylabel="mean of r cos(a), too long by [%]")
    axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def gps() -> Figure:
    """Error north of the filter, with the GPS alone and with a base receiver that shows the bias."""
    recording, truth = _recording("base_receiver")
    alone = replace(recording, streams={k: v for k, v in recording.streams.items() if k != "base"})
    figure, axes = panels(2, sharey=True)
    for one, log, title in zip(axes[0], (alone, recording), ("GPS alone", "with a base receiver"), strict=True):
        journal = run_filter(Flight.of(log), stride=20)
        error = journal.imu_x[:, 0] - np.interp(journal.imu_t, truth.t, truth.north)
        sigma = 2 * np.sqrt(journal.imu_var[:, 0])
        one.fill_between(journal.imu_t, -sigma, sigma, color=AFTER, alpha=0.18, lw=0, label="two sigma of the filter")
        one.plot(journal.imu_t, error, color=AFTER, lw=1.2, label="error")
        one.set_title(title, loc="left", fontsize=9)
        one.set_xlabel("time [s]")
    axes[0, 0].set_ylabel("north [m]")
    axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def camera() -> Figure:
    """Where a lens puts a square grid."""
    x = np.linspace(-0.6, 0.6, 13)
    grid = np.stack(np.meshgrid(x, x), axis=-1)
    figure, axes = panels(2, height=3.4)
    for one, k, title in zip(
        axes[0], ((-0.25, 0.05, 0, 0), (0.0, 0.0, 0.02, 0.02)), ("radial, k1 = -0.25", "tangential"), strict=True
    ):
        bent = bend(grid.reshape(-1, 2), np.array(k)).reshape(grid.shape)
        for line in (*bent, *bent.transpose(1, 0, 2)):
            one.plot(line[:, 0], line[:, 1], color=AFTER, lw=1)
        one.plot(grid[..., 0], grid[..., 1], ".", ms=2, color=SOFT)
        one.set_aspect("equal")
        one.set_title(title, loc="left", fontsize=9)
        one.set(xlabel="x = X / Z", ylabel="y = Y / Z")
    return figure


def pseudoranges() -> Figure:
    """What the atmosphere adds, over the elevation."""
    elevation = np.deg2rad(np.linspace(5, 90, 200))
    wet = float(np.ravel(zenith_delay(np.array([0.7]), np.array([50.0])))[0])
    figure, axes = panels()
    one = axes[0, 0]
    one.plot(
        np.rad2deg(elevation), wet * mapping(elevation), color=AFTER, label=f"troposphere, {wet:.2f} m at the zenith"
    )
    one.plot(np.rad2deg(elevation), 5.0 * obliquity(elevation), color=BEFORE, label="ionosphere, 5 m at the zenith")
    one.set(xlabel="elevation [deg]", ylabel="delay [m]")
    one.legend(frameon=False, fontsize=8)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    f.__name__: f for f in (accelerometer, gyroscope, magnetometer, sonar, barometer, laser, gps, camera, pseudoranges)
}


def main(names: list[str]) -> None:
    """Draw those, or all."""
    for name in names or FIGURES:
        keep(FIGURES[name](), FOLDER / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
