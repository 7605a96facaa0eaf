"""Draw the tracked shape over the frames, as a sheet of a few frames or as a video, to check the tracking."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np

from pliant.errors import InputError
from pliant.files import whole
from pliant.recording.camera import opencv
from pliant.video.reel import Reel

Array = np.ndarray
TILES, ACROSS, TILE = 12, 3, 560  # frames on a sheet, frames per row, and width of each in pixels
GAPS = 3  # number of gaps whose first frame is shown, too
FILM = 1280  # largest width of the video in pixels
LINE, EDGE, BASE, TIP, ALARM = (  # blue, green, red
    tuple(bytes.fromhex(colour)[::-1]) for colour in ("ff2828", "ffffff", "00a0ff", "ffc800", "ff963c")
)
ENDINGS = (".png", ".mp4")  # a sheet of pictures, a film
Draw = Callable[[float, Array, Array | None], None]


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


@contextmanager
def overlay(reel: Reel, paths: Sequence[Path]) -> Iterator[Draw]:
    """Create image or video files that show the tracked shape. Yield a function that draws the points of one frame over
    the frame's picture and adds this drawing to the files.

    The files appear only when the block ends without an error.
    """
    sheets, films = ([p for p in paths if p.suffix.lower() == ending] for ending in ENDINGS)
    sampled = set(np.linspace(0, reel.count - 1, TILES).round().astype(int).tolist()) if sheets else set()
    tiles: list[Array] = []
    size = _size(reel, FILM)
    with ExitStack() as stack:
        writers = [stack.enter_context(movie(film, reel.rate, size)) for film in films]
        number, gaps, hidden = 0, 0, False

        def draw(time: float, picture: Array, points: Array | None) -> None:
            nonlocal number, gaps, hidden
            begins, hidden = not hidden, points is None or not np.isfinite(points).all()
            gaps += begins and hidden
            if number in sampled or (sheets and begins and hidden and gaps <= GAPS):
                tiles.append(drawn(time, picture, points, _size(reel, TILE)))
            for write in writers:
                write(drawn(time, picture, points, size))
            number += 1

        yield draw
    for sheet in sheets:
        _write_sheet(tiles, sheet)


def _size(reel: Reel, most: int) -> tuple[int, int]:
    width = min(most, reel.width) // 2 * 2
    return width, round(width * reel.height / reel.width / 2) * 2


def drawn(time: float, picture: Array, points: Array | None, size: tuple[int, int]) -> Array:
    """Return the picture of a frame scaled to `size`, with the time and with S tracked points (S, 2) [pixels] drawn as
    a line.
    """
    cv2 = opencv("drawing on a video")
    canvas = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    share = size[0] / picture.shape[1]
    visible = np.empty((0, 2)) if points is None else points[np.isfinite(points).all(axis=1)]
    path = np.round(((visible + 0.5) * share - 0.5) * 16).astype(np.int32)
    if len(path) > 1:
        for colour, thick in ((EDGE, 4), (LINE, 2)):
            cv2.polylines(canvas, [path], isClosed=False, color=colour, thickness=thick, lineType=cv2.LINE_AA, shift=4)
    whole_line = points is not None and len(visible) == len(points)
    if 1 < len(path) <= 24:
        for x, y in path:
            cv2.circle(canvas, (int(x), int(y)), 80, EDGE, 2, cv2.LINE_AA, 4)
    elif len(path):
        for (x, y), colour in zip(path[[0, -1]], (BASE, TIP), strict=True):
            cv2.circle(canvas, (int(x), int(y)), 80, colour, 2, cv2.LINE_AA, 4)
    _write(canvas, f"{time:.3f} s", (8, 24), EDGE)
    if not whole_line:
        hidden = "gap" if points is None or not len(visible) else f"{len(points) - len(visible)} hidden"
        _write(canvas, hidden, (8, 50), ALARM)
    return np.asarray(canvas)


def _write(picture: Array, text: str, where: tuple[int, int], colour: tuple[int, ...]) -> None:
    cv2 = opencv("drawing on a video")
    for each, thick in (((0, 0, 0), 5), (colour, 2)):
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.6, each, thick, cv2.LINE_AA)


def _write_sheet(tiles: list[Array], path: Path) -> None:
    cv2 = opencv("drawing on a video")
    height, width, gap = *tiles[0].shape[:2], 6
    rows = -(-len(tiles) // ACROSS)
    canvas = np.full((rows * (height + gap) - gap, ACROSS * (width + gap) - gap, 3), 255, np.uint8)
    for k, tile in enumerate(tiles):
        y, x = k // ACROSS * (height + gap), k % ACROSS * (width + gap)
        canvas[y : y + height, x : x + width] = tile
    with whole(path) as draft:
        draft.write_bytes(cv2.imencode(".png", canvas)[1].tobytes())
