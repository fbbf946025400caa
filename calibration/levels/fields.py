"""What a log does not declare, of kinds rather than sizes: what may be believed beforehand, and what the log bears out.

A model of the Earth gives the field of a place to half a degree, and a log that was made there in the open has it so.
Beside steel its direction is off by a tenth; in a hall, a hull or a simulation it has nothing to do with the place.
Most compasses were calibrated, some never. What an IMU puts out is low-passed before it is sampled, so its samples are
means over the time before the stamp sooner than instants. Each is a belief with a prior, and the likelihood of the log
decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinan.calibration.levels.declared_effects import Readings
from sinan.calibration.levels.excerpts import excerpts_of
from sinan.calibration.levels.fit import likeliest, problem_of
from sinan.calibration.levels.iron import iron_of_turns
from sinan.calibration.levels.levels import Levels, first_levels, has_its_own_north
from sinan.calibration.levels.sizes import AS_IT_COMES, CALIBRATED, LITTLE, Iron, sizes_of
from sinan.estimator.filter.effect_forms import told_late_from
from sinan.estimator.filter.engine import run
from sinan.estimator.filter.field import field_of_the_log
from sinan.sensors.arrays import FloatArray
from sinan.sensors.errors import InputError
from sinan.sensors.geomagnetism import DIRECTION_STD, direction_at, field_along, inclination
from sinan.sensors.recording import Recording

#: 1-sigma of the norm of a field that nobody declares, as a part of it, and of its dip where no place tells it [rad]: a
#: choice, for steel in a room. Half calls a dip that is 0.2 rad off another field, twice takes one that is 0.06 rad off
#: for that of the place and one of 0.3 rad for steel (`bounds_of_work fields`).
FIELD_STD = 0.1
#: 1-sigma of the declination at a place that nobody tells [rad]: 62 % of the Earth between 60 degrees north and south
#: has less (measured: on the model of `sensors.geomagnetism`, in `test_fields`).
DECLINATION_STD = 0.2
#: Of logs that say where they were made, the share made beside steel, and where the place tells nothing: a choice. Half
#: of the first or twice the second call a dip that is 0.2 rad off another field, not steel; the other two change none
#: of 0.04 to 0.3 rad (`bounds_of_work fields`).
BESIDE_STEEL, ELSEWHERE = 0.1, 0.01
#: Of compasses whose noise nobody declares, the share that was never calibrated: a choice. Of iron of 0.141 and 0.148
#: of the field half takes both for what a calibration left, twice neither (`bounds_of_work iron`).
NEVER_CALIBRATED = 0.1
#: Of such IMUs the share that is sampled at instants, without a low-pass of about its own rate: a choice. Half takes
#: the instants of an aerobatic flight for means, twice changes none (`bounds_of_work kinds`).
INSTANT = 0.1
#: Of streams so many are stamped at the instant of the reading: 1 / 2, since nobody knows.
ONE_CLOCK = 0.5


@dataclass(frozen=True, eq=False)
class Field:
    """What may be believed of a field.

    Attributes
    ----------
    m_n, covariance : (3,) in NED, (3, 3)
    prior : its share among the beliefs
    words : where its direction is from
    """

    m_n: FloatArray
    covariance: FloatArray
    prior: float
    words: str

    @property
    def note(self) -> str:
        """In a line for the report."""
        norm, dip = np.linalg.norm(self.m_n), np.rad2deg(inclination(self.m_n))
        east = np.rad2deg(np.arctan2(self.m_n[1], self.m_n[0]))
        said = f"mag: field of norm {norm:.4g} from the log; dip {dip:.0f} deg, declination {east:.1f} deg"
        return f"{said} {self.words}; a state"


@dataclass(frozen=True)
class Believed:
    """What is believed of a compass before its sizes are sought.

    Attributes
    ----------
    field : magnetic, of the place; None where it is declared, or nothing reads it
    iron : median of the hard iron's prior, as a part of the field
    compass : that iron, less what the log's own turns show of it
    prior : logarithm of the share of such compasses, and of the density of the iron from which the bias starts over
        that which the model gives it
    """

    field: Field | None
    iron: float
    compass: Iron = LITTLE
    prior: float = 0.0

    @property
    def m_n(self) -> FloatArray | None:
        """(3,) field that is believed in."""
        return None if self.field is None else self.field.m_n

    @property
    def covariance(self) -> FloatArray | None:
        """(3, 3) of that field."""
        return None if self.field is None else self.field.covariance

    @property
    def notes(self) -> list[str]:
        """What of it a reader is told, a line each."""
        found = [] if self.field is None else [self.field.note]
        if self.iron == AS_IT_COMES and self.compass.taken is not None:
            found.append("mag: its hard iron is that of a compass which was never calibrated, by the likelihood")
            each = ", ".join(f"{one:.3g}" for one in self.compass.taken)
            found.append(f"mag: its bias starts from {each}, the hard iron that the turns of the log show")
        return found


def beforehand(recording: Recording) -> Believed:
    """The likeliest beliefs, at the medians of all sizes."""
    believed = [
        replace(one, field=field)
        for one in compasses_beforehand(recording)
        for field in fields_beforehand(recording, one.compass) or (None,)
    ]
    if len(believed) == 1:
        return believed[0]

    first = first_levels(recording, sizes_of(recording), None, None)

    def levels_of(one: Believed) -> Levels:
        levels = replace(first, m_n=one.m_n, field=one.covariance, iron=one.compass.taken)
        for size in sizes_of(recording, one.compass):
            if (size.sensor, size.key) == ("mag", "bias_std"):  # noise and colour are those of one norm for all
                levels = levels.with_size(size, size.median)
        return levels

    readings = Readings.of(levels_of(believed[0]).flight(recording))

    def log_posterior(one: Believed) -> float:
        try:
            journal = run(readings.inputs(levels_of(one).flight(recording)), "numba", 0)
        except InputError:  # no state follows from such a field
            return -np.inf
        return journal.log_likelihood + one.prior + float(np.log(1.0 if one.field is None else one.field.prior))

    best = max(range(len(believed)), key=lambda k: log_posterior(believed[k]))
    if believed[best].iron == AS_IT_COMES:
        return believed[best]
    fields = fields_beforehand(recording) or (None,)  # what a calibration leaves the filter learns itself
    return Believed(fields[best % len(fields)], CALIBRATED)


def compasses_beforehand(recording: Recording) -> Sequence[Believed]:
    """What may be believed of a compass, of no field yet: that it was calibrated, or never.

    Iron as large as the field turns the first heading by any angle, from which no filter that is linear finds back, and
    makes the norm of the readings another than the field's. So the bias starts from what the turns of the whole log
    show, and what they leave is the prior of the rest.
    """
    if sizes_of(recording) == sizes_of(recording, Iron(AS_IT_COMES)):
        return (Believed(None, CALIBRATED),)  # its size is declared, or nothing reads the field
    rate_std = first_levels(recording, sizes_of(recording), None, None).specs["gyro"].bias_std
    assert rate_std is not None
    found = []
    for iron, share in ((CALIBRATED, 1.0 - NEVER_CALIBRATED), (AS_IT_COMES, NEVER_CALIBRATED)):
        std = iron * LITTLE.norm(recording)
        taken, sigma = iron_of_turns(recording, std, rate_std)
        norm = Iron(taken=taken).norm(recording)
        left = min(float(np.hypot(CALIBRATED * norm, sigma)), std)
        density = -0.5 * float(taken @ taken) / std**2 - 3.0 * float(np.log(std / left))
        found.append(Believed(None, iron, Iron(left / norm, taken), float(np.log(share)) + density))
    return found


def fitted(recording: Recording, believed: Believed) -> Levels:
    """The likeliest sizes, for the likelier kind of IMU samples where the recording declares none; of a long log sought
    in excerpts, and from there in the whole.

    Means over a step make other streams later by half of it. So it counts for a kind how many streams are then not late
    at all, each by itself with odds of one to one beforehand: by the Savage-Dickey ratio of posterior to prior at zero.
    """
    kinds = {"average": 1.0 - INSTANT, "instant": INSTANT}
    if are_samples_declared(recording):
        kinds = {recording.spec("accel").imu_samples: 1.0}

    excerpts = excerpts_of(recording)
    whole = {kind: problem_of(recording, believed.m_n, believed.covariance, believed.compass, kind) for kind in kinds}
    problems = {kind: problem.heard_in(excerpts) for kind, problem in whole.items()}
    found = {kind: likeliest(problem) for kind, problem in problems.items()}

    def log_posterior(kind: str) -> float:
        levels, odds = found[kind], float(np.log(kinds[kind]))
        for size, sigma in zip(levels.found, levels.sigmas, strict=True):
            if size.sensor == "latency" and not size.is_of_position:
                late, before = levels.latency[size.key] / sigma, size.median / size.spread
                ratio = np.exp(0.5 * (before**2 - late**2)) * size.spread / sigma
                odds += float(np.log(1.0 - ONE_CLOCK + ONE_CLOCK * ratio))
        return levels.log_posterior + odds

    best = max(kinds, key=log_posterior)
    for kind in kinds:  # a search may end short of the top; so each is tried from where the best one ended
        if kind != best:
            again = likeliest(problems[kind], found[best])
            found[kind] = max(found[kind], again, key=lambda levels: levels.log_posterior)
    best = max(kinds, key=log_posterior)
    return found[best] if problems[best] is whole[best] else whole[best].settled(found[best])


def are_samples_declared(recording: Recording) -> bool:
    """Whether a recording says what the samples of its IMU are: it declares their noise, or that they are means."""
    spec = recording.spec("accel")
    return spec.says_noise or spec.imu_samples != "instant"


def not_told_late(recording: Recording, levels: Levels) -> frozenset[str]:
    """Streams that may be late by no more than the IMU's own samples: what these are is not declared."""
    if are_samples_declared(recording):
        return frozenset()
    step, sigma = recording.streams["imu"].step, levels.sigma_of
    return frozenset(
        key
        for key, late in levels.latency.items()
        if ("latency", key) in sigma and abs(late) < told_late_from(step, sigma["latency", key])
    )


def fields_beforehand(recording: Recording, compass: Iron = LITTLE) -> Sequence[Field]:
    """What may be believed of a field that the recording does not declare.

    The norm is that of the readings. Dip and declination are those of the place, where there is one, as the model has
    them or beside steel; or the dip is that of the log, and north is magnetic north, or that of the first heading.
    """
    if "mag" not in recording.streams or recording.environment.magnetic_field is not None:
        return ()
    found = field_of_the_log(recording, compass.taken)
    norm, dip = float(np.linalg.norm(found)), inclination(found)
    gps = "gps" in recording.streams  # whose north is the true one
    words = "found from the log"
    if has_its_own_north(recording):
        words += "; north is that of the first heading"
    elif not gps:
        words += "; north is magnetic north"
    stds = FIELD_STD, DECLINATION_STD if gps else 0.0
    if recording.origin is None:
        return (_field(norm, dip, 0.0, stds, 1.0, words),)
    there, east = direction_at(recording.origin)
    return (
        _field(norm, there, east, DIRECTION_STD[::-1], 1.0 - BESIDE_STEEL - ELSEWHERE, "of the place"),
        _field(norm, there, east, (FIELD_STD, FIELD_STD), BESIDE_STEEL, "of the place, but beside steel"),
        _field(norm, dip, 0.0, stds, ELSEWHERE, f"{words}: not that of the place"),
    )


def _field(norm: float, dip: float, east: float, stds: tuple[float, float], prior: float, words: str) -> Field:
    """A field whose dip and declination have a 1-sigma of `stds` [rad]."""
    m_n = field_along(norm, dip, east)
    along, level = m_n / norm, np.array([-np.sin(east), np.cos(east), 0.0])
    axes = np.stack([along, np.cross(along, level), level], axis=1)
    each = np.array([FIELD_STD, stds[0], stds[1] * np.cos(dip)])
    return Field(m_n, norm**2 * (axes * each**2) @ axes.T, prior, words)
