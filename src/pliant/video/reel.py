"""Reading a film frame by frame, with the time that its container gives each frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import opencv

Array = np.ndarray
FEWEST = 8  # frames in which a motion can be seen


@dataclass(frozen=True)
class Reel:
    """A film, opened: its size in pixels, rate in Hz, and how many frames it announces."""

    path: Path
    width: int
    height: int
    rate: float
    count: int

    def frames(self) -> Iterator[tuple[float, Array]]:
        """Time [s] and picture (H, W, 3), uint8, blue green red, of each frame, one at a time."""
        with _opened(self.path) as (cv2, film):
            while True:
                whole, picture = film.read()
                if not whole:
                    return
                yield 1e-3 * film.get(cv2.CAP_PROP_POS_MSEC), picture

    def sampled(self, count: int, width: int) -> Array:
        """(K, h, w, 3) uint8: so many frames or fewer, evenly over the film, made small."""
        with _opened(self.path) as (cv2, film):
            size = (width, max(1, round(self.height * width / self.width)))
            made = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in self._some(cv2, film, count)]
        return np.array(made)

    def pictures(self, count: int) -> Iterator[Array]:
        """The frames that `sampled` shows, as they are, one at a time."""
        with _opened(self.path) as (cv2, film):
            yield from self._some(cv2, film, count)

    def _some(self, cv2: Any, film: Any, count: int) -> Iterator[Array]:
        for frame in np.unique(np.linspace(0, self.count - 1, count).astype(int)).tolist():
            film.set(cv2.CAP_PROP_POS_FRAMES, frame)
            whole, picture = film.read()
            if whole:
                yield picture


def open_reel(path: Path) -> Reel:
    """Open a film.

    Raises
    ------
    InputError
        When it is absent, no film that OpenCV reads, or has too few frames.
    """
    if not path.is_file():
        raise InputError(f"no video can be read from {path}: it is {'a folder' if path.is_dir() else 'absent'}")
    with _opened(path) as (cv2, film):
        whole, picture = film.read()
        rate, count = float(film.get(cv2.CAP_PROP_FPS)), int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    if not whole or not rate > 0:
        raise InputError(f"{path.name} is no video that OpenCV can read, or it is damaged: MP4 is always read")
    if count < FEWEST:
        raise InputError(f"{path.name} has {count} frames: a motion needs {FEWEST} or more")
    return Reel(path, picture.shape[1], picture.shape[0], rate, count)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    cv2 = opencv("a video")
    film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        yield cv2, film
    finally:
        film.release()
