"""The simulator: motion that belongs together, noise as declared, effects that only the data show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.experiments.scenarios import load_scenario, scenario_names
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, effect
from sinan.sensors.errors import InputError
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, VELOCITY, Recording, Stream
from sinan.sensors.rotation import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    rotate,
    rotate_back,
    rpy_from_quaternion,
)
from sinan.sensors.scenario import Instrument, Scenario
from sinan.sensors.simulate import Present, simulate

NANORADIAN = 1e-9  # rad
MICROMETRE = 1e-6  # m
FALSE_ALARM = 1e-3  # of each statistical test, with a fixed seed
QUATERNION = ("qw", "qx", "qy", "qz")
FLIGHTS = tuple(name for name in scenario_names() if load_scenario(name).kind == "flight")


def run(name: str, seed: int = 1, **kw: object) -> tuple[Recording, Stream]:
    return simulate(load_scenario(name), np.random.default_rng(seed), **kw)  # type: ignore[arg-type]


def quiet(scenario: Scenario) -> Scenario:
    """The scenario with instruments that err by nothing."""
    silent = {
        name: replace(entry, spec=replace(entry.spec, noise_density=None, noise_std=0.0, bias_std=0.0, bias_walk=0.0))
        for name, entry in scenario.sensors.items()
    }
    for name in ("gps", "base"):
        if name in silent:
            silent[name] = replace(silent[name], spec=replace(silent[name].spec, velocity_noise_std=0.0))
    return scenario.replace(sensors=silent, truth_rate=0.0)


def magnus(w_start: FloatArray, w_middle: FloatArray, w_end: FloatArray, h: float) -> FloatArray:
    """Rotation vector over a step, fourth-order Magnus series from Simpson's rule."""
    integral = h / 6.0 * (w_start + 4.0 * w_middle + w_end)
    return integral + h**2 / 12.0 * np.cross(w_start, w_end)


@pytest.mark.parametrize("name", FLIGHTS)
def test_integrating_the_rates_gives_the_attitude(name: str) -> None:
    path = load_scenario(name).trajectory()
    h = 2.5e-4
    t = 20.0 + h * np.arange(4001)
    motion, middle = path.motion(t), path.motion(t[:-1] + 0.5 * h)
    steps = quaternion_exp(magnus(motion.w_ib_b[:-1], middle.w_ib_b, motion.w_ib_b[1:], h))
    q = motion.q_nb[0]
    for step in steps:
        q = quaternion_multiply(q, step)
    error = quaternion_log(quaternion_multiply(quaternion_conjugate(motion.q_nb[-1]), q))
    assert np.linalg.norm(error) < NANORADIAN


@pytest.mark.parametrize("name", FLIGHTS)
def test_integrating_the_specific_force_gives_the_position(name: str) -> None:
    scenario = load_scenario(name)
    h = 1e-3
    t = h * np.arange(int(scenario.duration / h) + 1)
    motion = scenario.trajectory().motion(t)
    a_n = rotate(motion.q_nb, motion.f_b) + motion.g_n
    # trapezoid with the end correction: the error of a smooth integrand is of fourth order
    v_n = motion.v_n[0] + h * (np.cumsum(a_n, axis=0) - 0.5 * (a_n + a_n[0]))
    p_n = motion.p_n[0] + h * (np.cumsum(v_n, axis=0) - 0.5 * (v_n + v_n[0]))
    assert np.max(np.abs(p_n - motion.p_n)) < 30.0 * MICROMETRE


@pytest.mark.parametrize("name", FLIGHTS)
def test_angular_acceleration_is_the_derivative_of_the_rate(name: str) -> None:
    path = load_scenario(name).trajectory()
    t, h = np.linspace(3.0, 60.0, 200), 1e-5
    difference = (path.motion(t + h).w_ib_b - path.motion(t - h).w_ib_b) / (2.0 * h)
    np.testing.assert_allclose(path.motion(t).dw_b, difference, atol=1e-6)


def test_thrust_and_drag_leave_only_drag_in_the_plane_of_the_rotors() -> None:
    scenario = load_scenario("aerobatics")
    scenario = scenario.replace(air=replace(scenario.air, drag=0.4, wind=(3.0, -1.0)))
    motion = scenario.trajectory().motion(np.linspace(0.0, scenario.duration, 500))
    air_b = rotate_back(motion.q_nb, motion.v_n - np.array([3.0, -1.0, 0.0]))
    np.testing.assert_allclose(motion.f_b[:, :2], -0.4 * air_b[:, :2], atol=1e-10)


def test_a_horizontal_acceleration_needs_a_tilt() -> None:
    scenario = load_scenario("square")
    scenario = scenario.replace(air=replace(scenario.air, drag=0.0))
    motion = scenario.trajectory().motion(np.linspace(0.0, scenario.duration, 500))
    forward = rotate_back(motion.q_nb * 0.0 + _yaw_only(motion.q_nb), motion.a_n)[:, 0]
    pitch = rpy_from_quaternion(motion.q_nb)[:, 1]
    np.testing.assert_allclose(np.tan(pitch), -forward / (scenario.gravity - motion.a_n[:, 2]), atol=1e-9)


def _yaw_only(q: FloatArray) -> FloatArray:
    yaw = rpy_from_quaternion(q)[:, 2]
    return quaternion_exp(np.stack([0 * yaw, 0 * yaw, yaw], axis=1))


@pytest.mark.parametrize("name", FLIGHTS)
def test_no_flight_goes_below_the_ground(name: str) -> None:
    scenario = load_scenario(name)
    if scenario.turns is None:
        motion = scenario.trajectory().motion(np.linspace(0.0, scenario.duration, 3000))
        assert np.min(motion.height) > -MICROMETRE


def test_on_the_ground_it_stands_level_and_draws_the_idle_current() -> None:
    scenario = load_scenario("takeoff_landing")
    scenario = scenario.replace(air=replace(scenario.air, wind=(5.0, 0.0)))
    recording, truth = simulate(scenario, np.random.default_rng(0))
    standing = truth.t < 3.0
    np.testing.assert_allclose(truth["qw"][standing], 1.0, atol=1e-12)
    assert recording.streams["power"]["current"][0] == pytest.approx(scenario.supply.idle_current)


@pytest.mark.parametrize("name", scenario_names())
def test_perfect_instruments_read_the_truth(name: str) -> None:
    scenario = quiet(load_scenario(name))
    recording, truth = simulate(scenario, np.random.default_rng(5))
    q = truth.array(QUATERNION)
    if "imu" in recording.streams:
        motion = scenario.trajectory().motion(recording.streams["imu"].t)
        shaking = np.max(scenario.vibration.amplitude) * 4.0
        np.testing.assert_allclose(recording.streams["imu"].array(ACCEL), motion.f_b, atol=1e-12 + shaking)
        np.testing.assert_allclose(recording.streams["imu"].array(GYRO), motion.w_ib_b, atol=1e-12)
        assert np.max(np.abs(q - motion.q_nb)) < 1e-12
    if "gps" in recording.streams:
        motion = scenario.trajectory().motion(recording.streams["gps"].t)
        reading = recording.streams["gps"].array((*POSITION, *VELOCITY))
        np.testing.assert_allclose(reading, np.hstack([motion.p_n, motion.v_n]), atol=1e-12)


def still(noise_density: float, walk: float = 0.0, std: float = 0.0) -> Scenario:
    """Two minutes on a table at 200 Hz."""
    base = load_scenario("no_aiding")
    assert base.turns is not None
    spec = replace(base.sensors["accel"].spec, noise_density=noise_density, bias_walk=walk, bias_std=std)
    sensors = {"accel": Instrument(spec, 200.0), "gyro": Instrument(spec, 200.0)}
    turns = replace(base.turns, kind="poses", poses=2, hold=60.0, turn=0.01)
    return base.replace(sensors=sensors, turns=replace(turns, poses=2), truth_rate=0.0)


def test_white_noise_has_the_declared_density_by_allan_deviation() -> None:
    import allantools

    density = 2e-3
    recording, _ = simulate(still(density), np.random.default_rng(11))
    resting = recording.streams["imu"].rows(recording.streams["imu"].t < 59.0)
    found = [
        allantools.oadev(resting[axis] - np.mean(resting[axis]), rate=200.0, data_type="freq", taus=[1.0 / 200.0])[1][0]
        for axis in (*ACCEL, *GYRO)
    ]
    assert np.sqrt(np.mean(np.square(found))) / np.sqrt(200.0) == pytest.approx(density, rel=0.01)


def test_the_increments_of_a_bias_have_the_variance_of_its_walk() -> None:
    walk = 3e-4
    _, truth = simulate(still(1e-3, walk, 0.1), np.random.default_rng(12))
    bias = truth.array(("bias_accel_x", "bias_accel_y", "bias_accel_z"))
    increments = np.diff(bias, axis=0) / (walk * np.sqrt(np.diff(truth.t)))[:, None]
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], increments.size)
    assert low < np.sum(increments**2) < high


def test_a_bias_between_its_samples_is_tied_to_them() -> None:
    scenario = load_scenario("base_receiver")
    spec = replace(scenario.sensors["gps"].spec, bias_walk=1.0)
    base = replace(scenario.sensors["base"], spec=replace(scenario.sensors["base"].spec, noise_std=1e-9))
    scenario = scenario.replace(
        sensors={**scenario.sensors, "gps": replace(scenario.sensors["gps"], spec=spec), "base": base}
    )
    recording, truth = simulate(scenario.replace(truth_rate=0.0), np.random.default_rng(3))
    seen = recording.streams["base"].array(POSITION) - np.array(base.place)
    near = np.stack(
        [np.interp(recording.streams["base"].t, truth.t, truth[f"bias_gps_{axis}"]) for axis in POSITION], axis=1
    )
    assert np.std(seen - near) < 1.0 * np.sqrt(0.005)  # the walk over one IMU interval


def test_the_same_seed_gives_the_same_recording() -> None:
    first, second = run("square", 4)[0], run("square", 4)[0]
    for name, stream in first.streams.items():
        for column in stream.columns:
            assert np.array_equal(stream[column], second.streams[name][column])


def test_another_seed_gives_another_recording() -> None:
    assert not np.array_equal(
        run("hover", 1)[0].streams["imu"]["accel_x"], run("hover", 2)[0].streams["imu"]["accel_x"]
    )


def test_adding_a_sensor_changes_no_other() -> None:
    full = load_scenario("base_receiver")
    few = full.replace(sensors={name: full.sensors[name] for name in ("accel", "gyro", "mag", "gps")})
    rich, truth = simulate(full, np.random.default_rng(8))
    poor, truth_poor = simulate(few, np.random.default_rng(8))
    for name in ("imu", "mag", "gps"):
        for column in poor.streams[name].columns:
            assert np.array_equal(poor.streams[name][column], rich.streams[name][column])
    assert all(np.array_equal(truth[column], truth_poor[column]) for column in truth_poor.columns)


def test_an_effect_changes_its_own_stream_alone() -> None:
    plain, current = run("figure_eight")[0], run("figure_eight", effects={"mag.current": [0.01, 0.0, 0.0]})[0]
    changed = [n for n in plain.streams if any(not np.array_equal(plain.streams[n][c], current.streams[n][c])
                                               for c in plain.streams[n].columns)]  # fmt: skip
    assert changed == ["mag"]


def test_an_undeclared_effect_is_nowhere_in_what_the_recording_says() -> None:
    plain, current = run("figure_eight")[0], run("figure_eight", effects={"mag.current": [0.01, 0.0, 0.0]})[0]
    for attribute in ("name", "kind", "sensors", "origin", "effects", "source"):
        assert repr(getattr(plain, attribute)) == repr(getattr(current, attribute))
    assert repr(plain.environment) == repr(current.environment)
    assert repr(plain.initial) == repr(current.initial)


def test_a_declared_effect_is_in_the_recording() -> None:
    recording, _ = run("figure_eight", effects={"mag.current": [0.01, 0.0, 0.0]}, declare=True)
    assert recording.effects == {"mag.current": (0.01, 0.0, 0.0)}


def test_a_step_cannot_be_declared() -> None:
    step = Present(effect("mag.step"), np.array([0.1, 0.0, 0.0]), 20.0)
    with pytest.raises(InputError, match=r"mag\.step"):
        run("hover", effects=[step], declare=True)


def test_the_effect_is_the_regressor_times_beta() -> None:
    beta = np.array([0.01, -0.02, 0.005])
    plain, current = run("climb_descent")[0], run("climb_descent", effects={"mag.current": beta})[0]
    t = plain.streams["mag"].t
    amperes = np.interp(t, plain.streams["power"].t, plain.streams["power"]["current"])
    difference = current.streams["mag"].array(MAG) - plain.streams["mag"].array(MAG)
    np.testing.assert_allclose(difference, amperes[:, None] * beta, atol=1e-3)


def test_a_late_gps_reads_where_it_was() -> None:
    late = 0.25
    plain, delayed = run("square")[0], run("square", effects={"gps.latency": [late]})[0]
    path = load_scenario("square").trajectory()
    t = plain.streams["gps"].t
    expected = path.motion(t - late).p_n - path.motion(t).p_n
    difference = delayed.streams["gps"].array(POSITION) - plain.streams["gps"].array(POSITION)
    np.testing.assert_allclose(difference, expected, atol=MICROMETRE)


def test_a_late_gps_with_a_lever_arm_is_the_antenna_of_then() -> None:
    late, arm = 0.25, np.array([0.3, -0.2, 0.5])
    both = run("yaw_turns", effects={"gps.latency": [late], "gps.lever_arm": arm})[0].streams["gps"]
    plain = run("yaw_turns")[0].streams["gps"]
    path = load_scenario("yaw_turns").trajectory()
    then, now = path.motion(both.t - late), path.motion(both.t)
    expected = then.p_n + rotate(then.q_nb, np.broadcast_to(arm, (len(both), 3))) - now.p_n
    np.testing.assert_allclose(both.array(POSITION) - plain.array(POSITION), expected, atol=10 * MICROMETRE)


def test_a_lagging_barometer_obeys_its_equation() -> None:
    lag = 0.6
    scenario = quiet(load_scenario("climb_descent"))
    scenario = scenario.replace(sensors={**scenario.sensors, "baro": replace(scenario.sensors["baro"], rate=500.0)})
    z = simulate(scenario, np.random.default_rng(0), {"baro.lag": [lag]})[0].streams["baro"]
    height = simulate(scenario, np.random.default_rng(0))[0].streams["baro"]["height"]
    rate = np.gradient(z["height"], z.t)
    np.testing.assert_allclose(lag * rate[2:-2], (height - z["height"])[2:-2], atol=1e-3)


def test_a_transient_comes_and_goes() -> None:
    hit = Present(effect("baro.transient"), np.array([3.0]), 20.0, 30.0)
    plain, hit_recording = run("hover")[0].streams["baro"], run("hover", effects=[hit])[0].streams["baro"]
    difference = hit_recording["height"] - plain["height"]
    expected = 3.0 * ((plain.t >= 20.0) & (plain.t < 30.0))
    np.testing.assert_allclose(difference, expected, atol=1e-12)


def test_outliers_hit_the_stated_share_of_readings() -> None:
    plain = run("hover")[0].streams["mag"]
    wrong = run("hover", effects={"mag.outliers": [0.1]})[0].streams["mag"]
    hit = np.sum(wrong["mag_x"] != plain["mag_x"])
    assert abs(hit - 0.1 * len(plain)) < 3.3 * np.sqrt(0.09 * len(plain))  # false alarm 1e-3


def test_a_sonar_out_of_range_gives_no_row_and_the_noise_is_not_cut() -> None:
    scenario = load_scenario("hover").replace(start=(0.0, 0.0, -7.995, 0.0, 1.0))
    recording, _ = simulate(scenario, np.random.default_rng(2))
    assert len(recording.streams["sonar"]) == 1200
    assert np.max(recording.streams["sonar"]["range"]) > scenario.sensors["sonar"].maximum
    above = scenario.replace(start=(0.0, 0.0, -8.005, 0.0, 1.0))
    assert "sonar" not in simulate(above, np.random.default_rng(2))[0].streams


def test_drop_outs_leave_the_other_rows_as_they_were() -> None:
    scenario = load_scenario("hover")
    gap = replace(scenario.sensors["gps"], dropouts=((20.0, 30.0),), loss=0.1)
    whole = simulate(scenario, np.random.default_rng(6))[0].streams["gps"]
    torn = simulate(scenario.replace(sensors={**scenario.sensors, "gps": gap}), np.random.default_rng(6))[0].streams[
        "gps"
    ]
    assert not np.any((torn.t >= 20.0) & (torn.t < 30.0))
    assert np.array_equal(torn["north"], whole["north"][np.isin(whole.t, torn.t)])


def test_rotor_drag_is_felt_by_the_accelerometer() -> None:
    dragged = load_scenario("square")
    dragged = quiet(dragged.replace(air=replace(dragged.air, drag=0.0)))
    recording, truth = simulate(dragged, np.random.default_rng(1), {"motion.rotor_drag": [0.3]})
    v_b = rotate_back(truth.array(QUATERNION), truth.array(VELOCITY))
    np.testing.assert_allclose(recording.streams["imu"].array(ACCEL)[:, :2], -0.3 * v_b[:, :2], atol=1e-9)


@pytest.mark.parametrize("name", [n for n in CATALOGUE if not n.startswith(("pseudorange.", "camera."))])
def test_every_effect_names_a_scenario_that_can_show_it(name: str) -> None:
    declaration = CATALOGUE[name]
    scenario = load_scenario("base_receiver" if declaration.stream == "base" else declaration.scenario)
    assert scenario.kind in declaration.kinds
    if declaration.stream == "level":
        assert "gps" not in scenario.sensors
    else:
        assert declaration.stream in scenario.sensors


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ({"mag.current": [1.0]}, "3"),
        ({"base.step": [1.0, 0.0, 0.0]}, "no sensor"),
        ({"mag.current": [np.nan, 0.0, 0.0]}, "finite"),
        ({"baro.lag": [-0.1]}, "effect baro.lag: -0.1; expected b of at least 0 s"),
    ],
)
def test_an_effect_that_does_not_fit_is_named(effects: dict[str, list[float]], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run("hover", effects=effects)


@pytest.mark.parametrize("name", [n for n in CATALOGUE if n.startswith("laser.")])
def test_a_scan_that_looks_above_the_horizon_loses_rows_in_silence(name: str) -> None:
    """Banked, the outer beam of a wide scan sees no ground: no reading, no warning, and the other rows as they are."""
    scenario = load_scenario("aerobatics")
    wide = replace(scenario.sensors["laser"].spec, angles=np.deg2rad([-60.0, 0.0, 50.0]))
    sensors = {**scenario.sensors, "laser": replace(scenario.sensors["laser"], spec=wide)}
    size = effect(name).size
    there = Present(effect(name), np.full(size, 0.02), 10.0, 30.0)
    scan = simulate(scenario.replace(sensors=sensors), np.random.default_rng(1), [there])[0].streams["laser"]
    assert 0 < len(scan) < scenario.duration * scenario.sensors["laser"].rate
    assert np.all(np.isfinite(scan.array(["range_0", "range_1", "range_2"])))
