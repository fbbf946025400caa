"""`sinan.read`, `sinan.simulate`, `sinan.cut`: recordings from logs and from scenarios."""

from __future__ import annotations

from numbers import Integral
from pathlib import Path

from sinan.experiments.datasets import resolve
from sinan.experiments.scenarios import Effects, simulated
from sinan.sensors.errors import InputError
from sinan.sensors.formats.choice import Choice
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario
from sinan.sensors.window import window


def read(
    path: str | Path,
    *,
    map: str | Path | None = None,
    start: float | None = None,
    stop: float | None = None,
    imu: int = 0,
    mag: int = 0,
    baro: int = 0,
    gps: int = 0,
    raw: bool = False,
) -> Recording:
    """Read a recording: a folder in the plain format, a log, or DATASET/FILE of a known data set.

    Parameters
    ----------
    path : of a folder or file, or DATASET/FILE; PX4's ULog, ArduPilot's .bin and .log, MAVLink's .tlog, ROS bags are
        read as they are
    map : TOML file that says how to read a log of another format
    start, stop : select a part, s after the first IMU sample (of poses: pose); None: from its beginning, to its end
    imu, mag, baro, gps : which of several sensors of a kind in an autopilot's log, counted from 0
    raw : undo the autopilot's own offsets, scales and compensation

    Returns
    -------
    Recording: SI units, body axes x forward, y right, z down (FRD), NED; magnetic field in the unit of the log

    Raises
    ------
    InputError : a file that cannot be read: where, what was found and what was expected

    Examples
    --------
    >>> import sinan
    >>> recording = sinan.read("flight", start=5.0, stop=25.0)
    >>> recording.kind, "gps" in recording.streams, round(float(recording.streams["imu"].t[0]))
    ('flight', True, 5)
    """
    choice = Choice(imu, mag, baro, gps, raw)
    return resolve(str(path), None if map is None else Path(map), (start, stop), choice)


def simulate(
    scenario: str | Path | Scenario, *, seed: int = 0, effects: Effects = (), declare: bool = False
) -> Recording:
    """Simulate a scenario: a recording with noise, biases, and their true values.

    Parameters
    ----------
    scenario : name of one that is shipped (docs/scenarios.md), a TOML file, or a `Scenario`
    seed : of the random numbers: the same seed gives the same recording
    effects : effects to add to the readings: by name, with the parameters in the order and the units of the catalogue,
        `{"mag.current": [0.003, 0.0, 0.001]}`; or as `--effect` takes them, `["gps.transient=4,0,0@20:30"]` [s]
    declare : declare the effects in the recording, so that estimators model them; else estimators do not know of them

    Returns
    -------
    Recording: its `truth` has position, velocity, attitude and biases (reading = truth + bias + noise)

    Raises
    ------
    InputError : no such scenario or effect, or one that does not fit; a seed that is none

    Examples
    --------
    >>> import sinan
    >>> recording = sinan.simulate("hover", seed=1, effects={"mag.current": [0.003, 0.0, 0.001]})
    >>> recording.streams["imu"]["accel_z"].mean().round(1).item()
    -9.8
    """
    if not isinstance(seed, Integral) or seed < 0:
        raise InputError("seed", f"{seed}", "a whole number from 0 on")
    return simulated(scenario, effects, int(seed), declare)[0]


def cut(recording: Recording, start: float | None = None, stop: float | None = None) -> Recording:
    """A part of a recording: the same time span of all its streams.

    Parameters
    ----------
    recording : of any kind
    start, stop : s after the first IMU sample (of poses: pose); None: from its beginning, to its end

    Returns
    -------
    Recording

    Raises
    ------
    InputError : none of the streams has readings there

    Examples
    --------
    >>> import sinan
    >>> part = sinan.cut(sinan.simulate("hover", seed=1), 5.0, 10.0)
    >>> [round(float(part.streams["imu"].t[k])) for k in (0, -1)]
    [5, 10]
    """
    return window(recording, (start, stop))
