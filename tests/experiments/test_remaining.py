"""Probes, which are no effects, and what is left in a residual: bursts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from sinan.estimator.evidence.probes import followed, is_probe, play, probes_for, what_it_follows
from sinan.estimator.evidence.source import Fit, StreamResidual
from sinan.estimator.evidence.term import Term
from sinan.estimator.evidence.whiteness import whiteness
from sinan.experiments.residual_loop.remaining import _MIXED, _bursts, _variance, patches, remaining
from sinan.sensors.arrays import FloatArray
from sinan.sensors.effects import CATALOGUE, Effect
from sinan.sensors.effects.streams import STREAMS
from sinan.sensors.motion import Motion
from tests.estimator.analytic_flight import analytic_motion

ALPHA = 0.01  # level of each test
RUNS = 200
TEN_MINUTES_AT_5_HZ = np.arange(3000) / 5.0
MICROMETRE = 1e-6
KNOWN = ("mag", "baro", "sonar", "laser", "gps")


# ---- probes


def covariates(t: FloatArray) -> dict[str, dict[str, FloatArray]]:
    """What a recording may know beside its readings."""
    warming, still = 20.0 + 15.0 * (1.0 - np.exp(-t / 10.0)), np.full(len(t), 21.0)
    falling = 16.0 - 0.05 * t + 0.3 * np.sin(t)
    return {
        "accel": {"temperature": warming},
        "gyro": {"voltage": falling},
        "baro": {"temperature": still},
        "mag": {"current": 5.0 + np.sin(t)},
    }


def flight() -> Motion:
    return analytic_motion(np.arange(600) / 20.0)


def probes() -> tuple[Effect, ...]:
    motion = flight()
    return probes_for(("accel", "gyro", *KNOWN), motion, covariates(motion.t), KNOWN)


@pytest.mark.parametrize("probe", probes(), ids=lambda probe: probe.name)
def test_regressor_of_a_probe(probe: Effect) -> None:
    motion = flight()
    along = motion.with_covariates(**covariates(motion.t).get(probe.stream, {}))
    G = probe.regressor(along)
    rows = len(STREAMS[probe.stream].components)
    assert G.shape[::2] == (len(motion), probe.size)
    assert G.shape[1] in (rows, 6 if probe.stream == "gps" else rows)  # position, or velocity too
    assert np.all(np.isfinite(G))
    assert np.all(np.any(G != 0.0, axis=(0, 1)))


def test_every_stream_has_a_probe() -> None:
    assert {probe.stream for probe in probes()} == {"accel", "gyro", *KNOWN}


def test_drifting_clock_is_a_lateness_that_grows() -> None:
    """Of the GPS too, whose lateness is an effect of its own; the first part is odd about the middle of the time."""
    found = {p.name: p for p in probes()}
    motion = flight()
    share = (motion.t - motion.t[0]) / (motion.t[-1] - motion.t[0]) - 0.5
    late = {"gps": "gps.latency", "baro": "baro.time_offset"}
    for stream, name in late.items():
        G = found[f"unexplained.{stream}.a drifting clock"].regressor(motion)
        np.testing.assert_allclose(G[:, :, 0], CATALOGUE[name].regressor(motion)[:, :, 0] * share[:, None])


def test_stream_without_readings_has_no_probe() -> None:
    motion = flight()
    assert probes_for(KNOWN, motion, {}, ()) == ()


def test_covariate_that_does_not_change_has_no_probe() -> None:
    assert "temperature" not in [what_it_follows(probe.name) for probe in probes() if probe.stream == "baro"]


@pytest.mark.parametrize(("stream", "name", "linear"), [("gyro", "voltage", True), ("accel", "temperature", False)])
def test_a_covariate_is_linear_in_a_probe_where_no_effect_is(stream: str, name: str, linear: bool) -> None:
    motion = flight()
    values = covariates(motion.t)[stream][name]
    probe = next(p for p in probes() if p.name == f"unexplained.{stream}.{name}")
    G = probe.regressor(motion.with_covariates(**{name: values}))[:, 0]
    left = values - G @ np.linalg.lstsq(G, values, rcond=None)[0]
    middle = 0.5 * (np.max(values) + np.min(values))
    left_of_offset = values - middle - G @ np.linalg.lstsq(G, values - middle, rcond=None)[0]
    assert (np.std(left_of_offset) < 1e-9) == linear
    assert np.std(left) > 1e-3  # the offset is no part of it: that is the bias


def test_a_covariate_that_might_be_a_drift_is_called_so() -> None:
    motion = flight()
    falling = {"voltage": 16.0 - 0.05 * motion.t, "current": 5.0 + np.sin(motion.t)}
    names = {what_it_follows(p.name) for p in probes_for(("gyro",), motion, {"gyro": falling}, ())}
    assert {"voltage or the time", "current"} <= names


def test_no_effect_of_the_catalogue_is_a_probe() -> None:
    assert not any(is_probe(name) for name in CATALOGUE)


def test_every_probe_is_one() -> None:
    assert all(is_probe(probe.name) for probe in probes())


def test_followed_names_stream_and_thing() -> None:
    names = ["baro.scale", "unexplained.baro.place", "unexplained.mag.current"]
    assert followed(names) == (("baro", "place"), ("mag", "current"))


# ---- play


def test_play_holds_while_it_moves_less_than_the_half_width() -> None:
    x = 10.0 + 0.9 * np.sin(np.linspace(0.0, 20.0, 500))
    assert np.ptp(play(x, 1.0)) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_play_lags_by_the_half_width(sign: float) -> None:
    x = sign * np.linspace(0.0, 5.0, 200)
    lag = sign * (x - play(x, 0.5))[100:]
    assert lag == pytest.approx(0.5, abs=MICROMETRE)


def test_play_is_never_farther_than_the_half_width() -> None:
    x = np.cumsum(np.random.default_rng(1).standard_normal(5000))
    assert np.max(np.abs(x - play(x, 2.0))) <= 2.0 + MICROMETRE


def test_no_play_follows_exactly() -> None:
    x = np.random.default_rng(2).standard_normal(100)
    assert np.array_equal(play(x, 0.0), x)


# ---- what is no reading


def test_what_is_no_reading_is_no_noise_that_is_too_small() -> None:
    """A receiver's heights that are none: their zeros are white, and no share of the readings."""
    tells = np.ones((3000, 3), dtype=np.bool_)
    tells[:, 2] = False
    for size, kinds in ((1.0, []), (1.3, ["variance"])):
        one = replace(residual(np.where(tells, size * white(5, 3), 0.0)), tells=tells)
        assert [r.kind for r in _variance(one, ALPHA)] == kinds
    alarms = 0
    for seed in range(RUNS):
        one = replace(residual(np.where(tells[:60], white(seed, 3, 60), 0.0)), tells=tells[:60])
        colour = whiteness(one.centred, float(np.mean(one.dof)))
        alarms += colour is not None and colour[1] < 0.05
    assert alarms <= most_alarms(0.05)
    assert alarms >= RUNS - int(stats.binom.isf(1e-3, RUNS, 0.97))


# ---- bursts


def residual(z: FloatArray, stream: str = "baro") -> StreamResidual:
    z = z.reshape(len(z), -1)
    t = np.arange(len(z)) / 5.0
    all_of_it, none = np.ones(z.shape, dtype=np.bool_), np.zeros(len(z), dtype=np.bool_)
    return StreamResidual(stream, t, z, z, all_of_it, none, "m", {}, np.arange(len(z)))


def white(seed: int, size: int = 1, n: int = 3000) -> FloatArray:
    return np.asarray(np.random.default_rng(seed).standard_normal((n, size)))


def coloured(seed: int, phi: float) -> FloatArray:
    """AR(1) of unit variance: z_k = phi z_k-1 + sqrt(1 - phi^2) n_k."""
    from scipy.signal import lfilter

    n = white(seed, n=4000)[:, 0]
    return np.asarray(lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], n))[1000:]


def most_alarms(rate: float) -> int:
    """Alarms among `RUNS` that a rate exceeds once in a thousand times."""
    return int(stats.binom.isf(1e-3, RUNS, rate))


@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.parametrize("n", [60, 400, 3000])
def test_white_noise_has_no_burst(n: int, size: int) -> None:
    alarms = sum(bool(_bursts(residual(white(seed, size, n)), ALPHA)) for seed in range(RUNS))
    assert alarms <= most_alarms(ALPHA)


@pytest.mark.parametrize("phi", [0.3, 0.7, 0.9, 0.97])
def test_coloured_noise_has_no_burst(phi: float) -> None:
    alarms = sum(bool(_bursts(residual(coloured(seed, phi)), ALPHA)) for seed in range(RUNS))
    assert alarms <= most_alarms(ALPHA)


@pytest.mark.parametrize("seed", range(5))
def test_burst_of_three_sigma_is_found(seed: int) -> None:
    z = white(seed)
    z[1200:1500] *= 3.0
    assert [(r.kind, r.in_mean) for r in _bursts(residual(z), ALPHA)] == [("local", True)]


def test_it_says_when_a_burst_was() -> None:
    """Blocks of 75 readings, five a second; without time stamps by the numbers of the readings."""
    z = white(7)
    z[1200:1275] *= 10.0
    one = residual(z)
    assert _bursts(one, ALPHA)[0].what.endswith("from 240 s to 254.8 s")
    assert _bursts(replace(one, t=np.arange(3000.0)), ALPHA)[0].what.endswith("in readings 1200 to 1274")


def test_size_of_a_burst() -> None:
    """Its excess is the size of the worst block over the usual: of 4 blocks with 75 readings, a little above 3."""
    z = white(7)
    z[1200:1500] *= 3.0
    assert _bursts(residual(z), ALPHA)[0].excess == pytest.approx(3.0, rel=0.3)


@pytest.mark.parametrize("wrong", [10.0, 1000.0])
def test_one_wrong_reading_is_no_burst(wrong: float) -> None:
    z = white(8)
    z[1300] = wrong
    assert _bursts(residual(z), ALPHA) == []


def test_short_stream_is_not_judged() -> None:
    assert _bursts(residual(10.0 * white(9, n=39)), ALPHA) == []


def test_level_is_not_judged() -> None:
    z = white(10)
    z[1200:1500] *= 5.0
    assert _bursts(residual(z, "level"), ALPHA) == []


def test_burst_where_no_noise_is_declared_is_no_structure_of_the_mean() -> None:
    z = white(7)
    z[1200:1500] *= 3.0
    assert [r.in_mean for r in _bursts(residual(z), ALPHA, known=False)] == [False]


# ---- variance


class OnlyResiduals:
    """A source of one stream with declared noise, and nothing else."""

    noise_known, is_predicting = True, False

    def __init__(self, z: FloatArray, stream: str = "baro", *others: StreamResidual) -> None:
        self._all = [residual(z, stream), *others]

    def residuals(self, fit: Fit) -> list[StreamResidual]:
        return self._all

    def faults(self) -> list[tuple[str, str, float, float]]:
        return []


NOTHING = Fit((), {}, {}, 0.0, "all", None)


def variance_left(z: FloatArray) -> list[bool]:
    """Whether what is left of kind `variance` is structure of the mean."""
    source: Any = OnlyResiduals(z)
    left = remaining(source, NOTHING, (), (), ALPHA)
    return [item.in_mean for item in left if item.kind == "variance"]


@pytest.mark.parametrize(
    ("z", "stream", "dropped"),
    [
        (5.0 * coloured(16, 0.9), "baro", ["baro.step", "gyro.transient"]),
        (5.0 * coloured(16, 0.9), "mag", ["baro.step", "gyro.transient"]),
        (5.0 * coloured(16, 0.9), "level", []),
        (coloured(16, 0.9), "baro", []),
        (5.0 * white(16), "baro", []),
    ],
    ids=["its own stream", "another stream", "level", "as large as the noise", "white"],
)
def test_an_interval_is_not_named_beside_a_gross_error(z: FloatArray, stream: str, dropped: list[str]) -> None:
    others = [] if stream == "baro" else [residual(white(17))]
    source: Any = OnlyResiduals(z, stream, *others)
    terms = [Term("baro.step", (10.0, 20.0)), Term("gyro.transient", (10.0, 20.0)), Term("baro.scale")]
    findings: Any = [SimpleNamespace(term=term) for term in terms]
    assert [term.name for term in patches(source, NOTHING, findings, ALPHA)] == dropped


def test_noise_five_times_the_declared_is_no_structure() -> None:
    assert variance_left(5.0 * white(11)) == [False]


@pytest.mark.parametrize("share", [0.05, 0.2, 0.3])
def test_a_second_echo_at_random_is_structure(share: float) -> None:
    """White, but of two kinds; at a share of 0.21 the kurtosis is that of noise."""
    other = np.random.default_rng(12).uniform(size=(3000, 1)) < share
    assert variance_left(white(13) + 20.0 * (other - share)) == [True]


def test_a_second_echo_as_small_as_the_noise_is_noise() -> None:
    other = np.random.default_rng(14).uniform(size=(3000, 1)) < 0.3
    assert variance_left(white(15) + 2.0 * (other - 0.3)) == [False]


def test_heavy_tails_and_coarse_counts_are_nearer_to_noise_than_two_kinds_of_readings() -> None:
    """`_MIXED` is between them; half of it would take the first for the last, twice the last for the first."""
    rng = np.random.default_rng(1)
    white = rng.standard_normal(20_000)
    tails, counts = rng.standard_t(3.0, len(white)), np.round(white / 0.45) * 0.45
    two = white * np.where(rng.random(len(white)) < 0.1, 6.0, 1.0)
    away = [float(stats.kstest(z / np.std(z), "norm").statistic) for z in (tails, counts, two)]
    assert min(away[:2]) > 0.5 * _MIXED
    assert max(away[:2]) < _MIXED < away[2] < 2.0 * _MIXED
