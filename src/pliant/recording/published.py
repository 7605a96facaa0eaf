"""Recordings that other laboratories published: ``data:NAME/FILE`` means one of them, in a folder of this user.

`published.toml` has each file's repository, commit, path and checksum. The folder is the one that the environment
variable PLIANT_DATA names, else ``pliant/data`` among the user's caches; PLIANT_DATA_MIRROR may name an address, http,
https or file, under which the files lie as NAME/FILE.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from dataclasses import dataclass
from functools import cache
from hashlib import file_digest
from pathlib import Path
from urllib.parse import quote, unquote, urlparse

from pliant.errors import InputError, clipped

PREFIX = "data:"
FOLDER, MIRROR = "PLIANT_DATA", "PLIANT_DATA_MIRROR"
SCHEMES = ("https", "http", "file")


@dataclass(frozen=True)
class Published:
    """One published file.

    Attributes
    ----------
    sha256 : str
    address : str
        Where it was published; empty where it has to be brought by hand.
    by_hand : str
        How, in that case.
    """

    sha256: str
    address: str = ""
    by_hand: str = ""


@dataclass(frozen=True)
class DataSet:
    """Files of one origin, by name, under one licence."""

    name: str
    what: str
    licence: str
    origin: str
    files: dict[str, Published]


@cache
def data_sets() -> dict[str, DataSet]:
    """All known data sets by name."""
    table = tomllib.loads((Path(__file__).parent / "published.toml").read_text(encoding="utf-8"))
    made = {}
    for name, entry in table.items():
        at = f"{entry['repository']}/raw/{entry['commit']}"
        files = {
            file: Published(f["sha256"], f"{at}/{quote(f['from'])}" if "from" in f else "", f.get("by_hand", ""))
            for file, f in entry["files"].items()
        }
        origin = f"{entry['repository']}, commit {entry['commit'][:7]}"
        made[name] = DataSet(name, entry["what"], entry["licence"], origin, files)
    return made


def data_set(name: str) -> DataSet:
    """One data set; InputError lists them where there is none of this name."""
    if name not in data_sets():
        raise InputError(f"no public recordings are called {clipped(name, 60)!r}: use one of {', '.join(data_sets())}")
    return data_sets()[name]


def data_folder() -> Path:
    """The folder of this user's public recordings; it need not exist."""
    if named := os.environ.get(FOLDER):
        return Path(named)
    import pooch

    return Path(pooch.os_cache("pliant")) / "data"


def published_path(text: str) -> Path:
    """The file that ``data:NAME/FILE`` means.

    Raises
    ------
    InputError
        When there is no such recording, or its file is not on this machine (it says how it comes there), or is another
        than the one that was published.
    """
    name, _, file = text.removeprefix(PREFIX).partition("/")
    known = data_set(name)
    if file not in known.files:
        raise InputError(f"{name} has no file {clipped(file, 60)!r}: it has {', '.join(known.files)}")
    path = data_folder() / name / file
    if not path.is_file():
        raise InputError(f"{text} is not on this machine: {how(known, file, path.parent)}")
    if not is_published(path, known.files[file]):
        raise InputError(f"{path} is not the file that was published, its checksum differs: remove it and fetch again")
    return path


def how(known: DataSet, file: str, folder: Path) -> str:
    """Return how a file gets into its folder."""
    f = known.files[file]
    if not f.address:
        return f"it has to be brought by hand ({f.by_hand}); put it into {folder}"
    return f"run `pliant data fetch {known.name}`, or without a network put {file} from {f.address} into {folder}"


def is_published(path: Path, published: Published) -> bool:
    """Whether a file has the checksum of the published one."""
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest() == published.sha256


def fetch(name: str, *, mirror: str | None = None) -> list[Path]:
    """Bring the files of a data set that are not here yet.

    Parameters
    ----------
    name : str
    mirror : str, optional
        Address (https, http or file) under which they lie as NAME/FILE; default: PLIANT_DATA_MIRROR, else where they
        were published.

    Returns
    -------
    list of Path
        All files of the set, each with the checksum of the published one; what could not be checked is not kept.

    Raises
    ------
    InputError
        When a file cannot be brought; it says which, from where, and where to put it by hand.
    """
    known, mirror = data_set(name), mirror or os.environ.get(MIRROR)
    if mirror and urlparse(mirror).scheme not in SCHEMES:
        raise InputError(f"a mirror is an address that begins with https://, http:// or file://, not {mirror[:80]!r}")
    folder = data_folder() / name
    return [brought(known, file, folder, mirror) for file in known.files]


def brought(known: DataSet, file: str, folder: Path, mirror: str | None) -> Path:
    """One file, from this machine, a mirror, or where it was published."""
    import pooch

    published, path = known.files[file], folder / file
    if path.is_file() and is_published(path, published):
        return path
    address = f"{mirror.rstrip('/')}/{known.name}/{quote(file)}" if mirror else published.address
    if not address:
        raise InputError(f"{known.name}/{file} is not on this machine: {how(known, file, folder)}")
    pooch.get_logger().setLevel("WARNING")  # the command tells what it does
    own = copied if urlparse(address).scheme == "file" else None
    try:
        pooch.retrieve(address, f"sha256:{published.sha256}", fname=file, path=folder, downloader=own)
    except (OSError, ValueError) as error:  # no network, no such file, another checksum
        reason = " ".join(str(error).split())
        source = published.address or "where it was published"
        raise InputError(f"{file} could not be brought from {address} ({clipped(reason, 120)}): put it into {folder} "
                         f"by hand, from {source}") from None  # fmt: skip
    return path


def copied(address: str, output: str, _pooch: object) -> None:
    """Bring a file from a folder that a ``file://`` address names."""
    shutil.copyfile(unquote(urlparse(address).path), output)
