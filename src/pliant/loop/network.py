"""Samples by UDP and by ZeroMQ (extra ``zmq``), one packet each."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from ipaddress import ip_address
from typing import Any

from pliant.errors import InputError
from pliant.loop.keyed import Sealer, Sessions
from pliant.loop.packet import LARGEST, pack, unpack
from pliant.loop.sample import Sample, Sender

Address = tuple[str, int]
BURST = 64  # packets looked at in one read: a flood cannot hold up the loop


class UdpSource:
    """Samples that arrive at a UDP port.

    Parameters
    ----------
    address : (host, port)
        Port 0: any free one; `address` holds it. An address of this machine alone (127.0.0.1) needs nothing else.
    key : bytes, optional
        Shared with the senders, from `new_key` or `read_key`: a packet that was not made with it, or comes a second
        time, is not a sample. An address that other machines reach asks for a key.
    private_link : bool
        The address belongs to a cable or network that only trusted machines share, so that no key is needed.
        "0.0.0.0", every network of the machine, asks for a key all the same.
    senders : sequence of str
        Addresses (IPv4) that may send; none means any. Without a key an address can be forged.

    Attributes
    ----------
    rejected : int
        Packets that were no samples: malformed, without the key, repeated, or from an address that may not send.

    Raises
    ------
    InputError
        When the port cannot be opened, or other machines reach it and there is no key.
    """

    def __init__(
        self, address: Address = ("127.0.0.1", 0), key: bytes | None = None, *, private_link: bool = False,
        senders: Sequence[str] = (),
    ) -> None:
        host = numeric(address[0])
        self._senders = frozenset(numeric(name) for name in senders)
        if key is None:
            refuse_open_host(host, private_link=private_link)
        self._sessions = None if key is None else Sessions(key)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, address[1]))
        except (OSError, OverflowError) as error:
            self._socket.close()
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"cannot listen at {address[0]}:{address[1]}: {reason}") from None
        self._socket.setblocking(False)
        self.address: Address = self._socket.getsockname()
        self._malformed = 0
        self.finished = False

    @property
    def rejected(self) -> int:
        """Packets that were no samples."""
        keyed = self._sessions
        return self._malformed + (keyed.forged + keyed.replayed + keyed.challenged if keyed else 0)

    def read(self) -> Sample | None:
        """The oldest sample that has arrived."""
        for _ in range(BURST):
            try:
                data, (host, port) = self._socket.recvfrom(LARGEST + 1)
            except (BlockingIOError, ConnectionError):
                return None
            if self._senders and host not in self._senders:
                self._malformed += 1
                continue
            session = b""
            if self._sessions is not None:
                data, session, answer = self._sessions.open(data)
                if answer:
                    with suppress(OSError):
                        self._socket.sendto(answer, (host, port))
                if not session:
                    continue
            try:
                return unpack(data, Sender(host, port, session))
            except InputError:
                self._malformed += 1
        return None

    def end_session(self, sender: Sender) -> None:
        """End a sender's session, if there is one: what it sent before cannot arrive any more; it starts another."""
        if self._sessions is not None:
            self._sessions.end(sender.session)

    def close(self) -> None:
        """Close the port."""
        self.finished = True
        self._socket.close()


class UdpSink:
    """Samples sent to a UDP port; `lost` counts those that the system did not take.

    Parameters
    ----------
    address : (host, port)
    key : bytes, optional
        That of the source. The first sample then only asks for a session, and is not read.
    """

    def __init__(self, address: Address, key: bytes | None = None) -> None:
        self._sealer = None if key is None else Sealer(key)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._address, self.lost = address, 0

    def write(self, sample: Sample) -> None:
        """Send without waiting."""
        data = pack(sample)
        if self._sealer is not None:
            self._take_challenges(self._sealer)
            data = self._sealer.seal(data)
        try:
            self._socket.sendto(data, self._address)
        except OSError:
            self.lost += 1

    def _take_challenges(self, sealer: Sealer) -> None:
        """Read the receiver's answers, if there are any."""
        with suppress(OSError):
            for _ in range(BURST):
                sealer.take_challenge(self._socket.recv(LARGEST))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def numeric(host: str) -> str:
    """The IPv4 address of a host's name; InputError when there is none."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise InputError(f"no address of the host {host!r}: {error.strerror or error}") from None


def refuse_open_host(host: str, *, private_link: bool) -> None:
    """Raise InputError where an address without a key lets other machines in."""
    address = ip_address(host)
    if address.is_unspecified:
        raise InputError(
            f"{host} lets every machine of every network send: give a key, or listen at 127.0.0.1 or at the address of "
            "a private link"
        )
    if not (address.is_loopback or private_link):
        raise InputError(
            f"other machines reach {host}: give a key, or private_link=True where only trusted machines share that link"
        )


def _zmq() -> Any:
    try:
        return import_module("zmq")
    except ImportError:
        raise InputError("ZeroMQ is not installed: pip install 'pliant[zmq]', or use UDP") from None


class ZmqSource:
    """Samples that a ZeroMQ publisher sends; the newest 100 are kept.

    Parameters
    ----------
    endpoint : str
        As ``tcp://127.0.0.1:5555``.
    private_link : bool
        The publisher may be another machine, on a link that only trusted machines share: nothing here has a key.
    """

    def __init__(self, endpoint: str, *, private_link: bool = False) -> None:
        if endpoint.startswith("tcp://"):
            refuse_open_host(numeric(endpoint.removeprefix("tcp://").rpartition(":")[0]), private_link=private_link)
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
