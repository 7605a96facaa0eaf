"""Read a video frame by frame with the times stored in the file, and compensate for changes of brightness. A helper
process with limits on time and memory decodes the frames.
"""

from __future__ import annotations

import json
import subprocess
import threading
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart import start_helper
from pliant.recording.apart_worker import LENGTH_BYTES, MAGIC, STAMP
from pliant.recording.camera import opencv

Array = np.ndarray
FEWEST = 8  # least number of frames
COARSE = 160  # points across the grid on which brightness is compared
DARK, BRIGHT, SATURATED = 30.0, 215.0, 250.0  # grey levels: only pixels between them are used to measure brightness
FEWEST_POINTS = 200  # least number of grid points
SAMPLES = 32  # frames in which brightness is compared
STEADY = 0.02  # relative change of brightness that noise and a moving body explain
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


@dataclass(frozen=True)
class Reel:
    """A video file: its size [pixels], frame rate [Hz] and stated number of frames.

    A helper process decodes it. With a `reference`, the median frame on a coarse grid, every frame is adjusted to the
    brightness of the reference.
    """

    path: Path
    width: int
    height: int
    rate: float
    count: int
    reference: Array | None = None  # (h, w, 3)
    source: Film | None = field(default=None, compare=False, repr=False, kw_only=True)

    @property
    def decoder(self) -> Film:
        """Helper process that decodes the film."""
        return self.source or Film(self.path)

    @property
    def coarse(self) -> int:
        """Spacing [pixels] of the grid of pixels on which brightness is measured."""
        return max(1, self.width // COARSE)

    def gain(self, part: Array) -> Array:
        """Return the brightness (3,) of a coarsely sampled picture (h, w, 3), relative to the median picture of the
        video, in blue, green and red.
        """
        if self.reference is None:
            return np.ones(3)
        good = (self.reference > DARK) & (self.reference < BRIGHT) & (part > DARK / 2) & (part < SATURATED)
        ratios = [part[..., c][good[..., c]] / self.reference[..., c][good[..., c]] for c in range(3)]
        return np.array([np.median(r) if r.size > FEWEST_POINTS else 1.0 for r in ratios])

    def even(self, picture: Array) -> Array:
        """Return the picture (H, W, 3) of H by W pixels adjusted to the median brightness of the video; unchanged for a
        video of steady brightness.
        """
        if self.reference is None:
            return picture
        gain = self.gain(picture[:: self.coarse, :: self.coarse])
        table = np.clip(np.arange(256.0)[:, None] / gain + 0.5, 0, 255).astype(np.uint8)
        return np.stack([table[:, c][picture[..., c]] for c in range(3)], axis=2)

    def frames(self) -> Iterator[tuple[float, Array]]:
        """Yield the time [s] and the picture of each frame of the video: (H, W, 3), H by W pixels in blue, green, red
        (uint8).
        """
        for time, picture in self.decoder.frames():
            yield time, self.even(picture)

    def sampled(self, count: int, width: int) -> Array:
        """Return at most `count` frames, spread evenly over the video and scaled to `width` pixels, as an array (K, h,
        w, 3) of K pictures (uint8).
        """
        cv2 = opencv("a video")
        size = (width, max(1, round(self.height * width / self.width)))
        return np.array([cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in self.pictures(count)])

    def pictures(self, count: int) -> Iterator[Array]:
        """Yield at most `count` frames at full size, spread evenly over the video."""
        numbers = np.unique(np.linspace(0, self.count - 1, count).astype(int)).tolist()
        for _, picture in self.decoder.frames(numbers):
            yield self.even(picture)


def open_reel(path: Path) -> Reel:
    """Open a video file and return it as a `Reel`.

    Raises
    ------
    InputError
        When the file does not exist, OpenCV cannot read it, or it has too few frames.
    """
    if not path.is_file():
        raise InputError(f"cannot read a video from {path}: "
                         f"{'this is a folder, not a file' if path.is_dir() else 'there is no such file'}")
    opencv("a video")
    film = Film(path)
    facts = film.facts()
    count = facts["count"]
    if count < FEWEST:
        raise InputError(f"{path.name} has {count} frames, but tracking needs {FEWEST} or more: use a longer video")
    return Reel(path, facts["width"], facts["height"], facts["rate"], count, source=film)


def even_exposure(reel: Reel) -> tuple[Reel, list[str]]:
    """Return the video with each frame adjusted, in each colour, to the median brightness of the video. Also return a
    history line on the change of brightness, if any.

    Brightness is the median ratio of a frame to the median frame, so that moving objects have no influence while they
    cover less than half of the picture. A video of steady brightness is returned unchanged.
    """
    parts = np.array([p[:: reel.coarse, :: reel.coarse] for p in reel.pictures(SAMPLES)])
    probe = replace(reel, reference=np.median(parts, axis=0).astype(np.float32))
    gains = np.array([probe.gain(part) for part in parts])
    change = float(np.abs(gains - 1.0).max())
    if change <= STEADY:
        return reel, []
    return probe, [f"brightness changes by up to {100 * change:.0f} % and was compensated: lock the camera's exposure"]
