"""Where each state lives: the one owner of indices.

Error state ``dx``, block after block: position (NED, m), velocity (NED, m/s), attitude (``dtheta_b``, rad, with
``C_true = C Exp(dtheta_b)``), then the biases of the sensors and the colour of their noise (reading = truth + bias +
colour + white noise), what the gyroscope's scale and axes and the compass's axes err by, and the error of the magnetic
field (NED).
Nominal state ``x``: the same with the attitude as a quaternion ``q_nb``, so it is one longer.
"""

from __future__ import annotations

from builtins import slice as Slice
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinan.sensors.arrays import FloatArray
from sinan.sensors.registry import sensors
from sinan.sensors.rotation import quaternion_conjugate, quaternion_exp, quaternion_log, quaternion_multiply
from sinan.sensors.sensor_type import NED, XYZ

#: The blocks that drive the process and are always there.
PROCESS_BLOCKS = ("position", "velocity", "attitude", "b_accel", "b_gyro")
#: Where the process is, in every layout: in the nominal state, and in the error state (P, sigmas, rows of H).
P_N, V_N, Q_NB, X_BIASES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, None)
B_ACCEL, B_GYRO, B_IMU = slice(10, 13), slice(13, 16), slice(10, 16)
DP, DV, DTHETA, DB_ACCEL, DB_GYRO = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15)
D_MOTION, D_BIASES = slice(0, 9), slice(9, None)
PV = slice(0, 6)  # position and velocity, in either
#: Elements of a (3, 3) matrix of body axes, row by row.
MATRIX = tuple(f"{row}{column}" for row in XYZ for column in XYZ)
#: Length of a row of the covariance inside the kernels, the most states of a filter: 7 * 8, of vector registers of
#: eight; all shipped sensors together have 54.
CAPACITY = 56


def blocks() -> dict[str, tuple[str, ...]]:
    """The axes of every block in the order in which they are laid out: the process, the sensors' biases, the colour of
    their noise, the axes of gyroscope and compass, the field; of biases and of colours the vectors come first.
    """
    own = [block for entry in sensors() for block in entry.blocks.items()]
    laid: dict[str, tuple[str, ...]] = {"position": NED, "velocity": NED, "attitude": XYZ}
    for kind in ("b_", "c_"):
        of_kind = [(name, axes) for name, axes in own if name.startswith(kind)]
        laid |= sorted(of_kind, key=lambda block: -len(block[1]))
    return {**laid, "c_zero_rate": XYZ, "s_gyro": MATRIX, "s_mag": XYZ, "field": NED}


def size_of(block: str) -> int:
    """Number of states of a block."""
    return len(blocks()[block])


@dataclass(frozen=True)
class StateLayout:
    """Blocks of the error state by name.

    Attributes
    ----------
    names : the blocks, in order; the five of the process first
    """

    names: tuple[str, ...] = (*PROCESS_BLOCKS, "b_mag", "b_gps", "b_baro")
    _slices: Mapping[str, Slice] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        there = blocks()
        known = [name for name in there if name in self.names]
        if list(self.names) != known or self.names[:5] != PROCESS_BLOCKS:
            raise ValueError(f"`names` is {self.names}; expected the five process blocks, then some of {list(there)}")
        ends = np.cumsum([len(there[name]) for name in self.names])
        if ends[-1] > CAPACITY:
            raise ValueError(f"{ends[-1]} states of {', '.join(self.names)}; the filter has room for {CAPACITY}")
        slices = {n: Slice(int(end) - len(there[n]), int(end)) for n, end in zip(self.names, ends, strict=True)}
        object.__setattr__(self, "_slices", slices)

    @property
    def n(self) -> int:
        """Number of error states: 22 with magnetometer, GPS and barometer biases."""
        return int(self._slices[self.names[-1]].stop)

    def has(self, name: str) -> bool:
        """Whether the block is there."""
        return name in self.names

    def start(self, name: str) -> int:
        """First index of a block in the error state."""
        if name not in self.names:
            raise KeyError(f"no state block `{name}`; there are {', '.join(self.names)}")
        return int(self._slices[name].start)

    def slice(self, name: str) -> Slice:
        """The block in the error state, in P and in a row of H."""
        self.start(name)
        return self._slices[name]

    def nominal(self, name: str) -> Slice:
        """The block in the nominal state; attitude is the quaternion."""
        start = self.start(name)
        if name == "attitude":
            return Slice(start, start + 4)
        shift = 1 if start > 6 else 0
        return Slice(start + shift, self._slices[name].stop + shift)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of every error state, such as `b_accel_x`."""
        there = blocks()
        return tuple(f"{name}_{axis}" if axis else name for name in self.names for axis in there[name])

    def retract(self, x: FloatArray, dx: FloatArray) -> FloatArray:
        """x (+) dx: adds, and turns the attitude, q <- q * exp(dtheta_b); (..., n + 1), (..., n) -> (..., n + 1)."""
        moved = np.concatenate([x[..., PV] + dx[..., PV], x[..., Q_NB], x[..., X_BIASES] + dx[..., D_BIASES]], axis=-1)
        moved[..., Q_NB] = quaternion_multiply(x[..., Q_NB], quaternion_exp(dx[..., DTHETA]))
        return moved

    def difference(self, x_true: FloatArray, x: FloatArray) -> FloatArray:
        """dx with x_true = x (+) dx; (..., n + 1) -> (..., n)."""
        turn = quaternion_multiply(quaternion_conjugate(x[..., Q_NB]), x_true[..., Q_NB])
        parts = [x_true[..., PV] - x[..., PV], quaternion_log(turn), x_true[..., X_BIASES] - x[..., X_BIASES]]
        return np.concatenate(parts, axis=-1)


def layout_for(bias_blocks: Sequence[str]) -> StateLayout:
    """The process blocks and the named bias blocks, in the fixed order."""
    return StateLayout(tuple(name for name in blocks() if name in PROCESS_BLOCKS or name in bias_blocks))


def states_of(bias_blocks: Sequence[str]) -> int:
    """Number of error states of the process blocks and the named bias blocks."""
    there = blocks()
    return sum(len(there[name]) for name in {*PROCESS_BLOCKS, *bias_blocks})
