"""Packets under a key: HMAC-SHA256, one session for each start of a sender, every packet accepted once.

A packet is the mark "PLN3", the session (16 bytes that the sender draws), a counter (uint64), a packet of
`pliant.loop.packet` and the tag (32 bytes). The tag is made with the key of the session, which is derived from the
shared key, the session and a challenge that the receiver draws. A packet of a session that is not in force is answered
with the challenge: the mark "PLNC", the session, the counter of that packet, the challenge (16 bytes) and a tag. What
was recorded of a session is therefore refused once that session has ended, by a receiver that was restarted as well.
"""

from __future__ import annotations

import hmac
import os
import secrets
import struct
from pathlib import Path
from typing import NamedTuple

from pliant.errors import InputError
from pliant.loop.packet import LARGEST

MAGIC, CHALLENGE = b"PLN3", b"PLNC"
HEAD = struct.Struct("<4s16sQ")
ANSWER = struct.Struct("<4s16sQ16s")
TAG = 32  # bytes
SHORTEST_KEY = 16  # bytes
WINDOW = 64  # packets by which one may come too late and still be read once
MOST_SESSIONS = 16  # at one port
OLDEST = (1 << WINDOW) - 1


def checked_key(key: bytes) -> bytes:
    """Return the key; InputError when it is shorter than 16 bytes or not made of bytes."""
    if not isinstance(key, bytes) or len(key) < SHORTEST_KEY:
        raise InputError(f"a key is at least {SHORTEST_KEY} random bytes: make one with pliant.loop.new_key")
    return key


def new_key(path: str | Path) -> bytes:
    """Write a random key of 32 bytes to a new file, as hexadecimal digits that only its owner may read; return it.

    Raises
    ------
    InputError
        When the file exists already or cannot be written.
    """
    key, path = secrets.token_bytes(32), Path(path)
    try:
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(key.hex() + "\n", encoding="ascii")
    except FileExistsError:
        raise InputError(f"the key file {path} exists already: name a new one") from None
    except OSError as error:
        raise InputError(f"cannot write the key file {path}: {error.strerror or error}") from None
    return key


def read_key(path: str | Path) -> bytes:
    """Return the key in a file that `new_key` wrote.

    Raises
    ------
    InputError
        When the file cannot be read, holds no key, or others than its owner may read it.
    """
    path = Path(path)
    try:
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise InputError(f"others may read the key file {path}: run chmod 600 {path}")
        with path.open("rb") as file:
            text = file.read(1025)
    except OSError as error:
        raise InputError(f"cannot read the key file {path}: {error.strerror or error}") from None
    try:
        return checked_key(bytes.fromhex(text.decode("ascii") if len(text) <= 1024 else ""))
    except ValueError:
        raise InputError(f"the key file {path} holds no key: expected hexadecimal digits, as new_key writes") from None


def tag_of(key: bytes, data: bytes) -> bytes:
    """HMAC-SHA256 of the data."""
    return hmac.digest(key, data, "sha256")


def session_key(key: bytes, session: bytes, challenge: bytes) -> bytes:
    """Key of one session."""
    return tag_of(key, b"pliant session" + session + challenge)


def challenge_key(key: bytes) -> bytes:
    """Key of the receiver's challenges: a tag of one direction is none of the other."""
    return tag_of(key, b"pliant challenge")


class Sealer:
    """A sender's side of a session.

    Parameters
    ----------
    key : bytes
        Shared with the receiver.
    """

    def __init__(self, key: bytes) -> None:
        self._key, self._challenges = checked_key(key), challenge_key(key)
        self._session = secrets.token_bytes(16)
        self._own_key = session_key(key, self._session, bytes(16))  # opens nothing: the first packet asks
        self._counter = self._answered = 0

    def seal(self, packet: bytes) -> bytes:
        """Return the packet under the session's key."""
        self._counter += 1
        data = HEAD.pack(MAGIC, self._session, self._counter) + packet
        if len(data) + TAG > LARGEST:
            raise InputError(f"a sample of {len(packet)} bytes under a key exceeds a datagram: send fewer points")
        return data + tag_of(self._own_key, data)

    def take_challenge(self, answer: bytes) -> bool:
        """Take a receiver's challenge; False when it is none, answers nothing that was asked or came before."""
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
    """Outcome of opening a packet: its content and session, an answer to send back, or neither."""

    packet: bytes = b""
    session: bytes = b""
    answer: bytes = b""


class _Session:
    def __init__(self, key: bytes, counter: int) -> None:
        self.key, self._newest, self._seen = key, counter, 1

    def first_time(self, counter: int) -> bool:
        """Whether a packet of that counter comes for the first time, at most `WINDOW` behind the newest."""
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
    """A receiver's side: the sessions in force under one key, at most 16; a new one ends the longest silent one.

    Attributes
    ----------
    forged, replayed, challenged : int
        Packets that are malformed or whose tag is wrong, those that came before, and those of sessions not in force,
        which were answered with the challenge.
    """

    def __init__(self, key: bytes) -> None:
        self._key, self._challenges = checked_key(key), challenge_key(key)
        self._challenge = secrets.token_bytes(16)
        self._sessions: dict[bytes, _Session] = {}
        self.forged = self.replayed = self.challenged = 0

    def open(self, data: bytes) -> Opened:
        """Look at a packet.

        A packet of a session in force is opened when its tag is right and it comes for the first time. A packet of
        another session starts that session when it was made with the present challenge, which serves once; otherwise
        the answer is the challenge. An answer is not longer than the packet, so that nobody can amplify a flood.
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
            self._sessions[name] = self._sessions.pop(name)  # the last one is the one heard last
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
        """End a session: what was recorded or held back of it opens nothing any more."""
        self._sessions.pop(session, None)
