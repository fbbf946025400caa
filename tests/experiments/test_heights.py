"""Heights against each other: no difference where there is none, and every failure of the sonar by its cause."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sinan.experiments.commands.heights import as_json
from sinan.experiments.heights import heights_of
from sinan.experiments.report.heights_words import causes, summary
from sinan.experiments.scenarios import load_scenario
from sinan.sensors.errors import InputError
from sinan.sensors.recording import NO_HEIGHT, Recording, Stream
from sinan.sensors.rotation import cos_tilt
from sinan.sensors.simulate import simulate

SOFT = (24.0, 26.0)  # s of the flight that go over grass
WRONG = (2.0, 2.3)  # s in which something hangs in the beam


@cache
def recording() -> Recording:
    """Low passes: large tilts, a soft stretch, and a rope in the beam."""
    scenario = load_scenario("low_pass")
    made, _ = simulate(scenario, np.random.default_rng(4))
    sonar = made.streams["sonar"]
    t = sonar.t - made.streams["imu"].t[0]
    hung = np.where((t > WRONG[0]) & (t < WRONG[1]), 1.0, sonar["range"])
    kept = ~((t > SOFT[0]) & (t < SOFT[1]))
    streams = {**made.streams, "sonar": Stream(sonar.t, {"range": hung}).rows(kept)}
    return made.replace(streams=streams)


def test_heights_agree_and_failures_have_their_causes() -> None:
    found = heights_of(recording())
    told = as_json(found, float(recording().streams["imu"].t[0])) | {"called": "low"}
    for sensor in ("sonar", "laser"):
        offset, scatter, slope = found.courses[sensor].against_filter or (1.0, 1.0, 0.0)
        assert abs(offset) < 0.01
        assert scatter == pytest.approx(0.03, abs=0.006)  # the noise of one reading
        assert slope == pytest.approx(1.0, abs=0.003)
    failures = told["sonar"]["failures"]
    counted = causes(failures)
    soft = [one for one in failures if one["cause"] == "soft target" and one["readings"] > 5]
    assert [(one["from"], one["to"]) for one in soft] == [pytest.approx(SOFT, abs=0.1)]
    near = [one for one in failures if one["cause"] == "something nearer"]
    assert [(one["from"], one["to"]) for one in near] == [pytest.approx(WRONG, abs=0.06)]
    # echoes that the simulated sonar lost by its beam angle, 35 deg, counted on the true motion
    scenario = load_scenario("low_pass")
    instants = np.arange(0.021, scenario.trajectory().motion(np.zeros(1)).t[0] + 80.0, 0.05)
    motion = scenario.trajectory().motion(instants[instants < found.motion.t[-1]])  # type: ignore[union-attr]
    tilted = int(np.count_nonzero(cos_tilt(motion.q_nb) < np.cos(np.deg2rad(35.0))))
    assert counted["no echo, beyond its beam angle"] == pytest.approx(tilted, abs=15)
    assert "something nearer" in summary(told)


def test_a_fix_without_a_height_takes_none_from_the_others() -> None:
    """Whatever stands in its place; it told nothing of the GPS, of all its fixes. Of a log without another none has."""
    gps = recording().streams["gps"]
    flat = np.arange(len(gps)) % 3 == 0
    down, epv = np.where(flat, 500.0, gps["down"]), np.where(flat, NO_HEIGHT, 0.5)
    fixes = Stream(gps.t, {**gps.columns, "down": down, "epv": epv})
    found = heights_of(recording().replace(streams={**recording().streams, "gps": fixes}))
    assert np.array_equal(found.courses["gps"].t, gps.t[~flat & (gps.t <= found.courses["gps"].t[-1])])
    offset, scatter, _ = found.courses["gps"].against_filter or (9.0, 9.0, 0.0)
    assert (abs(offset) < 2.0, scatter < 1.5) == (True, True)
    with pytest.raises(InputError, match="one of sonar, laser, baro, gps"):
        heights_of(recording().replace(streams={"gps": fixes.rows(flat)}))


def test_a_log_without_heights_is_named() -> None:
    streams = {"imu": recording().streams["imu"]}
    with pytest.raises(InputError, match="one of sonar, laser, baro, gps"):
        heights_of(recording().replace(streams=streams))
