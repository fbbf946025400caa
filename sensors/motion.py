"""`Motion`: kinematics and environment of the body as arrays over time, the input of every sensor model and effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.rotation import quaternion_interpolate, rotate, rotate_back


def _absent(*shape: int) -> FloatArray:
    return np.empty((0, *shape))


_WIDTHS = {"p_n": 3, "v_n": 3, "a_n": 3, "q_nb": 4, "f_b": 3, "w_ib_b": 3, "dw_b": 3, "m_b": 3, "m_n": 3}


@dataclass(frozen=True)
class Motion:
    """Motion of the body's reference point at n instants. A quantity that is not known is empty (length 0).

    Attributes
    ----------
    t : (n,) s
    p_n, v_n, a_n : (n, 3) position [m], velocity [m/s] and acceleration [m/s^2] in NED
    q_nb : (n, 4) attitude, body -> NED, scalar first
    f_b : (n, 3) specific force [m/s^2], body
    w_ib_b, dw_b : (n, 3) angular rate [rad/s] and its time derivative [rad/s^2], body
    m_b : (n, 3) magnetic field in the body, in the unit of the recording
    m_n : (n, 3) or (1, 3) magnetic field, NED
    g_n : (3,) gravity in NED [m/s^2]
    ground_down : down coordinate of the flat ground [m]
    covariates : further quantities that effects depend on, by name, each (n,) or (n, k): `temperature` [degC] of the
        stream's own sensor, `current` [A], `throttle` [0 to 1], `airspeed` [m/s], `wind` (n, 2) [m/s] north east,
        `vibration` (n, 3) [(m/s^2)^2]
    """

    t: FloatArray
    p_n: FloatArray = field(default_factory=lambda: _absent(3))
    v_n: FloatArray = field(default_factory=lambda: _absent(3))
    a_n: FloatArray = field(default_factory=lambda: _absent(3))
    q_nb: FloatArray = field(default_factory=lambda: _absent(4))
    f_b: FloatArray = field(default_factory=lambda: _absent(3))
    w_ib_b: FloatArray = field(default_factory=lambda: _absent(3))
    dw_b: FloatArray = field(default_factory=lambda: _absent(3))
    m_b: FloatArray = field(default_factory=lambda: _absent(3))
    m_n: FloatArray = field(default_factory=lambda: _absent(3))
    g_n: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 9.80665]))
    ground_down: float = 0.0
    covariates: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        n = len(self.t)
        for name, width in _WIDTHS.items():
            value = getattr(self, name)
            lengths = (0, 1, n) if name == "m_n" else (0, n)
            if value.ndim != 2 or value.shape[1] != width or len(value) not in lengths:
                raise ValueError(f"`{name}` has shape {value.shape}; expected ({n}, {width}): one row for each of `t`")

    def __len__(self) -> int:
        return len(self.t)

    def has(self, name: str) -> bool:
        """Whether the quantity or covariate `name` is known.

        Parameters
        ----------
        name : of an attribute, such as `v_n`, or of a covariate
        """
        if name in self.covariates:
            return True
        value = getattr(self, name, None)
        return value is not None and np.size(value) > 0

    @property
    def height(self) -> FloatArray:
        """(n,) height above the flat ground [m]."""
        return self.ground_down - self.p_n[:, 2]

    def at(self, t: FloatArray) -> Motion:
        """The motion at other instants.

        Position is interpolated by cubic Hermite polynomials (exact in position and velocity at the samples), attitude
        on the sphere, specific force, rates and covariates linearly; the field in the body is turned with the attitude
        where both are known. Beyond the ends position and attitude extrapolate, everything else holds its last value.

        Parameters
        ----------
        t : (m,) s
        """
        t = np.asarray(t, dtype=np.float64)
        if len(self.t) == 1:
            return replace(self.rows(np.zeros(len(t), dtype=np.int64)), t=t)
        changed: dict[str, object] = {"t": t}
        before = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        since = np.clip(t, self.t[0], self.t[-1]) - self.t[before]

        def linear(value: FloatArray) -> FloatArray:
            step = (self.t[before + 1] - self.t[before]).reshape(-1, *(1,) * (value.ndim - 1))
            slope = (value[before + 1] - value[before]) / step
            return np.asarray(slope * since.reshape(step.shape) + value[before])

        if self.has("q_nb"):
            changed["q_nb"] = quaternion_interpolate(t, self.t, self.q_nb)
        if self.has("p_n") and self.has("v_n"):
            changed["p_n"] = _hermite(t, self.t, self.p_n, self.v_n)
        elif self.has("p_n"):
            changed["p_n"] = linear(self.p_n)
        for name in ("v_n", "a_n", "f_b", "w_ib_b", "dw_b"):
            if self.has(name):
                changed[name] = linear(getattr(self, name))
        if self.has("m_n") and len(self.m_n) > 1:
            changed["m_n"] = linear(self.m_n)
        if self.has("q_nb") and self.has("m_n"):
            changed["m_b"] = rotate_back(np.asarray(changed["q_nb"]), np.asarray(changed.get("m_n", self.m_n)))
        elif self.has("m_b"):
            changed["m_b"] = linear(self.m_b)
        changed["covariates"] = {name: linear(value) for name, value in self.covariates.items()}
        return replace(self, **changed)  # type: ignore[arg-type]

    def rows(self, keep: BoolArray | IntArray | slice) -> Motion:
        """The motion at some of its instants: a slice, a mask or indices.

        Parameters
        ----------
        keep : which rows
        """
        n = len(self.t)
        changed: dict[str, object] = {}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, np.ndarray) and entry.name != "g_n" and len(value) == n:
                changed[entry.name] = value[keep]
        changed["covariates"] = {name: value[keep] for name, value in self.covariates.items()}
        return replace(self, **changed)  # type: ignore[arg-type]

    def with_covariates(self, **covariates: FloatArray) -> Motion:
        """The same motion with further covariates, each (n,) or (n, k).

        Parameters
        ----------
        covariates : by name, a row for each of `t`; one of the same name is replaced
        """
        return replace(self, covariates={**self.covariates, **covariates})

    def acceleration_n(self) -> FloatArray:
        """(n, 3) acceleration in NED [m/s^2]: C_nb f_b + g_n, or `a_n` where that is given."""
        if self.has("a_n"):
            return self.a_n
        return rotate(self.q_nb, self.f_b) + self.g_n


def _hermite(t: FloatArray, t_known: FloatArray, p: FloatArray, v: FloatArray) -> FloatArray:
    """Cubic Hermite interpolation; linear with the end's velocity beyond the ends."""
    i = np.clip(np.searchsorted(t_known, t, side="right") - 1, 0, len(t_known) - 2)
    h = (t_known[i + 1] - t_known[i])[:, None]
    s = (np.clip(t, t_known[0], t_known[-1]) - t_known[i])[:, None] / h
    value = (
        (1 + 2 * s) * (1 - s) ** 2 * p[i]
        + s * (1 - s) ** 2 * h * v[i]
        + s**2 * (3 - 2 * s) * p[i + 1]
        + s**2 * (s - 1) * h * v[i + 1]
    )
    before = np.minimum(t - t_known[0], 0.0)[:, None] * v[0]
    after = np.maximum(t - t_known[-1], 0.0)[:, None] * v[-1]
    return value + before + after
