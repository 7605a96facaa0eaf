"""Samples by UDP and by ZeroMQ (extra ``zmq``), one packet each."""

from __future__ import annotations

import socket
from importlib import import_module
from typing import Any

from pliant.errors import InputError
from pliant.loop.packet import LARGEST, pack, unpack
from pliant.loop.sample import Sample

Address = tuple[str, int]
BURST = 64  # packets looked at in one read: a flood cannot hold up the loop


class UdpSource:
    """Samples that arrive at a UDP port.

    Parameters
    ----------
    address : (host, port)
        Port 0: any free one; `address` tells it. Only this host's own interfaces by default.

    Attributes
    ----------
    rejected : int
        Packets that were no samples.
    """

    def __init__(self, address: Address = ("127.0.0.1", 0)) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise InputError(f"cannot listen at {address[0]}:{address[1]}: {error.strerror or error}") from None
        self._socket.setblocking(False)
        self.address: Address = self._socket.getsockname()
        self.rejected = 0
        self.finished = False

    def read(self) -> Sample | None:
        """The oldest sample that has arrived."""
        for _ in range(BURST):
            try:
                data = self._socket.recv(LARGEST + 1)
            except (BlockingIOError, ConnectionError):
                return None
            try:
                return unpack(data)
            except InputError:
                self.rejected += 1
        return None

    def close(self) -> None:
        """Close the port."""
        self.finished = True
        self._socket.close()


class UdpSink:
    """Samples sent to a UDP port; `lost` counts those that the system did not take."""

    def __init__(self, address: Address) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._address, self.lost = address, 0

    def write(self, sample: Sample) -> None:
        """Send without waiting."""
        try:
            self._socket.sendto(pack(sample), self._address)
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _zmq() -> Any:
    try:
        return import_module("zmq")
    except ImportError:
        raise InputError("ZeroMQ is not installed: pip install 'pliant[zmq]', or use UDP") from None


class ZmqSource:
    """Samples that a ZeroMQ publisher sends; `endpoint` as ``tcp://127.0.0.1:5555``. The newest 100 are kept."""

    def __init__(self, endpoint: str) -> None:
        zmq = _zmq()
        self._nothing = zmq.Again
        self._flag = zmq.NOBLOCK
        self._socket = zmq.Context.instance().socket(zmq.SUB)
        self._socket.setsockopt(zmq.RCVHWM, 100)
        self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        self._socket.connect(endpoint)
        self.rejected, self.finished = 0, False

    def read(self) -> Sample | None:
        """The oldest sample that has arrived."""
        for _ in range(BURST):
            try:
                return unpack(self._socket.recv(self._flag))
            except self._nothing:
                return None
            except InputError:
                self.rejected += 1
        return None

    def close(self) -> None:
        """Close the socket."""
        self.finished = True
        self._socket.close(0)


class ZmqSink:
    """Samples published at a ZeroMQ endpoint."""

    def __init__(self, endpoint: str) -> None:
        zmq = _zmq()
        self._flag = zmq.NOBLOCK
        self._socket = zmq.Context.instance().socket(zmq.PUB)
        self._socket.bind(endpoint)

    def write(self, sample: Sample) -> None:
        """Send without waiting."""
        self._socket.send(pack(sample), self._flag)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close(0)
