"""The likeliest sizes: log-likelihood of the filter's innovations and the priors together, with the exact gradient of
`estimator.evidence.level_scores`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.heading import beside_iron, with_heading
from sinan.calibration.levels.levels import Levels, first_levels
from sinan.calibration.levels.sizes import Size
from sinan.calibration.levels.slopes import slopes, sums_from
from sinan.estimator.evidence.comb import best_tooth, whole_moves
from sinan.estimator.evidence.level_scores import LevelScores, level_scores
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.inputs import RunInputs
from sinan.estimator.filter.tails import log_density
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.recording import Recording

#: Iterations of the search at most, what one gains at least of log L, and a round of it: bound of work
#: (`bounds_of_work sizes`). Half and twice of the second move a size by 0.03 and 0.06 sigma, of the others by none.
MOST, GAINED, SETTLED = 20, 0.05, 1.0
#: How often one step of the IMU is halved at most in the search for a lateness, where what a log tells is finer: bound
#: of work (`bounds_of_work sizes`).
HALVED = 6
#: Rounds of times and sizes: bound of work (`bounds_of_work sizes`).
ROUNDS = 6
#: The same in the whole of a long log, from where its excerpts left them: bound of work (`bounds_of_work long`).
SETTLING = 2
#: Parts of a log whose gradients show how well it tells the sizes, three for each of up to twenty: bound of work
#: (`bounds_of_work sizes`). Half and twice move a size by 0.11 and 0.03 of its sigma.
PARTS = 64


class Problem:
    """Log-posterior over theta: (log value - log median) / spread of each size."""

    def __init__(self, recording: Recording, sizes: Sequence[Size], first: Levels) -> None:
        self.recording, self.sizes, self.first = recording, tuple(sizes), first
        self._step = recording.streams["imu"].step
        moves = [size for size in sizes if size.sensor == "latency" and not size.is_of_position]
        self._margins = {size.key: max(abs(size.at(end)) for end in size.bounds) for size in moves}
        self._readings = Readings.of(first.flight(recording))

    def heard_in(self, excerpts: Sequence[Recording]) -> Problem:
        """The same sizes, sought in excerpts of the recording; in the whole, where there is one, or no state follows
        from the readings of one.
        """
        try:
            return self if len(excerpts) == 1 else _InExcerpts(self, excerpts)
        except InputError:
            return self

    def levels(self, theta: FloatArray) -> Levels:
        """Sizes at theta."""
        levels = self.first
        for size, x in zip(self.sizes, theta, strict=True):
            levels = levels.with_size(size, size.at(float(x)))
        return levels

    def inputs(self, levels: Levels) -> RunInputs:
        """What the filter runs on."""
        return self._readings.inputs(levels.flight(self.recording))

    def value(self, theta: FloatArray, inside: bool = False) -> float:
        """Log-posterior by a forward pass alone; of what cannot be, minus infinity.

        Parameters
        ----------
        inside : whether only readings count that no lateness moves out of the IMU's time
        """
        try:
            inputs = self.inputs(self.levels(theta))
            journal = run(inputs, "numba", 0)
        except InputError:
            return -np.inf
        counted = journal.accepted
        if inside:
            counted = counted & journal.is_inside(self._margins, inputs.imu.spans)
        return float(np.sum(journal.log_density[counted])) - 0.5 * float(theta @ theta)

    def value_and_gradient(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log-posterior and its gradient, of which times have no part."""
        value, each, _ = self._of_parts(theta, times=False)
        return value, np.sum(each, axis=0) - theta

    def _of_parts(self, theta: FloatArray, parts: int = 0, times: bool = True) -> tuple[float, FloatArray, FloatArray]:
        """Log-posterior; (parts, sizes) gradients of log L of so many parts, 0: as few as there are; (sizes,) its
        curvatures by times, zero of all else. What goes by a time is found over one step of the IMU to each
        side, or left out.
        """
        levels = self.levels(theta)
        inputs = self.inputs(levels)
        scores = level_scores(inputs, max(2, len(inputs.imu) // parts) if parts else None)
        here = densities(inputs, scores)
        value = float(np.sum(here)) - 0.5 * float(theta @ theta)
        found, bent = np.zeros((len(scores.first_reading), len(self.sizes))), np.zeros(len(self.sizes))
        for i, size in enumerate(self.sizes):
            if not size.linear:
                found[:, i] = size.spread * slopes(inputs, scores, levels, size)
            elif times:
                step = self._step / size.spread
                later, sooner = (self._gained(theta, i, move, inputs, here, scores) for move in (step, -step))
                found[:, i] = (later - sooner) / (2.0 * step)
                bent[i] = float(np.sum(later + sooner)) / step**2
        return value, found, bent

    def _gained(
        self, theta: FloatArray, i: int, step: float, inputs: RunInputs, here: FloatArray, scores: LevelScores
    ) -> FloatArray:
        """(parts,) what log L of each part gains by a step of one theta, of readings that no lateness moves out of the
        IMU's time: what begins with another reading has others before its first state has settled. Readings of two
        streams may change places.
        """
        moved, gained = theta.copy(), np.zeros(len(here))
        moved[i] += step
        other = run(self.inputs(self.levels(moved)), "numba", 0)
        mine, its = (np.lexsort((one.index, one.sensor)) for one in (inputs.events, other))
        counted = other.accepted & other.is_inside(self._margins, inputs.imu.spans)
        both = counted[its] & (here[mine] != 0.0)  # not what is before the start in one of them
        gained[mine] = np.where(both, other.log_density[its] - here[mine], 0.0)
        return sums_from(gained, scores.first_reading)

    def timed(self, theta: FloatArray, *, far: bool) -> FloatArray:
        """Theta with the likeliest lateness of each stream: by whole steps of the IMU, from long to short, where it may
        be far off; else by one, then halves of it, until a step is no longer than a sigma.
        """
        for i, size in enumerate(self.sizes):
            if size.linear:
                theta = self._timed(theta, i, size, far)
        return theta

    def _timed(self, theta: FloatArray, i: int, size: Size, far: bool) -> FloatArray:
        """Theta with the likeliest lateness of one stream."""

        def at(x: float) -> FloatArray:
            moved = theta.copy()
            moved[i] = x
            return moved

        def value(x: float) -> float:
            return self.value(at(x), inside=True) if size.bounds[0] <= x <= size.bounds[1] else -np.inf

        unit = self._step / size.spread
        moves = whole_moves(1.0, unit) if far else [0.5**k * unit for k in range(HALVED + 1)]
        return at(best_tooth(value, float(theta[i]), moves, narrowing=not far))

    def covariance(self, theta: FloatArray) -> FloatArray:
        """(sizes, sizes) of theta about its likeliest value; of the prior it is the identity."""
        return np.asarray(np.linalg.inv(self.information(theta)))

    def information(self, theta: FloatArray, times: bool = True) -> FloatArray:
        """(sizes, sizes) the information of log and prior.

        That of the log is the scatter of its parts' gradients (Berndt, Hall, Hall, Hausman, Ann. Econ. Soc. Meas. 3(4),
        1974), to which the prior adds one; of a time, what log L bends by. Where readings scatter less than their noise
        is said to, so do the gradients, and by their scatter a log would tell less of a time the better its readings
        are; how times go together is the scatter's. Of a time, which moves means, and a size, which makes variances, no
        information is common to both (Kay, Fundamentals of Statistical Signal Processing, 1993, section 3.9). Neglects
        that gradients of neighbouring parts go together.
        """
        _, each, bent = self._of_parts(theta, PARTS, times)
        each -= np.mean(each, axis=0)
        scatter = each.T @ each
        own = np.diag(scatter)
        of_times = np.array([size.linear for size in self.sizes])
        told = np.where(of_times & (own > 0.0), np.maximum(-bent, 0.0), own)
        scale = np.sqrt(np.divide(told, own, out=np.zeros(len(theta)), where=own > 0.0))
        both = of_times[:, None] == of_times
        return np.asarray(np.where(both, scale[:, None] * scatter * scale, 0.0) + np.eye(len(theta)))

    def maximise(self, theta: FloatArray) -> tuple[FloatArray, float]:
        """Times as they are, all else by quasi-Newton, in units in which the log tells all sizes alike and each by
        itself; the best point that was seen.
        """
        from scipy.optimize import LinearConstraint, minimize

        best, highest = theta, -np.inf
        free = np.array([not size.linear for size in self.sizes])
        if not np.any(free):
            return theta, self.value(theta)
        low, high = np.array([size.bounds for size in self.sizes])[free].T
        unit = units_of(self.information(theta, times=False)[np.ix_(free, free)])

        def negative(x: FloatArray) -> tuple[float, FloatArray]:
            nonlocal best, highest
            whole = theta.copy()
            whole[free] = np.clip(unit @ x, low, high)
            try:
                value, gradient = self.value_and_gradient(whole)
            except InputError:
                return 1e12, np.zeros(len(x))
            if value > highest:
                best, highest = whole, value
            return -value, -unit.T @ gradient[free]

        start, inside = np.linalg.solve(unit, theta[free]), LinearConstraint(unit, low, high)
        options = {"maxiter": MOST, "ftol": GAINED}
        minimize(negative, start, jac=True, method="SLSQP", constraints=inside, options=options)
        return best, highest

    def settled(self, levels: Levels) -> Levels:
        """The likeliest levels near some that were found in excerpts, by few turns of times and all else."""
        if not self.sizes:
            return levels
        return replace(self.fitted(self.theta(levels), turns=SETTLING, far=False), in_excerpts=True)

    def theta(self, levels: Levels) -> FloatArray:
        """Where the sizes of some levels are, within the bounds."""
        return np.array([size.theta(levels.value(size)) for size in self.sizes])

    def fitted(self, theta: FloatArray, turns: int | None = None, far: bool = True) -> Levels:
        """The likeliest levels, sought from a theta on; see `likeliest`. Their log-posterior is of readings that no
        lateness moves out of the IMU's time, so that those with others have the same.
        """
        theta, _ = self.likeliest(theta, turns, far)
        return replace(
            self.levels(theta), found=self.sizes, covariance=self.covariance(theta),
            log_posterior=self.value(theta, inside=True),
        )  # fmt: skip

    def likeliest(self, theta: FloatArray, turns: int | None = None, far: bool = True) -> tuple[FloatArray, float]:
        """Times and all else in turns, until one turn of both gains nothing; times at first may be far off."""
        value = -np.inf
        for turn in range(ROUNDS if turns is None else turns):
            before = value
            theta, value = self.maximise(self.timed(theta, far=far and turn == 0))
            if turn and value < before + SETTLED:
                break
        return theta, value


class _InExcerpts(Problem):
    """The sizes of a recording by excerpts of it, each with a first state of its own.

    The prior of a size counts once. Neglects that their biases are one: each counts as often as there are excerpts.
    """

    def __init__(self, whole: Problem, excerpts: Sequence[Recording]) -> None:
        self.recording, self.sizes, self.first, self._step = whole.recording, whole.sizes, whole.first, whole._step
        self._each = [self._begun(one) for one in excerpts]

    def _begun(self, excerpt: Recording) -> Problem:
        """The problem of one excerpt alone, with a first heading of its own."""
        first = self.first
        samples = first.specs["accel"].imu_samples
        own = replace(first_levels(excerpt, self.sizes, first.m_n, first.field, samples), iron=first.iron)
        return Problem(beside_iron(own.flight(with_heading(excerpt, own.specs))), self.sizes, own)

    def value(self, theta: FloatArray, inside: bool = False) -> float:
        return sum(one.value(theta, inside) for one in self._each) + self._counted_again(theta)

    def _of_parts(self, theta: FloatArray, parts: int = 0, times: bool = True) -> tuple[float, FloatArray, FloatArray]:
        parts_of_each = [one._of_parts(theta, parts // len(self._each), times) for one in self._each]
        values, each, bent = zip(*parts_of_each, strict=True)
        return sum(values) + self._counted_again(theta), np.concatenate(each), np.sum(bent, axis=0)

    def _counted_again(self, theta: FloatArray) -> float:
        """What takes the prior back that every excerpt has counted, but once."""
        return 0.5 * (len(self._each) - 1) * float(theta @ theta)


def units_of(information: FloatArray) -> FloatArray:
    """(sizes, sizes) columns in which all that is told is told alike and by itself: unit' information unit = 1."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(information)).T)


def densities(inputs: RunInputs, scores: LevelScores) -> FloatArray:
    """(K,) log density of each innovation by the law that the model gives it; 0 where the reading was not used."""
    events = inputs.events
    used = scores.loglik != 0.0
    m = events.freedom[used]
    found = np.zeros(len(events))
    found[used] = log_density(
        inputs.model, events.sensors, events.sensor[used], m, scores.loglik[used], scores.nis[used]
    )
    return found
