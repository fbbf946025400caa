"""A vehicle that speaks MAVLink on loopback, in a process of its own: `python mavlink_vehicle.py PLAN.json`.

It answers PARAM_REQUEST_READ, PARAM_SET and SET_MESSAGE_INTERVAL as ArduPilot and PX4 do, and corrects what its
sensors read by its parameters, as they document it (ArduPilot: f = (raw - OFFS) SCAL, field = D (raw + OFS); PX4:
(raw - OFF) SCALE). What the sensors read is the truth with a scale and an offset that only the plan knows. The plan
says what is shown, how the link is disturbed, and how long all of it may take.
"""

from __future__ import annotations

import json
import math
import random
import select
import socket
import sys
import time
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

G = 9.80665
FIELD = (0.22, 0.02, 0.44)  # gauss, NED
ARDUPILOT, PX4 = 3, 12


def attitude(roll: float, pitch: float, yaw: float) -> list[list[float]]:
    """Body to NED, angles in deg."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (roll, pitch, yaw))
    return [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]


def seen(C: list[list[float]], v_n: tuple[float, ...]) -> list[float]:
    """A vector of NED in the body."""
    return [sum(C[i][k] * v_n[i] for i in range(3)) for k in range(3)]


class Way:
    """Datagrams to where a capture listens, or a place to which it connects; with what disturbs it."""

    def __init__(self, plan: dict[str, Any]) -> None:
        self.udp = plan["link"] == "udp"
        self.place = ("127.0.0.1", plan["port"])
        self.loss, self.random = plan.get("loss", 0.0), random.Random(plan.get("seed", 1))
        self.held: list[bytes] = []
        self.peer: socket.socket | None = None
        if self.udp:
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        else:
            self.socket = socket.create_server(self.place)
        self.socket.setblocking(False)

    def send(self, frame: bytes, hold: bool) -> None:
        if self.random.random() < self.loss:
            return
        self.held.append(frame)
        if not hold:
            frames, self.held = self.held, []
            for one in frames:
                self._put(one)

    def _put(self, frame: bytes) -> None:
        try:
            if self.udp:
                self.socket.sendto(frame, self.place)
            elif self.peer is not None:
                self.peer.sendall(frame)
        except OSError:
            self.drop()

    def drop(self) -> None:
        """The connection is gone."""
        if self.peer is not None:
            self.peer.close()
            self.peer = None

    def receive(self, wait: float) -> bytes:
        """What has come."""
        ready, _, _ = select.select([self.socket, *([self.peer] if self.peer else [])], [], [], max(wait, 0.0))
        try:
            if self.udp:
                return self.socket.recvfrom(65536)[0] if ready else b""
            if self.socket in ready:
                self.drop()
                self.peer, _ = self.socket.accept()
            elif self.peer in ready and self.peer is not None:
                data = self.peer.recv(65536)
                if not data:
                    self.drop()
                return data
        except OSError:
            self.drop() if not self.udp else None
        return b""


class Simulated:
    """An autopilot with an IMU and a compass."""

    def __init__(self, plan: dict[str, Any]) -> None:
        self.plan, self.way = plan, Way(plan)
        self.link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.link.robust_parsing = True
        self.parameters: dict[str, float] = dict(plan.get("parameters", {}))
        self.rates = {"HEARTBEAT": 4.0}
        self.next: dict[str, float] = {}
        self.begun = time.monotonic()
        self.noise = random.Random(5)
        self.shown_since: float | None = None
        self.asked: float | None = None
        self.jumps = list(plan.get("clock", []))
        self.clock = plan.get("boot", 100.0)  # own clock at the beginning
        self.autopilot = {"ardupilot": ARDUPILOT, "px4": PX4}[plan.get("autopilot", "ardupilot")]

    @property
    def elapsed(self) -> float:
        return time.monotonic() - self.begun

    @property
    def known_for(self) -> float:
        """Since it was asked for something [s]: the plan's times begin then."""
        return 0.0 if self.asked is None else time.monotonic() - self.asked

    def run(self) -> None:
        while self.elapsed < self.plan["seconds"]:
            now = self.elapsed
            while self.jumps and self.known_for >= self.jumps[0]["at"]:
                self.restart(self.jumps.pop(0))
            for name in [name for name, rate in self.rates.items() if now >= self.next.get(name, 0.0)]:
                self.next[name] = max(self.next.get(name, now) + 1.0 / self.rates[name], now - 0.5)
                self.tell(name, now)
            self.hear(self.way.receive(min([self.next[name] for name in self.rates]) - self.elapsed))

    def restart(self, jump: dict[str, Any]) -> None:
        """The clock begins at another time; after a restart the vehicle is away first, and has forgotten rates."""
        if jump.get("away"):
            self.way.drop()
            time.sleep(jump["away"])
            self.rates = {"HEARTBEAT": 4.0}
        self.clock = jump["to"] - self.elapsed

    def quiet(self) -> bool:
        return any(a <= self.known_for < b for a, b in self.plan.get("held", []))

    def put(self, message: Any) -> None:
        self.way.send(bytes(message.pack(self.link)), self.quiet())
        self.link.seq = (self.link.seq + 1) % 256

    def tell(self, name: str, now: float) -> None:
        own = now + self.clock
        if name == "HEARTBEAT":
            self.put(mavlink.MAVLink_heartbeat_message(2, self.autopilot, 0, 0, 4, 3))
        elif name in ("RAW_IMU", "HIGHRES_IMU"):
            self.put(self.imu(name, own))
        elif name == "SCALED_PRESSURE":
            self.put(mavlink.MAVLink_scaled_pressure_message(round(1e3 * own), 950.0, 0.0, 2350))
        elif name == "GPS_RAW_INT":
            fields = (round(1e6 * own), 3, 473_977_000, 85_456_000, 488_000, 75, 120, 0, 0, 14, 536_000, 900, 1500, 300)
            self.put(mavlink.MAVLink_gps_raw_int_message(*fields))
        elif name == "BATTERY_STATUS":
            for battery, current in ((0, 1250), (1, 350)):
                cells = [4000, 4100, *[65535] * 8]
                fields = (battery, 0, 0, 2000, cells, current, -1, -1, 80)
                self.put(mavlink.MAVLink_battery_status_message(*fields))
        elif name == "ATTITUDE":
            rpy = [math.radians(a) for a in self.angles()]
            self.put(mavlink.MAVLink_attitude_message(round(1e3 * own), *rpy, 0.0, 0.0, 0.0))

    def angles(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw [deg] of what is shown now; between two poses a turn from one to the next."""
        if self.shown_since is None:
            return 0.0, 0.0, 0.0
        shown, hold, turn = self.plan["shown"], self.plan["hold"], self.plan.get("turn", 0.15)
        k, t = divmod(time.monotonic() - self.shown_since, hold + turn)
        first, second = (shown[(int(k) + j) % len(shown)] for j in (0, 1))
        round_ = 360.0 * t / hold if self.plan.get("round") else 0.0
        if t < hold:
            return first[0], first[1], first[2] + round_
        part = (t - hold) / turn
        return tuple(a + part * (b - a) for a, b in zip(first, second, strict=True))  # type: ignore[return-value]

    def imu(self, name: str, own: float) -> Any:
        if self.shown_since is None and self.elapsed > self.plan.get("lead", 0.3):
            self.shown_since = time.monotonic()
        C = attitude(*self.angles())
        f = self.corrected("accel", seen(C, (0.0, 0.0, -G)), 0.02)
        m = self.corrected("mag", seen(C, FIELD), 0.0005)
        w = [self.noise.gauss(0.0, 0.002) for _ in range(3)]
        if name == "HIGHRES_IMU":
            return mavlink.MAVLink_highres_imu_message(round(1e6 * own), *f, *w, *m, 950.0, 0.0, 500.0, 25.0, 0xFFF)
        mg = [round(1000.0 * value / G) for value in f]
        mrad, mgauss = [round(1000.0 * value) for value in w], [round(1000.0 * value) for value in m]
        return mavlink.MAVLink_raw_imu_message(round(1e6 * own), *mg, *mrad, *mgauss, 0, 2500)

    def corrected(self, sensor: str, truth: list[float], noise: float) -> list[float]:
        """What the chip reads of the truth, by the plan; and what the autopilot makes of it, by its parameters."""
        fault = self.plan.get(sensor, {"scale": (1, 1, 1), "offset": (0, 0, 0)})
        raw = [truth[k] * fault["scale"][k] + fault["offset"][k] + self.noise.gauss(0.0, noise) for k in range(3)]
        p = self.parameters
        if self.autopilot == PX4:
            cal = {"accel": "CAL_ACC0", "mag": "CAL_MAG0"}[sensor]
            return [(raw[k] - p.get(f"{cal}_{a}OFF", 0.0)) * p.get(f"{cal}_{a}SCALE", 1.0) for k, a in enumerate("XYZ")]
        if sensor == "accel":
            return [(raw[k] - p.get(f"INS_ACCOFFS_{a}", 0.0)) * p.get(f"INS_ACCSCAL_{a}", 1.0)
                    for k, a in enumerate("XYZ")]  # fmt: skip
        v = [raw[k] + 1e-3 * p.get(f"COMPASS_OFS_{a}", 0.0) for k, a in enumerate("XYZ")]
        dia = [p.get(f"COMPASS_DIA_{a}", 1.0) for a in "XYZ"]
        x, y, z = (p.get(f"COMPASS_ODI_{a}", 0.0) for a in "XYZ")
        D = [[dia[0], x, y], [x, dia[1], z], [y, z, dia[2]]]
        return [sum(D[i][j] * v[j] for j in range(3)) for i in range(3)]

    def hear(self, data: bytes) -> None:
        for message in self.link.parse_buffer(data) or []:
            name, now = message.get_type(), self.elapsed
            self.asked = self.asked or time.monotonic()
            if name == "COMMAND_LONG" and message.command == 511 and not self.plan.get("old"):
                self.interval(int(message.param1), message.param2, now)
            elif name == "REQUEST_DATA_STREAM" and message.req_stream_id == 1:
                self.rates["RAW_IMU"] = float(message.req_message_rate)
            elif name == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
                self.told(message.param_id, now)
            elif name == "PARAM_SET":
                self.parameters[message.param_id] = message.param_value
                self.told(message.param_id, now)

    def interval(self, number: int, interval: float, now: float) -> None:
        kind = mavlink.mavlink_map.get(number)
        known = kind is not None and kind.msgname in self.plan["sends"]
        if known and kind is not None:
            self.rates[kind.msgname] = min(1e6 / interval, self.plan.get("most", 400.0))
        self.put(mavlink.MAVLink_command_ack_message(511, 0 if known else 2))

    def told(self, name: str, now: float) -> None:
        fields = name.encode(), self.parameters[name], 9, len(self.parameters), 0
        self.put(mavlink.MAVLink_param_value_message(*fields))


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        Simulated(json.load(file)).run()
