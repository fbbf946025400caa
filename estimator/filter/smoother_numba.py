"""Compiled passes of the fixed-interval smoother (`smoother.py`) over one recorded stretch of the filter."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sinan.estimator.filter.engine_numba import _decay_over, _right_jacobian, _turn
from sinan.estimator.filter.kernel_cache import options
from sinan.sensors.arrays import FloatArray

CAP = 56  # = layout.CAPACITY; here, too, as compiled kernels are kept until the file changes in which they stand

_OPTIONS = options()


class By(NamedTuple):
    """Derivatives of the likelihood by the noise of each component, of each interval of the IMU, of each bias, and by
    the time constant of each.
    """

    r: FloatArray
    q_accel: FloatArray
    q_gyro: FloatArray
    bias: FloatArray
    time: FloatArray


def _adjoint(stride):
    """The compiled M <- Phi' M, the adjoint of `engine_numba._propagation`, for a flat M with `stride` columns: its
    offsets are constants, so that loops fill vector registers.
    """

    @njit(**_OPTIONS)
    def transpose(M, columns, c):
        """The first fifteen rows of each column; what is below them decays for itself."""
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]
        j0, j1, j2, j3, j4, j5, j6, j7, j8 = c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17]
        a0, a1, a2, a3, a4, a5, a6, a7, a8 = c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25], c[26]
        d0, d1, d2, d3, d4, d5, d6, d7, d8 = c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34], c[35]
        b0, b1, b2 = c[36] + c[45], c[37] + c[46], c[38] + c[47]
        b3, b4, b5 = c[39] + c[48], c[40] + c[49], c[41] + c[50]
        b6, b7, b8 = c[42] + c[51], c[43] + c[52], c[44] + c[53]
        half = c[54]
        for j in range(columns):
            p0, p1, p2 = half * M[j], half * M[stride + j], half * M[2 * stride + j]
            v0, v1, v2 = M[3 * stride + j], M[4 * stride + j], M[5 * stride + j]
            w0, w1, w2 = v0 + p0, v1 + p1, v2 + p2
            n0 = M[6 * stride + j] - d0 * w0 - d3 * w1 - d6 * w2
            n1 = M[7 * stride + j] - d1 * w0 - d4 * w1 - d7 * w2
            n2 = M[8 * stride + j] - d2 * w0 - d5 * w1 - d8 * w2
            M[3 * stride + j], M[4 * stride + j], M[5 * stride + j] = v0 + 2.0 * p0, v1 + 2.0 * p1, v2 + 2.0 * p2
            M[6 * stride + j] = r0 * n0 + r3 * n1 + r6 * n2 - a0 * w0 - a3 * w1 - a6 * w2
            M[7 * stride + j] = r1 * n0 + r4 * n1 + r7 * n2 - a1 * w0 - a4 * w1 - a7 * w2
            M[8 * stride + j] = r2 * n0 + r5 * n1 + r8 * n2 - a2 * w0 - a5 * w1 - a8 * w2
            M[9 * stride + j] -= b0 * w0 + b3 * w1 + b6 * w2
            M[10 * stride + j] -= b1 * w0 + b4 * w1 + b7 * w2
            M[11 * stride + j] -= b2 * w0 + b5 * w1 + b8 * w2
            M[12 * stride + j] -= j0 * n0 + j3 * n1 + j6 * n2
            M[13 * stride + j] -= j1 * n0 + j4 * n1 + j7 * n2
            M[14 * stride + j] -= j2 * n0 + j5 * n1 + j8 * n2

    return transpose


#: Columns of the block in which position, velocity, attitude and the IMU's biases meet: fifteen, to fill registers.
_BLOCK = 16
_adjoint_G, _adjoint_block, _adjoint_r = _adjoint(CAP), _adjoint(_BLOCK), _adjoint(1)


@njit(**_OPTIONS)
def _transposed_step(c, r, phi, axes):
    """r <- Phi' r, with the biases' decay `phi`, and `axes` as in `World`."""
    if axes >= 0:
        _add_axes(c, r, axes, -1.0)
    _adjoint_r(r, 1, c)
    for j in range(15, CAP):
        r[j] *= phi[j]
    if axes >= 0:
        _add_axes(c, r, axes, 1.0)


@njit(**_OPTIONS)
def _add_axes(c, r, at, sign):
    """r <- T' r, T as in `engine_numba._with_axes`."""
    for i in range(3):
        for j in range(3):
            r[at + 3 * i + j] += sign * c[58 + j] * r[12 + i]


@njit(**_OPTIONS)
def _add_axes_both(c, G, at, sign, states):
    """G <- T' G T for a symmetric flat G."""
    for i in range(3):
        for j in range(3):
            for k in range(states):
                G[CAP * (at + 3 * i + j) + k] += sign * c[58 + j] * G[CAP * (12 + i) + k]
    for k in range(states):
        for i in range(3):
            for j in range(3):
                G[CAP * k + at + 3 * i + j] += sign * c[58 + j] * G[CAP * k + 12 + i]


@njit(**_OPTIONS)
def _adjoint_step(c, G, block, phi, states, axes):
    """G <- Phi' G Phi for a symmetric flat G, both triangles equal."""
    if axes >= 0:
        _add_axes_both(c, G, axes, -1.0, states)
    _adjoint_G(G, states, c)
    for i in range(15):
        for j in range(15):
            block[_BLOCK * j + i] = G[CAP * i + j]
    _adjoint_block(block, 15, c)
    for i in range(15):
        for j in range(15):
            G[CAP * i + j] = block[_BLOCK * min(i, j) + max(i, j)]
    for i in range(15, states):
        if phi[i] != 1.0:
            for j in range(15):
                G[CAP * j + i] *= phi[i]
            for j in range(15, states):
                G[CAP * i + j] *= phi[i]
            for j in range(15, states):
                G[CAP * j + i] *= phi[i]
    for i in range(15, states):
        for j in range(15):
            G[CAP * i + j] = G[CAP * j + i]
    if axes >= 0:
        _add_axes_both(c, G, axes, 1.0, states)


@njit(**_OPTIONS)
def _step(c, d, phi, axes):
    """d <- Phi d."""
    if axes >= 0:
        _turn_axes(c, d, axes, 1.0)
    half = c[54]
    n, w = np.empty(3), np.empty(3)
    for i in range(3):
        a = 3 * i
        n[i] = c[a] * d[6] + c[a + 1] * d[7] + c[a + 2] * d[8]
        n[i] -= c[9 + a] * d[12] + c[10 + a] * d[13] + c[11 + a] * d[14]
    for i in range(3):
        a = 3 * i
        w[i] = d[3 + i] - c[18 + a] * d[6] - c[19 + a] * d[7] - c[20 + a] * d[8]
        w[i] -= c[27 + a] * n[0] + c[28 + a] * n[1] + c[29 + a] * n[2]
        for j in range(3):
            w[i] -= (c[36 + a + j] + c[45 + a + j]) * d[9 + j]
    for i in range(3):
        d[i] += half * (d[3 + i] + w[i])
        d[3 + i] = w[i]
        d[6 + i] = n[i]
    for j in range(15, CAP):
        d[j] *= phi[j]
    if axes >= 0:
        _turn_axes(c, d, axes, -1.0)


@njit(**_OPTIONS)
def _turn_axes(c, d, at, sign):
    """d <- T d, T as in `engine_numba._with_axes`."""
    for i in range(3):
        for j in range(3):
            d[12 + i] += sign * c[58 + j] * d[at + 3 * i + j]


@njit(**_OPTIONS)
def _turned(J, r, transposed):
    """Attitude part of r <- J r or J' r."""
    a, b, c = r[6], r[7], r[8]
    for i in range(3):
        if transposed:
            r[6 + i] = J[i] * a + J[3 + i] * b + J[6 + i] * c
        else:
            r[6 + i] = J[3 * i] * a + J[3 * i + 1] * b + J[3 * i + 2] * c


@njit(**_OPTIONS)
def backward(trail, row, white, world, r, r_after, N, with_N):
    """Carry r (CAP,) and N (CAP, CAP) from the end of the stretch to its start.

    Reading: r <- J' r, r <- r + H~' (y - U r);  N <- (I - U' H~)' J' N J (I - U' H~) + H~' H~, H~ = L^-1 H
    Step:    r <- Phi' r;                        N <- Phi' N Phi
    `r_after[s]` keeps r right after step s.
    """
    steps, step_of_event, U, H, turn = trail.steps, trail.step_of_event, trail.U, trail.H, trail.turn
    J, temp = np.empty(9), np.empty(CAP)
    phi, q = np.ones(CAP), np.zeros(CAP)
    flat, block = N.reshape(-1), np.zeros(15 * _BLOCK)
    k, s = len(step_of_event) - 1, len(r_after)
    while True:
        while k >= 0 and step_of_event[k] == s:
            first, m = row[k] - row[0], row[k + 1] - row[k]
            _right_jacobian(turn[k, 0], turn[k, 1], turn[k, 2], J)
            _turned(J, r, True)
            if with_N:
                _turn_both(J, flat, CAP)
            for a in range(m):
                temp[a] = white[first + a]
                for j in range(CAP):
                    temp[a] -= U[first + a, j] * r[j]
            for a in range(m):
                for j in range(CAP):
                    r[j] += H[first + a, j] * temp[a]
            if with_N:
                for _ in range(2):  # N <- (N - N U' H~) then the same from the other side
                    UN = U[first : first + m] @ N
                    N[:, :] = (N - H[first : first + m].T @ UN).T.copy()
                N += H[first : first + m].T @ H[first : first + m]
            k -= 1
        if s == 0:
            return
        s -= 1
        for j in range(CAP):
            r_after[s, j] = r[j]
        _decay_over(steps[s, 55], CAP, world, phi, q)
        _transposed_step(steps[s], r, phi, world.axes)
        if with_N:
            _adjoint_step(steps[s], flat, block, phi, CAP, world.axes)


@njit(**_OPTIONS)
def forward(trail, row, white, world, d, r_after, x_imu, x_smooth):
    """Carry the smoothed correction d = E[dx | all readings] through the stretch: d <- Phi d + Q r, d <- J (d - U' y).

    At every IMU sample x_smooth = x_imu (+) d.
    """
    steps, step_of_event, step_of_imu, U, turn = (
        trail.steps,
        trail.step_of_event,
        trail.step_of_imu,
        trail.U,
        trail.turn,
    )
    walk2, translation = world.walk2, world.translation
    J, phi, q = np.empty(9), np.ones(CAP), np.zeros(CAP)
    k, i, s = 0, 0, 0
    while True:
        while i < len(step_of_imu) and step_of_imu[i] == s:
            for j in range(6):
                x_smooth[i, j] = x_imu[i, j] + d[j]
            for j in range(9, CAP):
                x_smooth[i, j + 1] = x_imu[i, j + 1] + d[j]
            for j in range(6, 10):
                x_smooth[i, j] = x_imu[i, j]
            _turn(x_smooth[i], d[6], d[7], d[8])
            i += 1
        while k < len(step_of_event) and step_of_event[k] == s:
            first, m = row[k] - row[0], row[k + 1] - row[k]
            for a in range(m):
                for j in range(CAP):
                    d[j] -= U[first + a, j] * white[first + a]
            _right_jacobian(turn[k, 0], turn[k, 1], turn[k, 2], J)
            _turned(J, d, False)
            k += 1
        if s == len(steps):
            return
        h, q_accel, q_gyro = steps[s, 55], steps[s, 56], steps[s, 57]
        _decay_over(h, CAP, world, phi, q)
        _step(steps[s], d, phi, world.axes)
        for j in range(3):
            if translation:
                v = q_accel * h
                d[j] += v * h * h / 3.0 * r_after[s, j] + 0.5 * v * h * r_after[s, 3 + j]
                d[3 + j] += 0.5 * v * h * r_after[s, j] + v * r_after[s, 3 + j]
            d[6 + j] += q_gyro * h * r_after[s, 6 + j]
        for j in range(9, 15):
            d[j] += walk2[j] * h * r_after[s, j]
        for j in range(15, CAP):
            d[j] += q[j] * r_after[s, j]
        s += 1


@njit(**_OPTIONS)
def backward_scores(trail, row, out, used, tail, freedom, world, r, G, by):
    """Carry r, d log L / dx, and G, d log L / dP, from the end of the stretch to its start, and write down what they
    say of every noise on the way; derived in `estimator.evidence.level_scores`. G is symmetric, and flat.

    H here is L^-1 H and U = L^-1 H P, with L L' = S / weight; `tail` of each reading, 0: its law is normal,
    and `freedom`, how many of its components tell something.
    """
    steps, step_of_event, step_of_imu = trail.steps, trail.step_of_event, trail.step_of_imu
    U, H, turn = trail.U, trail.H, trail.turn
    walk2, states, translation = world.walk2, world.states, world.translation
    J, phi, q = np.empty(9), np.ones(CAP), np.zeros(CAP)
    m_max = 1
    for k in range(len(step_of_event)):
        m_max = max(m_max, row[k + 1] - row[k])
    y, Ur, Hy = np.zeros(m_max), np.zeros(m_max), np.zeros(CAP)
    L, inverse, own = np.zeros((m_max, m_max)), np.zeros((m_max, m_max)), np.zeros((m_max, m_max))
    UG, UGU, block = np.zeros((m_max, CAP)), np.zeros((m_max, m_max)), np.zeros(15 * _BLOCK)
    k, s, i = len(step_of_event) - 1, len(steps), len(step_of_imu) - 2
    while True:
        while k >= 0 and step_of_event[k] == s:
            first, m, weight = row[k] - row[0], row[k + 1] - row[k], out.weight[k]
            if not used[k]:
                k -= 1
                continue
            _right_jacobian(turn[k, 0], turn[k, 1], turn[k, 2], J)
            _turned(J, r, True)
            _turn_both(J, G, states)
            grown = 0.0  # d log L / d log weight
            for a in range(m):
                y[a], Ur[a] = np.sqrt(weight) * out.white[first + a], 0.0
                for j in range(states):
                    Ur[a] += U[first + a, j] * r[j]
                _row_times(a, U[first + a], G, states, UG)
                for b in range(m):
                    UGU[a, b] = 0.0
                    for j in range(states):
                        UGU[a, b] += UG[a, j] * U[first + b, j]
                grown += Ur[a] * y[a] - UGU[a, a]
            share, right = 1.0, 1.0  # -2 d log L by NIS, over the weight, and by log |S|
            if weight < 1.0:
                slope = 1.0  # of rho
                if tail[k] > 0.0:
                    slope = min(1.0, (tail[k] + freedom[k]) / (tail[k] + out.nis[k]))
                    right = weight / slope
                    right += grown * (1.0 - right)
                share = right * slope
                if slope < 1.0 or tail[k] == 0.0:
                    share += 2.0 * grown / (tail[k] + out.nis[k])
                share /= weight
            for a in range(m):
                for b in range(m):
                    own[a, b] = 0.5 * (share * y[a] * y[b] - Ur[a] * y[b] - y[a] * Ur[b])
                own[a, a] -= 0.5 * right
            _inverse_factor(m, weight, out.S, out.S_row[k], L, inverse)
            for j in range(m):
                value = 0.0
                for a in range(j, m):
                    for b in range(j, m):
                        value += inverse[a, j] * (own[a, b] + UGU[a, b]) * inverse[b, j]
                by.r[first + j] = value / weight
            for a in range(m):  # G <- (1 - H'U) G (1 - U'H), one side after the other: what cancels does so once
                for j in range(states):
                    for n in range(states):
                        G[CAP * j + n] -= UG[a, j] * H[first + a, n]
            for a in range(m):
                _row_times(a, U[first + a], G, states, UG)
                for b in range(m):
                    also = (own[a, b] + (1.0 - weight) * UGU[a, b]) / weight
                    for n in range(states):
                        UG[a, n] -= also * H[first + b, n]
            Hy[:] = 0.0
            for a in range(m):
                for j in range(states):
                    Hy[j] += H[first + a, j] * y[a]
                    for n in range(states):
                        G[CAP * j + n] -= H[first + a, j] * UG[a, n]
            for j in range(states):
                for n in range(j + 1):
                    both = 0.5 * (G[CAP * j + n] + G[CAP * n + j] + r[j] * Hy[n] + Hy[j] * r[n])
                    G[CAP * j + n], G[CAP * n + j] = both, both
            for a in range(m):
                for j in range(states):
                    r[j] += H[first + a, j] * (share * y[a] - Ur[a])
            k -= 1
        if s == 0:
            return
        s -= 1
        while i > 0 and step_of_imu[i] > s:
            i -= 1
        h = steps[s, 55]
        _decay_over(h, states, world, phi, q)
        for j in range(3):
            by.q_gyro[i] += h * G[(CAP + 1) * (6 + j)]
            if translation:
                with_v = G[(CAP + 1) * (3 + j)] + h * G[CAP * j + 3 + j]
                by.q_accel[i] += h * (with_v + h * h / 3.0 * G[(CAP + 1) * j])
        for j in range(9, 15):
            by.bias[j] += walk2[j] * h * G[(CAP + 1) * j]
        for j in range(15, states):
            by.bias[j] += q[j] * G[(CAP + 1) * j]
        for c in range(len(trail.coloured)):
            j = trail.coloured[c]
            value = -0.5 * walk2[j] / world.rate[j] * G[(CAP + 1) * j]
            for n in range(states):
                value += G[CAP * j + n] * trail.after[s, c, n + 1]
            by.time[j] += h * world.rate[j] * (r[j] * trail.after[s, c, 0] + 2.0 * value)
        _transposed_step(steps[s], r, phi, world.axes)
        _adjoint_step(steps[s], G, block, phi, states, world.axes)


@njit(**_OPTIONS)
def _inverse_factor(m, weight, S, at, L, inverse):
    """L with L L' = S / weight, and its inverse."""
    for a in range(m):
        for b in range(a + 1):
            value = S[at + a * m + b] / weight
            for n in range(b):
                value -= L[a, n] * L[b, n]
            L[a, b] = np.sqrt(value) if a == b else value / L[b, b]
        for b in range(a + 1):
            value = 1.0 if a == b else 0.0
            for n in range(b, a):
                value -= L[a, n] * inverse[n, b]
            inverse[a, b] = value / L[a, a]


@njit(**_OPTIONS)
def _row_times(a, u, G, states, out):
    """out[a] <- u G, G flat."""
    for j in range(states):
        out[a, j] = 0.0
    for n in range(states):
        for j in range(states):
            out[a, j] += u[n] * G[CAP * n + j]


@njit(**_OPTIONS)
def _turn_both(J, G, states):
    """G <- J' G J on the attitude block of a flat G."""
    for j in range(states):
        _turned(J, G[CAP * j : CAP * (j + 1)], True)
    for j in range(states):
        a, b, c = G[6 * CAP + j], G[7 * CAP + j], G[8 * CAP + j]
        for i in range(3):
            G[(6 + i) * CAP + j] = J[i] * a + J[3 + i] * b + J[6 + i] * c
