"""What the readings of a flight say about its first state and its biases: information along the motion.

The error model is linear along a known motion (the true one of a simulation, the smoothed one of a log):

    dx(t) = Phi(t, t_0) dx(t_0) + w,   reading error = H(t) dx(t) + n,   so without w
    Lambda = sum over readings of  Phi' H' R^-1 H Phi                    (observability Gramian, time-varying)

Process noise is not left out. The flight is cut into short cells; the readings of a cell are information about the
state at its middle node, Lambda_j = sum Phi(t, t_j)' H' R^-1 H Phi(t, t_j), and between nodes the noise Q_j enters:

    forward, with the prior:    P <- (P^-1 + Lambda_j)^-1,   P <- Phi_j P Phi_j' + Q_j
    backward, without a prior:  Lambda <- Lambda_j + Phi_j' (Lambda^-1 + Q_j)^-1 Phi_j

the latter as (I + Lambda Q_j)^-1 Lambda, which needs no inverse of Lambda. The process noise between a reading and its
node counts as noise of the reading; that readings of one cell share it is left out, so cells are as short as it takes
to keep it small. Since Lambda_j is a sum over sensors, all subsets of sensors run side by side.

All matrices are in units of `scale`, the prior sigmas: an eigenvalue s of the backward Lambda says that the readings
know that direction of the first state s times as well as the prior does; they leave 1 / sqrt(1 + s) of its sigma.

Source: P. S. Maybeck, Stochastic Models, Estimation, and Control, vol. 1, 1979, section 5.7 (inverse covariance form);
D. Goshen-Meskin, I. Y. Bar-Itzhack, "Observability analysis of piece-wise constant systems", IEEE Trans. AES 28(4),
1992 (why one frozen pair F, H does not do).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinan.estimator.evidence.error_integrals import MOVING, ErrorIntegrals, transitions
from sinan.estimator.filter.error_dynamics import bias_rates
from sinan.estimator.filter.flight_model import FlightModel
from sinan.estimator.filter.layout import DP, DV, StateLayout, size_of
from sinan.sensors.arrays import BoolArray, FloatArray, IntArray
from sinan.sensors.model import SensorModel
from sinan.sensors.motion import Motion
from sinan.sensors.recording import NO_HEIGHT

#: Length of a cell [s]: in half of it a consumer gyroscope adds 2e-4 sqrt(0.1) = 6e-5 rad, a hundredth of a
#: magnetometer's noise.
CELL = 0.2
#: Cells at most, as a longer flight has longer ones: bound of work (`bounds_of_work observability`).
MOST_CELLS = 4800
#: Cells are halved until the process noise in half of one is at most this share of the variance of a reading:
#: bound of work (`bounds_of_work observability`).
SHARED = 0.1
#: Process noise below this share of a reading's variance is not added to it: sigma is off by sqrt(1 + 0.001), half of
#: it.
SMALL = 1e-3
#: Instants at which a flight is asked how much of its process noise its sensors see: bound of work (`bounds_of_work
#: observability`).
PROBES = 9
#: Readings whose information is summed at a time: bound of work (`bounds_of_work observability`).
BATCH = 4096
#: Instants and weights inside a cell, from 0 to 1, at which noise enters: of Gauss and Legendre, 2 * 3 - 1 = 5 degrees
#: without an error.
_NOISE_AT = ((0.5 - np.sqrt(0.15), 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.5 + np.sqrt(0.15), 5.0 / 18.0))


@dataclass(frozen=True)
class Information:
    """Information of every sensor about the nodes of a flight, and how the nodes hang together, in units of `scale`.

    Attributes
    ----------
    layout : of all states; `states` (n,) those that are uncertain at all, indices into it
    t : (J,) nodes [s]
    scale : (n,) prior sigma of each state [its unit]
    P0 : (n, n) prior
    Phi, Q : (J - 1, n, n) from node to node
    readings : by sensor, (J, n, n) information of the readings around each node
    counts : by sensor, number of readings
    walk : (n,) growth of each state's own random walk [unit^2/s]
    """

    layout: StateLayout
    states: IntArray
    t: FloatArray
    scale: FloatArray
    P0: FloatArray
    Phi: FloatArray
    Q: FloatArray
    readings: Mapping[str, FloatArray]
    counts: Mapping[str, int]
    walk: FloatArray

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the states that are kept, as `StateLayout.labels` has them."""
        return tuple(self.layout.labels[i] for i in self.states)

    def index(self, label: str) -> int:
        """Row of a state.

        Raises
        ------
        KeyError : the state is not there, or nothing about it is uncertain
        """
        if label not in self.labels:
            raise KeyError(f"no uncertain state `{label}`; there are {', '.join(self.labels)}")
        return self.labels.index(label)

    def carried_prior(self, t: FloatArray) -> FloatArray:
        """(m, n) prior sigma, grown by each state's own random walk until t: all that is known without a reading."""
        return np.asarray(np.sqrt((np.diag(self.P0) * self.scale**2) + np.outer(t - self.t[0], self.walk)))


@dataclass(frozen=True)
class Course:
    """Posterior along the flight for several subsets of sensors.

    Attributes
    ----------
    t : (J + 1,) s; the first row is the prior, the others follow the readings around each node
    sigma : (subsets, J + 1, n) [unit of each state]
    P_end : (subsets, n, n) [units of the states]
    """

    t: FloatArray
    sigma: FloatArray
    P_end: FloatArray

    def row_at(self, t: float) -> int:
        """The row that holds at an instant; 0, the prior, at the start."""
        return int(np.searchsorted(self.t[1:], t + 1e-9 * (1.0 + abs(t)), side="right")) if t > self.t[0] else 0


def information(
    model: FlightModel,
    motion: Motion,
    readings: Mapping[str, FloatArray],
    P0: FloatArray,
    *,
    noise: tuple[FloatArray, FloatArray] | None = None,
    extra: Sequence[SensorModel] = (),
    told: Mapping[str, BoolArray] | None = None,
    cell: float | None = None,
) -> Information:
    """Linearise along a motion.

    Parameters
    ----------
    model : noise, biases and environment
    motion : the motion at instants as close as the IMU's: p_n, v_n, q_nb, f_b
    readings : by sensor, (k,) instants of its readings [s]; those outside the motion are left out
    P0 : (n, n) covariance at the first instant
    noise : (N - 1,) variance rates of accelerometer and gyroscope by interval of `motion`
        (`estimator.filter.imu.ImuTable`); default: the model's, sigma^2 / rate
    extra : sensors that the model does not have, such as a base receiver that one thinks of adding
    told : by sensor, (k, m) which components of its readings are readings at all; default: all
    cell : s; default `CELL`, shorter where the process noise asks for it, longer where that were over `MOST_CELLS`

    Neglects that readings of one cell share process noise, the Earth's turn, what declared effects change in H, and
    what is a state for the sake of others (`is_nuisance`): its sigmas are least ones where a model has these.
    """
    sensors = {**model.sensors, **{sensor.name: sensor for sensor in extra}}
    start, stop = float(motion.t[0]), float(motion.t[-1])
    walk, _ = bias_rates(model)
    grown = _grown_noise(model, motion, noise)
    if cell is None:
        cell = _cell_length(model, motion, {name: sensors[name] for name in readings}, walk, grown)
    t = np.linspace(start, stop, max(2, round((stop - start) / cell) + 1))
    rates = _noise_rates(model, motion, t, walk, grown)
    variance = np.diag(P0) + walk * (stop - start)
    asked = np.concatenate([np.full(size_of(name), not is_nuisance(name)) for name in model.layout.names])
    states = np.flatnonzero(asked & ((np.diag(P0) > 0.0) | (walk > 0.0)))
    scale = np.sqrt(np.where(np.diag(P0) > 0.0, np.diag(P0), variance))[states]
    integrals = ErrorIntegrals.along(motion)
    nodes = integrals.at(t)
    square, outer = np.ix_(states, states), np.outer(scale, scale)
    Phi = _padded(transitions(nodes.rows(slice(None, -1)), nodes.rows(slice(1, None))), model.layout.n)
    blocks, counts = {}, {}
    for name, instants in readings.items():
        seen = (instants >= start) & (instants <= stop)
        seen[seen] = _sees(sensors[name], motion.at(instants[seen]))
        inside, R = instants[seen], np.tile(np.diag(sensors[name].R), (int(np.sum(seen)), 1))
        if told is not None and name in told:
            R[~told[name][seen]] = NO_HEIGHT**2
        whole = _of_readings(sensors[name], model.layout, motion, integrals, nodes, rates, inside, R)
        blocks[name] = whole[:, square[0], square[1]] * outer
        counts[name] = len(inside)
    return Information(
        layout=model.layout, states=states, t=t, scale=scale, P0=P0[square] / outer,
        Phi=Phi[:, square[0], square[1]] * (scale[None, :] / scale[:, None]),
        Q=_process_noise(integrals, t, rates)[:, square[0], square[1]] / outer,
        readings=blocks, counts=counts, walk=walk[states],
    )  # fmt: skip


def is_nuisance(block: str) -> bool:
    """Whether a block is a state for the sake of others: the colour of readings, the errors of the field and of the
    axes of gyroscope and compass.
    """
    return block.startswith("c_") or block in ("s_gyro", "s_mag", "field")


def _sees(sensor: SensorModel, motion: Motion) -> BoolArray:
    """(k,) a range finder of which a beam looks at the sky has no prediction."""
    return np.asarray(np.all(np.isfinite(sensor.predict(motion)), axis=1))


def _padded(Phi: FloatArray, n: int) -> FloatArray:
    """(m, n, n) with ones for the states that stay."""
    full = np.tile(np.eye(n), (len(Phi), 1, 1))
    full[:, :MOVING, :MOVING] = Phi
    return full


def _jacobian(sensor: SensorModel, layout: StateLayout, motion: Motion) -> FloatArray:
    """(k, m, n) H of a sensor along a motion."""
    H = np.zeros((len(motion), sensor.size, layout.n))
    for name, block in sensor.jacobian(motion).items():
        if layout.has(name):
            H[:, :, layout.slice(name)] = block
    return H


def _noise_since(H: FloatArray, rates: FloatArray, h: FloatArray) -> FloatArray:
    """(k, m, m) H Q(h) H' of the process noise over a short time h (k,), with the spectral densities `rates` (k, n).

    Q = q_v [h^3 / 3, h^2 / 2; h^2 / 2, h] on position and velocity, q h on every other state; what the attitude's noise
    does to the velocity within h is left out.
    """
    p, v = DP, DV
    q, h1 = rates[:, None, v], h[:, None, None]
    moved = (H * (rates * h[:, None])[:, None, :]) @ np.swapaxes(H, 1, 2)
    crossed = (H[:, :, p] * (0.5 * q * h1**2)) @ np.swapaxes(H[:, :, v], 1, 2)
    placed = (H[:, :, p] * (q * h1**3 / 3.0)) @ np.swapaxes(H[:, :, p], 1, 2)
    return np.asarray(moved + placed + crossed + np.swapaxes(crossed, 1, 2))


def _of_readings(
    sensor: SensorModel,
    layout: StateLayout,
    motion: Motion,
    integrals: ErrorIntegrals,
    nodes: ErrorIntegrals,
    rates: FloatArray,
    t: FloatArray,
    variance: FloatArray,
) -> FloatArray:
    """(J, n, n) sum over a sensor's readings of (H Phi)' R^-1 (H Phi), each at the node that is nearest."""
    total = np.zeros((len(nodes.t), layout.n, layout.n))
    width = nodes.t[1] - nodes.t[0]
    for first in range(0, len(t), BATCH):
        instants, R = t[first : first + BATCH], variance[first : first + BATCH]
        node = np.rint((instants - nodes.t[0]) / width).astype(np.int64)
        H = _jacobian(sensor, layout, motion.at(instants))
        cell = np.minimum((instants - nodes.t[0]) // width, len(rates) - 1).astype(np.int64)
        late = _noise_since(H, rates[cell], np.abs(instants - nodes.t[node]))
        H[:, :, :MOVING] = H[:, :, :MOVING] @ transitions(nodes.rows(node), integrals.at(instants))
        if np.any(np.diagonal(late, axis1=1, axis2=2) > SMALL * R):
            H = np.linalg.solve(np.linalg.cholesky(late + R[:, :, None] * np.eye(sensor.size)), H)
        else:
            H /= np.sqrt(R)[:, :, None]
        cells, starts, place = np.unique(node, return_index=True, return_inverse=True)
        within = np.arange(len(node)) - starts[place]
        full = np.zeros((len(cells), int(within.max()) + 1, sensor.size, layout.n))  # zero where a cell has fewer
        full[place, within] = H
        rows = full.reshape(len(cells), -1, layout.n)
        total[cells] += np.swapaxes(rows, 1, 2) @ rows
    return total


def _grown_noise(
    model: FlightModel, motion: Motion, noise: tuple[FloatArray, FloatArray] | None
) -> tuple[FloatArray, FloatArray]:
    """(N,) integrals of the variance rates of accelerometer and gyroscope from the first instant on."""
    h = np.diff(motion.t)
    declared = (np.full(len(h), model.accel.sigma**2 / model.rate), np.full(len(h), model.gyro.sigma**2 / model.rate))
    accel, gyro = (np.concatenate([[0.0], np.cumsum(q * h)]) for q in (declared if noise is None else noise))
    return accel if model.translation else np.zeros_like(accel), gyro


def _noise_rates(
    model: FlightModel, motion: Motion, t: FloatArray, walk: FloatArray, grown: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """(J - 1, n) spectral densities of the process noise in every cell."""
    rates = np.tile(walk, (len(t) - 1, 1))
    for block, integral in zip(("velocity", "attitude"), grown, strict=True):
        mean = np.diff(np.interp(t, motion.t, integral)) / np.diff(t)
        rates[:, model.layout.slice(block)] = mean[:, None]
    return rates


def _cell_length(
    model: FlightModel,
    motion: Motion,
    sensors: Mapping[str, SensorModel],
    walk: FloatArray,
    grown: tuple[FloatArray, FloatArray],
) -> float:
    """The longest cell, halved from `CELL`, that keeps the process noise in it below every reading's own."""
    span = float(motion.t[-1] - motion.t[0])
    least = span / MOST_CELLS
    edges = np.linspace(motion.t[0], motion.t[-1], PROBES + 1)
    rates = np.median(_noise_rates(model, motion, edges, walk, grown), axis=0)
    probes = motion.at(0.5 * (edges[:-1] + edges[1:]))
    seen = []
    for sensor in sensors.values():
        here = probes.rows(_sees(sensor, probes))
        seen.append((_jacobian(sensor, model.layout, here), np.diag(sensor.R)))
    cell = max(CELL, least)
    while cell > 2.0 * least:
        shares = []
        for H, R in seen:
            late = _noise_since(H, np.tile(rates, (len(H), 1)), np.full(len(H), 0.5 * cell))
            shares.append(float(np.max(np.diagonal(late, axis1=1, axis2=2) / R, initial=0.0)))
        if max(shares, default=0.0) <= SHARED:
            break
        cell *= 0.5
    return cell


def _process_noise(integrals: ErrorIntegrals, t: FloatArray, rates: FloatArray) -> FloatArray:
    """(J - 1, n, n) Q = int Phi(t_j+1, s) diag(rates) Phi(t_j+1, s)' ds over each cell."""
    n, h = rates.shape[1], np.diff(t)
    stop, Q = integrals.at(t[1:]), np.zeros((len(h), n, n))
    for place, weight in _NOISE_AT:
        Phi = _padded(transitions(integrals.at(t[:-1] + place * h), stop), n)
        Q += (weight * h)[:, None, None] * ((Phi * rates[:, None, :]) @ np.swapaxes(Phi, 1, 2))
    return Q


def posterior(found: Information, subsets: Sequence[Sequence[str]]) -> Course:
    """Run forward with the prior: sigma of every state over time, for each subset of sensors.

    Parameters
    ----------
    found : from `information`
    subsets : names of sensors in `found.readings`; an empty one is the prior alone, carried along
    """
    n, J = len(found.scale), len(found.t)
    P: FloatArray = np.tile(found.P0, (len(subsets), 1, 1))
    sigma = np.zeros((len(subsets), J + 1, n))
    sigma[:, 0] = np.sqrt(np.diag(found.P0))
    (used, stack), eye = _by_node(found, subsets), np.eye(n)
    for j in range(J):
        if j:
            P = found.Phi[j - 1] @ P @ found.Phi[j - 1].T + found.Q[j - 1]
        updated = np.linalg.solve(eye + P @ np.tensordot(used, stack[j], axes=1), P)
        P = np.asarray(0.5 * (updated + np.swapaxes(updated, 1, 2)))
        sigma[:, j + 1] = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0))
    return Course(np.concatenate([found.t[:1], found.t]), sigma * found.scale, P * np.outer(found.scale, found.scale))


def first_state_information(found: Information, subsets: Sequence[Sequence[str]]) -> FloatArray:
    """(subsets, n, n) what the readings alone, without a prior, say about the first state, in units of `scale`."""
    n, J = len(found.scale), len(found.t)
    (used, stack), eye = _by_node(found, subsets), np.eye(n)
    Lambda = np.zeros((len(subsets), n, n))
    for j in range(J - 1, -1, -1):
        if j < J - 1:
            Lambda = found.Phi[j].T @ np.linalg.solve(eye + Lambda @ found.Q[j], Lambda) @ found.Phi[j]
        Lambda = Lambda + np.tensordot(used, stack[j], axes=1)
        Lambda = np.asarray(0.5 * (Lambda + np.swapaxes(Lambda, 1, 2)))
    return Lambda


def _by_node(found: Information, subsets: Sequence[Sequence[str]]) -> tuple[FloatArray, FloatArray]:
    """(subsets, sensors) one where a sensor is used, and (J, sensors, n, n) what each says about each node.

    Raises
    ------
    KeyError : a sensor without readings here
    """
    for name in {name for subset in subsets for name in subset}:
        if name not in found.readings:
            raise KeyError(f"no sensor `{name}`; there are {', '.join(found.readings)}")
    used = np.array([[float(name in subset) for name in found.readings] for subset in subsets])
    if not found.readings:
        return used, np.zeros((len(found.t), 0, len(found.scale), len(found.scale)))
    return used, np.stack(list(found.readings.values()), axis=1)
