"""Plays a telemetry log over UDP: `python mavlink_replay.py LOG PORT EVERY`; every so many frames one is lost.

It sends the log's first frame until whoever listens says something, then all frames at the pace at which they had come.
"""

from __future__ import annotations

import socket
import struct
import sys
import time
from pathlib import Path


def frames(data: bytes) -> list[tuple[float, bytes]]:
    """When each frame had come [s], and its bytes (MAVLink 2, unsigned)."""
    found, k = [], 0
    while k < len(data):
        (stamp,) = struct.unpack_from(">Q", data, k)
        size = 12 + data[k + 9]
        found.append((1e-6 * stamp, data[k + 8 : k + 8 + size]))
        k += 8 + size
    return found


def main() -> None:
    played, place, every = frames(Path(sys.argv[1]).read_bytes()), ("127.0.0.1", int(sys.argv[2])), int(sys.argv[3])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        way.settimeout(0.1)
        heard, end = False, time.monotonic() + 60.0
        while not heard and time.monotonic() < end:
            way.sendto(played[0][1], place)
            try:
                heard = bool(way.recv(1000))
            except OSError:  # nobody listens yet
                time.sleep(0.05)
        begin = time.monotonic() - played[0][0]
        for k, (stamp, frame) in enumerate(played, 1):
            time.sleep(max(0.0, begin + stamp - time.monotonic()))
            if k % every:
                way.sendto(frame, place)


if __name__ == "__main__":
    main()
