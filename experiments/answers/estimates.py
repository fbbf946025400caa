"""`sinan.estimate`: run the filter over a flight; the result is an object with tables, figures and a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from sinan.calibration.levels.assumptions import as_rows
from sinan.calibration.levels.preparation import prepared
from sinan.estimator.filter.engine import Engine
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import layout_for
from sinan.estimator.filter.smoother import SmoothedStates
from sinan.experiments.answers.asked import PLAIN, Answer, Asked
from sinan.experiments.estimate import bias_courses, estimated, score, state_table, write_states
from sinan.experiments.reference import Mounted, reference_of
from sinan.experiments.residual_loop.open_source import require_kind
from sinan.experiments.review.unseen import not_seen
from sinan.sensors.errors import InputError
from sinan.sensors.model import SensorModel
from sinan.sensors.recording import Recording
from sinan.sensors.window import clock_warnings, told_from, told_from_note

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from sinan.sensors.arrays import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Answer):
    """The result of the filter over a flight.

    Attributes
    ----------
    recording : the flight
    journal : every reading with its innovation, and whether the filter used it
    smoothed : states given all readings (fixed-interval smoother); None unless requested
    document : the numbers, as `sinan estimate --json` writes them
    reference : true or reference motion, in its own axes and on its own clock; None: there is none
    """

    recording: Recording
    journal: Journal
    smoothed: SmoothedStates | None
    document: dict[str, Any]
    reference: Mounted | None = None

    @property
    def model(self) -> FlightModel:
        """The filter's model: sensor models, noise, environment."""
        return self.journal.model

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """The sensors whose readings updated the filter."""
        return tuple(self.journal.sensors)

    def states(self) -> pd.DataFrame:
        """Nominal states and their 1-sigma over time; smoothed if the smoother was run.

        Returns
        -------
        a row at most every 0.02 s, index `t` [s]; columns `position_north` [m] ..., `qw` to `qz` (body to NED),
        `b_gyro_x` ..., and for each error state its sigma, `position_north_std` ... (attitude in rad, body axes)

        Examples
        --------
        >>> import sinan
        >>> result = sinan.estimate(sinan.simulate("hover", seed=1))
        >>> result.states()["position_down"].iloc[-1].round(0).item()
        -10.0
        """
        import pandas as pd

        names, rows = state_table(self.journal, self.smoothed)
        return pd.DataFrame(rows[:, 1:], columns=names[1:], index=pd.Index(rows[:, 0], name="t"))

    def biases(self) -> pd.DataFrame:
        """The biases at the end, each with its 1-sigma and, if known, its true value.

        Returns
        -------
        a row a component; columns `sensor`, `unit`, `value`, `sigma`, `truth`, and `off` = (value - truth) / sigma
        """
        import pandas as pd

        from sinan.experiments.report.words import bias_rows

        rows = bias_rows(self.document)
        table = pd.DataFrame(
            {
                "sensor": [row.sensor for row in rows],
                "unit": [row.unit for row in rows],
                "value": [row.value for row in rows],
                "sigma": [row.sigma for row in rows],
                "truth": [np.nan if row.truth is None else row.truth for row in rows],
            },
            index=pd.Index([row.name for row in rows], name="bias"),
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            table["off"] = (table["value"] - table["truth"]) / table["sigma"]
        return table

    def innovations(self, sensor: str) -> pd.DataFrame:
        """The innovations of one sensor, reading minus prediction.

        Parameters
        ----------
        sensor : one of `sensors`, such as "baro"

        Returns
        -------
        a row a reading, index `t` [s]; columns `nu_0` ... (the sensor's unit), `sigma_0` ... (root of the diagonal of
        S), `nis` = nu' S^-1 nu, `used` (the gate let it pass)

        Raises
        ------
        KeyError : no such sensor in this run; names those that are
        """
        import pandas as pd

        one = self.journal.stream(sensor)
        columns = {f"nu_{k}": one.nu[:, k] for k in range(one.dof)}
        columns |= {f"sigma_{k}": np.sqrt(one.S[:, k, k]) for k in range(one.dof)}
        return pd.DataFrame({**columns, "nis": one.nis, "used": one.accepted}, index=pd.Index(one.t, name="t"))

    def summary(self) -> str:
        """What `sinan estimate` prints: biases, NIS, errors against a reference, warnings."""
        from sinan.experiments.report.estimate_words import summary

        return summary(self.document["called"], self.document)

    def to_html(self, path: str | Path) -> Path:
        """Write the page of `sinan estimate --html`. Returns its path."""
        from sinan.experiments.report.estimate_page import estimate_page
        from sinan.experiments.review.drawing import drawn
        from sinan.experiments.review.of_answers import review_of_estimate

        zero = told_from(self.recording)
        courses = [replace(one, t=one.t - zero) for one in bias_courses(self.journal, self.reference)]
        review = review_of_estimate(self.recording, self.journal, self.reference)
        estimate_page(Path(path), self.document["called"], self.document, courses, drawn(review))
        return Path(path)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table of `states`. Returns its path.

        Parameters
        ----------
        path : of the CSV file; one that is there is replaced
        """
        write_states(self.journal, Path(path), self.smoothed)
        return Path(path)

    def plot_biases(self) -> list[Axes]:
        """Each bias over time with its 3-sigma band; black: the truth, where it is known. One axes a component."""
        from sinan.experiments.report import figures, screen

        return screen.axes(lambda: figures.biases_over_time(bias_courses(self.journal, self.reference)))

    def plot_trajectory(self) -> list[Axes]:
        """The way from above and the height over time, with the truth where it is known. Two axes."""
        from sinan.experiments.report import flight_figures, screen

        t, x = self._course()
        truth = None if self.reference is None else self.reference.reference
        return screen.axes(lambda: flight_figures.trajectory(t, x, truth))

    def plot_innovations(self) -> list[Axes]:
        """The innovations of every sensor over time with the 2-sigma band that the filter expects. One axes each."""
        from sinan.experiments.report import flight_figures, screen

        return screen.axes(lambda: flight_figures.innovations(self.journal))

    def _course(self) -> tuple[FloatArray, FloatArray]:
        if self.smoothed is not None:
            return self.smoothed.t, self.smoothed.x
        return self.journal.imu_t, self.journal.imu_x


def estimate(
    recording: Recording,
    *,
    smooth: bool = False,
    relinearise: bool = False,
    sensors: Iterable[SensorModel] = (),
    engine: str = "auto",
    asked: Asked = PLAIN,
) -> Estimate:
    """Run the error-state Kalman filter over a flight.

    Parameters
    ----------
    recording : a flight; noise, heading and magnetic field are estimated from its readings if it does not declare them
    smooth : run the fixed-interval smoother too: `states` and errors are then those given all readings
    relinearise : linearise the readings about the smoothed motion, for a coarse initial attitude
    sensors : sensor models of your own (`SensorModel`); each replaces the one with the same `name`
    engine : "numba" (compiled), "filterpy" (readable; the one that runs models of your own) or "auto"
    asked : how a command was typed, for texts and file names; a script leaves it out

    Returns
    -------
    Estimate

    Raises
    ------
    InputError : not a flight; a model of your own for a sensor that the flight does not have, or with what
        only the compiled filter does (`smooth`, `relinearise`, declared effects); a state that is not finite

    Examples
    --------
    >>> import sinan
    >>> result = sinan.estimate(sinan.simulate("hover", seed=1))
    >>> bool((result.biases()["off"].abs() < 4.0).all())
    True
    >>> axes = result.plot_biases()
    """
    from sinan.experiments.report.estimate_words import coarse_note, warnings_of

    require_kind(recording, "flight", "estimate", "`sinan calibrate` or `sinan trace`")
    if engine not in get_args(Engine):
        raise InputError("--engine", engine, "one of " + ", ".join(get_args(Engine)))
    own = {sensor.name: sensor for sensor in sensors}
    if own:
        engine = _require_readable(recording, own, engine, smooth, relinearise)
    ready = prepared(recording)
    model = with_sensors(ready.model, own, recording.where).replace(relinearise=relinearise)
    journal, later, document = estimated(Flight(ready.recording, model), engine, None, smooth)  # type: ignore[arg-type]
    target = reference_of(recording)
    if recording.truth is not None and target is not None:
        document["truth"] = score(journal, recording.truth, target, later)
    document["called"], document["window"] = asked.name_of(recording), asked.window
    document["assumed"] = [name for name in document["nis"] if name not in recording.streams]
    document["noise"] = list(ready.notes)
    document["assumptions"] = as_rows(model.assumptions)
    document["notes"] += [*coarse_note(journal), *told_from_note(recording)]
    found = {size.sensor for size in ready.levels.found if size.key == "noise_std"}
    document["estimated"] = sorted(found & set(model.sensors))
    document["call"] = asked.call_of(recording)
    document["undeclared"] = [name for name in document["nis"] if recording.spec(name).noise_std is None]
    doubts = warnings_of(document, document["call"], document["undeclared"])
    document["warnings"] = [*clock_warnings(recording), *doubts]
    document["not_seen"] = not_seen(recording)
    return Estimate(recording, journal, later, document, target)


def with_sensors(model: FlightModel, own: Mapping[str, SensorModel], where: str = "sensors") -> FlightModel:
    """A model with some sensor models exchanged, and the states that their biases need.

    Raises
    ------
    InputError : a sensor that the flight does not have
    """
    if not own:
        return model
    for name in own:
        if name not in model.sensors:
            raise InputError(where, f"no sensor `{name}`", "one of " + ", ".join(model.sensors), "sensors")
    exchanged = model.replace(sensors={name: own.get(name, sensor) for name, sensor in model.sensors.items()})
    blocks = [process.block for process in exchanged.processes] + ["field"] * model.layout.has("field")
    return exchanged.replace(layout=layout_for(blocks))


def _require_readable(
    recording: Recording, own: Mapping[str, SensorModel], engine: str, smooth: bool, relinearise: bool
) -> str:
    """The engine that knows no equations of its own; the compiled one has those of the models that are shipped."""
    names = ", ".join(own)
    asked_for = {
        '"numba"': engine == "numba",
        "smooth=True": smooth,
        "relinearise=True": relinearise,
        "effects that the recording declares": bool(recording.effects),
    }
    for what, wanted in asked_for.items():
        if wanted:
            raise InputError(f"sensors={names}", what, "the readable filter alone, which runs models of your own")
    return "filterpy"
