"""Samples of an IMU that shakes faster than it is logged.

Instants of a vibration above half the rate of a log are noise in its samples that no other sample shows: integrated,
they make a velocity walk which no body has. A sample is u_k = f(t_k) + v_k, v white of variance V, and the body's own
force, or rate, changes by a random walk of q per second at most. The likeliest f has the least

    sum of h (u_k - f_k)^2  +  tau^2 sum of (f_{k+1} - f_k)^2 / (t_{k+1} - t_k),      tau^2 = V h / q,

h the nominal step. Of even samples it is their mean with weights exp(-|t| / tau) to either side: a constant stays, of a
frequency 1 / (1 + (2 pi frequency tau)^2) is left. It looks ahead by tau. tau = 0 leaves the samples as they are.

Source: E. T. Whittaker, Proc. Edinburgh Math. Soc. 41, 1923, 63, with first differences in the place of third ones.
Neglects that vibration changes with the throttle, and that one which is taken for a slow one drifts: what it makes of
the means is the bias's.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sinan.estimator.filter.flight_model import FlightModel
from sinan.sensors.arrays import FloatArray


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
    t: FloatArray, values: FloatArray, stream: str, model: FlightModel, breaks: Collection[float] = ()
) -> FloatArray:
    """(n, ...) what goes with the samples of accelerometer or gyroscope, as the low pass leaves it; the same object
    where there is none.
    """
    tau: float = getattr(model.low_pass, stream)
    if not tau or len(t) < 2 or not values.size:
        return values
    from scipy.linalg import solveh_banded

    joined = ~np.isin(t[1:], np.array(list(breaks)))
    stiff = np.where(joined, tau**2 / np.diff(t), 0.0)
    nominal = 1.0 / model.rate
    bands = np.zeros((2, len(t)))
    bands[0, 1:] = -stiff
    bands[1] = nominal
    bands[1, 1:] += stiff
    bands[1, :-1] += stiff
    return np.asarray(solveh_banded(bands, nominal * values.reshape(len(t), -1))).reshape(values.shape)
