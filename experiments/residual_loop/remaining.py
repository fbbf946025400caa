"""What a model leaves in the residual, by stream, kind and size; and which of it is structure of the mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sinan.estimator.evidence.noise_left import noise_left
from sinan.estimator.evidence.probes import followed
from sinan.estimator.evidence.score import Evidence, Statistic, log_p_of_deviance, statistic_of
from sinan.estimator.evidence.source import Fit, Source, StreamResidual, log_p_needed
from sinan.estimator.evidence.term import Term
from sinan.estimator.evidence.whiteness import autocorrelation, whiteness
from sinan.estimator.filter.faults import FROZEN_LEVEL
from sinan.experiments.residual_loop.options import Option
from sinan.experiments.residual_loop.trials import Finding
from sinan.sensors.bounds import ASSUMED

#: A residual whose variance is this many times the declared noise, and that is coloured or has not the law of noise, is
#: an error that nobody declared, not noise that was declared badly: a choice, twice the standard deviation. Of
#: a slow noise 1.8 and 2.4 times as large half calls both an error, twice none (`bounds_of_work left`).
GROSS = 4.0
#: What stands out of a stream's blocks has this many times the usual energy: a choice, twice the size. Of 4 s
#: that are 1.8 and 2.4 times as noisy half calls both a burst, twice none (`bounds_of_work left`).
_BURST = 4.0
#: Blocks of a stream whose energy is compared, at most: a choice. Half changes no word, twice calls a slow noise a
#: burst too (`bounds_of_work left`).
_BLOCKS = 40
#: Blocks at least, readings that each has at least, and lags at which they repeat: bound of work
#: (`bounds_of_work left`).
_LEAST_BLOCKS, _LEAST_READINGS, _LAGS = 5, 8, 50
#: An interval this long after a reading includes it [s, or readings]: the step of the finest stamps, of a ULog, 1 us =
#: 1e-6 s.
_JUST_AFTER = 1e-6
#: Readings from which the normal approximation of kurtosis holds (Anscombe and Glynn 1983; SciPy's `normaltest`).
_LEAST_OF_A_LAW = 20
#: Largest distance from the law of noise that tails and coarse counts make, by Kolmogorov and Smirnov: a choice.
#: Student's t of three makes 0.09 and counts of 0.45 sigma as much, one reading in ten that is six times as large 0.14,
#: so that half calls heavy tails two kinds of readings and twice misses those that are (`test_remaining`).
_MIXED = 0.1
#: Share of what it explains that a probe may miss, of a function that is off by sqrt(0.1), a third of its size: a
#: choice, half and twice of which change nothing of a barometer that is noisier than declared (`bounds_of_work left`).
_LEFT_BY_PROBES = 0.1
#: A sensor that did not measure for a smaller share of the recording than this is no unexplained error: a choice. Of a
#: minute 40 ms are told and 80 ms are an error; half calls both so, and twice none (`bounds_of_work frozen`).
_LEAST_FAULT = 1e-3


@dataclass(frozen=True)
class Remaining:
    """Something left in the residual.

    Attributes
    ----------
    kind : "variance", "colour" or "local"
    excess : relative size: of the variance over 1, largest autocorrelation, offset over sigma
    follows : "time", "place" or the name of a covariate
    in_mean : whether it is structure of the mean, which the catalogue should explain
    what : in words, where kind and excess do not say it
    """

    stream: str
    kind: str
    excess: float
    follows: str
    p_value: float
    in_mean: bool
    what: str = ""


def remaining(
    source: Source, fit: Fit, left: Sequence[Option], suspects: Sequence[tuple[Term, Statistic]], alpha: float
) -> list[Remaining]:
    """What the final model leaves, by stream.

    Variance off the declared noise and stationary colour are no structure of the mean. What is: time-localised offsets
    that pass their test; what follows a place or a covariate; stretches in which a sensor did not measure; a burst, and
    a residual far larger than the declared noise that is coloured, or of two kinds of readings.

    Parameters
    ----------
    fit : the model with the effects found
    left : options that pass their test about it but were not accepted
    suspects : probes that pass theirs
    alpha : level of each test
    """
    found: list[Remaining] = []
    known = source.noise_known
    residuals = source.residuals(fit)
    for r in residuals:
        colour = whiteness(r.centred, float(np.mean(r.dof)))
        is_coloured = colour is not None and colour[1] < alpha
        if known:
            # noise that is found and a little off is that of its class
            found += [one for one in _variance(r, alpha) if one.in_mean or not source.is_predicting]
        if colour is not None and is_coloured and (r.stream not in ASSUMED or not source.is_predicting):
            found.append(Remaining(r.stream, "colour", colour[0], "time", colour[1], False))
        found += _bursts(r, alpha, known)
    for option in left:
        if option.term.interval is not None:
            p = float(np.exp(option.log_p))
            size = float(np.sqrt(option.statistic / max(option.dof, 1)))
            stream = option.term.effect.stream
            what = f"an offset of {size:.3g} sigma of {stream} {residuals[0].when(*option.term.interval)}"
            found.append(Remaining(stream, "local", size, "time", p, True, what))
    for term, s in suspects:
        stream, follows = followed([term.name])[0]
        found.append(Remaining(stream, "local", float(np.sqrt(s.statistic / max(s.dof, 1))), follows, s.p_value, True))
    return found + _faults(source, residuals)


def stands_out(
    source: Source, fit: Fit, finding: Finding, suspects: Sequence[tuple[Term, Statistic]], alpha: float
) -> bool:
    """Whether an effect found given an error that nothing explains would still be found in what that error leaves.

    Its gain is divided by the long-run variance of the streams that it shows in: what the probes leave is as large, and
    as slow, as the noise of that recording. Where no noise is declared, by the scatter of its own block scores. An
    interval never does: what has no name takes any shape in time. Nor does an effect of which no component is known to
    within its plausible size; nor anything where a stream that it shows in is left with an error far larger than its
    noise, since the probes have then not told what that error looks like; nor what explains no more than the probes,
    which are generic, may have left of theirs.
    """
    if finding.term.interval is not None:
        return False
    stream = finding.term.effect.stream
    if not finding.term.in_mean:  # wrong readings are so against a mean that is known
        return all(followed([term.name])[0][0] != stream for term, _ in suspects)
    evidence = source.evidence(fit, own_terms_only=True)
    if not _says_something(evidence, fit, finding.term):
        return False
    known = source.noise_known
    if known:
        own = {r.stream for r in source.residuals(fit)}
        followed_by = [(followed([term.name])[0][0], s.statistic) for term, s in suspects]
        probed = [gain for other, gain in followed_by if stream not in own or other == stream or other not in own]
        left = _LEFT_BY_PROBES * max(probed, default=0.0)
        if finding.gain < left or noise_left(source, fit, stream, slow=False) > GROSS:
            return False
    inflation = noise_left(source, fit, stream, slow=True) if known else max(finding.spread**2, 1.0)
    return log_p_of_deviance(evidence, finding.gain, len(finding.beta), inflation) < log_p_needed(source, alpha)


def patches(source: Source, fit: Fit, findings: Sequence[Finding], alpha: float) -> tuple[Term, ...]:
    """The intervals, where the fit leaves a stream with an error far larger than its noise: what has no name takes any
    shape in time, through the filter in other streams too, and its largest piece is cut out as an interval. Not of the
    level, which every acceleration breaks.
    """
    if not source.noise_known or not any(
        r.stream not in ASSUMED and _is_gross(r, alpha) for r in source.residuals(fit)
    ):
        return ()
    return tuple(finding.term for finding in findings if finding.term.interval is not None)


def _says_something(evidence: Evidence, fit: Fit, term: Term) -> bool:
    """Whether a component of an effect is known better than by what instruments have, or as larger than that."""
    plausible = evidence.plausible[evidence.columns(term.key)]
    if np.all(np.isinf(fit.std[term])):
        return bool(np.any(np.abs(fit.beta[term]) > plausible))
    std = statistic_of(evidence, term.key, fit.keys_given(term)).std
    return bool(np.any(std < plausible))


def _variance(r: StreamResidual, alpha: float) -> list[Remaining]:
    n, total = int(np.sum(r.dof)), float(np.sum(r.whitened**2))
    p = 2.0 * float(min(stats.chi2.sf(total, n), stats.chi2.cdf(total, n)))
    if p >= alpha:
        return []
    return [Remaining(r.stream, "variance", total / n - 1.0, "time", min(p, 1.0), _is_gross(r, alpha))]


def _is_gross(r: StreamResidual, alpha: float) -> bool:
    """Whether a residual is far larger than the declared noise, and coloured or of two kinds of readings."""
    if r.nis_per_dof <= GROSS:
        return False
    colour = whiteness(r.centred, float(np.mean(r.dof)))
    return (colour is not None and colour[1] < alpha) or _is_mixed(r, alpha)


def _is_mixed(r: StreamResidual, alpha: float) -> bool:
    """Whether a share of the readings is of something else, say a second echo: skewness and kurtosis are not those of
    noise (D'Agostino and Pearson 1973), nor is the law, by a distance that tails do not make.
    """
    if len(r.t) < _LEAST_OF_A_LAW or r.stream in ASSUMED:
        return False
    columns = [z[told] for z, told in zip(r.whitened.T, r.tells.T, strict=True)]
    columns = [z for z in columns if len(z) >= _LEAST_OF_A_LAW and np.ptp(z) > 0.0]
    if not columns:
        return False
    p = [float(stats.normaltest(z).pvalue) for z in columns]
    away = max(float(stats.kstest((z - z.mean()) / z.std(), "norm").statistic) for z in columns)
    return min(p) < alpha / len(p) and away > _MIXED


def _bursts(r: StreamResidual, alpha: float, known: bool = True) -> list[Remaining]:
    """Blocks of time in which a stream's residual is far larger than usual.

    Under stationary noise the energy of a block, over the median of all, is F with the block's degrees of freedom,
    which correlation divides: n / (1 + 2 sum rho^2) for the energy of a Gaussian process. Where no noise is declared,
    nothing says that it was the same throughout: a burst is no structure of the mean then.
    """
    blocks = min(_BLOCKS, len(r.t) // _LEAST_READINGS)
    if blocks < _LEAST_BLOCKS or r.stream in ASSUMED:  # an assumption, which every acceleration breaks
        return []
    z2 = np.sum(r.whitened**2, axis=1) / r.dof
    parts = np.array_split(z2, blocks)
    energy = np.array([(part.sum() - part.max()) / (len(part) - 1) for part in parts])  # one wrong reading is no burst
    usual = float(np.median(energy))
    dof = max(float(np.sum(r.dof)) / blocks / _repeats(r), 1.0)
    usual /= float(stats.chi2.median(dof)) / dof
    ratio = float(np.max(energy)) / max(usual, 1e-300)
    p = min(blocks * float(stats.f.sf(ratio, dof, dof * (blocks - 1))), 1.0)
    if ratio < _BURST or p >= alpha:
        return []
    ends = np.cumsum([0, *(len(part) for part in parts)])
    k = int(np.argmax(energy))
    when = r.when(float(r.t[ends[k]]), float(r.t[ends[k + 1] - 1]) + _JUST_AFTER)
    what = f"the {r.stream} residual is {np.sqrt(ratio):.2g} times its usual size {when}"
    return [Remaining(r.stream, "local", float(np.sqrt(ratio)), "time", p, known, what)]


def _repeats(r: StreamResidual) -> float:
    """1 + 2 sum rho^2 over the first lags, by what one noise as large in every reading would have: z over its size."""
    z = np.sign(r.centred) * np.sqrt(np.abs(r.centred))  # a burst must not stand for the whole correlation
    return 1.0 + 2.0 * float(np.sum(autocorrelation(z, min(_LAGS, len(z) // 4)) ** 2))


def _faults(source: Source, residuals: Sequence[StreamResidual]) -> list[Remaining]:
    """One entry a stream and kind of fault; its excess is the number of stretches.

    A few samples of a long recording are told, but are no unexplained error. A stretch lasts until the next reading.
    """
    least = _LEAST_FAULT * float(np.ptp(np.concatenate([r.t for r in residuals])))
    spacing = {r.stream: float(np.ptp(r.t)) / max(len(r.t) - 1, 1) for r in residuals}
    lasted: dict[tuple[str, str], list[float]] = {}
    for stream, kind, start, stop in source.faults():
        lasted.setdefault((stream, kind), []).append(stop - start + spacing.get(stream, 0.0))
    return [
        Remaining(
            stream, "local", float(len(times)), "time", FROZEN_LEVEL, sum(times) > least,
            f"{stream} was {kind} in {len(times)} stretch{'es' if len(times) > 1 else ''}, {sum(times):.3g} s in all",
        )
        for (stream, kind), times in lasted.items()
    ]  # fmt: skip
