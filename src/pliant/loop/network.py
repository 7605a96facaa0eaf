"""Send and receive samples by UDP or ZeroMQ (extra ``zmq``), one packet per sample."""

from __future__ import annotations

import re
import socket
from collections.abc import Sequence
from contextlib import suppress
from ipaddress import ip_address
from typing import Any

from pliant.errors import InputError, clipped
from pliant.loop.keyed import Sealer, Sessions
from pliant.loop.sample import LARGEST, Sample, Sender, pack, unpack
from pliant.plugins import optional

Address = tuple[str, int]
BURST = 64  # most packets handled in one read, so that a flood cannot delay the loop


class UdpSource:
    """Samples that arrive at a UDP port.

    Parameters
    ----------
    address : (host, port)
        Address to listen at. With port 0 the system chooses a free port; the attribute `address` holds it. The local
        address 127.0.0.1 needs neither key nor `private_link`.
    key : bytes, optional
        Key that the senders share, from `new_key` or `read_key`. Packets without it and repeated packets are rejected.
        An address that other machines can reach requires a key.
    private_link : bool
        True if the address belongs to a cable or network that only trusted machines share, so that no key is needed.
        "0.0.0.0", which means all networks of the machine, requires a key in any case.
    senders : sequence of str
        IPv4 addresses that may send; empty: all. Without a key an address can be forged.

    Attributes
    ----------
    rejected : int
        Number of packets that were not accepted: malformed, without the key, repeated, or from another address.

    Raises
    ------
    InputError
        When the port cannot be opened, or other machines can reach it and there is no key.
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
            raise InputError(f"cannot listen at {address[0]}:{address[1]}: {reason}; choose another port, or an "
                             "address of this machine") from None
        self._socket.setblocking(False)
        self.address: Address = self._socket.getsockname()
        self._malformed = 0
        self.finished = False

    @property
    def rejected(self) -> int:
        """Number of packets that were not accepted as samples."""
        keyed = self._sessions
        return self._malformed + (keyed.forged + keyed.replayed + keyed.challenged if keyed else 0)

    def read(self) -> Sample | None:
        """Return the oldest sample that has arrived, or None."""
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
        """End the session of `sender`: packets it has sent are refused from now on, and it must start a new one."""
        if self._sessions is not None:
            self._sessions.end(sender.session)

    def close(self) -> None:
        """Close the port."""
        self.finished = True
        self._socket.close()


class UdpSink:
    """Sends samples to a UDP port; `lost` counts the samples that the system could not send.

    Parameters
    ----------
    address : (host, port)
    key : bytes, optional
        The receiver's key. The first sample then only starts a session and is not delivered.
    """

    def __init__(self, address: Address, key: bytes | None = None) -> None:
        self._sealer = None if key is None else Sealer(key)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._address, self.lost = address, 0

    def write(self, sample: Sample) -> None:
        """Send a sample without waiting."""
        data = pack(sample)
        if self._sealer is not None:
            self._take_challenges(self._sealer)
            data = self._sealer.seal(data)
        try:
            self._socket.sendto(data, self._address)
        except OSError:
            self.lost += 1

    def _take_challenges(self, sealer: Sealer) -> None:
        """Read and use the receiver's challenges, if there are any."""
        with suppress(OSError):
            for _ in range(BURST):
                sealer.take_challenge(self._socket.recv(LARGEST))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def numeric(host: str) -> str:
    """Return the IPv4 address of a host name; raise InputError when there is none."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise InputError(f"cannot resolve the host {host!r}: {error.strerror or error}; give an IPv4 address") from None


def refuse_open_host(host: str, *, private_link: bool) -> None:
    """Raise InputError when other machines can reach the address `host`, unless `private_link` is True.

    The address 0.0.0.0 is refused in any case.
    """
    address = ip_address(host)
    if address.is_unspecified:
        raise InputError(
            f"machines of all networks can send commands to {host}: give a key, or listen at 127.0.0.1 or at the "
            "address of a private link"
        )
    if not (address.is_loopback or private_link):
        raise InputError(
            f"other machines can reach {host}: give a key, or private_link=True if only trusted machines share the link"
        )


def _zmq() -> Any:
    return optional("zmq", "ZeroMQ is not installed: pip install 'pliant[zmq]', or use UDP")


def host_and_port(endpoint: str) -> Address:
    """Return host and port of a ZeroMQ endpoint ``tcp://HOST:PORT``; raise InputError for any other transport, whose
    senders cannot be checked.
    """
    parts = re.fullmatch(r"tcp://(.+):([0-9]{1,5})", str(endpoint))
    if parts is None or not 0 < int(parts[2]) < 1 << 16:
        raise InputError(
            "a ZeroMQ endpoint must be tcp://HOST:PORT, such as tcp://127.0.0.1:5555, got "
            f"{clipped(str(endpoint), 60)!r}: other transports (ipc, inproc, pgm, ...) are not supported, because "
            "their senders cannot be checked"
        )
    return parts[1], int(parts[2])


class ZmqSource:
    """Samples from a ZeroMQ publisher; at most 100 wait to be read.

    Parameters
    ----------
    endpoint : str
        Address of the publisher, ``tcp://HOST:PORT``, e.g. ``tcp://127.0.0.1:5555``.
    private_link : bool
        True if the publisher may be another machine, on a link that only trusted machines share. ZeroMQ samples have
        no key.

    Raises
    ------
    InputError
        For another transport than TCP, or a host on another machine without `private_link`.
    """

    def __init__(self, endpoint: str, *, private_link: bool = False) -> None:
        name, port = host_and_port(endpoint)
        host = numeric(name)
        refuse_open_host(host, private_link=private_link)
        zmq = _zmq()
        self._nothing = zmq.Again
        self._flag = zmq.NOBLOCK
        self._socket = zmq.Context.instance().socket(zmq.SUB)
        self._socket.setsockopt(zmq.RCVHWM, 100)
        self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        self._socket.connect(f"tcp://{host}:{port}")  # the address that was checked, not a name that may change
        self.rejected, self.finished = 0, False

    def read(self) -> Sample | None:
        """Return the oldest sample that has arrived, or None."""
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
    """Publishes samples at a ZeroMQ endpoint ``tcp://HOST:PORT``.

    Raises
    ------
    InputError
        For another transport than TCP, or an address at which the system does not let it publish.
    """

    def __init__(self, endpoint: str) -> None:
        host_and_port(endpoint)
        zmq = _zmq()
        self._flag = zmq.NOBLOCK
        self._socket = zmq.Context.instance().socket(zmq.PUB)
        try:
            self._socket.bind(endpoint)
        except zmq.ZMQError as error:
            self._socket.close(0)
            reason = error.strerror or error
            raise InputError(
                f"cannot publish at {endpoint}: {reason}; choose another port, or an address of this machine"
            ) from None

    def write(self, sample: Sample) -> None:
        """Send a sample without waiting."""
        self._socket.send(pack(sample), self._flag)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close(0)
