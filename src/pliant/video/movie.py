"""Writing a film: whole or not at all."""

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
    """Takes frames (H, W, 3), uint8, blue green red; the file is there when all went well.

    Parameters
    ----------
    path : Path
        Ends in .mp4.
    rate : float, Hz
    size : (width, height), pixels

    Raises
    ------
    InputError
        For another ending, a folder that cannot be written, or without OpenCV.
    """
    cv2 = opencv("writing a film")
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise InputError(f"a film is written as .mp4, not {path.name!r}")
    draft = path.with_name(f".{path.stem}.{os.getpid()}.tmp.mp4")
    writer = cv2.VideoWriter(str(draft), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*CODEC), float(rate), size)
    try:
        if not writer.isOpened():
            raise InputError(f"cannot write a film to {path}: is its folder there?")

        yield writer.write
        writer.release()
        draft.replace(path)
    finally:
        writer.release()
        with suppress(OSError):
            draft.unlink(missing_ok=True)
