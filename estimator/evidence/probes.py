"""Suspects that are no effects: what a stream's error would follow if nothing in the catalogue explained it.

Each is a block of generic functions of one thing (place, a covariate, the speed through the air, the rate), in the form
of an effect, so that the filter's sensitivity pass scores it as it scores effects. A probe that passes has no name in
the report: the verdict is `unexplained`, and what remains is said to follow that thing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from sinan.estimator.evidence.term import varies
from sinan.estimator.filter.flight_model import DRIVERS
from sinan.sensors.arrays import FloatArray, zero_unless_finite
from sinan.sensors.effects import CATALOGUE
from sinan.sensors.effects.declaration import Effect, Parameter
from sinan.sensors.effects.streams import STREAMS
from sinan.sensors.motion import Motion
from sinan.sensors.rotation import matrix_from_quaternion, rotate_back

#: Names of probes begin so: no effect of the catalogue does.
PREFIX = "unexplained"
#: Bumps over the horizontal track: bound of work (`bounds_of_work flight`).
_PLACES = 10
#: Rows on which it is found out how an effect follows a covariate: bound of work (`bounds_of_work flight`).
_FEW = 20
#: Correlation with the time from which on sqrt(1 - 0.99^2), a seventh of a covariate, tells it from a drift.
_AS_TIME = 0.99
#: Half widths of the play of a sticking instrument, as shares of the range of what it measures, which a probe tries:
#: bound of work (`bounds_of_work flight`).
_PLAYS = (0.05, 0.15, 0.4)


def probes_for(streams: Iterable[str], motion: Motion, covariates: Mapping[str, Mapping[str, FloatArray]],
               known: Iterable[str]) -> tuple[Effect, ...]:  # fmt: skip
    """The probes of a flight's streams.

    Parameters
    ----------
    streams : names of the streams that effects may enter
    motion : estimated, at the samples of the IMU table
    covariates : by stream, what the recording knows at those samples
    known : streams with readings of their own (all but accel and gyro)
    """
    found: list[Effect] = []
    for stream in streams:
        if stream not in STREAMS or stream == "base":
            continue
        along = motion.with_covariates(**covariates.get(stream, {}))
        for name, first in powers_from(stream, along).items():
            found.append(_of_covariate(stream, name, along, first))
        if stream in DRIVERS:
            found.append(_of_itself(stream))
            continue
        if stream not in known:
            continue
        if motion.has("p_n") and float(np.ptp(motion.p_n[:, :2])) > 0.0 and float(np.ptp(motion.v_n[:, :2])) > 0.0:
            found.append(_of_place(stream, motion.p_n[:, :2]))
        late = [name for name in (f"{stream}.time_offset", f"{stream}.latency") if name in CATALOGUE]
        found += [_of_clock(stream, CATALOGUE[name], motion.t) for name in late]
        if stream == "baro":
            found += [_of_speed(stream, along), _of_play(stream, float(np.ptp(motion.p_n[:, 2])))]
        if stream == "mag":
            found.append(_of_field(stream))
    return tuple(found)


def what_it_follows(name: str) -> str:
    """The last part of a probe's name."""
    return name.split(".")[-1]


def probe(stream: str, follows: str, columns: int, shape: Callable[[Motion], FloatArray], memory: bool = False,
           needs: tuple[str, ...] = (), plausible: float | None = None) -> Effect:  # fmt: skip
    """An effect made of `shape`: motion -> (n, size, columns)."""
    size = STREAMS[stream].plausible if plausible is None else plausible
    return Effect(
        name=f"{PREFIX}.{stream}.{follows}",
        stream=stream,
        summary=f"The error of the {STREAMS[stream].title} follows {follows}.",
        enters="",
        physics="No effect of the catalogue: generic functions of one thing.",
        source="",
        parameters=tuple(Parameter(f"b{k}", "1", size) for k in range(columns)),
        needs=needs,
        regressor=shape,
        other_instants=memory,
        in_field_units=stream == "mag",
    )


def offsets(functions: FloatArray, size: int) -> FloatArray:
    """(n, size, size k) a free offset of each component times each of k functions (n, k)."""
    n, k = functions.shape
    return np.asarray(np.einsum("nk,ij->nikj", functions, np.eye(size)).reshape(n, size, k * size))


def _of_place(stream: str, track: FloatArray) -> Effect:
    """Bumps centred on places of the track far from each other, as wide as the gaps between them."""
    centres, width = _centres(track)
    size = len(STREAMS[stream].components)

    def shape(motion: Motion) -> FloatArray:
        away = motion.p_n[:, None, :2] - centres
        bumps = np.exp(-0.5 * np.sum(away**2, axis=2) / width**2)
        if stream != "mag":
            return offsets(bumps, size)
        C_bn = np.swapaxes(matrix_from_quaternion(motion.q_nb), 1, 2)  # a field at the place, seen in the body
        return np.asarray((C_bn[:, :, None, :] * bumps[:, None, :, None]).reshape(len(bumps), size, -1))

    return probe(stream, "place", size * len(centres), shape, needs=("p_n", "q_nb"))


def _centres(track: FloatArray) -> tuple[FloatArray, float]:
    """(k, 2) places of the track, each as far as can be from those before it, and the distance of the last."""
    chosen = [track[0]]
    nearest = np.linalg.norm(track - track[0], axis=1)
    for _ in range(_PLACES - 1):
        far = int(np.argmax(nearest))
        if nearest[far] <= 0.0:
            break
        chosen.append(track[far])
        gap = float(nearest[far])
        nearest = np.minimum(nearest, np.linalg.norm(track - track[far], axis=1))
    return np.array(chosen), gap if len(chosen) > 1 else 1.0


def powers_from(stream: str, along: Motion) -> dict[str, int]:
    """Covariates that vary, and from which power on no effect of the catalogue follows them."""
    few = along.rows(np.unique(np.linspace(0, len(along) - 1, _FEW).astype(int)))
    found = {}
    for name, values in along.covariates.items():
        if values.ndim == 1 and varies(values):
            found[name] = 2 if _is_linear_in(stream, name, few) else 1
    return found


def goes_with_time(values: FloatArray, t: FloatArray) -> bool:
    """Whether what follows a covariate might as well be a drift."""
    return bool(abs(np.corrcoef(values, t)[0, 1]) > _AS_TIME)


def _is_linear_in(stream: str, name: str, along: Motion) -> bool:
    """Whether an effect of the catalogue is an offset of the stream that goes with a covariate."""
    more = along.with_covariates(**{name: along.covariates[name] + 1.0})
    for entry in CATALOGUE.values():
        if entry.stream != stream or entry.localised is not None or entry.missing(along):
            continue
        rise = zero_unless_finite(entry.regressor(more)) - zero_unless_finite(entry.regressor(along))
        if np.any(rise) and np.allclose(rise, rise[0]):
            return True
    return False


def _of_covariate(stream: str, name: str, along: Motion, first: int) -> Effect:
    """Powers from the first that is wanted up to the third."""
    values = along.covariates[name]
    follows = f"{name} or the time" if goes_with_time(values, along.t) else name
    middle, half = 0.5 * (np.max(values) + np.min(values)), 0.5 * np.ptp(values)
    size, powers = len(STREAMS[stream].components), range(first, 4)

    def shape(motion: Motion) -> FloatArray:
        x = (motion.covariates[name] - middle) / half
        return offsets(np.stack([x**power for power in powers], axis=1), size)

    return probe(stream, follows, len(powers) * size, shape, needs=(name,))


def _of_itself(stream: str) -> Effect:
    """An axis that is not straight: c |u| u + d u^3 of its own reading u, in shares of its largest."""

    def shape(motion: Motion) -> FloatArray:
        u = motion.f_b if stream == "accel" else motion.w_ib_b
        x = u / max(float(np.max(np.abs(u))), 1e-12)
        axes = np.eye(3)
        return np.concatenate([(x * np.abs(x))[:, :, None] * axes, (x**3)[:, :, None] * axes], axis=2)

    return probe(stream, "its own size", 6, shape, needs=("f_b" if stream == "accel" else "w_ib_b",))


def _of_field(stream: str) -> Effect:
    """A magnetometer's axes that are not straight, and what turns twice with the heading."""

    def shape(motion: Motion) -> FloatArray:
        m_n = np.broadcast_to(motion.m_n, (len(motion), 3))
        x = rotate_back(motion.q_nb, m_n)
        x = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
        axes = np.eye(3)
        return np.concatenate([(x**2)[:, :, None] * axes, (x**3)[:, :, None] * axes], axis=2)

    return probe(stream, "direction", 6, shape, needs=("q_nb", "m_n"))


def _of_clock(stream: str, late: Effect, t: FloatArray) -> Effect:
    """Stamps that are late by more and more; `late` is the effect of a constant lateness."""
    begin, length = float(t[0]), float(t[-1] - t[0])

    def shape(motion: Motion) -> FloatArray:
        share = (motion.t - begin) / length - 0.5  # about its mean: a constant lateness is an effect of the catalogue
        return late.regressor(motion) * np.stack([share, share**2 - 1.0 / 12.0], axis=1)[:, None, :]

    return probe(stream, "a drifting clock", 2, shape, needs=late.needs, plausible=0.3)


def _of_speed(stream: str, along: Motion) -> Effect:
    """Pressure of the air's flow: u |u| of each component of the velocity in the body, in shares of the largest."""

    def flow(motion: Motion) -> FloatArray:
        v = motion.v_n
        if "wind" in motion.covariates:
            v = v - np.pad(motion.covariates["wind"], ((0, 0), (0, 1)))
        return rotate_back(motion.q_nb, v)

    largest = max(float(np.max(np.abs(flow(along)))), 1e-12)

    def shape(motion: Motion) -> FloatArray:
        u = flow(motion)
        return (u * np.abs(u) / largest**2)[:, None, :]

    return probe(stream, "the air's flow", 3, shape, needs=("v_n", "q_nb"))


def _of_play(stream: str, spread: float) -> Effect:
    """Hysteresis: the reading follows the height only when it has moved by a half width, for three half widths."""

    def shape(motion: Motion) -> FloatArray:
        height = -motion.p_n[:, 2]
        columns = [play(height, share * max(spread, 1e-9)) - height for share in _PLAYS]
        return np.stack(columns, axis=1)[:, None, :]

    return probe(stream, "hysteresis", len(_PLAYS), shape, memory=True, needs=("p_n",))


def play(x: FloatArray, half: float) -> FloatArray:
    """(n,) what follows x with a play of that half width."""
    from sinan.estimator.evidence.play_numba import follow

    return np.asarray(follow(np.ascontiguousarray(x), half))


def is_probe(name: str) -> bool:
    """Whether a name is that of a probe."""
    return name.startswith(PREFIX + ".")


def followed(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """(stream, what its error follows) of the probes among names."""
    return tuple((n.split(".")[1], what_it_follows(n)) for n in names if is_probe(n))
