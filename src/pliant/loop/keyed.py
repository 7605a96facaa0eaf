"""Packets authenticated by HMAC-SHA256 and a shared key. A recorded packet that is sent again is not accepted.

A packet consists of the mark "PLN3", the session (16 random bytes of the sender), a counter (uint64), a packet of
`pliant.loop.sample` and the tag (32 bytes). The tag is computed with the session's key, which is derived from the
shared key, the session and a challenge that the receiver draws at random. The receiver replies to a packet of an
unknown session with the challenge: the mark "PLNC", the session, the counter of that packet, the challenge (16 bytes)
and a tag. Recorded packets of a session are therefore refused after the session has ended, also by a receiver that was
restarted.
"""

from __future__ import annotations

import hmac
import os
import secrets
import struct
from pathlib import Path
from typing import NamedTuple

from pliant.errors import InputError
from pliant.files import regular_file, write_new
from pliant.loop.sample import LARGEST

MAGIC, CHALLENGE = b"PLN3", b"PLNC"
HEAD = struct.Struct("<4s16sQ")
ANSWER = struct.Struct("<4s16sQ16s")
TAG = 32  # bytes
SHORTEST_KEY = 16  # bytes
WINDOW = 64  # packets by which a packet may be out of order and still be accepted
MOST_SESSIONS = 16  # at one port
OLDEST = (1 << WINDOW) - 1


def checked_key(key: bytes) -> bytes:
    """Return the key; raise InputError when it is not a bytes object of at least 16 bytes."""
    if not isinstance(key, bytes) or len(key) < SHORTEST_KEY:
        raise InputError(
            f"a key must be a bytes object of at least {SHORTEST_KEY} random bytes: make one with pliant.loop.new_key"
        )
    return key


def new_key(path: str | Path) -> bytes:
    """Write a random 32-byte key to a new file and return it.

    The file holds hexadecimal digits, and only its owner may read it.

    Raises
    ------
    InputError
        When the file exists already or cannot be written.
    """
    key = secrets.token_bytes(32)
    write_new(path, key.hex() + "\n", mode=0o600)
    return key


def read_key(path: str | Path) -> bytes:
    """Return the key in a file that `new_key` wrote.

    Raises
    ------
    InputError
        When the file cannot be read, holds no key, or is readable by other users than its owner.
    """
    path = Path(path)
    try:
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise InputError(f"other users may read the key file {path}: run chmod 600 {path}")
        with regular_file(path, "key file") as file:
            text = file.read(1025)
    except OSError as error:
        raise InputError(f"cannot read the key file {path}: {error.strerror or error}") from None
    try:
        return checked_key(bytes.fromhex(text.decode("ascii") if len(text) <= 1024 else ""))
    except ValueError:
        raise InputError(f"the key file {path} has no key of hexadecimal digits: write a new one by pliant.loop.new_key"
                         ) from None


def tag_of(key: bytes, data: bytes) -> bytes:
    """Return the HMAC-SHA256 tag of `data` under `key`."""
    return hmac.digest(key, data, "sha256")


def session_key(key: bytes, session: bytes, challenge: bytes) -> bytes:
    """Return the key of one session, derived from the shared key, the session and the receiver's challenge."""
    return tag_of(key, b"pliant session" + session + challenge)


def challenge_key(key: bytes) -> bytes:
    """Return the key for the receiver's challenges. It differs from session keys, so that tags cannot be reused."""
    return tag_of(key, b"pliant challenge")


class Sealer:
    """The sender's side of a session: adds an authentication tag to packets.

    Parameters
    ----------
    key : bytes
        Key that the receiver shares.
    """

    def __init__(self, key: bytes) -> None:
        self._key, self._challenges = checked_key(key), challenge_key(key)
        self._session = secrets.token_bytes(16)
        self._own_key = session_key(key, self._session, bytes(16))  # never valid: the first packet requests a challenge
        self._counter = self._answered = 0

    def seal(self, packet: bytes) -> bytes:
        """Return the packet with header and authentication tag under the session's key."""
        self._counter += 1
        data = HEAD.pack(MAGIC, self._session, self._counter) + packet
        if len(data) + TAG > LARGEST:
            raise InputError(f"a sample of {len(packet)} bytes does not fit into one datagram: send fewer points")
        return data + tag_of(self._own_key, data)

    def take_challenge(self, answer: bytes) -> bool:
        """Derive a new session key from a receiver's challenge; return False if the challenge is not valid.

        A challenge is valid if its tag is right, it belongs to a packet of this session, and it is newer than the last
        one.
        """
        if len(answer) != ANSWER.size + TAG:
            return False
        magic, session, counter, challenge = ANSWER.unpack_from(answer)
        fitting = magic == CHALLENGE and session == self._session and self._answered < counter <= self._counter
        if not fitting or not hmac.compare_digest(tag_of(self._challenges, answer[:-TAG]), answer[-TAG:]):
            return False
        self._answered = counter
        self._own_key = session_key(self._key, self._session, challenge)
        return True


class Opened(NamedTuple):
    """Result of checking an incoming packet. An accepted one gives its content and session; one of an unknown session
    gives a challenge to send back; any other gives nothing.
    """

    packet: bytes = b""
    session: bytes = b""
    answer: bytes = b""


class _Session:
    def __init__(self, key: bytes, counter: int) -> None:
        self.key, self._newest, self._seen = key, counter, 1

    def first_time(self, counter: int) -> bool:
        """Return True if no packet with this counter was accepted before, and the counter is less than 64 behind the
        newest one. An older counter is always refused.
        """
        ahead = counter - self._newest
        if ahead > 0:
            self._seen = (self._seen << min(ahead, WINDOW) | 1) & OLDEST
            self._newest = counter
            return True
        if ahead <= -WINDOW or self._seen >> -ahead & 1:
            return False
        self._seen |= 1 << -ahead
        return True


class Sessions:
    """The receiver's side: checks packets of at most 16 active sessions under one key.

    A new session ends the one that has been silent for the longest time.

    Attributes
    ----------
    forged, replayed, challenged : int
        Numbers of packets that are malformed or have a wrong tag, of repeated packets, and of packets of inactive
        sessions, to which the challenge was sent.
    """

    def __init__(self, key: bytes) -> None:
        self._key, self._challenges = checked_key(key), challenge_key(key)
        self._challenge = secrets.token_bytes(16)
        self._sessions: dict[bytes, _Session] = {}
        self.forged = self.replayed = self.challenged = 0

    def open(self, data: bytes) -> Opened:
        """Check a packet and return its content, or the challenge to send back.

        A packet of an active session is opened when its tag is right and it is new. A packet of another session starts
        that session if it was made with the present challenge, which is valid once; otherwise the challenge is
        returned. A reply is never longer than the packet, so that the receiver cannot amplify a flood.
        """
        if len(data) < ANSWER.size + TAG or data[:4] != MAGIC:
            self.forged += 1
            return Opened()
        _, name, counter = HEAD.unpack_from(data)
        session = self._sessions.get(name)
        key = session.key if session else session_key(self._key, name, self._challenge)
        right = hmac.compare_digest(tag_of(key, data[:-TAG]), data[-TAG:])
        if not right:
            return self._refuse(name, counter)
        if session is None:
            self._start(name, key, counter)
        elif session.first_time(counter):
            self._sessions[name] = self._sessions.pop(name)  # the dict is ordered by the last packet
        else:
            self.replayed += 1
            return Opened()
        return Opened(data[HEAD.size : -TAG], name)

    def _start(self, name: bytes, key: bytes, counter: int) -> None:
        self._sessions[name] = _Session(key, counter)
        self._challenge = secrets.token_bytes(16)
        if len(self._sessions) > MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]

    def _refuse(self, name: bytes, counter: int) -> Opened:
        if name in self._sessions:
            self.forged += 1
            return Opened()
        self.challenged += 1
        answer = ANSWER.pack(CHALLENGE, name, counter, self._challenge)
        return Opened(answer=answer + tag_of(self._challenges, answer))

    def end(self, session: bytes) -> None:
        """End a session: its recorded or delayed packets are no longer accepted."""
        self._sessions.pop(session, None)
