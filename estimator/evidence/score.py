"""Information and score of every candidate effect, and the statistics made of them.

A source of evidence (a filter pass, a norm calibration, a set of pseudoranges) gives, for all candidates jointly and
block of time by block, with everything it fits besides projected out,

    Lambda_k = sum S_beta' S^-1 S_beta,    b_k = sum S_beta' S^-1 nu.

To first order E[b_k] = Lambda_k beta and Cov[b_k] = Lambda_k under the model. What follows is the same for any source.
Source: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108 (generalised likelihood ratio);
C. R. Rao, "Large sample tests of statistical hypotheses" (1948) (the score test).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from sinan.sensors.arrays import FloatArray, IntArray

#: Blocks of time over which evidence is summed: of twenty the scatter is known to sqrt(2 / 19), a third.
BLOCKS = 20
#: A direction of beta is dropped where the data, taken together, leave it wider than this many plausible sizes: a
#: filter linearised at noisy points claims a little information on directions that it cannot see. A choice, three times
#: what is called implausible; half and twice change nothing of the poses of an accelerometer (`bounds_of_work poses`).
WIDEST_DIRECTION = 30.0
#: Degrees of freedom of the places' variances in the laws that are tried of gains at other places: bound of work
#: (`bounds_of_work flight`).
_TAILS = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 64.0])
#: The logarithm of their scale, in steps of log(1e6) / 138 = 0.1, so that a variance is met to half of 10 %.
_LOG_VARIANCES = np.linspace(0.0, np.log(1e6), 139)
#: The gain below which a place is as good as any: bound of work (`bounds_of_work flight`).
_LEAST_GAIN = 1e-3


@dataclass(frozen=True)
class Evidence:
    """Information and score of all candidates jointly, by block of time.

    Attributes
    ----------
    names : of the candidates
    sizes : number of parameters of each
    information : (blocks, p, p), p the sum of the sizes
    score : (blocks, p)
    plausible : (p,) plausible 1-sigma sizes, the unit in which directions of beta are compared
    noise_dof : degrees of freedom from which the noise level was estimated, with what the model lacks still in it;
        infinite where its scale is given
    readings : n, where -2 log L is n log SSE since the noise is estimated; infinite where its scale is given
    spare : readings less parameters of the fit; infinite where nobody counts them
    prior_sigma : 1-sigma with which a fit holds each parameter to zero, in plausible sizes; infinite where it does not
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]
    information: FloatArray
    score: FloatArray
    plausible: FloatArray
    noise_dof: float = np.inf
    readings: float = np.inf
    spare: float = np.inf
    prior_sigma: float = np.inf

    @property
    def noise_known(self) -> bool:
        """Whether the scale of the noise is a given of the test, as `Source.noise_known` has it."""
        return not np.isfinite(self.noise_dof)

    def columns(self, *names: str) -> list[int]:
        """Column numbers of the named candidates."""
        starts = np.concatenate([[0], np.cumsum(self.sizes)])
        where = {name: range(starts[i], starts[i + 1]) for i, name in enumerate(self.names)}
        return [column for name in names for column in where[name]]

    @property
    def total_information(self) -> FloatArray:
        """(p, p) over all blocks."""
        return np.asarray(self.information.sum(axis=0))

    @property
    def total_score(self) -> FloatArray:
        """(p,) over all blocks."""
        return np.asarray(self.score.sum(axis=0))


@dataclass(frozen=True)
class Statistic:
    """What the evidence says about one candidate.

    Attributes
    ----------
    name : of the candidate
    statistic : b' Lambda^-1 b, chi-square with `dof` under "no effect"; with an estimated noise level the likelihood
        ratio nu log(SSE before / SSE after) that becomes it
    dof : number of directions of beta that the data can see
    scatter : of the block scores about one constant beta; 1 for a true effect, above for a wrong one or for colour
    log_p, log_p_corrected : logarithm of the p-value, as it is and with the evidence divided by max(1, scatter), which
        itself scatters about 1 under "no effect" (`log_p_of_divided`)
    beta, std : (size,) first-order estimate and its 1-sigma (infinite in directions that are not seen)
    detectable_from : (size,) smallest component that could be told from none (lambda = 30), the others free; see also
        `Source.detectable`
    """

    name: str
    statistic: float
    dof: int
    scatter: float
    log_p: float
    log_p_corrected: float
    beta: FloatArray
    std: FloatArray
    detectable_from: FloatArray

    @property
    def p_value(self) -> float:
        """Of the corrected statistic."""
        return float(np.exp(self.log_p_corrected))


#: Two models whose odds differ by a factor of less than exp(5) are not told apart (Kass and Raftery 1995: 2 log of the
#: Bayes factor above 10 is "very strong" evidence).
CONFUSED = 10.0
#: lambda = beta' Lambda beta at which an effect is found nine times in ten: of three parameters among 50 candidates,
#: ncx2.sf(chi2.isf(0.01 / 50, 3), 3, 30) = 89 % (at 30 to 45, 96 % of simulated cases).
DETECTABLE_LAMBDA = 30.0


#: Nodes and weights on (0, 1) for means over the scatter's distribution: right to four digits.
_QUADRATURE = tuple(
    0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(16), (1.0, 0.0), strict=True)
)


def gain_of(
    information: FloatArray, score: FloatArray, floor: Callable[[FloatArray], FloatArray | float]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """By how much the weighted sum of squares drops with each of m sets of k parameters, along what is seen of them.

    Parameters
    ----------
    information, score : (m, k, k), (m, k)
    floor : of the (m, k) eigenvalues of the information, rising: above which a direction counts as seen, (m, 1) or all

    Returns
    -------
    (m,) gain b' L^-1 b, (m,) directions seen, (m, k) estimate
    """
    values, vectors = np.linalg.eigh(information)
    seen = values > floor(values)
    along = np.einsum("mij,mi->mj", vectors, score)
    inverse = np.where(seen, 1.0 / np.where(seen, values, 1.0), 0.0)
    return np.sum(along**2 * inverse, axis=1), seen.sum(axis=1), np.einsum("mij,mj->mi", vectors, along * inverse)


def log_p_value(gain: float, dof: int, noise_dof: float = np.inf, scatter: float = 1.0) -> float:
    """Logarithm of the p-value of a drop in the weighted sum of squares.

    Declared noise: chi-square(gain / scatter). Estimated noise: F of (gain / dof) / (what is left / its dof) / scatter.

    Parameters
    ----------
    gain : drop of the sum of squares in units of the present noise variance
    dof : parameters that brought it; 0 gives 0 (p = 1)
    noise_dof : degrees of freedom of the present noise estimate; infinite: declared
    scatter : divides the evidence where it exceeds 1
    """
    scatter = max(1.0, scatter)
    if dof == 0:
        return 0.0
    if not np.isfinite(noise_dof):
        log_p = float(stats.chi2.logsf(gain / scatter, dof))
        return log_p if np.isfinite(log_p) else -0.5 * gain / scatter
    left = noise_dof - dof
    if left <= 0.0:
        return 0.0
    rest = max(noise_dof - gain, 1e-12 * noise_dof)
    F = (gain / dof) / (rest / left) / scatter
    log_p = float(stats.f.logsf(F, dof, left))
    return log_p if np.isfinite(log_p) else -0.5 * left * float(np.log1p(dof * F / left))  # the tail's leading term


def log_p_of_deviance(evidence: Evidence, gain: float, dof: int, scatter: float = 1.0) -> float:
    """Logarithm of the p-value of a drop of -2 log L between two fits.

    With estimated noise it is n log(SSE before / SSE after), from which F follows.

    Parameters
    ----------
    evidence : about the fit with the parameters in question
    gain : the drop
    dof, scatter : see `log_p_value`
    """
    if gain <= 0.0:
        return 0.0
    if evidence.noise_known:
        return log_p_value(gain, dof, scatter=scatter)
    before = evidence.noise_dof + dof
    return log_p_value(before * (1.0 - float(np.exp(-gain / evidence.readings))), dof, before, scatter)


def log_p_of_estimate(evidence: Evidence, information: float, dof: int) -> float:
    """Logarithm of the p-value of b' Lambda b of an estimate that is zero.

    With estimated noise the same over its parameters is F, and without them -2 log L would be larger by
    n log(1 + b' Lambda b / noise_dof).

    Parameters
    ----------
    evidence : about the fit with the parameters in question
    information : b' Lambda b
    dof : parameters
    """
    if evidence.noise_known:
        return log_p_value(information, dof)
    gain = evidence.readings * float(np.log1p(information / max(evidence.noise_dof, 1.0)))
    return log_p_of_deviance(evidence, gain, dof)


def log_p_of_divided(gain: float, dof: int, scatter: float, scatter_dof: int) -> float:
    """Logarithm of the p-value of T = gain / max(1, scatter), as T is distributed where nothing is missing.

    Gain and scatter are independent there, chi-square with `dof` and, divided by it, with `scatter_dof` (Cochran), so
    P(T > t) = E[Q(t max(1, s))] with Q the tail of chi-square: exact, where Q(t) alone is too cautious.
    """
    if dof == 0:
        return 0.0
    t = gain / max(1.0, scatter)
    if scatter_dof < 1:
        return log_p_value(t, dof)
    below = 1.0 - float(special.chdtrc(scatter_dof, scatter_dof))
    nodes, weights = _QUADRATURE
    above = (1.0 - below) * nodes
    divisors = np.concatenate([[1.0], special.chdtri(scatter_dof, above) / scatter_dof])
    shares = np.concatenate([[below], (1.0 - below) * weights])
    first = log_p_value(t, dof)
    rest = special.chdtrc(dof, t * divisors) / max(float(special.chdtrc(dof, t)), 1e-300)
    return first + float(np.log(below + min(float(shares[1:] @ rest[1:]), 1.0 - below)))


def log_p_among(gain: float, peers: FloatArray, dof: int) -> float:
    """Logarithm of the p-value of a gain a degree of freedom among those of its peers, (m,), other places.

    What is wrong with the noise is stronger in one place than in another: with a variance s^2 of each place drawn from
    a scaled inverse chi-square law such gains follow s0^2 F(dof, nu) (Smyth, 2004, Stat. Appl. Genet. Mol. Biol. 3(1),
    section 6.2). s0^2, at least 1, and nu are those of the largest likelihood. Neglects how well so few places tell
    them: one in twenty passes at 1 %, and of the strongest of many places more.
    """
    log_f = np.log(np.maximum(peers, _LEAST_GAIN)) - _LOG_VARIANCES[:, None]
    fits = [np.sum(stats.f.logpdf(np.exp(log_f), dof, nu) + log_f, axis=1) for nu in _TAILS]
    nu, variance = np.unravel_index(int(np.argmax(fits)), (len(_TAILS), len(_LOG_VARIANCES)))
    return float(stats.f.logsf(gain / np.exp(_LOG_VARIANCES[variance]), dof, _TAILS[nu]))


def likelihood_ratio(gain: float, noise_dof: float) -> float:
    """The gain as a likelihood ratio: itself with declared noise, nu log(1 / (1 - gain / nu)) with estimated noise."""
    if not np.isfinite(noise_dof):
        return gain
    return float(-noise_dof * np.log(max(1.0 - gain / noise_dof, 1e-12)))


def gain_of_ratio(statistic: float, noise_dof: float) -> float:
    """The gain behind a likelihood ratio: the inverse of `likelihood_ratio`."""
    if not np.isfinite(noise_dof):
        return statistic
    return float(noise_dof * (1.0 - np.exp(-statistic / noise_dof)))


def sums_by_block(S: FloatArray, r: FloatArray, block: IntArray, noise: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """(blocks, p, p) information S' S / noise and (blocks, p) score S' r / noise of whitened rows.

    Parameters
    ----------
    S, r : (rows, p), (rows,) sensitivities and innovations or residuals
    block : (rows,) number of each row's block
    noise : variance of the whitened rows
    """
    inside = [block == k for k in range(int(block.max()) + 1)]
    information = np.stack([S[rows].T @ S[rows] / noise for rows in inside])
    return information, np.stack([S[rows].T @ r[rows] / noise for rows in inside])


def statistic_of(evidence: Evidence, name: str, given: Sequence[str] = ()) -> Statistic:
    """The statistic of one candidate, with the effects in `given` fitted as well (Schur complement).

    b_i.g = b_i - Lambda_ig Lambda_gg^-1 b_g,   Lambda_i.g = Lambda_ii - Lambda_ig Lambda_gg^-1 Lambda_gi
    """
    information, score = project_out(evidence, name, given)
    columns = evidence.columns(name)
    plausible = evidence.plausible[columns]
    basis = _seen_directions(information.sum(axis=0), plausible)
    size = len(columns)
    if basis.shape[1] == 0:
        unseen = np.full(size, np.inf)
        return Statistic(name, 0.0, 0, 1.0, 0.0, 0.0, np.zeros(size), unseen, unseen)
    L = np.einsum("ia,kij,jb->kab", basis, information, basis)
    b = score @ basis
    total, total_score = L.sum(axis=0), b.sum(axis=0)
    x = np.linalg.solve(total, total_score)
    inverse = np.linalg.inv(total)
    covariance = basis @ inverse @ basis.T
    lost = 1.0 - np.sum((basis / plausible[:, None]) ** 2, axis=1) > 1e-3  # a share of the component is unseen
    std = np.where(lost, np.inf, np.sqrt(np.diag(covariance)))
    gain, dof, noise_dof = float(total_score @ x), basis.shape[1], evidence.noise_dof
    scatter, scatter_dof = block_scatter(L, b, x)
    if np.isfinite(noise_dof):  # the noise that is left once the effect is in the model
        scatter *= max(noise_dof - dof, 1.0) / max(noise_dof - gain, 1e-12 * noise_dof)
        log_p_corrected = log_p_value(gain, dof, noise_dof, scatter)
    else:
        log_p_corrected = log_p_of_divided(gain, dof, scatter, scatter_dof)
    return Statistic(
        name,
        likelihood_ratio(gain, noise_dof),
        dof,
        scatter,
        log_p_value(gain, dof, noise_dof),
        log_p_corrected,
        basis @ x,
        std,
        np.sqrt(DETECTABLE_LAMBDA) * std,
    )


def log_evidence_of_all(W: FloatArray, white: FloatArray, plausible: FloatArray) -> float:
    """Logarithm of the odds for all candidates at once against none, each N(0, plausible^2), whatever their sizes:

    1/2 b' (Lambda + P^-1)^-1 b - 1/2 log |1 + P Lambda|

    Parameters
    ----------
    W, white : (rows, p), (rows,) sensitivities and whitened innovations
    plausible : (p,)
    """
    W = W * plausible
    A, b = np.eye(W.shape[1]) + W.T @ W, W.T @ white
    return 0.5 * float(b @ np.linalg.solve(A, b)) - 0.5 * float(np.linalg.slogdet(A)[1])


def sigma_of_wide(evidence: Evidence, name: str, given: Sequence[str] = ()) -> FloatArray:
    """(size,) 1-sigma of each component of a candidate, the others free within what counts as seen: of two kinds of
    noise comparable, where a direction is seen with one of them alone.
    """
    information, _ = project_out(evidence, name, given)
    widest = WIDEST_DIRECTION * evidence.plausible[evidence.columns(name)]
    return np.sqrt(np.diag(np.linalg.inv(information.sum(axis=0) + np.diag(widest**-2.0))))


def log_p_of_held(evidence: Evidence, s: Statistic, given: Sequence[str] = ()) -> float:
    """Logarithm of the p-value of what an effect explains that is held to zero as the fit holds its own,

        b' (Lambda + P^-1)^-1 b,

    of what only a size explains that does not occur hardly anything.

    Parameters
    ----------
    s : the statistic of the effect, with the same `given`
    """
    if not np.isfinite(evidence.prior_sigma):
        return s.log_p
    information, score = project_out(evidence, s.name, given)
    held = np.diag((evidence.prior_sigma * evidence.plausible[evidence.columns(s.name)]) ** -2.0)
    total = score.sum(axis=0)
    return log_p_value(float(total @ np.linalg.solve(information.sum(axis=0) + held, total)), s.dof, evidence.noise_dof)


def project_out(evidence: Evidence, name: str, given: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """(blocks, size, size) and (blocks, size): information and score of a candidate with `given` projected out.

    The projection is that of all blocks together, applied to each, so that the blocks still add up.
    """
    i = evidence.columns(name)
    own = evidence.information[:, i][:, :, i]
    score = evidence.score[:, i]
    if not given:
        return own, score
    g = evidence.columns(*given)
    scale = evidence.plausible[g]
    Lgg = evidence.total_information[np.ix_(g, g)] * np.outer(scale, scale)
    Lgi = evidence.total_information[np.ix_(g, i)] * scale[:, None]
    A = scale[:, None] * (np.linalg.pinv(Lgg, rcond=1e-12, hermitian=True) @ Lgi)
    cross = evidence.information[:, g][:, :, i]
    middle = np.einsum("ga,kgj->kaj", A, cross)
    information = own - middle - np.swapaxes(middle, 1, 2)
    information = information + np.einsum("ga,kgh,hb->kab", A, evidence.information[:, g][:, :, g], A)
    return information, score - evidence.score[:, g] @ A


def block_scatter(information: FloatArray, score: FloatArray, beta: FloatArray) -> tuple[float, int]:
    """Scatter of the block scores about one constant beta, per degree of freedom, and how many it has.

    sum_k e_k' Lambda_k^+ e_k / (rank - size),  e_k = b_k - Lambda_k beta;  1 in expectation for the true effect

    Parameters
    ----------
    information : (blocks, size, size)
    score : (blocks, size)
    beta : (size,)
    """
    floor = 1e-4 * np.trace(information.sum(axis=0)) / max(len(information), 1)
    gain, seen, _ = gain_of(information, score - information @ beta, lambda _: floor)
    total, dof = float(np.sum(gain)), int(np.sum(seen)) - len(beta)
    return (total / dof, dof) if dof > 0 else (1.0, 0)


def squared_correlation(evidence: Evidence, first: str, second: str, given: Sequence[str] = ()) -> float:
    """Largest squared canonical correlation between the signatures of two candidates; 1: they cannot be told apart."""
    together = [name for name in given if name not in (first, second)]
    i, j = evidence.columns(first), evidence.columns(second)
    L = evidence.total_information
    if together:
        g = evidence.columns(*together)
        L = L - L[:, g] @ np.linalg.pinv(L[np.ix_(g, g)], rcond=1e-12, hermitian=True) @ L[g, :]
    wi = _whitener(L[np.ix_(i, i)], evidence.plausible[i])
    wj = _whitener(L[np.ix_(j, j)], evidence.plausible[j])
    if wi.shape[1] == 0 or wj.shape[1] == 0:
        return 0.0
    return float(np.clip(np.linalg.norm(wi.T @ L[np.ix_(i, j)] @ wj, 2) ** 2, 0.0, 1.0))


def predicted_lambda(evidence: Evidence, name: str, beta: FloatArray, others: Sequence[str] = ()) -> float:
    """beta' Lambda beta of one effect with `others` projected out: what could be found beforehand."""
    information, _ = project_out(evidence, name, others)
    return float(beta @ information.sum(axis=0) @ beta)


#: Degrees of freedom of Student's t about the plausible size: effects of five plausible sizes happen, 2 t.sf(5, 3) =
#: 1.5 %, of fifty do not, 2 t.sf(50, 3) = 2e-5. A choice: of half and twice 6 % and 0.2 % are above five, which changes
#: nothing of effects that are hardly noticed (`bounds_of_work weak`).
_PRIOR_DOF = 3.0


def log_bayes_factor(
    evidence: Evidence, name: str, beta: FloatArray, gain: float, others: Sequence[str] = (), scatter: float = 1.0
) -> float:
    """Logarithm of the odds for an effect against none, where both were as likely beforehand.

    gain / 2 - log det(1 + L) / 2 + k / 2 log(2 pi) + log t(z),   in units of the plausible sizes

    The likelihood, what the data narrow the estimate by (Occam's factor, of Laplace's approximation), and Student's t
    of the size in k dimensions, k = tr((1 + L)^-1 L): directions that the data do not see count for nothing, nor do
    their components of z = (1 + L)^-1 L beta.

    Source: R. E. Kass, A. E. Raftery, J. Amer. Stat. Assoc. 90 (1995) 773.

    Parameters
    ----------
    evidence : about the fit with the effect
    beta : (size,) its estimate
    gain : drop of -2 log L that it brought
    others : names of the effects in the model besides, projected out
    scatter : how many times the variance that the evidence takes noise for is what it has: gain and L are less by it
    """
    plausible = evidence.plausible[evidence.columns(name)]
    information, _ = project_out(evidence, name, others)
    L = information.sum(axis=0) * np.outer(plausible, plausible) / scatter
    A = np.eye(len(L)) + L
    z = np.linalg.solve(A, L @ (beta / plausible))
    occam = 0.5 * float(np.linalg.slogdet(A)[1])
    nu, k = _PRIOR_DOF, float(np.trace(np.linalg.solve(A, L)))
    at_zero = float(special.gammaln(0.5 * (nu + k)) - special.gammaln(0.5 * nu)) - 0.5 * k * float(np.log(0.5 * nu))
    return 0.5 * gain / scatter - occam + at_zero - 0.5 * (nu + k) * float(np.log1p(z @ z / nu))


def without_prior(evidence: Evidence, beta: FloatArray) -> FloatArray:
    """(p,) the estimates that the readings alone have, of all parameters jointly, where a fit has held each to zero.

    Lambda (x - beta) = P^-1 beta,   in the directions that are seen: what holds a fit where it is, and no score besides

    Parameters
    ----------
    evidence : about the fit, of its own terms
    beta : (p,) their estimates
    """
    W = _whitener(evidence.total_information, evidence.plausible)
    return np.asarray(beta + W @ (W.T @ (beta / (evidence.prior_sigma * evidence.plausible) ** 2)))


def _seen_directions(information: FloatArray, plausible: FloatArray) -> FloatArray:
    """(size, seen) orthogonal (in plausible units) directions of beta on which there is information."""
    scaled = information * np.outer(plausible, plausible)
    values, vectors = np.linalg.eigh(scaled)
    return np.asarray(plausible[:, None] * vectors[:, values > WIDEST_DIRECTION**-2])


def _whitener(information: FloatArray, plausible: FloatArray) -> FloatArray:
    """(size, seen) W with W' Lambda W = 1 on the directions that are seen."""
    basis = _seen_directions(information, plausible)
    if basis.shape[1] == 0:
        return basis
    values, vectors = np.linalg.eigh(basis.T @ information @ basis)
    return np.asarray(basis @ vectors / np.sqrt(values))
