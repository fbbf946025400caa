"""Prediction over seconds: readings of one stream are withheld, and a model says what they are.

Where the noise of a log is found and not declared, a smaller one-step innovation proves no effect: it may have taken
the shape of colour. What is wrong in the mean is wrong for seconds, and shows when nothing corrects the filter. What
lasts is estimated without the quarter of the log in which it is asked: an effect has to be there in the others too.
Source: A. Gelman, J. Hwang, A. Vehtari, Stat. Comput. 24 (2014) 997 (models compared by what they predict of data left
out); K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13 (the scatter of clusters).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from sinan.estimator.evidence.flights.passes import Fitted, FlightPasses
from sinan.estimator.evidence.flights.withheld import Window
from sinan.estimator.evidence.source import Fit, StreamResidual
from sinan.estimator.evidence.term import Term
from sinan.estimator.evidence.weighing import in_weight
from sinan.estimator.filter.effect_forms import Along, Terms
from sinan.estimator.filter.events import WITHHELD, variances
from sinan.estimator.filter.flight import Flight
from sinan.estimator.filter.journal import StreamJournal
from sinan.estimator.filter.tails import deviance_of, stray_over_centre
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.noise import BiasProcess

#: Readings are withheld for so long, once in so long [s], so that a filter has half of that to find back: a choice.
#: Half and twice change nothing of a hover whose GPS is off for a while (`bounds_of_work flight`).
WINDOW, EVERY = 5.0, 7.5
#: An interval that is shorter lies in two windows at most, since they begin `EVERY` apart: the readings around them do
#: not tell its size [s].
SHORTEST_ASKED = 2.0 * EVERY
#: Level at which a model counts as the better one: a stated risk.
LEVEL = 0.05
#: Logarithm of the odds that count as positive evidence (Kass and Raftery 1995: 2 log of the odds above 2).
POSITIVE = 1.0
#: 1-sigma s of a share with which a true effect has positive evidence nine times in ten, 2 s^2 + 2 z s = 1: of a normal
#: law z = norm.ppf(0.9).
SURELY_TOLD = 0.31
#: Parts of a log, each predicted by what the others say of the effects: three quarters of it, which know an effect to
#: sqrt(4/3) times the sigma of all, 15 % more.
FOLDS = 4
#: A log with fewer windows hardly tells how they scatter: at `LEVEL` a share would have to be t.isf(0.05, 2) = 2.9
#: sigma of two windows, and t.isf(0.05, 3) = 2.4 of three.
LEAST_WINDOWS = 3


@dataclass(frozen=True)
class Share:
    """How much of what an effect predicts of withheld readings is there: 1 of a true effect, 0 of one that is not.

    With e the whitened error without the effect and d what the effect changes of it, the squares grow less with it
    where the share is above one half. How well it is known the model says, as if it were one window, and each window.

    Attributes
    ----------
    products, squares : (n,) sums of d e and of d d in each window, of all streams
    believed : (n,) variance of each product by the model
    """

    products: FloatArray
    squares: FloatArray
    believed: FloatArray

    @property
    def value(self) -> float:
        """sum d e / sum d d."""
        return float(np.sum(self.products) / max(float(np.sum(self.squares)), 1e-300))

    @property
    def effective(self) -> float:
        """As how many windows that tell equally much these count (L. Kish, Survey Sampling, 1965): 0 if none tells."""
        return float(np.sum(self.squares) ** 2 / max(float(np.sum(self.squares**2)), 1e-300))

    @property
    def scatter(self) -> float:
        """Variance of the products over what the model believes, at least 1.

        The belief counts as one window more: a unit of information (R. E. Kass, L. Wasserman, J. Am. Stat. Assoc. 90
        (1995) 928).
        """
        if self.effective == 0.0:
            return 1.0
        left = self.products - self.value * self.squares
        return max(1.0, 1.0 / self.effective + float(np.sum(left**2) / np.sum(self.believed)))

    @property
    def sigma(self) -> float:
        """1-sigma of the value, by the model and the windows."""
        if self.effective == 0.0:
            return float("inf")
        return float(np.sqrt(self.scatter * np.sum(self.believed)) / np.sum(self.squares))

    @property
    def log_ratio(self) -> float:
        """Logarithm of the ratio of likelihoods of a share of 1 and one of 0, as which one beyond these counts.

        The value is distributed as Student's t about either, with as many degrees of freedom as there are windows.
        """
        n = self.effective
        if n == 0.0:
            return 0.0
        value = min(max(self.value, 0.0), 1.0)
        of_none, of_all = (np.log1p((off / self.sigma) ** 2 / n) for off in (value, 1.0 - value))
        return float(0.5 * (n + 1.0) * (of_none - of_all))

    def weighed(self, log_odds: Callable[[float], float]) -> float:
        """Logarithm of the odds for what has this share, by withheld readings and by those of one step ahead together.

        Where the errors of seconds are larger than the model believes, what it makes of those of one step counts less.

        Parameters
        ----------
        log_odds : by the likelihood of the log, where noise has so many times the variance of the model
        """
        return log_odds(self.scatter) + self.log_ratio

    def bears_out(self, log_odds: Callable[[float], float], needed: float, lasts: bool = True) -> bool:
        """Whether withheld readings speak for the effect, and all odds together exceed what is needed where it may have
        been found by chance.

        Parameters
        ----------
        lasts : what takes the shape of an effect that lasts gains as much one step ahead, but is not there over
            seconds; an offset that comes and goes within a step is told by that, and of seconds no more is asked than
            that they rather speak for it
        """
        return self.log_ratio > (POSITIVE if lasts else 0.0) and self.weighed(log_odds) > needed

    @property
    def is_there(self) -> bool:
        """Whether withheld readings are predicted better with the effect, and part of it is there by no chance of the
        windows: a share of 0, not of one half, is what chance has to be ruled out of.
        """
        from scipy import stats

        n = self.effective
        return bool(n > 0.0 and self.value > max(0.5, float(stats.t.isf(LEVEL, n)) * self.sigma))


def can_be_predicted(term: Term) -> bool:
    """Whether the readings around withheld ones tell the size of an effect: not of one that is soon over."""
    return term.interval is None or term.interval[1] - term.interval[0] >= SHORTEST_ASKED


@dataclass(frozen=True)
class _Withheld:
    """Withheld readings of one stream, in the order of time.

    Attributes
    ----------
    residual : what is off of them
    normal : (n,) logarithm of their normal density
    whitening : (n, m, m) L^-1, where the innovation has the covariance S = L L'
    state : (n, m, m) the part of S that is no white noise of the reading itself
    window : (n,) in which each was withheld
    since : (n,) its age in that window [s]
    colours : first-order noise of the readings, which is a part of the state, with the first component of each
    """

    residual: StreamResidual
    normal: FloatArray
    whitening: FloatArray
    state: FloatArray
    window: IntArray
    since: FloatArray
    colours: Sequence[tuple[int, BiasProcess]]


class Prediction:
    """What fits of one flight predict of withheld readings; each is asked once, as long as anybody has it.

    Parameters
    ----------
    passes : over the flight
    streams : whose readings are withheld, one at a time, with the unit of a residual
    """

    def __init__(self, passes: FlightPasses, streams: Sequence[tuple[str, str]]) -> None:
        self._passes, self._streams = passes, tuple(streams)
        # a fit is whole passes, so that here none outlives those that `KnownFits` keeps and its callers hold
        self._known: WeakKeyDictionary[Fitted, Sequence[_Withheld]] = WeakKeyDictionary()
        self._at_once: WeakKeyDictionary[Fitted, Sequence[_Withheld]] = WeakKeyDictionary()
        t = passes.table.t
        self._edges = t[np.round(np.linspace(0, len(t) - 1, FOLDS + 1)).astype(np.int64)]
        begins = np.arange(passes.start + WINDOW, passes.end - WINDOW, EVERY)
        self._windows = [(float(begin), float(begin) + WINDOW) for begin in begins]

    @property
    def is_possible(self) -> bool:
        """Whether the log is long enough, and has a stream besides the IMU."""
        return len(self._windows) >= LEAST_WINDOWS and bool(self._streams)

    def share(self, fit: Fit, without: Fit) -> Share:
        """Of what a fit has and another has not."""
        sums = np.zeros((3, len(self._windows)))
        for held, mine, d in _changes(self._of(without), self._of(fit)):
            one, e = held.residual, held.residual.whitened[mine]
            plain = np.sum(e**2, axis=1)
            nis = np.minimum(plain, np.sum((e - d) ** 2, axis=1))
            normal = held.normal[mine] + 0.5 * (plain - nis)
            weight = 1.0 / self._passes.flight.model.spread(one.stream, nis, one.dof[mine], normal)
            sums += self._summed(held, mine, e, d, weight)
        return Share(*sums)

    def _summed(self, held: _Withheld, rows: IntArray, e: FloatArray, d: FloatArray, weight: FloatArray) -> FloatArray:
        """(3, windows) `_sums` of some of the readings of one stream, by window."""
        found = np.zeros((3, len(self._windows)))
        window, whitening, state, since = (
            known[rows] for known in (held.window, held.whitening, held.state, held.since)
        )
        for k in np.unique(window):
            at = window == k
            found[:, k] = _sums(e[at], d[at], weight[at], whitening[at], state[at], since[at], held.colours)
        return found

    def share_if_there(self, fit: Fit, more: Terms) -> Share:
        """Of effects that a fit has not, if they were there: how well withheld readings would tell of them."""
        state = fit.detail
        assert isinstance(state, Fitted)
        before = self._at_once.get(state)
        if before is None:
            before = self._withheld([(self._passes.along(state.own, state.motion), self._windows)])
            self._at_once[state] = before
        after = self._withheld([(self._passes.along(state.own.joined(more), state.motion), self._windows)])
        sums = np.zeros((3, len(self._windows)))
        for held, mine, d in _changes(before, after):
            sums += self._summed(held, mine, d, d, np.ones(len(d)))
        return Share(*sums)

    def of(self, fit: Fit) -> Sequence[StreamResidual]:
        """Withheld readings of each instrument less what the fit predicts of them, up to `WINDOW` seconds on.

        Each has the weight that one over its variance gives it, so that the RMS is not that of the last second. The
        squares of the whitened are -2 log density by the law that the model gives an innovation.
        """
        found, model = [], self._passes.flight.model
        for held in self._of(fit):
            one = held.residual
            nis = np.sum(one.whitened**2, axis=1)
            stray = stray_over_centre(model.stray_of(one.stream), held.normal, nis)
            own = np.maximum(0.0, deviance_of(nis, one.dof, model.tail_of(one.stream), stray))
            found.append(replace(one, whitened=one.whitened * np.sqrt(own / np.maximum(nis, 1e-300))[:, None]))
        return found

    def _of(self, fit: Fit) -> Sequence[_Withheld]:
        """The same whitened by the covariance of the prediction."""
        state = fit.detail
        assert isinstance(state, Fitted)
        known = self._known.get(state)
        if known is not None:
            return known
        asked = [(state.along, self._windows)]
        if fit.part == "all":  # without effects too: what is known of the biases is then the same
            asked = []
            for first, last in zip(self._edges[:-1], self._edges[1:], strict=True):
                mine = [window for window in self._windows if first <= window[0] + 0.5 * WINDOW < last]
                own = self._given(fit, first, last, mine) if fit.in_mean else state.own
                asked.append((self._passes.along(own, state.motion), mine))
        self._known[state] = found = self._withheld(asked)
        return found

    def _withheld(self, asked: Sequence[tuple[Along, Sequence[Window]]]) -> Sequence[_Withheld]:
        """Of windows, each with the effects and along the motion that it is asked with."""
        found = []
        for name, unit in self._streams:
            parts = [
                (along.flight, self._passes.run_withheld(name, windows, along).stream(name))
                for along, windows in asked
                if windows
            ]
            found += self._residual(name, unit, parts)
        return found

    def _given(self, fit: Fit, first: float, last: float, windows: Sequence[Window]) -> Terms:
        """The fit's effects without what is predicted, to first order, each held to zero as in the fit.

        Of what lasts without all readings from `first` to `last` and what of the windows reaches beyond; of an interval
        without those in the windows.
        """
        state = fit.detail
        assert isinstance(state, Fitted)
        W, white, event = self._passes.rows(state.sensitivity, state.journal, "all")
        t, beta = state.journal.stamps[event], state.own.vector  # as they are withheld, whatever is late
        parts = zip(state.own.effects, fit.in_mean, strict=True)
        lasts = np.concatenate([np.full(entry.size, term.interval is None) for entry, term in parts])
        prior = self._passes.prior(state.own.effects)

        def step(rows: BoolArray, columns: BoolArray, white: FloatArray) -> FloatArray:
            V, p = W[np.ix_(rows, columns)], prior[columns]
            return np.asarray(np.linalg.solve(V.T @ V + np.diag(p), V.T @ white[rows] - p * beta[columns]))

        given = np.ones(len(t), dtype=bool)
        for begin, end in windows:
            given &= (t < begin) | (t >= end)
        if np.any(lasts):
            change = step(given & ((t < first) | (t >= last)), np.ones(len(beta), dtype=bool), white)[lasts]
            white = white - W[:, lasts] @ change
            beta[lasts] += change
        if not np.all(lasts):
            beta[~lasts] += step(given, ~lasts, white)
        return state.own.at(beta)

    def _residual(self, name: str, unit: str, parts: Sequence[tuple[Flight, StreamJournal]]) -> list[_Withheld]:
        seen = [(one, (one.status == WITHHELD) & np.isfinite(one.nis)) for _, one in parts]
        t, row, nu, white, tells, S, normal = (
            np.concatenate([getattr(one, key)[keep] for one, keep in seen])
            for key in ("t", "index", "told", "white", "tells", "S", "loglik")
        )
        if not len(t):
            return []
        variance = np.mean(np.diagonal(S, axis1=1, axis2=2)[:, :3], axis=1, where=tells[:, :3])
        begins = np.array([begin for begin, _ in self._windows])
        rows = [(flight, one.index[keep]) for (flight, _), (one, keep) in zip(parts, seen, strict=True)]
        own = np.concatenate([variances(flight, name)[mine] for flight, mine in rows])
        # by their stamps they were withheld, whatever is late
        stamp = np.concatenate([flight.recording.streams[name].t[mine] for flight, mine in rows])
        window = np.searchsorted(begins, stamp, side="right") - 1
        state = S - own[:, :, None] * np.eye(S.shape[1])
        nu, white = in_weight(nu, variance[:, None]), np.where(tells, white, 0.0)
        order = np.argsort(t, kind="stable")
        held = t[order] > self._passes.split
        residual = StreamResidual(name, t[order], nu[order], white[order], tells[order], held, unit, {}, row[order])
        whitening = np.linalg.inv(np.linalg.cholesky(S))
        since, colours = stamp - begins[window], self._passes.flight.model.colour_of(name)
        found = _Withheld(residual, normal[order], whitening[order], state[order], window[order], since[order], colours)
        return [found]


def _changes(
    before: Sequence[_Withheld], after: Sequence[_Withheld]
) -> Iterator[tuple[_Withheld, IntArray, FloatArray]]:
    """Of each stream that two models predict: what the first has of it, which of its rows the second has too, and what
    the second takes off the whitened errors of those.
    """
    others = {one.residual.stream: one.residual for one in after}
    for held in before:
        one, other = held.residual, others.get(held.residual.stream)
        if other is not None:
            _, mine, same = np.intersect1d(one.row, other.row, return_indices=True)  # a lateness moves all stamps
            yield held, mine, one.whitened[mine] - other.whitened[same]


def _sums(
    e: FloatArray,
    d: FloatArray,
    weight: FloatArray,
    whitening: FloatArray,
    state: FloatArray,
    since: FloatArray,
    colours: Sequence[tuple[int, BiasProcess]],
) -> tuple[float, float, float]:
    """Of the errors e and changes d (k, m) of one stream in one window: product, square, and what variance the product
    is believed to have.

    White noise is each reading's own, and where one is doubted it is that which is larger. Colour is what has come of
    it since the window began.
    """
    g = weight[:, None] * np.einsum("kij,ki->kj", whitening, d)
    square = float(weight @ np.sum(d**2, axis=1))
    believed = square - float(np.einsum("ki,kij,kj", g, state, g))
    rest = state.copy()
    for first, colour in colours:
        columns = np.arange(first, first + colour.size)
        rest[:, columns, columns] -= (colour.std**2 * -np.expm1(-2.0 * colour.rate * since))[:, None]
        believed += _variance_by_colour(g[:, columns], since, colour)
    return float(weight @ np.sum(d * e, axis=1)), square, believed + _variance_of_sum(g, rest)


def _variance_by_colour(g: FloatArray, since: FloatArray, colour: BiasProcess) -> float:
    """Variance of the sum of g_k' c_k over k (k, m), c first-order noise that was known to be zero `since` seconds ago.

    What comes of it in the step to the reading k is in all that follow, less by exp(-t / tau).
    """
    rate = min(colour.rate, 0.5 * np.log(np.finfo(np.float64).max) / WINDOW)  # what is forgotten sooner is white
    of_later = np.exp(rate * since)[:, None] * np.cumsum((g * np.exp(-rate * since)[:, None])[::-1], axis=0)[::-1]
    grown = -np.expm1(-2.0 * rate * np.diff(since, prepend=0.0))
    return float(colour.std**2 * grown @ np.sum(of_later**2, axis=1))


def _variance_of_sum(g: FloatArray, P: FloatArray) -> float:
    """Variance of the sum of g_k' x_k over k, x_k (m,) of variance P_k.

    Of two instants the smaller variance is what both have in common: of a walk that of the earlier one, of a constant
    that is estimated the better that of the later one (B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979: the
    error of an estimate has nothing in common with its changes). Each of the axes in which the mean of P is diagonal is
    one by itself.

    Neglects that a body turns with its axes, in which errors are taken for the same, and that a position whose velocity
    walks has more in common than that.
    """
    axes = np.linalg.eigh(np.mean(P, axis=0))[1]
    p = np.maximum(np.einsum("ji,kjl,li->ki", axes, P, axes), 0.0)
    order = np.argsort(p, axis=0)
    p, g = np.take_along_axis(p, order, axis=0), np.take_along_axis(g @ axes, order, axis=0)
    of_no_less = np.cumsum(g[::-1], axis=0)[::-1]
    return float(np.sum(np.diff(p, axis=0, prepend=0.0) * of_no_less**2))
