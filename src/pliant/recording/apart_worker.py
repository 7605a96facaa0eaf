"""Helper process that reads one file with a library and writes its arrays to standard output. A crash of the library
then stops no other process.

The process imports the library, then limits its own time and memory, and then opens the file.
"""

from __future__ import annotations

import json
import os
import struct
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MAGIC = b"pliant-arrays\n"
LENGTH_BYTES = 8  # of the header that follows MAGIC
STAMP = struct.Struct("<d")  # time of a frame of a film
Content = tuple[dict[str, np.ndarray], dict[str, Any]]

READ = {  # kind of file -> module with `read(path)`; a module loads its library when it is imported
    "hdf5": "pliant.recording.apart_hdf5",
    "c3d": "pliant.recording.apart_c3d",
    "mat5": "pliant.recording.apart_mat5",
    "tdms": "pliant.recording.apart_tdms",
    "bag": "pliant.recording.apart_bag",
}
CONTENT, CONTENT_FACTOR = 2**26, 40  # bytes that a file may hold: a small file, and for each byte of a compressed one
WORKING = 2**28  # bytes of address space beside the content: buffers of a library
UNKNOWN_BASE = 2**31  # address space of the process before it reads, where the system does not say it


class Refused(ValueError):
    """Error for a file that may be intact but holds content that pliant does not read. Its text is a full sentence
    that follows the file name and a colon.
    """


def content_bound(size: int) -> int:
    """Return the largest total size [bytes] of arrays that is accepted from a file of `size` bytes, which may be
    compressed.
    """
    return CONTENT + CONTENT_FACTOR * size


def limit(seconds: int, memory: int) -> None:
    """Limit the processor time [s] and the memory [bytes] of the running process; without effect on Windows."""
    try:
        import resource
    except ImportError:
        return
    memory += address_space()
    for kind, most in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
        try:
            hard = resource.getrlimit(kind)[1]
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (bound, hard))
        except (OSError, ValueError):  # macOS does not limit the address space
            continue


def address_space() -> int:
    """Return the current size [bytes] of the address space of the running process, libraries included."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return UNKNOWN_BASE


def plain_attributes(attributes: dict[Any, Any]) -> dict[str, Any]:
    """Return the attributes of a data set with all values converted to numbers, texts or arrays that JSON can
    represent.
    """
    plain = {}
    for key, value in attributes.items():
        if isinstance(value, (np.ndarray, np.generic)) and not isinstance(value, (bytes, str)):
            item = {"array": value.tolist(), "dtype": str(value.dtype)} if np.ndim(value) else value.item()
        else:
            item = value if isinstance(value, (bytes, str, int, float, bool)) else str(value)
        plain[str(key)] = text_of(item) if isinstance(item, bytes) else item
    return plain


def text_of(text: bytes) -> str:
    """Decode bytes as UTF-8 text, or as Latin-1 where they are not valid UTF-8."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def without_objects(values: np.ndarray) -> np.ndarray:
    """Return an array in which Python objects, such as strings of variable length, are converted to text."""
    if not values.dtype.hasobject:
        return values
    return np.array([v.decode() if isinstance(v, bytes) else str(v) for v in values.ravel()]).reshape(values.shape)


def write_answer(out: BinaryIO, arrays: dict[str, np.ndarray], facts: dict[str, Any]) -> None:
    """Write the arrays of a file, and a dict of facts about them, to the binary stream `out`, from which `read_answer`
    reads them.

    The header lists the name, type and shape of each array.
    """
    listed = [[name, array.dtype.str, list(array.shape)] for name, array in arrays.items()]
    write_header(out, {"facts": facts, "arrays": listed})
    out.writelines(array.tobytes() for array in arrays.values())


def write_header(out: BinaryIO, content: dict[str, Any]) -> None:
    """Write the start of an answer to the binary stream `out`, with a dict as JSON."""
    header = json.dumps(content, default=_unknown).encode()
    out.write(MAGIC + len(header).to_bytes(LENGTH_BYTES, "little") + header)


def _unknown(value: Any) -> str:
    """Replace a value that JSON cannot store, such as bytes within an array of attributes."""
    return text_of(value) if isinstance(value, bytes) else str(value)


def read_answer(answer: bytes) -> Content | dict[str, Any]:
    """Decode the output of the helper process, and return the arrays of the file and the dict of facts about them. If
    the process could not read the file, return a dict with the reason instead.
    """
    start = len(MAGIC) + LENGTH_BYTES
    end = start + int.from_bytes(answer[len(MAGIC) : start], "little")
    header: dict[str, Any] = json.loads(answer[start:end])
    if "reason" in header:
        return header
    arrays = {}
    for name, kind, shape in header["arrays"]:
        dtype = np.dtype(kind)
        count = int(np.prod(shape, dtype=np.int64))
        values = np.frombuffer(answer, dtype, count, end) if count and dtype.itemsize else np.zeros(count, dtype)
        arrays[name] = values.reshape(shape).copy()
        end += values.nbytes
    return arrays, header["facts"]


def answer_to(out: BinaryIO, kind: str, path: str, seconds: int, memory: int, named: Sequence[str] = ()) -> None:
    """Read a file, of some kinds the parts `named` in it, under limits on time [s] and memory [bytes], and write its
    arrays, or the reason of a failure, to the binary stream `out`.
    """
    read = import_module(READ[kind]).read
    limit(seconds, memory)
    try:
        arrays, facts = read(path, *named)
    except BaseException as error:  # noqa: BLE001  whatever a library raises is one reason
        reason = str(error).split("\n")[0] or type(error).__name__
        write_header(out, {"reason": reason[:200], "refused": isinstance(error, Refused)})
    else:
        write_answer(out, arrays, facts)


def main() -> None:
    """Run the helper process: read one file and write its arrays to standard output. The command-line arguments are the
    kind of library, the path, the time limit [s], the memory limit [bytes] and the parts to read.
    """
    kind, path, seconds, memory, *named = sys.argv[1:]
    answer = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # a library that prints must not mix with the answer
    with os.fdopen(answer, "wb") as out:
        answer_to(out, kind, path, int(seconds), int(memory), named)
