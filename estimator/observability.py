"""What the readings of a flight say about its first state and its biases: information along the motion.

The error model is linear along a known motion (the true one of a simulation, the smoothed one of a log):

    dx(t) = Phi(t, t_0) dx(t_0) + w,   reading error = H(t) dx(t) + n,   so without w
    Lambda = sum over readings of  Phi' H' R^-1 H Phi                    (observability Gramian, time-varying)

Process noise is not left out. The flight is cut into short cells; the readings of a cell are information about the
state at its middle node, Lambda_j = sum Phi(t, t_j)' H' R^-1 H Phi(t, t_j), and between nodes the noise Q_j enters:

    forward, with the prior:    P <- (P^-1 + Lambda_j)^-1,   P <- Phi_j P Phi_j' + Q_j
    backward, without a prior:  Lambda <- Lambda_j + Phi_j' (Lambda^-1 + Q_j)^-1 Phi_j

the latter as (I + Lambda Q_j)^-1 Lambda, which needs no inverse of Lambda. What is left out is the process noise within
half a cell of a reading. Since Lambda_j is a sum over sensors, all subsets of sensors run side by side.

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

from estimator.error_dynamics import walk_rates
from estimator.error_integrals import MOVING, ErrorIntegrals, transitions
from estimator.flight_model import FlightModel
from estimator.layout import StateLayout
from sensors.arrays import BoolArray, FloatArray, IntArray
from sensors.model import SensorModel
from sensors.motion import Motion
from sensors.rotation import cos_tilt

#: Length of a cell [s]: in half of it a consumer gyroscope adds 6e-5 rad, a hundredth of a magnetometer's noise.
CELL = 0.2
#: Cells at most; a longer flight has longer cells.
MOST_CELLS = 2400
#: Readings whose information is summed at a time, to bound the memory.
BATCH = 4096
#: Instants and weights inside a cell, from 0 to 1, at which noise enters (Gauss and Legendre, exact to degree 5).
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
    cell: float | None = None,
) -> Information:
    """Linearise along a motion.

    Parameters
    ----------
    model : noise, biases and environment
    motion : the motion at instants as close as the IMU's: p_n, v_n, q_nb, f_b
    readings : by sensor, (k,) instants of its readings [s]; those outside the motion are left out
    P0 : (n, n) covariance at the first instant
    noise : (N - 1,) variance rates of accelerometer and gyroscope by interval of `motion` (`estimator.imu.ImuTable`);
        default: the model's, sigma^2 / rate
    extra : sensors that the model does not have, such as a base receiver that one thinks of adding
    cell : s; default `CELL`, longer where that were more than `MOST_CELLS`

    Neglects the process noise within half a cell, the turn of the Earth, and what declared effects change in H.
    """
    sensors = {**model.sensors, **{sensor.name: sensor for sensor in extra}}
    start, stop = float(motion.t[0]), float(motion.t[-1])
    width = max(CELL, (stop - start) / MOST_CELLS) if cell is None else cell
    t = np.linspace(start, stop, max(2, round((stop - start) / width) + 1))
    walk = walk_rates(model)
    variance = np.diag(P0) + walk * (stop - start)
    states = np.flatnonzero((np.diag(P0) > 0.0) | (walk > 0.0))
    scale = np.sqrt(np.where(np.diag(P0) > 0.0, np.diag(P0), variance))[states]
    integrals = ErrorIntegrals.along(motion)
    nodes = integrals.at(t)
    square, outer = np.ix_(states, states), np.outer(scale, scale)
    n = model.layout.n

    def kept(blocks: FloatArray, unit: FloatArray) -> FloatArray:
        return np.asarray(_padded(blocks, n)[:, square[0], square[1]] * unit)

    blocks, counts = {}, {}
    for name, instants in readings.items():
        inside = instants[(instants >= start) & (instants <= stop)]
        part = motion.at(inside)
        inside = inside[_sees(name, part)]
        whole = _of_readings(sensors[name], model.layout, motion, integrals, nodes, inside)
        blocks[name] = whole[:, square[0], square[1]] * outer
        counts[name] = len(inside)
    return Information(
        layout=model.layout, states=states, t=t, scale=scale, P0=P0[square] / outer,
        Phi=kept(transitions(nodes.rows(slice(None, -1)), nodes.rows(slice(1, None))), scale[None, :] / scale[:, None]),
        Q=_process_noise(model, motion, integrals, t, walk, noise)[:, square[0], square[1]] / outer,
        readings=blocks, counts=counts, walk=walk[states],
    )  # fmt: skip


def _sees(name: str, motion: Motion) -> BoolArray:
    """(k,) a range finder that looks at the sky has no prediction."""
    if name not in ("sonar", "laser"):
        return np.ones(len(motion), dtype=np.bool_)
    return np.asarray(cos_tilt(motion.q_nb) > 0.0)


def _padded(Phi: FloatArray, n: int) -> FloatArray:
    """(m, n, n) with ones for the states that stay."""
    full = np.tile(np.eye(n), (len(Phi), 1, 1))
    full[:, :MOVING, :MOVING] = Phi
    return full


def _of_readings(
    sensor: SensorModel,
    layout: StateLayout,
    motion: Motion,
    integrals: ErrorIntegrals,
    nodes: ErrorIntegrals,
    t: FloatArray,
) -> FloatArray:
    """(J, n, n) sum over a sensor's readings of (H Phi)' R^-1 (H Phi), each at the node that is nearest."""
    total = np.zeros((len(nodes.t), layout.n, layout.n))
    weight = np.sqrt(np.diag(sensor.R))[None, :, None]
    width = nodes.t[1] - nodes.t[0]
    for first in range(0, len(t), BATCH):
        instants = t[first : first + BATCH]
        node = np.rint((instants - nodes.t[0]) / width).astype(np.int64)
        H = np.zeros((len(instants), sensor.size, layout.n))
        for name, block in sensor.jacobian(motion.at(instants)).items():
            if layout.has(name):
                H[:, :, layout.slice(name)] = block
        H /= weight
        H[:, :, :MOVING] = H[:, :, :MOVING] @ transitions(nodes.rows(node), integrals.at(instants))
        cells, starts, place = np.unique(node, return_index=True, return_inverse=True)
        within = np.arange(len(node)) - starts[place]
        full = np.zeros((len(cells), int(within.max()) + 1, sensor.size, layout.n))  # zero where a cell has fewer
        full[place, within] = H
        rows = full.reshape(len(cells), -1, layout.n)
        total[cells] += np.swapaxes(rows, 1, 2) @ rows
    return total


def _process_noise(
    model: FlightModel,
    motion: Motion,
    integrals: ErrorIntegrals,
    t: FloatArray,
    walk: FloatArray,
    noise: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """(J - 1, n, n) Q = int Phi(t_j+1, s) diag(q) Phi(t_j+1, s)' ds over each cell."""
    n, h = model.layout.n, np.diff(t)
    rates = np.tile(walk, (len(h), 1))
    for block, sigma, measured in (
        (slice(3, 6), model.accel.sigma, None if noise is None else noise[0]),
        (slice(6, 9), model.gyro.sigma, None if noise is None else noise[1]),
    ):
        if measured is None:
            rates[:, block] = sigma**2 / model.rate
        else:
            grown = np.concatenate([[0.0], np.cumsum(measured * np.diff(motion.t))])
            rates[:, block] = (np.diff(np.interp(t, motion.t, grown)) / h)[:, None]
    if not model.translation:
        rates[:, :6] = 0.0
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
