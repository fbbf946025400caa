"""Normal gravity against the published values of the WGS-84 ellipsoid."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.earth import normal_gravity

MICROGAL = 1e-8  # m/s^2


@pytest.mark.parametrize(("latitude_deg", "gravity"), [(0.0, 9.7803253359), (90.0, 9.8321849378)])
def test_gravity_at_equator_and_pole(latitude_deg: float, gravity: float) -> None:
    """NIMA TR8350.2, table 3.4."""
    assert normal_gravity(np.deg2rad(latitude_deg), 0.0) == pytest.approx(gravity, abs=MICROGAL)


def test_gravity_falls_as_the_free_air_gradient() -> None:
    """0.3086 mGal/m at 45 deg (H. Moritz, Geodetic Reference System 1980)."""
    fall = (normal_gravity(np.pi / 4, 0.0) - normal_gravity(np.pi / 4, 100.0)) / 100.0
    assert fall == pytest.approx(3.086e-6, abs=2e-9)
