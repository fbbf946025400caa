"""Evidence, refit and residuals of any least-squares problem, for the loop: poses and turns.

The problem gives whitened residuals and their derivatives; this module fits the nuisance parameters, projects them out
of the information and the score, and searches the intervals of localised effects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sinan.calibration.poses.evidence.gauss_newton import minimise
from sinan.calibration.poses.evidence.linear_problem import LinearProblem, Rows
from sinan.calibration.poses.evidence.wrong_poses import Deleted, wrong_poses
from sinan.estimator.evidence.budget import Budget
from sinan.estimator.evidence.intervals import onsets
from sinan.estimator.evidence.intervals.left_out import log_p_left_out
from sinan.estimator.evidence.intervals.localise import OffsetScan, find_interval, refine
from sinan.estimator.evidence.intervals.onsets import Step, declared_step, refined
from sinan.estimator.evidence.intervals.wrong_readings import OUTLIER, SHORTEST, isolated_outliers
from sinan.estimator.evidence.score import (
    BLOCKS,
    DETECTABLE_LAMBDA,
    Evidence,
    Statistic,
    statistic_of,
    sums_by_block,
)
from sinan.estimator.evidence.source import (
    LEAST_SPARE,
    FieldUnit,
    Fit,
    LocalFinding,
    Part,
    Signature,
    StreamResidual,
    held_out,
)
from sinan.estimator.evidence.term import Term
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.effects import Effect
from sinan.sensors.errors import InputError

#: Rows of a block at the least, where there are fewer than `BLOCKS` of that: bound of work (`bounds_of_work poses`).
_ROWS_A_BLOCK = 8
#: A single reading so many sigma off is kept out of the search for intervals: of good ones 2 norm.sf(4), one in 16,000.
_SUSPECT = 4.0
#: Rows by which the readings kept out may move an end of the interval found: 2 + 1, since two in a row are kept out at
#: most.
_ENDS_WITHIN = 3
#: Share of the degrees of freedom that a probe may take: a choice, below the half that proves little; half and twice
#: change nothing of the poses of an accelerometer (`bounds_of_work poses`).
_PROBE_SHARE = 0.4
#: A probe less likely to be chance than this is asked what it predicts: bound of work, far above what is called an
#: effect (`bounds_of_work poses`).
_WORTH_LEAVING_OUT = 0.05
#: Rows of the shortest disturbance of turns and rests: of one turn, since it has two.
_SHORTEST_OF_SUMS = 2
#: Blocks of the split that is fixed before anything is fitted; every fifth is held out, so that a fit to the rest has
#: sqrt(5/4) = 1.1 times the sigmas of one to all. 25 / 5 = 5 blocks are held out.
_SPLIT_BLOCKS, _SPLIT_EVERY = 25, 5


@dataclass(frozen=True)
class _State:
    nuisance: FloatArray
    used: BoolArray
    wrong: BoolArray


class LeastSquaresSource:
    """A `Source` made of a `LinearProblem`."""

    def __init__(self, problem: LinearProblem, zero: float = 0.0) -> None:
        self._problem, self._zero = problem, zero
        rows = problem.rows(problem.start(), {}, ())
        self._measured = rows.measured
        self._n = int(np.sum(self._measured))
        order = np.argsort(np.argsort(problem.t[self._measured], kind="stable"), kind="stable")
        blocks = max(min(_SPLIT_BLOCKS, self._n), 1)
        self._block = np.full(len(self._measured), -1)
        self._block[self._measured] = order * blocks // max(self._n, 1)
        held = self._block[self._measured] % _SPLIT_EVERY == _SPLIT_EVERY - 1
        freedom = self._n - rows.nuisance.shape[1] + int(np.sum(~self._measured))
        self._candidates = tuple(e for e in problem.candidates if freedom - e.size >= LEAST_SPARE)
        self._probes = problem.probes(int(_PROBE_SHARE * freedom))
        self._held_out = np.zeros(len(self._measured), dtype=bool)
        self._held_out[self._measured] = held
        fitted, parameters = len(rows.residual) - int(np.sum(held)), rows.nuisance.shape[1]
        if fitted <= parameters:
            raise InputError(
                problem.where,
                f"{self._n} residuals, {int(np.sum(held))} of them held out",
                f"more poses: over {parameters} residuals to fit the plain model, and one in five to test it",
            )

    @property
    def name(self) -> str:
        """Of the recording."""
        return self._problem.name

    @property
    def field(self) -> FieldUnit:
        """The unit of a magnetometer's readings."""
        return self._problem.field

    @property
    def noise_known(self) -> bool:
        """Whether the problem declares its noise."""
        return self._problem.noise_known

    @property
    def candidates(self) -> tuple[Effect, ...]:
        """Effects with a regressor known from the start that leave enough readings to contradict them."""
        return self._candidates

    @property
    def families(self) -> int:
        """Candidates, and the localised families step, transient, outliers."""
        return len(self.candidates) + 3

    @property
    def alike(self) -> Sequence[frozenset[str]]:
        """None."""
        return ()

    # ---- fitting

    def fit(self, terms: Sequence[Term], start: Mapping[Term, FloatArray] | None = None, part: Part = "all") -> Fit:
        """Gauss-Newton over nuisance parameters and beta, with halved steps where the cost would rise."""
        beta = {term: np.zeros(term.effect.size) for term in terms}
        beta.update({term: np.asarray(value) for term, value in (start or {}).items() if term in beta})
        used = self._measured & ~self._held_out if part == "fitting" else self._measured.copy()
        used |= ~self._measured
        wrong = np.zeros_like(used)
        x = self._problem.start()
        passes = 3 if any(not term.in_mean for term in terms) else 1
        for _ in range(passes):
            x, beta, information = minimise(self._problem, x, beta, used & ~wrong)
            if passes > 1:
                wrong = self._wrong_about(self._problem.rows(x, beta, ()), beta)
        rows = self._problem.rows(x, beta, ())
        active = used & ~wrong
        r = rows.residual[active]
        freedom = max(int(np.sum(active & self._measured)) - information.shape[0] + int(np.sum(~self._measured)), 1)
        sse = float(r @ r)
        noise = 1.0 if self._problem.noise_known else sse / freedom
        covariance: FloatArray = np.asarray(noise * np.linalg.pinv(information, rcond=1e-12, hermitian=True))
        deviance = sse if self._problem.noise_known else int(np.sum(active & self._measured)) * np.log(max(sse, 1e-300))
        std = self._standard_deviations(beta, covariance, len(x), wrong)
        for term in beta:
            if not term.in_mean:
                beta[term] = np.array([float(np.mean(wrong[self._measured]))])
        return Fit(tuple(terms), beta, std, deviance, part, _State(x, used, wrong))

    def alone(self, fit: Fit, term: Term, evidence: Evidence) -> FloatArray:
        """The fit's own: least squares hold nothing."""
        return fit.beta[term]

    def _standard_deviations(
        self, beta: Mapping[Term, FloatArray], covariance: FloatArray, m: int, wrong: BoolArray
    ) -> dict[Term, FloatArray]:
        std, column = {}, m
        for term, value in beta.items():
            if not term.in_mean:
                share = float(np.mean(wrong[self._measured]))
                std[term] = np.array([np.sqrt(max(share * (1 - share), 1e-12) / max(self._n, 1))])
                continue
            std[term] = np.sqrt(np.maximum(np.diag(covariance)[column : column + len(value)], 0.0))
            column += len(value)
        return std

    # ---- evidence

    def _rows_of(self, fit: Fit) -> BoolArray:
        """The rows of a fit's part, without those that are wrong about it."""
        used = ~self._held_out if fit.part == "fitting" else np.ones_like(self._held_out)
        return np.asarray(used & ~_state(fit).wrong)

    def _noise(self, fit: Fit, rows: Rows, columns: int) -> tuple[float, float, BoolArray]:
        """Noise variance of the whitened rows, its degrees of freedom, and the rows in use."""
        active = self._rows_of(fit)
        if self._problem.noise_known:
            return 1.0, np.inf, active
        freedom = max(float(np.sum(active) - columns), 1.0)
        noise = float(np.sum(rows.residual[active] ** 2)) / freedom
        return noise or np.inf, freedom, active  # as many parameters as readings leave no noise, and prove nothing

    def evidence(self, fit: Fit, own_terms_only: bool = False) -> Evidence:
        """Information and score of all candidates and of the fit's own terms, nuisance parameters projected out."""
        return self._evidence_of(fit, () if own_terms_only else self.candidates)

    def _evidence_of(self, fit: Fit, effects: Sequence[Effect]) -> Evidence:
        """The same of the fit's own terms and of these effects."""
        state = _state(fit)
        moving = fit.in_mean
        wanted = [entry for entry in effects if entry.name not in fit.keys]
        names = fit.keys + [entry.name for entry in wanted]
        rows = self._problem.rows(state.nuisance, fit.beta, wanted, known=True)
        columns = rows.nuisance.shape[1] + sum(len(fit.beta[term]) for term in moving)
        noise, noise_dof, active = self._noise(fit, rows, columns)
        S = np.hstack([rows.effects[name] for name in names])[active] if names else np.zeros((int(active.sum()), 0))
        N, r = rows.nuisance[active], rows.residual[active]
        Q = np.linalg.qr(N / np.maximum(np.linalg.norm(N, axis=0), 1e-300))[0]
        S = S - Q @ (Q.T @ S)
        information, score = sums_by_block(S, r, self._blocks(active), noise)
        by_name = {entry.name: entry for entry in wanted} | {term.key: term.effect for term in moving}
        sizes = tuple(rows.effects[name].shape[1] for name in names)
        plausible = [self._problem.plausible(by_name[name]) for name in names]
        readings = np.inf if self._problem.noise_known else float(np.sum(active & self._measured))
        sigmas = np.concatenate(plausible) if plausible else np.zeros(0)
        spare = float(np.sum(active) - columns)
        return Evidence(tuple(names), sizes, information, score, sigmas, noise_dof, readings, spare)

    def _blocks(self, active: BoolArray) -> IntArray:
        """Block of time of each active row, blocks of equal numbers of rows."""
        t = self._problem.t[active]
        order = np.argsort(np.argsort(t, kind="stable"), kind="stable")
        blocks = int(np.clip(len(t) // _ROWS_A_BLOCK, 1, BLOCKS))
        return np.asarray(order * blocks // len(t), dtype=np.int64)

    def starts(self, fit: Fit) -> Mapping[Term, FloatArray]:
        """None: every regressor is known."""
        return {}

    def detectable(self, fit: Fit, statistics: Sequence[Statistic]) -> Sequence[Statistic]:
        """The statistics; where the noise is estimated n log(1 + lambda / n) has to be 30, n the degrees of freedom, by
        which an effect that is not in the fit adds to it.
        """
        n = self.evidence(fit).noise_dof
        if not np.isfinite(n):
            return statistics
        wider = np.sqrt(np.expm1(DETECTABLE_LAMBDA / n) * n / DETECTABLE_LAMBDA)
        return [replace(s, detectable_from=s.detectable_from * wider) for s in statistics]

    # ---- localised effects

    def local_findings(self, fit: Fit, intervals: bool = True) -> Sequence[LocalFinding]:
        """The best step, the best transient, and the wrong readings, about the fit."""
        rows = self._problem.rows(_state(fit).nuisance, fit.beta, ())
        outliers = self._outlier_finding(fit, rows)
        return [*(self._intervals(fit, rows) if intervals else ()), *([outliers] if outliers else [])]

    def _intervals(self, fit: Fit, rows: Rows) -> Sequence[LocalFinding]:
        """The best step and the best transient."""
        moving = fit.in_mean
        columns = rows.nuisance.shape[1] + sum(len(fit.beta[term]) for term in moving)
        noise, noise_dof, active = self._noise(fit, rows, columns)
        wrong = self._wrong_rows(rows, _SUSPECT)
        fitted = self._fitted(rows, fit.beta)

        def scan_of(kept: IntArray) -> OffsetScan:
            everything = np.concatenate([kept, np.flatnonzero(active & ~self._measured)])
            offset = rows.offset[everything].copy()
            offset[len(kept) :] = 0.0
            root = np.sqrt(noise)
            return OffsetScan(rows.residual[everything] / root, offset / root, fitted[everything] / root)

        every = np.flatnonzero(active & self._measured)
        every = every[np.argsort(self._problem.t[every], kind="stable")]
        calm = np.flatnonzero(~wrong[every])  # an interval must not live on one wrong reading
        scan, whole = scan_of(every[calm]), scan_of(every)
        calm_dof = max(noise_dof - (len(every) - len(calm)), 1.0)
        if not self._problem.noise_known and 1.0 < calm_dof < noise_dof:  # nor hide in the noise of one
            noise *= scan.sum_of_squares / calm_dof
            scan = scan_of(every[calm])
        t = self._problem.t[every]
        instants = self._problem.instants
        after_all = max(float(t[-1]) + _after(t), float(instants[-1]) + _after(instants))
        shortest = SHORTEST if self._problem.rows_are_readings else _SHORTEST_OF_SUMS
        findings = []
        for family, to_the_end in (("transient", False), ("step", True)):
            found = find_interval(scan, to_the_end, calm_dof, shortest, len(calm))
            if found is not None:  # but its ends are where all readings put them
                ends = (int(calm[found.first]), int(calm[found.last - 1]) + 1 if found.last < len(calm) else len(t))
                first, last = refine(whole, *ends, to_the_end, shortest, _ENDS_WITHIN, len(t))
                end = float(t[last]) if last < len(t) else after_all
                term = Term(f"{self._problem.stream}.{family}", (float(t[first]), end))
                one = LocalFinding(term, found.statistic, found.dof, found.log_p, found.beta, found.searched, calm_dof)
                findings.append(one)
        return findings

    def _wrong_rows(self, rows: Rows, threshold: float = OUTLIER) -> BoolArray:
        wrong = np.zeros(len(rows.residual), dtype=bool)
        if not self._problem.rows_are_readings:  # a mean or a turn that is off is no wrong reading
            return wrong
        index = np.flatnonzero(self._measured)
        index = index[np.argsort(self._problem.t[index], kind="stable")]
        wrong[index] = isolated_outliers(rows.residual[index], 1.0 if self._problem.noise_known else None, threshold)
        return wrong

    def _fitted(self, rows: Rows, terms: Mapping[Term, FloatArray]) -> FloatArray:
        return np.hstack([rows.nuisance, *[rows.effects[term.key] for term in terms if term.in_mean]])

    def _deleted(self, rows: Rows, terms: Mapping[Term, FloatArray], used: BoolArray) -> tuple[IntArray, Deleted]:
        """Rows of the readings that a fit to `used` would be better without, and the evidence."""
        if not self._problem.rows_are_readings:
            return np.zeros(0, dtype=np.int64), Deleted(np.zeros(0, dtype=bool), 0.0, 0.0)
        index = np.flatnonzero(used)
        measured = self._measured[index]
        fitted = self._fitted(rows, terms)[index]
        found = wrong_poses(rows.residual[index], fitted, measured, self._problem.noise_known)
        in_time = np.argsort(self._problem.t[index[measured]], kind="stable")
        alone = np.convolve(found.rows[measured][in_time].astype(int), np.ones(SHORTEST, dtype=int), mode="valid")
        if np.any(alone >= SHORTEST):  # so many in a row are a disturbance
            found = Deleted(np.zeros(len(index), dtype=bool), 0.0, 0.0)
        return index[found.rows], found

    def _wrong_about(self, rows: Rows, terms: Mapping[Term, FloatArray]) -> BoolArray:
        """Readings that leave their neighbours, or that a fit to the others cannot explain."""
        wrong = self._wrong_rows(rows)
        wrong[self._deleted(rows, terms, np.ones_like(wrong))[0]] = True
        return wrong

    def _outlier_finding(self, fit: Fit, rows: Rows) -> LocalFinding | None:
        if not self._problem.rows_are_readings or any(not term.in_mean for term in fit.terms):
            return None
        used = _state(fit).used
        wrong = self._wrong_rows(rows) & used
        count = int(np.sum(wrong))
        log_p = float(stats.binom.logsf(count - 1, self._n, 2.0 * stats.norm.sf(OUTLIER))) if count else 0.0
        deleted, found = self._deleted(rows, fit.beta, used)
        statistic = float(np.sum(rows.residual[wrong] ** 2))
        if found.log_p < log_p:
            log_p, statistic = found.log_p, max(statistic, found.gain)
            wrong[deleted] = True
        if not np.any(wrong):
            return None
        term = Term(f"{self._problem.stream}.outliers")
        return LocalFinding(term, statistic, 1, log_p, np.array([float(np.sum(wrong)) / self._n]))

    # ---- what is in no catalogue

    def suspects(self, fit: Fit) -> Sequence[tuple[Term, Statistic]]:
        """Every probe and the evidence for it about the fit, the fit's own terms projected out.

        The p-value is the larger of two: of what it explains, and of what it predicts of readings left out of the fit.
        """
        here = {term.name for term in fit.terms}
        probes = [entry for entry in self._probes if entry.name not in here]
        if not probes:
            return ()
        evidence = self._evidence_of(fit, probes)
        found = [(Term(entry.name, probe=entry), statistic_of(evidence, entry.name, fit.keys)) for entry in probes]
        return [(term, self._as_left_out(fit, term, s)) for term, s in found]

    def _as_left_out(self, fit: Fit, term: Term, s: Statistic) -> Statistic:
        """The statistic with the p-value of the blocks of readings left out in turn, where that is larger."""
        if s.log_p_corrected > np.log(_WORTH_LEAVING_OUT):
            return s
        state = _state(fit)
        active = state.used & ~state.wrong
        rows = self._problem.rows(state.nuisance, fit.beta, [term.effect], known=True)
        given, added = self._fitted(rows, fit.beta)[active], rows.effects[term.key][active]
        log_p = log_p_left_out(rows.residual[active], given, added, self._block[active], self._problem.noise_known)
        return replace(s, log_p_corrected=max(s.log_p_corrected, log_p))

    def faults(self) -> Sequence[tuple[str, str, float, float]]:
        """Stretches in which the sensor did not measure; they are in no fit."""
        return self._problem.faults

    # ---- residuals

    def set_aside(self, fit: Fit) -> bool:
        """Never: each fit leaves out the readings that are wrong about it."""
        return False

    def set_aside_within(self, fit: Fit, term: Term) -> bool:
        """Never: the search has no interval as short as that."""
        return False

    def relocated(self, fit: Fit, term: Term) -> tuple[Term, FloatArray]:
        """The term with the ends of its interval where all samples put them, where a row holds many; else itself: its
        interval was searched reading by reading.
        """
        if self._problem.rows_are_readings or term.interval is None:
            return term, fit.beta[term]
        state, active = _state(fit), self._rows_of(fit)
        others = [other for other in fit.in_mean if other != term]

        def rows_of(steps: Sequence[Step]) -> onsets.Rows:
            wanted = [replace(declared_step(step), name=f"{step[0]}@{step[1]!r}") for step in steps]
            rows = self._problem.rows(state.nuisance, fit.beta, wanted, known=True)
            columns = np.hstack([rows.effects[entry.name] for entry in wanted])
            white = rows.residual + rows.effects[term.key] @ fit.beta[term]
            fitted = self._fitted(rows, {other: fit.beta[other] for other in others})
            noise = self._noise(fit, rows, fitted.shape[1] + rows.offset.shape[1])[0]
            white, columns, fitted = (values / np.sqrt(noise) for values in (white, columns, fitted))
            stream = np.full(int(np.sum(active)), self._problem.stream)
            return onsets.Rows(fitted[active], columns[active], white[active], stream, self._problem.t[active])

        t = np.unique(self._problem.t[active & self._measured])
        stamps = self._problem.instants
        spacing, interval = float(np.median(np.diff(t))), term.interval
        sample = float(np.median(np.diff(stamps)))
        to_the_end = interval[1] > t[-1]
        while spacing > sample:
            span = float(stamps[0]), interval[1] if to_the_end else float(stamps[-1]) + sample
            interval = refined(rows_of, self._problem.stream, interval, spacing, stamps, *span).interval
            spacing /= onsets.REFINED
        return replace(term, interval=interval), fit.beta[term]

    def residuals(self, fit: Fit) -> Sequence[StreamResidual]:
        """What the model leaves on all measured rows; wrong readings that the model names are left out."""
        state = _state(fit)
        rows = self._problem.rows(state.nuisance, fit.beta, ())
        keep = self._measured & ~state.wrong
        return [
            StreamResidual(
                self._problem.stream,
                self._problem.t[keep],
                rows.raw[keep][:, None],
                rows.residual[keep][:, None],
                np.ones((int(np.sum(keep)), 1), dtype=bool),
                self._held_out[keep],
                self._problem.unit,
                {name: value[keep] for name, value in self._problem.covariates.items()},
                np.flatnonzero(keep),
                self._zero,
            )
        ]

    def budget(self, plain: Fit, final: Fit) -> Sequence[Budget]:
        """None: noise is all of a pose's residual that is not an effect."""
        return ()

    @property
    def is_predicting(self) -> bool:
        """Never: nothing errs for long in a set of poses."""
        return False

    def predicts(self, fit: Fit, without: Fit, surely: bool = True) -> bool:
        """Never."""
        return False

    def weighed(self, fit: Fit, other: Fit, log_odds: Callable[[float], float]) -> float:
        """The odds alone."""
        return log_odds(1.0)

    @property
    def assumes_motion(self) -> bool:
        """No: poses are measured."""
        return False

    def gain_assuming_less(self, fit: Fit, without: Fit) -> float:
        """Infinite: nothing is assumed."""
        return np.inf

    def bears_out(self, fit: Fit, without: Fit, log_odds: Callable[[float], float], needed: float) -> bool:
        """Never."""
        return False

    def held_out(self, fit: Fit) -> Sequence[StreamResidual]:
        """The rows that no fitting part has."""
        return held_out(self.residuals(fit))

    def signature(self, before: Fit, term: Term, beta: FloatArray) -> Signature | None:
        """What an effect predicts for the residuals of a model without it, as far as the fit does not take it up."""
        if not term.in_mean:
            return None
        state = _state(before)
        model = {**before.beta, term: np.zeros(len(beta))}
        rows = self._problem.rows(state.nuisance, model, ())
        active = state.used & ~state.wrong
        own = [rows.effects[key] for key in before.keys]
        S, N = rows.effects[term.key][active] @ beta, np.hstack([rows.nuisance, *own])[active]
        predicted = S - N @ np.linalg.lstsq(N, S, rcond=1e-10)[0]
        size = rows.raw[active] / np.where(rows.residual[active] == 0.0, np.inf, rows.residual[active])
        measured = self._measured[active]
        t = self._problem.t[active][measured]
        raw = rows.raw[active][measured]
        return Signature(self._problem.stream, t, (predicted * size)[measured], raw, self._problem.unit)


def _after(t: FloatArray) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 1.0


def _state(fit: Fit) -> _State:
    assert isinstance(fit.detail, _State)
    return fit.detail
