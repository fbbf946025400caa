"""Whole filter passes over a flight with effects in the model, each along the motion that the one before has found."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sinan.estimator.evidence.gauss_newton import least
from sinan.estimator.evidence.score import WIDEST_DIRECTION
from sinan.estimator.evidence.sensitivity import Sensitivity, pass_along
from sinan.estimator.evidence.source import IMPLAUSIBLE, LINEAR, Part
from sinan.estimator.filter.effect_forms import Along, Terms, declared_terms, is_lateness, reference_motion
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.imu import imu_table
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.journal import Journal
from sinan.estimator.filter.layout import DTHETA
from sinan.estimator.filter.relinearise import COARSE_ATTITUDE
from sinan.estimator.filter.run_filter import run_filter
from sinan.estimator.filter.smoother import smooth
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect, effects_for
from sinan.sensors.errors import InputError
from sinan.sensors.motion import Motion
from sinan.sensors.recording import Recording
from sinan.sensors.rotation import quaternion_conjugate, quaternion_multiply

#: The last third of the samples is held out: a fit to the rest has sqrt(3/2) times the sigmas of one to all, a fifth
#: more.
_FITTING_SHARE = 2.0 / 3.0
#: Points, and halvings of a step, at most: bound of work (`bounds_of_work flight`).
_MOST_STEPS, _MOST_HALVINGS = 12, 3
#: Gauss-Newton has settled when a step moves no parameter by more than this share of its sigma: bound of work
#: (`bounds_of_work brief`). Twice moves a lateness by 8 % of its sigma.
_SETTLED = 0.05
#: So has the plain model when a pass gains no more than this of -2 log L, and a fit whose step fails though no more
#: than this was predicted of it: bound of work (`bounds_of_work brief`).
_SETTLED_DEVIANCE = 1.0
#: Two deviances that differ by less are those of one and the same likelihood, and the share to which it is found where
#: they cease to be alike: bound of work (`bounds_of_work brief`).
_ALIKE, _BOUND_KNOWN = 0.1, 0.02
#: An effect whose loss the derivative predicts to cost less of -2 log L than 3^2 = 9, three sigma of one parameter, may
#: have a size that no derivative sees; it has none where its loss costs no more than that.
_HARDLY = 9.0
#: What a size that may be a bound is multiplied by to see whether the readings change. Above a bound all sizes do the
#: same, so that any factor shows it that exceeds 1 + 0.02, what `_BOUND_KNOWN` leaves open.
_LARGER = 1.5
#: Plausible sizes by which a step is limited, since the regressors hold along the motion of the last pass: bound of
#: work (`bounds_of_work brief`).
_LONGEST_STEP = 20.0
#: Sigma of the start over that which all readings leave of the first attitude: it adds 1 / 5^2 = 4 % to what they know.
_TIMES_KNOWN = 5.0
#: 1-sigma of an attitude found from the first readings beyond which it is started from as it is [rad]: the
#: vertical force is then off by g theta^2 / 2 = 0.2 m/s^2, of second order, and so is what a pass about it says.
_WIDE_START = 0.2
#: Declared 1-sigma of the first attitude up to which its heading is kept: forces along the ground turn with it, and
#: 1 - cos(0.1) = 0.5 % of them are of second order at that sigma [rad].
_LINEAR_HEADING = 0.1
#: Declared 1-sigma of the first attitude from which on its square matters: of two sigma g theta^2 / 2 = 2 mm/s^2 [rad].
_SECOND_ORDER = 0.01
#: Readings count that are so many plausible sizes of a lateness from either end of a stretch, or of a part: a choice.
#: Half and twice change no word of a late receiver (`bounds_of_work brief`).
_AT_ENDS = 2.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """A pass with effects at their estimate.

    Attributes
    ----------
    own : the effects in the model at their estimate, which the prior of `FlightPasses` holds to zero
    std : (p,) of each of their parameters, by the readings alone
    deviance : -2 log likelihood of the part that was fitted, without the prior
    journal : of the pass
    along : the effects, and the motion along which they were evaluated
    sensitivity : of the whitened innovations to the effects
    recording : of the readings that were there
    """

    own: Terms
    std: FloatArray
    deviance: float
    journal: Journal
    along: Along
    sensitivity: Sensitivity
    recording: Recording

    @property
    def motion(self) -> Motion:
        """Along which the effects were evaluated."""
        return self.along.motion


@dataclass(frozen=True)
class _Tried:
    """One pass with effects at some beta.

    Attributes
    ----------
    own : the effects
    cost : deviance and, by the prior, the length of beta
    information, score : (p, p), (p,) of the part that is fitted, without the prior
    """

    own: Terms
    cost: float
    deviance: float
    journal: Journal
    along: Along
    sensitivity: Sensitivity
    information: FloatArray
    score: FloatArray


class FlightPasses:
    """Passes over one flight.

    Parameters
    ----------
    flight : without its single wrong readings, and without gates; readings are taken out when more are found wrong
    prior_sigma : 1-sigma of every parameter before any reading, in plausible sizes
    """

    def __init__(self, flight: Flight, prior_sigma: float = IMPLAUSIBLE) -> None:
        # passes start from the attitude of the one before, whose heading a field that is known holds
        self.flight, self.prior_sigma = flight.believing(own_north=False), prior_sigma
        self.table = imu_table(flight)
        recording = flight.recording
        t = recording.streams["imu"].t
        self.start, self.end = float(t[0]), float(t[-1])
        self.split = float(t[round(_FITTING_SHARE * (len(t) - 1))])
        late = [one for one in effects_for("flight", tuple(self.flight.model.sensors)) if is_lateness(one)]
        self._margins = {one.stream: _AT_ENDS * one.parameters[0].plausible for one in late}
        journal = run_filter(self.flight, {}, engine="numba", stride=0)
        self.notes = journal.notes
        plain_motion = reference_motion(journal, declared_terms(recording), self.table)
        declared = recording.initial
        self._keeps_heading = (
            declared.quaternion is not None
            and declared.attitude_std is not None
            and _SECOND_ORDER < declared.attitude_std <= _LINEAR_HEADING
        )
        self._start_std = self._attitude_std_at_start(journal)
        if self._start_std is not None and self._start_std >= COARSE_ATTITUDE:
            self.flight = self.flight.believing(relinearise=True)
        self.plain_motion = self._settled(plain_motion)

    def along(self, own: Terms, motion: Motion, recording: Recording | None = None) -> Along:
        """Effects in the model, evaluated along a motion: what a pass is about.

        Parameters
        ----------
        recording : another with the same IMU; default: that without wrong readings
        """
        recording = self.flight.recording if recording is None else recording
        terms = own.joined(declared_terms(recording))
        return Along(self.flight.reading(self._started(recording, motion)), terms, motion, self.table)

    def believing(self, flight: Flight) -> FlightPasses:
        """Passes over the same readings, along the same motions, with the noise that the model of a flight has."""
        other = copy(self)
        other.flight = flight.reading(self.flight.recording).believing(
            gate_level=None, own_north=False, relinearise=self.flight.model.relinearise
        )
        other.table = imu_table(other.flight)
        return other

    @property
    def plain(self) -> Along:
        """No effect, along the motion of the plain model."""
        return self.along(Terms(), self.plain_motion)

    @staticmethod
    def run(wanted: Sequence[Effect], along: Along, stride: int = 0) -> tuple[Journal, Sensitivity]:
        """One pass, and the sensitivities to the effects wanted; `stride` samples between logged states, 0: none."""
        return pass_along(along, wanted, blocks=0, keep_rows=1, stride=stride)

    @staticmethod
    def run_withheld(stream: str, held: Sequence[tuple[float, float]], along: Along) -> Journal:
        """A pass that is not given a stream's readings of some windows, but says what it predicts of them."""
        flight = along.flight.believing(withheld={stream: held})
        return pass_along(replace(along, flight=flight), [], blocks=0, keep_rows=1, stride=0)[0]

    def follow(self, journal: Journal, along: Along) -> Motion:
        """The motion that a pass has found, the effects taken off, those declared too."""
        return reference_motion(journal, along.terms, self.table)

    def fitted(self, own: Terms, part: Part, again: bool = True) -> Fitted:
        """Gauss-Newton over beta, from its first values on, with passes in the effects' exact form.

        Parameters
        ----------
        again : begin once more at a likelier size that lies on the way back from one that no derivative sees

        Raises
        ------
        InputError : from the first values no state, covariance or finite information follows
        """
        best = self._likeliest(own, part)
        std = _sigma(best.information)
        found = Fitted(best.own, std, best.deviance, best.journal, best.along, best.sensitivity, self.flight.recording)
        for k, seen, predicted in self._hardly_seen(best.own, best.information):
            least = self._least(found, k, part, seen, predicted)
            if again and least.deviance < found.deviance - _SETTLED_DEVIANCE:  # the steps have leapt over a minimum
                nearer = self.fitted(least.own, part, again=False)
                return nearer if nearer.deviance < found.deviance else least
            found = least
        return found

    def _likeliest(self, own: Terms, part: Part) -> _Tried:
        """Gauss-Newton's point of the least deviance and, by the prior, length of beta."""
        prior = self.prior(own.effects)

        def step(there: _Tried) -> tuple[FloatArray, int] | None:
            pull = there.score - prior * there.own.vector
            step = self._step(there.information, pull, prior)
            if np.all(np.abs(step) < _SETTLED * _posterior_sigma(there.information, prior)):
                return None
            predicted = float(2.0 * step @ pull - step @ (there.information @ step + prior * step))
            return step, _MOST_HALVINGS if predicted >= _SETTLED_DEVIANCE else 0

        def tried(there: _Tried, step: FloatArray) -> _Tried:
            return self._tried(own.at(there.own.vector + step), part, prior, there)

        return least(self._tried(own, part, prior, None), lambda there: there.cost, step, tried, _MOST_STEPS)

    def _tried(self, own: Terms, part: Part, prior: FloatArray, before: _Tried | None) -> _Tried:
        """A pass with the effects at beta, along the motion with these.

        Raises
        ------
        InputError : beta is so far off that none follows
        """
        motion = self.plain_motion if before is None else before.along.motion
        if before is not None or np.any(own.vector):  # the exact forms hold along the motion with these
            along = self.along(own, motion)
            motion = self.follow(self.run([], along)[0] if before is None else before.journal, along)
        along = self.along(own, motion)
        journal, sensitivity = self.run(own.effects, along)
        deviance = self.deviance(journal, part)
        W, white, _ = self.rows(sensitivity, journal, part)
        information, score = W.T @ W, W.T @ white
        self._require_numbers(deviance, information, score, own.vector)
        cost = deviance + float(own.vector @ (prior * own.vector))
        return _Tried(own, cost, deviance, journal, along, sensitivity, information, score)

    def _hardly_seen(self, terms: Terms, information: FloatArray) -> list[tuple[int, bool, float]]:
        """Places of the effects that are in the model at a size at which the derivative hardly sees them, whether it
        does at all, and what it predicts of -2 log L for their loss.
        """
        found = []
        ends = np.cumsum([0, *(entry.size for entry in terms.effects)])
        for k, ((entry, b), (first, last)) in enumerate(zip(terms.pairs, pairwise(ends), strict=True)):
            own = information[first:last, first:last]
            seen = np.diag(own) * entry.plausible_in(self.plain_motion) ** 2 > WIDEST_DIRECTION**-2
            predicted = float(b @ own @ b)
            if np.any(b) and predicted < _HARDLY:
                found.append((k, bool(np.any(seen)), predicted))
        return found

    def _least(self, fit: Fitted, k: int, part: Part, is_seen: bool, predicted: float) -> Fitted:
        """The fit with effect k as small as the data are alike, which is a bound and has no sigma, nor has one of which
        the data say nothing; one that fits better, where there is one on the way; itself where its loss costs what the
        derivative has predicted, or where more of it changes the readings.
        """
        mine = np.concatenate([np.full(entry.size, i == k) for i, entry in enumerate(fit.own.effects)])
        std = np.where(mine, np.inf, fit.std)

        def at(share: float) -> Fitted:
            own = fit.own.at(np.where(mine, share * fit.own.vector, fit.own.vector))
            along = self.along(own, fit.motion)
            try:
                journal, sensitivity = self.run(own.effects, along)
            except InputError:  # no state or covariance follows
                return replace(fit, std=std, deviance=np.inf)
            return replace(
                fit, own=own, std=std, deviance=self.deviance(journal, part), journal=journal, along=along,
                sensitivity=sensitivity,
            )  # fmt: skip

        none, low, high, found = at(0.0), 0.0, 1.0, replace(fit, std=std)
        gain = none.deviance - fit.deviance
        if gain < -_SETTLED_DEVIANCE:
            return none
        if gain < _HARDLY:
            return fit if is_seen else found
        if predicted > LINEAR * gain or abs(at(_LARGER).deviance - fit.deviance) > _SETTLED_DEVIANCE:
            return fit
        while high - low > _BOUND_KNOWN * high:
            share = 0.5 * (low + high)
            tried = at(share)
            if tried.deviance < fit.deviance - _SETTLED_DEVIANCE:
                return tried
            if tried.deviance < fit.deviance + _ALIKE:
                high, found = share, tried
            else:
                low = share
        return found

    def _require_numbers(self, *values: float | FloatArray) -> None:
        """Raise where a pass has led to what is no number: nothing can be said of such a model."""
        if not all(np.all(np.isfinite(value)) for value in values):
            raise InputError(
                self.flight.recording.where, "a fit that does not converge", "readings that the model can explain"
            )

    def counted(self, journal: Journal, part: Part) -> BoolArray:
        """(K,) which readings are in a part with any lateness up to `_AT_ENDS`: they fit models, and compare them."""
        until = self.end if part == "all" else self.split
        spans = [(start, min(end, until)) for start, end in self.table.spans if start < until]
        return journal.is_inside(self._margins, spans)

    def rows(self, sensitivity: Sensitivity, journal: Journal, part: Part) -> tuple[FloatArray, FloatArray, IntArray]:
        """(r, p) sensitivities, (r,) whitened innovations and (r,) places in the journal of a part."""
        keep = self.counted(journal, part)[sensitivity.event]
        return sensitivity.rows[keep], sensitivity.white[keep], sensitivity.event[keep]

    def deviance(self, journal: Journal, part: Part) -> float:
        """-2 log likelihood of a part."""
        return float(-2.0 * np.sum(journal.log_density[journal.accepted & self.counted(journal, part)]))

    def deviance_at(self, own: Terms, motion: Motion, part: Part) -> float:
        """-2 log likelihood of a part with effects as they are, along a motion; infinite where no state, covariance or
        number follows.
        """
        try:
            deviance = self.deviance(self.run([], self.along(own, motion))[0], part)
        except InputError:
            return np.inf
        return np.inf if np.isnan(deviance) else deviance

    def _settled(self, motion: Motion) -> Motion:
        """The motion that the plain model finds when its passes start from it: a start far off takes several."""
        best, settled = np.inf, motion
        for _ in range(_MOST_STEPS):
            along = self.along(Terms(), motion)
            journal, _ = self.run([], along)
            deviance = self.deviance(journal, "all")
            if not deviance < best - _SETTLED_DEVIANCE:
                break
            best, settled = deviance, motion
            motion = self.follow(journal, along)
        self._require_numbers(best)
        return settled

    def prior(self, effects: Sequence[Effect]) -> FloatArray:
        """(p,) information on each parameter before any reading, so that what no reading sees stays zero."""
        return np.asarray((self.prior_sigma * self.plausible(effects)) ** -2.0)

    def plausible(self, effects: Sequence[Effect]) -> FloatArray:
        """(p,) plausible 1-sigma size of each parameter."""
        return np.concatenate([*(entry.plausible_in(self.plain_motion) for entry in effects), np.zeros(0)])

    def _step(self, information: FloatArray, score: FloatArray, prior: FloatArray) -> FloatArray:
        """Newton's step, limited to `_LONGEST_STEP` plausible sizes."""
        step = np.linalg.solve(information + np.diag(prior), score)
        longest = _LONGEST_STEP / (self.prior_sigma * np.sqrt(prior))
        return np.asarray(step / np.max(np.abs(step) / longest, initial=1.0))

    def _attitude_std_at_start(self, journal: Journal) -> float | None:
        """Sigma with which every pass starts at the smoothed attitude of the one before; None: as the filter starts.

        Where the recording declares no attitude, the first readings, from which it is found, have the effects in them
        that are looked for: it may be wrong by as much as a magnetometer or an accelerometer may be turned or bent.
        Until the tilt is found, an error theta of it lacks g theta^2 / 2 of the vertical force, which is of second
        order and passes for an error of the accelerometer. So a pass starts no wider than a filter stays linear, where
        all readings together know the first attitude so much better than that sigma that it adds nothing to them.
        Beside an effect that turns the heading they know it less well: the first step towards such an effect is shorter
        for that, and each pass starts from where the one before has ended. Where the declared heading is kept, so is
        its sigma.
        """
        declared = self.flight.recording.initial.attitude_std
        if declared is not None and declared <= _SECOND_ORDER:
            return None
        assert isinstance(journal.run, RunInputs)
        if self._keeps_heading:
            return declared
        first = float(np.sqrt(np.linalg.eigvalsh(journal.run.P[DTHETA, DTHETA])[-1]))
        wide = max(first, COARSE_ATTITUDE) if declared is None else declared
        known = float(np.max(smooth(journal, sigmas=True).sigma[0, DTHETA]))
        narrow = min(wide, max(_TIMES_KNOWN * known, COARSE_ATTITUDE))
        return narrow if narrow < _WIDE_START or declared is not None else None

    def _started(self, recording: Recording, motion: Motion) -> Recording:
        """The recording with the first attitude of the reference motion, and a sigma that lets it be wrong.

        A declared attitude keeps its heading, which turns no force up or down: the tilt alone is that of the motion.
        """
        if self._start_std is None:
            return recording
        q_nb, declared = motion.q_nb[0], self.flight.recording.initial
        if self._keeps_heading and declared.quaternion is not None:
            turn = quaternion_multiply(declared.quaternion, quaternion_conjugate(q_nb))
            about_down = np.array([turn[0], 0.0, 0.0, turn[3]]) / max(float(np.hypot(turn[0], turn[3])), 1e-300)
            q_nb = quaternion_multiply(about_down, q_nb)
        return recording.replace(initial=replace(declared, quaternion=q_nb, attitude_std=self._start_std))


def _sigma(information: FloatArray) -> FloatArray:
    """(p,) 1-sigma of each parameter by the readings alone, of what they do not tell at all 0; sought in units in which
    each by itself is told alike, as parameters of different units may be told a million times better than others.
    """
    told = np.sqrt(np.maximum(np.diag(information), 0.0))
    unit = np.divide(1.0, told, out=np.zeros_like(told), where=told > 0.0)
    covariance = np.linalg.pinv(information * np.outer(unit, unit), rcond=1e-12, hermitian=True)
    return np.asarray(unit * np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def _posterior_sigma(information: FloatArray, prior: FloatArray) -> FloatArray:
    """(p,) 1-sigma of each parameter by readings and prior together."""
    unit = prior**-0.5
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    return np.asarray(unit * np.sqrt(np.sum(vectors**2 / (1.0 + np.maximum(values, 0.0)), axis=1)))
