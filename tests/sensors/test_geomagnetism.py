"""The Earth's field against the published test values of the World Magnetic Model."""

from __future__ import annotations

from datetime import date

import numpy as np
import pytest

from sinan.sensors.geomagnetism import decimal_year, declination, earth_field

NANOTESLA = 1e-9  # T
HALF_A_DAY = 0.2 * NANOTESLA  # change of the field between midnight and noon


@pytest.mark.parametrize(
    ("latitude", "longitude", "field"),
    [
        (80.0, 0.0, (6570.4, -146.3, 54606.0)),
        (0.0, 120.0, (39624.3, 109.9, -10932.5)),
        (-80.0, 240.0, (5940.6, 15772.1, -52480.8)),
    ],
)
def test_world_magnetic_model_2020(latitude: float, longitude: float, field: tuple[float, float, float]) -> None:
    """A. Chulliat et al., The US/UK World Magnetic Model for 2020-2025, NOAA: test values for 2020.0, height 0."""
    found = earth_field(latitude, longitude, 0.0, date(2020, 1, 1))
    np.testing.assert_allclose(found, np.array(field) * NANOTESLA, atol=HALF_A_DAY)


@pytest.mark.parametrize("year", [2010, 2015, 2020, 2025])
def test_releases_join_within_their_uncertainty(year: int) -> None:
    before, after = (earth_field(40.0, 116.0, 50.0, day) for day in (date(year - 1, 12, 31), date(year, 1, 1)))
    assert np.linalg.norm(after - before) < 250.0 * NANOTESLA


def test_the_reference_field_agrees_with_the_world_magnetic_model() -> None:
    before, after = earth_field(48.0, 11.0, 0.0, date(2009, 12, 31)), earth_field(48.0, 11.0, 0.0, date(2010, 1, 1))
    assert np.linalg.norm(after - before) < 100.0 * NANOTESLA


def test_longitude_counts_either_way() -> None:
    day = date(2026, 6, 1)
    np.testing.assert_array_equal(earth_field(10.0, 200.0, 0.0, day), earth_field(10.0, -160.0, 0.0, day))


def test_declination_is_positive_to_the_east() -> None:
    assert declination(np.array([1.0, 0.1, 0.5])) == pytest.approx(np.arctan(0.1))


def test_the_middle_of_a_year() -> None:
    assert decimal_year(date(2025, 7, 2)) == pytest.approx(2025.5, abs=1e-9)


@pytest.mark.parametrize("day", [date(1899, 12, 31), date(2030, 1, 1)])
def test_a_date_that_no_model_covers_is_refused(day: date) -> None:
    with pytest.raises(ValueError, match="1900 to 2029"):
        earth_field(0.0, 0.0, 0.0, day)


def test_a_latitude_beyond_the_pole_is_refused() -> None:
    with pytest.raises(ValueError, match="latitude_deg"):
        earth_field(91.0, 0.0, 0.0, date(2026, 1, 1))
