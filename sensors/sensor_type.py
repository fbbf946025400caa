"""What a sensor declares of itself beside its model: all that simulation, files, filter, calibration and reports ask.

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
    """What a model is made of: declared noise and bias, and where it is simulated the limits of the instrument.

    Attributes
    ----------
    sigma, bias_std, bias_walk : of one reading and of the bias, in the unit of the reading
    sigma_velocity : of a velocity that is read too [m/s]; None: none is
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
    """One sensor as all else knows it.

    Attributes
    ----------
    name, title : in files and states, such as `baro`; in a sentence, such as `barometer`
    make : its model; None: of more than `Given` (a camera)
    kernel : its equations in the compiled engine
    columns : what a row of its stream has, one of the alternatives; none: it is part of the stream `imu`
    numbered : a reading of several components has columns of this beginning: `range_` and `range_0`, `range_1`, ...
    own : further columns that are numbers
    declares : keys of `[sensors.NAME]` in a recording
    components, unit, plausible : of a reading, and of what disturbs it in time; no components: no such effects
    in_poses : read in poses too
    bias : axes of the bias in the state, ("",) a single one; empty: no bias of its own
    bias_block : whose bias it reads; empty: its own
    bias_optional : no bias unless one is declared; else its size has to be said
    colour : axes of the colour of its noise in the state; a velocity's besides where `velocity` is set
    velocity : whether it may read a velocity too
    turn : among readings of one instant the smaller comes first
    height : height above the ground [m] that a reading (1, k) shows at a roll and a pitch (1,), for the first position
    height_turn : whose is taken first, the smaller
    heard : (n,) which readings come back, of a model along a motion over ground of a softness; None: all
    late : scenario that shows its late stamps; empty: the catalogue has no effect of them
    thermometers : streams whose temperature is taken for its own, first come; `thermometer`: its own stream has one
    spoils : the error that an effect on it spoils first, such as `height_rms`
    quantities : what a map of a log may name
    believed_bias : 1-sigma that is believed of the bias where nothing is declared; 0: none
    levels : levels of noise sought where a log declares none: key, median and spread of the logarithm of the prior
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
