"""Effects of a pseudorange against RTKLIB's own functions, and against numbers worked out by hand.

The tables are what `tropmodel` and `ionmodel` of RTKLIB 2.4.3 return, called through pyrtklib 0.2.7.
"""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.effects import effect
from sinan.sensors.effects.pseudorange_ionosphere import klobuchar
from sinan.sensors.effects.pseudorange_troposphere import zenith_delay
from sinan.sensors.motion import Motion

MILLIMETRE = 1e-3

#: latitude [deg], height [m], zenith delay [m] by tropmodel at 70 % humidity
TROPMODEL = np.array(
    [
        (0.0, 0.0, 2.43361),
        (0.0, 3000.0, 1.63472),
        (30.0, 1000.0, 2.12964),
        (45.0, 0.0, 2.42746),
        (60.0, 500.0, 2.26937),
        (60.0, 8000.0, 0.81327),
        (90.0, 0.0, 2.42134),
        (90.0, 5000.0, 1.24043),
        (-40.0, 10000.0, 0.60429),
    ]
)
DAY = (1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -2.6e5)
NEGATIVE = (-2e-8, 1e-8, 0.0, 0.0, 5e4, 0.0, 0.0, 0.0)  # an amplitude below zero
SHORT = (2e-8, 0.0, 0.0, 0.0, 5e4, 0.0, 0.0, 0.0)  # a period below 20 h
#: coefficients; latitude, longitude, elevation, azimuth [deg]; time of week [s]; slant delay [m] by ionmodel
IONMODEL = [
    (DAY, 45, 0, 90, 0, 50400, 3.9474),
    (DAY, 45, 0, 90, 0, 36000, 3.2332),
    (DAY, 45, 10, 30, 90, 405600, 6.1206),
    (DAY, -20, 150, 15, 300, 10000, 8.6073),
    (DAY, 74, 20, 10, 5, 40000, 4.0603),
    (DAY, 80, 20, 10, 5, 40000, 4.0603),
    (DAY, -80, 20, 10, 175, 40000, 6.2990),
    (NEGATIVE, 40, 0, 45, 90, 50400, 2.0254),
    (SHORT, 20, 0, 60, 45, 36000, 3.9534),
    (SHORT, 20, 0, 60, 45, 40000, 5.9599),
]


def test_the_zenith_delay_is_that_of_rtklib() -> None:
    """RTKLIB takes 273.16 K for 0 degC and 0.002277 for the wet part, together 0.1 mm more."""
    latitude_deg, height, expected = TROPMODEL.T
    found = zenith_delay(np.radians(latitude_deg), height)
    np.testing.assert_allclose(found, expected, atol=0.15 * MILLIMETRE)


def test_the_air_begins_at_the_sea_and_is_held_at_eleven_kilometres() -> None:
    """A metre of air at sea level is 0.12 hPa, which is 0.27 mm dry; the vapour in it makes 0.04 to 0.1 mm more."""
    height = np.array([-50.0, 0.0, 1.0, 11000.0, 15000.0])
    delay = zenith_delay(np.full(5, 0.8), height)
    assert delay[0] == delay[1]
    assert 0.27 * MILLIMETRE < delay[1] - delay[2] < 0.4 * MILLIMETRE
    assert delay[3] == delay[4]


@pytest.mark.parametrize("line", IONMODEL, ids=[f"{line[1]}N {line[2]}E at {line[5]}s" for line in IONMODEL])
def test_the_ionosphere_is_that_of_rtklib(
    line: tuple[tuple[float, ...], float, float, float, float, float, float],
) -> None:
    coefficients, *degrees, t, expected = line
    angles = np.radians(np.array(degrees)[:, None])
    found = klobuchar(np.array([coefficients]), *angles, np.array([t]))
    assert found[0] == pytest.approx(expected, abs=MILLIMETRE)


def test_a_satellite_below_the_horizon_has_the_ionosphere_of_the_horizon() -> None:
    both = np.ones(2)
    found = klobuchar(np.array([DAY, DAY]), 0.5 * both, 0.1 * both, np.radians([-20.0, 0.0]), both, 45000.0 * both)
    assert found[0] == found[1]


def test_the_ionosphere_on_another_frequency() -> None:
    """The published example, 23.784 m on L1, is (1575.42 / 1176.45)^2 = 1.79327 times that on L5."""
    angles = dict(
        zip(
            ("latitude", "longitude", "elevation", "azimuth"),
            np.radians([[40.0], [-100.0], [20.0], [210.0]]),
            strict=True,
        )
    )
    known = np.array([[3.82e-8, 1.49e-8, -1.79e-7, 0.0, 1.43e5, 0.0, -3.28e5, 1.13e5]])
    motion = Motion(
        t=np.array([20.75 * 3600.0]), covariates={**angles, "frequency": np.array([1176.45e6]), "klobuchar": known}
    )
    found = effect("pseudorange.ionosphere").apply(np.array([[2.0e7]]), np.ones(1), motion)
    assert found[0, 0] - 2.0e7 == pytest.approx(42.651, abs=2.0 * MILLIMETRE)


def test_half_the_turn_of_the_earth_is_half_as_long() -> None:
    """w / c x_s y_r = 7.2921151467e-5 / 299792458 x 2e7 x 6.378e6 = 31.0275 m in full for a receiver on the y axis."""
    motion = Motion(
        t=np.zeros(1),
        covariates={
            "satellite_position": np.array([[2.0e7, 1.0e7, 1.3e7]]),
            "receiver_position": np.array([[0.0, 6.378e6, 0.0]]),
        },
    )
    turned = effect("pseudorange.earth_rotation")
    for share, longer in ((0.0, 0.0), (0.5, 15.5138), (1.0, 31.0275)):
        found = turned.apply(np.array([[2.0e7]]), np.array([share]), motion)[0, 0]
        assert found - 2.0e7 == pytest.approx(longer, abs=MILLIMETRE)
