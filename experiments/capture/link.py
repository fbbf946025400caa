"""Bytes from and to a vehicle: UDP, TCP or a serial line, that may go away and come back."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from typing import Any

from sinan.sensors.errors import InputError, with_extra

FORMS = "udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE[:BAUD]"
_BAUD = 57600
#: The largest datagram, and so many bytes of a stream at once.
_MOST = 65536
#: How long after a link is gone it is tried again, and how long a connection may take [s].
_AGAIN, _PATIENCE = 0.5, 2.0
#: Datagrams that are taken at once: a burst must not keep what came first from being written.
_BURST = 500


class Link(ABC):
    """A way to a vehicle.

    Attributes
    ----------
    name : as the user gave it
    trouble : why nothing can come now; empty: nothing is known to be wrong
    """

    name: str
    trouble: str = ""

    @abstractmethod
    def receive(self, wait: float) -> list[bytes]:
        """What has come, after at most so many seconds; nothing where the link is gone."""

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send, if there is a way; what is lost is asked for again."""

    @abstractmethod
    def close(self) -> None:
        """End it."""


def open_link(text: str) -> Link:
    """A link of its name: `udp:` or `udpin:` listens, `udpout:` sends first, `tcp:` connects.

    Raises
    ------
    InputError : no such form, a port that is in use, no `pyserial`
    """
    kind, _, rest = text.partition(":")
    if kind == "serial" and rest:
        device, _, baud = rest.rpartition(":")
        if device and baud.isdigit():
            return SerialLink(text, device, int(baud))
        return SerialLink(text, rest, _BAUD)
    host, _, port = rest.rpartition(":")
    if kind not in ("udp", "udpin", "udpout", "tcp") or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise InputError("--link", text, FORMS)
    place = host.strip("[]"), int(port)
    if kind == "tcp":
        return TcpLink(text, place)
    return UdpLink(text, place, listens=kind != "udpout")


class UdpLink(Link):
    """Datagrams; one that listens answers whoever was heard last."""

    def __init__(self, name: str, place: tuple[str, int], listens: bool) -> None:
        self.name = name
        try:
            family, _, _, _, address = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise InputError("--link", f"{name}: {error.strerror or error}", "an address that is known") from None
        self._peer: Any = None if listens else address
        try:
            if listens:
                self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise InputError("--link", f"{name}: {error.strerror or error}", "an address that is free") from None

    def receive(self, wait: float) -> list[bytes]:
        """What has come."""
        found: list[bytes] = []
        self._socket.settimeout(wait)
        try:
            while len(found) < _BURST:
                data, self._peer = self._socket.recvfrom(_MOST)
                found.append(data)
                self._socket.settimeout(0.0)
        except OSError as error:  # nothing (more) there, or a refusal of what was sent before
            if not found and not isinstance(error, TimeoutError | BlockingIOError):
                time.sleep(min(wait, _AGAIN))
        return found

    def send(self, data: bytes) -> None:
        """Send to the vehicle, once it is known where it is."""
        if self._peer is not None:
            try:
                self._socket.settimeout(_PATIENCE)
                self._socket.sendto(data, self._peer)
            except OSError as error:
                self.trouble = error.strerror or type(error).__name__
            else:
                self.trouble = ""

    def close(self) -> None:
        """End it."""
        self._socket.close()


class _Connected(Link):
    """A link that is connected, and connected again where it was lost."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._channel: Any = None
        self._next = 0.0

    @abstractmethod
    def _connect(self) -> Any:
        """A channel, or an `OSError`."""

    @abstractmethod
    def _read(self, channel: Any, wait: float) -> bytes:
        """What has come; an `OSError` where the channel is gone."""

    @abstractmethod
    def _write(self, channel: Any, data: bytes) -> None:
        """Send, or an `OSError`."""

    def receive(self, wait: float) -> list[bytes]:
        """What has come."""
        if self._channel is None and not self._again(wait):
            return []
        try:
            data = self._read(self._channel, wait)
        except OSError as error:
            self._lost(error)
            return []
        return [data] if data else []

    def _again(self, wait: float) -> bool:
        """Connect, not too often."""
        now = time.monotonic()
        if now < self._next:
            time.sleep(min(wait, self._next - now))
            return False
        self._next = now + _AGAIN
        try:
            self._channel = self._connect()
        except OSError as error:
            self._lost(error)
            return False
        self.trouble = ""
        return True

    def send(self, data: bytes) -> None:
        """Send, if connected."""
        if self._channel is not None:
            try:
                self._write(self._channel, data)
            except OSError as error:
                self._lost(error)

    def _lost(self, error: OSError) -> None:
        self.trouble = error.strerror or str(error) or type(error).__name__
        self.close()

    def close(self) -> None:
        """End it."""
        channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()


class TcpLink(_Connected):
    """A connection to a place that listens."""

    def __init__(self, name: str, place: tuple[str, int]) -> None:
        super().__init__(name)
        self._place = place

    def _connect(self) -> socket.socket:
        channel = socket.create_connection(self._place, timeout=_PATIENCE)
        channel.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return channel

    def _read(self, channel: socket.socket, wait: float) -> bytes:
        channel.settimeout(wait)
        try:
            data = channel.recv(_MOST)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError("the other side has closed the connection")
        return data

    def _write(self, channel: socket.socket, data: bytes) -> None:
        channel.settimeout(_PATIENCE)
        channel.sendall(data)


class SerialLink(_Connected):
    """A serial line; a device that is unplugged is waited for."""

    def __init__(self, name: str, device: str, baud: int) -> None:
        super().__init__(name)
        try:
            import serial
        except ImportError:
            raise InputError("--link", f"{name}, which `pyserial` reads", with_extra("mavlink")) from None
        self._serial, self._device, self._baud = serial, device, baud

    def _connect(self) -> Any:
        return self._serial.Serial(self._device, self._baud, timeout=0.0, write_timeout=_PATIENCE)

    def _read(self, channel: Any, wait: float) -> bytes:
        channel.timeout = wait
        first = channel.read(1)
        return bytes(first + channel.read(channel.in_waiting)) if first else b""

    def _write(self, channel: Any, data: bytes) -> None:
        channel.write(data)
