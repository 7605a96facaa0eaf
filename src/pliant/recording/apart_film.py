"""Helper process that decodes a film by OpenCV and writes its frames to standard output.

A damaged film may crash the decoder or lead it to endless work or memory; here it ends the helper alone. Each line of
standard input asks for frames: ``all``, or their numbers separated by blanks. The answer is one record per frame, its
time [s] and its picture, and a record with the time NaN at the end.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any, BinaryIO

import cv2

from pliant.recording.apart_worker import STAMP, limit, write_header


def numbered(path: str, request: str) -> Iterator[tuple[float, Any]]:
    """Yield the time [s] and the picture (H, W, 3) of each requested frame of a film."""
    film = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    try:
        if request == "all":
            while True:
                complete, picture = film.read()
                if not complete:
                    return
                yield 1e-3 * film.get(cv2.CAP_PROP_POS_MSEC), picture
        for number in map(int, request.split()):
            film.set(cv2.CAP_PROP_POS_FRAMES, number)
            complete, picture = film.read()
            if complete:
                yield 1e-3 * film.get(cv2.CAP_PROP_POS_MSEC), picture
    finally:
        film.release()


def serve(out: BinaryIO, requests: Iterator[str], path: str) -> None:
    """Write the size, the rate [Hz] and the number of frames that a film states, then answer each line of requests."""
    film = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    complete, picture = film.read()
    rate, count = float(film.get(cv2.CAP_PROP_FPS)), film.get(cv2.CAP_PROP_FRAME_COUNT)
    film.release()
    if not complete or not rate > 0:
        write_header(out, {"reason": "it has no frame that can be decoded, or no frame rate"})
        return
    shape = picture.shape
    write_header(out, {"height": shape[0], "width": shape[1], "rate": rate, "count": max(int(count), 0)})
    out.flush()
    for request in requests:
        for time, frame in numbered(path, request.strip()):
            if frame.shape != shape:
                return  # the reader finds an answer without its end
            out.write(STAMP.pack(time))
            out.write(frame.data)
        out.write(STAMP.pack(float("nan")))
        out.flush()


def main() -> None:
    """Run the helper process. The command-line arguments are the path of the film, the limit of processor time [s] and
    that of memory [bytes].
    """
    path, seconds, memory = sys.argv[1:4]
    answer = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # a library that prints must not mix with the answer
    limit(int(seconds), int(memory))
    with os.fdopen(answer, "wb") as out:
        serve(out, iter(sys.stdin.readline, ""), path)
