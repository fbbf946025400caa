"""Compiled passes of the fixed-interval smoother over one recorded stretch of the filter; see `estimator.smoother`."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from estimator.engine_numba import _right_jacobian, _turn

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}


@njit(**_OPTIONS)
def _transposed_step(c, r):
    """r <- Phi' r, the adjoint of `engine_numba._propagation`."""
    half = c[54]
    w0, w1, w2 = r[3] + half * r[0], r[4] + half * r[1], r[5] + half * r[2]
    n0 = r[6] - c[27] * w0 - c[30] * w1 - c[33] * w2
    n1 = r[7] - c[28] * w0 - c[31] * w1 - c[34] * w2
    n2 = r[8] - c[29] * w0 - c[32] * w1 - c[35] * w2
    for j in range(3):
        r[3 + j] += 2.0 * half * r[j]
        r[6 + j] = c[j] * n0 + c[3 + j] * n1 + c[6 + j] * n2 - c[18 + j] * w0 - c[21 + j] * w1 - c[24 + j] * w2
        r[9 + j] -= (c[36 + j] + c[45 + j]) * w0 + (c[39 + j] + c[48 + j]) * w1 + (c[42 + j] + c[51 + j]) * w2
        r[12 + j] -= c[9 + j] * n0 + c[12 + j] * n1 + c[15 + j] * n2


@njit(**_OPTIONS)
def _step(c, d):
    """d <- Phi d."""
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
def backward(steps, step_of_event, row, white, U, H, turn, r, r_after, N, with_N):
    """Carry r (24,) and N (24, 24) from the end of the stretch to its start.

    Reading: r <- J' r, r <- r + H~' (y - U r);  N <- (I - U' H~)' J' N J (I - U' H~) + H~' H~, H~ = L^-1 H
    Step:    r <- Phi' r;                        N <- Phi' N Phi
    `r_after[s]` keeps r right after step s.
    """
    J, temp = np.empty(9), np.empty(24)
    k, s = len(step_of_event) - 1, len(r_after)
    while True:
        while k >= 0 and step_of_event[k] == s:
            first, m = row[k] - row[0], row[k + 1] - row[k]
            _right_jacobian(turn[k, 0], turn[k, 1], turn[k, 2], J)
            _turned(J, r, True)
            if with_N:
                for j in range(24):
                    _turned(J, N[j], True)
                N[:, :] = N.T.copy()
                for j in range(24):
                    _turned(J, N[j], True)
            for a in range(m):
                temp[a] = white[first + a]
                for j in range(24):
                    temp[a] -= U[first + a, j] * r[j]
            for a in range(m):
                for j in range(24):
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
        for j in range(24):
            r_after[s, j] = r[j]
        _transposed_step(steps[s], r)
        if with_N:
            for j in range(24):
                _transposed_step(steps[s], N[j])
            N[:, :] = N.T.copy()
            for j in range(24):
                _transposed_step(steps[s], N[j])


@njit(**_OPTIONS)
def forward(steps, step_of_event, step_of_imu, row, white, U, turn, d, r_after, walk2, translation, x_imu, x_smooth):
    """Carry the smoothed correction d = E[dx | all readings] through the stretch: d <- Phi d + Q r, d <- J (d - U' y).

    At every IMU sample x_smooth = x_imu (+) d.
    """
    J = np.empty(9)
    k, i, s = 0, 0, 0
    while True:
        while i < len(step_of_imu) and step_of_imu[i] == s:
            for j in range(6):
                x_smooth[i, j] = x_imu[i, j] + d[j]
            for j in range(9, 24):
                x_smooth[i, j + 1] = x_imu[i, j + 1] + d[j]
            for j in range(6, 10):
                x_smooth[i, j] = x_imu[i, j]
            _turn(x_smooth[i], d[6], d[7], d[8])
            i += 1
        while k < len(step_of_event) and step_of_event[k] == s:
            first, m = row[k] - row[0], row[k + 1] - row[k]
            for a in range(m):
                for j in range(24):
                    d[j] -= U[first + a, j] * white[first + a]
            _right_jacobian(turn[k, 0], turn[k, 1], turn[k, 2], J)
            _turned(J, d, False)
            k += 1
        if s == len(steps):
            return
        h, q_accel, q_gyro = steps[s, 55], steps[s, 56], steps[s, 57]
        _step(steps[s], d)
        for j in range(3):
            if translation:
                v = q_accel * h
                d[j] += v * h * h / 3.0 * r_after[s, j] + 0.5 * v * h * r_after[s, 3 + j]
                d[3 + j] += 0.5 * v * h * r_after[s, j] + v * r_after[s, 3 + j]
            d[6 + j] += q_gyro * h * r_after[s, 6 + j]
        for j in range(9, 24):
            d[j] += walk2[j] * h * r_after[s, j]
        s += 1
