"""The compiled engine: strapdown step, covariance prediction, vector update and sensitivity fused into one time loop.

What it computes is what `estimator.strapdown`, `estimator.error_dynamics` and the models in `sensors` say; the tests
hold it against them and against the filterpy engine. Arrays and floats only; it returns a status, `filter` raises.

Layout: P is flat, `CAPACITY` to a row, so that offsets are constants and loops fill vector registers; states that do
not exist keep P = 0, and of the rows only those are visited in which states are, eight at a time. The sensitivities V
come in tiles of `CAPACITY` rows x 16 columns. Those of effects on accelerometer
and gyroscope move at every step; between two readings the others obey V <- Phi V, so that the product of the Phi waits
for the next reading that corrects, or for the end of the chunk.

P stays symmetric to the last bit: the update subtracts sum_k u_k u_k' with u = L^-1 H P, S = L L', whose element (i, j)
is the same sum as (j, i), and the prediction mirrors one triangle.
"""

# mypy: disable-error-code="no-untyped-def"
# The kernels' types are those of the arrays that `estimator.compiled` hands them.

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from estimator.kernel_cache import options

CAP = 40  # = layout.CAPACITY
TILE = 16  # columns of V that are carried together: fewer, and the compiler unrolls loops instead of filling registers
SIXTEEN = np.uint64(16)  # unsigned offsets need no test for negative indices, which would keep a loop from vectors
P_Z, T_X, T_Y, T_Z = np.uint64(32), np.uint64(96), np.uint64(112), np.uint64(128)  # rows 2, 6, 7, 8 of a tile
MAX_H = 14  # non-zero columns of a row of H: position, velocity, attitude, bias
GPS, BASE, MAG, BARO, RANGE, LEVEL, SPEED = 0, 1, 2, 3, 4, 5, 6
ACCEPTED, GATED, OUTSIDE, NO_PREDICTION, FAULTY, WITHHELD = 0, 1, 2, 3, 4, 5
OK, NOT_FINITE, NOT_POSITIVE = 0, 1, 2

_OPTIONS = options()
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
def _strapdown(x, u0, u1, h, g, w_ie, translation, C0, C1, J, c):
    """One step of the nominal state over h, and the coefficients of its error dynamics.

    phi = h (w_0 + w_1) / 2 + h^2 / 12 w_0 x w_1,  q_1 = q_0 exp(phi),  C_1 f_1 with q_1
    v_1 = v_0 + h / 2 (C_0 f_0 + C_1 f_1) + h g,  p_1 = p_0 + h / 2 (v_0 + v_1)
    c: R (0), h J_r (9), A_0 (18), A_1 (27), B_0 (36), B_1 (45), h / 2 (54); see `error_dynamics`.
    """
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
    if translation:
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
def _decay_over(h, states, rate, walk2, phi, q):
    """phi = exp(-h rate) and the variance q that the process adds to each bias over h; a walk has rate 0."""
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
def _predict(P, c, top, h, q_accel, q_gyro, walk2, states, phi, q):
    """P <- Phi P Phi' + Q, both triangles equal."""
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
def _decay_V(V, first, last, states, phi):
    """The rows of V of biases that decay, for the tiles from `first` to `last`."""
    for i in range(15, states):
        if phi[i] != 1.0:
            for tile in range(first, last):
                for j in range(TILE):
                    V[tile, TILE * i + j] *= phi[i]


@njit(**_INLINE)
def _predict_V(V, c, tiles, Ga, Gg, at, a_tiles, g_first, g_tiles, u00, u01, u10, u11, work):
    """V <- Phi V - B G, tile by tile; at the step's ends the regressor is u00 G_k + u01 G_k+1, u10 G_k + u11 G_k+1."""
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
def _put(H_index, H_value, H_n, row, index, value):
    n = H_n[row]
    H_index[row, n] = index
    H_value[row, n] = value
    H_n[row] = n + 1


@njit(**_INLINE)
def _measure(kind, m, bias, colour, field, x, C, m_n, g, ground_down, beams, first_beam, H_index, H_value, H_n, z_pred):
    """Prediction of one reading and the non-zero elements of its H; False where there is no prediction."""
    for i in range(m):
        H_n[i] = 0
    if kind == GPS:
        for i in range(m):
            z_pred[i] = x[i]
            _put(H_index, H_value, H_n, i, i, 1.0)
    elif kind == SPEED:
        for i in range(m):
            z_pred[i] = x[3 + i]
            _put(H_index, H_value, H_n, i, 3 + i, 1.0)
    elif kind == BASE:
        for i in range(m):
            z_pred[i] = 0.0
    elif kind == BARO:
        z_pred[0] = -x[2]
        _put(H_index, H_value, H_n, 0, 2, -1.0)
    elif kind == RANGE:
        for i in range(m):
            b0, b1, b2 = beams[first_beam + i, 0], beams[first_beam + i, 1], beams[first_beam + i, 2]
            down = C[6] * b0 + C[7] * b1 + C[8] * b2
            if not down > 0.0:
                return False
            r = (ground_down - x[2]) / down
            z_pred[i] = r
            _put(H_index, H_value, H_n, i, 2, -1.0 / down)
            _put(H_index, H_value, H_n, i, 6, r / down * (C[7] * b2 - C[8] * b1))
            _put(H_index, H_value, H_n, i, 7, r / down * (C[8] * b0 - C[6] * b2))
            _put(H_index, H_value, H_n, i, 8, r / down * (C[6] * b1 - C[7] * b0))
    else:
        s, a, b, c = 1.0, m_n[0], m_n[1], m_n[2]
        if kind == LEVEL:
            s, a, b, c = -1.0, g[0], g[1], g[2]
        elif field >= 0:
            a, b, c = a + x[field + 1], b + x[field + 2], c + x[field + 3]
        for i in range(3):
            z_pred[i] = s * (C[i] * a + C[3 + i] * b + C[6 + i] * c)
        _put(H_index, H_value, H_n, 0, 7, -z_pred[2])
        _put(H_index, H_value, H_n, 0, 8, z_pred[1])
        _put(H_index, H_value, H_n, 1, 6, z_pred[2])
        _put(H_index, H_value, H_n, 1, 8, -z_pred[0])
        _put(H_index, H_value, H_n, 2, 6, -z_pred[1])
        _put(H_index, H_value, H_n, 2, 7, z_pred[0])
        if kind == MAG and field >= 0:
            for i in range(3):
                for j in range(3):
                    _put(H_index, H_value, H_n, i, field + j, C[3 * j + i])
    if bias >= 0:
        single = kind in (BARO, RANGE)
        for i in range(m if single else 3):
            at = bias if single else bias + i
            z_pred[i] += x[at + 1]
            _put(H_index, H_value, H_n, i, at, 1.0)
    if colour >= 0:
        for i in range(m):
            at = colour if kind == RANGE else colour + i
            z_pred[i] += x[at + 1]
            _put(H_index, H_value, H_n, i, at, 1.0)
    return True


@njit(**_INLINE)
def _add_form(m, row, D, ref, event, replaces, x, H_index, H_value, H_n, z_pred, J):
    """z_pred += D (x (-) x_ref), H += D J_r^-1 on position, velocity and attitude: an effect along a known motion.

    Where it replaces the model's own prediction, only the bias stays of that: linear about the reference.
    """
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
            for k in range(H_n[i]):
                if H_index[i, k] >= 9:
                    z_pred[i] += H_value[i, k] * x[H_index[i, k] + 1]
        for j in range(9):
            z_pred[i] += D[row + i, j] * d[j]
        for j in range(6):
            dense[j] = D[row + i, j]
        for j in range(3):
            dense[6 + j] = D[row + i, 6] * J[j] + D[row + i, 7] * J[3 + j] + D[row + i, 8] * J[6 + j]
        kept = 0
        for k in range(H_n[i]):
            if H_index[i, k] < 9:
                dense[H_index[i, k]] += 0.0 if replaces else H_value[i, k]
            else:
                kept_index[kept], kept_value[kept] = H_index[i, k], H_value[i, k]
                kept += 1
        H_n[i] = 0
        for j in range(9):
            _put(H_index, H_value, H_n, i, j, dense[j])
        for k in range(kept):
            _put(H_index, H_value, H_n, i, kept_index[k], kept_value[k])


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
def _factor(m, P, H_index, H_value, H_n, r, row, B, S, L):
    """B = H P, S = H P H' + R, S = L L', R the variances r from `row` on; P as rows (CAP, CAP).

    False where S is not positive.
    """
    for i in range(m):
        _set_row(B, i, P, H_index[i, 0], H_value[i, 0])
        for k in range(1, H_n[i]):
            _add_row(B, i, P, H_index[i, k], H_value[i, k])
        for j in range(i + 1):
            s = 0.0
            for k in range(H_n[j]):
                s += H_value[j, k] * B[i, H_index[j, k]]
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
def _sort_row(i, H_index, H_value, H_n, near, h, r):
    """Elements of one row of H for `_correct_V`: columns 2, 6, 7, 8 in `near`, two others in h and r; counts others."""
    for q in range(4):
        near[4 * i + q] = 0.0
    h[2 * i], h[2 * i + 1], r[2 * i], r[2 * i + 1] = 0.0, 0.0, np.uint64(0), np.uint64(0)
    others = 0
    for q in range(H_n[i]):
        at = H_index[i, q]
        if at == 2:
            near[4 * i] = H_value[i, q]
        elif 6 <= at <= 8:
            near[4 * i + at - 5] = H_value[i, q]
        else:
            if others < 2:
                h[2 * i + others], r[2 * i + others] = H_value[i, q], np.uint64(16 * at)
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
def _add_others(i, V, tiles, H_index, H_value, H_n, W, row):
    """The elements of H_i beyond the two that `_put_HV` takes: an effect along a known motion fills the row."""
    others = 0
    for q in range(H_n[i]):
        c = H_index[i, q]
        if c == 2 or 6 <= c <= 8:
            continue
        others += 1
        if others > 2:
            for tile in range(tiles):
                for j in range(16):
                    W[row, 16 * tile + j] += H_value[i, q] * V[tile, 16 * c + j]


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
def _correct_V(m, V, tiles, H_index, H_value, H_n, L, U, J, G, g_at, first, count, W, row, group, near, h, r, states):
    """S_beta = H V + G, W = L^-1 S_beta into the rows of `W` from `row` on, V <- V - U' W, then the reset.

    All components of S_beta are taken before V changes: a reading with less weight has L scaled, but not its H V. The
    rows of V that most readings need have constant places, which lets the loops fill vector registers.
    """
    for i in range(m):
        others = _sort_row(i, H_index, H_value, H_n, near, h, r)
        for tile in range(tiles):
            _put_HV(i, V, tile, near, h, r, W, row + i, np.uint64(16 * tile))
        if others > 2:
            _add_others(i, V, tiles, H_index, H_value, H_n, W, row + i)
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


@njit(**_OPTIONS)
def run_chunk(
    clock, imu_t, imu_u, q_accel, q_gyro, i0, i1, k0, k1, ev_t, ev_sensor, ev_row, ev_S, ev_status,
    z, form, D, ref, kind, size, bias, colour, field, beam_start, beams, r, gate, robust, tail,
    g, m_n, w_ie, ground_down, translation, averaged, states, walk2, rate, x, P,
    nu, white, S_out, nis, loglik, weight, x_event, var_event, log_imu, x_imu, var_imu,
    record, steps, step_of_event, step_of_imu, U_out, H_out, turn_out,
    V, tiles, Ga, Gg, a_tiles, g_first, g_tiles, Gz, ev_G, col_first, col_count, W_out, W_white, W_event,
):  # fmt: skip
    """Run from IMU sample i0 to i1 through the events k0 to k1; returns (status, event, rows of W).

    `clock[0]` is the time of the state. What each array holds is said where `estimator.filter` makes it.
    """
    m_max = np.max(size) if len(size) else 1
    C0, C1, J, c, top = np.zeros(9), np.zeros(9), np.zeros(9), np.zeros(55), np.zeros((1, 180))
    u0, u1, work, dx = np.zeros(6), np.zeros(6), np.zeros(48), np.zeros(CAP)
    y, z_pred = np.zeros(m_max), np.zeros(m_max)
    H_index, H_value, H_n = np.zeros((m_max, MAX_H), np.int64), np.zeros((m_max, MAX_H)), np.zeros(m_max, np.int64)
    phi, q = np.ones(CAP), np.zeros(CAP)
    U, S, L = np.zeros((m_max + 3, CAP)), np.zeros((m_max, m_max)), np.zeros((m_max, m_max))
    P_rows, group = P.reshape((CAP, CAP)), np.zeros((3, 16))
    driven = max(a_tiles, g_first + g_tiles)  # tiles that move at every step
    if tiles - driven < 2:  # the product costs as much as a tile
        driven = tiles
    M, T = np.zeros((1, 180)), 0.0  # see `_apply_product`
    _start_product(M)
    for j in range(3, 9):
        M[0, 13 * j + 72] = 1.0
    near, h_other, r_other = np.zeros(4 * m_max), np.zeros(2 * m_max), np.zeros(2 * m_max, np.uint64)
    i, k, rows, n_steps = i0, k0, 0, 0
    while True:
        # --- the state moves to the next sample or the next event, whichever comes first
        to_event = k < k1 and (i >= i1 or ev_t[k] < imu_t[i + 1])
        if not to_event and i >= i1:
            break
        t_next = clock[0]
        if not to_event:
            t_next = imu_t[i + 1]
        elif ev_status[k] == ACCEPTED or ev_status[k] == WITHHELD:
            t_next = ev_t[k]
        h = t_next - clock[0]
        if h > 0.0:
            span = imu_t[i + 1] - imu_t[i]
            a0 = (clock[0] - imu_t[i]) / span
            a1 = (t_next - imu_t[i]) / span if to_event else 1.0
            if averaged:
                a0, a1 = 1.0, 1.0
            for j in range(6):
                u0[j] = (1.0 - a0) * imu_u[i, j] + a0 * imu_u[i + 1, j]
                u1[j] = (1.0 - a1) * imu_u[i, j] + a1 * imu_u[i + 1, j]
            _strapdown(x, u0, u1, h, g, w_ie, translation, C0, C1, J, c)
            _decay_over(h, states, rate, walk2, phi, q)
            for j in range(15, states):
                x[j + 1] *= phi[j]
            if tiles > 0:
                _decay_V(V, 0, driven, states, phi)
                _predict_V(V, c, driven, Ga, Gg, i, a_tiles, g_first, g_tiles, 1.0 - a0, a0, 1.0 - a1, a1, work)
                if driven < tiles:
                    _propagate_top(M, 0, c)
                    T += h
            _predict(P, c, top, h, q_accel[i] if translation else 0.0, q_gyro[i], walk2, states, phi, q)
            if record:
                for j in range(55):
                    steps[n_steps, j] = c[j]
                steps[n_steps, 55], steps[n_steps, 56], steps[n_steps, 57] = h, q_accel[i], q_gyro[i]
                n_steps += 1
            clock[0] = t_next
        if not to_event:
            i += 1
            if record:
                step_of_imu[i - i0] = n_steps
            if log_imu > 0 and i % log_imu == 0:
                for j in range(CAP + 1):
                    x_imu[i // log_imu, j] = x[j]
                for j in range(CAP):
                    var_imu[i // log_imu, j] = P[0, (CAP + 1) * j]
            continue
        # --- a reading
        s = ev_sensor[k]
        m, at = size[s], ev_row[k]
        if record:
            step_of_event[k - k0] = n_steps
        if ev_status[k] == ACCEPTED or ev_status[k] == WITHHELD:
            _matrix(x, C0)
            if not np.isfinite(C0[0] + x[2]):
                return NOT_FINITE, k, rows
            if kind[s] == MAG and form[s] == 2:  # linear about the reference in the field's error too
                _matrix(ref[k], C0)
            seen = _measure(
                kind[s],
                m,
                bias[s],
                colour[s],
                field,
                x,
                C0,
                m_n,
                g,
                ground_down,
                beams,
                beam_start[s],
                H_index,
                H_value,
                H_n,
                z_pred,
            )
            if not seen:
                ev_status[k] = NO_PREDICTION
            else:
                if form[s]:
                    _add_form(m, at, D, ref, k, form[s] == 2, x, H_index, H_value, H_n, z_pred, J)
                for j in range(m):
                    nu[at + j] = z[at + j] - z_pred[j]
                if not _factor(m, P_rows, H_index, H_value, H_n, r, at, U, S, L):
                    return NOT_POSITIVE, k, rows
                total, log_det = 0.0, 0.0
                for a in range(m):
                    e = nu[at + a]
                    for b in range(a):
                        e -= L[a, b] * y[b]
                    y[a] = e / L[a, a]
                    total += y[a] * y[a]
                    log_det += 2.0 * np.log(L[a, a])
                    white[at + a] = y[a]
                    for b in range(m):
                        S_out[ev_S[k] + a * m + b] = S[a, b]
                nis[k] = total
                loglik[k] = -0.5 * (total + log_det + m * 1.8378770664093453)
                if not np.isfinite(total):
                    return NOT_FINITE, k, rows
                if ev_status[k] == WITHHELD:
                    pass
                elif total > gate[s]:
                    ev_status[k] = GATED
                else:
                    spread = total / robust[s]
                    if tail[s] > 0.0:
                        spread = (tail[s] + total) / (tail[s] + m)
                    if spread > 1.0:
                        factor = np.sqrt(spread)
                        weight[k] = 1.0 / spread
                        for a in range(m):
                            y[a] /= factor
                            for b in range(a + 1):
                                L[a, b] *= factor
                    for a in range(m):
                        for b in range(a):
                            _add_row(U, a, U, b, -L[a, b])
                        _set_row(U, a, U, a, 1.0 / L[a, a])
                    _correct(m, U, y, x, P, J, dx, states)
                    if tiles > 0:
                        if T > 0.0:
                            _apply_product(V, driven, tiles, M, T)
                            _decay_over(T, states, rate, walk2, phi, q)
                            _decay_V(V, driven, tiles, states, phi)
                            _start_product(M)
                            T = 0.0
                        _correct_V(
                            m, V, tiles, H_index, H_value, H_n, L, U, J, Gz, ev_G[k], col_first[s], col_count[s],
                            W_out, rows, group, near, h_other, r_other, states,
                        )  # fmt: skip
                    if len(W_white) > 1:  # asked for
                        for a in range(m):
                            W_white[rows] = y[a]
                            W_event[rows] = k
                            rows += 1
                    if record:
                        for j in range(3):
                            turn_out[k - k0, j] = dx[6 + j]
                        for a in range(m):
                            for j in range(CAP):
                                U_out[at + a - ev_row[k0], j] = U[a, j]
                                H_out[at + a - ev_row[k0], j] = 0.0
                            for b in range(H_n[a]):
                                H_out[at + a - ev_row[k0], H_index[a, b]] = H_value[a, b]
                            for b in range(a):
                                for j in range(CAP):
                                    H_out[at + a - ev_row[k0], j] -= L[a, b] * H_out[at + b - ev_row[k0], j]
                            for j in range(CAP):
                                H_out[at + a - ev_row[k0], j] /= L[a, a]
        for j in range(CAP + 1):
            x_event[k, j] = x[j]
        for j in range(CAP):
            var_event[k, j] = P[0, (CAP + 1) * j]
        k += 1
    if T > 0.0:  # V is whole at the end of a chunk
        _apply_product(V, driven, tiles, M, T)
        _decay_over(T, states, rate, walk2, phi, q)
        _decay_V(V, driven, tiles, states, phi)
    for j in range(CAP + 1):
        if not np.isfinite(x[j]):
            return NOT_FINITE, k, rows
    return OK, k, rows
