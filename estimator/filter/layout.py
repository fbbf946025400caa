"""Where each state lives: the one owner of indices.

Error state ``dx``, block after block: position (NED, m), velocity (NED, m/s), attitude (``dtheta_b``, rad, with
``C_true = C Exp(dtheta_b)``), then the biases of the sensors and the colour of their noise (reading = truth + bias +
colour + white noise), and the error of the declared magnetic field (NED).
Nominal state ``x``: the same with the attitude as a quaternion ``q_nb``, so it is one longer.
"""

from __future__ import annotations

from builtins import slice as Slice
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.rotation import quaternion_conjugate, quaternion_exp, quaternion_log, quaternion_multiply

#: Sizes of the blocks, in the order in which they are laid out; the first five drive the process and are always there.
BLOCK_SIZES = {
    "position": 3,
    "velocity": 3,
    "attitude": 3,
    "b_accel": 3,
    "b_gyro": 3,
    "b_mag": 3,
    "b_gps": 3,
    "b_baro": 1,
    "b_sonar": 1,
    "b_laser": 1,
    "c_mag": 3,
    "c_gps": 3,
    "c_gps_velocity": 3,
    "c_baro": 1,
    "c_sonar": 1,
    "c_laser": 1,
    "field": 3,
}
PROCESS_BLOCKS = ("position", "velocity", "attitude", "b_accel", "b_gyro")
#: Length of a row of the covariance inside the kernels: every block of the list above, a multiple of a vector register.
CAPACITY = 40


@dataclass(frozen=True)
class StateLayout:
    """Blocks of the error state by name.

    Attributes
    ----------
    names : the blocks, in order; the five of the process first
    """

    names: tuple[str, ...] = tuple(BLOCK_SIZES)[:8]

    def __post_init__(self) -> None:
        known = [name for name in BLOCK_SIZES if name in self.names]
        if list(self.names) != known or self.names[:5] != PROCESS_BLOCKS:
            raise ValueError(
                f"`names` is {self.names}; expected the five process blocks, then some of {list(BLOCK_SIZES)}"
            )

    @property
    def n(self) -> int:
        """Number of error states: 22 with magnetometer, GPS and barometer biases."""
        return sum(BLOCK_SIZES[name] for name in self.names)

    def has(self, name: str) -> bool:
        """Whether the block is there."""
        return name in self.names

    def start(self, name: str) -> int:
        """First index of a block in the error state."""
        if name not in self.names:
            raise KeyError(f"no state block `{name}`; there are {', '.join(self.names)}")
        return sum(BLOCK_SIZES[other] for other in self.names[: self.names.index(name)])

    def slice(self, name: str) -> Slice:
        """The block in the error state, in P and in a row of H."""
        start = self.start(name)
        return Slice(start, start + BLOCK_SIZES[name])

    def nominal(self, name: str) -> Slice:
        """The block in the nominal state; attitude is the quaternion."""
        start = self.start(name)
        if name == "attitude":
            return Slice(start, start + 4)
        shift = 1 if start > 6 else 0
        return Slice(start + shift, start + shift + BLOCK_SIZES[name])

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of every error state, such as `b_accel_x`."""
        axes = {
            "position": ("north", "east", "down"),
            "velocity": ("north", "east", "down"),
            "b_gps": ("north", "east", "down"),
            "c_gps": ("north", "east", "down"),
            "field": ("north", "east", "down"),
            "c_gps_velocity": ("north", "east", "down"),
        }
        labels: list[str] = []
        for name in self.names:
            if BLOCK_SIZES[name] == 1:
                labels.append(name)
            else:
                labels += [f"{name}_{axis}" for axis in axes.get(name, ("x", "y", "z"))]
        return tuple(labels)

    def retract(self, x: FloatArray, dx: FloatArray) -> FloatArray:
        """x (+) dx: adds, and turns the attitude, q <- q * exp(dtheta_b); (..., n + 1), (..., n) -> (..., n + 1)."""
        moved = np.concatenate([x[..., :6] + dx[..., :6], x[..., 6:10], x[..., 10:] + dx[..., 9:]], axis=-1)
        moved[..., 6:10] = quaternion_multiply(x[..., 6:10], quaternion_exp(dx[..., 6:9]))
        return moved

    def difference(self, x_true: FloatArray, x: FloatArray) -> FloatArray:
        """dx with x_true = x (+) dx; (..., n + 1) -> (..., n)."""
        turn = quaternion_multiply(quaternion_conjugate(x[..., 6:10]), x_true[..., 6:10])
        parts = [x_true[..., :6] - x[..., :6], quaternion_log(turn), x_true[..., 10:] - x[..., 10:]]
        return np.concatenate(parts, axis=-1)


def layout_for(bias_blocks: Sequence[str]) -> StateLayout:
    """The process blocks and the named bias blocks, in the fixed order."""
    return StateLayout(tuple(name for name in BLOCK_SIZES if name in PROCESS_BLOCKS or name in bias_blocks))
