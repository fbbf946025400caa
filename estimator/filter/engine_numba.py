"""The compiled engine: strapdown step, covariance prediction, vector update and sensitivity fused into one time loop.

What it computes is what `estimator.filter.strapdown`, `estimator.filter.error_dynamics` and the models in `sensors`
say; the tests hold it against them and against the filterpy engine. Arrays and floats only; it returns a status,
`filter` raises.

Layout: P is flat, `CAPACITY` to a row, so that offsets are constants and loops fill vector registers; states that do
not exist keep P = 0, and of the rows only those are visited in which states are, eight at a time. The sensitivities V
come in tiles of `CAPACITY` rows x 16 columns. Those of effects on accelerometer
and gyroscope move at every step; between two readings the others obey V <- Phi V, so that the product of the Phi waits
for the next reading that corrects, or for the end of the chunk.

P stays symmetric to the last bit: the update subtracts sum_k u_k u_k' with u = L^-1 H P, S = L L', whose element (i, j)
is the same sum as (j, i), and the prediction mirrors one triangle.
"""

# mypy: disable-error-code="no-untyped-def"
# The kernels' types are those of the arrays that `estimator.filter.compiled` hands them.

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from sinan.estimator.filter.kernel_cache import options
from sinan.estimator.filter.tails import NOTHING
from sinan.sensors.arrays import FloatArray, IntArray

CAP = 56  # = layout.CAPACITY
TILE = 16  # columns of V that are carried together: fewer, and the compiler unrolls loops instead of filling registers
SIXTEEN = np.uint64(16)  # unsigned offsets need no test for negative indices, which would keep a loop from vectors
P_Z, T_X, T_Y, T_Z = np.uint64(32), np.uint64(96), np.uint64(112), np.uint64(128)  # rows 2, 6, 7, 8 of a tile
MAX_H = 16  # non-zero columns of a row of H: position, velocity, attitude, bias, colour, field, axes of the compass
GPS, BASE, MAG, BARO, RANGE, LEVEL, SPEED = 0, 1, 2, 3, 4, 5, 6
ACCEPTED, GATED, OUTSIDE, NO_PREDICTION, FAULTY, WITHHELD = 0, 1, 2, 3, 4, 5
OK, NOT_FINITE, NOT_POSITIVE = 0, 1, 2

_OPTIONS = options()


# What the kernels take. The records stand in the kernels' own file: numba compiles anew when that changes.


class Imu(NamedTuple):
    """(N,) s, (N, 6) force and rate, (N - 1,) the variance rates of the intervals: see `imu.ImuTable`."""

    t: FloatArray
    u: FloatArray
    q_accel: FloatArray
    q_gyro: FloatArray


class Readings(NamedTuple):
    """The readings in order, K of them, and the rows of their components: see `events.Events`."""

    t: FloatArray
    sensor: IntArray
    row: IntArray
    freedom: IntArray
    z: FloatArray
    r: FloatArray
    D: FloatArray
    ref: FloatArray


class Sensors(NamedTuple):
    """One element a sensor: its equations, components, first states of bias and colour (-1: none), whether effects are
    in its readings (`Events.has_form`), its first row in `beams`, and the tail of its law. `gate` and `robust`, beyond
    which a reading is doubtful, have one a number of components that tell something (`Events.freedom`); `lead` is of
    a GPS.
    """

    kind: IntArray
    size: IntArray
    bias: IntArray
    colour: IntArray
    form: IntArray
    beam_start: IntArray
    beams: FloatArray
    gate: FloatArray
    robust: FloatArray
    tail: FloatArray
    stray: FloatArray
    lead: float


class World(NamedTuple):
    """Environment and process: `field`, `axes` and `turned` are the first states of the field's error, of the
    gyroscope's scale and axes, and of the compass's axes (-1: none), `states` a multiple of 8.
    """

    g: FloatArray
    m_n: FloatArray
    w_ie: FloatArray
    ground_down: float
    translation: bool
    averaged: bool
    field: int
    axes: int
    turned: int
    states: int
    walk2: FloatArray
    rate: FloatArray


class State(NamedTuple):
    """(1,) s, (CAP + 1,), (1, CAP^2) and (tiles, TILE CAP): time, nominal state, covariance, sensitivities."""

    clock: FloatArray
    x: FloatArray
    P: FloatArray
    V: FloatArray


class Effects(NamedTuple):
    """Candidate effects as columns of V: see `compiled.Columns`."""

    tiles: int
    a_tiles: int
    g_first: int
    g_tiles: int
    Ga: FloatArray
    Gg: FloatArray
    Gz: FloatArray
    at: IntArray
    first: IntArray
    width: IntArray


class Written(NamedTuple):
    """What is written of every reading and of every `stride`-th IMU sample: see `inputs.RunOutputs`."""

    S_row: IntArray
    status: IntArray
    nu: FloatArray
    white: FloatArray
    S: FloatArray
    nis: FloatArray
    loglik: FloatArray
    weight: FloatArray
    x_event: FloatArray
    var_event: FloatArray
    stride: int
    x_imu: FloatArray
    var_imu: FloatArray


class Trail(NamedTuple):
    """What going backwards needs: steps (s, 61), steps before each reading and sample, L^-1 H P, L^-1 H, the turns; and
    after each step (s, coloured, CAP + 1) the states that have a time constant and their rows of P.
    """

    kept: bool
    steps: FloatArray
    step_of_event: IntArray
    step_of_imu: IntArray
    U: FloatArray
    H: FloatArray
    turn: FloatArray
    coloured: IntArray
    after: FloatArray


class Whitened(NamedTuple):
    """L^-1 S_beta, L^-1 nu and the reading of every row that was used; of one row: not asked for."""

    W: FloatArray
    white: FloatArray
    event: IntArray


_NO_ROWS, _NOWHERE = np.zeros((1, 1)), np.zeros(1, dtype=np.int64)
NO_TRAIL = Trail(
    False, _NO_ROWS, _NOWHERE, _NOWHERE, _NO_ROWS, _NO_ROWS, _NO_ROWS, _NOWHERE[:0], np.zeros((1, 1, CAP + 1))
)
NO_WHITENED = Whitened(_NO_ROWS, np.zeros(1), _NOWHERE)


class Rows(NamedTuple):
    """The rows of H of one reading: places and values of their non-zero elements, and how many there are."""

    column: IntArray
    value: FloatArray
    n: IntArray


class Sorted(NamedTuple):
    """The same rows as `_correct_V` takes them, see `_sort_row`, and three rows of W for one tile."""

    near: FloatArray
    other: FloatArray
    place: IntArray
    group: FloatArray


_INLINE: dict[str, Any] = {**_OPTIONS, "forceinline": True}  # arrays as arguments cost more than many a body here


@njit(**_INLINE)
def _half_angle(square):
    """cos(a/2) and sin(a/2)/a of a^2; the series is exact to rounding below 0.25 rad."""
    if square < 0.0625:
        s = 0.25 * square
        c = 1.0 + s * (-1 / 2 + s * (1 / 24 + s * (-1 / 720 + s * (1 / 40320 - s / 3628800))))
        return c, 0.5 * (1.0 + s * (-1 / 6 + s * (1 / 120 + s * (-1 / 5040 + s * (1 / 362880 - s / 39916800)))))
    a = np.sqrt(square)
    return np.cos(0.5 * a), np.sin(0.5 * a) / a


@njit(**_INLINE)
def _turn(x, dx, dy, dz):
    """q <- q * exp(d), normalised."""
    w, s = _half_angle(dx * dx + dy * dy + dz * dz)
    ex, ey, ez = s * dx, s * dy, s * dz
    qw, qx, qy, qz = x[6], x[7], x[8], x[9]
    nw = qw * w - qx * ex - qy * ey - qz * ez
    nx = qw * ex + qx * w + qy * ez - qz * ey
    ny = qw * ey - qx * ez + qy * w + qz * ex
    nz = qw * ez + qx * ey - qy * ex + qz * w
    scale = 1.0 / np.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
    x[6], x[7], x[8], x[9] = nw * scale, nx * scale, ny * scale, nz * scale


@njit(**_INLINE)
def _matrix(x, C):
    """C_nb of the nominal quaternion, flat (9,)."""
    w, a, b, c = x[6], x[7], x[8], x[9]
    C[0], C[1], C[2] = 1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)
    C[3], C[4], C[5] = 2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)
    C[6], C[7], C[8] = 2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)


@njit(**_INLINE)
def _right_jacobian(px, py, pz, J):
    """J_r(phi) = I - a [phi]x + b [phi]x^2, flat (9,). Sola eq. 183."""
    square = px * px + py * py + pz * pz
    if square < 0.0625:
        a = 0.5 + square * (-1 / 24 + square * (1 / 720 - square / 40320))
        b = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 - square / 362880))
    else:
        angle = np.sqrt(square)
        a = (1.0 - np.cos(angle)) / square
        b = (angle - np.sin(angle)) / (square * angle)
    J[0], J[1], J[2] = 1 - b * (py * py + pz * pz), a * pz + b * px * py, -a * py + b * px * pz
    J[3], J[4], J[5] = -a * pz + b * px * py, 1 - b * (px * px + pz * pz), a * px + b * py * pz
    J[6], J[7], J[8] = a * py + b * px * pz, -a * px + b * py * pz, 1 - b * (px * px + py * py)


@njit(**_INLINE)
def _inverse_right_jacobian(px, py, pz, J):
    """J_r^-1(phi) = I + [phi]x / 2 + b [phi]x^2, flat (9,). Sola eq. 184."""
    square = px * px + py * py + pz * pz
    if square < 0.0625:
        b = 1 / 12 + square * (1 / 720 + square * (1 / 30240 + square / 1209600))
    else:
        angle = np.sqrt(square)
        b = 1.0 / square - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    J[0], J[1], J[2] = 1 - b * (py * py + pz * pz), -0.5 * pz + b * px * py, 0.5 * py + b * px * pz
    J[3], J[4], J[5] = 0.5 * pz + b * px * py, 1 - b * (px * px + pz * pz), -0.5 * px + b * py * pz
    J[6], J[7], J[8] = -0.5 * py + b * px * pz, 0.5 * px + b * py * pz, 1 - b * (px * px + py * py)


@njit(**_INLINE)
def _cross_times(ax, ay, az, C, scale, out, at):
    """out[at:at+9] = scale [a]x C."""
    for j in range(3):
        out[at + j] = scale * (ay * C[6 + j] - az * C[3 + j])
        out[at + 3 + j] = scale * (az * C[j] - ax * C[6 + j])
        out[at + 6 + j] = scale * (ax * C[3 + j] - ay * C[j])


@njit(**_INLINE)
def _strapdown(x, u0, u1, h, world, C0, C1, J, c):
    """One step of the nominal state over h, and the coefficients of its error dynamics.

    phi = h (w_0 + w_1) / 2 + h^2 / 12 w_0 x w_1,  q_1 = q_0 exp(phi),  C_1 f_1 with q_1
    v_1 = v_0 + h / 2 (C_0 f_0 + C_1 f_1) + h g,  p_1 = p_0 + h / 2 (v_0 + v_1)
    c: R (0), h J_r (9), A_0 (18), A_1 (27), B_0 (36), B_1 (45), h / 2 (54); see `error_dynamics`.
    """
    g, w_ie = world.g, world.w_ie
    fx0, fy0, fz0 = u0[0] - x[10], u0[1] - x[11], u0[2] - x[12]
    fx1, fy1, fz1 = u1[0] - x[10], u1[1] - x[11], u1[2] - x[12]
    wx0, wy0, wz0 = u0[3] - x[13], u0[4] - x[14], u0[5] - x[15]
    wx1, wy1, wz1 = u1[3] - x[13], u1[4] - x[14], u1[5] - x[15]
    k = h * h / 12.0
    px = 0.5 * h * (wx0 + wx1) + k * (wy0 * wz1 - wz0 * wy1)
    py = 0.5 * h * (wy0 + wy1) + k * (wz0 * wx1 - wx0 * wz1)
    pz = 0.5 * h * (wz0 + wz1) + k * (wx0 * wy1 - wy0 * wx1)
    _matrix(x, C0)
    _turn(x, px, py, pz)
    if w_ie[0] != 0.0 or w_ie[2] != 0.0:
        _turn_earth(x, -h * w_ie[0], -h * w_ie[1], -h * w_ie[2])
    _matrix(x, C1)
    _right_jacobian(px, py, pz, J)
    for j in range(9):
        c[9 + j] = h * J[j]
    for i in range(3):
        for j in range(3):
            c[3 * i + j] = C1[i] * C0[j] + C1[3 + i] * C0[3 + j] + C1[6 + i] * C0[6 + j]
    half = 0.5 * h
    c[54] = half
    if world.translation:
        ax0, ay0, az0 = (
            C0[0] * fx0 + C0[1] * fy0 + C0[2] * fz0,
            C0[3] * fx0 + C0[4] * fy0 + C0[5] * fz0,
            C0[6] * fx0 + C0[7] * fy0 + C0[8] * fz0,
        )
        ax1, ay1, az1 = (
            C1[0] * fx1 + C1[1] * fy1 + C1[2] * fz1,
            C1[3] * fx1 + C1[4] * fy1 + C1[5] * fz1,
            C1[6] * fx1 + C1[7] * fy1 + C1[8] * fz1,
        )
        vx, vy, vz = x[3], x[4], x[5]
        x[3] = vx + half * (ax0 + ax1) + h * (g[0] - 2.0 * (w_ie[1] * vz - w_ie[2] * vy))
        x[4] = vy + half * (ay0 + ay1) + h * (g[1] - 2.0 * (w_ie[2] * vx - w_ie[0] * vz))
        x[5] = vz + half * (az0 + az1) + h * (g[2] - 2.0 * (w_ie[0] * vy - w_ie[1] * vx))
        x[0] += half * (vx + x[3])
        x[1] += half * (vy + x[4])
        x[2] += half * (vz + x[5])
        _cross_times(ax0, ay0, az0, C0, half, c, 18)
        _cross_times(ax1, ay1, az1, C1, half, c, 27)
        for j in range(9):
            c[36 + j] = half * C0[j]
            c[45 + j] = half * C1[j]


@njit(**_INLINE)
def _turn_earth(x, dx, dy, dz):
    """q <- exp(d) * q: the navigation frame turns under the body."""
    w, s = _half_angle(dx * dx + dy * dy + dz * dz)
    ex, ey, ez = s * dx, s * dy, s * dz
    qw, qx, qy, qz = x[6], x[7], x[8], x[9]
    x[6] = w * qw - ex * qx - ey * qy - ez * qz
    x[7] = w * qx + ex * qw + ey * qz - ez * qy
    x[8] = w * qy - ex * qz + ey * qw + ez * qx
    x[9] = w * qz + ex * qy - ey * qx + ez * qw


def _propagation(stride):
    """The compiled M <- Phi M for M = M[at], flat with `stride` columns: its offsets are constants."""

    @njit(**_INLINE)
    def propagate(M, at, c):
        """M <- Phi M for the nine rows of position, velocity and attitude.

        n = R t - h J b_g,  v' = v - A_0 t - A_1 n - (B_0 + B_1) b_a,  p' = p + h / 2 (v + v')
        """
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]
        j0, j1, j2, j3, j4, j5, j6, j7, j8 = c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17]
        a0, a1, a2, a3, a4, a5, a6, a7, a8 = c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25], c[26]
        d0, d1, d2, d3, d4, d5, d6, d7, d8 = c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34], c[35]
        b0, b1, b2 = c[36] + c[45], c[37] + c[46], c[38] + c[47]
        b3, b4, b5 = c[39] + c[48], c[40] + c[49], c[41] + c[50]
        b6, b7, b8 = c[42] + c[51], c[43] + c[52], c[44] + c[53]
        half = c[54]
        for j in range(stride):
            t0, t1, t2 = M[at, 6 * stride + j], M[at, 7 * stride + j], M[at, 8 * stride + j]
            e0, e1, e2 = M[at, 9 * stride + j], M[at, 10 * stride + j], M[at, 11 * stride + j]
            g0, g1, g2 = M[at, 12 * stride + j], M[at, 13 * stride + j], M[at, 14 * stride + j]
            n0 = r0 * t0 + r1 * t1 + r2 * t2 - j0 * g0 - j1 * g1 - j2 * g2
            n1 = r3 * t0 + r4 * t1 + r5 * t2 - j3 * g0 - j4 * g1 - j5 * g2
            n2 = r6 * t0 + r7 * t1 + r8 * t2 - j6 * g0 - j7 * g1 - j8 * g2
            v0, v1, v2 = M[at, 3 * stride + j], M[at, 4 * stride + j], M[at, 5 * stride + j]
            w0 = v0 - a0 * t0 - a1 * t1 - a2 * t2 - d0 * n0 - d1 * n1 - d2 * n2 - b0 * e0 - b1 * e1 - b2 * e2
            w1 = v1 - a3 * t0 - a4 * t1 - a5 * t2 - d3 * n0 - d4 * n1 - d5 * n2 - b3 * e0 - b4 * e1 - b5 * e2
            w2 = v2 - a6 * t0 - a7 * t1 - a8 * t2 - d6 * n0 - d7 * n1 - d8 * n2 - b6 * e0 - b7 * e1 - b8 * e2
            M[at, 0 * stride + j] += half * (v0 + w0)
            M[at, 1 * stride + j] += half * (v1 + w1)
            M[at, 2 * stride + j] += half * (v2 + w2)
            M[at, 3 * stride + j], M[at, 4 * stride + j], M[at, 5 * stride + j] = w0, w1, w2
            M[at, 6 * stride + j], M[at, 7 * stride + j], M[at, 8 * stride + j] = n0, n1, n2

    return propagate


_propagate_P, _propagate_top, _propagate_tile = _propagation(CAP), _propagation(12), _propagation(TILE)


@njit(**_INLINE)
def _decay_over(h, states, world, phi, q):
    """phi = exp(-h rate) and the variance q that the process adds to each bias over h; a walk has rate 0."""
    rate, walk2 = world.rate, world.walk2
    for j in range(15, states):
        if rate[j] == 0.0:
            phi[j], q[j] = 1.0, walk2[j] * h
        elif rate[j] == rate[j - 1]:
            phi[j] = phi[j - 1]
            q[j] = 0.5 * walk2[j] / rate[j] * (1.0 - phi[j] * phi[j])
        else:
            phi[j] = np.exp(-h * rate[j])
            q[j] = 0.5 * walk2[j] / rate[j] * (1.0 - phi[j] * phi[j])


@njit(**_INLINE)
def _predict(P, c, top, h, q_accel, q_gyro, world, phi, q):
    """P <- Phi P Phi' + Q, both triangles equal."""
    walk2, states = world.walk2, world.states
    _propagate_P(P, 0, c)
    for i in range(9):
        for j in range(15):
            top[0, 12 * j + i] = P[0, CAP * i + j]
    _propagate_top(top, 0, c)
    for i in range(9):
        for j in range(i, 9):
            value = top[0, 12 * i + j]
            P[0, CAP * i + j] = value
            P[0, CAP * j + i] = value
    for i in range(15, states):
        if phi[i] != 1.0:
            for j in range(9):
                P[0, CAP * j + i] *= phi[i]
            for j in range(9, states):
                P[0, CAP * i + j] *= phi[i]
            for j in range(9, states):
                P[0, CAP * j + i] *= phi[i]
    for i in range(9, states):
        for j in range(9):
            P[0, CAP * i + j] = P[0, CAP * j + i]
    for i in range(3):
        v = q_accel * h
        P[0, (CAP + 1) * i] += v * h * h / 3.0
        P[0, CAP * i + i + 3] += 0.5 * v * h
        P[0, CAP * (i + 3) + i] += 0.5 * v * h
        P[0, (CAP + 1) * (i + 3)] += v
        P[0, (CAP + 1) * (i + 6)] += q_gyro * h
    for i in range(9, 15):
        P[0, (CAP + 1) * i] += walk2[i] * h
    for i in range(15, states):
        P[0, (CAP + 1) * i] += q[i]


@njit(**_INLINE)
def _with_axes(P, at, w, sign):
    """P <- T P T' with T = 1 + sign W: the gyroscope's bias and what scale and axes make of its rate become one.

    b <- b + sign W s, with W s = S w: element 3 i + j of s, from state `at` on, is that of row i and column j of S.
    T^-1 has the other sign.
    """
    for i in range(3):
        for k in range(CAP):
            more = w[0] * P[0, CAP * (at + 3 * i) + k] + w[1] * P[0, CAP * (at + 3 * i + 1) + k]
            P[0, CAP * (12 + i) + k] += sign * (more + w[2] * P[0, CAP * (at + 3 * i + 2) + k])
    for i in range(3):
        row = CAP * (12 + i)
        for j in range(i, 3):
            n = row + at + 3 * j
            more = w[0] * P[0, n] + w[1] * P[0, n + 1] + w[2] * P[0, n + 2]
            value = P[0, row + 12 + j] + sign * more
            P[0, row + 12 + j], P[0, CAP * (12 + j) + 12 + i] = value, value
        for k in range(CAP):
            if k < 12 or k > 14:
                P[0, CAP * k + 12 + i] = P[0, row + k]


@njit(**_INLINE)
def _with_axes_V(V, first, last, at, w, sign):
    """V <- T V for the tiles from `first` to `last`: see `_with_axes`."""
    for tile in range(first, last):
        for i in range(3):
            n = TILE * (at + 3 * i)
            for j in range(TILE):
                more = w[0] * V[tile, n + j] + w[1] * V[tile, n + TILE + j] + w[2] * V[tile, n + 2 * TILE + j]
                V[tile, TILE * (12 + i) + j] += sign * more


@njit(**_INLINE)
def _decay_V(V, first, last, states, phi):
    """The rows of V of biases that decay, for the tiles from `first` to `last`."""
    for i in range(15, states):
        if phi[i] != 1.0:
            for tile in range(first, last):
                for j in range(TILE):
                    V[tile, TILE * i + j] *= phi[i]


@njit(**_INLINE)
def _predict_V(V, c, tiles, effects, at, u00, u01, u10, u11, work):
    """V <- Phi V - B G, tile by tile; at the step's ends the regressor is u00 G_k + u01 G_k+1, u10 G_k + u11 G_k+1."""
    Ga, Gg, a_tiles, g_first, g_tiles = effects.Ga, effects.Gg, effects.a_tiles, effects.g_first, effects.g_tiles
    for j in range(9):  # what the accelerometer's effects add to the velocity
        work[j] = u00 * c[36 + j] + u10 * c[45 + j]
        work[9 + j] = u01 * c[36 + j] + u11 * c[45 + j]
    x0, x1, x2, x3, x4, x5, x6, x7, x8 = work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], work[8]
    y0, y1, y2, y3, y4, y5 = work[9], work[10], work[11], work[12], work[13], work[14]
    y6, y7, y8, half = work[15], work[16], work[17], c[54]
    s0, s1 = 0.5 * (u00 + u10), 0.5 * (u01 + u11)
    for tile in range(tiles):
        gyro = g_first <= tile < g_first + g_tiles
        k0 = at * g_tiles + tile - g_first
        k1 = k0 + g_tiles
        if gyro:  # an effect on the gyroscope acts for the step like a bias
            for j in range(48):
                work[j] = V[tile, 192 + j]
                V[tile, 192 + j] += s0 * Gg[k0, j] + s1 * Gg[k1, j]
        _propagate_tile(V, tile, c)
        if gyro:
            for j in range(48):
                V[tile, 192 + j] = work[j]
        if tile < a_tiles:
            k0 = at * a_tiles + tile
            k1 = k0 + a_tiles
            for j in range(16):
                a0, a1, a2, b0, b1, b2 = (
                    Ga[k0, j],
                    Ga[k0, 16 + j],
                    Ga[k0, 32 + j],
                    Ga[k1, j],
                    Ga[k1, 16 + j],
                    Ga[k1, 32 + j],
                )
                d0 = x0 * a0 + x1 * a1 + x2 * a2 + y0 * b0 + y1 * b1 + y2 * b2
                d1 = x3 * a0 + x4 * a1 + x5 * a2 + y3 * b0 + y4 * b1 + y5 * b2
                d2 = x6 * a0 + x7 * a1 + x8 * a2 + y6 * b0 + y7 * b1 + y8 * b2
                V[tile, 48 + j] -= d0
                V[tile, 64 + j] -= d1
                V[tile, 80 + j] -= d2
                V[tile, j] -= half * d0
                V[tile, 16 + j] -= half * d1
                V[tile, 32 + j] -= half * d2


@njit(**_INLINE)
def _start_product(M):
    """M <- the columns of the identity, attitude and biases: the biases' own rows are so already."""
    for j in range(108):
        M[0, j] = 0.0
    M[0, 72], M[0, 85], M[0, 98] = 1.0, 1.0, 1.0


def _combination(first):
    """The compiled V <- V + M [t, b_a, b_g] for three rows from `first` on, position or velocity."""

    @njit(**_INLINE)
    def combine(V, tile, M):
        n = 12 * first
        a0, a1, a2, a3, a4, a5 = M[0, n], M[0, n + 1], M[0, n + 2], M[0, n + 3], M[0, n + 4], M[0, n + 5]
        a6, a7, a8 = M[0, n + 6], M[0, n + 7], M[0, n + 8]
        n = 12 * first + 12
        b0, b1, b2, b3, b4, b5 = M[0, n], M[0, n + 1], M[0, n + 2], M[0, n + 3], M[0, n + 4], M[0, n + 5]
        b6, b7, b8 = M[0, n + 6], M[0, n + 7], M[0, n + 8]
        n = 12 * first + 24
        c0, c1, c2, c3, c4, c5 = M[0, n], M[0, n + 1], M[0, n + 2], M[0, n + 3], M[0, n + 4], M[0, n + 5]
        c6, c7, c8 = M[0, n + 6], M[0, n + 7], M[0, n + 8]
        n = TILE * first
        for j in range(TILE):
            t0, t1, t2 = V[tile, 96 + j], V[tile, 112 + j], V[tile, 128 + j]
            e0, e1, e2 = V[tile, 144 + j], V[tile, 160 + j], V[tile, 176 + j]
            g0, g1, g2 = V[tile, 192 + j], V[tile, 208 + j], V[tile, 224 + j]
            s0 = a0 * t0 + a1 * t1 + a2 * t2 + a3 * e0 + a4 * e1 + a5 * e2 + a6 * g0 + a7 * g1 + a8 * g2
            s1 = b0 * t0 + b1 * t1 + b2 * t2 + b3 * e0 + b4 * e1 + b5 * e2 + b6 * g0 + b7 * g1 + b8 * g2
            s2 = c0 * t0 + c1 * t1 + c2 * t2 + c3 * e0 + c4 * e1 + c5 * e2 + c6 * g0 + c7 * g1 + c8 * g2
            V[tile, n + j] += s0
            V[tile, n + 16 + j] += s1
            V[tile, n + 32 + j] += s2

    return combine


_add_to_position, _add_to_velocity = _combination(0), _combination(3)


@njit(**_INLINE)
def _apply_product(V, first, tiles, M, T):
    """V <- Phi_k ... Phi_1 V for the tiles from `first` on, whose effects add nothing between two readings.

    M (15 rows of 12) is that product's columns of attitude and biases, T the time that it spans:

        p' = p + T v + M_p [t, b_a, b_g],  v' = v + M_v [t, b_a, b_g],  t' = M_tt t + M_tg b_g
    """
    r0, r1, r2, j0, j1, j2 = M[0, 72], M[0, 73], M[0, 74], M[0, 78], M[0, 79], M[0, 80]
    r3, r4, r5, j3, j4, j5 = M[0, 84], M[0, 85], M[0, 86], M[0, 90], M[0, 91], M[0, 92]
    r6, r7, r8, j6, j7, j8 = M[0, 96], M[0, 97], M[0, 98], M[0, 102], M[0, 103], M[0, 104]
    for tile in range(first, tiles):
        for j in range(48):
            V[tile, j] += T * V[tile, 48 + j]
        _add_to_position(V, tile, M)
        _add_to_velocity(V, tile, M)
        for j in range(TILE):
            t0, t1, t2 = V[tile, 96 + j], V[tile, 112 + j], V[tile, 128 + j]
            g0, g1, g2 = V[tile, 192 + j], V[tile, 208 + j], V[tile, 224 + j]
            V[tile, 96 + j] = r0 * t0 + r1 * t1 + r2 * t2 + j0 * g0 + j1 * g1 + j2 * g2
            V[tile, 112 + j] = r3 * t0 + r4 * t1 + r5 * t2 + j3 * g0 + j4 * g1 + j5 * g2
            V[tile, 128 + j] = r6 * t0 + r7 * t1 + r8 * t2 + j6 * g0 + j7 * g1 + j8 * g2


@njit(**_INLINE)
def _put(H, row, index, value):
    n = H.n[row]
    H.column[row, n] = index
    H.value[row, n] = value
    H.n[row] = n + 1


@njit(**_INLINE)
def _turn_compass(at, x, H, z_pred):
    """The field in the body, in `z_pred`, as a compass sees it whose axes are turned by t: m + m x t."""
    a, b, c = z_pred[0], z_pred[1], z_pred[2]
    _put(H, 0, at + 1, -c)
    _put(H, 0, at + 2, b)
    _put(H, 1, at, c)
    _put(H, 1, at + 2, -a)
    _put(H, 2, at, -b)
    _put(H, 2, at + 1, a)
    z_pred[0] += b * x[at + 3] - c * x[at + 2]
    z_pred[1] += c * x[at + 1] - a * x[at + 3]
    z_pred[2] += a * x[at + 2] - b * x[at + 1]


@njit(**_INLINE)
def _measure(s, m, sensors, world, x, C, H, z_pred):
    """Prediction of one reading and the non-zero elements of its H; False where there is no prediction."""
    kind, bias, colour, field = sensors.kind[s], sensors.bias[s], sensors.colour[s], world.field
    for i in range(m):
        H.n[i] = 0
    if kind == GPS:
        for i in range(m):
            z_pred[i] = x[i]
            _put(H, i, i, 1.0)
        if sensors.lead != 0.0:
            for i in range(3):
                z_pred[i] += sensors.lead * x[3 + i]
                _put(H, i, 3 + i, sensors.lead)
    elif kind == SPEED:
        for i in range(m):
            z_pred[i] = x[3 + i]
            _put(H, i, 3 + i, 1.0)
    elif kind == BASE:
        for i in range(m):
            z_pred[i] = 0.0
    elif kind == BARO:
        z_pred[0] = -x[2]
        _put(H, 0, 2, -1.0)
    elif kind == RANGE:
        for i in range(m):
            at = sensors.beam_start[s] + i
            b0, b1, b2 = sensors.beams[at, 0], sensors.beams[at, 1], sensors.beams[at, 2]
            down = C[6] * b0 + C[7] * b1 + C[8] * b2
            if not down > 0.0:
                return False
            r = (world.ground_down - x[2]) / down
            z_pred[i] = r
            _put(H, i, 2, -1.0 / down)
            _put(H, i, 6, r / down * (C[7] * b2 - C[8] * b1))
            _put(H, i, 7, r / down * (C[8] * b0 - C[6] * b2))
            _put(H, i, 8, r / down * (C[6] * b1 - C[7] * b0))
    else:
        sign, a, b, c = 1.0, world.m_n[0], world.m_n[1], world.m_n[2]
        if kind == LEVEL:
            sign, a, b, c = -1.0, world.g[0], world.g[1], world.g[2]
        elif field >= 0:
            a, b, c = a + x[field + 1], b + x[field + 2], c + x[field + 3]
        for i in range(3):
            z_pred[i] = sign * (C[i] * a + C[3 + i] * b + C[6 + i] * c)
        _put(H, 0, 7, -z_pred[2])
        _put(H, 0, 8, z_pred[1])
        _put(H, 1, 6, z_pred[2])
        _put(H, 1, 8, -z_pred[0])
        _put(H, 2, 6, -z_pred[1])
        _put(H, 2, 7, z_pred[0])
        if kind == MAG and field >= 0:
            for i in range(3):
                for j in range(3):
                    _put(H, i, field + j, C[3 * j + i])
        if kind == MAG and world.turned >= 0:
            _turn_compass(world.turned, x, H, z_pred)
    if bias >= 0:
        single = kind in (BARO, RANGE)
        for i in range(m if single else 3):
            at = bias if single else bias + i
            z_pred[i] += x[at + 1]
            _put(H, i, at, 1.0)
    if colour >= 0:
        for i in range(m):
            at = colour if kind == RANGE else colour + i
            z_pred[i] += x[at + 1]
            _put(H, i, at, 1.0)
    return True


@njit(**_INLINE)
def _add_form(m, readings, event, replaces, x, H, z_pred, J):
    """z_pred += D (x (-) x_ref), H += D J_r^-1 on position, velocity and attitude: an effect along a known motion.

    Where it replaces the model's own prediction, only the bias stays of that: linear about the reference.
    """
    D, ref, row = readings.D, readings.ref, readings.row[event]
    d = np.empty(9)
    for i in range(6):
        d[i] = x[i] - ref[event, i]
    w, a, b, c = ref[event, 6], -ref[event, 7], -ref[event, 8], -ref[event, 9]
    nw = w * x[6] - a * x[7] - b * x[8] - c * x[9]
    nx = w * x[7] + a * x[6] + b * x[9] - c * x[8]
    ny = w * x[8] - a * x[9] + b * x[6] + c * x[7]
    nz = w * x[9] + a * x[8] - b * x[7] + c * x[6]
    if nw < 0.0:
        nw, nx, ny, nz = -nw, -nx, -ny, -nz
    s = np.sqrt(nx * nx + ny * ny + nz * nz)
    scale = 2.0 * np.arctan2(s, nw) / s if s > 1e-8 else 2.0
    d[6], d[7], d[8] = scale * nx, scale * ny, scale * nz
    _inverse_right_jacobian(d[6], d[7], d[8], J)
    dense, kept_index, kept_value = np.empty(9), np.empty(MAX_H, np.int64), np.empty(MAX_H)
    for i in range(m):
        if replaces:
            z_pred[i] = 0.0
            for k in range(H.n[i]):
                if H.column[i, k] >= 9:
                    z_pred[i] += H.value[i, k] * x[H.column[i, k] + 1]
        for j in range(9):
            z_pred[i] += D[row + i, j] * d[j]
        for j in range(6):
            dense[j] = D[row + i, j]
        for j in range(3):
            dense[6 + j] = D[row + i, 6] * J[j] + D[row + i, 7] * J[3 + j] + D[row + i, 8] * J[6 + j]
        kept = 0
        for k in range(H.n[i]):
            if H.column[i, k] < 9:
                dense[H.column[i, k]] += 0.0 if replaces else H.value[i, k]
            else:
                kept_index[kept], kept_value[kept] = H.column[i, k], H.value[i, k]
                kept += 1
        H.n[i] = 0
        for j in range(9):
            _put(H, i, j, dense[j])
        for k in range(kept):
            _put(H, i, kept_index[k], kept_value[k])


@njit(**_INLINE)
def _set_row(M, i, N, k, a):
    """M[i] <- a N[k]."""
    for j in range(CAP):
        M[i, j] = a * N[k, j]


@njit(**_INLINE)
def _add_row(M, i, N, k, a):
    """M[i] <- M[i] + a N[k]."""
    for j in range(CAP):
        M[i, j] += a * N[k, j]


def _subtraction(stride):
    """The compiled M <- M - U' W: three rows of U and W, eight rows of M = M[at] at a time."""

    @njit(**_INLINE)
    def subtract(M, at, U, k, W, first, states):
        for i in range(0, states, 8):
            a0, b0, c0 = U[k, i + 0], U[k + 1, i + 0], U[k + 2, i + 0]
            a1, b1, c1 = U[k, i + 1], U[k + 1, i + 1], U[k + 2, i + 1]
            a2, b2, c2 = U[k, i + 2], U[k + 1, i + 2], U[k + 2, i + 2]
            a3, b3, c3 = U[k, i + 3], U[k + 1, i + 3], U[k + 2, i + 3]
            a4, b4, c4 = U[k, i + 4], U[k + 1, i + 4], U[k + 2, i + 4]
            a5, b5, c5 = U[k, i + 5], U[k + 1, i + 5], U[k + 2, i + 5]
            a6, b6, c6 = U[k, i + 6], U[k + 1, i + 6], U[k + 2, i + 6]
            a7, b7, c7 = U[k, i + 7], U[k + 1, i + 7], U[k + 2, i + 7]
            n = stride * i
            for j in range(stride):
                u, v, w = W[first, j], W[first + 1, j], W[first + 2, j]
                M[at, n + j] = M[at, n + j] - a0 * u - b0 * v - c0 * w
                M[at, n + stride + j] = M[at, n + stride + j] - a1 * u - b1 * v - c1 * w
                M[at, n + 2 * stride + j] = M[at, n + 2 * stride + j] - a2 * u - b2 * v - c2 * w
                M[at, n + 3 * stride + j] = M[at, n + 3 * stride + j] - a3 * u - b3 * v - c3 * w
                M[at, n + 4 * stride + j] = M[at, n + 4 * stride + j] - a4 * u - b4 * v - c4 * w
                M[at, n + 5 * stride + j] = M[at, n + 5 * stride + j] - a5 * u - b5 * v - c5 * w
                M[at, n + 6 * stride + j] = M[at, n + 6 * stride + j] - a6 * u - b6 * v - c6 * w
                M[at, n + 7 * stride + j] = M[at, n + 7 * stride + j] - a7 * u - b7 * v - c7 * w

    return subtract


_subtract_P, _subtract_tile = _subtraction(CAP), _subtraction(TILE)


@njit(**_INLINE)
def _subtract_one(V, tile, U, k, w, states):
    """V[tile] <- V[tile] - u w', one row u = U[k], eight rows of the tile at a time."""
    for i in range(0, states, 8):
        a0, a1, a2, a3 = U[k, i + 0], U[k, i + 1], U[k, i + 2], U[k, i + 3]
        a4, a5, a6, a7 = U[k, i + 4], U[k, i + 5], U[k, i + 6], U[k, i + 7]
        n = TILE * i
        for j in range(TILE):
            u = w[0, j]
            V[tile, n + 0 + j] -= a0 * u
            V[tile, n + 16 + j] -= a1 * u
            V[tile, n + 32 + j] -= a2 * u
            V[tile, n + 48 + j] -= a3 * u
            V[tile, n + 64 + j] -= a4 * u
            V[tile, n + 80 + j] -= a5 * u
            V[tile, n + 96 + j] -= a6 * u
            V[tile, n + 112 + j] -= a7 * u


@njit(**_INLINE)
def _factor(m, P, H, r, row, B, S, L):
    """B = H P, S = H P H' + R, S = L L', R the variances r from `row` on; P as rows (CAP, CAP).

    False where S is not positive.
    """
    for i in range(m):
        _set_row(B, i, P, H.column[i, 0], H.value[i, 0])
        for k in range(1, H.n[i]):
            _add_row(B, i, P, H.column[i, k], H.value[i, k])
        for j in range(i + 1):
            s = 0.0
            for k in range(H.n[j]):
                s += H.value[j, k] * B[i, H.column[j, k]]
            if i == j:
                s += r[row + i]
            S[i, j] = s
            S[j, i] = s
    for i in range(m):
        for j in range(i + 1):
            s = S[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                L[i, i] = np.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    return True


@njit(**_INLINE)
def _reset(P, J):
    """P <- J P J' on the attitude block: the error is counted from the turned attitude on."""
    for j in range(CAP):
        t0, t1, t2 = P[0, 6 * CAP + j], P[0, 7 * CAP + j], P[0, 8 * CAP + j]
        P[0, 6 * CAP + j] = J[0] * t0 + J[1] * t1 + J[2] * t2
        P[0, 7 * CAP + j] = J[3] * t0 + J[4] * t1 + J[5] * t2
        P[0, 8 * CAP + j] = J[6] * t0 + J[7] * t1 + J[8] * t2
    for i in range(6, 9):
        t0, t1, t2 = P[0, CAP * i + 6], P[0, CAP * i + 7], P[0, CAP * i + 8]
        for j in range(3):
            P[0, CAP * i + 6 + j] = J[3 * j] * t0 + J[3 * j + 1] * t1 + J[3 * j + 2] * t2
    for j in range(CAP):
        if j < 6 or j > 8:
            at = CAP * j + 6
            P[0, at], P[0, at + 1], P[0, at + 2] = P[0, 6 * CAP + j], P[0, 7 * CAP + j], P[0, 8 * CAP + j]
    P[0, CAP * 7 + 6], P[0, CAP * 8 + 6], P[0, CAP * 8 + 7] = P[0, CAP * 6 + 7], P[0, CAP * 6 + 8], P[0, CAP * 7 + 8]


@njit(**_INLINE)
def _correct(m, U, y, x, P, J, dx, states):
    """x <- x (+) U' y, P <- P - U' U, and the reset of the attitude error."""
    for j in range(CAP):
        value = 0.0
        for k in range(m):
            value += U[k, j] * y[k]
        dx[j] = value
    for k in range(m, 3 * ((m + 2) // 3)):
        for j in range(CAP):
            U[k, j] = 0.0
    for k in range(0, m, 3):
        _subtract_P(P, 0, U, k, U, k, states)
    for j in range(6):
        x[j] += dx[j]
    for j in range(9, states):
        x[j + 1] += dx[j]
    _turn(x, dx[6], dx[7], dx[8])
    _right_jacobian(dx[6], dx[7], dx[8], J)
    _reset(P, J)


@njit(**_INLINE)
def _sort_row(i, H, near, h, r):
    """Elements of one row of H for `_correct_V`: columns 2, 6, 7, 8 in `near`, two others in h and r; counts others."""
    for q in range(4):
        near[4 * i + q] = 0.0
    h[2 * i], h[2 * i + 1], r[2 * i], r[2 * i + 1] = 0.0, 0.0, np.uint64(0), np.uint64(0)
    others = 0
    for q in range(H.n[i]):
        at = H.column[i, q]
        if at == 2:
            near[4 * i] = H.value[i, q]
        elif 6 <= at <= 8:
            near[4 * i + at - 5] = H.value[i, q]
        else:
            if others < 2:
                h[2 * i + others], r[2 * i + others] = H.value[i, q], np.uint64(16 * at)
            others += 1
    return others


@njit(**_INLINE)
def _put_HV(i, V, tile, near, h, r, W, row, at):
    """W[row] <- H_i V[tile] in the tile's columns, those from `at` on; H_i as `_sort_row` leaves it."""
    a, b, c, d = near[4 * i], near[4 * i + 1], near[4 * i + 2], near[4 * i + 3]
    e, f, p, q = h[2 * i], h[2 * i + 1], r[2 * i], r[2 * i + 1]
    for j in range(SIXTEEN):
        s = a * V[tile, P_Z + j] + b * V[tile, T_X + j] + c * V[tile, T_Y + j] + d * V[tile, T_Z + j]
        W[row, at + j] = s + e * V[tile, p + j] + f * V[tile, q + j]


@njit(**_INLINE)
def _add_others(i, V, tiles, H, W, row):
    """The elements of H_i beyond the two that `_put_HV` takes: an effect along a known motion fills the row."""
    others = 0
    for q in range(H.n[i]):
        c = H.column[i, q]
        if c == 2 or 6 <= c <= 8:
            continue
        others += 1
        if others > 2:
            for tile in range(tiles):
                for j in range(16):
                    W[row, 16 * tile + j] += H.value[i, q] * V[tile, 16 * c + j]


@njit(**_INLINE)
def _whiten(m, L, W, row, columns):
    """W <- L^-1 W for the m rows of W from `row` on; the rows before one come off three at a time."""
    for i in range(m):
        n, d = row + i, 1.0 / L[i, i]
        for k in range(0, i - 2, 3):
            a, b, c = L[i, k], L[i, k + 1], L[i, k + 2]
            for j in range(columns):
                W[n, j] -= a * W[row + k, j] + b * W[row + k + 1, j] + c * W[row + k + 2, j]
        if i % 3 == 0:
            for j in range(columns):
                W[n, j] *= d
        elif i % 3 == 1:
            a = L[i, i - 1]
            for j in range(columns):
                W[n, j] = (W[n, j] - a * W[n - 1, j]) * d
        else:
            a, b = L[i, i - 2], L[i, i - 1]
            for j in range(columns):
                W[n, j] = (W[n, j] - a * W[n - 2, j] - b * W[n - 1, j]) * d


@njit(**_INLINE)
def _correct_V(m, V, effects, s, event, H, L, U, J, W, row, ready, states):
    """S_beta = H V + G, W = L^-1 S_beta into the rows of `W` from `row` on, V <- V - U' W, then the reset.

    All components of S_beta are taken before V changes: a reading with less weight has L scaled, but not its H V. The
    rows of V that most readings need have constant places, which lets the loops fill vector registers.
    """
    tiles, G, g_at = effects.tiles, effects.Gz, effects.at[event]
    first, count = effects.first[s], effects.width[s]
    near, h, r, group = ready.near, ready.other, ready.place, ready.group
    for i in range(m):
        others = _sort_row(i, H, near, h, r)
        for tile in range(tiles):
            _put_HV(i, V, tile, near, h, r, W, row + i, np.uint64(16 * tile))
        if others > 2:
            _add_others(i, V, tiles, H, W, row + i)
        for j in range(count):
            W[row + i, first + j] += G[g_at + i * count + j]
    _whiten(m, L, W, row, 16 * tiles)
    for tile in range(tiles):
        at = np.uint64(16 * tile)
        for k in range(0, m, 3):
            for i in range(min(3, m - k)):
                for j in range(SIXTEEN):
                    group[i, j] = W[row + k + i, at + j]
            if k + 1 == m:
                _subtract_one(V, tile, U, k, group, states)
            else:
                _subtract_tile(V, tile, U, k, group, 0, states)
        for j in range(16):
            t0, t1, t2 = V[tile, 96 + j], V[tile, 112 + j], V[tile, 128 + j]
            V[tile, 96 + j] = J[0] * t0 + J[1] * t1 + J[2] * t2
            V[tile, 112 + j] = J[3] * t0 + J[4] * t1 + J[5] * t2
            V[tile, 128 + j] = J[6] * t0 + J[7] * t1 + J[8] * t2


@njit(**_INLINE)
def _at_ends(imu, i, a0, a1, u0, u1):
    """Force and rate at the two ends of a step, shares a0 and a1 of interval i."""
    for j in range(6):
        u0[j] = (1.0 - a0) * imu.u[i, j] + a0 * imu.u[i + 1, j]
        u1[j] = (1.0 - a1) * imu.u[i, j] + a1 * imu.u[i + 1, j]


@njit(**_INLINE)
def _as_scaled(x, at, u0, u1, w):
    """u <- u - S (u - b) of the rates, S the gyroscope's scale and axes; `w` is the mean u - b of the step."""
    for j in range(3):
        w[j] = 0.5 * (u0[3 + j] + u1[3 + j]) - x[13 + j]
    if at >= 0:
        a, b, c = u0[3] - x[13], u0[4] - x[14], u0[5] - x[15]
        d, e, f = u1[3] - x[13], u1[4] - x[14], u1[5] - x[15]
        for i in range(3):
            n = at + 3 * i + 1
            u0[3 + i] -= x[n] * a + x[n + 1] * b + x[n + 2] * c
            u1[3 + i] -= x[n] * d + x[n + 1] * e + x[n + 2] * f


@njit(**_INLINE)
def _keep_step(trail, n, c, h, q_accel, q_gyro, w):
    for j in range(55):
        trail.steps[n, j] = c[j]
    for j in range(3):
        trail.steps[n, 58 + j] = w[j]
    trail.steps[n, 55], trail.steps[n, 56], trail.steps[n, 57] = h, q_accel, q_gyro


@njit(**_INLINE)
def _keep_coloured(trail, n, x, P):
    for c in range(len(trail.coloured)):
        i = trail.coloured[c]
        trail.after[n, c, 0] = x[i + 1]
        for j in range(CAP):
            trail.after[n, c, j + 1] = P[0, CAP * i + j]


@njit(**_INLINE)
def _write_state(x, P, row, x_out, var_out):
    for j in range(CAP + 1):
        x_out[row, j] = x[j]
    for j in range(CAP):
        var_out[row, j] = P[0, (CAP + 1) * j]


@njit(**_INLINE)
def _whiten_innovation(m, nu, at, L, y, white):
    """y = L^-1 nu, of the rows of nu from `at` on; (NIS, log det S)."""
    total, log_det = 0.0, 0.0
    for a in range(m):
        e = nu[at + a]
        for b in range(a):
            e -= L[a, b] * y[b]
        y[a] = e / L[a, a]
        total += y[a] * y[a]
        log_det += 2.0 * np.log(L[a, a])
        white[at + a] = y[a]
    return total, log_det


@njit(**_INLINE)
def _doubt(nis, m, tail, stray):
    """`tails.spread_of`, with `stray` over the reading's normal density."""
    spread, own = (tail + nis) / (tail + m), nis
    if nis > m:
        own = m + (tail + m) * np.log1p((nis - m) / (tail + m))
    return max(1.0, spread) * (1.0 + np.exp(min(stray + 0.5 * (own - nis), NOTHING)))


@njit(**_INLINE)
def _less_weight(m, spread, y, L):
    """S grows by `spread`: so y = L^-1 nu shrinks by its root."""
    factor = np.sqrt(spread)
    for a in range(m):
        y[a] /= factor
        for b in range(a + 1):
            L[a, b] *= factor


@njit(**_INLINE)
def _whiten_rows(m, U, L):
    """U <- L^-1 U."""
    for a in range(m):
        for b in range(a):
            _add_row(U, a, U, b, -L[a, b])
        _set_row(U, a, U, a, 1.0 / L[a, a])


@njit(**_INLINE)
def _keep_correction(trail, k, at, m, dx, U, H, L):
    """The turn of the attitude, L^-1 H P and L^-1 H of the k-th reading, whose rows begin with `at`."""
    for j in range(3):
        trail.turn[k, j] = dx[6 + j]
    for a in range(m):
        for j in range(CAP):
            trail.U[at + a, j] = U[a, j]
            trail.H[at + a, j] = 0.0
        for b in range(H.n[a]):
            trail.H[at + a, H.column[a, b]] = H.value[a, b]
        for b in range(a):
            for j in range(CAP):
                trail.H[at + a, j] -= L[a, b] * trail.H[at + b, j]
        for j in range(CAP):
            trail.H[at + a, j] /= L[a, a]


@njit(**_OPTIONS)
def run_chunk(i0, i1, k0, k1, imu, readings, sensors, world, state, effects, out, trail, whitened):
    """Run from IMU sample i0 to i1 through the events k0 to k1; returns (status, event, rows of W)."""
    clock, x, P, V, tiles, states = state.clock, state.x, state.P, state.V, effects.tiles, world.states
    m_max = np.max(sensors.size) if len(sensors.size) else 1
    C0, C1, J, c, top = np.zeros(9), np.zeros(9), np.zeros(9), np.zeros(55), np.zeros((1, 180))
    u0, u1, w, work, dx = np.zeros(6), np.zeros(6), np.zeros(3), np.zeros(48), np.zeros(CAP)
    y, z_pred = np.zeros(m_max), np.zeros(m_max)
    H = Rows(np.zeros((m_max, MAX_H), np.int64), np.zeros((m_max, MAX_H)), np.zeros(m_max, np.int64))
    phi, q = np.ones(CAP), np.zeros(CAP)
    U, S, L = np.zeros((m_max + 3, CAP)), np.zeros((m_max, m_max)), np.zeros((m_max, m_max))
    P_rows = P.reshape((CAP, CAP))
    driven = max(effects.a_tiles, effects.g_first + effects.g_tiles)  # tiles that move at every step
    if tiles - driven < 2 or world.axes >= 0:  # the product costs as much as a tile
        driven = tiles
    M, T = np.zeros((1, 180)), 0.0  # see `_apply_product`
    _start_product(M)
    for j in range(3, 9):
        M[0, 13 * j + 72] = 1.0
    ready = Sorted(np.zeros(4 * m_max), np.zeros(2 * m_max), np.zeros(2 * m_max, np.uint64), np.zeros((3, 16)))
    i, k, rows, n_steps = i0, k0, 0, 0
    while True:
        # --- the state moves to the next sample or the next event, whichever comes first
        to_event = k < k1 and (i >= i1 or readings.t[k] < imu.t[i + 1])
        if not to_event and i >= i1:
            break
        t_next = clock[0]
        if not to_event:
            t_next = imu.t[i + 1]
        elif out.status[k] == ACCEPTED or out.status[k] == WITHHELD:
            t_next = readings.t[k]
        h = t_next - clock[0]
        if h > 0.0:
            span = imu.t[i + 1] - imu.t[i]
            a0 = (clock[0] - imu.t[i]) / span
            a1 = (t_next - imu.t[i]) / span if to_event else 1.0
            if world.averaged:
                a0, a1 = 1.0, 1.0
            _at_ends(imu, i, a0, a1, u0, u1)
            _as_scaled(x, world.axes, u0, u1, w)
            _strapdown(x, u0, u1, h, world, C0, C1, J, c)
            _decay_over(h, states, world, phi, q)
            for j in range(15, states):
                x[j + 1] *= phi[j]
            if tiles > 0:
                _decay_V(V, 0, driven, states, phi)
                if world.axes >= 0:
                    _with_axes_V(V, 0, driven, world.axes, w, 1.0)
                _predict_V(V, c, driven, effects, i, 1.0 - a0, a0, 1.0 - a1, a1, work)
                if world.axes >= 0:
                    _with_axes_V(V, 0, driven, world.axes, w, -1.0)
                if driven < tiles:
                    _propagate_top(M, 0, c)
                    T += h
            if world.axes >= 0:
                _with_axes(P, world.axes, w, 1.0)
            _predict(P, c, top, h, imu.q_accel[i] if world.translation else 0.0, imu.q_gyro[i], world, phi, q)
            if world.axes >= 0:
                _with_axes(P, world.axes, w, -1.0)
            if trail.kept:
                _keep_step(trail, n_steps, c, h, imu.q_accel[i], imu.q_gyro[i], w)
                _keep_coloured(trail, n_steps, x, P)
                n_steps += 1
            clock[0] = t_next
        if not to_event:
            i += 1
            if trail.kept:
                trail.step_of_imu[i - i0] = n_steps
            if out.stride > 0 and i % out.stride == 0:
                _write_state(x, P, i // out.stride, out.x_imu, out.var_imu)
            continue
        # --- a reading
        s = readings.sensor[k]
        m, at = sensors.size[s], readings.row[k]
        if trail.kept:
            trail.step_of_event[k - k0] = n_steps
        if out.status[k] == ACCEPTED or out.status[k] == WITHHELD:
            _matrix(x, C0)
            if not np.isfinite(C0[0] + x[2]):
                return NOT_FINITE, k, rows
            if sensors.kind[s] == MAG and sensors.form[s] == 2:  # linear about the reference in the field's error too
                _matrix(readings.ref[k], C0)
            if not _measure(s, m, sensors, world, x, C0, H, z_pred):
                out.status[k] = NO_PREDICTION
            else:
                if sensors.form[s]:
                    _add_form(m, readings, k, sensors.form[s] == 2, x, H, z_pred, J)
                for j in range(m):
                    out.nu[at + j] = readings.z[at + j] - z_pred[j]
                if not _factor(m, P_rows, H, readings.r, at, U, S, L):
                    return NOT_POSITIVE, k, rows
                total, log_det = _whiten_innovation(m, out.nu, at, L, y, out.white)
                for a in range(m):
                    for b in range(m):
                        out.S[out.S_row[k] + a * m + b] = S[a, b]
                out.nis[k] = total
                out.loglik[k] = -0.5 * (total + log_det + m * 1.8378770664093453)
                if not np.isfinite(total):
                    return NOT_FINITE, k, rows
                if out.status[k] == WITHHELD:
                    pass
                elif total > sensors.gate[readings.freedom[k]]:
                    out.status[k] = GATED
                else:
                    spread = total / sensors.robust[readings.freedom[k]]
                    if sensors.tail[s] > 0.0:
                        b = sensors.stray[s] - out.loglik[k]
                        spread = _doubt(total, readings.freedom[k], sensors.tail[s], b)
                    if spread > 1.0:
                        out.weight[k] = 1.0 / spread
                        _less_weight(m, spread, y, L)
                    _whiten_rows(m, U, L)
                    _correct(m, U, y, x, P, J, dx, states)
                    if tiles > 0:
                        if T > 0.0:
                            _apply_product(V, driven, tiles, M, T)
                            _decay_over(T, states, world, phi, q)
                            _decay_V(V, driven, tiles, states, phi)
                            _start_product(M)
                            T = 0.0
                        _correct_V(m, V, effects, s, k, H, L, U, J, whitened.W, rows, ready, states)
                    if len(whitened.white) > 1:  # asked for
                        for a in range(m):
                            whitened.white[rows] = y[a]
                            whitened.event[rows] = k
                            rows += 1
                    if trail.kept:
                        _keep_correction(trail, k - k0, at - readings.row[k0], m, dx, U, H, L)
        _write_state(x, P, k, out.x_event, out.var_event)
        k += 1
    if T > 0.0:  # V is whole at the end of a chunk
        _apply_product(V, driven, tiles, M, T)
        _decay_over(T, states, world, phi, q)
        _decay_V(V, driven, tiles, states, phi)
    for j in range(CAP + 1):
        if not np.isfinite(x[j]):
            return NOT_FINITE, k, rows
    return OK, k, rows
