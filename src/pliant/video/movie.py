"""Write a video file; a failed write leaves no partial file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from pliant.errors import InputError
from pliant.recording.camera import opencv

CODEC = "mp4v"  # MPEG-4: every build of OpenCV's wheels writes and reads it


@contextmanager
def movie(path: Path, rate: float, size: tuple[int, int]) -> Iterator[Callable[[np.ndarray], None]]:
    """Open a video file for writing and yield a function that appends one frame (H, W, 3) of H by W pixels in blue,
    green, red (uint8).

    The file appears under its name only when the block ends without an error.

    Parameters
    ----------
    path : Path
        File name that ends in .mp4.
    rate : float, Hz
    size : (width, height), pixels

    Raises
    ------
    InputError
        For another ending, a folder that cannot be written, or where OpenCV is not installed.
    """
    cv2 = opencv("writing a film")
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise InputError(f"a video is written as .mp4, not {path.name!r}: change the file name")
    draft = path.with_name(f".{path.stem}.{os.getpid()}.tmp.mp4")
    writer = cv2.VideoWriter(str(draft), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*CODEC), float(rate), size)
    try:
        if not writer.isOpened():
            raise InputError(f"cannot write a video to {path}: check that its folder exists and is writable")

        yield writer.write
        writer.release()
        draft.replace(path)
    finally:
        writer.release()
        with suppress(OSError):
            draft.unlink(missing_ok=True)
