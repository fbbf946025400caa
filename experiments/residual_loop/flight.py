"""A flight and its filter as a source of information and score.

The whitened innovations of the filter are N(0, 1) where the model is right, and W beta where an effect is missing, W
being the sensitivity pass: a linear problem with nothing left to project out, since the filter has done that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from estimator.effect_forms import Terms, declared_terms, reference_motion, stream_motion, with_covariates
from estimator.events import ACCEPTED
from estimator.faults import Note
from estimator.filter import RunInputs, run_filter
from estimator.flight_model import FlightModel
from estimator.imu import imu_table
from estimator.journal import Journal
from estimator.relinearise import COARSE_ATTITUDE
from estimator.score import Evidence, Statistic, statistic_of
from estimator.sensitivity import Sensitivity, candidate_streams, sensitivity_pass
from experiments.residual_loop.least_squares_source import SHORTEST, isolated_outliers
from experiments.residual_loop.noise_left import slow_streams
from experiments.residual_loop.onsets import (
    Rows,
    Step,
    best_onsets,
    declared_step,
    grid_of,
    log_p_beside,
    refined,
    slow_noise_of,
    slow_noise_steps,
)
from experiments.residual_loop.probes import probes_for
from experiments.residual_loop.source import Fit, LocalFinding, Part, Signature, StreamResidual
from experiments.residual_loop.step_columns import StepColumns
from experiments.residual_loop.term import Term, covariates_vary, declaration
from sensors.arrays import BoolArray, FloatArray, IntArray
from sensors.covariates import covariates_for
from sensors.effects import Effect, effects_for
from sensors.effects.streams import STREAMS
from sensors.errors import InputError
from sensors.motion import Motion
from sensors.recording import Recording

_BLOCKS = 20
_LEAST_OUTLIERS = 3
#: What is asked against the declared field cannot be asked where the field was found from the log itself.
_OF_THE_DECLARED_FIELD = ("mag.declination", "mag.scale")
#: The last third of the time is held out.
_FITTING_SHARE = 2.0 / 3.0
_MOST_STEPS, _MOST_HALVINGS = 12, 3
#: How far the end of an interval may be off before it is looked for about its own fit: share of the log.
_RELOCATION = 0.01
#: Gauss-Newton has settled when a step moves no parameter by more than this share of its sigma.
_SETTLED = 0.05
#: So has the plain model when a pass gains no more than this of -2 log L.
_SETTLED_DEVIANCE = 1.0
#: Shares of the plausible size by which a first step is limited: the regressors hold along the motion of the last pass.
_LONGEST_STEP = 20.0
#: 1-sigma of an attitude found from the first readings beyond which it is started from as it is [rad].
_WIDE_START = 0.2
#: Declared 1-sigma of the first attitude from which on its square matters: two sigma are 2 mm/s^2 [rad].
_SECOND_ORDER = 0.01


@dataclass(frozen=True)
class _State:
    journal: Journal
    betas: tuple[tuple[Effect, FloatArray], ...]
    motion: Motion
    sensitivity: Sensitivity  # to the betas


class FlightSource:
    """The `Source` of a flight.

    Parameters
    ----------
    recording : a flight
    model : from `flight_model`; its gates are switched off, since a strong effect would lose its own evidence to
        them, and single wrong readings are taken out instead
    """

    def __init__(self, recording: Recording, model: FlightModel) -> None:
        self.model = model.replace(gate_level=None)
        self._as_recorded = recording
        self.recording, self.wrong = without_wrong_readings(recording, self.model)
        self._table = imu_table(self.recording, self.model)
        self._steps: dict[Part, StepColumns] = {}
        t = self.recording.streams["imu"].t
        self._start, self._end = float(t[0]), float(t[-1])
        self._split = self._start + _FITTING_SHARE * (self._end - self._start)
        journal = run_filter(self.recording, self.model, {}, engine="numba", stride=0)
        self._notes = journal.notes
        self._plain_motion = reference_motion(self.recording, journal, declared_terms(self.recording), self._table)
        self._start_std = self._attitude_std_at_start(journal)
        if self._start_std is not None and self._start_std >= COARSE_ATTITUDE:
            self.model = self.model.replace(relinearise=True)
        self._plain_motion = self._settled(self._plain_motion)
        self._candidates = self._possible()

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.recording.name

    @property
    def held_out_from(self) -> float:
        """Time after which readings are held out [s]."""
        return self._split

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """The effects that enter a stream of the run and whose covariates vary in the recording."""
        return self._candidates

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

    def effect(self, term: Term) -> Effect:
        """The declaration behind a term, over its interval where it has one."""
        return declaration(term)

    def _possible(self) -> tuple[Effect, ...]:
        declared = set(self.recording.effects)
        guessed = self.recording.environment.magnetic_field is None
        found = []
        for entry in effects_for("flight", candidate_streams(self.model)):
            if entry.name in declared or (guessed and entry.name in _OF_THE_DECLARED_FIELD):
                continue
            if entry.stream == "level" and "gps" not in self.model.sensors:  # nothing sees the velocity it goes with
                continue
            if entry.stream in self.model.sensors:
                along = stream_motion(self.recording, self.model, entry.stream, Terms(), self._plain_motion)
            else:
                along = with_covariates(self.recording, entry.stream, self._plain_motion)
            if entry.missing(along):
                continue
            if covariates_vary(entry, along):
                found.append(entry)
        return tuple(found)

    # ---- fitting

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Gauss-Newton over beta with whole filter passes in the effects' exact form."""
        effects = [declaration(term) for term in terms if term.in_mean]
        beta = [np.asarray((start or {}).get(term, np.zeros(declaration(term).size))) for term in terms if term.in_mean]
        motion = self._plain_motion
        best: tuple[float, list[FloatArray], Journal, Motion, FloatArray, Sensitivity] | None = None
        halvings = 0
        for _ in range(_MOST_STEPS):
            try:
                if best is not None or any(np.any(b) for b in beta):  # the exact forms hold along the motion with these
                    terms_now = self._terms(effects, beta)
                    if best is None:
                        journal, _ = self._pass([], effects, beta, motion)
                    motion = reference_motion(self.recording, journal, terms_now, self._table)
                journal, sensitivity = self._pass(effects, effects, beta, motion)
                deviance = self._deviance(journal, part)
            except InputError:  # beta so far off that no state or covariance follows
                if best is None:
                    raise
                deviance = np.inf
            if best is not None and best[0] < deviance:  # too far: half the way back
                halvings += 1
                if halvings > _MOST_HALVINGS:
                    break
                beta = [0.5 * (b + good) for b, good in zip(beta, best[1], strict=True)]
                journal, motion = best[2], best[3]
                continue
            W, white = self._rows(sensitivity, journal, part)
            information = W.T @ W
            best = (deviance, beta, journal, motion, information, sensitivity)
            if not effects:
                break
            step = self._step(information, W.T @ white, effects)
            sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information, hermitian=True)), 1e-300))
            if np.all(np.abs(step) < _SETTLED * sigma):
                break
            beta = [b + s for b, s in zip(beta, np.split(step, np.cumsum([len(b) for b in beta])[:-1]), strict=True)]
        assert best is not None
        deviance, beta, journal, motion, information, sensitivity = best
        covariance = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        splits = np.split(std, np.cumsum([len(b) for b in beta])[:-1]) if beta else []
        in_mean = [term for term in terms if term.in_mean]
        values, stds = dict(zip(in_mean, beta, strict=True)), dict(zip(in_mean, splits, strict=True))
        for term in terms:
            if not term.in_mean:
                values[term], stds[term] = self._outlier_share(term)
        state = _State(journal, tuple(zip(effects, beta, strict=True)), motion, sensitivity)
        return Fit(tuple(terms), values, stds, deviance, part, state)

    def _settled(self, motion: Motion) -> Motion:
        """The motion that the plain model finds when its passes start from it: a start far off takes several."""
        best = np.inf
        for _ in range(_MOST_STEPS):
            journal, _ = self._pass([], [], [], motion)
            deviance = self._deviance(journal, "all")
            if not deviance < best - _SETTLED_DEVIANCE:
                break
            best, settled = deviance, motion
            motion = reference_motion(self.recording, journal, declared_terms(self.recording), self._table)
        return settled

    def _step(self, information: FloatArray, score: FloatArray, effects: Sequence[Effect]) -> FloatArray:
        """Newton's step, limited to `_LONGEST_STEP` plausible sizes."""
        scale = np.concatenate([entry.plausible_in(self._plain_motion) for entry in effects])
        ridge = np.diag(1.0 / (100.0 * scale) ** 2)
        step = np.linalg.solve(information + ridge, score)
        return np.asarray(step / max(float(np.max(np.abs(step) / (_LONGEST_STEP * scale))), 1.0))

    @staticmethod
    def _terms(effects: Sequence[Effect], beta: Sequence[FloatArray]) -> Terms:
        return Terms(tuple(zip(effects, beta, strict=True)))

    def _pass(
        self,
        candidates: Sequence[Effect],
        effects: Sequence[Effect],
        beta: Sequence[FloatArray],
        motion: Motion,
        recording: Recording | None = None,
    ) -> tuple[Journal, Sensitivity]:
        pairs: Any = list(zip(effects, beta, strict=True))
        return sensitivity_pass(
            self._started(recording or self.recording, motion),
            self.model,
            candidates,
            pairs,
            motion=motion,
            blocks=0,
            keep_rows=1,
            stride=0,
        )

    def _attitude_std_at_start(self, journal: Journal) -> float | None:
        """Sigma with which every pass starts at the smoothed attitude of the one before; None: as the filter starts.

        Where the recording declares no attitude, the first readings, from which it is found, have the effects in them
        that are looked for: it may be wrong by as much as a magnetometer or an accelerometer may be turned or bent. The
        sigma is no prior then; it is as wide as the filter can take and still be linear. Where it declares a coarse
        one, that is its sigma: until the tilt is found, an error theta of it lacks g theta^2 / 2 of the vertical force,
        which is of second order and passes for an error of the accelerometer.
        """
        declared = self.recording.initial.attitude_std
        if declared is not None:
            return declared if declared > _SECOND_ORDER else None
        assert isinstance(journal.run, RunInputs)
        widest = float(np.sqrt(np.linalg.eigvalsh(journal.run.P[6:9, 6:9])[-1]))
        return max(widest, COARSE_ATTITUDE) if widest < _WIDE_START else None

    def _started(self, recording: Recording, motion: Motion) -> Recording:
        """The recording with the first attitude of the reference motion, and a sigma that lets it be wrong."""
        if self._start_std is None:
            return recording
        start = replace(recording.initial, quaternion=motion.q_nb[0], attitude_std=self._start_std)
        return recording.replace(initial=start)

    def _in_part(self, t: FloatArray, part: Part) -> BoolArray:
        return np.ones(len(t), dtype=bool) if part == "all" else np.asarray(t <= self._split)

    def _rows(self, sensitivity: Sensitivity, journal: Journal, part: Part) -> tuple[FloatArray, FloatArray]:
        keep = self._in_part(journal.t[sensitivity.event], part)
        return sensitivity.rows[keep], sensitivity.white[keep]

    def _deviance(self, journal: Journal, part: Part) -> float:
        used = (journal.status == ACCEPTED) & self._in_part(journal.t, part)
        return float(-2.0 * np.sum(journal.loglik[used]))

    # ---- evidence

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """Information and score of all candidates and of the fit's own terms, by block of time."""
        state = _state(fit)
        in_mean = [term for term in fit.terms if term.in_mean]
        names = [term.key for term in in_mean]
        own = [effect for effect, _ in state.betas]
        others = [] if own_terms_only else [entry for entry in self._candidates if entry.name not in names]
        columns = [*own, *others]
        if not columns:
            return Evidence((), (), np.zeros((1, 0, 0)), np.zeros((1, 0)), np.zeros(0))
        return self._evidence_of(columns, fit, names)

    def _evidence_of(self, columns: Sequence[Effect], fit: Fit, names: Sequence[str]) -> Evidence:
        """Of effects, the first of which are the fit's own with these names."""
        state = _state(fit)
        own = [effect for effect, _ in state.betas]
        journal, sensitivity = state.journal, state.sensitivity
        if len(columns) > len(own):
            journal, sensitivity = self._pass(columns, own, [b for _, b in state.betas], state.motion)
        W, white = self._rows(sensitivity, journal, fit.part)
        t = journal.t[sensitivity.event][self._in_part(journal.t[sensitivity.event], fit.part)]
        block = np.minimum((_BLOCKS * (t - self._start) / (self._end - self._start)).astype(int), _BLOCKS - 1)
        count = int(block.max()) + 1
        information, score = np.zeros((count, W.shape[1], W.shape[1])), np.zeros((count, W.shape[1]))
        for k in range(count):
            inside = block == k
            information[k] = W[inside].T @ W[inside]
            score[k] = W[inside].T @ white[inside]
        plausible = [entry.plausible_in(self._plain_motion) for entry in columns]
        return Evidence(
            (*names, *(entry.name for entry in columns[len(own) :])),
            tuple(entry.size for entry in columns),
            information,
            score,
            np.concatenate(plausible) if plausible else np.zeros(0),
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
        named = {term.name for term in fit.terms}
        found = {}
        for entry in self._candidates:
            if entry.name not in named and self._goes_with_place(entry):
                tried = [(self._deviance_at(fit, entry, beta), beta) for beta in directions_of(entry)]
                deviance, beta = min(tried, key=lambda one: one[0])
                if deviance < fit.deviance:
                    found[Term(entry.name)] = beta
        return found

    def _goes_with_place(self, entry: Effect) -> bool:
        """Whether an effect is another one where the whole path lies elsewhere above the ground."""
        if entry.stream not in self.model.sensors:
            return False
        along = stream_motion(self.recording, self.model, entry.stream, Terms(), self._plain_motion)
        elsewhere = replace(along, p_n=along.p_n + np.array([1.0, 1.0, 0.0]))
        return not np.allclose(entry.regressor(along), entry.regressor(elsewhere), rtol=0.0, atol=1e-6)

    def _deviance_at(self, fit: Fit, entry: Effect, beta: FloatArray) -> float:
        """-2 log L of the fit with one more effect, of this size, the others as they are."""
        state = _state(fit)
        effects, betas = [*(e for e, _ in state.betas), entry], [*(b for _, b in state.betas), beta]
        try:
            journal, _ = self._pass([], effects, betas, state.motion)
            motion = reference_motion(self.recording, journal, self._terms(effects, betas), self._table)
            journal, _ = self._pass([], effects, betas, motion)
        except InputError:  # no state or covariance follows
            return float(np.inf)
        return self._deviance(journal, fit.part)

    # ---- localised effects

    def local_findings(self, fit: Fit) -> Sequence[LocalFinding]:
        """The best step and the best transient of every stream, and the wrong readings, about the fit."""
        state = _state(fit)
        worth = float(np.log(0.01 / self.families))
        stamps = {stream: self._stamps(stream) for stream in self._local_streams}
        found = best_onsets(stamps, *self._span_of(fit), partial(self._step_rows, fit), len(state.journal.nu), worth)
        named = {term.name for term in fit.terms}
        return [*found, *(o for o in self._outliers(state) if o.term.name not in named)]

    def relocated(self, fit: Fit, term: Term) -> Term:
        """The term with the ends of its interval where the innovations about this very fit want them.

        About the plain model a strong step is found where its first-order effect fits best, which need not be where it
        is. White + W_I beta are the innovations with the offset not taken off, linear about the motion with it.
        """
        if term.interval is None:
            return term
        mine = self._columns_of(fit, term)

        def rows_of(steps: Sequence[Step]) -> Rows:
            return self._step_rows(fit, steps).without(mine, fit.beta[term])

        stream = term.name.split(".")[0]
        spacing = _RELOCATION * (self._end - self._start)
        stamps = self._stamps(stream)
        best = refined(rows_of, stream, term.interval, spacing, stamps, *self._span_of(fit))
        return replace(term, interval=best.interval)

    def set_aside(self, fit: Fit) -> bool:
        """Take out readings that are wrong about this fit: a strong effect hides them from the plain model."""
        return self._take_out(wrong_about(self.recording, self.model, _state(fit).journal))

    def set_aside_within(self, term: Term) -> bool:
        """Take out the readings in an interval that has fewer of them than the shortest disturbance.

        The first reading of a stream does not leave its neighbours, which a wide prior draws after it.
        """
        stream = term.name.split(".")[0]
        if term.interval is None or stream not in self.wrong:
            return False
        t = self._stamps(stream)
        inside = np.flatnonzero((t >= term.interval[0]) & (t < term.interval[1]))
        return len(inside) < SHORTEST and self._take_out({stream: inside})

    def _take_out(self, wrong: Mapping[str, IntArray]) -> bool:
        wrong = {stream: rows for stream, rows in wrong.items() if len(rows)}
        self.recording = without_rows(self.recording, wrong)
        for stream, rows in wrong.items():
            found, count = self.wrong[stream]
            self.wrong[stream] = found + len(rows), count
        return bool(wrong)

    def log_p_beside_slow_noise(self, fit: Fit, terms: Sequence[Term]) -> list[float]:
        """Logarithm of the p-value of each term beside slow noise of those streams whose residual is slow: of a term of
        the fit as it is, of another to first order.

        All streams are asked: an error of the position is seen in every other one too.
        """
        noisy = [stream for stream in slow_streams(self.residuals(fit)) if stream in STREAMS]
        found = np.full(len(terms), -np.inf)
        for stream in noisy if terms else ():
            found = np.maximum(found, self._beside_slow_noise(fit, terms, stream))
        return [float(log_p) for log_p in found]

    def _beside_slow_noise(self, fit: Fit, terms: Sequence[Term], stream: str) -> list[float]:
        span = self._span_of(fit)
        steps = slow_noise_steps(stream, self._local_streams, span)
        columns = {s: self._step_rows(fit, of_stream).wanted for s, of_stream in steps.items()}
        rows = self._own_rows(fit)
        new = [term for term in terms if term not in fit.beta]
        found = {}
        if new:
            noise = slow_noise_of(rows, columns, stream, span)
            for term, wanted in zip(new, self._columns(fit, [declaration(term) for term in new]), strict=True):
                found[term] = log_p_beside(noise, replace(rows, wanted=wanted))
        for term in set(terms) - set(new):
            mine = self._columns_of(fit, term)
            one = replace(rows.without(mine, fit.beta[term]), wanted=rows.own[:, mine])
            found[term] = log_p_beside(slow_noise_of(one, columns, stream, span), one)
        return [found[term] for term in terms]

    def _span_of(self, fit: Fit) -> tuple[float, float]:
        """Begin and end of the data of a fit [s]."""
        return self._start, self._end if fit.part == "all" else self._split

    @staticmethod
    def _columns_of(fit: Fit, term: Term) -> BoolArray:
        """Which of the parameters in the fit are the term's."""
        in_mean = [t for t in fit.terms if t.in_mean]
        return np.concatenate([np.full(len(fit.beta[t]), t == term) for t in in_mean])

    def _stamps(self, stream: str) -> FloatArray:
        return self.recording.streams["imu" if stream in ("accel", "gyro") else stream].t

    def _own_rows(self, fit: Fit) -> Rows:
        """Of the fit's own terms, nothing wanted besides."""
        state = _state(fit)
        journal, sensitivity = state.journal, state.sensitivity
        W, white = self._rows(sensitivity, journal, fit.part)
        event = sensitivity.event[self._in_part(journal.t[sensitivity.event], fit.part)]
        sensor = np.array(journal.sensors)[journal.sensor[event]]
        return Rows(W, W[:, :0], white, sensor, journal.t[event])

    def _step_rows(self, fit: Fit, steps: Sequence[Step]) -> Rows:
        rows = self._own_rows(fit)
        kept = self._steps.setdefault(fit.part, StepColumns(grid_of(self._span_of(fit))))
        attitude = _state(fit).motion.q_nb
        wanted = kept.of(rows, attitude, steps, lambda new: self._columns(fit, [declared_step(step) for step in new]))
        return replace(rows, wanted=wanted)

    def _columns(self, fit: Fit, effects: Sequence[Effect]) -> list[FloatArray]:
        """(r, size) sensitivities to effects that are not in the fit, of each."""
        if not effects:
            return []
        state = _state(fit)
        own, beta = [e for e, _ in state.betas], [b for _, b in state.betas]
        journal, sensitivity = self._pass(effects, own, beta, state.motion)
        W, _ = self._rows(sensitivity, journal, fit.part)
        return np.split(W, np.cumsum([entry.size for entry in effects])[:-1], axis=1)

    def _outliers(self, state: _State) -> list[LocalFinding]:
        """Streams whose readings as recorded are wrong more often than the noise allows, with the fit's effects in."""
        from scipy import stats

        if max((wrong for wrong, _ in self.wrong.values()), default=0) < _LEAST_OUTLIERS:
            return []
        own, beta = [e for e, _ in state.betas], [b for _, b in state.betas]
        journal, _ = self._pass([], own, beta, state.motion, self._as_recorded)
        found = []
        for stream, (before, count) in self.wrong.items():
            wrong = min(before, len(wrong_rows(journal, stream)))
            if wrong >= _LEAST_OUTLIERS:
                log_p = float(stats.binom.logsf(wrong - 1, count, 2.0 * stats.norm.sf(6.0)))
                share = np.array([wrong / count])
                found.append(LocalFinding(Term(f"{stream}.outliers"), float(wrong), 1, log_p, share))
        return found

    def _outlier_share(self, term: Term) -> tuple[FloatArray, FloatArray]:
        wrong, count = self.wrong[term.name.split(".")[0]]
        share = wrong / count
        return np.array([share]), np.array([np.sqrt(max(share * (1 - share), 1e-12) / count)])

    # ---- what is in no catalogue

    def suspects(self, fit: Fit) -> Sequence[tuple[Term, Statistic]]:
        """Every probe and the evidence for it about the fit, the fit's own terms projected out."""
        state = _state(fit)
        streams = list(self._local_streams)
        own = [e for e, _ in state.betas]
        here = {e.name for e in own}
        covariates = {s: covariates_for(self.recording, s, state.motion.t) for s in streams}
        probes = [e for e in probes_for(streams, state.motion, covariates, self.model.sensors) if e.name not in here]
        if not probes:
            return ()
        evidence = self._evidence_of([*own, *probes], fit, [t.key for t in fit.terms if t.in_mean])
        given = list(evidence.names[: len(own)])
        return [(Term(e.name, probe=e), statistic_of(evidence, e.name, given)) for e in probes]

    def faults(self) -> Sequence[tuple[str, str, float, float]]:
        """Stretches that the filter found frozen or saturated."""
        return [
            (note.stream, note.kind, note.start, note.stop)
            for note in self._notes
            if isinstance(note, Note) and note.kind in ("frozen", "saturated")
        ]

    # ---- residuals and states

    def states(self, fit: Fit) -> tuple[FloatArray, FloatArray]:
        """Time [s] and nominal state of the filter after each reading that was used."""
        journal = _state(fit).journal
        used = journal.accepted
        return journal.t[used], journal.x[used]

    def residuals(self, fit: Fit) -> Sequence[StreamResidual]:
        """Innovations of every sensor with the effects of the fit at their beta, over everything."""
        journal = _state(fit).journal
        rows = []
        for name in self.model.sensors:
            one = journal.stream(name)
            keep = one.accepted
            if np.any(keep):
                held = one.t[keep] > self._split
                unit = {"mag": "1", "level": "m/s^2"}.get(name, "m")
                rows.append(StreamResidual(name, one.t[keep], one.nu[keep], one.white[keep], held, unit, {}))
        return rows

    def signature(self, before: Fit, term: Term, beta: FloatArray) -> Signature | None:
        """What an effect predicts for the whitened innovations of its stream, and those innovations; an effect on the
        IMU is shown in the stream where it is seen most.
        """
        if not term.in_mean:
            return None
        state = _state(before)
        entry = declaration(term)
        own, known = [e for e, _ in state.betas], [b for _, b in state.betas]
        journal, sensitivity = self._pass([*own, entry], own, known, state.motion)
        predicted = sensitivity.rows[:, -entry.size :] @ beta
        sensor = np.asarray([journal.sensors[s] for s in journal.sensor[sensitivity.event]])
        seen = {name: float(np.sum(predicted[sensor == name] ** 2)) for name in self.model.sensors}
        stream = entry.stream if entry.stream in seen else max(seen, key=lambda name: seen[name])
        mine = sensor == stream
        t = journal.t[sensitivity.event][mine]
        return Signature(stream, t, predicted[mine], sensitivity.white[mine], "sigma")


def directions_of(entry: Effect) -> list[FloatArray]:
    """Betas of one plausible size along every axis and diagonal."""
    signs = np.array([one for one in product((-1.0, 0.0, 1.0), repeat=entry.size) if any(one)])
    return list(signs / np.linalg.norm(signs, axis=1, keepdims=True) * entry.plausible)


def wrong_rows(journal: Journal, sensor: str) -> IntArray:
    """Rows of a sensor's stream whose whitened innovation leaves its neighbours' by six sigma, alone."""
    one = journal.stream(sensor)
    order = np.argsort(one.t, kind="stable")
    wrong = np.zeros(len(one), dtype=bool)
    for component in np.nan_to_num(one.white[order].T):
        wrong[order] |= isolated_outliers(component, 1.0)
    return one.index[wrong]


def without_wrong_readings(recording: Recording, model: FlightModel) -> tuple[Recording, dict[str, tuple[int, int]]]:
    """The recording without isolated wrong readings, and how many of how many there were by stream.

    A reading is wrong when its whitened innovation leaves those of its neighbours by six sigma, alone: an effect of the
    catalogue, a step or a disturbance moves neighbours too.
    """
    found = {name: (0, len(recording.streams[name])) for name in model.sensors if name in recording.streams}
    for _ in range(2):  # what a gross one hides shows when it is gone
        journal = run_filter(recording, model.replace(relinearise=False), {}, engine="numba", stride=0)
        more = wrong_about(recording, model, journal)
        recording = without_rows(recording, more)
        found = {name: (before + len(more.get(name, ())), count) for name, (before, count) in found.items()}
        if not more:
            break
    return recording, found


def wrong_about(recording: Recording, model: FlightModel, journal: Journal) -> dict[str, IntArray]:
    """The rows that are wrong in a recording's journal, by stream that has any."""
    wrong = {name: wrong_rows(journal, name) for name in model.sensors if name in recording.streams}
    return {name: rows for name, rows in wrong.items() if len(rows)}


def without_rows(recording: Recording, rows: Mapping[str, IntArray]) -> Recording:
    """The recording without some rows of its streams; itself where there are none."""
    if not rows:
        return recording
    kept = {
        name: recording.streams[name].rows(_all_but(len(recording.streams[name]), wrong))
        for name, wrong in rows.items()
    }
    return recording.replace(streams={**recording.streams, **kept})


def _all_but(count: int, rows: IntArray) -> BoolArray:
    keep = np.ones(count, dtype=bool)
    keep[rows] = False
    return keep


def _state(fit: Fit) -> _State:
    assert isinstance(fit.detail, _State)
    return fit.detail
