"""motion.rotor_drag: the air holds the rotors back, so the specific force is not along body down."""

from __future__ import annotations

from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects.algebra import air_velocity_b
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.motion import Motion

PLAUSIBLE = 0.3  # 1/s; P. Martin, E. Salaun, ICRA 2010: some 0.3 1/s for a small quadrotor


def regressor(motion: Motion) -> FloatArray:
    """(n, 3, 1): horizontal specific force in the body -b (v - wind)."""
    drag = -air_velocity_b(motion)
    drag[:, 2] = 0.0
    return drag[:, :, None]


EFFECT = Effect(
    name="motion.rotor_drag",
    stream="level",
    summary="The rotors' drag tilts what the accelerometer takes for down.",
    enters="horizontal specific force in the body = -b (v - wind), not zero",
    physics=(
        "The horizontal specific force of a multicopter is not zero but -b (v - wind) in the body (blade flapping and "
        "induced drag, linear in the airspeed). What uses the accelerometer as a level neglects it; where the "
        "accelerometer drives the process the force is measured, and the effect is no candidate."
    ),
    source="P. Martin, E. Salaun, The true role of accelerometer feedback in quadrotor control, ICRA 2010",
    parameters=(Parameter("b", "1/s", PLAUSIBLE),),
    needs=("v_n", "q_nb"),
    regressor=regressor,
    scenario="no_aiding_flight",
    separates="steady flight at several speeds",
)
