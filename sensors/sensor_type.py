"""The declaration of a sensor: its model, and all that simulation, files, filter, calibration and reports have to know.

`sensors.registry` lists the declarations; docs/how_to_add_a_sensor.md follows one from its file to a trace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion

#: Which equations of the compiled engine are a sensor's; `form`: none, its own model is evaluated along the smoothed
#: motion of the pass before and enters linear about it; empty: it drives the filter.
Kernel = Literal["", "position", "zero", "field", "height", "range", "form"]
#: Keys of `[sensors.NAME]` that a sensor which is read now and then may declare.
PER_READING = ("noise_std", "bias_walk", "bias_std")
XYZ, NED = ("x", "y", "z"), ("north", "east", "down")
#: The columns that a map of a log may name for a quantity, and what it is in the units of maps.
Quantities = Mapping[str, tuple[tuple[str, ...], str]]


@dataclass(frozen=True)
class Given:
    """What a sensor model is constructed from: declared noise and bias and, for simulation, the instrument's limits.

    Attributes
    ----------
    sigma, bias_std, bias_walk : of one reading and of the bias, in the unit of the reading
    sigma_velocity : of a velocity, if the sensor measures one too [m/s]; else None
    angles : (beams,) of a scan [rad]
    minimum, maximum : ranges between which an echo comes back [m]
    beam_angle : largest tilt at which the ground answers [rad]
    """

    sigma: float
    bias_std: float = 0.0
    bias_walk: float = 0.0
    sigma_velocity: float | None = None
    angles: FloatArray = field(default_factory=lambda: np.zeros(1))
    minimum: float = 0.0
    maximum: float = np.inf
    beam_angle: float = np.pi / 2


@dataclass(frozen=True, eq=False)
class SensorType:
    """Declaration of one sensor; every table by sensor in the project is made from these.

    Attributes
    ----------
    name, title : name in files and states, such as `baro`, and in sentences, such as `barometer`
    make : constructs its model; None: that takes more than `Given` (a camera)
    kernel : which branch of the compiled engine has its equations
    columns : columns of its stream, one tuple for each alternative; empty: it is part of the stream `imu`
    numbered : prefix of the columns if a reading has several components: `range_` for `range_0`, `range_1`, ...
    own : further numeric columns
    declares : keys that `[sensors.NAME]` of a recording may have
    components, unit, plausible : of its step and transient effects: component names, unit, plausible 1-sigma size; no
        components: it has no such effects
    in_poses : whether a recording of poses may have it
    bias : axes of its bias in the filter's state, ("",) for a scalar; empty: it has no bias of its own
    bias_block : name of another sensor's bias block that it shares; empty: its own
    bias_optional : it has no bias unless one is declared; if False, the size of the bias must be declared
    colour : axes of the colour (first-order Gauss-Markov noise) in the filter's state, and the same for its velocity if
        `velocity` is set
    velocity : whether it may measure a velocity too
    turn : order of processing among readings with the same time stamp, smallest first
    height : (reading (1, k), roll (1,), pitch (1,)) -> height above the ground [m], to initialise the position
    height_turn : order of preference for that height, smallest first
    heard : (model, motion, softness of the ground) -> (n,) which echoes come back, in simulation; None: all
    late : scenario in which a time offset of it is observable; empty: the catalogue has no such effect
    thermometers : streams whose temperature stands for its own, in order of preference; `thermometer`: whether its own
        stream has one
    spoils : the error that its effects increase most, such as `height_rms`
    quantities : names of quantities that a map of a log may use for it
    believed_bias : prior 1-sigma of the bias if nothing is declared; 0: no bias
    levels : noise parameters that are estimated if a log does not declare them: key, and median and standard deviation
        of the logarithm of the log-normal prior
    """

    name: str
    title: str
    make: Callable[[Given], SensorModel] | None
    kernel: Kernel
    columns: tuple[tuple[str, ...], ...] = ()
    numbered: str = ""
    own: tuple[str, ...] = ()
    declares: tuple[str, ...] = PER_READING
    components: tuple[str, ...] = ()
    unit: str = ""
    plausible: float = 0.0
    in_poses: bool = False
    bias: tuple[str, ...] = ()
    bias_block: str = ""
    bias_optional: bool = False
    colour: tuple[str, ...] = ()
    velocity: bool = False
    turn: int = 2
    height: Callable[[Any, FloatArray, FloatArray, FloatArray], FloatArray] | None = None
    height_turn: int = 9
    heard: Callable[[Any, Motion, float], BoolArray] | None = None
    late: str = ""
    thermometers: tuple[str, ...] = ()
    thermometer: bool = False
    spoils: str = ""
    quantities: Quantities = field(default_factory=dict)
    believed_bias: float = 0.0
    levels: tuple[tuple[str, float, float], ...] = ()

    @property
    def stream(self) -> str:
        """The stream that holds its readings."""
        return self.name if self.columns else "imu"

    @property
    def block(self) -> str:
        """The state block of the bias that it reads."""
        return self.bias_block or f"b_{self.name}"

    @property
    def blocks(self) -> dict[str, tuple[str, ...]]:
        """The state blocks that are its own, and their axes."""
        own = {f"b_{self.name}": self.bias, f"c_{self.name}": self.colour}
        if self.velocity and self.colour:
            own[f"c_{self.name}_velocity"] = NED
        return {block: axes for block, axes in own.items() if axes}

    @property
    def bias_columns(self) -> tuple[str, ...]:
        """Names of its bias in `truth.csv`."""
        return tuple(f"bias_{self.name}_{axis}" if axis else f"bias_{self.name}" for axis in self.bias)

    @property
    def all_columns(self) -> tuple[str, ...]:
        """All columns of its stream that are numbers."""
        return tuple(dict.fromkeys((*(c for columns in self.columns for c in columns), *self.own)))

    def named(self, size: int) -> tuple[str, ...]:
        """Columns of a reading of so many components."""
        if not self.columns:
            return tuple(f"{self.name}_{axis}" for axis in self.components)
        if self.numbered and size > 1:
            return tuple(f"{self.numbered}{i}" for i in range(size))
        return self.columns[0]
