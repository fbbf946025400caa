"""The streams that time-localised effects enter: sizes, units, plausible sizes of a disturbance."""

from __future__ import annotations

from dataclasses import dataclass

from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion


@dataclass(frozen=True)
class StreamSize:
    """One stream as a disturbance sees it: components, their unit, a plausible disturbance, kinds of recording, and
    what the sensor is called in a sentence.
    """

    components: tuple[str, ...]
    unit: str
    plausible: float
    kinds: frozenset[str] = frozenset({"flight"})
    title: str = ""


_BOTH = frozenset({"flight", "poses"})
_AXES = ("x", "y", "z")
_NED = ("north", "east", "down")

#: Plausible: a knock or thermal shock of a MEMS sensor (zero tolerances of the MPU-6000: 50 mg, 20 deg/s), iron brought
#: near (a tenth of the field), a door or a gust (baro), an obstacle under the beam, a GPS multipath jump
STREAMS = {
    "accel": StreamSize(_AXES, "m/s^2", 0.5, _BOTH, title="accelerometer"),
    "gyro": StreamSize(_AXES, "rad/s", 0.05, _BOTH, title="gyroscope"),
    "mag": StreamSize(_AXES, "1", 0.1, _BOTH, title="magnetometer"),
    "baro": StreamSize(("height",), "m", 3.0, title="barometer"),
    "sonar": StreamSize(("range",), "m", 1.0, title="sonar"),
    "laser": StreamSize(("range",), "m", 1.0, title="laser"),
    "gps": StreamSize(_NED, "m", 10.0, title="GPS"),
    "base": StreamSize(_NED, "m", 10.0, title="base receiver"),
}


def textbook_model(stream: str, size: int, motion: Motion) -> SensorModel:
    """The plain model of a stream, for effects that need its prediction at other instants; its noise is of no account.

    Parameters
    ----------
    stream : mag, baro, sonar, laser or gps
    size : components of a reading
    motion : whose covariate `angles` holds a scan's beams
    """
    from sinan.sensors.barometer import Barometer
    from sinan.sensors.gps import Gps
    from sinan.sensors.laser import Laser
    from sinan.sensors.magnetometer import Magnetometer
    from sinan.sensors.sonar import Sonar

    if stream == "laser":
        angles = motion.covariates["angles"][0] if motion.has("angles") else None
        return Laser(1.0) if angles is None else Laser(1.0, angles=angles)
    if stream == "gps":
        return Gps(1.0, 1.0 if size == 6 else None)
    models: dict[str, SensorModel] = {"mag": Magnetometer(1.0), "baro": Barometer(1.0), "sonar": Sonar(1.0)}
    return models[stream]
