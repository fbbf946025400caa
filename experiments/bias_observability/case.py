"""The question: along which motion, with which sensors and which prior. From a scenario or from a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sinan.estimator.evidence.observability import Information, information, is_nuisance
from sinan.estimator.filter.events import ACCEPTED, ranges_of
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel
from sinan.experiments.bias_observability import segments as stretches
from sinan.experiments.bias_observability.segments import Segment
from sinan.sensors.arrays import BoolArray, FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.gps import BaseReceiver
from sinan.sensors.laser import Laser
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.registry import where
from sinan.sensors.scenario import Scenario
from sinan.sensors.sensor_type import SensorType
from sinan.sensors.sonar import Sonar
from sinan.sensors.window import WHOLE, Span, between, end_of, start_of, window

#: Readings a second of a base receiver that is only imagined [Hz]: what correction services send.
BASE_RATE = 1.0
#: Least noise that is imagined of it [m]: of a code receiver, whatever a GPS that filters its own output seems to have.
BASE_SIGMA = 0.3
#: A laser range finder that is only imagined: rate [Hz], noise [m], longest range [m]; as the scenarios have it.
LASER_RATE, LASER_SIGMA, LASER_RANGE = 20.0, 0.03, 40.0
#: Of blocks that are left out, what a reader calls them.
_LEFT_OUT = {"s_gyro": "gyro's scale and axes", "s_mag": "turn of the compass's axes"}
#: A longer flight is looked at from its start to here [s].
LONGEST = 1200.0


@dataclass(frozen=True)
class Case:
    """A motion with what is read along it.

    Attributes
    ----------
    name : of the scenario or recording
    along : "true" or "smoothed": where the error model is linearised
    model : noise, biases, environment
    motion : at the IMU's instants
    readings : by sensor, instants of the readings [s]
    told : by sensor, which components of its readings are readings at all; one that is not named: all
    P0 : (n, n) prior at the first instant
    noise : (N - 1,) variance rates of accelerometer and gyroscope, as of `estimator.filter.imu.ImuTable`
    segments : what is flown when
    rates : by sensor, readings a second [Hz]
    heard : by range sensor, which readings arrive along another motion
    imagined : sensors that are not aboard, but whose use is asked for
    notes : what was assumed
    """

    name: str
    along: str
    model: FlightModel
    motion: Motion
    readings: Mapping[str, FloatArray]
    P0: FloatArray
    noise: tuple[FloatArray, FloatArray]
    segments: tuple[Segment, ...]
    rates: Mapping[str, float]
    heard: Mapping[str, Callable[[Motion], BoolArray]]
    imagined: tuple[SensorModel, ...] = ()
    told: Mapping[str, BoolArray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def aboard(self) -> tuple[str, ...]:
        """Sensors that aid, without the imagined ones."""
        return tuple(name for name in self.readings if name not in {sensor.name for sensor in self.imagined})

    def information(self) -> Information:
        """Linearised along the motion, the imagined sensors among the others."""
        return information(
            self.model, self.motion, self.readings, self.P0, noise=self.noise, extra=self.imagined, told=self.told
        )


def is_ranging(entry: SensorType) -> bool:
    """Whether a sensor measures ranges to the ground."""
    return entry.kernel == "range"


def case_of_scenario(scenario: Scenario, seed: int = 0, span: Span = WHOLE) -> Case:
    """A scenario along its true motion, or a part of it; instants, drop-outs and echoes are those of one simulated
    flight.
    """
    from sinan.sensors.simulate import simulate

    recording = window(simulate(scenario, np.random.default_rng(seed))[0], span)
    motion = scenario.trajectory().motion
    heard: dict[str, Callable[[Motion], BoolArray]] = {}
    for name in where(is_ranging):
        if name in scenario.sensors:
            beam = scenario.sensors[name]
            echo = Sonar(1.0, 0.0, 0.0, beam.minimum, beam.maximum, beam.beam_angle).echo
            heard[name] = partial(echo, softness=beam.softness)
    flown = stretches.of_scenario(scenario)
    if span != WHOLE:
        flown = stretches.within(flown, start_of(recording), end_of(recording))
    return _case(Flight.of(recording), None, motion, flown, heard)


def case_of_recording(recording: Recording) -> Case:
    """A recording along the motion that all its readings together give; readings that the filter refused do not count.

    Noise, field and heading that the recording does not declare are taken from it, as `sinan estimate` does.

    Raises
    ------
    InputError : not a flight, or what the noise cannot be estimated from
    """
    from sinan.calibration.levels.preparation import near_level
    from sinan.estimator.filter.smoother import estimated_motion

    if recording.kind != "flight" or "imu" not in recording.streams:
        found = f'kind = "{recording.kind}"' if recording.kind != "flight" else "no stream imu"
        raise InputError(recording.where, found, "a flight with an imu stream, whose filter has biases to see")
    recording, notes = _shortened(recording)
    ready = near_level(recording)
    recording, journal = ready.recording, ready.run()
    motion = estimated_motion(journal)
    used = {
        name: journal.t[(journal.sensor == s) & (journal.status == ACCEPTED)] for s, name in enumerate(journal.sensors)
    }
    heard: dict[str, Callable[[Motion], BoolArray]] = {}
    for name in set(used) & set(where(is_ranging)):
        stream = recording.streams[name]
        column = stream[ranges_of(stream)[0]]
        heard[name] = Sonar(1.0, 0.0, 0.0, float(column.min()), float(column.max())).echo
    fixes = journal.stream("gps") if "gps" in used else None
    told = {} if fixes is None else {"gps": fixes.tells[fixes.accepted]}
    case = _case(ready.flight, used, lambda t: motion, (), heard)
    return replace(case, along="smoothed", told=told, notes=(*case.notes, *ready.notes, *notes))


def _case(
    flight: Flight,
    used: Mapping[str, FloatArray] | None,
    motion_at: Callable[[FloatArray], Motion],
    segments: tuple[Segment, ...],
    heard: Mapping[str, Callable[[Motion], BoolArray]],
) -> Case:
    from sinan.estimator.filter.inputs import prepare

    if flight.model.layout.has("field"):  # left out below: it counts as known
        flight = flight.believing(own_north=False)
    inputs, model = prepare(flight), flight.model
    if used is None:
        events = inputs.events
        accepted = events.status == ACCEPTED
        used = {name: events.t[(events.sensor == s) & accepted] for s, name in enumerate(events.sensors)}
    readings = {name: t for name, t in used.items() if len(t)}
    if not readings:
        raise InputError(
            flight.where, "no reading of an aiding sensor", "at least one: without any, no bias can be told"
        )
    motion = motion_at(inputs.imu.t)
    notes = [str(note) for note in model.notes]
    left_out = [_LEFT_OUT.get(name, name.removeprefix("c_")) for name in model.layout.names if is_nuisance(name)]
    if left_out:
        what = "noise that lasts, or an error of field or axes"
        notes.append(f"{what}, is left out ({', '.join(left_out)}): sigmas are least ones")
    imagined: list[SensorModel] = []
    for sensor, instants, note in (_base(model, readings, motion), _laser(model, readings, motion)):
        if sensor is not None:
            imagined.append(sensor)
            readings[sensor.name] = instants
            notes.append(note)
    return Case(
        name=flight.recording.name, along="true", model=model, motion=motion, readings=readings, P0=inputs.P,
        noise=(inputs.imu.q_accel, inputs.imu.q_gyro), segments=segments or stretches.of_motion(motion),
        rates={name: _rate(t) for name, t in readings.items()}, heard=heard,
        imagined=tuple(imagined), notes=tuple(notes),
    )  # fmt: skip


def _base(
    model: FlightModel, readings: Mapping[str, FloatArray], motion: Motion
) -> tuple[SensorModel | None, FloatArray, str]:
    """A base receiver where a GPS has a bias and no other looks at it."""
    if "gps" not in readings or not model.layout.has("b_gps") or "base" in readings:
        return None, np.empty(0), ""
    sigma = max(float(np.sqrt(model.sensors["gps"].R[0, 0])), BASE_SIGMA)
    note = f"base receiver: none aboard; imagined with {BASE_RATE:g} Hz and a noise of {sigma:.2g} m"
    return BaseReceiver(sigma), np.arange(motion.t[0], motion.t[-1], 1.0 / BASE_RATE), note


def _laser(
    model: FlightModel, readings: Mapping[str, FloatArray], motion: Motion
) -> tuple[SensorModel | None, FloatArray, str]:
    """A laser over known ground where heights are estimated and no range finder without a bias is aboard."""
    unbiased = any(name in readings and not model.layout.has(f"b_{name}") for name in where(is_ranging))
    if not model.translation or unbiased or "laser" in readings:
        return None, np.empty(0), ""
    instants = np.arange(motion.t[0], motion.t[-1], 1.0 / LASER_RATE)
    heard = Sonar(1.0, 0.0, 0.0, 0.0, LASER_RANGE).echo(motion.at(instants))
    note = f"laser: none aboard; imagined over flat ground with {LASER_RATE:g} Hz, a noise of {LASER_SIGMA:g} m"
    return Laser(LASER_SIGMA), instants[heard], f"{note} and {LASER_RANGE:g} m of range"


def _rate(t: FloatArray) -> float:
    return 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _shortened(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """The first `LONGEST` of a recording."""
    start, stop = start_of(recording), end_of(recording)
    if stop - start <= LONGEST:
        return recording, ()
    part = between(recording, -np.inf, start + LONGEST)
    return part, (f"only the first {LONGEST:g} s of {stop - start:.0f} s are looked at: --from and --to say which",)
