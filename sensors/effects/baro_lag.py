"""baro.lag: the barometer follows the pressure with a first-order lag."""

from __future__ import annotations

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.5  # s; IIR filters of BMP280 and MS5611 drivers and a narrow port give 0.05 to 1 s

SERIES_TERMS = 18  # x^18 / 18! is below 2e-16 for x < 1


def regressor(motion: Motion) -> FloatArray:
    """(n, 1, 1): a short lag delays, d z / d b = -d height / dt = v_down."""
    return motion.v_n[:, 2, None, None].copy()


def exact(plain: FloatArray, beta: FloatArray, motion: Motion, model: SensorModel | None = None) -> FloatArray:
    """The solution of b dz/dt = height - z over the motion's own instants; the lag started on a ramp.

    Between two instants the height is the cubic through its values u and rates v, for which with x = h / b

        z_1 = exp(-x) z_0 + A u_0 + B u_1 + h (C v_0 + D v_1),   I_k = int_0^1 x exp(-x (1 - s)) s^k ds,
        A = I_0 - 3 I_2 + 2 I_3,  B = 3 I_2 - 2 I_3,  C = I_1 - 2 I_2 + I_3,  D = I_3 - I_2,

    whatever the sampling. For a lag that is not positive the linear form continues the function.
    """
    b = float(beta[0])
    if b <= 0.0:
        return plain + b * regressor(motion)[:, :, 0]
    u, v, h = plain[:, 0], -motion.v_n[:, 2], np.diff(motion.t)
    I_0, I_1, I_2, I_3 = moments(h / b)
    driven = (I_0 - 3.0 * I_2 + 2.0 * I_3) * u[:-1]
    driven += (3.0 * I_2 - 2.0 * I_3) * u[1:]
    driven += (I_1 - 2.0 * I_2 + I_3) * h * v[:-1]
    driven += (I_3 - I_2) * h * v[1:]
    z = [float(u[0] - b * v[0])]
    for kept, added in zip(np.exp(-h / b).tolist(), driven.tolist(), strict=True):
        z.append(kept * z[-1] + added)
    return np.array(z)[:, None]


def moments(x: FloatArray) -> tuple[FloatArray, ...]:
    """I_k = int_0^1 x exp(-x (1 - s)) s^k ds for k = 0 to 3: I_k = 1 - k I_{k-1} / x, by its series where x < 1."""
    recursive = [-np.expm1(-x)]
    for k in (1, 2, 3):
        recursive.append(1.0 - k * recursive[-1] / x)
    series = [np.zeros_like(x) for _ in range(4)]
    term = x * np.exp(-x)
    for j in range(SERIES_TERMS):
        for k in range(4):
            series[k] += term / (j + k + 1)
        term = term * x / (j + 1)
    return tuple(np.where(x < 1.0, series[k], recursive[k]) for k in range(4))


EFFECT = Effect(
    name="baro.lag",
    stream="baro",
    summary="The barometer follows with a lag.",
    enters="the reading is z with b dz/dt = height - z,  b > 0",
    physics=(
        "b dz/dt = height - z, b > 0: a narrow port, foam, or the low-pass filter inside the sensor. The true filter "
        "is used, not its first order. A lag shorter than the vehicle's changes of climb rate is a delay: "
        "`baro.time_offset` cannot be told from it."
    ),
    source="K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed. (first-order response)",
    parameters=(Parameter("b", "s", PLAUSIBLE, positive=True),),
    needs=("p_n", "v_n"),
    regressor=regressor,
    exact=exact,
    other_instants=True,
    scenario="climb_descent",
    separates="quick changes of climb rate",
)
