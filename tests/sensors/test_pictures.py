"""A simulated camera: its pixels are those of the marks, its effects are those of the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sinan.experiments.commands.info import _stream
from sinan.experiments.review.events import gap_events
from sinan.experiments.scenarios import load_scenario, simulated, with_sensors
from sinan.sensors.covariates import camera_of, covariates_for
from sinan.sensors.effects import effect
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.scenario import Scenario

SIZES = {"camera.misalignment": (0.03, -0.02, 0.04), "camera.focal": (0.02, -0.015), "camera.time_offset": (0.04,)}
SQUARE = with_sensors(load_scenario("_camera"), ["accel", "gyro", "camera"])


def quiet(**changes: object) -> Scenario:
    """The square with a camera that has next to no noise."""
    camera = SQUARE.sensors["camera"]
    spec = replace(camera.spec, noise_std=1e-6)
    return SQUARE.replace(sensors={**SQUARE.sensors, "camera": replace(camera, spec=spec, **changes)})  # type: ignore[arg-type]


def there(scenario: Scenario, recording: Recording, late: float = 0.0) -> Motion:
    """The true motion at the camera's readings, with what each is of."""
    t = recording.streams["camera"].t
    return scenario.trajectory().motion(t - late).with_covariates(**covariates_for(recording, "camera", t))


def pixels(recording: Recording) -> np.ndarray:
    return recording.streams["camera"].array(("u", "v"))


def test_pixels_are_those_of_the_marks_and_in_the_picture() -> None:
    scenario = quiet()
    recording, _ = simulated(scenario)
    uv = pixels(recording)
    np.testing.assert_allclose(uv, camera_of(recording).predict(there(scenario, recording)), atol=1e-5)
    assert np.all((uv >= -0.5) & (uv <= np.array(scenario.sensors["camera"].marks.size) - 0.5))
    _, count = np.unique(recording.streams["camera"].t, return_counts=True)
    assert np.max(count) == scenario.sensors["camera"].marks.most


@pytest.mark.parametrize("name", SIZES)
def test_an_effect_acts_as_the_catalogue_says_and_only_while_it_does(name: str) -> None:
    scenario, beta = quiet(), np.array(SIZES[name])
    recording, _ = simulated(scenario, [f"{name}={','.join(map(str, beta))}@20:30"])
    motion, camera = there(scenario, recording), camera_of(recording)
    plain = camera.predict(motion)
    if name == "camera.time_offset":
        changed = camera.predict(there(scenario, recording, beta[0]))
    else:
        changed = plain + effect(name).change(plain, beta, motion, camera)
    acting = (motion.t >= 20.0) & (motion.t < 30.0)
    assert 0 < np.sum(acting) < len(acting)
    np.testing.assert_allclose(pixels(recording), np.where(acting[:, None], changed, plain), atol=1e-5)
    assert np.sqrt(np.mean((changed - plain)[acting] ** 2)) > 1.0


def test_noise_is_as_declared_and_pictures_are_lost_whole() -> None:
    camera = replace(SQUARE.sensors["camera"], loss=0.5, dropouts=((10.0, 20.0),))
    scenario = SQUARE.replace(sensors={**SQUARE.sensors, "camera": camera})
    recording, _ = simulated(scenario)
    off = pixels(recording) - camera_of(recording).predict(there(scenario, recording))
    assert np.std(off) == pytest.approx(0.7, rel=0.1)  # 6 sigma of the standard deviation of 2000 numbers
    t = np.unique(recording.streams["camera"].t)
    assert not np.any((t >= 10.0) & (t < 20.0))
    assert 0.35 < len(t) / ((scenario.duration - 10.0) * camera.rate) < 0.65


def test_other_sensors_read_the_same_with_a_camera_aboard() -> None:
    both, alone = simulated(SQUARE)[0], simulated(with_sensors(SQUARE, ["accel", "gyro"]))[0]
    np.testing.assert_array_equal(both.streams["imu"].array(("accel_x",)), alone.streams["imu"].array(("accel_x",)))
    assert "camera" not in alone.streams
    assert alone.points is None


def test_sensors_that_cannot_be_are_said() -> None:
    with pytest.raises(InputError, match="no sensor `lidar`"):
        with_sensors(SQUARE, ["lidar"])
    with pytest.raises(InputError, match="gyro without accel"):
        with_sensors(SQUARE, ["gyro", "camera"])
    with pytest.raises(InputError, match="`camera` in poses"):
        with_sensors(load_scenario("mag_poses"), ["mag", "camera"])
    camera = SQUARE.sensors["camera"]
    blind = replace(camera, spec=replace(camera.spec, focal=None))
    with pytest.raises(InputError, match="focal in pixels"):
        simulated(SQUARE.replace(sensors={**SQUARE.sensors, "camera": blind}))


def test_the_points_of_one_picture_are_no_gaps() -> None:
    camera = replace(SQUARE.sensors["camera"], dropouts=((10.0, 20.0),))
    recording, _ = simulated(SQUARE.replace(sensors={**SQUARE.sensors, "camera": camera}))
    (gap,) = gap_events(recording)
    assert gap.start < 10.0 < 20.0 <= gap.stop
    told = _stream(recording, "camera", recording.streams["camera"], 0.0)
    assert told["rate_hz"] == pytest.approx(camera.rate)
    assert told["gaps"]["count"] == 1
