"""Pseudoranges as a source of information and score: which effects the ranges of a receiver call for.

About a fix with some effects modelled, the prefit residual of row i is, to first order,

    r_i = u_i dp_k + dc_kg + s_j(t) + F_i x(t) + sum_e G_ie beta_e + n_i

with position dp_k and clocks dc_kg of its epoch k, which are projected out, an error s_j of its satellite and a common
error x of the ionosphere that is modelled. The latter two do not average down: they are Gauss-Markov processes that
last half an hour, and a Kalman filter over blocks of time carries them along with its sensitivity to every candidate's
beta (Friedland's separate-bias recursion), so that scores of different blocks are independent and add up.

Most of these effects have a size that is known beforehand. The statistic asks whether beta is zero; an effect is only
taken if the known size also fits better than none.

Source: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108; B. Friedland, ibid. 14 (1969) 359.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinan.estimator.evidence.intervals.onsets import SEARCHED, Rows, Step, strongest_onset
from sinan.estimator.evidence.score import BLOCKS, CONFUSED, DETECTABLE_LAMBDA, Evidence, Statistic, statistic_of
from sinan.estimator.positioning.location import Location
from sinan.estimator.positioning.noise_fit import LASTING as LASTING
from sinan.estimator.positioning.point_positioning import rectangle
from sinan.estimator.positioning.steady_fault import steady_fault
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import pseudorange_satellite_fault
from sinan.sensors.effects.declaration import Effect
from sinan.sensors.motion import Motion
from sinan.sensors.pseudorange import (
    IONOSPHERE_RAY,
    MODELLED,
    Pseudoranges,
    circumstances,
    full_size,
    ionosphere_left,
    line_of_sight,
    sum_of,
)
from sinan.sensors.range_noise import LOWEST_ELEVATION
from sinan.sensors.range_noise import USUAL_ACCURACY as USUAL_ACCURACY

#: Satellites for which the onset of a fault is searched: bound of work (`bounds_of_work ranges`).
SHORTLIST = 6
#: Within it the code errors of one satellite are one [s]: a choice, half and twice of which change no name of a
#: receiver of GPS with a satellite that walks off (`bounds_of_work ranges`).
MULTIPATH_TIME = 60.0
#: What of a code error is new from one `MULTIPATH_TIME` to the next, (a^2 + a^2 / sin^2 E): RTKLIB 2.4.2, where nothing
#: is set (`prcopt_default`), 100 times the 3 mm of a phase. The whole error of one epoch, with what stays, which is
#: `MULTIPATH` here, is `sensors.pseudorange.CODE_NOISE`.
CHANGING_NOISE = 0.3  # m
#: Multipath that stays, divided by sin E [m]: a choice, half and twice of which change none either (`bounds_of_work
#: ranges`).
MULTIPATH = 0.5
#: Error of broadcast orbit and clock, as seen by a receiver [m] (Montenbruck, Steigenberger, Hauschild, Adv. Space Res.
#: 61 (2018) 3020); the accuracy that the message promises where that is worse than its usual value.
SIGNAL_IN_SPACE: Mapping[str, float] = {"G": 0.6, "E": 0.25, "J": 0.6, "C": 1.1, "R": 1.9}
#: What a model of the mean weather leaves at the zenith [m]: 2 cm of the dry part, and half of the up to 20 cm of the
#: wet, sqrt(0.02^2 + 0.1^2) = 0.1.
ZENITH_LEFT = 0.1
IONOSPHERE = "pseudorange.ionosphere"
TROPOSPHERE = "pseudorange.troposphere"
FAULT = pseudorange_satellite_fault.EFFECT


@dataclass(frozen=True)
class Called:
    """An effect that the ranges call for.

    Attributes
    ----------
    name, satellite : of the effect
    statistic : evidence when it was taken
    full : the size that is modelled from then on; a fault: the estimate
    confused_with : effects that would have explained the same
    interval : of a fault: seconds of the recording from its onset to the end
    known_position : whether it took a known position to see it
    """

    name: str
    satellite: str | None
    statistic: Statistic
    full: FloatArray
    confused_with: tuple[str, ...]
    interval: tuple[float, float] | None
    known_position: bool


@dataclass(frozen=True)
class Columns:
    """Whitened rows of the linear problem with the nuisance of each epoch projected out.

    Attributes
    ----------
    state : (n, satellites + 3) derivative by the satellites' errors and the common ionosphere
    candidates : (n, p)
    residual : (n,)
    block : (n,) block of time
    """

    state: FloatArray
    candidates: FloatArray
    residual: FloatArray
    block: IntArray


@dataclass(frozen=True)
class Candidate:
    """An effect to be scored; a fault has its satellite and its onset [s of the recording]."""

    name: str
    satellite: str | None = None
    onset: float = 0.0

    @property
    def key(self) -> str:
        """How the evidence calls it."""
        return self.name if self.satellite is None else f"{self.name}@{self.satellite}:{self.onset:.9g}"

    @property
    def effect(self) -> Effect:
        """Its declaration."""
        return MODELLED[self.name] if self.satellite is None else FAULT


def evidence(
    location: Location,
    position: FloatArray,
    candidates: Sequence[Candidate],
    keep: BoolArray,
    known: bool = False,
) -> Evidence:
    """Information and score of the candidates about a fix, by block of time.

    Parameters
    ----------
    location : the fix and what it models
    position : (epochs, 3) where to linearise, ECEF [m]; NaN leaves an epoch out
    candidates : what is scored
    keep : (n,) rows that take part
    known : the position is known: only the clocks are projected out
    """
    rows = np.flatnonzero(keep & np.isfinite(position[location.ranges.epoch, 0]))
    columns = linearise(location, position, candidates, rows, known)
    sizes = tuple(candidate.effect.size for candidate in candidates)
    variance = state_variance(location, position, rows)
    span = float(np.ptp(location.ranges.t)) if len(location.ranges.t) > 1 else 0.0
    information, score = filter_blocks(columns, variance, np.exp(-span / BLOCKS / LASTING))
    plausible = np.concatenate([candidate.effect.plausible for candidate in candidates])
    return Evidence(tuple(candidate.key for candidate in candidates), sizes, information, score, plausible)


def linearise(
    location: Location,
    position: FloatArray,
    candidates: Sequence[Candidate],
    rows: IntArray,
    known: bool,
) -> Columns:
    """Whiten the rows and project position and clocks of each epoch out of them."""
    ranges = location.ranges.rows(rows)
    motion = circumstances(ranges, np.where(np.isfinite(position), position, 1e7))
    distance, direction = line_of_sight(ranges.position, position[ranges.epoch])
    residual = ranges.value - distance - sum_of(motion, location.effects)
    clocks = np.eye(len(location.clock_names))[location.clock_group[rows]]
    nuisance = clocks if known else np.hstack([direction, clocks])
    state = satellite_columns(location.ranges, ranges)
    common = np.zeros((len(rows), 3))
    if IONOSPHERE in location.effects:
        common = ionosphere_left(motion, sum_of(motion, [IONOSPHERE]))
    columns = [candidate.effect.regressor(seen_by(candidate, ranges, motion))[:, 0] for candidate in candidates]
    whitening = 1.0 / np.sqrt(changing_variance(ranges, motion.covariates["elevation"]))
    everything = np.hstack([state, common, *columns, residual[:, None]]) * whitening[:, None]
    free = project_out(everything, nuisance * whitening[:, None], ranges.epoch, len(ranges.t))
    m = state.shape[1] + 3
    return Columns(free[:, :m], free[:, m:-1], free[:, -1], blocks_of(ranges))


def seen_by(candidate: Candidate, ranges: Pseudoranges, motion: Motion) -> Motion:
    """The circumstances as a candidate needs them: a fault its rows and the time since its onset."""
    if candidate.satellite is None:
        return motion
    elapsed = motion.covariates["elapsed"] - candidate.onset
    faulty = (ranges.satellite == candidate.satellite) & (elapsed >= 0.0)
    return motion.with_covariates(faulty=faulty.astype(np.float64), elapsed=elapsed)


def satellite_columns(all_ranges: Pseudoranges, ranges: Pseudoranges) -> FloatArray:
    """(n, satellites) one where the row is the satellite's."""
    names = np.unique(all_ranges.satellite)
    return np.asarray(ranges.satellite[:, None] == names[None, :], dtype=np.float64)


def blocks_of(ranges: Pseudoranges) -> IntArray:
    """(n,) number of the block of time of each row."""
    span = max(float(np.ptp(ranges.t)), 1e-9)
    return np.minimum((ranges.time - ranges.t[0]) / span * BLOCKS, BLOCKS - 1).astype(np.int64)


def changing_variance(ranges: Pseudoranges, elevation: FloatArray) -> FloatArray:
    """(n,) variance of what is new in a row [m^2]: code errors that last a minute count once in a minute."""
    interval = float(np.median(np.diff(ranges.t))) if len(ranges.t) > 1 else MULTIPATH_TIME
    sine = np.sin(np.maximum(elevation, LOWEST_ELEVATION))
    return np.asarray(CHANGING_NOISE**2 * (1.0 + 1.0 / sine**2) * max(1.0, MULTIPATH_TIME / interval))


def state_variance(location: Location, position: FloatArray, rows: IntArray) -> FloatArray:
    """(satellites + 3,) variance of each satellite's lasting error [m^2], and one for each column of the ionosphere."""
    ranges = location.ranges.rows(rows)
    motion = circumstances(ranges, np.where(np.isfinite(position), position, 1e7))
    sine = np.sin(np.maximum(motion.covariates["elevation"], LOWEST_ELEVATION))
    space = np.array([SIGNAL_IN_SPACE[system] for system in ranges.system.tolist()])
    variance = np.where(ranges.accuracy > USUAL_ACCURACY, np.maximum(space, ranges.accuracy), space) ** 2
    variance = variance + (MULTIPATH / sine) ** 2
    if IONOSPHERE in location.effects:
        variance = variance + (IONOSPHERE_RAY * sum_of(motion, [IONOSPHERE])) ** 2
    if TROPOSPHERE in location.effects:
        variance = variance + (ZENITH_LEFT / sine) ** 2
    column = satellite_columns(location.ranges, ranges)
    mean = (column.T @ variance) / np.maximum(column.sum(axis=0), 1.0)
    return np.concatenate([mean, np.ones(3)])


def project_out(X: FloatArray, A: FloatArray, epoch: IntArray, epochs: int) -> FloatArray:
    """X less what the columns A explain of it, epoch by epoch."""
    shape = rectangle(epoch, epochs)
    A_k, X_k = shape.spread(A), shape.spread(X)
    N = np.swapaxes(A_k, 1, 2) @ A_k
    right = np.swapaxes(A_k, 1, 2) @ X_k
    return shape.rows(X_k - A_k @ (np.linalg.pinv(N, rcond=1e-10, hermitian=True) @ right))


def filter_blocks(columns: Columns, variance: FloatArray, persistence: float) -> tuple[FloatArray, FloatArray]:
    """Kalman filter over the blocks with the sensitivity of its innovations to beta.

    z = H x + G beta + noise of variance one,  S = H P H' + 1,  S_beta = G + H V,  nu = z - H x
    M = (P^-1 + H'H)^-1,  so that S^-1 = 1 - H M H' and the gain K = M H'
    Lambda_k = S_beta' S^-1 S_beta,  b_k = S_beta' S^-1 nu
    x <- x + K nu,  V <- V - K S_beta,  P <- M;  to the next block all of them fade by f

    Only products of columns enter, so the rows of a block are summed first.

    Parameters
    ----------
    columns : whitened rows
    variance : (m,) stationary variance of the states
    persistence : f, share of a state that lasts to the next block

    Returns
    -------
    (blocks, p, p) and (blocks, p)
    """
    m, p = columns.state.shape[1], columns.candidates.shape[1]
    P, x, V = np.diag(variance), np.zeros(m), np.zeros((m, p))
    information, score = np.zeros((BLOCKS, p, p)), np.zeros((BLOCKS, p))
    everything = np.hstack([columns.state, columns.candidates, columns.residual[:, None]])
    for k in range(BLOCKS):
        inside = everything[columns.block == k]
        if len(inside):
            products = inside.T @ inside
            HH, HG, Hz = products[:m, :m], products[:m, m:-1], products[:m, -1]
            GG, Gz = products[m:-1, m:-1], products[m:-1, -1]
            M = np.linalg.solve(np.eye(m) + P @ HH, P)
            H_S, H_nu = HG + HH @ V, Hz - HH @ x
            S_S = GG + HG.T @ V + V.T @ H_S
            S_nu = Gz - HG.T @ x + V.T @ H_nu
            MHS = M @ H_S
            information[k], score[k] = S_S - H_S.T @ MHS, S_nu - MHS.T @ H_nu
            x, V, P = x + M @ H_nu, V - MHS, 0.5 * (M + M.T)
        x, V = persistence * x, persistence * V
        P = persistence**2 * P + (1.0 - persistence**2) * np.diag(variance)
    return information, score


def part_of(found: Evidence, fitting: bool) -> Evidence:
    """The evidence of the first two thirds of the blocks, or of all."""
    last = 2 * BLOCKS // 3 if fitting else BLOCKS
    return replace(found, information=found.information[:last], score=found.score[:last])


def gain(found: Evidence, key: str, full: FloatArray) -> float:
    """Drop of -2 log L by the effect at its known size: 2 b' beta - beta' Lambda beta."""
    i = found.columns(key)
    b, L = found.total_score[i], found.total_information[np.ix_(i, i)]
    return float(2.0 * b @ full - full @ L @ full)


def full_sizes(location: Location, position: FloatArray) -> dict[str, FloatArray]:
    """The size of each effect that is known beforehand, as the mean over the recording."""
    rows = np.isfinite(position[location.ranges.epoch, 0])
    motion = circumstances(location.ranges.rows(rows), np.where(np.isfinite(position), position, 1e7))
    if not len(motion):
        return {name: np.zeros(1) for name in MODELLED}
    return {name: np.array([float(np.mean(full_size(name, motion)))]) for name in MODELLED}


def next_effect(
    location: Location, position: FloatArray, keep: BoolArray, alpha: float, known: bool = False, fitting: bool = False
) -> tuple[Called | None, list[Statistic]]:
    """The strongest effect that passes at family-wise error alpha, and the statistics of all that are not modelled.

    The size that is known must also fit better than none.
    """
    candidates = [Candidate(name) for name in MODELLED if name not in location.effects]
    if not candidates:
        return None, []
    found = part_of(evidence(location, position, candidates, keep, known), fitting)
    statistics = [statistic_of(found, candidate.key) for candidate in candidates]
    full = full_sizes(location, position)
    threshold = alpha / (len(MODELLED) + 1)
    passing = [s for s in statistics if s.p_value < threshold and gain(found, s.name, full[s.name]) > 0.0]
    if not passing:
        return None, statistics
    best = min(passing, key=lambda s: s.log_p_corrected)
    rivals = rivals_of(found, best.name, full, threshold, passing)
    return Called(best.name, None, best, full[best.name], rivals, None, known), statistics


def rivals_of(
    found: Evidence, name: str, full: Mapping[str, FloatArray], threshold: float, passing: Sequence[Statistic]
) -> tuple[str, ...]:
    """Effects that explain the same nearly as well: given either one, nothing calls for the other."""
    best = gain(found, name, full[name])
    rivals = []
    for other in (s.name for s in passing if s.name != name):
        if gain(found, other, full[other]) < best - 10.0:
            continue
        if min(statistic_of(found, name, [other]).p_value, statistic_of(found, other, [name]).p_value) > threshold:
            rivals.append(other)
    return tuple(rivals)


def next_fault(location: Location, position: FloatArray, keep: BoolArray, alpha: float) -> Called | None:
    """The satellite whose fault explains most, with its onset, if it passes at family-wise error alpha.

    To be asked about a fix that models every known effect: what these explain is no fault. All satellites are scored
    over the whole time, the strongest of them with every onset by the search that flights and poses use; the likelihood
    names satellite and onset.
    """
    names = np.unique(location.ranges.satellite[keep & np.isfinite(location.fixes.residual)]).tolist()
    whole = [Candidate(FAULT.name, name) for name in names]
    if not whole:
        return None
    found = evidence(location, position, whole, keep)
    scores = {candidate: statistic_of(found, candidate.key) for candidate in whole}
    if min(s.log_p for s in scores.values()) > np.log(alpha / ((len(MODELLED) + 1) * len(names))):
        return None
    strongest = [str(c.satellite) for c in sorted(whole, key=lambda c: -scores[c].statistic)[:SHORTLIST]]
    ranges = location.ranges
    span, time = float(np.ptp(ranges.t)), ranges.time - ranges.t[0]
    stamps = {name: np.unique(time[keep & (ranges.satellite == name)]) for name in strongest}

    def rows_of(steps: Sequence[Step]) -> Rows:
        found = evidence(location, position, [Candidate(FAULT.name, *step) for step in steps], keep)
        return rows_with(found, np.concatenate([[1.0, max(span - onset, 1.0)] for _, onset in steps]))

    gain, (satellite, onset) = strongest_onset(rows_of, stamps, FAULT.size, span)
    chosen = Candidate(FAULT.name, satellite, onset)
    statistic = statistic_of(evidence(location, position, [chosen], keep), chosen.key)
    if not statistic.p_value < alpha / ((len(MODELLED) + 1) * len(names) * SEARCHED):
        return None
    confused = sorted(name for name in strongest if name != satellite and gain[name] > gain[satellite] - CONFUSED)
    confused_with = tuple(f"{FAULT.name} of {name}" for name in confused)
    return Called(FAULT.name, satellite, statistic, statistic.beta, confused_with, (onset, span), False)


def rows_with(found: Evidence, unit: FloatArray) -> Rows:
    """As many rows as columns, with the information and the score of the whole time: L = W'W, b = W' white.

    Parameters
    ----------
    unit : (p,) of each parameter; a drift by what it makes of a range until the end is known about as well as an offset
    """
    L, b = found.total_information / np.multiply.outer(unit, unit), found.total_score / unit
    size = np.sqrt(np.maximum(L.diagonal(), 1e-300))
    power, directions = np.linalg.eigh(L / np.multiply.outer(size, size))
    there = power > 1e-13 * power[-1]
    root, directions = np.sqrt(power[there]), directions[:, there]
    white = directions.T @ (b / size) / root
    return Rows(
        np.zeros((len(white), 0)), (directions * root).T * size, white, np.full(len(white), ""), np.zeros(len(white))
    )


def next_steady_fault(location: Location, keep: BoolArray, alpha: float) -> Called | None:
    """A satellite that is off for the whole log, if the probability of no such fault is below alpha.

    The evidence is that of `estimator.positioning.steady_fault`: 2 log B stands for the statistic, and the posterior
    probability of no fault for the p-value, which bounds it from above.
    """
    found = steady_fault(location, keep)
    if found is None or 1.0 - found.confident >= alpha:
        return None
    log_p = float(np.log(max(1.0 - found.confident, 1e-300)))
    beta, std = np.array([found.offset, 0.0]), np.array([found.std, np.inf])
    detectable = np.array([found.std * np.sqrt(DETECTABLE_LAMBDA), np.inf])
    statistic = Statistic(FAULT.name, 2.0 * found.log_bayes, 1, 1.0, log_p, log_p, beta, std, detectable)
    span = float(np.ptp(location.ranges.t))
    confused = tuple(f"{FAULT.name} of {name}" for name in found.others)
    return Called(FAULT.name, found.satellite, statistic, beta, confused, (0.0, span), False)
