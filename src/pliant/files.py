"""Files are written whole or not at all; what a person wrote is read within bounds."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any

from pliant.errors import InputError, clipped

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]

DEEPEST, LONGEST_TEXT, LARGEST_FILE = 32, 4000, 20_000_000  # levels, characters, bytes
LARGEST_NUMBER = 1e300
PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""  # of a dotted key of TOML
LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){PART}(?:[ \t]*+\.[ \t]*+{PART}){{{DEEPEST}}}")
DRAFTS = ".pliant-draft-"  # what the names of draft folders begin with
ABANDONED = 86400.0  # s, after which a draft folder belongs to no process any more
SEAL = b"pliant-sha256 "
SEAL_BYTES = len(SEAL) + 64 + 1  # the digest and a line end


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A draft beside `path` to write to; it takes the place of `path` when all went well, and is removed otherwise."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def writable(folder: str | Path) -> Path:
    """Return the folder, made where it is absent; InputError where no file can be written into it."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # a name of its own: other runs may try the same folder
    except OSError as error:
        raise InputError(f"cannot write into the output folder {folder}: {error.strerror or error}") from None
    return folder


@contextmanager
def output_folder(folder: str | Path) -> Iterator[Path]:
    """Yield a folder to write to, made where it is absent; one that was made and is empty is removed after a failure.

    Raises
    ------
    InputError
        When no file can be written into it.
    """
    folder = Path(folder)
    absent = [part for part in (folder, *folder.parents) if not part.exists()]
    try:
        yield writable(folder)
    except BaseException:  # Ctrl-C among them
        for part in absent:
            with suppress(OSError):
                part.rmdir()
        raise


@contextmanager
def replaced_together(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Yield a draft folder whose files replace those of the same names in `folder`, as one set.

    The file of the last name marks a whole set: it is removed first and put in place last, so that a process killed at
    any moment leaves the old set, the new one, or no file of that name. No other file in `folder` is touched.

    Parameters
    ----------
    folder : Path
        Exists and can be written.
    names : sequence of str
        What will be in the draft folder.
    """
    for old in folder.glob(f"{DRAFTS}*"):  # of processes that were killed
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED:
                shutil.rmtree(old)
    try:
        with tempfile.TemporaryDirectory(prefix=DRAFTS, dir=folder, ignore_cleanup_errors=True) as made:
            draft = Path(made)
            yield draft
            for name in names:
                on_disk(draft / name)
            with alone_in(folder):
                (folder / names[-1]).unlink(missing_ok=True)
                for name in names:
                    (draft / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}") from None


def on_disk(path: Path) -> None:
    """Wait until a file's content is on the disk: else a power cut may leave its name without its content."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold a lock on a folder, where the system has such locks: two processes do not mix their files."""
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def seal(path: Path) -> None:
    """Append a checksum of its content to a file whose format knows its own end, such as HDF5."""
    with path.open("rb") as file:
        digest = file_digest(file, "sha256").hexdigest()
    with path.open("ab") as file:
        file.write(SEAL + digest.encode() + b"\n")


def seal_of(content: bytes | memoryview) -> bytes:
    """The checksum of bytes, as it stands behind them."""
    return SEAL + sha256(content).hexdigest().encode() + b"\n"


def is_sealed(path: Path) -> bool | None:
    """Whether a file keeps the checksum that it ends in; None where it ends in none.

    A damaged checksum is one: the HDF5 before it says where it ends itself.
    """
    with path.open("rb") as file:
        head = file.read(48)
        left = max(file.seek(0, os.SEEK_END) - SEAL_BYTES, 0)
        file.seek(left)
        end = file.read()
        if not end.startswith(SEAL) and left != hdf5_bytes(head):
            return None
        file.seek(0)
        digest = sha256()
        while left and (part := file.read(min(left, 1 << 22))):
            digest.update(part)
            left -= len(part)
    return end == SEAL + digest.hexdigest().encode() + b"\n"


def hdf5_bytes(head: bytes) -> int:
    """Bytes of an HDF5 file, as its superblock says; -1 of anything else.

    Source: HDF5 File Format Specification, version 3, section II.A (offsets of 8 bytes)
    """
    if not head.startswith(b"\x89HDF\r\n\x1a\n"):
        return -1
    at = {0: 40, 1: 44}.get(head[8], 28)
    return int.from_bytes(head[at : at + 8], "little")


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file atomically: the old content or the new, never half of it."""
    path = Path(path)
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return path


def read_entries(path: str | Path, what: str) -> Any:
    """The entries of a TOML or JSON file that a person wrote: a study, a mapping, a task.

    Parameters
    ----------
    path : str or Path
        ``.json`` is JSON, everything else TOML.
    what : str
        What the file is, for messages.

    Raises
    ------
    InputError
        When it cannot be read, is neither, or holds what no person writes: more than 32 levels, texts of more than 4000
        characters or with control characters, numbers beyond 1e300.
    """
    path = Path(path)
    kind = "JSON" if path.suffix == ".json" else "TOML"
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{what} {path} has {path.stat().st_size} bytes: no {what} is so large")
        text = path.read_text(encoding="utf-8")
        if kind == "TOML" and (key := LONG_KEY.search(text)):  # its reader takes the square of the parts in time
            raise InputError(f"{what} {path} has a key of more than {DEEPEST} parts: '{clipped(key.group(), 60)}'")
        content = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except OSError as error:
        raise InputError(f"cannot read the {what} {path}: {error.strerror or error}") from None
    except RecursionError:
        raise InputError(f"{what} {path} is nested deeper than {DEEPEST} levels") from None
    except ValueError as error:  # no UTF-8, no TOML, no JSON, an integer of thousands of digits, a NUL in the path
        if isinstance(error, InputError):
            raise
        raise InputError(f"{what} {clipped(str(path), 200)} is not valid {kind}: {clipped(str(error), 200)}") from None
    if problem := _problem(content):
        raise InputError(f"{what} {path} {problem}")
    return content


def _problem(content: Any) -> str:
    """Return the fault of a file's content in words, or "". Without recursion, since nesting is what is limited."""
    left = [(content, 0, "the whole")]
    while left:
        value, depth, where = left.pop()
        if depth > DEEPEST:
            return f"is nested deeper than {DEEPEST} levels at '{clipped(where)}'"
        if isinstance(value, dict):
            left += [(text, depth, f"the name of an entry in {where}") for text in value]
            left += [(item, depth + 1, str(name)) for name, item in value.items()]
        elif isinstance(value, list):
            left += [(item, depth + 1, where) for item in value]
        elif isinstance(value, str):
            if len(value) > LONGEST_TEXT:
                return f"holds a text of {len(value)} characters at '{clipped(where)}': at most {LONGEST_TEXT}"
            if any(ord(c) < 32 and c not in "\t\n\r" for c in value):
                return f"holds a control character in the text at '{clipped(where)}'"
        elif isinstance(value, (int, float)) and not abs(value) <= LARGEST_NUMBER:  # not a number compares false
            return f"holds a number that is none, or too large to be used, at '{clipped(where)}'"
    return ""
