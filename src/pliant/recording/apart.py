"""Formats whose libraries a damaged file can end, or keep for ever: read in a process of their own, with limits.

HDF5 and MATLAB files hold addresses and lengths that their libraries follow: one wrong byte leads to memory that is
not theirs, or into a circle. Here that ends the helper, not the program, and becomes one sentence.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart_worker import MAGIC, Content

WORKER = Path(__file__).with_name("apart_worker.py")
SECONDS, BYTES_PER_SECOND = 4, 10e6  # time of the processor: a start, and what even a slow disk and inflating take
WAIT_FACTOR = 8  # by the clock on the wall: other programs want the processor too
MEMORY, MEMORY_FACTOR = 2**31, 40  # address space: a library's own, and a compressed file's content


def read_apart(kind: str, path: Path, what: str) -> Content:
    """Read the arrays of a file in a helper process.

    Parameters
    ----------
    kind : {"hdf5", "classic", "mat5", "mat73"}
    path : Path
    what : str
        Name of the format, for messages.

    Returns
    -------
    arrays, told
        Arrays by number; names, dimensions and attributes that belong to them.

    Raises
    ------
    InputError
        When the library refuses the file, ends, or takes more time or memory than any whole file of this size.
    """
    size = path.stat().st_size
    seconds = int(SECONDS + size / BYTES_PER_SECOND)
    command = [sys.executable, "-P", str(WORKER), kind, str(path.resolve()), str(seconds)]
    command.append(str(int(MEMORY + MEMORY_FACTOR * size)))
    damaged = f"{path.name} is no readable {what} file, or it is damaged"
    try:
        code, answer = _run(command, WAIT_FACTOR * seconds)
    except subprocess.TimeoutExpired:
        raise InputError(f"{damaged}: its library did not come to an end within {WAIT_FACTOR * seconds} s") from None
    except OSError as error:
        raise InputError(f"no helper process can be started to read {path.name}: {error.strerror or error}") from None
    if code or not answer.startswith(MAGIC):
        raise InputError(f"{damaged}: {_end(code, seconds)}")
    answer = answer[len(MAGIC) :]
    if answer.startswith(b"{"):
        raise InputError(f"{damaged}: {json.loads(answer)['reason']}")
    with np.load(io.BytesIO(answer), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    told: dict[str, Any] = json.loads(arrays.pop("told").tobytes())
    return arrays, told


def _run(command: list[str], seconds: int) -> tuple[int, bytes]:
    """Exit code and output of the helper; what every recording is made of is imported while it works."""
    with subprocess.Popen(  # noqa: S603  our own worker, no shell
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "HDF5_USE_FILE_LOCKING": "FALSE"},
    ) as helper:  # fmt: skip
        try:
            import_module("xarray")
            answer, _ = helper.communicate(timeout=seconds)
        finally:
            helper.kill()  # one that has not come to an end by now never may
    return helper.returncode, answer


def _end(code: int, seconds: int) -> str:
    if code == -24:  # SIGXCPU
        return f"its library did not come to an end within {seconds} s"
    return "its library ended while reading it"
