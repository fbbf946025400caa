"""How wrong one pseudorange of one epoch is about the full model, by system, elevation and signal strength.

    v = s_system^2 + e^2 / sin^2 E + c^2 10^(-(C/N0 - 45) / 10) + (r I)^2

s is orbit, satellite clock and what the system's signals have of their own; e multipath and what the troposphere
leaves; c the code loop's noise at 45 dB-Hz; r the share of the ionospheric delay I that is particular to a ray. What
the rays have in common of the ionosphere is a field of standard deviation `field` times I, which is
`sensors.pseudorange.ionosphere_left`. A message that promises less than usual, above 4 m, is believed: its accuracy is
added.

The sizes that are there unless others are given are geometric means over five sites (docs/notes/range_noise.md).

Source: the form is that of H.-J. Euler, C. C. Goad, Bulletin Geodesique 65 (1991) 130, with the strength of S. Brunner,
H. Hartinger, L. Troyer, Journal of Geodesy 73 (1999) 280.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.formats.rinex_observation import TextArray

REFERENCE_STRENGTH = 45.0  # dB-Hz; also of a row without a strength
#: Elevation below which no error of a range grows [rad]: every law of them divides by the sine of this at least.
LOWEST_ELEVATION = np.deg2rad(5.0)
#: Above what messages usually promise [m]: 2.0, 2.8 and 3.12 m in 2550 of the 2552 messages of Esbjerg and Kamakura
#: (measured: `pytest tests/experiments/test_gnss.py -k promise`); 4.0 is GPS's URA index 2 (IS-GPS-200).
USUAL_ACCURACY = 4.0
SYSTEMS = "GEJCR"
TYPICAL = {"G": 0.44, "E": 0.20, "J": 0.51, "C": 0.91, "R": 1.37}  # m


@dataclass(frozen=True)
class RangeNoise:
    """The law's sizes.

    Attributes
    ----------
    system : s by the letter of the system [m]
    elevation, strength : e and c [m]
    ray, field : shares of the ionospheric delay [1]
    """

    system: Mapping[str, float] = field(default_factory=lambda: dict(TYPICAL))
    elevation: float = 0.15
    strength: float = 0.24
    ray: float = 0.05
    field: float = 0.18

    @property
    def sizes(self) -> FloatArray:
        """(9,) s of G, E, J, C, R, then e, c, r, field."""
        s = [self.system[letter] for letter in SYSTEMS]
        return np.array([*s, self.elevation, self.strength, self.ray, self.field])

    @classmethod
    def of(cls, sizes: FloatArray) -> RangeNoise:
        """The law with these sizes (9,)."""
        values = [float(x) for x in sizes]
        return cls(dict(zip(SYSTEMS, values[:5], strict=True)), *values[5:])

    def variance(
        self,
        system: TextArray,
        elevation: FloatArray,
        strength: FloatArray,
        accuracy: FloatArray,
        ionosphere: FloatArray,
    ) -> FloatArray:
        """(n,) variance of each row, without the field [m^2]."""
        basis = squares(system, elevation, strength, ionosphere)
        return np.asarray(basis @ self.sizes[:8] ** 2 + believed(accuracy))


def squares(system: TextArray, elevation: FloatArray, strength: FloatArray, ionosphere: FloatArray) -> FloatArray:
    """(n, 8) what the squares of the first eight sizes are multiplied with."""
    sine = np.sin(np.maximum(elevation, LOWEST_ELEVATION))
    power = np.where(np.isfinite(strength), strength, REFERENCE_STRENGTH)
    columns = [(system == letter).astype(np.float64) for letter in SYSTEMS]
    columns += [1.0 / sine**2, 10.0 ** (-0.1 * (power - REFERENCE_STRENGTH)), ionosphere**2]
    return np.stack(columns, axis=1)


def believed(accuracy: FloatArray) -> FloatArray:
    """(n,) variance that an unusually bad message adds [m^2]."""
    return np.where(accuracy > USUAL_ACCURACY, accuracy, 0.0) ** 2
