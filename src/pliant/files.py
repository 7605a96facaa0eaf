"""Functions that write files atomically, and read files within limits: regular files of a limited size alone, and TOML
and JSON of a limited nesting depth.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from hashlib import file_digest, sha256
from io import BufferedReader
from pathlib import Path
from typing import Any, NamedTuple

from pliant.errors import InputError, clipped

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]

DEEPEST, LONGEST_TEXT, LARGEST_FILE = 32, 4000, 20_000_000  # levels, characters, bytes
LARGEST_TABLE = 2_000_000_000  # bytes of a table of numbers, such as a recording or a log
SPECIAL = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}
LARGEST_NUMBER = 1e300
PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""  # of a dotted key of TOML
LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){PART}(?:[ \t]*+\.[ \t]*+{PART}){{{DEEPEST}}}")
DRAFTS = ".pliant-draft-"  # start of the names of temporary folders
ABANDONED = 86400.0  # s, after which a temporary folder is left over from a killed process
SEAL = b"pliant-sha256 "
SEAL_BYTES = len(SEAL) + 64 + 1  # the digest and a line end


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Context manager that yields a temporary file, which replaces the file `path` if the block succeeds.

    If the block fails, the temporary file is removed.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {reason_of(error)}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def reason_of(error: OSError) -> str:
    """Return the system's description of an error, also of one that the HDF5 library reports inside a text of its own,
    such as ``No space left on device``.
    """
    inside = re.search(r"error message = '([^']*)'", str(error))
    return error.strerror or (inside[1] if inside else str(error))


def writable(folder: str | Path) -> Path:
    """Return `folder` as a Path, created if it is absent; raise InputError if no file can be written into it."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # a name of its own: other runs may try the same folder
    except OSError as error:
        raise InputError(
            f"cannot write into the output folder {folder}: {error.strerror or error}; choose another folder"
        ) from None
    return folder


@contextmanager
def output_folder(folder: str | Path) -> Iterator[Path]:
    """Context manager that yields an output folder, created if absent and removed after an error if it is still empty.

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
    """Context manager that yields a temporary folder, whose files then replace those of the same names in `folder`, all
    or none.

    The file with the last name marks a complete set. It is removed first and written last, so that a process killed at
    any moment leaves the old set, the new set, or no file of that name. Other files in `folder` are not touched.

    Parameters
    ----------
    folder : Path
        An existing folder that can be written to.
    names : sequence of str
        Names of the files that the block writes into the temporary folder.
    """
    for old in folder.glob(f"{DRAFTS}*"):  # left over from processes that were killed
        with suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED:
                shutil.rmtree(old)
    try:
        with tempfile.TemporaryDirectory(prefix=DRAFTS, dir=folder, ignore_cleanup_errors=True) as temporary:
            draft = Path(temporary)
            yield draft
            for name in names:
                on_disk(draft / name)
            with alone_in(folder):
                (folder / names[-1]).unlink(missing_ok=True)
                for name in names:
                    (draft / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {reason_of(error)}") from None


def on_disk(path: Path) -> None:
    """Wait until the content of the file `path` is physically stored on the disk.

    Otherwise a power cut may leave the file's name without its content.
    """
    with path.open("rb+") as file:
        os.fsync(file.fileno())


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Context manager that locks a folder, so that two processes do not mix their files. It needs a system with file
    locks and does nothing on others.
    """
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
    """Append a SHA-256 checksum to a file of a format that ignores additional bytes at its end, such as HDF5."""
    with path.open("rb") as file:
        digest = file_digest(file, "sha256").hexdigest()
    with path.open("ab") as file:
        file.write(SEAL + digest.encode() + b"\n")


def seal_of(content: bytes | memoryview) -> bytes:
    """Return the line with the SHA-256 checksum of `content` that `seal` appends to a file."""
    return SEAL + sha256(content).hexdigest().encode() + b"\n"


def is_sealed(path: Path) -> bool | None:
    """Return True if a file matches the checksum appended to it, False if it does not, and None if it has no checksum.

    A damaged checksum counts as one: the header of an HDF5 file says where its content ends, so that more bytes are
    expected to be a checksum.
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
    """Return the size [bytes] of an HDF5 file as stated in its first bytes `head`, or -1 for another format.

    Source: HDF5 File Format Specification, version 3, section II.A (offsets of 8 bytes)
    """
    if not head.startswith(b"\x89HDF\r\n\x1a\n"):
        return -1
    offset = {0: 40, 1: 44}.get(head[8], 28)
    return int.from_bytes(head[offset : offset + 8], "little")


def write_new(path: str | Path, text: str, mode: int = 0o666) -> Path:
    """Write `text` to a file that does not exist yet, atomically: after an error there is no such file.

    Parameters
    ----------
    path : str or Path
    text : str
    mode : int
        Permissions, from which those of the process's umask are taken.

    Raises
    ------
    InputError
        When the file exists, also if another process has written it meanwhile, or cannot be written.
    """
    path = Path(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        draft.touch(mode)
        draft.write_text(text, encoding="utf-8")
        try:
            os.link(draft, path)  # unlike a replacement, it fails if the file exists
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            path.touch(exist_ok=False)
            draft.replace(path)
    except FileExistsError:
        raise InputError(
            f"{path} exists already and is not overwritten: choose another name, or remove it first"
        ) from None
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
    return path


def write_text(path: str | Path, text: str) -> Path:
    """Write `text` to the file `path`, atomically: a killed process leaves the old content or the new."""
    path = Path(path)
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return path


@contextmanager
def regular_file(path: str | Path, what: str) -> Iterator[BufferedReader]:
    """Context manager that opens a regular file for reading. Pipes, devices and sockets are refused before they are
    opened, because reading them may never end.

    Parameters
    ----------
    path : str or Path
    what : str
        Kind of the file for error messages, such as "study".

    Raises
    ------
    InputError
        When the path is a pipe, a device or a socket.
    OSError
        When the file cannot be opened.
    """
    refuse_special(path, Path(path).stat().st_mode, what)
    with open(path, "rb", opener=without_waiting) as file:
        refuse_special(path, os.fstat(file.fileno()).st_mode, what)  # it may have been replaced meanwhile
        yield file


def without_waiting(path: str, flags: int) -> int:
    """Open a file as `os.open` does, without waiting for the writer of a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def refuse_special(path: str | Path, mode: int, what: str) -> None:
    """Raise InputError if the mode of a file is that of a pipe, a device or a socket."""
    if special := SPECIAL.get(stat.S_IFMT(mode)):
        raise InputError(
            f"cannot read the {what} {path}: it is {special}; save its content to a file and name this file"
        )


def content_of(path: str | Path, what: str, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a regular file of at most `largest` bytes.

    Parameters
    ----------
    path : str or Path
    what : str
        Kind of the file for error messages, such as "study".
    largest : int
        Largest size, bytes.

    Raises
    ------
    InputError
        When the file cannot be read, is a pipe or a device, or is larger.
    """
    try:
        with regular_file(path, what) as file:
            size = os.fstat(file.fileno()).st_size
            content = file.read(largest + 1) if size <= largest else b""
    except OSError as error:
        raise InputError(f"cannot read the {what} {path}: {error.strerror or error}") from None
    size = max(size, len(content))  # some files of the system state 0
    if size > largest:
        raise InputError(f"{what} {path} has {size} bytes: at most {largest} are read; make the file smaller")
    return content


def read_entries(path: str | Path, what: str) -> Any:
    """Return the content of a TOML or JSON file written by a user, such as a study, a column mapping or a control task.

    Parameters
    ----------
    path : str or Path
        A file that ends in ``.json`` is read as JSON, any other as TOML.
    what : str
        Kind of the file for error messages, such as "study".

    Raises
    ------
    InputError
        When the file cannot be read, is not valid TOML or JSON, or exceeds a limit: 20 MB, 32 levels of nesting, texts
        of 4000 characters, numbers of 1e300. Control characters in a text are refused too.
    """
    path = Path(path)
    kind = "JSON" if path.suffix == ".json" else "TOML"
    try:
        text = content_of(path, what).decode("utf-8").replace("\r\n", "\n")
        if kind == "TOML" and (key := LONG_KEY.search(text)):  # the time to read a key grows as the square of its parts
            raise InputError(
                f"{what} {path} has a key of more than {DEEPEST} parts: '{clipped(key.group(), 60)}'; shorten it"
            )
        content = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except RecursionError:
        raise InputError(
            f"{what} {path} is nested deeper than {DEEPEST} levels: use fewer levels of tables and lists"
        ) from None
    except ValueError as error:  # no UTF-8, no TOML, no JSON, an integer of thousands of digits, a NUL in the path
        if isinstance(error, InputError):
            raise
        raise InputError(f"{what} {clipped(str(path), 200)} is not valid {kind}: {clipped(str(error), 200)}") from None
    if problem := _problem(content):
        raise InputError(f"{what} {path} {problem}")
    return content


def _problem(content: Any) -> str:
    """Return the fault of a file's content in words, or "".

    It uses no recursion, since the depth of nesting is what it limits.
    """
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
        elif isinstance(value, (int, float)) and not abs(value) <= LARGEST_NUMBER:  # true for NaN too
            return f"holds a number that is NaN or larger than {LARGEST_NUMBER:g} at '{clipped(where)}'"
    return ""


class FileKind(NamedTuple):
    """A kind of file: its name in a sentence, and what to do with it."""

    name: str
    use: str


MODEL = FileKind("a model", "pass it to `pliant simulate`, `pliant view` or `pliant export`, or as --model to `pliant "
                 "estimate`, `pliant contact` or `pliant sweep`")  # fmt: skip
METRICS = FileKind("the metrics of a run", "the model of that run is model.json in the same folder, and `pliant "
                   "figures` takes the folder")  # fmt: skip
STUDY = FileKind("a study", "run it by `pliant run`, which writes the model and the report")
SWEEP = FileKind("a sweep", "pass it to `pliant sweep`, with --model")
MAPPING = FileKind("a mapping, which describes the columns of a table", "pass it with --mapping")
RECORDING = FileKind("a recording", "look at it by `pliant inspect`, and write a study for it by `pliant new "
                     "STUDY.toml --from FILE`")  # fmt: skip
ENTRIES = (".toml", ".json")
RECORDINGS = (".csv", ".tsv", ".trc", ".txt", ".dat", ".log", ".nc", ".nc4", ".cdf", ".h5", ".hdf5", ".c3d", ".npz",
              ".mat", ".lvm", ".tdms", ".mcap", ".db3")  # fmt: skip


def kind_of_file(path: Path) -> FileKind | None:
    """Return the kind of a file by its entries (TOML, JSON) or else by its ending; None if it shows neither."""
    suffix = path.suffix.lower()
    if suffix in RECORDINGS:
        return RECORDING
    if suffix not in ENTRIES or not path.is_file():
        return None
    try:
        content = read_entries(path, "file")
    except InputError:
        return None
    return kind_of_entries(content) if isinstance(content, Mapping) else None


def kind_of_entries(content: Mapping[str, Any]) -> FileKind | None:
    """Return the kind of a TOML or JSON file with these entries; None if they show none."""
    schema = str(content.get("schema_name", content.get("schema")))
    if schema == "pliant-metrics":
        return METRICS
    if schema == "pliant-model" or "link_length" in content:
        return MODEL
    if {"recordings", "actuator", "fits"} & set(content):
        return STUDY
    if set(content) == {"sweep"}:
        return SWEEP
    return MAPPING if {"points", "stations", "length_unit", "pressure", "delimiter"} & set(content) else None


def refuse_other(path: Path, wanted: FileKind) -> None:
    """Raise InputError if a file is of another kind than `wanted`; the message says which command takes it."""
    kind = kind_of_file(path)
    if kind not in (None, wanted):
        raise InputError(f"{path} is {kind.name}, not {wanted.name}: {kind.use}")
