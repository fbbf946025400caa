"""baro.lag: the barometer follows the pressure with a first-order lag."""

from __future__ import annotations

import numpy as np

from sensors.arrays import FloatArray
from sensors.effects.declaration import Effect, Parameter
from sensors.model import SensorModel
from sensors.motion import Motion

PLAUSIBLE = 0.5  # s; IIR filters of BMP280 and MS5611 drivers and a narrow port give 0.05 to 1 s


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): a short lag delays, d z / d b = -d height / dt = v_down."""
    return motion.v_n[:, 2, None, None].copy()


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """The solution of b dz/dt = height - z over the motion's own instants; the lag started on a ramp.

    Between two instants the height u is the cubic through its values and rates. A polynomial input has the
    particular solution z_p = u - b Du + b^2 D^2u - b^3 D^3u (D = d/dt), so that
    z(t) = z_p(t) + (z(t_k) - z_p(t_k)) exp(-(t - t_k) / b) whatever the sampling. A lag that is not
    positive has no such solution; there the linear form continues the function.
    """
    b = float(beta[0])
    if b <= 0.0 or len(motion) < 2:
        return plain + b * regressor(motion)[:, :, 0]
    u, v = plain[:, 0], -motion.v_n[:, 2]
    h = np.diff(motion.t)
    slope = np.diff(u) / h
    jerk = 6.0 * (v[1:] + v[:-1] - 2.0 * slope) / h**2
    curvature_start = (6.0 * slope - 4.0 * v[:-1] - 2.0 * v[1:]) / h
    curvature_end = (-6.0 * slope + 2.0 * v[:-1] + 4.0 * v[1:]) / h
    start = u[:-1] - b * v[:-1] + b**2 * curvature_start - b**3 * jerk
    end = u[1:] - b * v[1:] + b**2 * curvature_end - b**3 * jerk
    decay = np.exp(-h / b)
    z = [float(u[0] - b * v[0])]
    for first, last, kept in zip(start.tolist(), end.tolist(), decay.tolist(), strict=True):
        z.append((z[-1] - first) * kept + last)
    return np.array(z)[:, None]


EFFECT = Effect(
    name="baro.lag",
    stream="baro",
    summary="The barometer follows with a lag.",
    physics=(
        "b dz/dt = height - z, b > 0: a narrow port, foam, or the low-pass filter inside the sensor. The true filter "
        "is used, not its first order. A lag shorter than the vehicle's changes of climb rate is a delay: "
        "`baro.time_offset` cannot be told from it."
    ),
    source="K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed. (first-order response)",
    parameters=(Parameter("b", "s", PLAUSIBLE),),
    needs=("p_n", "v_n"),
    regressor=regressor,
    exact=exact,
    other_instants=True,
    scenario="climb_descent",
    separates="quick changes of climb rate",
)
