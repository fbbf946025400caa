"""The standard atmosphere against the tables of ISO 2533, and the speed of sound against handbooks."""

from __future__ import annotations

import numpy as np
import pytest

from sinan.sensors.atmosphere import height_from_pressure, pressure_from_height, speed_of_sound

#: Geopotential height [m] and pressure [Pa]: ISO 2533:1975, table 5
TABLE = np.array([[-1000.0, 113929.0], [0.0, 101325.0], [1000.0, 89874.6], [5000.0, 54019.9], [11000.0, 22632.0]])
PASCAL = 0.6  # the table's last digit
DECIMETRE = 0.1


def test_pressures_are_those_of_the_table() -> None:
    np.testing.assert_allclose(pressure_from_height(TABLE[:, 0]), TABLE[:, 1], atol=PASCAL)


def test_heights_are_those_of_the_table() -> None:
    np.testing.assert_allclose(height_from_pressure(TABLE[:, 1]), TABLE[:, 0], atol=DECIMETRE)


def test_a_height_counts_from_where_the_reference_is() -> None:
    """8.43 m a hectopascal at sea level: p / (rho g) = 100 / (1.225 x 9.80665) = 8.324 m, in air of 15 degC."""
    found = height_from_pressure(np.array([99900.0, 100000.0, 100100.0]), reference=100000.0)
    assert found[1] == 0.0
    np.testing.assert_allclose(found[[0, 2]], [8.44, -8.43], atol=0.01)


def test_the_speed_of_sound_is_that_of_the_handbook() -> None:
    """Dry air: 331.3 m/s at 0 degC, 343.2 at 20 degC (CRC Handbook), and 318.9 at -20 degC."""
    np.testing.assert_allclose(speed_of_sound(np.array([0.0, 20.0, -20.0])), [331.3, 343.2, 318.9], atol=0.1)


def test_thin_air_is_air() -> None:
    assert height_from_pressure(np.array([0.5]), reference=0.6)[0] > 0.0


@pytest.mark.parametrize(("pressure", "reference"), [(0.0, 101325.0), (-5.0, 101325.0), (90000.0, 0.0)])
def test_a_pressure_that_cannot_be_is_an_error(pressure: float, reference: float) -> None:
    with pytest.raises(ValueError, match="not positive"):
        height_from_pressure(np.array([101325.0, pressure]), reference)
