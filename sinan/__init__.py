"""sinan: sensor models, calibration, an error-state Kalman filter, and a tracer that finds the effects a model lacks.

    >>> import sinan
    >>> result = sinan.estimate(sinan.simulate("figure_eight", seed=1))
    >>> axes = result.plot_biases()

`sinan.__all__` is the public interface: names in it keep their meaning from one version to the next. Each name is
loaded when it is first used. `sinan.__version__` is the version installed.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

# Installed, the four parts lie in this folder; in a checkout beside it, so that the tree shows them at its top.
if not (Path(__file__).parent / "sensors").is_dir():
    __path__.append(str(Path(__file__).resolve().parents[1]))

if TYPE_CHECKING:
    from sinan import testing as testing
    from sinan.experiments.answers.calibrations import Calibrations as Calibrations
    from sinan.experiments.answers.calibrations import calibrate as calibrate
    from sinan.experiments.answers.consistency import Consistency as Consistency
    from sinan.experiments.answers.consistency import monte_carlo as monte_carlo
    from sinan.experiments.answers.estimates import Estimate as Estimate
    from sinan.experiments.answers.estimates import estimate as estimate
    from sinan.experiments.answers.fixes import Positions as Positions
    from sinan.experiments.answers.fixes import positions as positions
    from sinan.experiments.answers.observability import Observability as Observability
    from sinan.experiments.answers.observability import observability as observability
    from sinan.experiments.answers.recordings import cut as cut
    from sinan.experiments.answers.recordings import read as read
    from sinan.experiments.answers.recordings import simulate as simulate
    from sinan.experiments.answers.stepping import Step as Step
    from sinan.experiments.answers.stepping import steps as steps
    from sinan.experiments.answers.traces import Trace as Trace
    from sinan.experiments.answers.traces import trace as trace
    from sinan.sensors.accelerometer import Accelerometer as Accelerometer
    from sinan.sensors.barometer import Barometer as Barometer
    from sinan.sensors.camera import Camera as Camera
    from sinan.sensors.effects import CATALOGUE as effects  # noqa: F401
    from sinan.sensors.effects.declaration import Effect as Effect
    from sinan.sensors.effects.own import effect as effect
    from sinan.sensors.errors import InputError as InputError
    from sinan.sensors.gps import BaseReceiver as BaseReceiver
    from sinan.sensors.gps import Gps as Gps
    from sinan.sensors.gyroscope import Gyroscope as Gyroscope
    from sinan.sensors.laser import Laser as Laser
    from sinan.sensors.level import Level as Level
    from sinan.sensors.magnetometer import Magnetometer as Magnetometer
    from sinan.sensors.model import SensorModel as SensorModel
    from sinan.sensors.motion import Motion as Motion
    from sinan.sensors.recording import Recording as Recording
    from sinan.sensors.sonar import Sonar as Sonar

    __version__: str

#: Where each name of the face is: module, and the name there where it is another.
_FACE: dict[str, tuple[str, str]] = {
    "read": ("experiments.answers.recordings", "read"),
    "simulate": ("experiments.answers.recordings", "simulate"),
    "cut": ("experiments.answers.recordings", "cut"),
    "Recording": ("sensors.recording", "Recording"),
    "estimate": ("experiments.answers.estimates", "estimate"),
    "Estimate": ("experiments.answers.estimates", "Estimate"),
    "steps": ("experiments.answers.stepping", "steps"),
    "Step": ("experiments.answers.stepping", "Step"),
    "trace": ("experiments.answers.traces", "trace"),
    "Trace": ("experiments.answers.traces", "Trace"),
    "calibrate": ("experiments.answers.calibrations", "calibrate"),
    "Calibrations": ("experiments.answers.calibrations", "Calibrations"),
    "observability": ("experiments.answers.observability", "observability"),
    "Observability": ("experiments.answers.observability", "Observability"),
    "monte_carlo": ("experiments.answers.consistency", "monte_carlo"),
    "Consistency": ("experiments.answers.consistency", "Consistency"),
    "positions": ("experiments.answers.fixes", "positions"),
    "Positions": ("experiments.answers.fixes", "Positions"),
    "effects": ("sensors.effects", "CATALOGUE"),
    "effect": ("sensors.effects.own", "effect"),
    "Effect": ("sensors.effects.declaration", "Effect"),
    "Motion": ("sensors.motion", "Motion"),
    "SensorModel": ("sensors.model", "SensorModel"),
    "Accelerometer": ("sensors.accelerometer", "Accelerometer"),
    "Gyroscope": ("sensors.gyroscope", "Gyroscope"),
    "Magnetometer": ("sensors.magnetometer", "Magnetometer"),
    "Barometer": ("sensors.barometer", "Barometer"),
    "Gps": ("sensors.gps", "Gps"),
    "BaseReceiver": ("sensors.gps", "BaseReceiver"),
    "Sonar": ("sensors.sonar", "Sonar"),
    "Laser": ("sensors.laser", "Laser"),
    "Camera": ("sensors.camera", "Camera"),
    "Level": ("sensors.level", "Level"),
    "InputError": ("sensors.errors", "InputError"),
    "testing": ("testing", ""),
}
__all__ = [*_FACE]


def __getattr__(name: str) -> object:
    """A name of the face, loaded when it is first asked for."""
    if name == "__version__":
        from sinan.experiments.report.made import sinan_version

        return sinan_version()
    if name not in _FACE:
        from difflib import get_close_matches

        near = get_close_matches(name, _FACE, n=1)
        hint = f"; is it `{near[0]}`?" if near else ""
        raise AttributeError(f"module 'sinan' has no attribute '{name}'{hint}")
    module, there = _FACE[name]
    found = import_module(f"sinan.{module}")
    value: object = getattr(found, there) if there else found
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_FACE, "__version__"})
