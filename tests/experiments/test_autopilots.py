"""Parameters of autopilots: what a trace found is gone once the autopilot's own documented correction has them.

The corrections are written out here as PX4 (1.14, `src/lib/sensor_calibration`, `src/modules/ekf2`,
`src/lib/temperature_compensation`) and ArduPilot (4.5, `AP_Compass_Backend::correct_field`,
`AP_InertialSensor_Backend::_rotate_and_correct_accel`, `AP_InertialSensor_tempcal`, `AP_Baro_Wind`, `AP_NavEKF3`) have
them, about values read from the file that the ground station would load.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sinan.experiments.answers.traces import in_its_terms
from sinan.experiments.autopilots.files import as_file
from sinan.experiments.autopilots.findings import Findings, findings_of
from sinan.experiments.autopilots.parameters import autopilot_of, facts_of_log, params_for
from sinan.experiments.commands.cli import app
from sinan.experiments.datasets import log_of, resolve
from sinan.experiments.scenarios.loader import load_scenario
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.formats.choice import Choice
from sinan.sensors.formats.facts import Facts
from sinan.sensors.motion import Motion
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream
from sinan.sensors.rotation import matrix_from_quaternion, quaternion_from_rpy
from sinan.sensors.simulate import simulate
from sinan.sensors.window import window
from tests.experiments.test_own_logs import FIELD, dataflash, flight, ulog
from tests.flights import scenario_at

SINGLE = 3e-7  # a file has 32 bits a number
G = 9.80665
Values = Mapping[str, float]


def three(values: Values, form: str, default: float = 0.0) -> np.ndarray:
    return np.array([values.get(form.format(axis), default) for axis in "XYZ"])


def symmetric(diagonal: np.ndarray, off: np.ndarray) -> np.ndarray:
    x, y, z = off
    return np.diag(diagonal) + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]])


def euler(degrees: np.ndarray) -> np.ndarray:
    """Dcm of roll, pitch, yaw, in that order about the turned axes' fixed predecessors: Rz(yaw) Ry(pitch) Rx(roll)."""
    (r, p, y) = np.radians(degrees)
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


#: The numbered rotations of the tests: none, yaw 270, roll 180 yaw 90, pitch 180.
NUMBERED = {0: (0, 0, 0), 6: (0, 0, 270), 10: (180, 0, 90), 12: (0, 180, 0)}


def of_file(text: str) -> dict[str, float]:
    """As QGroundControl (five columns) and Mission Planner (name and value) read a file."""
    found = {}
    for line in text.splitlines():
        if line.startswith("#") or not line.strip():
            continue
        if "\t" in line:
            vehicle, component, name, value, kind = line.split("\t")
            assert (vehicle, component) == ("1", "1")
            assert kind == ("6" if "." not in value and "e" not in value and _is_whole(name) else "9"), line
        else:
            name, value = line.split(",")
        assert len(name) <= 16, "longer than MAVLink's PARAM_SET takes"
        found[name] = float(value)
    return found


def _is_whole(name: str) -> bool:
    return name.endswith(("_ROT", "_TYP", "_TYPE", "_ENABLE", "_ID"))


def loaded(autopilot: str, effects: Mapping[str, object], before: Values, **known: object) -> dict[str, float]:
    """The log's parameters with the file's in their place."""
    betas = {name: np.array(beta, dtype=np.float64) for name, beta in effects.items()}
    found = Findings(betas, **known)  # type: ignore[arg-type]
    facts = Facts("a log", autopilot={"px4": "PX4", "ardupilot": "ArduPilot"}[autopilot], parameters=before)
    params = params_for(autopilot, found, facts)
    assert not params.without
    return {**before, **of_file(as_file(params))}


# --- the documented corrections ---------------------------------------------------------------------------


def px4_mag(raw: np.ndarray, current: np.ndarray, values: Values, k: int = 0) -> np.ndarray:
    """`Magnetometer::Correct`: R (S ((data + power COMP) - OFF)), power = battery current in kA for type 2."""
    cal = f"CAL_MAG{k}"
    number = values.get(f"{cal}_ROT", -1.0)
    own = [values.get(f"{cal}_{angle}", 0.0) for angle in ("ROLL", "PITCH", "YAW")]
    if number == -1.0:
        R = euler(three(values, "SENS_BOARD_{}_OFF")) @ euler(np.array(NUMBERED[int(values.get("SENS_BOARD_ROT", 0))]))
    else:
        R = euler(np.array(own)) if number == 100.0 else euler(np.array(NUMBERED[int(number)]))
    S = symmetric(three(values, f"{cal}_{{}}SCALE", 1.0), three(values, f"{cal}_{{}}ODIAG"))
    power = 0.001 * current if values.get("CAL_MAG_COMP_TYP", 0.0) == 2.0 else 0.0 * current
    data = raw + power[:, None] * three(values, f"{cal}_{{}}COMP") - three(values, f"{cal}_{{}}OFF")
    return np.asarray(data @ (R @ S).T)


def px4_mag_raw(field: np.ndarray, current: np.ndarray, values: Values) -> np.ndarray:
    """What the chip read, of what its correction made of it."""
    none = px4_mag(np.zeros_like(field), current, values)
    M = np.stack([px4_mag(np.eye(3)[[i]], np.zeros(1), {**values, **ZERO_OFF})[0] for i in range(3)], axis=1)
    return np.asarray((field - none) @ np.linalg.inv(M).T)


ZERO_OFF = dict.fromkeys(("CAL_MAG0_XOFF", "CAL_MAG0_YOFF", "CAL_MAG0_ZOFF"), 0.0)


def ardupilot_mag(raw: np.ndarray, current: np.ndarray, values: Values, k: str = "") -> np.ndarray:
    """`rotate_field`, `correct_field`, gauss: mat (R raw + OFS) SCALE, then motor compensation, type 2 by current."""
    number = int(values.get(f"COMPASS_ORIENT{k}", 0))
    angles = [values.get(f"CUST_ROT1_{angle}", 0.0) for angle in ("ROLL", "PITCH", "YAW")]
    R = euler(np.array(angles)) if number == 101 else euler(np.array(NUMBERED[number]))
    field = (raw @ R.T + 1e-3 * three(values, f"COMPASS_OFS{k}_{{}}")) * (values.get(f"COMPASS_SCALE{k}", 0.0) or 1.0)
    diagonal = three(values, f"COMPASS_DIA{k}_{{}}")
    if np.any(diagonal):
        field = field @ symmetric(diagonal, three(values, f"COMPASS_ODI{k}_{{}}")).T
    motor = 1e-3 * current[:, None] * three(values, f"COMPASS_MOT{k}_{{}}")
    return np.asarray(field + (motor if values.get("COMPASS_MOTCT", 0.0) == 2.0 else 0.0))


def ardupilot_mag_raw(field: np.ndarray, current: np.ndarray, values: Values) -> np.ndarray:
    none = ardupilot_mag(np.zeros_like(field), current, values)
    zero = {**values, **dict.fromkeys(("COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z"), 0.0)}
    M = np.stack([ardupilot_mag(np.eye(3)[[i]], np.zeros(1), zero)[0] for i in range(3)], axis=1)
    return np.asarray((field - none) @ np.linalg.inv(M).T)


def px4_imu(raw: np.ndarray, T: np.ndarray, values: Values, sensor: str) -> np.ndarray:
    """`Accelerometer::Correct` R ((data - thermal - OFF) SCALE), `Gyroscope::Correct` without a scale; thermal offset
    by `TemperatureCompensation::calc_thermal_offsets_3D`: X0 + X1 dT, dT = T - TREF within TMIN to TMAX.
    """
    kind, group, scaled = {"accel": ("ACC", "A", True), "gyro": ("GYRO", "G", False)}[sensor]
    R = euler(three(values, "SENS_BOARD_{}_OFF")) @ euler(np.array(NUMBERED[int(values.get("SENS_BOARD_ROT", 0))]))
    thermal = np.zeros_like(raw)
    if values.get(f"TC_{group}_ENABLE", 0.0) == 1.0:
        assert values[f"TC_{group}0_ID"] == values[f"CAL_{kind}0_ID"]
        dT = np.clip(T, values[f"TC_{group}0_TMIN"], values[f"TC_{group}0_TMAX"]) - values[f"TC_{group}0_TREF"]
        X0, X1 = ([values[f"TC_{group}0_X{order}_{axis}"] for axis in range(3)] for order in (0, 1))
        thermal = np.array(X0) + dT[:, None] * np.array(X1)
    scale = three(values, f"CAL_{kind}0_{{}}SCALE", 1.0) if scaled else 1.0
    return np.asarray((raw - thermal - three(values, f"CAL_{kind}0_{{}}OFF")) * scale @ R.T)


def ardupilot_imu(raw: np.ndarray, T: np.ndarray, values: Values, sensor: str) -> np.ndarray:
    """Temperature calibration v -= P(T) - P(calibration's T), P(T) = c1 (T - 35 degC) / 1e6; offset, scale, board."""
    kind = {"accel": "ACC", "gyro": "GYR"}[sensor]
    v = np.array(raw)
    if values.get("INS_TCAL1_ENABLE", 0.0) == 1.0:
        low, high = values["INS_TCAL1_TMIN"], values["INS_TCAL1_TMAX"]
        c1 = three(values, f"INS_TCAL1_{kind}1_{{}}") * 1e-6
        at = np.clip([*T, values[f"INS_{kind}1_CALTEMP"]], low, high)
        v = v - (at[:-1] - at[-1])[:, None] * c1
    v = v - three(values, f"INS_{kind}OFFS_{{}}")
    v = v * (three(values, "INS_ACCSCAL_{}", 1.0) if sensor == "accel" else 1.0)
    return np.asarray(v @ euler(np.array(NUMBERED[int(values.get("AHRS_ORIENTATION", 0))])).T)


# --- signs, frames and units ------------------------------------------------------------------------------

PX4_MAG = {
    "CAL_MAG0_ID": 197388.0, "CAL_MAG0_ROT": 6.0, "CAL_MAG0_XOFF": 0.05, "CAL_MAG0_YOFF": -0.08, "CAL_MAG0_ZOFF": 0.02,
    "CAL_MAG0_XSCALE": 1.05, "CAL_MAG0_YSCALE": 0.96, "CAL_MAG0_ZSCALE": 1.02, "CAL_MAG0_XODIAG": 0.02,
    "CAL_MAG0_YODIAG": -0.03, "CAL_MAG0_ZODIAG": 0.01, "CAL_MAG_COMP_TYP": 2.0, "CAL_MAG0_XCOMP": 1.5,
    "CAL_MAG0_YCOMP": -0.7, "CAL_MAG0_ZCOMP": 0.4,
}  # fmt: skip
ARDUPILOT_MAG = {
    "COMPASS_EXTERNAL": 1.0, "COMPASS_ORIENT": 10.0, "COMPASS_OFS_X": 61.0, "COMPASS_OFS_Y": -42.0,
    "COMPASS_OFS_Z": 33.0, "COMPASS_SCALE": 1.1, "COMPASS_DIA_X": 1.02, "COMPASS_DIA_Y": 0.97, "COMPASS_DIA_Z": 1.08,
    "COMPASS_ODI_X": 0.03, "COMPASS_ODI_Y": -0.04, "COMPASS_ODI_Z": 0.05, "COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 1.1,
    "COMPASS_MOT_Y": -2.0, "COMPASS_MOT_Z": 0.5, "CUST_ROT_ENABLE": 0.0,
}  # fmt: skip
MAGS: dict[str, tuple[Callable[..., np.ndarray], Callable[..., np.ndarray], Values]] = {
    "px4": (px4_mag, px4_mag_raw, PX4_MAG),
    "ardupilot": (ardupilot_mag, ardupilot_mag_raw, ARDUPILOT_MAG),
}
BOTH = pytest.mark.parametrize("autopilot", list(MAGS))


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Any motion."""
    rng = np.random.default_rng(3)
    n = 200
    q = rng.standard_normal((n, 4))
    return Motion(
        t=np.arange(n) / 10.0, p_n=rng.normal(0.0, 20.0, (n, 3)), v_n=rng.normal(0.0, 4.0, (n, 3)),
        q_nb=q / np.linalg.norm(q, axis=1)[:, None], f_b=rng.normal(0.0, 6.0, (n, 3)),
        w_ib_b=rng.normal(0.0, 1.0, (n, 3)), dw_b=rng.normal(0.0, 3.0, (n, 3)), m_n=np.array([[0.2, 0.03, 0.43]]),
        covariates={"current": rng.uniform(0.0, 40.0, n), "temperature": rng.uniform(18.0, 55.0, n)},
    )  # fmt: skip


def field_of(motion: Motion) -> np.ndarray:
    C_nb = matrix_from_quaternion(motion.q_nb)
    return np.asarray(np.einsum("nji,j->ni", C_nb, motion.m_n[0]))


def with_effects(plain: np.ndarray, effects: Mapping[str, object], motion: Motion) -> np.ndarray:
    """Effects add, each taken of the plain reading."""
    return np.asarray(plain + sum(CATALOGUE[n].change(plain, np.array(b), motion) for n, b in effects.items()))


@BOTH
@pytest.mark.parametrize(
    "effects",
    [
        {"mag.scale": (0.04, -0.03, 0.02)},
        {"mag.cross_axis": (0.03, 0.01, -0.02)},
        {"mag.current": (0.003, -0.001, 0.002)},
        {"mag.misalignment": (0.05, -0.08, 0.11)},
        {
            "mag.scale": (0.04, -0.03, 0.02), "mag.cross_axis": (0.03, 0.01, -0.02),
            "mag.current": (0.003, -0.001, 0.002), "mag.misalignment": (0.05, -0.08, 0.11),
        },
    ],
    ids=lambda effects: "+".join(effects),
)  # fmt: skip
@pytest.mark.parametrize("calibrated", [True, False])
def test_a_field_without_its_effects(
    motion: Motion, autopilot: str, effects: Mapping[str, object], calibrated: bool
) -> None:
    """Through a mounting, an offset, a matrix and a compensation that the log has already; a bias is left to the
    estimator, and is constant, as the turn that no parameter takes without a turn of its own would not be.
    """
    correct, undone, before = MAGS[autopilot]
    before = before if calibrated else {name: before[name] for name in before if name.endswith(("_EXTERNAL", "_ROT"))}
    current, plain = motion.covariates["current"], field_of(motion)
    raw = undone(with_effects(plain, effects, motion), current, before)
    new = correct(raw, current, loaded(autopilot, effects, before))
    turned = "mag.misalignment" in effects or autopilot == "none"
    if turned or not calibrated or ("mag.current" in effects and len(effects) == 1):
        np.testing.assert_allclose(new, plain, atol=3.0 * SINGLE)
    else:  # two symmetric matrices make one that is turned a little; no turn is set for that
        T = np.linalg.lstsq(plain, new, rcond=None)[0].T
        np.testing.assert_allclose(new, plain @ T.T, atol=3.0 * SINGLE)
        np.testing.assert_allclose(T @ T.T, np.eye(3), atol=1e-5)
        assert np.arccos((np.trace(T) - 1.0) / 2.0) < 3e-3
    assert np.max(np.abs(correct(raw, current, before) - plain)) > 0.005


@BOTH
def test_a_compensation_that_nothing_used_is_not_added_to(motion: Motion, autopilot: str) -> None:
    """And those of other compasses do not begin to act."""
    kind, own, other = {
        "px4": ("CAL_MAG_COMP_TYP", "CAL_MAG0_XCOMP", "CAL_MAG1_XCOMP"),
        "ardupilot": ("COMPASS_MOTCT", "COMPASS_MOT_X", "COMPASS_MOT2_X"),
    }[autopilot]
    before = {**MAGS[autopilot][2], kind: 0.0, own: 9.0, other: 9.0}
    new = loaded(autopilot, {"mag.current": (0.003, -0.001, 0.002)}, before)
    raw = MAGS[autopilot][1](with_effects(field_of(motion), {"mag.current": (0.003, -0.001, 0.002)}, motion),
                             motion.covariates["current"], before)  # fmt: skip
    np.testing.assert_allclose(
        MAGS[autopilot][0](raw, motion.covariates["current"], new), field_of(motion), atol=3.0 * SINGLE
    )
    assert (new[kind], new[other]) == (2.0, 0.0)


@BOTH
def test_a_trace_of_raw_readings_replaces_what_the_log_had(motion: Motion, autopilot: str) -> None:
    """`--raw`: PX4's chip in its own axes, ArduPilot's turned into the body's; offsets stay, as a bias."""
    correct, _, before = MAGS[autopilot]
    effects = {"mag.scale": (0.04, -0.03, 0.02), "mag.current": (0.003, -0.001, 0.002)}
    current, plain = motion.covariates["current"], field_of(motion)
    read = with_effects(plain, effects, motion)
    R = euler(np.array(NUMBERED[int(before.get("COMPASS_ORIENT", before.get("CAL_MAG0_ROT", 0)))]))
    new = loaded(autopilot, effects, before, choice=Choice(raw=True))
    if autopilot == "px4":
        left = correct(read, current, new) @ R - plain
    else:
        left = correct(read @ R, current, new) - plain
    np.testing.assert_allclose(left - left[0], 0.0, atol=5.0 * SINGLE)
    assert np.max(np.abs(left[0])) < 0.2


IMUS: dict[str, tuple[Callable[..., np.ndarray], Values]] = {
    "px4": (px4_imu, {
        "SENS_BOARD_ROT": 6.0, "CAL_ACC0_ID": 1310988.0, "CAL_GYRO0_ID": 1310989.0, "CAL_ACC0_XOFF": 0.2,
        "CAL_ACC0_YOFF": -0.1, "CAL_ACC0_ZOFF": 0.3, "CAL_ACC0_XSCALE": 1.01, "CAL_ACC0_YSCALE": 0.98,
        "CAL_ACC0_ZSCALE": 1.003, "CAL_GYRO0_XOFF": 0.01, "TC_G_ENABLE": 1.0, "TC_G0_ID": 1310989.0, "TC_G0_TREF": 30.0,
        "TC_G0_TMIN": 20.0, "TC_G0_TMAX": 40.0, "TC_G0_X0_0": 1e-3, "TC_G0_X0_1": 0.0, "TC_G0_X0_2": 0.0,
        "TC_G0_X1_0": 2e-4, "TC_G0_X1_1": -1e-4, "TC_G0_X1_2": 0.0}),
    "ardupilot": (ardupilot_imu, {
        "AHRS_ORIENTATION": 6.0, "INS_ACCOFFS_X": 0.3, "INS_ACCOFFS_Y": -0.2, "INS_ACCOFFS_Z": 0.1,
        "INS_ACCSCAL_X": 1.01, "INS_ACCSCAL_Y": 0.99, "INS_ACCSCAL_Z": 1.002, "INS_GYROFFS_X": 0.02,
        "INS_ACC1_CALTEMP": 30.0, "INS_GYR1_CALTEMP": 32.0}),
}  # fmt: skip


@BOTH
@pytest.mark.parametrize(
    ("sensor", "effect", "beta"),
    [
        ("accel", "accel.scale", (0.02, -0.03, 0.01)),
        ("accel", "accel.temperature", (0.004, -0.002, 0.006)),
        ("gyro", "gyro.temperature", (4e-4, -2e-4, 6e-4)),
    ],
)
def test_an_imu_without_its_effect(
    motion: Motion, autopilot: str, sensor: str, effect: str, beta: tuple[float, ...]
) -> None:
    """What is constant is a bias, which estimators have."""
    correct, before = IMUS[autopilot]
    T = motion.covariates["temperature"]
    if autopilot == "px4":  # where the calibration of the log is clipped, its own line is another one
        before = {**before, "TC_G0_TMIN": 10.0, "TC_G0_TMAX": 60.0}
    plain = motion.f_b if sensor == "accel" else motion.w_ib_b
    zero = correct(np.zeros((len(T), 3)), T, before, sensor)
    M = np.stack([correct(np.eye(3)[[i]], T[:1], before, sensor)[0] - zero[0] for i in range(3)], axis=1)
    raw = (with_effects(plain, {effect: beta}, motion) - zero) @ np.linalg.inv(M).T
    spans = dict.fromkeys(("accel", "gyro"), (float(T.min()), float(T.max())))
    new = correct(raw, T, loaded(autopilot, {effect: beta}, before, temperatures=spans), sensor) - plain
    is_scale = effect.endswith("scale")  # the offset of the log is behind the scale factor
    left = new - np.mean(new, axis=0) if not is_scale else new - new[0]
    np.testing.assert_allclose(left, 0.0, atol=2e-5 if is_scale else 3e-6)


@BOTH
@pytest.mark.parametrize("effects", [
    {"gps.lever_arm": (0.2, -0.1, -0.3)},
    {"accel.lever_arm": (0.05, 0.02, -0.04)},
    {"gps.lever_arm": (0.2, -0.1, -0.3), "accel.lever_arm": (0.05, 0.02, -0.04)},
], ids=lambda effects: "+".join(effects))  # fmt: skip
def test_the_antenna_seen_from_the_imu(motion: Motion, autopilot: str, effects: Mapping[str, object]) -> None:
    """`Ekf::controlGpsFusion`, `NavEKF3_core::CorrectGPSForAntennaOffset`: position - R (GPS_POS - IMU_POS), velocity -
    R (w x (GPS_POS - IMU_POS)): those of the IMU.
    """
    imu, gps = {"px4": ("EKF2_IMU_POS_{}", "EKF2_GPS_POS_{}"), "ardupilot": ("INS_POS1_{}", "GPS_POS1_{}")}[autopilot]
    before = {imu.format("X"): 0.03, imu.format("Z"): -0.02, gps.format("X"): 0.5, gps.format("Y"): 0.1}
    new = loaded(autopilot, effects, before)
    C_nb = matrix_from_quaternion(motion.q_nb)
    plain = np.hstack([motion.p_n, motion.v_n])
    antenna = with_effects(plain, {n: b for n, b in effects.items() if n.startswith("gps")}, motion)
    arm = three(new, gps) - three(new, imu)
    position = antenna[:, :3] - C_nb @ arm
    velocity = antenna[:, 3:] - np.einsum("nij,nj->ni", C_nb, np.cross(motion.w_ib_b, arm))
    own = np.array(effects.get("accel.lever_arm", (0.0, 0.0, 0.0)))  # type: ignore[arg-type]
    np.testing.assert_allclose(position, motion.p_n + C_nb @ own, atol=1e-6)
    np.testing.assert_allclose(
        velocity, motion.v_n + np.einsum("nij,nj->ni", C_nb, np.cross(motion.w_ib_b, own)), atol=1e-6
    )


@pytest.mark.parametrize(
    ("autopilot", "effect", "name"),
    [
        ("px4", "gps.latency", "EKF2_GPS_DELAY"), ("px4", "mag.time_offset", "EKF2_MAG_DELAY"),
        ("px4", "baro.time_offset", "EKF2_BARO_DELAY"), ("px4", "laser.time_offset", "EKF2_RNG_DELAY"),
        ("ardupilot", "gps.latency", "GPS1_DELAY_MS"), ("ardupilot", "baro.time_offset", "EK3_HGT_DELAY"),
    ],
)  # fmt: skip
def test_a_reading_that_is_late_is_fused_at_its_own_time(autopilot: str, effect: str, name: str) -> None:
    """`time_us - DELAY * 1000`: a ramp that is read b late is where it was then, to a millisecond."""
    new = loaded(autopilot, {effect: (0.123,)}, {})
    stamp = np.arange(10.0)
    reading = 2.0 * (stamp - 0.123)
    np.testing.assert_allclose(reading, 2.0 * (stamp - 1e-3 * new[name]), atol=1e-6)


@BOTH
def test_a_delay_that_the_autopilot_does_not_take_is_said(autopilot: str) -> None:
    params = params_for(autopilot, Findings({"gps.latency": np.array([-0.05])}), None)
    assert not params.settings
    assert "and it is -50 ms" in params.without["gps.latency"]


@BOTH
def test_the_declination_is_that_of_the_place_and_what_was_found(motion: Motion, autopilot: str) -> None:
    """With it in the field's heading `atan2(-m_y, m_x) + declination` is the yaw of a level body."""
    field_n = motion.m_n[0]
    before = {"EKF2_DECL_TYPE": 7.0} if autopilot == "px4" else {"COMPASS_AUTODEC": 1.0}
    found = {"mag.declination": (0.1,)}
    new = loaded(autopilot, found, before, declination=float(np.arctan2(field_n[1], field_n[0])))
    yaw = np.linspace(-3.0, 3.0, len(motion))
    q = quaternion_from_rpy(np.stack([0.0 * yaw, 0.0 * yaw, yaw], axis=1))
    level = Motion(t=motion.t, q_nb=q, m_n=motion.m_n)
    m = with_effects(field_of(level), found, level)
    if autopilot == "px4":
        declination = np.radians(new["EKF2_MAG_DECL"])
        assert new["EKF2_DECL_TYPE"] == 6.0  # not looked up in a table
    else:
        declination = new["COMPASS_DEC"]
        assert new["COMPASS_AUTODEC"] == 0.0
    np.testing.assert_allclose(np.exp(1j * (np.arctan2(-m[:, 1], m[:, 0]) + declination)), np.exp(1j * yaw), atol=1e-6)


@BOTH
def test_the_height_without_the_pressure_of_the_air(motion: Motion, autopilot: str) -> None:
    """PX4: height + K V^2 / (2 g) in the estimator (`EKF2.cpp`, K V^2 the sum over the axes); ArduPilot: pressure -
    K rho V^2 / 2 in the driver (`AP_Baro::wind_pressure_correction`), whose logged height has it already.
    """
    speed2 = np.sum(motion.v_n**2, axis=1)
    moving = Motion(t=motion.t, p_n=motion.p_n, v_n=motion.v_n, q_nb=motion.q_nb, covariates={"airspeed": speed2**0.5})
    height = -motion.p_n[:, 2:]
    read = with_effects(height, {"baro.airspeed": (0.02,)}, moving)[:, 0]
    v_b = np.einsum("nji,nj->ni", matrix_from_quaternion(motion.q_nb), motion.v_n)
    if autopilot == "px4":
        new = loaded(autopilot, {"baro.airspeed": (0.02,)}, {})
        ahead, behind = ([[new[f"EKF2_PCOEF_{w}"] for w in ways]] for ways in (("XP", "YP", "Z"), ("XN", "YN", "Z")))
        K = np.where(v_b > 0.0, ahead, behind)
        np.testing.assert_allclose(read + np.sum(K * v_b**2, axis=1) / (2.0 * G), height[:, 0], atol=1e-5)
    else:
        before = {"BARO1_WCF_ENABLE": 1.0, "BARO1_WCF_FWD": -0.1}
        new = loaded(autopilot, {"baro.airspeed": (0.02,)}, before)
        rho = 1.2

        def error(values: Values) -> np.ndarray:
            K = np.where(v_b > 0.0, *([[values.get(f"BARO1_WCF_{w}", 0.0) for w in ways]] for ways in WAYS))
            return np.asarray(0.5 * rho * np.sum(K * v_b**2, axis=1))

        pressure = -rho * G * read + error(before)  # before the correction that the log has
        np.testing.assert_allclose(-(pressure - error(new)) / (rho * G), height[:, 0], atol=1e-5)


def test_the_range_from_the_imu(motion: Motion) -> None:
    """Both: range + (R (POS - IMU_POS))_down / R_33, for an offset along the body's down POS_Z - IMU_POS_Z; PX4's beam
    points along (sin PITCH, 0, cos PITCH) (`SensorRangeFinder::updateSensorToEarthRotation`).
    """
    found = {"laser.mount_offset": (0.07,)}
    for autopilot, name, imu in (
        ("px4", "EKF2_RNG_POS_Z", "EKF2_IMU_POS_Z"),
        ("ardupilot", "RNGFND2_POS_Z", "INS_POS1_Z"),
    ):
        new = loaded(autopilot, found, {imu: -0.02, "RNGFND1_TYPE": 2.0, "RNGFND2_TYPE": 8.0})
        np.testing.assert_allclose(5.0 + 0.07 + new[name] - new[imu], 5.0, atol=1e-6)
    new = loaded("px4", {"laser.boresight": (0.0, 0.04)}, {})
    turned = euler(np.array([0.0, np.degrees(0.04), 0.0])) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose([np.sin(new["EKF2_RNG_PITCH"]), 0.0, np.cos(new["EKF2_RNG_PITCH"])], turned, atol=1e-7)


#: `BARO1_WCF_*` of a body that moves forward, right, down; and of the opposite.
WAYS = (("FWD", "RGT", "DN"), ("BCK", "LFT", "UP"))

# --- what has no parameter, and what is doubtful -----------------------------------------------------------


@BOTH
def test_every_effect_of_the_catalogue_has_a_parameter_or_a_reason(autopilot: str) -> None:
    effects = {name: 0.1 * CATALOGUE[name].plausible for name in CATALOGUE if not CATALOGUE[name].is_local}
    spans = dict.fromkeys(("accel", "gyro"), (20.0, 40.0))
    params = params_for(autopilot, Findings(effects, declination=0.0, temperatures=spans), None)
    set_ = {effect for one in params.settings for effect in one.effects}
    assert set_ | set(params.without) == set(effects)
    assert "gyro.scale" in params.without
    assert len([one.name for one in params.settings]) == len({one.name for one in params.settings})


def test_a_compass_that_turns_with_its_board_is_not_turned_alone(motion: Motion) -> None:
    """Scale and compensation still are right, about the board's own axes."""
    before = {"CAL_MAG0_ROT": -1.0, "SENS_BOARD_ROT": 10.0, "SENS_BOARD_X_OFF": 3.0}
    effects = {"mag.scale": (0.04, -0.03, 0.02), "mag.current": (0.003, -0.001, 0.002)}
    current, plain = motion.covariates["current"], field_of(motion)
    raw = px4_mag_raw(with_effects(plain, effects, motion), current, before)
    new = px4_mag(raw, current, loaded("px4", effects, before))
    np.testing.assert_allclose(new, plain, atol=3.0 * SINGLE)
    params = params_for(
        "px4",
        Findings({"mag.misalignment": np.array([0.1, 0.0, 0.0])}),
        Facts("PX4 ULog", autopilot="PX4", parameters=before),
    )
    assert not params.settings
    assert "turns with the board" in params.without["mag.misalignment"]


def effect(name: str, **more: object) -> dict[str, object]:
    return {"name": name, "beta": [0.1] * CATALOGUE[name].size, "predicts": True, "confused_with": [],
            "interval": None, **more}  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "verdict", "unit", "why"),
    [
        (effect("mag.scale", predicts=False), "unexplained", "gauss", "does not predict"),
        (
            effect("mag.scale", confused_with=["mag.cross_axis"]),
            "ambiguous",
            "gauss",
            "cannot tell it from mag.cross_axis",
        ),
        (effect("mag.scale", predicts=None), "unexplained", "gauss", "something remains"),
        (effect("mag.step", interval=[3.0, 9.0]), "effects", "gauss", "it was temporary"),
        (effect("mag.scale", at_least=True), "effects", "gauss", "only its least size"),
        (effect("mag.current"), "effects", "", "unit of the field is not known"),
    ],
)
def test_what_is_doubtful_is_not_set(entry: dict[str, object], verdict: str, unit: str, why: str) -> None:
    recording, _ = simulate(load_scenario("hover"), np.random.default_rng(0))
    recording = recording.replace(environment=replace(recording.environment, field_unit=unit))
    found = findings_of({"verdict": verdict, "effects": [entry]}, recording, None)
    params = params_for("px4", found, None)
    assert not params.settings
    assert why in params.without[str(entry["name"])]
    assert why.split()[0] in as_file(params)


# --- from a log to the parameters to a log without the effect ----------------------------------------------

EFFECTS = {"mag.current": (0.0015, -0.0005, 0.001), "mag.cross_axis": (0.02, -0.016, 0.012)}
WRITERS: dict[str, Callable[..., Path]] = {"px4": ulog, "ardupilot": dataflash}


def flown() -> Recording:
    """Half a minute of shaking and turning that tells the two effects apart, with an IMU of 50 Hz and no barometer."""
    recording, _ = simulate(scenario_at(50.0, "aerobatics"), np.random.default_rng(4), EFFECTS)
    part = window(recording, (60.0, 90.0))
    return part.replace(streams={name: part.streams[name] for name in ("imu", "gps", "mag", "power")})


def with_field(recording: Recording, field: np.ndarray) -> Recording:
    """A field in gauss, which the writers take as parts of the field."""
    columns = dict(zip(MAG, field.T / FIELD, strict=True))
    return recording.replace(streams={**recording.streams, "mag": Stream(recording.streams["mag"].t, columns)})


@pytest.mark.parametrize("autopilot", list(WRITERS))
def test_from_a_log_to_the_parameters_that_make_the_effect_go(tmp_path: Path, autopilot: str) -> None:
    """What is left after the first file is within the first trace's own uncertainty; after a second one, combined with
    the first, neither is seen: without the effects the noise is less, and less can be seen.
    """
    correct, undone, values = MAGS[autopilot]
    recording = flown()
    mag, power = recording.streams["mag"], recording.streams["power"]
    current = np.interp(mag.t, power.t, power["current"])
    raw = undone(FIELD * mag.array(MAG), current, values)
    log = tmp_path / "log"
    first = traced(WRITERS[autopilot](log, recording, values), tmp_path, autopilot)
    sigma = {one["name"]: np.array(one["std"]) for one in first["effects"]}
    assert set(sigma) == set(EFFECTS)
    for _ in range(2):
        values = {**values, **of_file((tmp_path / "file").read_text())}
        WRITERS[autopilot](log, with_field(recording, correct(raw, current, values)), values)
        again = traced(log, tmp_path, autopilot)
        for one in again["effects"]:
            assert np.all(np.abs(one["beta"]) < 3.0 * sigma[one["name"]])
        if not again["effects"]:
            return
    raise AssertionError(again["headline"])


def traced(log: Path, folder: Path, autopilot: str) -> dict[str, Any]:
    """A report, whose parameters are on the page, in the terminal and in the file."""
    report, page = folder / "report.json", folder / "page.html"
    said = invoke("trace", str(log), "--json", str(report), "--html", str(page))
    document: dict[str, Any] = json.loads(report.read_text())
    names = [one["name"] for one in (document["autopilot"] or {"parameters": []})["parameters"]]
    assert bool(names) == bool(document["effects"])
    assert all(name in said and name in page.read_text() for name in names)
    if names:
        end = {"px4": "flight.params", "ardupilot": "flight.param"}[autopilot]
        assert document["autopilot"]["call"] == f"sinan params {log} --out {end}"
        assert document["autopilot"]["call"] in page.read_text()
    invoke("params", str(log), "--trace", str(report), "--out", str(folder / "file"))
    assert list(of_file((folder / "file").read_text())) == names
    shown = invoke("params", str(log), "--for", autopilot, "--trace", str(report))
    assert of_file(shown) == of_file((folder / "file").read_text())
    return document


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_report_of_another_log_is_refused(tmp_path: Path) -> None:
    log = ulog(tmp_path / "log")
    (tmp_path / "report.json").write_text(json.dumps({"verdict": "no_effect", "effects": [], "choice": {},
                                                      "recording": "another"}))  # fmt: skip
    result = CliRunner().invoke(app, ["params", str(log), "--trace", str(tmp_path / "report.json")])
    assert result.exit_code != 0
    assert "a report of another" in str(result.exception) + result.output


def test_of_a_log_that_is_not_there_that_is_said() -> None:
    """And not that it does not say whose it is."""
    result = CliRunner().invoke(app, ["params", "nosuch.ulg"])
    assert result.exit_code != 0
    assert "no such file" in str(result.exception) + result.output


def test_of_nothing_found_the_terminal_says_that_the_file_changes_nothing(tmp_path: Path) -> None:
    log, report = ulog(tmp_path / "log"), tmp_path / "report.json"
    report.write_text(json.dumps({"verdict": "unexplained", "effects": [], "choice": {}, "recording": "log",
                                  "called": "log", "headline": "none"}))  # fmt: skip
    said = invoke("params", str(log), "--trace", str(report), "--out", str(tmp_path / "file"))
    assert "nothing to set: the file changes no parameter" in said


@pytest.mark.measured
def test_the_log_of_a_data_set_is_asked_as_its_path_is(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    name = "px4_v6xrt_flight/corrupt_unregistered_msg_id.ulg"
    entry = {"name": "gps.latency", "beta": [0.12], "std": [0.01], "unit": "s", "predicts": True, "confused_with": []}
    document = {"verdict": "effects", "effects": [entry], "choice": {}}
    recording = resolve(name)
    by_path = in_its_terms(document, recording, [str(measured_data / name)])
    assert by_path[0] is not None
    assert in_its_terms(document, recording, [name]) == by_path
    assert autopilot_of(facts_of_log(log_of(name))) == "px4"


@pytest.mark.measured
def test_a_log_that_a_kept_map_reads_is_not_asked(measured_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a map makes of a log are not the sensors that the autopilot's parameters are about."""
    monkeypatch.setenv("SINAN_DATA", str(measured_data))
    name = "rfly_course/MagRaw.mat"
    assert log_of(name) == Path(name)
    assert log_of("nowhere/at_all.ulg") == Path("nowhere/at_all.ulg")


def test_a_choice_of_sensors_is_that_of_the_report() -> None:
    """`--mag 1` of a dataflash log is the second compass."""
    found = Findings({"mag.scale": np.array([0.1, 0.0, 0.0])}, choice=Choice(mag=1))
    params = params_for("ardupilot", found, None)
    assert params.settings[0].name == "COMPASS_DIA2_X"


# --- an autopilot's log of a board that was turned by hand -------------------------------------------------


@BOTH
def test_poses_in_an_autopilots_log_become_its_parameters(tmp_path: Path, autopilot: str) -> None:
    """Twelve rests of 2.5 s with turns between. What the log holds was corrected by parameters that it tells."""
    rng = np.random.default_rng(8)
    rests = rng.standard_normal((12, 3))
    up = np.repeat(rests / np.linalg.norm(rests, axis=1)[:, None], 250, axis=0)
    for k in range(250, len(up), 250):  # a turn from one to the next, of 0.6 s
        part = np.linspace(0.0, 1.0, 60)[:, None]
        turn = (1.0 - part) * up[k - 31] + part * up[k + 30]
        up[k - 30 : k + 30] = turn / np.linalg.norm(turn, axis=1)[:, None]
    t = 0.01 * np.arange(len(up))
    still = np.linalg.norm(np.gradient(up, axis=0), axis=1) < 1e-9
    w = rng.normal(0.0, 0.001, up.shape) + np.where(still, 0.0, 1.0)[:, None]
    before = {
        "px4": {"CAL_ACC0_XSCALE": 1.02, "CAL_ACC0_YOFF": -0.1, "CAL_ACC0_ID": 0.0, "SENS_BOARD_ROT": 0.0},
        "ardupilot": {"INS_ACCSCAL_X": 1.02, "INS_ACCSCAL_Y": 1.0, "INS_ACCSCAL_Z": 1.0, "INS_ACCOFFS_Y": -0.1},
    }[autopilot]
    off, scale = {"px4": ("CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE"), "ardupilot": ("INS_ACCOFFS_{}", "INS_ACCSCAL_{}")}[
        autopilot
    ]
    raw = G * up * [1.03, 0.98, 1.01] + [0.2, -0.3, 0.1] + rng.normal(0.0, 0.02, up.shape)
    sent = (raw - three(before, off)) * three(before, scale, 1.0)
    imu = Stream(t, dict(zip((*ACCEL, *GYRO), np.hstack([sent, w]).T, strict=True)))
    write = {"px4": ulog, "ardupilot": dataflash}[autopilot]
    others = flight().streams
    log = write(tmp_path / "log", flight().replace(streams={**others, "imu": imu}), before)
    refused = CliRunner().invoke(app, ["calibrate", "accel", str(log)])
    assert 'kind = "flight"' in str(refused.exception)
    said = invoke("calibrate", "accel", str(log), "--poses")
    lines = [line.split() for line in said.splitlines() if line.endswith("for accelerometer calibration")]
    found = {line[1]: float(line[2].rstrip(",")) for line in lines}
    new = {**before, **found}
    np.testing.assert_allclose(three(new, scale, 1.0), 1.0 / np.array([1.03, 0.98, 1.01]), atol=2e-3)
    np.testing.assert_allclose(three(new, off), [0.2, -0.3, 0.1], atol=0.02)
