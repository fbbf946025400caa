"""Weak directions of an information matrix, and the sentence that names the states in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.observability import Information
from sinan.sensors.arrays import FloatArray

#: Readings narrow a direction to half its prior sigma where they hold three times the prior's information.
HALVED = 3.0
#: Below this share of the prior's information the readings say nothing: far under any sigma, well above rounding.
NOTHING = 1e-6
#: The same in terms of the largest singular value, for matrices whose rounding exceeds `NOTHING`.
ROUNDING = 1e-13
#: Weak directions whose information differs by less than this factor may be mixed with each other.
ALIKE = 10.0
#: Components from this share of the largest on make the title.
NAMED = 0.1
#: Further ones are named where the readings would notice them alone: with this many times the prior's information.
NOTICED = 10.0
MOST_NAMED = 5

_AXES = {"attitude_x": "roll", "attitude_y": "pitch", "attitude_z": "heading"}
_UNITS = {"position": "m", "velocity": "m/s", "attitude": "deg", "b_accel": "m/s²", "b_gyro": "deg/s", "b_mag": "",
          "b_gps": "m", "b_baro": "m", "b_sonar": "m", "b_laser": "m"}  # fmt: skip


@dataclass(frozen=True)
class Direction:
    """A combination of states that the readings hardly see.

    Attributes
    ----------
    v : (n,) unit vector in units of the prior sigmas
    information : v' Lambda v, in units of the prior's
    states : labels of the states in it, biases before the rest, the largest first
    main : those that make the title
    amounts : by label, in `unit_of`, the largest of them at one prior sigma
    """

    v: FloatArray
    information: float
    states: tuple[str, ...]
    main: tuple[str, ...]
    amounts: Mapping[str, float]

    @property
    def left(self) -> float:
        """Share of the prior sigma that the readings leave along the direction."""
        return float(1.0 / np.sqrt(1.0 + self.information))

    @property
    def title(self) -> str:
        """`accel x bias against pitch`."""
        first, *others = (name_of(label) for label in self.main)
        return f"{first} against {listed(others)}" if others else f"{first} by itself"

    @property
    def sentence(self) -> str:
        """What looks like what, with sizes, and how much of it is left."""
        first, *others = self.states
        unseen = self.information < NOTHING
        left = f"{100.0 * self.left:.0f} % of the prior sigma stay"
        if not others:
            return f"{self.title}: {'no reading shows it' if unseen else left}"
        sign = np.sign(self.amounts[first]) or 1.0
        looks = listed(
            [f"{amount_of(label, sign * self.amounts[label], signed=True)} of {name_of(label)}" for label in others]
        )
        trace = "leave no trace in any reading" if unseen else f"leave little trace; {left}"
        return f"{self.title}: {amount_of(first, self.amounts[first])} of {name_of(first)} with {looks} {trace}"


def name_of(label: str) -> str:
    """`b_accel_x` -> accel x bias, `attitude_y` -> pitch, `position_north` -> north position."""
    if label in _AXES:
        return _AXES[label]
    block, _, axis = label.removeprefix("b_").partition("_")
    if label.startswith("b_"):
        return f"{_sensor(block)} {axis} bias" if axis else f"{_sensor(block)} bias"
    return f"{axis} {block}"


def _sensor(block: str) -> str:
    return "GPS" if block == "gps" else block


def block_of(label: str) -> str:
    """The block of a state's label."""
    return next(block for block in _UNITS if label == block or label.startswith(f"{block}_"))


def unit_of(label: str) -> str:
    """The unit in which a state is shown; the field has that of the recording."""
    return _UNITS[block_of(label)]


def unit_in_words(label: str) -> str:
    """The same for a person: that of the field is called by its name."""
    return unit_of(label) or "field"


def shown(label: str, value: float) -> float:
    """A value in `unit_of`: angles and rates in degrees."""
    return float(np.rad2deg(value)) if unit_of(label).startswith("deg") else value


def amount_of(label: str, value: float, signed: bool = False) -> str:
    """A value that is already in `unit_of`, with its unit."""
    text = figures(value) if signed and value < 0.0 else f"{'+' if signed else ''}{figures(abs(value))}"
    return f"{text} {unit_in_words(label)}"


def figures(value: float) -> str:
    """Two significant figures, large numbers in full."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2g}"


def listed(parts: Sequence[str]) -> str:
    """a, b and c."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def spectrum(Lambda: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values (n,) of a symmetric, not negative matrix, largest first, and the directions as columns."""
    values, vectors = np.linalg.eigh(Lambda)
    return np.maximum(values[::-1], 0.0), np.asarray(vectors[:, ::-1])


def floor_of(values: FloatArray) -> float:
    """The information below which a direction counts as not seen at all."""
    return max(NOTHING, ROUNDING * float(values.max(initial=0.0)))


def rank(values: FloatArray) -> int:
    """Directions of which the readings say anything at all."""
    return int(np.sum(values > floor_of(values)))


def physical(found: Information, Lambda: FloatArray) -> FloatArray:
    """The same information in physical units: m, m/s, deg, m/s^2, deg/s, the field's own."""
    unit = np.array([1.0 / shown(label, 1.0) for label in found.labels]) / found.scale
    return np.asarray(Lambda * np.outer(unit, unit))


def weak_directions(found: Information, Lambda: FloatArray, without: Sequence[str] = ()) -> list[Direction]:
    """Directions whose sigma the readings alone would not halve, the weakest first, each turned to few states.

    Parameters
    ----------
    found : from `information`
    Lambda : (n, n) from `first_state_information`
    without : sensors that are not used: nobody asks for their biases
    """
    asked = [i for i, label in enumerate(found.labels) if block_of(label) not in {f"b_{name}" for name in without}]
    values, within = spectrum(Lambda[np.ix_(asked, asked)])
    vectors = np.zeros((len(Lambda), len(asked)))
    vectors[asked] = within
    weak = np.flatnonzero(values < HALVED)[::-1]
    floor = floor_of(values)
    groups: list[list[int]] = []
    for k in weak:
        value = max(float(values[k]), floor)
        if groups and value <= ALIKE * max(float(values[groups[-1][0]]), floor):
            groups[-1].append(int(k))
        else:
            groups.append([int(k)])
    turned = [column for group in groups for column in simple_structure(vectors[:, group]).T]
    made = [_direction(found, v, Lambda, floor) for v in turned]
    return sorted(made, key=lambda direction: (direction.information, found.index(direction.states[0])))


def _direction(found: Information, v: FloatArray, Lambda: FloatArray, floor: float) -> Direction:
    order = np.argsort(-np.abs(v))
    largest = abs(float(v[order[0]]))
    plain = [i for i in order if abs(v[i]) >= NAMED * largest]
    alone = v**2 * np.diag(Lambda)
    named = plain + [i for i in order if i not in plain and alone[i] >= NOTICED]
    biases_first = [(not found.labels[i].startswith("b_"), -round(abs(float(v[i])), 3), i) for i in named[:MOST_NAMED]]
    named = [i for _, _, i in sorted(biases_first)]
    main = [i for i in named if i in plain] if len(plain) > 1 else named
    amounts = {found.labels[i]: shown(found.labels[i], float(v[i] * found.scale[i] / largest)) for i in named}
    value = float(v @ Lambda @ v)
    return Direction(v, value if value > floor else 0.0, tuple(amounts), tuple(found.labels[i] for i in main), amounts)


def simple_structure(V: FloatArray, sweeps: int = 100) -> FloatArray:
    """(n, k) the same space spanned by directions that have few large components each (varimax).

    Maximises sum_j [mean(v_ij^4) - mean(v_ij^2)^2] over rotations of the columns.

    Source: H. F. Kaiser, "The varimax criterion for analytic rotation in factor analysis", Psychometrika 23, 1958.
    """
    k = V.shape[1]
    R, before = np.eye(k), 0.0
    for _ in range(sweeps if k > 1 else 0):
        turned = V @ R
        U, s, W = np.linalg.svd(V.T @ (turned**3 - turned * np.mean(turned**2, axis=0)))
        R = U @ W
        if s.sum() <= before * (1.0 + 1e-12):
            break
        before = float(s.sum())
    turned = V @ R
    return np.asarray(turned * np.where(turned[np.argmax(np.abs(turned), axis=0), range(k)] < 0.0, -1.0, 1.0))
