"""Whether readings can be in the unit that they are said to be in: what a wrong scale looks like, for every reader.

A reading is refused only where its unit is recognised; what is merely odd (a fault, a large bias, a crash) passes.
"""

from __future__ import annotations

from datetime import date as Date

import numpy as np

from sinan.sensors.arrays import FloatArray, integral
from sinan.sensors.constants import STANDARD_GRAVITY
from sinan.sensors.errors import InputError
from sinan.sensors.formats.lasting import LOST, lasting_gravity, other_axes
from sinan.sensors.formats.units import UNITS
from sinan.sensors.geomagnetism import earth_field, inclination
from sinan.sensors.recording import ACCEL, GYRO, MAG, POSITION, VELOCITY, Recording, Stream
from sinan.sensors.rotation import cross

#: The median norm of specific force lies within this factor of gravity, in flight and at rest, with the biases that are
#: sold (0.3 g) and for circles flown at 50 deg of bank (1.56 g).
_NEAR_GRAVITY = 1.6
_ACCEL_UNITS = (("g", 1.0), ("milli-g", 1000.0))
#: A sensor at rest in poses whose norm is off by this factor is in another unit: g and milli-g, or T, mT, G, uT and nT
#: are ten apart or more, which leaves 40 % for the scale of the sensor.
OTHER_UNIT = 7.0
#: Norm of the field on the Earth's surface [gauss] (World Magnetic Model); units are ten apart or more, and a reading's
#: scale, iron of the vehicle and steel of a room may make it three times as large or small.
EARTH_FIELD = (0.2, 0.7)
_FIELD_FACTOR = 3.0
#: Parts of gravity that last: above the first the rates would be right, below the second the force has no gravity.
_KEPT, _GONE = 0.8, 0.5
#: Sines of dips: where the field is steep enough to tell up from down, and how near one is to another [1].
_DIPS, _NEAR_DIP = 0.4, 0.35
#: The dip changes by less than a degree in ten years.
_ANY_DATE = Date(2020, 1, 1)
#: Gravity on the Earth's surface lies within 0.3 % of the standard one; on other bodies the rules below do not hold.
_EARTH_GRAVITY = (9.7, 9.9)
#: Pressures of the lower atmosphere [hPa]; as pascals they would be 40 km up.
HECTOPASCALS = (300.0, 1100.0)
#: Beyond 10 g in the middle of a flight: no vehicle, but raw counts of every converter with 12 bits or more.
_HIGHEST_MEDIAN_FORCE = 100.0
#: Inertial sensors read at most 32 000 times a second; as days, 100 a second are 1e-7 apart [s].
_SHORTEST_STEP = 1e-5
#: The widest range of a rate gyroscope that is sold for vehicles is 4000 deg/s.
_HIGHEST_RATE = np.radians(4000.0)
#: Bias of the worst rate gyroscopes that are sold is 40 deg/s; a body at rest cannot turn faster than its gyro's bias.
HIGHEST_RATE_AT_REST = 1.0
#: Where another unit is said.
_SAYS = "a header, `ax [g]`, `gx [deg/s]`, or `unit` of a map says another unit"
#: Fewer readings say nothing of their unit.
_FEWEST = 10
#: Share of the turn of a direction that the rates explain: below it the scale between the two says nothing.
_EXPLAINED = 0.5
_DEGREE = np.pi / 180.0
#: Ways of this time [s] are longer than places scatter; the share of them that velocities of one unit explain, and how
#: near their scale is to that of the unit [1]: km/h, kn and m/s are 1.8 and more apart.
_WAY, _ALL_EXPLAINED, _SAME = 2.0, 0.9, 0.2


def check_units(recording: Recording) -> None:
    """Refuse readings whose unit is recognisably another one.

    Raises
    ------
    InputError : names the stream, what the readings look like, and the unit that was expected
    """
    imu = recording.streams.get("imu")
    if imu is not None:
        _check_exchange(recording, imu)
    for name in ("imu", "poses"):
        stream = recording.streams.get(name)
        if stream is not None and stream.has(ACCEL):
            _check_accel(recording, name, stream)
    if imu is not None:
        _check_time(recording, imu)
        _check_gyro(recording, imu)
    if (gps := recording.streams.get("gps")) is not None:
        _check_speed(recording, gps)
    baro = recording.streams.get("baro")
    if baro is not None and "pressure" in baro:
        _check_pressure(recording, baro)


def _check_exchange(recording: Recording, imu: Stream) -> None:
    """Rates whose norm is that of gravity, and steadier than the force's, which is not near it, are the force."""
    gravity = recording.environment.gravity
    on_earth = gravity is None or _EARTH_GRAVITY[0] < gravity < _EARTH_GRAVITY[1]
    if not on_earth or len(imu) < _FEWEST:
        return
    force, rate = (np.linalg.norm(imu.array(names), axis=1) for names in (ACCEL, GYRO))
    (f, f_varies), (w, w_varies) = (_middle(norm) for norm in (force, rate))
    force_is, rate_is = (1.0 / _NEAR_GRAVITY < one / STANDARD_GRAVITY < _NEAR_GRAVITY for one in (f, w))
    if rate_is and not force_is and w_varies * f < f_varies * w:
        found = f"gyroscope with a median norm of {w:.4g}, accelerometer with one of {f:.4g}: look exchanged"
        expected = f"accel in m/s^2, about {STANDARD_GRAVITY:.2f} at rest, and gyro in rad/s: exchange their columns"
        raise InputError(recording.where, found, f"{expected} in the header, or by a map", "stream imu")


def _middle(norm: FloatArray) -> tuple[float, float]:
    """The median, and the width of the middle half."""
    low, middle, high = np.percentile(norm, [25.0, 50.0, 75.0])
    return float(middle), float(high - low)


def _check_accel(recording: Recording, name: str, stream: Stream) -> None:
    """The median norm of specific force is near gravity; in poses `gravity = 1` says that g is meant."""
    gravity = recording.environment.gravity
    poses = recording.kind == "poses"
    if poses and gravity is not None and not _EARTH_GRAVITY[0] < gravity < _EARTH_GRAVITY[1]:
        return
    force = float(np.median(np.linalg.norm(stream.array(ACCEL), axis=1)))
    found = f"accelerometer with a median norm of {force:.4g}"
    for unit, one in _ACCEL_UNITS:
        if one / _NEAR_GRAVITY < force < one * _NEAR_GRAVITY:
            free = " (or gravity was taken off)" if unit == "g" and _points_anywhere(stream) else ""
            hint = f"m/s^2, about {STANDARD_GRAVITY:.2f} at rest; {_SAYS}"
            raise InputError(recording.where, f"{found}: looks like {unit}{free}", hint, f"stream {name}")
    if not poses and force > _HIGHEST_MEDIAN_FORCE:
        raise InputError(recording.where, f"{found}: looks like raw counts", "m/s^2", f"stream {name}")
    times = force / STANDARD_GRAVITY
    if poses and not 1.0 / OTHER_UNIT < times < OTHER_UNIT:
        ratio = f"{times:.0f} times gravity" if times > 1.0 else f"gravity / {1.0 / max(times, 1e-9):.0f}"
        found += f", {ratio}: looks like another unit"
        expected = f"m/s^2, about {STANDARD_GRAVITY:.2f} at rest; a map converts units and raw counts"
        raise InputError(recording.where, found, expected, f"stream {name}")


def _points_anywhere(stream: Stream) -> bool:
    """Whether an acceleration has no lasting direction, as one has from which gravity was taken."""
    force = stream.array(ACCEL)
    lasting = float(np.linalg.norm(np.mean(force, axis=0)))
    return len(force) >= _FEWEST and lasting < 0.5 * float(np.median(np.linalg.norm(force, axis=1)))


def _check_time(recording: Recording, imu: Stream) -> None:
    if len(imu) < _FEWEST:
        return
    step = imu.step
    if step < _SHORTEST_STEP:
        found = f"a median step of {step:.4g} s between samples: time looks like days (MATLAB's datenum) read as s"
        raise InputError(recording.where, found, "seconds, or a map whose `time` has a unit", "stream imu")
    if step >= 1.0:
        unit = "ms" if step < 1000.0 else "us"
        meant = ", or us as ms" if unit == "ms" else ""
        found = f"a median step of {step:.4g} s between samples: time looks like {unit} read as s{meant}"
        raise InputError(recording.where, found, "seconds, after the conversion of a map", "stream imu")


def _check_speed(recording: Recording, gps: Stream) -> None:
    """Velocities, integrated, are the way; fitted by one scale, that of another unit is told where it explains all."""
    if len(gps) < _FEWEST or not gps.has(VELOCITY) or not gps.has(POSITION):
        return
    t, v, p = gps.t, gps.array(VELOCITY[:2]), gps.array(POSITION[:2])
    way = integral(t, v)
    rows = np.unique(np.floor((t - t[0]) / _WAY), return_index=True)[1]  # the first of each
    expected, seen = np.diff(way[rows], axis=0).ravel(), np.diff(p[rows], axis=0).ravel()
    power, along = float(expected @ expected), float(expected @ seen)
    if len(rows) < _FEWEST or not power > 0.0 or along**2 < _ALL_EXPLAINED * power * float(seen @ seen):
        return
    for unit, (factor, _) in UNITS["speed"].items():
        if factor != 1.0 and along > 0.0 and abs(np.log(along / power / factor)) < _SAME:
            found = f"velocities {power / along:.4g} times those of the places: look like {unit}"
            raise InputError(recording.where, found, "m/s; a header, `vn [cm/s]`, or a map", "stream gps")


def check_field(recording: Recording) -> None:
    """Refuse a magnetometer in gauss, as the unit of a map says, that no field on the Earth would make so.

    What spreads about the middle of the readings is held against the strongest field, wherever hard iron has put it;
    the longest reading against the weakest, since few directions make the spread small.

    Raises
    ------
    InputError : names the stream, the size found and that expected
    """
    for name in ("mag", "poses"):
        stream = recording.streams.get(name)
        if stream is None or not stream.has(MAG) or len(stream) < _FEWEST:
            continue
        reading = stream.array(MAG)
        spread = float(np.median(np.linalg.norm(reading - np.median(reading, axis=0), axis=1)))
        longest = float(np.max(np.linalg.norm(reading, axis=1)))
        if spread > _FIELD_FACTOR * EARTH_FIELD[1]:
            found = f"magnetometer readings that spread over {spread:.3g} gauss"
        elif max(spread, longest) < EARTH_FIELD[0] / _FIELD_FACTOR:
            found = f"magnetometer readings up to {longest:.3g} gauss"
        else:
            continue
        expected = f"{EARTH_FIELD[0]} to {EARTH_FIELD[1]} gauss, the Earth's field, after the conversion of the map"
        raise InputError(recording.where, f"{found}: looks like another unit", expected, f"stream {name}")


def unit_of_field(norm: float) -> str:
    """The unit in which the Earth's field is as large; empty: none. Units are ten apart, the field varies by 3.5.

    Parameters
    ----------
    norm : a middle one of a magnetometer's readings
    """
    fitting = [unit for unit, (gauss, _) in UNITS["field"].items() if EARTH_FIELD[0] <= gauss * norm <= EARTH_FIELD[1]]
    return fitting[0] if fitting else ""


def _check_pressure(recording: Recording, baro: Stream) -> None:
    pressure = float(np.median(baro["pressure"]))
    if HECTOPASCALS[0] < pressure < HECTOPASCALS[1]:
        found = f"a median pressure of {pressure:.4g}: looks like hPa"
        raise InputError(recording.where, found, "Pa, about 101325 at sea level", "stream baro")


def _check_gyro(recording: Recording, imu: Stream) -> None:
    """Rates beyond any instrument; rates that turn the field or gravity 57 times too fast; rates at rest."""
    rate = imu.array(GYRO)
    peak = float(np.percentile(np.abs(rate), 99.9))
    if peak > _HIGHEST_RATE:
        unit = "deg/s" if peak < np.degrees(_HIGHEST_RATE) else "raw counts"
        raise _gyro_error(recording, f"gyroscope with rates to {peak:.4g}: looks like {unit}")
    force = imu.array(ACCEL)
    mag = recording.streams.get("mag")
    directions = [(imu.t, force)]
    if mag is not None and mag.has(MAG):
        directions.append((mag.t, mag.array(MAG)))
    for t, direction in directions:
        if _turns_like_degrees(imu.t, rate, t, direction):
            raise _gyro_error(recording, f"gyroscope with rates to {peak:.4g}: looks like deg/s (what it sees turns 57 "
                                         "times slower)")  # fmt: skip
    _check_lasting(recording, imu, peak)
    at_rest = np.all(np.std(force, axis=0) < 0.2) and len(imu) > 1
    mean_force = force.mean(axis=0)
    across = np.median(np.linalg.norm(cross(rate, mean_force), axis=1)) / max(float(np.linalg.norm(mean_force)), 1e-9)
    if at_rest and across > HIGHEST_RATE_AT_REST:
        raise _gyro_error(recording, f"gyroscope with a rate of {across:.3g} at rest: looks like deg/s")


def _check_lasting(recording: Recording, imu: Stream, peak: float) -> None:
    """Specific force, turned by the rates, has gravity as its mean; else rates are in deg/s, or gravity was taken off.

    A multicopter's force stays along its own z, however it tilts, and tells of wrong rates in no other way.
    """
    gravity = recording.environment.gravity
    if gravity is not None and not _EARTH_GRAVITY[0] < gravity < _EARTH_GRAVITY[1]:
        return
    with np.errstate(all="ignore"):  # a damaged reading gives no number, which says nothing
        lasting = lasting_gravity(imu)
        as_rad, as_deg = (lasting(scale * np.eye(3)) for scale in (1.0, _DEGREE))
    if not as_rad < LOST:
        return
    force = float(np.median(np.linalg.norm(imu.array(ACCEL), axis=1)))
    if as_deg > max(_KEPT, as_rad) and force < _NEAR_GRAVITY * STANDARD_GRAVITY:
        found = f"gyroscope with rates to {peak:.4g}: looks like deg/s (as rad/s, gravity would point everywhere)"
        other = other_axes(imu)
        found += "" if other is None else f", or has other axes than the accelerometer ({other.words()})"
        raise _gyro_error(recording, found)
    if max(as_rad, as_deg) < _GONE and force < _KEPT * STANDARD_GRAVITY:
        found = f"accelerometer with a median norm of {force:.4g}: gravity was taken off, as of a linear acceleration"
        raise InputError(recording.where, found, "what the accelerometer reads, 9.81 m/s^2 at rest", "stream imu")


def sign_of_force(recording: Recording) -> list[str]:
    """A sentence where the field dips as it would at this place if the accelerometer had the other sign; else none.

    Hard iron as large as the field may do the same, so that nothing is refused.
    """
    if way_of_dip(recording) >= 0 or (dips := _dips(recording)) is None:
        return []
    seen, expected = np.degrees(np.arcsin(dips))
    there = f"by what it says of up the field dips {seen:.0f} deg, and {expected:.0f} deg at this place"
    way = "gravity is logged, not force (a map turns all three axes of accel), or mag has other axes"
    return [f"accel: {there}: {way}"]


def way_of_dip(recording: Recording) -> int:
    """1: the field dips as it does at this place; -1: the other way, as much; 0: it is not known."""
    if (dips := _dips(recording)) is None or abs(dips[1]) < _DIPS:
        return 0
    seen, expected = dips
    near = min((1, -1), key=lambda way: abs(seen - way * expected))
    return near if abs(seen - near * expected) <= _NEAR_DIP else 0


def _dips(recording: Recording) -> tuple[float, float] | None:
    """Sines of the dip that is seen and of that at this place; None: one is not known.

    sin(dip) is minus the mean of the cosine between force, which points up, and field.
    """
    imu, mag = recording.streams.get("imu"), recording.streams.get("mag")
    if recording.origin is None or imu is None or mag is None or not mag.has(MAG):
        return None
    expected = inclination(earth_field(*recording.origin, _ANY_DATE))
    force = np.stack([np.interp(mag.t, imu.t, imu[name]) for name in ACCEL], axis=-1)
    field = mag.array(MAG)
    with np.errstate(all="ignore"):
        cosine = np.sum(force * field, axis=1) / (np.linalg.norm(force, axis=1) * np.linalg.norm(field, axis=1))
        seen = -float(np.nanmedian(cosine)) if np.any(np.isfinite(cosine)) else 0.0
    return float(np.clip(seen, -1.0, 1.0)), float(np.sin(expected))


def _gyro_error(recording: Recording, found: str) -> InputError:
    return InputError(recording.where, found, f"rad/s; {_SAYS}", "stream imu")


def _turns_like_degrees(t_rate: FloatArray, rate: FloatArray, t: FloatArray, seen: FloatArray) -> bool:
    """Whether a direction fixed in the world turns in the body about pi/180 times as fast as the rates say.

    d u / dt = -w x u is integrated over intervals of about 0.3 s and fitted by one scale s, du = s int(-w x u) dt:
    s = 1 for rad/s, pi/180 for deg/s. Noise of the rates pulls s towards zero, but then explains little of du. A bias
    of the rates is taken off as their median; that of a direction that goes all round, as its middle.
    """
    if len(t) < 50 or len(t_rate) < 50:
        return False
    u = seen - (0.5 * (np.max(seen, axis=0) + np.min(seen, axis=0)) if _covers(seen) else 0.0)
    norm = np.linalg.norm(u, axis=1)
    if np.median(norm) <= 0.0:
        return False
    u = u / np.median(norm)
    w = np.stack([np.interp(t, t_rate, column) for column in rate.T], axis=-1)
    turn = -cross(w - np.median(w, axis=0), u)
    angle = integral(t, turn)
    interval = max(0.3, float(np.median(np.diff(t))))
    rows = np.unique(np.floor((t - t[0]) / interval), return_index=True)[1]  # the first of each
    du, expected = np.diff(u[rows], axis=0).ravel(), np.diff(angle[rows], axis=0).ravel()
    power, seen_power = float(expected @ expected), float(du @ du)
    if power <= 0.0 or seen_power <= 0.0:
        return False
    scale = float(expected @ du) / power
    explained = scale * float(expected @ du) / seen_power
    return explained > _EXPLAINED and 0.5 * _DEGREE < scale < 2.0 * _DEGREE


def _covers(seen: FloatArray) -> bool:
    """Whether the readings turn through so much of the sphere that their middle is their offset."""
    half = 0.5 * np.ptp(seen, axis=0)
    return bool(np.min(half) > 0.5 * np.max(half))
