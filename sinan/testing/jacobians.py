"""A sensor model's Jacobian against central differences on the manifold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import quaternion_exp, quaternion_multiply

#: Step of the central differences, in the state's own unit (m, m/s, rad): rounding and curvature both stay small.
STEP = 1e-6
#: Largest difference that is allowed, in the unit of the reading over that of the state, and as a share of it.
ABSOLUTE, RELATIVE = 1e-7, 1e-7
#: Blocks of the error state that a motion has.
BLOCKS = ("position", "velocity", "attitude")
_AXES = {"position": ("north", "east", "down"), "velocity": ("north", "east", "down")}


def some_motion(poses: int = 5, seed: int = 4) -> Motion:
    """A few poses of a tilted body some 12 m above the ground, in general position.

    Parameters
    ----------
    poses : how many
    seed : of the random numbers
    """
    rng = np.random.default_rng(seed)
    return Motion(
        t=np.arange(poses, dtype=np.float64),
        p_n=rng.normal(0.0, 3.0, (poses, 3)) + np.array([0.0, 0.0, -12.0]),
        v_n=rng.normal(0.0, 2.0, (poses, 3)),
        q_nb=quaternion_exp(rng.normal(0.0, 0.4, (poses, 3))),
        f_b=rng.normal(0.0, 3.0, (poses, 3)),
        w_ib_b=rng.normal(0.0, 1.0, (poses, 3)),
        m_n=np.array([[0.5, -0.06, 0.86]]),
        ground_down=1.0,
        covariates={"point_n": rng.normal(0.0, 2.0, (poses, 3)) + np.array([20.0, 0.0, -12.0])},
    )


def moved(at: Motion, block: str, step: FloatArray) -> Motion:
    """The motion with one block of the error state stepped (3,): the attitude turns in the body, q * exp(step)."""
    if block == "position":
        return replace(at, p_n=at.p_n + step)
    if block == "velocity":
        return replace(at, v_n=at.v_n + step)
    return replace(at, q_nb=quaternion_multiply(at.q_nb, quaternion_exp(step)))


def assert_jacobian(
    model: SensorModel,
    motion: Motion | None = None,
    *,
    absolute: float = ABSOLUTE,
    relative: float = RELATIVE,
) -> None:
    """Assert that a model's Jacobian is the derivative of its prediction, by position, velocity and attitude.

    A block that the model does not name has to be zero. The attitude error is an angle about the body's axes:
    C_true = C Exp(dtheta_b). The block of the model's own bias has the shape of what is added to the reading.

    Parameters
    ----------
    model : name, size, R, bias, predict(motion), jacobian(motion)
    motion : along what; default: `some_motion`
    absolute, relative : difference that is allowed, [unit of the reading / unit of the state], and as a share

    Raises
    ------
    AssertionError : names block, pose, component and axis of the largest difference, with both values
    """
    at = some_motion() if motion is None else motion
    given = model.jacobian(at)
    plain = model.predict(at)
    if plain.shape != (len(at), model.size):
        raise AssertionError(f"{model.name}: predict has shape {plain.shape}; expected {(len(at), model.size)}")
    for block, H in given.items():
        width = 3 if block in BLOCKS or model.bias is None else model.bias.size
        if H.shape != (len(at), model.size, width):
            expected = (len(at), model.size, width)
            raise AssertionError(f"{model.name}: d reading / d {block} has shape {H.shape}; expected {expected}")
    wrong = [said for block in BLOCKS if (said := _wrong(model, at, block, given.get(block), absolute, relative))]
    if wrong:
        raise AssertionError("\n".join(wrong))


def _wrong(
    model: SensorModel, at: Motion, block: str, given: FloatArray | None, absolute: float, relative: float
) -> str:
    """The worst entry of one block in words; empty: all are right."""
    H = np.zeros((len(at), model.size, 3)) if given is None else given
    columns = []
    for step in STEP * np.eye(3):
        change = model.predict(moved(at, block, step)) - model.predict(moved(at, block, -step))
        columns.append(change / (2.0 * STEP))
    differences = np.stack(columns, axis=-1)
    off = np.abs(H - differences) - relative * np.abs(differences)
    if np.all(off <= absolute):
        return ""
    pose, component, axis = np.unravel_index(int(np.argmax(np.where(np.isnan(off), np.inf, off))), off.shape)
    name = _AXES.get(block, ("x", "y", "z"))[axis]
    said = f"{H[pose, component, axis]:.6g}" if given is not None else "nothing, which is 0"
    return (
        f"{model.name}: d reading[{component}] / d {block} {name} at pose {pose}: the Jacobian says {said}, "
        f"central differences say {differences[pose, component, axis]:.6g}"
    )
