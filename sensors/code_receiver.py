"""Classes of receivers of the C/A and of the P code: noise, drift and rate of their pseudoranges.

    rho' = |p_s - p_r| + c (clock_rx - clock_sat) + delays + m + n

n is white, m a first-order Gauss-Markov process of each satellite (multipath, drift of the channels), and the clock
runs off at a steady rate with white frequency noise. The noise of a code goes with the length of its chips, ten times
shorter in the P code.

Source: E. D. Kaplan, C. J. Hegarty, Understanding GPS, 2nd ed. (2006), 5.6.3, the code loop's thermal noise. The
course's classes take the lecture's numbers, 20 m and 2 m (section 7), half of the variance as noise, half as drift; the
lecture does not split them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.constants import SPEED_OF_LIGHT
from sinan.sensors.range_noise import LOWEST_ELEVATION

CA_CHIP = SPEED_OF_LIGHT / 1.023e6  # m, IS-GPS-200N, 3.3.2.1
P_CHIP = SPEED_OF_LIGHT / 10.23e6  # m, the same
LOWEST_STRENGTH, RISE = 36.0, 14.0  # dB-Hz at the horizon, and what the zenith has more: a patch antenna with a plane


def strength(elevation: FloatArray) -> FloatArray:
    """(n,) signal-to-noise density [dB-Hz] of a satellite at that elevation [rad]."""
    return np.asarray(LOWEST_STRENGTH + RISE * np.sin(np.maximum(elevation, 0.0)))


@dataclass(frozen=True)
class CodeReceiver:
    """A class of receivers.

    Attributes
    ----------
    name : by which a scenario asks for it
    codes : RINEX names of what it measures: one code of L1, or one of L1 and one of L2
    chip : length of a chip [m]
    bandwidth : one-sided, of the code loop [Hz]
    spacing : between early and late [chips]
    losses : of the signal against that of the C/A code: codeless tracking, a weaker code [dB]
    noise : 1-sigma of a pseudorange at any elevation [m], in place of the loop's; None: the loop's
    drift : 1-sigma of the slow error at the zenith [m]; grows as 1 / sin E
    drift_time : its correlation time [s]
    clock_drift : of the receiver's clock [m/s]
    clock_noise : its white frequency noise [m/sqrt(s)]
    rate : epochs a second [Hz]
    """

    name: str
    codes: tuple[str, ...]
    chip: float
    bandwidth: float = 1.0
    spacing: float = 0.5
    losses: float = 0.0
    noise: float | None = None
    drift: float = 0.0
    drift_time: float = 60.0
    clock_drift: float = 30.0
    clock_noise: float = 1.0
    rate: float = 1.0

    def sigma(self, strength: FloatArray) -> FloatArray:
        """(n,) 1-sigma of the white noise [m].

        sigma = chip sqrt(B d / (2 C/N0) (1 + 2 / (T C/N0))),  T = 0.02 s

        Parameters
        ----------
        strength : (n,) [dB-Hz], of the C/A code
        """
        if self.noise is not None:
            return np.full(len(strength), self.noise)
        density = 10.0 ** (0.1 * (strength - self.losses))  # Hz
        squaring = 1.0 + 2.0 / (0.02 * density)
        return np.asarray(self.chip * np.sqrt(self.bandwidth * self.spacing / (2.0 * density) * squaring))

    def slow(self, elevation: FloatArray) -> FloatArray:
        """(n,) 1-sigma of the slow error [m]; the course's classes know no elevation."""
        if self.noise is not None:
            return np.full(len(elevation), self.drift)
        return np.asarray(self.drift / np.sin(np.maximum(elevation, LOWEST_ELEVATION)))


#: What a scenario may ask for.
CLASSES = {
    one.name: one
    for one in (
        CodeReceiver("ca", ("C1C",), CA_CHIP, drift=0.5),
        CodeReceiver("p", ("C1W",), P_CHIP, bandwidth=0.5, spacing=1.0, losses=10.0, drift=0.1, clock_noise=0.3),
        CodeReceiver(
            "p_two", ("C1W", "C2W"), P_CHIP, bandwidth=0.5, spacing=1.0, losses=10.0, drift=0.1, clock_noise=0.3
        ),
        CodeReceiver("course_ca", ("C1C",), CA_CHIP, noise=20.0 / np.sqrt(2.0), drift=20.0 / np.sqrt(2.0)),
        CodeReceiver("course_p", ("C1W",), P_CHIP, noise=2.0 / np.sqrt(2.0), drift=2.0 / np.sqrt(2.0)),
    )
}
