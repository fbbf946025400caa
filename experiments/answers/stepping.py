"""`sinan.steps`: run the readable filter step by step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.engine_filterpy import Moment, ReadableFilter, Update
from sinan.estimator.filter.events import STATUS
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.inputs import RunInputs, prepare
from sinan.estimator.filter.layout import StateLayout
from sinan.estimator.filter.run_filter import run_filter
from sinan.experiments.answers.estimates import with_sensors
from sinan.experiments.residual_loop.open_source import require_kind
from sinan.sensors.arrays import FloatArray
from sinan.sensors.model import SensorModel
from sinan.sensors.recording import Recording


@dataclass(frozen=True, eq=False)
class Step:
    """State of the filter after a prediction or an update.

    Attributes
    ----------
    kind : "start" (initial state), "predict" (x and P propagated to t by the IMU), "update" (a reading was processed)
    t : s
    sensor : the sensor of the reading; "imu" for a prediction; empty at the start
    x : (n + 1,) nominal state: position, velocity (NED, SI), quaternion body -> NED, biases
    covariance : (n, n) of the error state, in which the attitude is three small angles about the body's axes [rad]
    layout : which entries of x and of the covariance belong to which state
    status : of an update: "accepted", "gated" (rejected), "withheld", or why the reading could not be predicted
    reading, predicted, innovation : (m,) of an update: z, h(x), and z - h(x), in the sensor's unit
    H : (m, n) of an update: Jacobian of the prediction with respect to the error state
    R, S : (m, m) of an update: covariance of the noise, and of the innovation, S = H P H' + R
    K : (n, m) of an update: gain; zeros where the reading was not used
    F, Q : (n, n) of a prediction: transition matrix of the error state, and covariance of the process noise
    """

    kind: Literal["start", "predict", "update"]
    t: float
    sensor: str
    x: FloatArray
    covariance: FloatArray
    layout: StateLayout
    status: str = ""
    reading: FloatArray | None = None
    predicted: FloatArray | None = None
    innovation: FloatArray | None = None
    H: FloatArray | None = None
    R: FloatArray | None = None
    S: FloatArray | None = None
    K: FloatArray | None = None
    F: FloatArray | None = None
    Q: FloatArray | None = None

    @property
    def state(self) -> dict[str, FloatArray]:
        """The nominal state by name: `position`, `velocity`, `attitude` (quaternion w, x, y, z), `b_accel`, ..."""
        return {name: self.x[self.layout.nominal(name)] for name in self.layout.names}

    @property
    def sigma(self) -> dict[str, FloatArray]:
        """1-sigma of the error state by name; of `attitude` three angles about the body's axes [rad]."""
        std = np.sqrt(np.diag(self.covariance))
        return {name: std[self.layout.slice(name)] for name in self.layout.names}

    @property
    def nis(self) -> float | None:
        """nu' S^-1 nu of an update, chi-square with m degrees of freedom if the model is right; None: no prediction."""
        if self.innovation is None or self.S is None:
            return None
        return float(self.innovation @ np.linalg.solve(self.S, self.innovation))


def steps(recording: Recording, *, sensors: Iterable[SensorModel] = ()) -> Iterator[Step]:
    """Run the readable filter over a flight and yield after every prediction and every update.

    It is the filter of `sinan.estimate`, with the same model of the recording and, to rounding, the same states.

    Parameters
    ----------
    recording : a flight
    sensors : sensor models of your own (`SensorModel`); each replaces the one with the same `name`

    Yields
    ------
    Step

    Raises
    ------
    InputError : not a flight; a sensor that the flight does not have; a state that is not finite

    Examples
    --------
    >>> import sinan
    >>> for moment in sinan.steps(sinan.simulate("hover", seed=1)):
    ...     if moment.kind == "update" and moment.sensor == "baro":
    ...         break
    >>> moment.innovation.shape, moment.K.shape == (moment.layout.n, 1)
    ((1,), True)
    >>> bool(abs(moment.innovation[0]) < 4.0 * moment.S[0, 0] ** 0.5)
    True
    >>> moment.state["b_baro"].shape, moment.sigma["attitude"].shape
    ((1,), (3,))
    """
    require_kind(recording, "flight", "steps", "`sinan.calibrate` or `sinan.trace`")
    return _steps(ReadableFilter(_inputs(recording, sensors)))


def _inputs(recording: Recording, sensors: Iterable[SensorModel]) -> RunInputs:
    """What the last pass of the filter over a recording runs on."""
    own = {sensor.name: sensor for sensor in sensors}
    ready = prepared(recording)
    flight = Flight(ready.recording, with_sensors(ready.model, own, recording.where))
    if own:
        return prepare(flight)
    inputs = run_filter(flight).run
    assert isinstance(inputs, RunInputs)
    return inputs


def _steps(engine: ReadableFilter) -> Iterator[Step]:
    yield _step(engine, None)
    for moment in engine.steps():
        yield _step(engine, moment)


def _step(engine: ReadableFilter, moment: Moment | None) -> Step:
    """A copy of where the engine stands: what it does next changes none of it."""
    x, P, layout = engine.x.copy(), engine.ekf.P.copy(), engine.model.layout
    if moment is None:
        return Step("start", engine.t, "", x, P, layout)
    if moment.event < 0:
        return Step("predict", moment.t, "imu", x, P, layout, F=engine.ekf.F.copy(), Q=engine.ekf.Q.copy())
    events, k = engine.inputs.events, moment.event
    sensor, status = events.sensors[events.sensor[k]], STATUS[engine.outputs.status[k]]
    found: Update | None = engine.update
    if found is None:
        return Step("update", float(events.t[k]), sensor, x, P, layout, status)
    return Step(
        "update", moment.t, sensor, x, P, layout, status, found.z, found.z_pred, found.nu, found.H, found.R, found.S,
        found.K,
    )  # fmt: skip
