"""What a log says of its own magnetometer: hard iron, norm and dip, where it was disturbed, which errors last.

Found without an attitude: |m - b| is the field's norm, and (m - b) . down its vertical part, whatever the heading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from sinan.calibration.levels.noise_start import reading_noise
from sinan.sensors.arrays import BoolArray, FloatArray, runs_of
from sinan.sensors.errors import InputError
from sinan.sensors.geomagnetism import declination, earth_field, field_along, inclination
from sinan.sensors.recording import ACCEL, GYRO, MAG, Recording, Stream

#: A recording has no date: dip and declination of most places move by 0.1 deg a year.
EPOCH = date(2020, 1, 1)
#: 1-sigma of declination and dip of a place so found [rad]: five years of that, and what the crust and the model leave
#: (0.38 and 0.2 deg; error model of the World Magnetic Model, technical report of its 2020 release, section 3).
DIRECTION_STD = (np.deg2rad(0.63), np.deg2rad(0.54))
#: Specific force within this of gravity counts as showing where down is [m/s^2]; a tenth of gravity, 6 deg.
STEADY = 1.0
#: Passes of the robust fit, and the residual, in robust sigmas, from which a row loses weight (Cauchy).
PASSES, BEND = 20, 2.0
#: What is left of an error that is averaged over so long is what lasts [s]; shorter logs are cut into so many blocks.
#: It comes back with the pose (soft iron, axes, the room), so that the whole log's mean is no better than one block's.
BLOCK, LEAST_BLOCKS = 30.0, 4
#: A stretch is disturbed where the norm, averaged over `SMOOTH` seconds, is this many robust sigmas off; what is within
#: `AROUND` seconds of it counts as disturbed as well.
DISTURBED, SMOOTH, AROUND = 4.0, 0.5, 1.0
#: Hard iron, norm and dip are five unknowns, and each reading gives two lines: 15 of the 20 lines are left to judge by.
LEAST_READINGS = 10
#: A direction in which vectors spread by less than this many of their white noises shows no turns: of noise alone the
#: likeliest sphere is one of the noise's own size, about the mean reading. A spread of `CLEAR` of their length is turns
#: whatever the noise: of few readings and quick turns the differences are no noise.
TURNED, CLEAR = 5.0, 0.25
#: 1-sigma of a hard iron before the log is read, over the readings' norm: what the log does not show is taken as none.
HARD_IRON = 0.5
#: No line is believed to better than this share of the field: numbers that nobody measured have no noise at all.
LEAST_ERROR = 1e-6
#: The least norm that a pass may come to, over that of the readings: bound of work (`bounds_of_work compass`).
LEAST_NORM = 1e-3
#: The passes end when no unknown moves by more, over the field: bound of work (`bounds_of_work compass`).
SETTLED = 1e-6
#: A norm within this share of the field is not called disturbed: scale and axes of a good compass do that.
HARMLESS = 0.01
#: A stretch has another hard iron where that leaves the norm undisturbed in this share of it, and where the stretch
#: tells it, and a field as large as the rest has it, to this share of the field.
EXPLAINED, TOLD = 0.9, 0.1


@dataclass(frozen=True)
class Compass:
    """A magnetometer as its log shows it.

    Attributes
    ----------
    offset, std : (3,) hard iron and its 1-sigma [unit of the readings]
    norm, dip : of the field [unit], [rad, positive down]
    disturbed : (n,) readings whose norm is not the field's
    shifted : (n,) readings of stretches in which it would be, had the instrument another hard iron there
    scatter : standard deviation of the norm of one undisturbed reading [unit]
    noise_std : white noise of one reading that leaves averages as uncertain as they are [unit]
    declination : of the field [rad, positive to the east]; 0 where north means magnetic north
    """

    offset: FloatArray
    std: FloatArray
    norm: float
    dip: float
    disturbed: BoolArray
    shifted: BoolArray
    scatter: float
    noise_std: float
    declination: float = 0.0

    @property
    def m_n(self) -> FloatArray:
        """(3,) field in NED."""
        return field_along(self.norm, self.dip, self.declination)


def direction_at(origin: tuple[float, float, float]) -> tuple[float, float]:
    """Dip and declination of the Earth's field at a place [rad]; latitude and longitude in deg, height in m."""
    field_n = earth_field(*origin, EPOCH)
    return inclination(field_n), declination(field_n)


def compass_of(recording: Recording) -> Compass:
    """Fit hard iron, norm and dip; find disturbed stretches; fit again without them; ask which of them have a hard iron
    of their own, as a magnet on the instrument has it: an effect for the loop to find, while iron in the room is none.

    Where the recording says where on Earth it was made, dip and declination are those of the place: a body that stays
    near level shows the horizontal field, and of vertical field and vertical hard iron only the sum.

    |m|^2 = 2 b . m + (|B|^2 - |b|^2)    and    m . down = b . down + |B| sin(dip)

    are linear in b and the two constants; a known dip ties the constants to each other and to b (Newton's steps).
    down = -f / |f| where |f| is near gravity. Cauchy weights, because either line has outliers (accelerations,
    steel). Directions of b that the log's turns do not show stay near 0, with a large `std`.

    Raises
    ------
    InputError : no `mag` or `imu`, hardly a reading of it, or no field in them
    """
    for name in ("mag", "imu"):
        if name not in recording.streams:
            raise InputError(recording.where, f"no stream {name}", "a magnetometer and an IMU")
    mag, imu = recording.streams["mag"], recording.streams["imu"]
    if len(mag) < LEAST_READINGS:
        expected = f"{LEAST_READINGS} readings to find the field from, or [environment] magnetic_field"
        raise InputError(recording.where, f"{len(mag)} magnetometer readings", expected, "stream mag")
    f = np.stack([np.interp(mag.t, imu.t, imu[name]) for name in ACCEL], axis=-1)
    m, rate = mag.array(MAG), 1.0 / float(np.median(np.diff(mag.t)))
    if np.median(np.linalg.norm(m, axis=1)) == 0.0:
        raise InputError(recording.where, "no field in the readings", "readings of a magnetometer", "stream mag")
    if np.median(np.linalg.norm(f, axis=1)) == 0.0:
        raise InputError(recording.where, "no force in the readings", "readings of an accelerometer", "stream imu")
    turn = np.linalg.norm(imu.array(GYRO), axis=1)
    moved = np.gradient(np.interp(mag.t, imu.t, np.concatenate([[0.0], np.cumsum(turn[1:] * np.diff(imu.t))])))
    dip, east = (None, 0.0) if recording.origin is None else direction_at(recording.origin)
    disturbed = np.zeros(len(m), dtype=bool)
    for _ in range(2):
        fit = _fit(mag.t, m, f, moved, ~disturbed, dip)
        error = np.linalg.norm(m - fit.offset, axis=1) - fit.norm
        average = _averaged(error, rate)
        usual = max(1.4826 * float(np.median(np.abs(average - np.median(average)))), HARMLESS * fit.norm)
        disturbed = _disturbed(average, usual, rate)
    clean, shifted = error[~disturbed], _shifted(mag.t, m, f, moved, disturbed, fit, rate, usual)
    scatter, noise = float(np.sqrt(np.mean(clean**2))), _error(mag.t[~disturbed], clean)
    return Compass(fit.offset, fit.std, fit.norm, fit.dip, disturbed & ~shifted, shifted, scatter, noise, east)


def corrected(recording: Recording, compass: Compass, keep_shifted: bool = False) -> Recording:
    """The recording with the hard iron taken off, without the disturbed readings, with the field that was found.

    A field that the recording declares stays. What was done is in the recording's notes.

    Parameters
    ----------
    keep_shifted : readings about another hard iron stay, for who looks for what it is; else they are left out too
    """
    mag = recording.streams["mag"]
    columns = {**mag.columns, **{name: mag[name] - b for name, b in zip(MAG, compass.offset, strict=True)}}
    m_n = recording.environment.magnetic_field
    words = ", ".join(f"{b:.4g}" for b in compass.offset)
    notes = [f"mag: hard iron ({words}) found from the log and taken off"]
    count, shifted = int(np.sum(compass.disturbed)), int(np.sum(compass.shifted))
    if count:
        notes.append(f"mag: {count} readings left out: the norm is not the field's")
    if shifted:
        kept = "kept, so that the effect is found" if keep_shifted else "left out: `sinan trace` looks for the effect"
        notes.append(f"mag: {shifted} readings have the norm of the field about another hard iron: {kept}")
    left_out = compass.disturbed if keep_shifted else compass.disturbed | compass.shifted
    return recording.replace(
        streams={**recording.streams, "mag": Stream(mag.t, columns).rows(~left_out)},
        environment=replace(recording.environment, magnetic_field=compass.m_n if m_n is None else m_n),
        notes=(*recording.notes, *notes),
    )


@dataclass(frozen=True)
class _Fit:
    """Hard iron, norm and dip; `std` (3,) 1-sigma of the hard iron, with errors that last [unit]."""

    offset: FloatArray
    norm: float
    dip: float
    std: FloatArray


@dataclass(frozen=True)
class _Kind:
    """One of the two kinds of lines: its rows, their instants, how far the body turned there, its least error, and the
    share of its error that comes back with the motion: of that a block of time is worth one line.
    """

    rows: slice
    t: FloatArray
    moved: FloatArray
    least: float
    lasts: float = 0.0


def _fit(
    t: FloatArray, m: FloatArray, f: FloatArray, moved: FloatArray, used: BoolArray, dip: float | None = None
) -> _Fit:
    """The two lines of `compass_of`, by weighted least squares; lengths over the median norm of the readings.

    Each kind of line weighs by its own error, what does not average out with it: in flight the second shows the
    accelerations, which come back with its turns, and the first the noise of a reading. Such weights may settle on the
    wrong kind: two starts, both kinds alike and the norm alone, and the end with the smaller errors counts.

    Parameters
    ----------
    moved : (n,) angle by which the body turned at each reading [rad]
    """
    unit = float(np.median(np.linalg.norm(m[used], axis=1)))
    m, force = m / unit, np.linalg.norm(f, axis=1)
    steady = used & (np.abs(force - np.median(force)) < STEADY)
    down, _, _ = _turned(-f / np.maximum(force, 1e-9)[:, None], steady)
    # an error of one reading enters the norm's line its own size
    y = np.concatenate([0.5 * np.sum(m**2, axis=1)[used], np.sum(m * down, axis=1)[steady]])
    turned, seen, noise = _turned(m, used)
    half, zero, one = np.full((len(m), 1), 0.5), np.zeros((len(m), 1)), np.ones((len(m), 1))
    A = np.concatenate([np.hstack([turned, half, zero])[used], np.hstack([down, zero, one])[steady]])
    # no line is believed to better than a reading's noise, nor than the force is gravity's alone
    alone, tilts = 1.0, 0.0
    if np.any(steady):
        alone = float(np.sqrt(np.mean((force[steady] / np.median(force) - 1.0) ** 2)))
        tilts = float(np.sum(np.var(down[steady], axis=0)))
    # accelerations tilt what the accelerometer shows with every turn of a flight: the smaller the tilts, the more
    lasts = min(1.0, 2.0 * alone**2 / max(tilts, LEAST_ERROR))
    n = int(np.sum(used))
    kinds = (
        _Kind(slice(0, n), t[used], moved[used], max(noise, LEAST_ERROR)),
        _Kind(slice(n, len(y)), t[steady], moved[steady], max(alone, LEAST_ERROR), lasts),
    )
    ends = [_solved(A, y, kinds, dip, noise * seen, trust) for trust in (1.0, 0.0)]
    _, x, lines = min(ends, key=lambda end: end[0])
    b, norm = x[:3], _norm(x)
    found = float(np.arcsin(np.clip(x[4] / norm, -1.0, 1.0))) if dip is None else dip
    std = np.linalg.norm(np.linalg.pinv(np.linalg.qr(lines, mode="r"))[:3], axis=1)
    return _Fit(b * unit, norm * unit, found, np.asarray(std * unit))


def _solved(
    A: FloatArray, y: FloatArray, kinds: tuple[_Kind, _Kind], dip: float | None, noise: FloatArray, trust: float
) -> tuple[float, FloatArray, FloatArray]:
    """The errors of all lines together, the five unknowns and the weighted lines.

    A known dip leaves b and |B|: the constants (|B|^2 - |b|^2, |B| sin dip) are followed from step to step.

    Parameters
    ----------
    noise : (3, 3) square root of the covariance of the readings' noise in A, which pulls b towards their mean: that is
        taken off at the end, as far as the norm's lines show as much
    trust : [0, 1] in the second kind at the start
    """
    x, J = np.array([0.0, 0.0, 0.0, 1.0, 0.0 if dip is None else np.sin(dip)]), np.eye(5)
    w = np.full(len(y), 1.0 / LEAST_ERROR)
    w[kinds[1].rows] *= trust
    prior, nothing, errors = np.eye(3, 5) / HARD_IRON, np.zeros(3), 0.0
    for _ in range(PASSES):
        lines, right, before = np.concatenate([A * w[:, None], prior]), np.concatenate([y * w, nothing]), x
        if dip is None:
            x = np.linalg.lstsq(lines, right, rcond=None)[0]
        else:
            x, J = _with_dip(lines, right, x, dip)
        residual, errors = y - A @ x, 0.0
        for kind in kinds:
            share, error = _weights(kind, residual[kind.rows])
            w[kind.rows] = share / error
            errors += len(share) * float(np.log(error))
        if np.max(np.abs(x - before)) < SETTLED:
            break
    lines, own = np.concatenate([A * w[:, None], prior]) @ J, kinds[0].rows
    shown = float(np.sqrt(np.mean((w[own] * residual[own]) ** 2) / np.max(w[own]) ** 2))
    spread = noise @ noise * min(1.0, shown / kinds[0].least) ** 2
    # E[sum w^2 m (y - m . b)] is sum w^2 spread (mean of m - b), and that of sum w^2 m m' more than of the true m
    pull, H = np.zeros(lines.shape[1]), lines.T @ lines
    pull[:3] = spread @ np.sum(w[own, None] ** 2 * (A[own, :3] - x[:3]), axis=0)
    H[:3, :3] -= np.sum(w[own] ** 2) * spread
    step = np.linalg.lstsq(H, pull, rcond=None)[0]
    return errors, x - step if dip is None else _stepped(x, -step, dip), lines


def _weights(kind: _Kind, residual: FloatArray) -> tuple[FloatArray, float]:
    """(n,) what an outlier keeps of its weight (Cauchy), and the error of a line, of which a part lasts.

    What is usual is the median over the way that the body turns, not over time: at rest it repeats one line.
    """
    if len(residual) < LEAST_READINGS:
        return np.ones(len(residual)), 1.0
    order = np.argsort(np.abs(residual))
    way = np.cumsum(kind.moved[order]) if np.any(kind.moved) else np.arange(1.0, len(order) + 1.0)
    sigma = max(1.4826 * float(np.abs(residual[order][np.searchsorted(way, 0.5 * way[-1])])), kind.least)
    share = 1.0 / np.sqrt(1.0 + (residual / (BEND * sigma)) ** 2)
    kept, block = residual * share, len(residual) / _blocks(kind.t)
    coming_back = float(np.sqrt(np.mean(kept**2) * (1.0 + kind.lasts * (block - 1.0))))
    return share, max(_error(kind.t, kept), coming_back, kind.least)


def _error(t: FloatArray, residual: FloatArray) -> float:
    """White noise of one row that leaves the mean of all as uncertain as it is, or more so: the scatter averages out,
    what lasts does not.
    """
    return float(np.hypot(np.sqrt(np.mean(residual**2)), _lasting(t, residual) * np.sqrt(len(residual))))


def _turned(vectors: FloatArray, used: BoolArray) -> tuple[FloatArray, FloatArray, float]:
    """(n, 3) the vectors, at their mean along directions in which those used spread no more than noise does; (3, 3) the
    projector on the other directions; the noise.
    """
    if np.sum(used) < LEAST_READINGS:
        return vectors, np.eye(3), 0.0
    # differences of rows that are no neighbours, or turns between them, are no noise
    noise = min(reading_noise(vectors), reading_noise(vectors[used]), CLEAR / TURNED)
    mean = np.mean(vectors[used], axis=0)
    spread, axes = np.linalg.eigh(np.cov(vectors[used], rowvar=False))
    turned = axes[:, spread > (TURNED * noise) ** 2]
    seen = np.asarray(turned @ turned.T)
    return np.asarray(mean + (vectors - mean) @ seen), seen, noise


def _with_dip(lines: FloatArray, right: FloatArray, x: FloatArray, dip: float) -> tuple[FloatArray, FloatArray]:
    """One Newton step of (b, |B|), and the derivative (5, 4) of the five unknowns of the lines by them."""
    b, norm = x[:3], _norm(x)
    J = np.zeros((5, 4))
    J[:3, :3], J[3, :3], J[3, 3], J[4, 3] = np.eye(3), -2.0 * b, 2.0 * norm, np.sin(dip)
    step = np.asarray(np.linalg.lstsq(lines @ J, right - lines @ x, rcond=None)[0], dtype=np.float64)
    return _stepped(x, step, dip), J


def _stepped(x: FloatArray, step: FloatArray, dip: float) -> FloatArray:
    """(5,) the unknowns of the lines after a step (4,) of (b, |B|), at a known dip."""
    b, norm = x[:3] + step[:3], max(_norm(x) + step[3], LEAST_NORM)
    return np.array([*b, norm**2 - b @ b, norm * np.sin(dip)])


def _norm(x: FloatArray) -> float:
    """|B| of the five unknowns."""
    return float(np.sqrt(max(x[3] + x[:3] @ x[:3], LEAST_NORM**2)))


def _disturbed(average: FloatArray, usual: float, rate: float) -> BoolArray:
    """(n,) rows in and around stretches in which the averaged norm is off; `usual`: a robust sigma of it."""
    off = np.abs(average) > DISTURBED * usual
    reach = _reach(len(average), rate)
    near = np.convolve(off.astype(float), np.ones(2 * reach + 1), mode="same") > 0.5
    return np.asarray(near & (np.mean(near) < 0.5))  # more than half disturbed: then the fit is what is wrong


def _reach(rows: int, rate: float) -> int:
    """Rows around a stretch that count as disturbed as well."""
    return min(max(round(AROUND * rate), 1), (rows - 1) // 2)


def _averaged(error: FloatArray, rate: float) -> FloatArray:
    """(n,) mean over `SMOOTH` seconds."""
    window = min(max(round(SMOOTH * rate), 1), len(error))
    return np.convolve(error, np.full(window, 1.0 / window), mode="same")


def _shifted(
    t: FloatArray,
    m: FloatArray,
    f: FloatArray,
    moved: FloatArray,
    disturbed: BoolArray,
    fit: _Fit,
    rate: float,
    usual: float,
) -> BoolArray:
    """(n,) rows of the disturbed stretches that a hard iron of their own explains: one that the turns of the stretch
    tell, and about which the norm is the field's. Another field about the old one is a place and no magnet.
    """
    found = np.zeros(len(m), dtype=bool)
    inside = _reach(len(m), rate) + round(SMOOTH * rate)
    for start, stop in runs_of(disturbed):
        core = slice(start + inside, max(stop - inside, 0))
        rows = len(t[core])
        if rows < LEAST_READINGS or np.median(np.linalg.norm(m[core], axis=1)) == 0.0:
            continue
        there = _fit(t[core], m[core], f[core], moved[core], np.ones(rows, dtype=bool), fit.dip)
        alike = max(float(np.max(there.std)), abs(there.norm - fit.norm)) < TOLD * fit.norm
        of_its_own, of_the_rest = (_is_steady(m[core], at.offset, rate, usual) for at in (there, fit))
        found[start:stop] = alike and of_its_own and not of_the_rest
    return found


def _is_steady(m: FloatArray, offset: FloatArray, rate: float, usual: float) -> bool:
    """Whether the norm about a hard iron is the same in all of a stretch but its odd parts."""
    error = np.linalg.norm(m - offset, axis=1)
    off = np.abs(_averaged(error - np.median(error), rate)) > DISTURBED * usual
    return bool(np.mean(off) < 1.0 - EXPLAINED)


def _lasting(t: FloatArray, error: FloatArray) -> float:
    """Root mean square of what is left of an error that is averaged over `BLOCK` seconds.

    The norm shows one component of three, which turns about with the body: the others are as large.
    """
    blocks = _blocks(t)
    block = np.minimum(((t - t[0]) * blocks / (t[-1] - t[0])).astype(int), blocks - 1)
    count, total = np.bincount(block), np.bincount(block, error)
    return float(np.sqrt(np.sum(total[count > 0] ** 2 / count[count > 0]) / len(t)))


def _blocks(t: FloatArray) -> int:
    """How many blocks of time a log has; all are as long, so that the last reading alone is none."""
    return max(int((t[-1] - t[0]) / BLOCK), LEAST_BLOCKS)
