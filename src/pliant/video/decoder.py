"""Decode the frames of a film in a helper process with limits on time and memory."""

from __future__ import annotations

import json
import subprocess
import threading
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart import start_helper
from pliant.recording.apart_worker import LENGTH_BYTES, MAGIC, STAMP

Array = np.ndarray
SECONDS, BYTES_PER_SECOND = 60, 1e4  # processor time: even of a film at rest, whose frames take few bytes
MEMORY = 2**32  # bytes: buffers of the decoder and of its threads
FRAME_S = 60.0  # s of real time for one frame
LONGEST_HEADER = 2**16  # bytes


class Film:
    """A film that helper processes decode. A helper that has answered a request whole is used for the next one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._idle: list[_Helper] = []

    def facts(self) -> dict[str, Any]:
        """Return the size [pixels], the rate [Hz] and the number of frames that the film states: width, height, rate,
        count.

        Raises
        ------
        InputError
            When the film cannot be decoded.
        """
        if not self._idle:
            self._idle.append(_Helper(self.path))
        return self._idle[0].facts

    def frames(self, numbers: Sequence[int] | None = None) -> Iterator[tuple[float, Array]]:
        """Yield the time [s] and the picture (H, W, 3) (uint8) of each frame, or of the frames of these numbers."""
        helper = self._idle.pop() if self._idle else _Helper(self.path)
        answered = False
        try:
            yield from helper.answers("all" if numbers is None else " ".join(map(str, numbers)))
            answered = True
        finally:
            if answered:
                self._idle.append(helper)
            else:
                helper.end()


class _Helper:
    """One helper process, and the facts of the film that it sent."""

    def __init__(self, path: Path) -> None:
        self.path = path
        seconds = int(SECONDS + path.stat().st_size / BYTES_PER_SECOND)
        arguments = [str(path.resolve()), str(seconds), str(MEMORY)]
        self.process = start_helper("pliant.recording.apart_film", arguments, stdin=subprocess.PIPE)
        self.end = weakref.finalize(self, _stop, self.process)
        head = bytes(self._read(len(MAGIC) + LENGTH_BYTES))
        length = int.from_bytes(head[len(MAGIC) :], "little")
        if not head.startswith(MAGIC) or length > LONGEST_HEADER:
            raise self._broken()
        self.facts: dict[str, Any] = json.loads(bytes(self._read(length)))
        if "reason" in self.facts:
            raise InputError(f"OpenCV cannot read {path.name} as a video, as {self.facts['reason']}; it may be "
                             "damaged: convert it to MP4")  # fmt: skip

    def answers(self, request: str) -> Iterator[tuple[float, Array]]:
        """Yield the time and the picture of each frame of the answer to a request."""
        shape = (self.facts["height"], self.facts["width"], 3)
        requests: IO[bytes] = self.process.stdin  # type: ignore[assignment]
        try:
            requests.write(f"{request}\n".encode())
            requests.flush()
        except OSError:
            raise self._broken() from None
        while True:
            (time,) = STAMP.unpack(self._read(STAMP.size).tobytes())
            if np.isnan(time):
                return
            yield time, self._read(int(np.prod(shape))).reshape(shape)

    def _read(self, count: int) -> Array:
        """Return the next bytes (count,) of the helper; raise InputError where it ends or stalls."""
        content = bytearray(count)
        view, filled = memoryview(content), 0
        answer: IO[bytes] = self.process.stdout  # type: ignore[assignment]
        watchdog = threading.Timer(FRAME_S, self.process.kill)
        watchdog.daemon = True
        watchdog.start()
        try:
            while filled < count:
                got = answer.readinto(view[filled:])  # type: ignore[attr-defined]
                if not got:
                    raise self._broken()
                filled += got
        finally:
            watchdog.cancel()
        return np.frombuffer(content, np.uint8)  # of a bytearray, so that it can be written to

    def _broken(self) -> InputError:
        self.end()
        return InputError(f"{self.path.name} cannot be decoded: its decoder crashed, took too long, needed too much "
                          "memory, or met frames of another size; convert the film to MP4")


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            try:
                stream.close()
            except OSError:  # of a request that the helper no longer reads
                continue
    process.wait()
