"""A flight and its filter as a source of information and score.

The whitened innovations of the filter are N(0, 1) where the model is right, and W beta where an effect is missing, W
being the sensitivity pass: a linear problem with nothing left to project out, since the filter has done that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from sinan.estimator.evidence.budget import Budget, budget_of
from sinan.estimator.evidence.comb import best_tooth, whole_moves
from sinan.estimator.evidence.flights.candidates import best_starts, flight_candidates, places_alike
from sinan.estimator.evidence.flights.known_columns import KnownColumns
from sinan.estimator.evidence.flights.known_fits import KnownFits, Question
from sinan.estimator.evidence.flights.open_levels import OpenLevels
from sinan.estimator.evidence.flights.passes import Fitted, FlightPasses
from sinan.estimator.evidence.flights.prediction import SURELY_TOLD, Prediction
from sinan.estimator.evidence.intervals.doubted import doubted_in
from sinan.estimator.evidence.intervals.onsets import Rows, Step, best_onsets, declared_step, grid_of, refined
from sinan.estimator.evidence.intervals.outliers import ADDED as WRONG_DOF
from sinan.estimator.evidence.intervals.outliers import WrongReadings, wrong_among
from sinan.estimator.evidence.intervals.wrong_readings import (
    OUTLIER,
    SHORTEST,
    without_rows,
    without_wrong_readings,
    wrong_about,
    wrong_rows,
)
from sinan.estimator.evidence.probes import probes_for
from sinan.estimator.evidence.score import (
    BLOCKS,
    DETECTABLE_LAMBDA,
    Evidence,
    Statistic,
    log_evidence_of_all,
    sigma_of_wide,
    statistic_of,
    sums_by_block,
    without_prior,
)
from sinan.estimator.evidence.sensitivity import candidate_streams
from sinan.estimator.evidence.source import (
    IMPLAUSIBLE,
    FieldUnit,
    Fit,
    LocalFinding,
    Part,
    Signature,
    StreamResidual,
    field_unit,
    held_out,
)
from sinan.estimator.evidence.term import Term
from sinan.estimator.filter.effect_forms import TOLD_LATE, Terms, is_lateness, told_late_from
from sinan.estimator.filter.events import readings
from sinan.estimator.filter.faults import Note
from sinan.estimator.filter.flight import Flight, OfFlight
from sinan.estimator.filter.flight_model import DRIVERS
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.run_filter import run_filter
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.bounds import ASSUMED, Place, Speed
from sinan.sensors.covariates import covariates_for
from sinan.sensors.effects import Effect
from sinan.sensors.effects.streams import STREAMS
from sinan.sensors.errors import InputError
from sinan.sensors.held import held
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording, tells_height
from sinan.sensors.window import told_from

#: 1-sigma of what is sought, in plausible sizes, where the noise of a log is found and not declared, since nothing but
#: the prior holds what the motion hardly shows; instruments that are sold have one. A choice, half and twice of which
#: move a lateness by 0.4 % of its sigma (`bounds_of_work sold`).
SOLD = 2.0
#: Sigmas below their mean above which nine of ten estimates lie: of a normal law norm.ppf(0.9).
NINE_IN_TEN = 1.3
#: How far the end of an interval may be off before it is looked for about its own fit, as a share of the log: bound of
#: work (`bounds_of_work flight`).
_RELOCATION = 0.01
#: Times as wide as they were found that bounds of a motion are for an effect to stand without them, the step of what
#: they are found among: a choice, half of which names a step in a clean figure of eight, and twice nothing
#: (`bounds_of_work assumed`).
_LESS = 3.0


class FlightSource(OfFlight):
    """The `Source` of a flight.

    Parameters
    ----------
    flight : its gates are switched off, since a strong effect would lose its own evidence to them, and single wrong
        readings are taken out instead
    logged : where the noise is found and not declared, all readings as they were logged: an effect is then proved by
        what it predicts of withheld readings, not by one-step residuals, and wrong readings are those far from their
        neighbours, not from the filter
    open_levels : how far the sizes of the noise are open, found when a report asks; None: all are declared
    """

    def __init__(
        self,
        flight: Flight,
        logged: Recording | None = None,
        open_levels: Callable[[], OpenLevels | None] | None = None,
    ) -> None:
        self._logged, self._opened, self._open_levels = logged, flight, open_levels
        kept, self.wrong = without_wrong_readings(flight.believing(gate_level=None))
        self._passes = FlightPasses(kept, IMPLAUSIBLE if logged is None else SOLD)
        self._known_columns = KnownColumns()
        self._known = KnownFits()
        streams = [(name, self._unit_of(name)) for name in self._local_streams if name in kept.model.sensors]
        self._prediction = Prediction(self._passes, streams)
        self._starts: tuple[Fit, Mapping[Term, FloatArray]] | None = None
        self._candidates = flight_candidates(self.flight, self._passes.plain_motion)

    @property
    def flight(self) -> Flight:
        """Without the readings that were set aside, and without gates."""
        return self._passes.flight

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.recording.name

    @property
    def field(self) -> FieldUnit:
        """The unit of a magnetometer's readings."""
        return field_of(self.recording)

    @property
    def held_out_from(self) -> float:
        """Time after which readings are held out [s]."""
        return self._passes.split

    @property
    def left_out(self) -> dict[str, FloatArray]:
        """Stamps of the readings that were set aside as wrong, by stream that has any [s]."""
        streams = {name: (s.t, self.recording.streams[name].t) for name, s in self._opened.recording.streams.items()
                   if name in self.wrong and name in self.recording.streams}  # fmt: skip
        return {name: np.setdiff1d(t, kept) for name, (t, kept) in streams.items() if len(t) > len(kept)}

    @property
    def stretches(self) -> list[tuple[float, float]]:
        """Begin and end of each stretch of the IMU that no gap cuts [s]."""
        return self._passes.table.spans

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """The effects that enter a stream of the run and whose covariates vary in the recording."""
        return self._candidates

    @property
    def alike(self) -> Sequence[frozenset[str]]:
        """Places of two instruments, where only that of one relative to the other shows."""
        return places_alike(self.flight, self._candidates)

    @property
    def families(self) -> int:
        """Candidates, and step, transient and outliers of every stream."""
        return len(self._candidates) + 3 * len(self._local_streams)

    @property
    def noise_known(self) -> bool:
        """Always: the filter has noise levels, declared or from the log."""
        return True

    @property
    def _local_streams(self) -> tuple[str, ...]:
        return tuple(name for name in candidate_streams(self.model) if name in STREAMS)

    # ---- fitting

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Gauss-Newton over beta with whole filter passes in the effects' exact form; each parameter is held to zero
        with a sigma of so many plausible sizes as `FlightPasses` is given, which is in neither `std` nor `deviance`.

        What was asked before of the same readings, or is asked from its own estimate on, is not found again, nor taken
        further where it had not settled.
        """
        in_mean = [term for term in terms if term.in_mean]
        effects = [term.effect for term in in_mean]
        first = [(start or {}).get(term, np.zeros(entry.size)) for term, entry in zip(in_mean, effects, strict=True)]
        own = Terms.of(zip(effects, first, strict=True))
        asked = Question.of(in_mean, own.vector, part)
        best = self._known.of(asked, self.recording)
        if best is None:
            best = self._passes.fitted(own, part)
            self._known.add(asked, Question.of(in_mean, best.own.vector, part), best)
        values = dict(zip(in_mean, best.own.split(best.own.vector), strict=True))
        stds = dict(zip(in_mean, best.own.split(best.std), strict=True))
        for term in terms:
            if not term.in_mean:
                values[term], stds[term] = self._outlier_share(term)
        return Fit(tuple(terms), values, stds, best.deviance, part, best)

    def alone(self, fit: Fit, term: Term, evidence: Evidence) -> FloatArray:
        """By the derivatives, and where these move it by more than its sigma, by a pass with all terms as they have
        them: the fit's own unless that is likelier. A size that no derivative sees is that of the fit.
        """
        state, mine = _state(fit), self._columns_of(fit, term)
        vector = without_prior(evidence, state.own.vector)
        alone, beta = vector[mine], fit.beta[term]
        if np.all(np.abs(alone - beta) <= fit.std[term]):
            return alone
        return alone if self._passes.deviance_at(state.own.at(vector), state.motion, fit.part) < fit.deviance else beta

    # ---- evidence

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """Information and score of all candidates and of the fit's own terms, by block of time."""
        state = _state(fit)
        own = state.own.effects
        others = [] if own_terms_only else [entry for entry in self._candidates if entry.name not in fit.keys]
        columns = [*own, *others]
        if not columns:
            return Evidence((), (), np.zeros((1, 0, 0)), np.zeros((1, 0)), np.zeros(0))
        return self._evidence_of(columns, fit)

    def _evidence_of(self, columns: Sequence[Effect], fit: Fit) -> Evidence:
        """Of effects, the first of which are the fit's own."""
        own, rows = _state(fit).own.effects, self._own_rows(fit)
        W = np.hstack([rows.own, *self._columns(fit, columns[len(own) :])])
        return self._evidence_in(columns, fit, W, rows.white, rows.t)

    def _evidence_in(
        self, columns: Sequence[Effect], fit: Fit, W: FloatArray, white: FloatArray, t: FloatArray
    ) -> Evidence:
        """Of effects, the first of which are the fit's own, in rows at instants."""
        own = _state(fit).own.effects
        share = (t - self._passes.start) / (self._passes.end - self._passes.start)
        block = np.minimum((BLOCKS * share).astype(int), BLOCKS - 1)
        information, score = sums_by_block(W, white, block)
        return Evidence(
            (*fit.keys, *(entry.name for entry in columns[len(own) :])),
            tuple(entry.size for entry in columns),
            information,
            score,
            self._passes.plausible(columns),
            prior_sigma=self._passes.prior_sigma,
        )

    def starts(self, fit: Fit) -> Mapping[Term, FloatArray]:
        """First estimates of candidates in whose regressor there is a place that no sensor measures.

        A slope of the ground under a dead-reckoned position: with the slope in the model the range measures the
        position too, without it the regressor runs along a path that is metres off. The score at zero is then blind to
        it, and the likelihood has several maxima. So it is asked at one plausible size in every direction, after the
        motion has followed, and the best is where to start.
        """
        if {"gps", "base"} & set(self.model.sensors):
            return {}
        if self._starts is None or not self._starts[0].is_that_of(fit):
            named = {term.name for term in fit.terms}
            others = [entry for entry in self._candidates if entry.name not in named]
            best = best_starts(self._passes, _state(fit), fit.part, others)
            self._starts = fit, {Term(name): beta for name, beta in best.items()}
        return self._starts[1]

    def explained_by_all(self, flight: Flight) -> float:
        """What all candidates at once add to the log-likelihood of the plain model with the noise of another flight,
        their sizes integrated over.

        Raises
        ------
        InputError : no model, or no number, follows from that noise
        """
        passes = self._passes.believing(flight)
        journal, sensitivity = passes.run(self._candidates, passes.plain)
        W, white, _ = passes.rows(sensitivity, journal, "all")
        found = log_evidence_of_all(W, white, passes.plausible(self._candidates))
        if not np.isfinite(found):
            raise InputError(flight.recording.where, "noise with which the filter's numbers overflow", "less of it")
        return found

    def detectable(self, fit: Fit, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """The statistics of effects that are not in a fit, with what is detectable of them where the noise takes a part
        of it up, what the IMU's samples are decides how late a stream is, or withheld readings have to bear them out;
        as they are where all of it is declared.
        """
        levels = self._open_levels() if self._open_levels is not None and statistics else None
        if levels is not None:
            statistics = self._as_noise_leaves(fit, statistics, levels)
        return self._as_seconds_tell(fit, self._as_late_as_samples(statistics))

    def _as_noise_leaves(self, fit: Fit, statistics: Sequence[Statistic], levels: OpenLevels) -> Sequence[Statistic]:
        """With what the noise takes up of each besides."""
        effects = [Term(s.name).effect for s in statistics]
        sides = [[self._stds(fit, effects, flight) for flight in pair] for pair in levels.sides]
        found = []
        for k, s in enumerate(statistics):
            less, more = (np.array([pair[side][k] for pair in sides]) for side in (0, 1))
            found.append(replace(s, detectable_from=s.detectable_from * levels.wider(less, more)))
        return found

    def _as_late_as_samples(self, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """With no less than what is told nine times in ten for lateness of streams whose model has one that is not."""
        late = self.flight.model.latency if self._logged is not None else {}
        if not late:
            return statistics
        found, step = [], self.recording.streams["imu"].step
        for s in statistics:
            entry = Term(s.name).effect
            if is_lateness(entry) and entry.stream in late:
                std = s.detectable_from / np.sqrt(DETECTABLE_LAMBDA)
                least = told_late_from(step, std, TOLD_LATE + NINE_IN_TEN)
                s = replace(s, detectable_from=np.maximum(s.detectable_from, least))
            found.append(s)
        return found

    def _as_seconds_tell(self, fit: Fit, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """With no less than what withheld readings bear out nine times in ten, where an effect has to be: as large in
        all components as in the one that is seen best.
        """
        if not self.is_predicting:
            return statistics
        found = []
        for s in statistics:
            term = Term(s.name)
            sizes = s.detectable_from / term.effect.plausible_in(self._passes.plain_motion)
            if term.in_mean and np.min(sizes) < IMPLAUSIBLE:
                beta = np.where(np.arange(len(sizes)) == np.argmin(sizes), s.detectable_from, 0.0)
                try:
                    share = self._prediction.share_if_there(fit, Terms.of({term.effect: beta}))
                    s = replace(s, detectable_from=s.detectable_from * max(1.0, share.sigma / SURELY_TOLD))
                except (InputError, np.linalg.LinAlgError):  # with so large an effect no state follows
                    pass
            found.append(s)
        return found

    def _stds(self, fit: Fit, effects: Sequence[Effect], flight: Flight) -> list[FloatArray]:
        """1-sigma of each of some effects that are not in the fit, with the noise of another flight; NaN where no model
        follows from that.
        """
        state, passes = _state(fit), self._passes.believing(flight)
        columns = [*state.own.effects, *effects]
        try:
            journal, sensitivity = passes.run(columns, passes.along(state.own, state.motion))
            W, white, event = passes.rows(sensitivity, journal, fit.part)
            evidence = self._evidence_in(columns, fit, W, white, journal.t[event])
            return [sigma_of_wide(evidence, entry.name, fit.keys) for entry in effects]
        except (InputError, np.linalg.LinAlgError):
            return [np.full(entry.size, np.nan) for entry in effects]

    # ---- localised effects

    def local_findings(self, fit: Fit, intervals: bool = True) -> Sequence[LocalFinding]:
        """The best step and the best transient of every stream, and the wrong readings, about the fit."""
        named = {term.name for term in fit.terms}
        outliers = [found for found in self._outliers(_state(fit)) if found.term.name not in named]
        return [*self._intervals(fit), *outliers] if intervals else outliers

    def _intervals(self, fit: Fit) -> Sequence[LocalFinding]:
        """The best step and the best transient of every stream."""
        worth = float(np.log(0.01 / self.families))
        stamps = {stream: self._stamps(stream) for stream in self._local_streams}
        readings = len(_state(fit).journal.nu)
        return best_onsets(stamps, *self._span_of(fit), partial(self._step_rows, fit), readings, worth)

    def relocated(self, fit: Fit, term: Term) -> tuple[Term, FloatArray]:
        """The term with the ends of its interval where the innovations about this very fit want them; a lateness on the
        likeliest tooth of its comb.

        About the plain model a strong step is found where its first-order effect fits best, which need not be where it
        is. White + W_I beta are the innovations with the offset not taken off, linear about the motion with it.
        """
        if term.interval is None:
            return term, self._on_the_best_tooth(fit, term) if is_lateness(term.effect) else fit.beta[term]
        mine = self._columns_of(fit, term)

        def rows_of(steps: Sequence[Step]) -> Rows:
            return self._step_rows(fit, steps).without(mine, fit.beta[term])

        stream = term.name.split(".")[0]
        spacing = _RELOCATION * (self._passes.end - self._passes.start)
        stamps = self._stamps(stream)
        best = refined(rows_of, stream, term.interval, spacing, stamps, *self._span_of(fit))
        return replace(term, interval=best.interval), fit.beta[term]

    def _on_the_best_tooth(self, fit: Fit, term: Term) -> FloatArray:
        """(1,) the likeliest lateness, whole steps of the IMU from the fit's, along the motion of the fit."""
        state, mine = _state(fit), self._columns_of(fit, term)
        (plausible,) = term.effect.plausible_in(self._passes.plain_motion)

        def value(x: float) -> float:
            vector = state.own.vector
            vector[mine] = x
            held = (x / (self._passes.prior_sigma * plausible)) ** 2
            return -0.5 * (self._passes.deviance_at(state.own.at(vector), state.motion, fit.part) + held)

        moves = whole_moves(plausible, float(np.median(np.diff(self._passes.table.t))))
        return np.array([best_tooth(value, float(fit.beta[term][0]), moves)])

    def set_aside(self, fit: Fit) -> bool:
        """Take out readings that are wrong about this fit: a strong effect hides them from the plain model."""
        return self._take_out(wrong_about(self.flight, _state(fit).journal))

    def set_aside_within(self, fit: Fit, term: Term) -> bool:
        """Take out the readings in an interval that has fewer of them than the shortest disturbance.

        The first reading of a stream does not leave its neighbours, which a wide prior draws after it.
        """
        stream = term.name.split(".")[0]
        if term.interval is None or stream not in self.wrong:
            return False
        one = _state(fit).journal.stream(stream)
        inside = term.covers(one.t)
        return int(np.sum(inside)) < SHORTEST and self._take_out({stream: one.index[inside]})

    def _take_out(self, wrong: Mapping[str, IntArray]) -> bool:
        wrong = {stream: rows for stream, rows in wrong.items() if len(rows)}
        self._passes.flight = self.flight.reading(without_rows(self.recording, wrong))
        for stream, rows in wrong.items():
            found, count = self.wrong[stream]
            self.wrong[stream] = found + len(rows), count
        return bool(wrong)

    def _span_of(self, fit: Fit) -> tuple[float, float]:
        """Begin and end of the data of a fit [s]."""
        return self._passes.start, self._passes.end if fit.part == "all" else self._passes.split

    @staticmethod
    def _columns_of(fit: Fit, term: Term) -> BoolArray:
        """Which of the parameters in the fit are the term's."""
        return np.concatenate([np.full(len(fit.beta[t]), t == term) for t in fit.in_mean])

    def _stamps(self, stream: str) -> FloatArray:
        return self.recording.streams["imu" if stream in DRIVERS else stream].t

    def _own_rows(self, fit: Fit) -> Rows:
        """Of the fit's own terms, nothing wanted besides."""
        state = _state(fit)
        journal, sensitivity = state.journal, state.sensitivity
        W, white, event = self._passes.rows(sensitivity, journal, fit.part)
        sensor = np.array(journal.sensors)[journal.sensor[event]]
        return Rows(W, W[:, :0], white, sensor, journal.t[event], doubted_in(journal, event))

    def _step_rows(self, fit: Fit, steps: Sequence[Step]) -> Rows:
        rows, columns = self._own_rows(fit), self._columns(fit, [declared_step(step) for step in steps])
        return replace(rows, wanted=np.hstack([rows.wanted, *columns]))

    def _columns(self, fit: Fit, effects: Sequence[Effect]) -> list[FloatArray]:
        """(r, size) sensitivities to effects that are not in the fit, of each."""

        def computed(new: Sequence[Effect]) -> Sequence[FloatArray]:
            journal, sensitivity = self._passes.run(new, _state(fit).along)
            W, _, _ = self._passes.rows(sensitivity, journal, fit.part)
            return np.split(W, np.cumsum([entry.size for entry in new])[:-1], axis=1)

        return self._known_columns.of(fit, grid_of(self._span_of(fit)), effects, computed)

    def _outliers(self, state: Fitted) -> list[LocalFinding]:
        """Streams whose readings as recorded are wrong more often than the noise allows, with the fit's effects in."""
        if self._logged is None:
            return self._wrong_about_the_filter(state)
        return [
            LocalFinding(Term(f"{stream}.outliers"), one.gain, WRONG_DOF, one.log_p, np.array([one.share]))
            for stream, one in self._wrong_among_logged.items()
            if len(one.row) >= SHORTEST
        ]

    def _wrong_about_the_filter(self, state: Fitted) -> list[LocalFinding]:
        """Wrong readings where the noise is declared: those that the filter would not expect in as many."""
        from scipy import stats

        if max((wrong for wrong, _ in self.wrong.values()), default=0) < SHORTEST:
            return []
        along = self._passes.along(state.own, state.motion, self._opened.recording)
        journal, _ = self._passes.run([], along)
        found = []
        for stream, (before, count) in self.wrong.items():
            wrong = min(before, len(wrong_rows(journal, stream)))
            if wrong >= SHORTEST:
                tail = self.model.tail_of(stream)
                chance = 2.0 * (stats.norm.sf(OUTLIER) if tail is None else stats.t.sf(OUTLIER, tail))
                log_p = float(stats.binom.logsf(wrong - 1, count, chance))
                share = np.array([wrong / count])
                found.append(LocalFinding(Term(f"{stream}.outliers"), float(wrong), 1, log_p, share))
        return found

    @cached_property
    def _wrong_among_logged(self) -> dict[str, WrongReadings]:
        """Wrong readings of every stream that has a law, along the plain motion: what is missing there is slower."""
        assert self._logged is not None
        found = {}
        for name, sensor in self.model.sensors.items():
            if name in self.wrong and name in self._logged.streams:
                z, t = readings(self.flight.reading(self._logged), name)
                inside = (t >= self._passes.start) & (t <= self._passes.end) & ~held(z)
                error = z[inside] - sensor.predict(self._passes.plain_motion.at(t[inside]))
                if name == "gps" and not np.all(tells_height(self._logged.streams[name])[inside]):
                    error = np.delete(error, 2, axis=1)
                found[name] = wrong_among(error)
        return {name: one for name, one in found.items() if one is not None}

    def _outlier_share(self, term: Term) -> tuple[FloatArray, FloatArray]:
        stream = term.name.split(".")[0]
        wrong, count = self.wrong[stream]
        if self._logged is not None:
            one = self._wrong_among_logged[stream]
            wrong, count = len(one.row), one.readings
        share = wrong / count
        return np.array([share]), np.array([np.sqrt(max(share * (1 - share), 1e-12) / count)])

    # ---- what is in no catalogue

    def suspects(self, fit: Fit) -> Sequence[tuple[Term, Statistic]]:
        """Every probe and the evidence for it about the fit, the fit's own terms projected out."""
        state = _state(fit)
        streams = list(self._local_streams)
        own = state.own.effects
        here = {e.name for e in own}
        covariates = {s: covariates_for(self.recording, s, state.motion.t) for s in streams}
        probes = [e for e in probes_for(streams, state.motion, covariates, self.model.sensors) if e.name not in here]
        if not probes:
            return ()
        evidence = self._evidence_of([*own, *probes], fit)
        given = list(evidence.names[: len(own)])
        return [(Term(e.name, probe=e), statistic_of(evidence, e.name, given)) for e in probes]

    def faults(self) -> Sequence[tuple[str, str, float, float]]:
        """Stretches that the filter found frozen or saturated."""
        return [
            (note.stream, note.kind, note.start, note.stop)
            for note in self._passes.notes
            if isinstance(note, Note) and note.kind in ("frozen", "saturated")
        ]

    def gated(self) -> Journal:
        """The filter with its gate over the recording as it is."""
        return run_filter(self._opened, engine="numba", stride=0)

    # ---- residuals and states

    def states(self, fit: Fit) -> tuple[FloatArray, FloatArray]:
        """Time [s] and nominal state of the filter at the samples of the IMU."""
        journal, _ = self._passes.run([], _state(fit).along, stride=1)
        return journal.imu_t, journal.imu_x

    def budget(self, plain: Fit, final: Fit) -> Sequence[Budget]:
        """Of every instrument; what the model takes the motion to be is none."""
        before, after = _state(plain).journal, _state(final).journal
        names = [name for name in self.model.sensors if name not in ASSUMED]
        found = [budget_of(name, self._unit_of(name), before, after) for name in names]
        return [one for one in found if one is not None]

    @staticmethod
    def motion(fit: Fit) -> Motion:
        """The smoothed motion along which the effects of a fit were evaluated."""
        return _state(fit).motion

    @staticmethod
    def journal(fit: Fit) -> Journal:
        """The filter's pass with the effects of a fit, of which no reading is refused."""
        return _state(fit).journal

    def residuals(self, fit: Fit) -> Sequence[StreamResidual]:
        """Innovations of every sensor with the effects of the fit at their beta, over everything."""
        journal = _state(fit).journal
        rows = []
        for name in self.model.sensors:
            one = journal.stream(name)
            keep = one.accepted
            if np.any(keep):
                held = one.t[keep] > self._passes.split
                unit = self._unit_of(name)
                white = np.where(one.tells, one.white * np.sqrt(one.weight)[:, None], 0.0)
                rows.append(
                    StreamResidual(
                        name,
                        one.t[keep],
                        one.told[keep],
                        white[keep],
                        one.tells[keep],
                        held,
                        unit,
                        {},
                        one.index[keep],
                        told_from(self.recording),
                        np.diagonal(one.S[keep], axis1=1, axis2=2),
                        one.weight[keep],
                    )
                )
        return rows

    @property
    def is_predicting(self) -> bool:
        """Where the noise is found and not declared, and the log is long enough."""
        return self._logged is not None and self._prediction.is_possible

    def predicts(self, fit: Fit, without: Fit, surely: bool = True) -> bool:
        """Whether the withheld readings of all streams are predicted better."""
        share = self._prediction.share(fit, without)
        return share.is_there if surely else share.value > 0.5

    def weighed(self, fit: Fit, other: Fit, log_odds: Callable[[float], float]) -> float:
        """Odds for a fit over another, by withheld readings too; see `Share.weighed`."""
        return self._prediction.share(fit, other).weighed(log_odds)

    def bears_out(self, fit: Fit, without: Fit, log_odds: Callable[[float], float], needed: float) -> bool:
        """What withheld readings say of an effect, together with its odds; see `Share.bears_out`."""
        lasts = any(term.interval is None for term in fit.terms if term not in without.terms)
        return self._prediction.share(fit, without).bears_out(log_odds, needed, lasts)

    @property
    def assumes_motion(self) -> bool:
        """Whether place or speed are bounded."""
        return any(isinstance(one, Place | Speed) for one in self.model.sensors.values())

    def gain_assuming_less(self, fit: Fit, without: Fit) -> float:
        """With bounds of place and speed `_LESS` times as wide: they are no readings, and so no evidence."""
        if not self.assumes_motion:
            return np.inf
        sensors = self.model.sensors
        wider = {name: one.wider(_LESS) for name, one in sensors.items() if isinstance(one, Place | Speed)}
        passes = self._passes.believing(self.flight.believing(sensors={**sensors, **wider}))
        try:
            return passes.fitted(_state(without).own, "all").deviance - passes.fitted(_state(fit).own, "all").deviance
        except InputError:  # no state follows without them
            return 0.0

    def held_out(self, fit: Fit) -> Sequence[StreamResidual]:
        """Withheld readings in every part of the log, or the residuals of its last third."""
        return self._prediction.of(fit) if self.is_predicting else held_out(self.residuals(fit))

    def _unit_of(self, name: str) -> str:
        known = field_unit(float(np.linalg.norm(self.model.m_n)), self.field.name)
        return {"mag": known, "level": "m/s^2", "speed": "m/s", "zero_rate": "rad/s", "camera": "pixel"}.get(name, "m")

    def signature(self, before: Fit, term: Term, beta: FloatArray) -> Signature | None:
        """What an effect predicts for the whitened innovations of its stream, and those innovations; an effect on the
        IMU is shown in the stream where it is seen most.
        """
        if not term.in_mean:
            return None
        state = _state(before)
        entry = term.effect
        journal, sensitivity = self._passes.run([*state.own.effects, entry], state.along)
        predicted = sensitivity.rows[:, -entry.size :] @ beta
        sensor = np.asarray([journal.sensors[s] for s in journal.sensor[sensitivity.event]])
        seen = {name: float(np.sum(predicted[sensor == name] ** 2)) for name in self.model.sensors}
        stream = entry.stream if entry.stream in seen else max(seen, key=lambda name: seen[name])
        mine = sensor == stream
        t = journal.t[sensitivity.event][mine]
        return Signature(stream, t, predicted[mine], sensitivity.white[mine], "sigma")


def _state(fit: Fit) -> Fitted:
    assert isinstance(fit.detail, Fitted)
    return fit.detail


def field_of(recording: Recording) -> FieldUnit:
    """In what effects on a flight's magnetometer are said; where no current is known, throttle stands for it."""
    streams = recording.streams
    known = any("current" in streams[name] for name in ("power", "mag") if name in streams)
    return FieldUnit(recording.environment.field_unit, by_throttle=not known)
