"""motion.wind: the air moves against the ground."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion

PLAUSIBLE = 5.0  # m/s, a fresh breeze is 8


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 2): +drag C_bn (wind, 0) on the body's x and y, drag = covariate `rotor_drag` [1/s]."""
    C_bn = matrix_from_quaternion(motion.q_nb).transpose(0, 2, 1)
    G = motion.covariates["rotor_drag"][:, None, None] * C_bn[:, :, :2]
    G[:, 2] = 0.0
    return G


EFFECT = Effect(
    name="motion.wind",
    stream="level",
    summary="The wind tilts what the accelerometer takes for down.",
    enters="horizontal specific force in the body += drag x wind,  wind = b",
    physics=(
        "Rotor drag sees v - wind: the horizontal specific force is +drag wind in addition to the -drag v of "
        "`motion.rotor_drag`. Only the product with the drag is seen, so the drag has to be declared (covariate "
        "`rotor_drag`)."
    ),
    source="P. Martin, E. Salaun, The true role of accelerometer feedback in quadrotor control, ICRA 2010",
    parameters=(Parameter("north", "m/s", PLAUSIBLE), Parameter("east", "m/s", PLAUSIBLE)),
    needs=("q_nb", "rotor_drag"),
    regressor=regressor,
    scenario="no_aiding_flight",
    separates="yaw turns in the wind, with a declared rotor drag",
)
