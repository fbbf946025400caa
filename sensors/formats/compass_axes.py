"""Whether a compass has the axes of the IMU: which of the ways to name and sign three axes its turns show.

Between two instants the field in the body turns back by what the gyroscope integrates to, v2 = C^T v1, whatever
attitude, field and place are, so that no other sensor is asked. With v = (I + E) (S m - b) of readings m, a signed
permutation S, hard iron b, soft iron and small angles E, the axes are as read (S = I), or S is one of 23 others, or
compass and gyroscope do not belong together and the field goes back to its middle by itself, m2 - m1 = A m1 + c. The
likeliest counts, by the evidence of each (Laplace's approximation) and what is known beforehand. -S explains all that S
does: a mirror image is told from a turn by the dip alone. Neglects that errors of the gyroscope differ in a pair.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.compass_pairs import Pairs, pairs_of, when_late
from sinan.sensors.formats.plausible import way_of_dip
from sinan.sensors.formats.signed_axes import SIGNED, words_of
from sinan.sensors.recording import GYRO, MAG, Recording, Stream
from sinan.sensors.rotation import cross, skew

#: The 24 of them that are turns; as read first.
TURNS = np.stack(sorted((S for S in SIGNED if np.linalg.det(S) > 0.0), key=lambda S: -float(np.trace(S))))
#: Of a hundred logs one has other axes, as of what readers and maps say: all but as read share 0.01.
_PRIOR = np.log([0.99] + [0.01 / len(TURNS)] * len(TURNS))
#: 1-sigma of what is not known, so that the worst that is sold is within two: hard iron [changes of the field], soft
#: iron and angles [1], bias of the gyroscope [rad/s], its scale [1], lateness [s].
_SIGMAS = np.repeat([10.0, 0.2, 0.1, 0.05, 0.05], [3, 9, 3, 3, 1])
#: Latenesses [s] about which the linear one is asked again: within 0.1 s none is further than a sigma from one.
_LATE = (0.05, 0.1)
#: 1-sigma of A and c: a field that is forgotten within a pair has A = -I.
_OWN = np.ones(12)
#: Log odds of 20 to 1, log(20), which leave another in question.
_ALIKE = 3.0
#: Student's t of what is left (Lange, Little and Taylor 1989: 4), and a bound of work: rounds of its weights.
_NU, _ROUNDS = 4.0, 5
#: Least sigma of what is left, as a share of the change: without noise it would be zero.
_LEAST = 0.01


class _Fit(NamedTuple):
    """Log evidence, parameters, and (n, 3) what is left of the change, of an explanation."""

    evidence: float
    beta: FloatArray
    r: FloatArray


class AxesFound(NamedTuple):
    """Of `TURNS` and of none of them: log odds against the axes as read, (25,) shares of the change left, hard iron."""

    odds: FloatArray
    left: FloatArray
    iron: FloatArray


def note_of_axes(recording: Recording, axes: FloatArray | None = None) -> list[str]:
    """A sentence where the compass has other axes than the IMU, with those that its map should say; else none.

    Parameters
    ----------
    axes : (3, 3) what the map says now
    """
    imu, mag = recording.streams.get("imu"), recording.streams.get("mag")
    if imu is None or mag is None or not imu.has(GYRO) or not mag.has(MAG):
        return []
    with np.errstate(all="ignore"):  # a damaged reading gives no number, and its pairs are left out
        found = axes_found(imu, mag)
    if found is None or not np.all(np.isfinite(found.odds)) or (best := int(np.argmax(found.odds))) in (0, len(TURNS)):
        return []
    field = Stream(mag.t, dict(zip(MAG, (mag.array(MAG) @ TURNS[best].T - found.iron[best]).T, strict=True)))
    way = way_of_dip(recording.replace(streams={**recording.streams, "mag": field}))
    turn = TURNS[best] @ (np.eye(3) if axes is None else axes)
    said = words_of(-turn if way < 0 else turn)
    said += ", a mirror image," if way < 0 else f" (of a mirror image {words_of(-turn)})" if way == 0 else ""
    alike = int(np.sum(found.odds[1 : len(TURNS)] > found.odds[best] - _ALIKE)) - 1
    said += f", or {alike} others that such turns do not tell from it," if alike else ""
    left = f"{100.0 * found.left[best]:.0f} % of the change of the field is left, as read {100.0 * found.left[0]:.0f} %"
    would = f"if those are right, axes = {said} in a map would do"
    return [f"mag: the compass does not have the axes of the gyroscope; {would}: {left}"]


def axes_found(imu: Stream, mag: Stream) -> AxesFound | None:
    """What the turns of a log say of its compass; None: there are too few pairs of readings."""
    pairs = pairs_of(imu, mag)
    if pairs is None:
        return None
    rough = [_fit(pairs, S, _SIGMAS[:3], 1.0) for S in TURNS]
    left = [pairs.weight[:, None] * fit.r for fit in rough]
    share = 1.0 / max(_colour(left[0]), _colour(min(left, key=lambda r: float(np.sum(r * r)))))
    fits = _fits(pairs, share)
    if int(np.argmax([fit.evidence for fit in fits] + _PRIOR)) not in (0, len(TURNS)):
        for late in _LATE:  # only now, since it is rare
            others = _fits(when_late(imu, pairs, late), share)
            fits = [max(pair, key=lambda fit: fit.evidence) for pair in zip(fits, others, strict=True)]
    odds = np.array([fit.evidence for fit in fits]) + _PRIOR
    squares = np.array([np.sum(fit.r**2) for fit in fits])
    iron = [pairs.unit * fit.beta[:3] + S @ pairs.middle for fit, S in zip(fits, TURNS, strict=False)]
    return AxesFound(odds - odds[0], np.sqrt(squares / np.sum((pairs.m2 - pairs.m1) ** 2)), np.array(iron))


def _fits(pairs: Pairs, share: float) -> list[_Fit]:
    """One for each of `TURNS`, and one for a field that is not that of the gyroscope."""
    return [*(_fit(pairs, S, _SIGMAS, share) for S in TURNS), _fit(pairs, None, _OWN, share)]


def _colour(r: FloatArray) -> float:
    """How many pairs say what one would that is independent: 1 + 2 sum rho_k^2 (Bartlett 1946), less what chance makes.

    Pairs overlap, and a motion that goes to and fro is that of before.
    """
    n, power = len(r), float(np.sum((r.T @ r) ** 2))
    squares = [np.sum((r[k:].T @ r[:-k]) ** 2) * (n / (n - k)) ** 2 / power for k in range(1, n // 4)]
    return 1.0 + 2.0 * max(0.0, float(np.sum(squares)) - 3.0 * len(squares) / n)


def _fit(pairs: Pairs, S: FloatArray | None, sigmas: FloatArray, share: float) -> _Fit:
    """r = weight (y + X beta) by Student's t, beta ~ N(0, sigmas^2), with the information of a `share` of the pairs."""
    n, p = len(pairs.m1), len(sigmas)
    weight = (np.ones(n) if S is None else pairs.weight)[:, None]  # what is not turned changes as much in any pair
    beta: FloatArray = np.zeros(p)
    w: FloatArray = np.ones(n)
    sigma2 = 1.0
    for _ in range(_ROUNDS):
        y, X = _own(pairs) if S is None else _turned(pairs, S, beta[:3], p)
        y, X = weight * y, (weight[:, :, None] * X).reshape(3 * n, p)
        XtW = share / sigma2 * X.T * np.repeat(w, 3)
        H = XtW @ X
        beta = np.asarray(np.linalg.solve(H + np.diag(sigmas**-2), -XtW @ y.ravel()), dtype=np.float64)
        r = y + (X @ beta).reshape(n, 3)
        r2 = np.sum(r * r, axis=1)
        sigma2 = max(float(np.sum(w * r2)) / (3.0 * n), _LEAST**2)
        w = (_NU + 3.0) / (_NU + r2 / sigma2)
    sizes = 3.0 * np.log(weight[:, 0]) - 1.5 * np.log(sigma2)
    likelihood = share * float(np.sum(sizes - 0.5 * (_NU + 3.0) * np.log1p(r2 / (_NU * sigma2))))
    occam = float(np.linalg.slogdet(np.eye(p) + sigmas[:, None] * H * sigmas)[1])
    return _Fit(likelihood - 0.5 * float(np.sum((beta / sigmas) ** 2)) - 0.5 * occam, beta, r / weight)


def _own(pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """y (n, 3) and X (n, 3, 12) of a field that goes back to its middle by itself: y - A m1 - c."""
    ones = np.concatenate([pairs.m1, np.ones((len(pairs.m1), 1))], axis=1)
    X = np.eye(3)[None, :, :, None] * ones[:, None, None, :]
    return pairs.m2 - pairs.m1, X.reshape(-1, 3, 12)


def _turned(pairs: Pairs, S: FloatArray, b: FloatArray, p: int) -> tuple[FloatArray, FloatArray]:
    """y (n, 3) and X (n, 3, p), of `_SIGMAS`: y = S m2 - C^T S m1, to first order about hard iron b.

    v1 = S m1 - b and v2 = C^T v1 stand for the readings, so that no E makes both sides nothing.
    """
    Ct, one = pairs.Ct, np.eye(3)
    u1 = pairs.m1 @ S.T
    y = pairs.m2 @ S.T - np.einsum("nij,nj->ni", Ct, u1)
    X = [Ct - one]
    if p > len(b):
        v1 = u1 - b
        v2 = np.einsum("nij,nj->ni", Ct, v1)
        E = one[None, :, :, None] * v2[:, None, None, :] - Ct[:, :, :, None] * v1[:, None, None, :]
        K = skew(v2)
        bias, scale = K * (pairs.t2 - pairs.t1)[:, None, None], K * pairs.phi[:, None, :]
        late = np.einsum("nij,nj->ni", Ct, cross(pairs.w1, v1)) - cross(pairs.w2, v2)
        X += [E.reshape(-1, 3, 9), bias, scale, late[:, :, None]]
    return y, np.concatenate(X, axis=2)
