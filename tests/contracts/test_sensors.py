"""One contract for every sensor model: Jacobian on the manifold, noise as declared, wrong shapes refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from sinan.estimator.filter.flight_model import LEVEL_WINDOW
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.accelerometer import Accelerometer
from sinan.sensors.arrays import FloatArray
from sinan.sensors.barometer import Barometer
from sinan.sensors.camera import Camera, Intrinsics
from sinan.sensors.gps import BaseReceiver, Gps
from sinan.sensors.gyroscope import Gyroscope
from sinan.sensors.laser import Laser
from sinan.sensors.level import Level
from sinan.sensors.magnetometer import Magnetometer
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.noise import random_walk
from sinan.sensors.readings import model_of
from sinan.sensors.rotation import quaternion_from_rpy
from sinan.sensors.scenario import Scenario
from sinan.sensors.simulate import simulate
from sinan.sensors.sonar import Sonar
from sinan.testing import assert_jacobian, some_motion

FALSE_ALARM = 1e-3  # of each statistical test, with a fixed seed

MODELS: dict[str, SensorModel] = {
    "accel": Accelerometer(0.03, 0.1, 3e-4),
    "gyro": Gyroscope(0.003, 0.01, 2e-5),
    "mag": Magnetometer(0.005, 0.05, 1e-4),
    "mag without bias": Magnetometer(0.005),
    "baro": Barometer(0.3, 2.0, 0.02),
    "baro without bias": Barometer(0.3),
    "sonar": Sonar(0.03, 0.1, 0.01),
    "sonar without bias": Sonar(0.03),
    "laser": Laser(0.03),
    "laser with bias": Laser(0.03, 0.1, 0.01),
    "laser scan": Laser(0.03, 0.1, 0.0, np.deg2rad([-20.0, 0.0, 35.0])),
    "gps": Gps(0.5, 0.1, 1.0, 0.05),
    "gps position": Gps(0.5, None, 1.0, 0.05),
    "gps without bias": Gps(0.5, 0.1),
    "base": BaseReceiver(0.3),
    "level": Level(0.7),
    "camera": Camera(0.4, Intrinsics(np.array([1.1, 0.9]), np.zeros(2), "brown", np.array([-0.2, 0.05, 1e-3, 2e-3]))),
}
#: block, components, 1-sigma at the start, walk
BIASES = {
    "accel": ("b_accel", 3, 0.1, 3e-4),
    "gyro": ("b_gyro", 3, 0.01, 2e-5),
    "mag": ("b_mag", 3, 0.05, 1e-4),
    "baro": ("b_baro", 1, 2.0, 0.02),
    "sonar": ("b_sonar", 1, 0.1, 0.01),
    "laser with bias": ("b_laser", 1, 0.1, 0.01),
    "laser scan": ("b_laser", 1, 0.1, 0.0),
    "gps": ("b_gps", 3, 1.0, 0.05),
    "gps position": ("b_gps", 3, 1.0, 0.05),
}
WALKING = [name for name, (_, _, _, walk) in BIASES.items() if walk > 0.0]
STAYING = [name for name in BIASES if name not in WALKING]
#: Sensors without a bias of their own that read another one's
SHARED = {"level": "b_accel", "base": "b_gps"}


def motion() -> Motion:
    """Five poses of a tilted body above the ground."""
    return some_motion()


@pytest.fixture(params=MODELS, ids=lambda name: name.replace(" ", "_"))
def model(request: pytest.FixtureRequest) -> SensorModel:
    return MODELS[str(request.param)]


@pytest.fixture
def name(model: SensorModel) -> str:
    """Of the model in the list above."""
    return next(name for name, entry in MODELS.items() if entry is model)


def test_the_jacobian_is_that_of_central_differences(model: SensorModel) -> None:
    if model.name in ("accel", "gyro"):  # drivers of the process: the motion's own f_b and w_ib_b
        assert not {"position", "velocity", "attitude"} & set(model.jacobian(motion()))
        return
    assert_jacobian(model)


def test_the_bias_adds_to_the_reading(model: SensorModel) -> None:
    """Reading = truth + bias: one bias for all beams of a scan, that of a GPS in its position alone."""
    blocks = {name: H for name, H in model.jacobian(motion()).items() if name.startswith("b_")}
    block = SHARED.get(model.name) if model.bias is None else model.bias.block
    assert list(blocks) == ([block] if block else [])
    for H in blocks.values():
        expected = np.ones((model.size, 1)) if H.shape[2] == 1 else np.eye(model.size, 3)
        np.testing.assert_array_equal(H, np.broadcast_to(expected, (5, *expected.shape)))


def test_shapes(model: SensorModel) -> None:
    at = motion()
    assert model.predict(at).shape == (len(at), model.size)
    assert all(H.shape[:2] == (len(at), model.size) for H in model.jacobian(at).values())
    assert model.R.shape == (model.size, model.size)


#: Standard deviations that the models above were made with: of each component, or of all
SIGMAS = {
    "accel": 0.03, "gyro": 0.003, "mag": 0.005, "baro": 0.3, "sonar": 0.03, "laser": 0.03, "base": 0.3, "level": 0.7,
    "camera": 0.4,
    "gps": [0.5, 0.5, 0.5, 0.1, 0.1, 0.1], "gps position": 0.5,
}  # fmt: skip


def test_the_noise_is_that_of_the_data_sheet_and_independent(name: str, model: SensorModel) -> None:
    sigma = np.broadcast_to(SIGMAS.get(name, SIGMAS[name.split()[0]]), model.size)
    np.testing.assert_allclose(model.R, np.diag(sigma**2), rtol=1e-15)


@pytest.mark.parametrize("model", WALKING, indirect=True)
def test_a_bias_grows_as_its_walk(model: SensorModel) -> None:
    assert model.bias is not None
    rng, walks = np.random.default_rng(9), 400
    t = np.array([0.0, 0.3, 2.0])
    drawn = np.concatenate([random_walk(t, model.bias, rng) for _ in range(walks)], axis=1)
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], drawn.shape[1])
    grown = np.sum((drawn[2] - drawn[0]) ** 2) / (model.bias.walk**2 * 2.0)
    start = np.sum(drawn[0] ** 2) / model.bias.std**2
    assert low < grown < high
    assert low < start < high


@pytest.mark.parametrize("model", STAYING, indirect=True)
def test_a_bias_without_a_walk_stays_where_it_begins(model: SensorModel) -> None:
    assert model.bias is not None
    drawn = random_walk(np.array([0.0, 0.3, 2.0]), model.bias, np.random.default_rng(9))
    assert np.all(drawn[0] != 0.0)
    np.testing.assert_array_equal(drawn, np.broadcast_to(drawn[0], drawn.shape))


def test_a_model_has_a_bias_where_its_sizes_say_so(name: str, model: SensorModel) -> None:
    """The sizes that the models above were made with."""
    found = model.bias and (model.bias.block, model.bias.size, model.bias.std, model.bias.walk)
    assert found == BIASES.get(name)


@pytest.mark.parametrize("kind", [Magnetometer, Barometer, Sonar, Laser, Gps])
@pytest.mark.parametrize(("std", "walk"), [(0.2, 0.0), (0.0, 0.3)])
def test_one_size_is_enough_for_a_bias(kind: type, std: float, walk: float) -> None:
    bias = kind(1.0, bias_std=std, bias_walk=walk).bias
    assert (bias.std, bias.walk) == (std, walk)


@pytest.mark.parametrize(
    ("rpy_deg", "reads"),
    [((0.0, 0.0, 40.0), (0.0, 0.0, -9.8)), ((90.0, 0.0, 0.0), (0.0, -9.8, 0.0)), ((0.0, 90.0, 0.0), (9.8, 0.0, 0.0))],
    ids=["level", "right side down", "nose up"],
)
def test_level_reads_what_an_accelerometer_at_rest_reads(
    rpy_deg: tuple[float, float, float], reads: tuple[float, float, float]
) -> None:
    """It feels the table that holds it up: minus gravity, in the axis that points down."""
    q_nb = quaternion_from_rpy(np.deg2rad([rpy_deg]))
    at = Motion(np.zeros(1), q_nb=q_nb, g_n=np.array([0.0, 0.0, 9.8]))
    np.testing.assert_allclose(Level(0.7).predict(at)[0], reads, atol=1e-12)


def test_without_a_word_level_has_the_window_of_the_filter() -> None:
    assert Level(0.7).window == LEVEL_WINDOW


@pytest.mark.parametrize("kind", [Magnetometer, Barometer, Sonar, Laser, Gps])
def test_without_a_word_there_is_no_bias(kind: type) -> None:
    assert kind(1.0).bias is None


@pytest.mark.parametrize("kind", [Accelerometer, Gyroscope])
def test_without_a_word_the_bias_of_a_driver_is_zero(kind: type) -> None:
    assert (kind(1.0).bias.std, kind(1.0).bias.walk) == (0.0, 0.0)


def test_without_a_word_a_laser_has_one_beam_along_body_down() -> None:
    np.testing.assert_array_equal(Laser(1.0).beams_b, [[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("field", ["p_n", "v_n", "q_nb", "f_b", "w_ib_b"])
def test_a_wrong_shape_raises(field: str) -> None:
    """No model sees a motion of the wrong shape: the motion itself refuses it, and names what is wrong."""
    at = motion()
    with pytest.raises(ValueError, match=f"`{field}` has shape"):
        replace(at, **{field: getattr(at, field)[:, :2]})


def test_a_motion_of_another_length_raises() -> None:
    at = motion()
    with pytest.raises(ValueError, match="one row for each of `t`"):
        replace(at, p_n=at.p_n[:3])


def declared(scale: float) -> Scenario:
    """A square with a base receiver, with no bias anywhere and the noise times `scale`."""
    scenario = load_scenario("square")
    base = load_scenario("base_receiver").sensors["base"]
    sensors = {}
    for name, entry in {**scenario.sensors, "base": base}.items():
        values = {key: getattr(entry.spec, key) for key in ("noise_density", "noise_std", "velocity_noise_std")}
        noise = {key: value * scale for key, value in values.items() if value is not None}
        sensors[name] = replace(entry, spec=replace(entry.spec, bias_std=0.0, bias_walk=0.0, **noise))
    return scenario.replace(sensors=sensors)


STREAM_OF = {"accel": "imu", "gyro": "imu"}
SIMULATED = ("accel", "gyro", "mag", "baro", "sonar", "laser", "gps", "base")


def innovations(scale: float, name: str) -> tuple[FloatArray, SensorModel]:
    """reading - predict(true motion), and the model."""
    from sinan.sensors.readings import columns_of

    scenario = declared(scale)
    recording, _ = simulate(scenario, np.random.default_rng(21))
    entry = scenario.sensors[name]
    model = model_of(name, entry)
    stream = recording.streams[STREAM_OF.get(name, name)]
    at = scenario.trajectory().motion(stream.t)
    place = np.array(entry.place) if name == "base" else 0.0
    return stream.array(columns_of(name, model.size)) - place - model.predict(at), model


@pytest.mark.parametrize("name", SIMULATED)
def test_zero_noise_gives_zero_innovation(name: str) -> None:
    nu, _ = innovations(0.0, name)
    np.testing.assert_allclose(nu, 0.0, atol=1e-11)


@pytest.mark.parametrize("name", SIMULATED)
def test_the_simulated_variance_is_the_declared_one(name: str) -> None:
    nu, model = innovations(1.0, name)
    low, high = chi2.ppf([FALSE_ALARM / 2, 1.0 - FALSE_ALARM / 2], nu.size)
    assert low < np.sum(nu**2 / np.diag(model.R)) < high
