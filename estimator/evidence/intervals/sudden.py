"""At which readings a stream jumps: its innovations against the answer that the filter gives to a jump.

A grid of onsets misses a step that the filter swallows between two of its points. The filter's answer to a step changes
little from one reading to the next, so that of the grid's nearest onset serves for every reading around.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from sinan.estimator.evidence.score import log_p_value
from sinan.sensors.arrays import FloatArray

#: Jumps of a stream that are looked at: bound of work (`bounds_of_work flight`).
_MOST = 6
#: Logarithm of the p-value above which none is: a stated risk of 5 %.
_NOTABLE = -3.0
#: The answer is followed for so many readings at least: bound of work (`bounds_of_work flight`).
_SHORTEST_ANSWER = 3


def jumps(answers: FloatArray, white: FloatArray, t: FloatArray, grid: FloatArray) -> FloatArray:
    """Where a stream jumps most, each jump far from the others.

    Parameters
    ----------
    answers : (n, c, m, size) change of the whitened innovations of reading i by an offset from onset k on
    white : (n, c) whitened innovations
    t : (n,) stamps of the readings [s]
    grid : (m,) onsets [s], evenly spaced

    Returns
    -------
    (k,) stamps of the first readings after the jumps [s], at most `_MOST`
    """
    if len(t) < _SHORTEST_ANSWER:
        return np.zeros(0)
    spacing = float(grid[1] - grid[0])
    gain = np.zeros(len(t))
    dof = answers.shape[3]
    reach = max(round(spacing / max(float(np.median(np.diff(t))), 1e-9)), _SHORTEST_ANSWER)
    for k, onset in enumerate(grid):
        i = int(np.searchsorted(t, onset))
        answer = answers[i : i + reach, :, k]
        here = np.arange(i, int(np.searchsorted(t, onset + spacing)))
        here = here[here + len(answer) <= len(t)]
        if len(answer) < _SHORTEST_ANSWER or not len(here):
            continue
        information = np.einsum("lci,lcj->ij", answer, answer)
        windows = np.lib.stride_tricks.sliding_window_view(white, len(answer), axis=0)[here]  # (here, c, l)
        score = np.einsum("lci,hcl->hi", answer, windows)
        gain[here] = np.einsum("hi,ij,hj->h", score, np.linalg.pinv(information, rcond=1e-6, hermitian=True), score)
    if not np.any(gain):
        return np.zeros(0)
    usual = max(float(np.median(gain[gain > 0.0])) / float(stats.chi2.median(dof)), 1.0)
    found: list[float] = []
    left = gain / usual
    while len(found) < _MOST:
        j = int(np.argmax(left))
        if log_p_value(float(left[j]), dof) + np.log(len(t)) > _NOTABLE:
            break
        found.append(float(t[j]))
        left[max(j - reach // 2, 0) : j + reach // 2 + 1] = 0.0
    return np.array(found)


def doubts(t: FloatArray, doubt: FloatArray) -> FloatArray:
    """From which readings on several in a row are doubted, those first that are doubted most in all.

    A jump that the filter doubts it does not follow at once, and what is doubted hardly pulls: squares do not show
    where it is. A single reading that is doubted is a wrong one, and no jump.

    Parameters
    ----------
    t : (n,) stamps of the readings [s]
    doubt : (n,) -log weight of each; 0: it is believed

    Returns
    -------
    (k,) stamps of the first readings [s], at most `_MOST`
    """
    ends = np.flatnonzero(np.diff(doubt > 0.0, prepend=False, append=False)).reshape(-1, 2)
    ends = ends[ends[:, 1] - ends[:, 0] > 1]
    total = [-float(np.sum(doubt[first:last])) for first, last in ends]
    return t[ends[np.argsort(total, kind="stable")[:_MOST], 0]]
