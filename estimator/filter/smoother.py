"""Fixed-interval smoother: the state at every IMU sample, given all readings.

Two passes without an inverse (Bryson and Frazier; de Jong 1989): backwards r collects what later readings say about the
error dx of the filter's state, and the smoothed correction is dx = P r. Within a part the correction is then carried
forwards, dx <- Phi dx + Q r and dx <- dx - K nu, so that no covariance is kept but at the starts of parts.

Memory is bounded: the filter runs once and leaves its state at the start of every part; each part is run again, last
first, while it is smoothed.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973;
J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods, 2nd ed., sections 4.4 to 4.6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sinan.estimator.filter.events import ACCEPTED
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import B_IMU, CAPACITY, P_N, Q_NB, V_N
from sinan.estimator.filter.pieces import parts_of, recorded
from sinan.sensors.arrays import FloatArray, IntArray
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import rotate_back

#: IMU samples in a part, whose covariances are in memory at one time, 2000 * 56^2 * 8 bytes = 50 MB at most; and where
#: sigmas are wanted, which come one a part, 2 s of 200 Hz.
PART, PART_OF_SIGMAS = 2000, 400


@dataclass(frozen=True)
class SmoothedStates:
    """States given all readings.

    Attributes
    ----------
    t, x : (N,), (N, n + 1) nominal state at the samples of the IMU table
    t_sigma, sigma : (M,), (M, n) 1-sigma at the starts of the parts; empty unless asked for
    """

    t: FloatArray
    x: FloatArray
    t_sigma: FloatArray
    sigma: FloatArray


def smooth(journal: Journal, sigmas: bool = False, part: int | None = None) -> SmoothedStates:
    """Smooth a run of the filter.

    Parameters
    ----------
    journal : of `run_filter`
    sigmas : also the 1-sigma at the start of every part
    part : IMU samples in a part; default: `PART_OF_SIGMAS` where those are wanted, else `PART`
    """
    if part is None:
        part = PART_OF_SIGMAS if sigmas else PART
    inputs = journal.run
    assert isinstance(inputs, RunInputs)
    N, n = len(inputs.imu), inputs.model.layout.n
    parts = parts_of(inputs, part)
    r, information = np.zeros(CAPACITY), np.zeros((CAPACITY, CAPACITY))
    x_smooth, sigma = np.zeros((N, n + 1)), np.zeros((len(parts), n) if sigmas else (0, n))
    for place, one in reversed(list(enumerate(parts))):
        states = _smooth_part(one.inputs, r, information, sigmas)
        x_smooth[one.i0 : one.i1 + 1] = states[:, : n + 1]
        if sigmas:
            P = one.inputs.P
            smoothed = P - P @ information[:n, :n] @ P
            sigma[place] = np.sqrt(np.maximum(np.diag(smoothed), 0.0))
        if one.begins:  # later readings say nothing of what was before
            r[:], information[:] = 0.0, 0.0
    t_sigma = inputs.imu.t[[one.i0 for one in parts]] if sigmas else np.empty(0)
    return SmoothedStates(inputs.imu.t, x_smooth, t_sigma, sigma)


def joint_covariance(journal: Journal, states: IntArray, part: int) -> tuple[FloatArray, FloatArray]:
    """How the errors of a smoothed run at different instants go together.

    With e_j the error at the start of part j given all readings, P_j and N_j the filter's covariance and what later
    readings say there, L_j the transition of the filter's error over the part (steps and readings),

        cov(e_j, e_k) = P_j L_j' ... L_{k-1}' (1 - N_k P_k),   j <= k

    Parameters
    ----------
    journal : of `run_filter`
    states : (m,) places in the error state
    part : IMU samples between two instants

    Returns
    -------
    (M,) instants [s], and (M, m, M, m) covariance

    Source: J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods, 2nd ed., section 4.7.
    """
    inputs = journal.run
    assert isinstance(inputs, RunInputs)
    n, m = inputs.model.layout.n, len(states)
    parts = parts_of(inputs, part)
    L_T, seen = np.zeros((len(parts), n, n)), np.zeros((len(parts), n, m))
    r, N = np.zeros(CAPACITY), np.zeros((CAPACITY, CAPACITY))
    for place, one in reversed(list(enumerate(parts))):
        L_T[place] = _part_back(one.inputs, r, N, n)
        seen[place] = (np.eye(n) - N[:n, :n] @ one.inputs.P)[:, states]
        if one.begins:
            r[:], N[:] = 0.0, 0.0
    covariance = np.zeros((len(parts), m, len(parts), m))
    before = np.zeros((len(parts), m, n))
    for k, one in enumerate(parts):
        before[:k] = 0.0 if one.begins else before[:k] @ L_T[k - 1]
        before[k] = one.inputs.P[states]
        covariance[: k + 1, :, k] = before[: k + 1] @ seen[k]
        covariance[k, :, :k] = covariance[:k, :, k].transpose(2, 0, 1)
    return inputs.imu.t[[one.i0 for one in parts]], covariance


def _part_back(part: RunInputs, r: FloatArray, N: FloatArray, n: int) -> FloatArray:
    """(n, n) transposed transition of the filter's error over a part; N is carried to its start, in place."""
    from sinan.estimator.filter.smoother_numba import backward

    engine, trail = recorded(part, 1)
    row, after = part.events.row, np.zeros((len(trail.steps), CAPACITY))
    nothing = np.zeros(int(row[-1]))
    backward(trail, row, nothing, engine.world, r, after, N, True)
    columns = np.eye(CAPACITY)[:n]
    for column in columns:
        backward(trail, row, nothing, engine.world, column, after, N, False)
    return np.asarray(columns[:, :n].T)


def _smooth_part(part: RunInputs, r: FloatArray, information: FloatArray, sigmas: bool) -> FloatArray:
    """(samples, CAPACITY + 1) smoothed states of one part; r and information are carried to its start, in place."""
    from sinan.estimator.filter.smoother_numba import backward, forward

    engine, trail = recorded(part, 1)
    outputs, row = engine.outputs, part.events.row
    used = outputs.status == ACCEPTED
    scale = np.repeat(np.where(used, np.sqrt(outputs.weight), 0.0), np.diff(row))
    white = np.where(scale > 0.0, outputs.white, 0.0) * scale
    r_after, x_smooth = np.zeros((len(trail.steps), CAPACITY)), np.zeros((len(part.imu), CAPACITY + 1))
    backward(trail, row, white, engine.world, r, r_after, information, sigmas)
    d = np.zeros(CAPACITY)
    n = len(part.P)
    d[:n] = part.P @ r[:n]
    forward(trail, row, white, engine.world, d, r_after, outputs.x_imu, x_smooth)
    return x_smooth


def estimated_motion(
    journal: Journal,
    t: FloatArray | None = None,
    smoothed: SmoothedStates | bool = True,
) -> Motion:
    """The motion as the filter, or all readings together, have it: the arrays along which effects are evaluated.

    f_b and w_ib_b are the IMU's readings less the biases, sample by sample, so that an effect on the IMU is taken of
    what the IMU saw; dw_b is the slope of w_ib_b over `RATE_WINDOW`.

    Parameters
    ----------
    journal : of `run_filter`, with a state at every IMU sample where it is not smoothed
    t : (m,) s; default: the samples of the IMU table
    smoothed : states to use; True: smooth now; False: the filter's own
    """
    inputs = journal.run
    assert isinstance(inputs, RunInputs)
    model, table = inputs.model, inputs.imu
    x = (smooth(journal) if smoothed is True else smoothed).x if smoothed else journal.imu_x
    if len(x) != len(table):
        raise ValueError(f"`journal` has {len(x)} states for {len(table)} IMU samples; run the filter with stride=1")
    p_n, v_n, q_nb = (np.ascontiguousarray(x[:, part]) for part in (P_N, V_N, Q_NB))
    m_n = field_along(model, x)
    motion = Motion(
        t=table.t, p_n=p_n, v_n=v_n, q_nb=q_nb, m_b=rotate_back(q_nb, m_n), m_n=m_n, g_n=model.g_n,
        ground_down=model.ground_down,
    )  # fmt: skip
    motion = with_imu(motion, imu_less_errors(model, table.u, x))
    return motion if t is None else motion.at(t)


def imu_less_errors(model: FlightModel, u: FloatArray, x: FloatArray) -> FloatArray:
    """(n, 6) samples of the IMU less what the states (n, ...) say that they err by."""
    left, axes = u - x[:, B_IMU], model.gyro.axes
    if axes is not None:
        S = x[:, model.layout.nominal(axes.block)].reshape(-1, 3, 3)
        left[:, 3:] -= np.einsum("nij,nj->ni", S, left[:, 3:])
    return left


def with_imu(motion: Motion, u: FloatArray) -> Motion:
    """The motion with a force and a rate u (n, 6), and the slope of that rate."""
    f_b, w_ib_b = np.ascontiguousarray(u[:, :3]), np.ascontiguousarray(u[:, 3:])
    return replace(motion, f_b=f_b, w_ib_b=w_ib_b, dw_b=_slope(motion.t, w_ib_b))


#: Length of the window over which the rate's slope is taken [s], five samples at 200 Hz: a choice, half and twice of
#: which change nothing of a late GPS (`bounds_of_work brief`).
RATE_WINDOW = 0.025


def _slope(t: FloatArray, w: FloatArray) -> FloatArray:
    """(n, 3) least-squares slope of w over a sliding window, one-sided at the ends."""
    half = max(1, round(0.5 * RATE_WINDOW / float(np.median(np.diff(t)))))
    index = np.clip(np.arange(len(t))[:, None] + np.arange(-half, half + 1), 0, len(t) - 1)
    s = t[index] - t[index].mean(axis=1, keepdims=True)
    moment = sum(s[:, k, None] * w[rows] for k, rows in enumerate(index.T))
    return np.asarray(moment / np.sum(s * s, axis=1)[:, None])


def field_along(model: FlightModel, x: FloatArray) -> FloatArray:
    """(1, 3) or (n, 3) magnetic field in NED: as declared, or with its error as the states (n, ...) have it."""
    layout = model.layout
    return model.m_n[None, :] + x[:, layout.nominal("field")] if layout.has("field") else model.m_n[None, :]
