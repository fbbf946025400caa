"""Calibrations that makers and authors published for units whose readings are among the data sets.

corrected = A (reading + offset), in the readings' own unit and axes as the maps deliver them; |corrected| is constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True)
class Published:
    """A published calibration of one triad.

    Attributes
    ----------
    A, offset : (3, 3), (3,) corrected = A (reading + offset)
    source : whose it is
    """

    A: FloatArray
    offset: FloatArray
    source: str

    def spread(self, reading: FloatArray) -> float:
        """RMS deviation of the corrected norm from its mean, over that mean: scale is nobody's merit."""
        norm = np.linalg.norm((reading + self.offset) @ self.A.T, axis=1)
        return float(np.std(norm) / np.mean(norm))


def _diagonal(K: tuple[float, ...], offset: tuple[float, ...], source: str) -> Published:
    return Published(np.diag(K), np.array(offset), source)


def _dorveaux(A: list[list[float]], B: list[float], source: str) -> Published:
    """unit field = A m + B, m in counts, of which the map makes 3000 a unit."""
    return Published(3000.0 * np.array(A), np.linalg.solve(np.array(A), np.array(B)) / 3000.0, source)


_COURSE = "Quan, Dai, Wang, course slides"
#: The map turns counts into (counts - 32768) / 415, counts per m/s^2.
_XSENS_B = (32768.0 - np.array([33124.2, 33275.2, 32364.4])) / 415.0
_XSENS_T = np.array([[1.0, 0.0, 0.0], [-0.00354989, 1.0, 0.0], [-0.00890444, -0.0213032, 1.0]])

#: By input and sensor; two where it is not said which of two belongs to a log.
PUBLISHED: Mapping[tuple[str, str], tuple[Published, ...]] = {
    ("rfly_course/AccRaw.mat", "accel"): (
        _diagonal((0.9912, 0.9974, 0.9947), (0.0168, 0.2691, 0.1253), _COURSE),
    ),
    ("xsens_mti_imu_tk/xsens_acc.mat.gz", "accel"): (
        Published(_XSENS_T @ np.diag(415.0 / np.array([414.478, 412.102, 414.538])), _XSENS_B, "imu_tk, third party"),
    ),
}  # fmt: skip
_QMC = (
    _dorveaux(
        [[9.245237e-4, -3.688389e-6, 3.453669e-6], [-5.322591e-5, 1.348658e-3, -4.036563e-5],
         [-1.267906e-5, -4.911390e-5, 6.250404e-4]], [-5.704758, 0.126012, -2.063141], "T. Suarez, parameter file",
    ),
    _dorveaux(
        [[9.239633e-4, -2.282760e-5, -1.264916e-5], [-3.264637e-5, 1.394196e-3, -8.316409e-5],
         [9.246627e-7, 5.043424e-5, 6.255307e-4]], [-5.674257, 0.139953, -2.193756], "T. Suarez, description",
    ),
)  # fmt: skip
PUBLISHED = {
    **PUBLISHED,
    **{(f"qmc5883l_mag_calib/{name}_raw_data.csv", "mag"): _QMC for name in ("noisy", "filtered")},
}

#: By input and sensor: effect, published parameters in its order, whose. Non-orthogonalities of the MPU-9150 are
#: printed in deg, scales in %. The norm sees the sum of a pair of off-diagonal elements: triangular matrices compare.
_MPU9150 = "27th ICINS 2020, IEEE document 9133804"
_DEG, _PERCENT = np.pi / 180.0, 0.01
PARAMETERS: Mapping[tuple[str, str], tuple[str, FloatArray, str]] = {
    ("xsens_mti_imu_tk/xsens_acc.mat.gz", "accel"): (
        "accel.cross_axis", np.array([0.00354989, 0.00890444, 0.0213032]), "imu_tk, third party",
    ),
    **{
        (f"mpu9150_imu_calib/imu{k}.log", "accel"): ("accel.cross_axis", _DEG * np.array(m), _MPU9150)
        for k, m in enumerate(((0.02, 0.317, 0.123), (-0.01, 0.145, -0.284), (-0.012, 0.282, 0.26)))
    },
    **{
        (f"mpu9150_imu_calib/imu{k}.log", "gyro"): ("gyro.scale", _PERCENT * np.array(s), _MPU9150)
        for k, s in enumerate(((0.041, 0.457, 0.826), (0.007, 0.26, -0.179), (-0.058, 0.277, 0.242)))
    },
}  # fmt: skip


#: Delays [s] to which the author of logs had set his own filter (`timing.txt` in each log): settings, not certified.
#: That of the GPS is the one of positions; of velocities it is 0.23 s.
SETTINGS: Mapping[str, Mapping[str, float]] = {
    f"inertialnav_quads/{log}.zip": {"gps.latency": 0.21, "mag.time_offset": 0.03, "baro.time_offset": 0.35}
    for log in ("f450_glitch_log", "quad106", "quad123", "quadOptFlowLogData")
}


def published(name: str, sensor: str) -> tuple[Published, ...]:
    """What is published for a log's sensor; none for most."""
    return PUBLISHED.get((name, sensor), ())
