"""Where a satellite was and what its clock showed when it sent the signal: broadcast orbits and clocks.

Times are GPS time in seconds; positions and velocities are ECEF (the frame of the broadcast orbits) at the instant of
transmission. What is *not* in them is in the catalogue of effects: `pseudorange.earth_rotation` (the Earth turns while
the signal travels), `pseudorange.relativity` (the periodic part of the satellite clock) and `pseudorange.group_delay`.
Neglected altogether: the difference between the frames of the constellations (some centimetres) and the satellite's
antenna offset (in the broadcast orbit).

Sources: IS-GPS-200N, table 20-IV and 20.3.3.3.3.1; Galileo OS SIS ICD 2.1, 5.1.1; BDS-SIS-ICD-B1I-3.0, 5.2.4.12;
GLONASS ICD 5.1, A.3.1.2; Remondi (2004), GPS Solutions 8, for the velocity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.constants import EARTH_RATE, SPEED_OF_LIGHT, WGS84_GM
from sinan.sensors.formats.rinex_navigation import Navigation, Table
from sinan.sensors.formats.rinex_observation import TextArray
from sinan.sensors.formats.rinex_text import WEEK

GM: Mapping[str, float] = {  # m^3/s^2, of the orbit model of each system
    "G": WGS84_GM,
    "J": WGS84_GM,
    "E": 3.986004418e14,  # Galileo OS SIS ICD 2.1, table 67
    "C": 3.986004418e14,  # BDS-SIS-ICD-B1I-3.0, 3.2
    "I": WGS84_GM,
}
RATE: Mapping[str, float] = {"G": EARTH_RATE, "J": EARTH_RATE, "E": EARTH_RATE, "C": 7.2921150e-5, "I": EARTH_RATE}
#: Largest time between an instant and the reference time of its orbit [s]: half the fit interval with some slack.
LONGEST_AGE: Mapping[str, float] = {"G": 7201.0, "J": 7201.0, "E": 14400.0, "C": 21601.0, "I": 7201.0, "R": 1801.0}
LEAST_ACCURATE = 300.0  # m: an orbit that promises less than this promises nothing
#: Galileo accuracy is a negative number where the satellite gives no accuracy prediction
INAV_CLOCK = 1 << 9  # bit of Galileo's data source: clock for E5b and E1 (RINEX 3.04, table A8)
GEOSTATIONARY_TILT = np.deg2rad(-5.0)  # BDS-SIS-ICD-B1I-3.0, table 5-11
PZ90_GM = 3.986004418e14  # m^3/s^2, PZ-90.11
PZ90_A = 6378136.0  # m
PZ90_J2 = 1.0826257e-3  # 1
PZ90_RATE = 7.2921151467e-5  # rad/s
RUNGE_KUTTA_STEP = 60.0  # s; over half an hour its error stays below a centimetre

OK, ABSENT, STALE, UNHEALTHY = 0, 1, 2, 3
STATUS = ("used", "no navigation message", "navigation message too old", "flagged unhealthy")


@dataclass(frozen=True)
class SatelliteStates:
    """Satellites at the instants of transmission, one row a pseudorange.

    Attributes
    ----------
    status : (n,) OK, ABSENT, STALE or UNHEALTHY; the other rows are NaN unless OK
    position, velocity : (n, 3) ECEF [m], [m/s]
    clock : (n,) satellite clock minus system time from the clock polynomial [s]: `dt_sat` of the pseudorange equation
    group_delay : (n,) T_GD, BGD (E5b or E5a against E1) or T_GD1 [s]; zero for GLONASS
    accuracy : (n,) broadcast accuracy of the range (URA, SISA) [m]
    channel : (n,) GLONASS frequency number, zero for the others
    age : (n,) instant minus reference time of the orbit [s]; also where STALE
    message : (n,) row of the navigation table (`kepler`, or `glonass` for GLONASS) that was used, -1 unless OK
    """

    status: IntArray
    position: FloatArray
    velocity: FloatArray
    clock: FloatArray
    group_delay: FloatArray
    accuracy: FloatArray
    channel: FloatArray
    age: FloatArray
    message: IntArray


def satellite_states(
    navigation: Navigation,
    satellite: TextArray,
    week: int,
    t: FloatArray,
    pseudorange: FloatArray,
    message: IntArray | None = None,
) -> SatelliteStates:
    """States of the satellites when they sent what arrived.

    t_tx = t - P / c - dt_sat: the pseudorange P takes the receiver's clock error out of its own time tag t.

    Parameters
    ----------
    navigation : broadcast messages
    satellite : (n,) names
    week, t : GPS week, and (n,) the receiver's time tags from its start [s]
    pseudorange : (n,) [m]
    message : (n,) rows of the navigation tables to use; the nearest healthy ones if not given
    """
    n = len(satellite)
    sent = t - pseudorange / SPEED_OF_LIGHT
    status = np.full(n, ABSENT)
    values = np.full((n, 9), np.nan)
    age = np.full(n, np.nan)
    channel = np.zeros(n)
    taken = np.full(n, -1)
    for kind, table in (("kepler", navigation.kepler), ("glonass", navigation.glonass)):
        mine = np.flatnonzero((satellite.astype("<U1") == "R") == (kind == "glonass"))
        if not len(mine) or not len(table):
            continue
        reference = table["toe" if kind == "kepler" else "time"]
        if message is None:
            taken[mine], status[mine], age[mine] = choose(table, reference - week * WEEK, satellite[mine], sent[mine])
        else:
            taken[mine], status[mine] = message[mine], OK
            age[mine] = sent[mine] + week * WEEK - reference[message[mine]]
        rows = mine[taken[mine] >= 0]
        messages = table[taken[rows]]
        if kind == "kepler":
            values[rows] = kepler_rows(messages, week, sent[rows])
        else:
            values[rows] = glonass_rows(messages, week, sent[rows])
            channel[rows] = messages["channel"]
    values[status != OK] = np.nan
    return SatelliteStates(
        status, values[:, :3], values[:, 3:6], values[:, 6], values[:, 7], values[:, 8], channel, age, taken
    )


def choose(
    table: Table, reference: FloatArray, satellite: TextArray, t: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """The message whose reference time is nearest to each instant.

    Parameters
    ----------
    table : messages of any satellites
    reference : (messages,) reference times, on the clock of t
    satellite, t : (n,)

    Returns
    -------
    index : (n,) into the table, -1 where none can be used
    status : (n,)
    age : (n,) instant minus reference time [s], NaN where the satellite has no message
    """
    index = np.full(len(satellite), -1)
    status = np.full(len(satellite), ABSENT)
    age = np.full(len(satellite), np.nan)
    usable = preferred(table)
    healthy = is_healthy(table)
    for name in np.unique(satellite).tolist():
        rows = np.flatnonzero(satellite == name)
        messages = np.flatnonzero((table["satellite"] == name) & usable)
        if not len(messages):
            continue
        messages = messages[np.argsort(reference[messages], kind="stable")]
        times = reference[messages]
        after = np.clip(np.searchsorted(times, t[rows]), 1, max(len(times) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(times) - 1)
        nearest = np.where(np.abs(t[rows] - times[before]) <= np.abs(times[after] - t[rows]), before, after)
        age[rows] = t[rows] - times[nearest]
        index[rows] = messages[nearest]
        stale = np.abs(age[rows]) > LONGEST_AGE[name[0]]
        status[rows] = np.where(stale, STALE, np.where(healthy[messages[nearest]], OK, UNHEALTHY))
    return np.where(status == OK, index, -1), status, age


def preferred(table: Table) -> BoolArray:
    """Messages whose clock fits single-frequency work: Galileo I/NAV, or all where a satellite has no I/NAV."""
    if "source" not in (table.dtype.names or ()):
        return np.ones(len(table), dtype=bool)
    galileo = table["satellite"].astype("<U1") == "E"
    inav = (table["source"].astype(np.int64) & INAV_CLOCK) != 0
    without = ~np.isin(table["satellite"], np.unique(table["satellite"][inav]))
    return np.asarray(~galileo | inav | without)


def is_healthy(table: Table) -> BoolArray:
    """Messages that call their satellite healthy and promise an accuracy.

    QZSS: all but the last bit, which stands for another signal. NaN health counts as healthy.
    """
    health = np.nan_to_num(table["health"]).astype(np.int64)
    health = np.where(table["satellite"].astype("<U1") == "J", health & ~1, health)
    if "accuracy" not in (table.dtype.names or ()):
        return np.asarray(health == 0)
    promised = np.nan_to_num(table["accuracy"])
    return np.asarray((health == 0) & (promised >= 0.0) & (promised <= LEAST_ACCURATE))


def kepler_rows(message: Table, week: int, sent: FloatArray) -> FloatArray:
    """(n, 9) position, velocity, clock, group delay and accuracy from Kepler messages, one a row.

    `sent` is the satellite clock's time of transmission; the satellite's own clock error is taken out of it.
    """
    since = sent - (message["toc"] - week * WEEK)
    clock = message["af0"] + message["af1"] * since + message["af2"] * since**2
    since = since - clock
    clock = message["af0"] + message["af1"] * since + message["af2"] * since**2
    position, velocity = kepler_orbit(message, sent - clock - (message["toe"] - week * WEEK))
    use_inav = (message["source"].astype(np.int64) & INAV_CLOCK) != 0
    galileo = message["satellite"].astype("<U1") == "E"
    group_delay = np.where(galileo & use_inav, message["group_delay_2"], message["group_delay"])
    return np.column_stack([position, velocity, clock, group_delay, np.nan_to_num(message["accuracy"])])


def kepler_orbit(message: Table, t_k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position and velocity from Kepler elements with harmonic corrections (IS-GPS-200N, table 20-IV).

    Parameters
    ----------
    message : (n,) rows of `KEPLER`
    t_k : (n,) time from `toe` [s]

    Returns
    -------
    (n, 3) ECEF [m] and (n, 3) its time derivative in ECEF [m/s]
    """
    system = message["satellite"].astype("<U1")
    names = system.tolist()
    gm = np.array([GM.get(name, WGS84_GM) for name in names])
    rate = np.array([RATE.get(name, EARTH_RATE) for name in names])
    e = message["e"]
    a = message["sqrt_a"] ** 2
    n = np.sqrt(gm / a**3) + message["delta_n"]
    E, E_dot = eccentric_anomaly(message["m0"] + n * t_k, n, e)
    nu = np.arctan2(np.sqrt(1.0 - e**2) * np.sin(E), np.cos(E) - e)
    nu_dot = E_dot * np.sqrt(1.0 - e**2) / (1.0 - e * np.cos(E))
    phi = nu + message["omega"]
    sin_2, cos_2 = np.sin(2.0 * phi), np.cos(2.0 * phi)
    u = phi + message["cus"] * sin_2 + message["cuc"] * cos_2
    u_dot = nu_dot * (1.0 + 2.0 * (message["cus"] * cos_2 - message["cuc"] * sin_2))
    r = a * (1.0 - e * np.cos(E)) + message["crs"] * sin_2 + message["crc"] * cos_2
    r_dot = a * e * np.sin(E) * E_dot + 2.0 * nu_dot * (message["crs"] * cos_2 - message["crc"] * sin_2)
    i = message["i0"] + message["i_dot"] * t_k + message["cis"] * sin_2 + message["cic"] * cos_2
    i_dot = message["i_dot"] + 2.0 * nu_dot * (message["cis"] * cos_2 - message["cic"] * sin_2)
    geo = is_geostationary(message["satellite"])
    turn = np.where(geo, 0.0, rate)  # geostationary BeiDou elements are in a frame that does not turn with the Earth
    node = message["omega0"] + (message["omega_dot"] - turn) * t_k - rate * (message["toe"] % WEEK - bdt(system))
    node_dot = message["omega_dot"] - turn
    position, velocity = out_of_plane(r, r_dot, u, u_dot, i, i_dot, node, node_dot)
    if geo.any():
        position[geo], velocity[geo] = geostationary(position[geo], velocity[geo], rate[geo], t_k[geo])
    return position, velocity


def bdt(system: TextArray) -> FloatArray:
    """(n,) GPS time minus the system's time [s]: the node is given for the start of the system's own week."""
    return np.where(system == "C", 14.0, 0.0)


def eccentric_anomaly(M: FloatArray, n: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve Kepler's equation M = E - e sin E by Newton's method; also dE/dt."""
    E = M + e * np.sin(M)
    for _ in range(20):
        step = (E - e * np.sin(E) - M) / (1.0 - e * np.cos(E))
        E = E - step
        if not np.any(np.abs(step) > 1e-14):
            break
    return E, n / (1.0 - e * np.cos(E))


def out_of_plane(
    r: FloatArray,
    r_dot: FloatArray,
    u: FloatArray,
    u_dot: FloatArray,
    i: FloatArray,
    i_dot: FloatArray,
    node: FloatArray,
    node_dot: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """From radius and argument of latitude in the orbital plane to three axes: Rz(node) Rx(i)."""
    x, y = r * np.cos(u), r * np.sin(u)
    x_dot = r_dot * np.cos(u) - y * u_dot
    y_dot = r_dot * np.sin(u) + x * u_dot
    sin_n, cos_n, sin_i, cos_i = np.sin(node), np.cos(node), np.sin(i), np.cos(i)
    position = np.stack([x * cos_n - y * cos_i * sin_n, x * sin_n + y * cos_i * cos_n, y * sin_i], axis=-1)
    velocity = np.stack(
        [
            x_dot * cos_n - y_dot * cos_i * sin_n + y * sin_i * sin_n * i_dot - position[:, 1] * node_dot,
            x_dot * sin_n + y_dot * cos_i * cos_n - y * sin_i * cos_n * i_dot + position[:, 0] * node_dot,
            y_dot * sin_i + y * cos_i * i_dot,
        ],
        axis=-1,
    )
    return position, velocity


def is_geostationary(satellite: TextArray) -> BoolArray:
    """BeiDou satellites whose orbits are given in the geostationary way: C01 to C05 and C59 to C63."""
    return np.isin(satellite, ["C01", "C02", "C03", "C04", "C05", "C59", "C60", "C61", "C62", "C63"])


def geostationary(
    position: FloatArray, velocity: FloatArray, rate: FloatArray, t_k: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """p = Rz(w t_k) Rx(-5 deg) p_g (BDS-SIS-ICD-B1I-3.0, 5.2.4.12), with R the rotation of the axes."""
    s, c = np.sin(GEOSTATIONARY_TILT), np.cos(GEOSTATIONARY_TILT)
    R_x = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    p, v = position @ R_x.T, velocity @ R_x.T
    sin_t, cos_t = np.sin(rate * t_k), np.cos(rate * t_k)
    zero, one = np.zeros_like(sin_t), np.ones_like(sin_t)
    R_z = np.array([[cos_t, sin_t, zero], [-sin_t, cos_t, zero], [zero, zero, one]]).transpose(2, 0, 1)
    turned = np.einsum("nij,nj->ni", R_z, p)
    spin = np.stack([turned[:, 1], -turned[:, 0], zero], axis=-1) * rate[:, None]
    return turned, np.einsum("nij,nj->ni", R_z, v) + spin


def glonass_rows(message: Table, week: int, sent: FloatArray) -> FloatArray:
    """(n, 9) position, velocity, clock, group delay and accuracy from GLONASS state vectors, one a row."""
    since = sent - (message["time"] - week * WEEK)
    clock = -message["tau"] + message["gamma"] * since
    clock = -message["tau"] + message["gamma"] * (since - clock)
    state = np.stack([message[name] for name in ("x", "y", "z", "vx", "vy", "vz")], axis=-1)
    moon_and_sun = np.stack([message[name] for name in ("ax", "ay", "az")], axis=-1)
    state = runge_kutta(state, moon_and_sun, since - clock)
    return np.column_stack([state, clock, np.zeros(len(state)), np.full(len(state), 5.0)])


def runge_kutta(state: FloatArray, moon_and_sun: FloatArray, duration: FloatArray) -> FloatArray:
    """Integrate (n, 6) state vectors over (n,) durations [s], all at once, each in its own equal steps."""
    if not len(state):
        return state
    steps = max(1, int(np.ceil(np.max(np.abs(duration)) / RUNGE_KUTTA_STEP)))
    h = (duration / steps)[:, None]
    for _ in range(steps):
        k1 = glonass_motion(state, moon_and_sun)
        k2 = glonass_motion(state + 0.5 * h * k1, moon_and_sun)
        k3 = glonass_motion(state + 0.5 * h * k2, moon_and_sun)
        k4 = glonass_motion(state + h * k3, moon_and_sun)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def glonass_motion(state: FloatArray, moon_and_sun: FloatArray) -> FloatArray:
    """(n, 6) d state / dt in PZ-90, which turns with the Earth (GLONASS ICD 5.1, A.3.1.2)."""
    p, v = state[:, :3], state[:, 3:]
    r2 = np.sum(p**2, axis=1, keepdims=True)
    z2 = 5.0 * p[:, 2:] ** 2 / r2
    central = -PZ90_GM / r2**1.5 * p
    flattening = -1.5 * PZ90_J2 * PZ90_GM * PZ90_A**2 / r2**2.5 * p * np.concatenate([1 - z2, 1 - z2, 3 - z2], axis=1)
    centrifugal = PZ90_RATE**2 * p * np.array([1.0, 1.0, 0.0])
    coriolis = 2.0 * PZ90_RATE * np.stack([v[:, 1], -v[:, 0], np.zeros(len(v))], axis=-1)
    return np.concatenate([v, central + flattening + centrifugal + coriolis + moon_and_sun], axis=1)
