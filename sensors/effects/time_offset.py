"""<stream>.time_offset: the time stamps of a stream are late."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sinan.sensors.arrays import FloatArray, zero_unless_finite
from sinan.sensors.effects.beams import beams_b
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import STREAMS as ALL_STREAMS
from sinan.sensors.effects.streams import textbook_model
from sinan.sensors.magnetometer import field_b
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.ranging import slant_range_jacobian
from sinan.sensors.rotation import cross

PLAUSIBLE = 0.1  # s; buffers, filters and serial lines of hobby autopilots
STREAMS = ("mag", "baro", "sonar", "laser")  # gps: `gps.latency`; accel and gyro are the clock; a base stands still


def rate_of_field(motion: Motion) -> FloatArray:
    """(n, 3) d(C_bn m_n)/dt = -w x m_b."""
    return -cross(motion.w_ib_b, field_b(motion))


def rate_of_height(motion: Motion) -> FloatArray:
    """(n, 1) climb rate."""
    return -motion.v_n[:, 2:3]


def rate_of_range(motion: Motion) -> FloatArray:
    """(n, beams) H_position v_n + H_attitude w_ib_b; none where the beam does not point below the horizon."""
    rates = []
    for beam in beams_b(motion):
        H = slant_range_jacobian(motion, beam)
        with np.errstate(invalid="ignore"):
            along = np.sum(H["position"][:, 0] * motion.v_n, axis=1)
            rate = along + np.sum(H["attitude"][:, 0] * motion.w_ib_b, axis=1)
        rates.append(zero_unless_finite(rate))
    return np.stack(rates, axis=1)


RATES: dict[str, Callable[[Motion], FloatArray]] = {
    "mag": rate_of_field,
    "baro": rate_of_height,
    "sonar": rate_of_range,
    "laser": rate_of_range,
}
NEEDS = {
    "mag": ("m_b", "q_nb", "w_ib_b"),
    "baro": ("p_n", "v_n"),
    "sonar": ("p_n", "v_n", "q_nb", "w_ib_b"),
    "laser": ("p_n", "v_n", "q_nb", "w_ib_b"),
}
SCENARIO = {"mag": "aerobatics", "baro": "climb_descent", "sonar": "low_pass", "laser": "climb_descent"}


def for_stream(stream: str) -> Effect:
    """The time offset of one stream: mag, baro, sonar or laser."""

    def regressor(motion: Motion) -> FloatArray:
        """(n, size, 1): -d reading / dt."""
        return -RATES[stream](motion)[:, :, None]

    def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
        """The plain reading at t - b."""
        model = model or textbook_model(stream, plain.shape[1], motion)
        return model.predict(motion.at(motion.t - beta[0]))

    return Effect(
        name=f"{stream}.time_offset",
        stream=stream,
        summary=f"The {ALL_STREAMS[stream].title}'s time stamps are late.",
        enters="reading -> that of t - b",
        physics=(
            "The reading belongs to t - b, b > 0 if it is stamped after it was taken: transfer and buffers, or another "
            "clock. The reading at t - b is used, not its first order. The clock is that of the IMU."
        ),
        source="M. Li, A. I. Mourikis, International Journal of Robotics Research 33(7), 2014",
        parameters=(Parameter("b", "s", PLAUSIBLE),),
        needs=NEEDS[stream],
        regressor=regressor,
        exact=exact,
        other_instants=True,
        scenario=SCENARIO[stream],
        separates="quick changes of what the sensor reads",
    )
