"""Errors of ranges that change with time: Gauss-Markov processes, what they are like, and draws of them.

    first order:   R(tau) = s^2 exp(-|tau| / T)
    second order:  R(tau) = s^2 exp(-w |tau|) (cos w tau + sin w |tau|),  w = w0 / sqrt(2),  w0 = sqrt(2) / T

The second-order one has a rate, which a correction can carry; its spectrum is that by which the clocks of GPS were
made worse on purpose until May 2000 ("selective availability"): s = 23 m, w0 = 0.012 rad/s (RTCA DO-208, appendix B).

Source: A. Gelb, Applied Optimal Estimation (1974), table 2.2-1; C. Van Loan, IEEE Trans. AC 23 (1978) 395.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True)
class RangeError:
    """A stationary Gauss-Markov process.

    Attributes
    ----------
    sigma : 1-sigma [m]
    time : T of its autocovariance [s]
    order : 1 or 2
    """

    sigma: float
    time: float
    order: int = 1

    def autocovariance(self, tau: FloatArray) -> FloatArray:
        """R(tau) [m^2] of any shape [s]."""
        x = np.abs(tau) / self.time
        shape = np.exp(-x) if self.order == 1 else np.exp(-x) * (np.cos(x) + np.sin(x))
        return np.asarray(self.sigma**2 * shape)

    def draw(self, t: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """(instants, count) independent processes [m], exactly distributed at the instants.

        Parameters
        ----------
        t : (instants,) rising [s]
        count : of processes
        rng : random numbers
        """
        w0_2 = 2.0 / self.time**2
        if self.order == 1:
            A, P = np.array([[-1.0 / self.time]]), np.array([[self.sigma**2]])
        else:
            A, P = np.array([[0.0, 1.0], [-w0_2, -2.0 / self.time]]), np.diag([1.0, w0_2]) * self.sigma**2
        x = np.sqrt(P) @ rng.standard_normal((len(P), count))
        drawn = np.empty((len(t), count))
        step = -1.0
        for k in range(len(t)):
            if k:
                if abs(t[k] - t[k - 1] - step) > 1e-9:
                    step = float(t[k] - t[k - 1])
                    Phi = expm(A * step)
                    Q = P - Phi @ P @ Phi.T
                    root = np.linalg.cholesky(Q + 1e-15 * P)
                x = Phi @ x + root @ rng.standard_normal((len(P), count))
            drawn[k] = x[0]
        return drawn


def aged_variance(
    errors: tuple[RangeError, ...], base_variance: float, back: FloatArray, weight: FloatArray, age: float
) -> float:
    """Variance of a corrected range when the correction is any weighted sum of what the base has measured [m^2].

    e(t + a) - sum_k w_k (e(t - b_k) + n_k) has the variance
    R(0) - 2 w' r + w' (K + s^2 1) w,  r_k = R(a + b_k),  K_kl = R(b_k - b_l)

    Parameters
    ----------
    errors : independent processes that both receivers see
    base_variance : s^2 of the base's white noise [m^2]
    back : (n,) how long before the correction's time each measurement was [s]
    weight : (n,) its weight in value plus rate times age
    age : a, of the correction [s]
    """
    total = base_variance * float(weight @ weight)
    for error in errors:
        K = error.autocovariance(back[:, None] - back[None, :])
        r = error.autocovariance(age + back)
        total += float(error.autocovariance(np.zeros(1))[0] - 2.0 * weight @ r + weight @ K @ weight)
    return total


def line_weights(back: FloatArray, age: float, rate: bool = True) -> FloatArray:
    """(n,) weights by which a straight line through the measurements predicts what comes `age` later.

    With fewer than three, or without the rate, the line's value at the correction's own time is held.
    """
    n = len(back)
    if n < 3:
        return np.eye(n)[int(np.argmin(back))]
    x = -back
    middle = float(np.mean(x))
    slope = (x - middle) / np.sum((x - middle) ** 2)
    at_own_time = np.full(n, 1.0 / n) - middle * slope
    return np.asarray(at_own_time + (age * slope if rate else 0.0))
