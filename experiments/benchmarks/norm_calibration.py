"""Norm calibration of 20,000 readings, interleaved: analytic Jacobian against SciPy's two-point differences."""

from __future__ import annotations

import time

import numpy as np

from sinan.calibration.poses.triad import calibrate_norm


def main(readings: int = 20_000, repeats: int = 7) -> dict[str, float]:
    """Median seconds of both, and their ratio."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal((readings, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    y = u * [1.02, 0.97, 1.01] + [0.2, -0.1, 0.3] + 0.01 * rng.standard_normal(u.shape)
    analytic: list[float] = []
    two_point: list[float] = []
    for _ in range(repeats):
        for use_analytic, times in ((True, analytic), (False, two_point)):
            start = time.perf_counter()
            calibrate_norm("mag", y, 1.0, "triangular", analytic=use_analytic)
            times.append(time.perf_counter() - start)
    result = {"analytic": float(np.median(analytic)), "two_point": float(np.median(two_point))}
    result["ratio"] = result["analytic"] / result["two_point"]
    return result


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:10} {value:.4f}")
