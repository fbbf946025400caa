"""<stream>.time_offset: the time stamps of a stream are late."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray, zero_unless_finite
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import STREAMS as ALL_STREAMS
from sinan.sensors.effects.streams import textbook_model
from sinan.sensors.magnetometer import field_b
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.registry import sensor
from sinan.sensors.rotation import cross

PLAUSIBLE = 0.1  # s; buffers, filters and serial lines of hobby autopilots


def rate_of_field(motion: Motion) -> FloatArray:
    """(n, 3) d(C_bn m_n)/dt = -w x m_b."""
    return -cross(motion.w_ib_b, field_b(motion))


def rate_of(model: SensorModel, motion: Motion) -> FloatArray:
    """(n, size) of any model: H_position v_n + H_attitude w_ib_b."""
    with np.errstate(invalid="ignore"):
        H = model.jacobian(motion)
        rates = {"position": motion.v_n, "attitude": motion.w_ib_b} if "attitude" in H else {"position": motion.v_n}
        parts = [np.sum(H[block] * rate[:, None, :], axis=2) for block, rate in rates.items() if block in H]
    return zero_unless_finite(sum(parts, np.zeros((len(motion), model.size))))


#: What is needed of the motion, by the equations of the sensor.
NEEDS = {"field": ("m_b", "q_nb", "w_ib_b"), "height": ("p_n", "v_n")}
NEEDS_OF_OTHERS = ("p_n", "v_n", "q_nb", "w_ib_b")


def for_stream(stream: str) -> Effect:
    """The time offset of one stream; gps has `gps.latency`, accel and gyro are the clock, a base stands still."""
    kernel = sensor(stream).kernel

    def regressor(motion: Motion) -> FloatArray:
        """(n, size, 1): -d reading / dt."""
        if kernel == "field":
            return -rate_of_field(motion)[:, :, None]
        return -rate_of(textbook_model(stream, len(ALL_STREAMS[stream].components), motion), motion)[:, :, None]

    def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
        """The plain reading at t - b."""
        model = model or textbook_model(stream, plain.shape[1], motion)
        return model.predict(motion.at(motion.t - beta[0]))

    return Effect(
        name=f"{stream}.time_offset",
        stream=stream,
        summary=f"The {ALL_STREAMS[stream].title}'s time stamps are late.",
        opposite=f"The {ALL_STREAMS[stream].title}'s time stamps are early.",
        enters="reading -> that of t - b",
        physics=(
            "The reading belongs to t - b, b > 0 if it is stamped after it was taken: transfer and buffers, or another "
            "clock. The reading at t - b is used, not its first order. The clock is that of the IMU."
        ),
        source="M. Li, A. I. Mourikis, International Journal of Robotics Research 33(7), 2014",
        parameters=(Parameter("b", "s", PLAUSIBLE),),
        needs=NEEDS.get(kernel, NEEDS_OF_OTHERS),
        regressor=regressor,
        exact=exact,
        other_instants=True,
        scenario=sensor(stream).late,
        separates="quick changes of what the sensor reads",
    )
