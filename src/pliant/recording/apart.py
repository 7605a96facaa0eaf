"""Read files in a separate process with limits on time and memory, for formats whose libraries may crash.

HDF5, MATLAB and C3D files hold addresses and lengths that their libraries follow: one wrong byte may lead to invalid
memory access or an endless loop. In the helper process this ends the helper alone, and becomes one error message.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pliant.errors import InputError
from pliant.recording.apart_worker import MAGIC, WORKING, content_bound, read_answer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pliant.recording.apart_worker import Content

SOURCES = str(Path(__file__).parents[2])  # the folder that holds pliant; no other package is looked for there
START = """import sys
sys.path.insert(0, sys.argv.pop(1))
import pliant
del sys.path[0]
from importlib import import_module
import_module(sys.argv.pop(1)).main()"""
SECONDS, BYTES_PER_SECOND = 4, 10e6  # processor time: start of the process, and decompression even from a slow disk
WAIT_FACTOR = 8  # wall-clock time per processor time: other programs use the processor too
COPIES = 2  # of the content in memory at a time: as stored and as read
ENVIRONMENT = {  # one thread; no lock files; no library that a filter's number would load; no film from the network
    "OPENBLAS_NUM_THREADS": "1", "HDF5_USE_FILE_LOCKING": "FALSE", "HDF5_PLUGIN_PRELOAD": "::",
    "OPENCV_FFMPEG_CAPTURE_OPTIONS": "protocol_whitelist;file", "OPENCV_LOG_LEVEL": "SILENT",
}  # fmt: skip
RECOVER = {".mcap": " (mcap recover writes what is whole of a recording that was cut)"}


def read_apart(kind: str, path: Path, what: str, named: Sequence[str] = ()) -> Content:
    """Read the arrays of a file in a separate process with limits on time and memory, so that a damaged file cannot
    crash the calling process.

    Parameters
    ----------
    kind : {"hdf5", "c3d", "mat5", "tdms", "bag"}
        Key of `pliant.recording.apart_worker.READ`, which selects the library.
    path : Path
    what : str
        Name of the format, for messages.
    named : sequence of str
        Topics of a bag whose arrays of numbers are read.

    Returns
    -------
    arrays, facts
        Arrays by key; a dict with their names, dimensions and attributes, as the worker of this kind returns it.

    Raises
    ------
    InputError
        When the library rejects the file, crashes, or takes more time or memory than any intact file of this size.
    """
    size = sum(f.stat().st_size for f in path.iterdir()) if path.is_dir() else path.stat().st_size
    seconds = int(SECONDS + size / BYTES_PER_SECOND)
    damaged = f"{path.name} cannot be read as {what}; it may be damaged, so copy or export it again"
    damaged += RECOVER.get(path.suffix.lower(), "")
    try:
        code, answer = run_helper(kind, path, seconds, WORKING + COPIES * content_bound(size), named)
    except subprocess.TimeoutExpired:
        raise InputError(f"{damaged}: its library did not finish within {WAIT_FACTOR * seconds} s") from None
    except OSError as error:
        raise InputError(f"cannot start a helper process to read {path.name}: {error.strerror or error}") from None
    if code or not answer.startswith(MAGIC):
        raise InputError(f"{damaged}: {_end(code, seconds)}")
    try:
        content = read_answer(answer)
    except (ValueError, KeyError, TypeError):  # a library that wrote over the memory of its process
        raise InputError(f"{damaged}: {_end(1, seconds)}") from None
    if isinstance(content, dict):
        start = f"{path.name}: " if content["refused"] else f"{damaged}: "
        raise InputError(f"{start}{content['reason']}")
    return content


def start_helper(module: str, arguments: Sequence[str], stdin: int = subprocess.DEVNULL) -> subprocess.Popen[bytes]:
    """Start a helper process that runs the function `main` of a module of pliant, and return it."""
    return subprocess.Popen(  # noqa: S603  our own worker, no shell
        [sys.executable, "-P", "-c", START, SOURCES, module, *arguments], stdin=stdin, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, env={**os.environ, **ENVIRONMENT},
    )  # fmt: skip


def run_helper(kind: str, path: Path, seconds: int, memory: int, named: Sequence[str]) -> tuple[int, bytes]:
    """Run the helper process that reads a file, and return its exit code and its output as bytes."""
    arguments = [kind, str(path.resolve()), str(seconds), str(memory), *named]
    with start_helper("pliant.recording.apart_worker", arguments) as helper:
        try:
            import_module("xarray")
            answer, _ = helper.communicate(timeout=WAIT_FACTOR * seconds)
        finally:
            helper.kill()  # one that has not come to an end by now never may
    return helper.returncode, answer


def _end(code: int, seconds: int) -> str:
    if code == -24:  # SIGXCPU
        return f"its library did not finish within {seconds} s"
    return "its library crashed while reading it"
