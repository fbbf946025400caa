"""Samples of an IMU that shakes faster than it is logged.

Instants of a vibration above half the rate of a log are noise of its samples that no other sample shows. A sample is
u_k = f(t_k) + v_k, v white of variance V, and the body's own force, or rate, changes by a random walk of q per second.
The likeliest f has the least

    sum of h (u_k - f_k)^2  +  tau^2 sum of (f_{k+1} - f_k)^2 / (t_{k+1} - t_k),      tau^2 = V h / q,

h the nominal step. Of even samples of frequency nu it leaves 1 / (1 + (2 tau / h)^2 sin^2(pi nu h)), of slow ones that
is nearly 1 / (1 + (2 pi nu tau)^2), a mean with weights exp(-|t| / tau) to either side; of a constant all. It looks
ahead by tau. tau = 0 leaves the samples as they are.

Source: E. T. Whittaker, Proc. Edinburgh Math. Soc. 41, 1923, 63, with first differences in the place of third ones.
Neglects that vibration changes with the throttle; that a motion faster than tau goes, too; that what is left of v is
no longer white within tau, while the filter, and the search for what of a sample is signal, take it for white. What v
makes of a mean over longer than tau stays: it is the noise's, or the bias's.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray, IntArray

#: Stamps closer than this, as a part of the nominal step, are taken for so far apart: rounding is 2^-53 = 1e-16 of the
#: equations' largest coefficient, and would be seen.
_LEAST = 1e-3


def low_passed_imu(t: FloatArray, u: FloatArray, model: FlightModel, breaks: Collection[float] = ()) -> FloatArray:
    """(n, 6) specific force and rate of a body, of what its IMU reads.

    Parameters
    ----------
    t, u : (n,) [s], (n, 6) as read
    model : whose time constants they are
    breaks : first stamps of logs that follow another, which have nothing in common with it [s]
    """
    parts = ("accel", u[:, :3]), ("gyro", u[:, 3:])
    found = [low_passed(t, part, stream, model, breaks) for stream, part in parts]
    return u if all(one is part for one, (_, part) in zip(found, parts, strict=True)) else np.hstack(found)


def low_passed(
    t: FloatArray,
    values: FloatArray,
    stream: str,
    model: FlightModel,
    breaks: Collection[float] = (),
    row: IntArray | None = None,
) -> FloatArray:
    """(n, ...) what goes with the samples of accelerometer or gyroscope, as the low pass leaves it; the same object
    where there is none.

    Parameters
    ----------
    row : (n,) of a table of which some samples were put into gaps, see `ImuTable`: these lie between their neighbours
    """
    tau: float = getattr(model.low_pass, stream)
    if not tau or len(t) < 2 or not values.size:
        return values
    if row is not None and np.any(row < 0):
        from scipy.interpolate import make_interp_spline

        own = row >= 0
        left = low_passed(t[own], values[own], stream, model, breaks)
        return np.asarray(make_interp_spline(t[own], left, k=1)(t))
    from scipy.linalg import solveh_banded

    rate, log = model.rate, np.searchsorted(np.sort(np.array(list(breaks))), t, side="right")
    apart = np.maximum(np.diff(t), _LEAST / rate)
    stiff = np.where(np.diff(log) == 0, tau**2 / apart, 0.0)
    bands = np.zeros((2, len(t)))
    bands[0, 1:] = -stiff
    bands[1] = 1.0 / rate
    bands[1, 1:] += stiff
    bands[1, :-1] += stiff
    flat = values.reshape(len(t), -1) / rate
    return np.asarray(solveh_banded(bands, flat, check_finite=False)).reshape(values.shape)
