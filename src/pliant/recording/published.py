"""Access to published recordings of other laboratories: the path ``data:NAME/FILE`` names a file in a local folder.

`published.toml` lists the repository, commit, path and checksum of each file. The environment variable PLIANT_DATA
names the folder; its default is ``pliant/data`` in the user's cache folder. PLIANT_DATA_MIRROR may hold an address
(http, https or file) that serves the files as NAME/FILE.
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
    """A published file: its checksum and its address on the web, or how to download it by hand.

    Attributes
    ----------
    sha256 : str
        Checksum of the file.
    address : str
        Address of the file; empty where it must be downloaded by hand.
    by_hand : str
        How to download it by hand, where `address` is empty.
    """

    sha256: str
    address: str = ""
    by_hand: str = ""


@dataclass(frozen=True)
class DataSet:
    """A published data set: its files by name, with their origin and licence."""

    name: str
    what: str
    licence: str
    origin: str
    files: dict[str, Published]


@cache
def data_sets() -> dict[str, DataSet]:
    """Return all known published data sets by name."""
    table = tomllib.loads((Path(__file__).parent / "published.toml").read_text(encoding="utf-8"))
    catalogue = {}
    for name, entry in table.items():
        source = f"{entry['repository']}/raw/{entry['commit']}"
        files = {
            file: Published(f["sha256"], f"{source}/{quote(f['from'])}" if "from" in f else "", f.get("by_hand", ""))
            for file, f in entry["files"].items()
        }
        origin = f"{entry['repository']}, commit {entry['commit'][:7]}"
        catalogue[name] = DataSet(name, entry["what"], entry["licence"], origin, files)
    return catalogue


def data_set(name: str) -> DataSet:
    """Return the published data set with the name `name`; raise InputError, which lists the known names, where there is
    none.
    """
    if name not in data_sets():
        raise InputError(f"there is no public data set {clipped(name, 60)!r}: use one of {', '.join(data_sets())}")
    return data_sets()[name]


def data_folder() -> Path:
    """Return the local folder into which published recordings are downloaded; it may not exist yet."""
    if named := os.environ.get(FOLDER):
        return Path(named)
    import pooch

    return Path(pooch.os_cache("pliant")) / "data"


def published_path(text: str) -> Path:
    """Return the path of the local file that a text ``data:NAME/FILE`` names; raise InputError where it has not been
    downloaded.

    Raises
    ------
    InputError
        When there is no such recording, its file is not on this machine (the message says how to get it), or its
        checksum differs from that of the published file.
    """
    name, _, file = text.removeprefix(PREFIX).partition("/")
    known = data_set(name)
    if file not in known.files:
        raise InputError(f"{name} has no file {clipped(file, 60)!r}: choose one of {', '.join(known.files)}")
    path = data_folder() / name / file
    if not path.is_file():
        raise InputError(f"{text} is not on this machine: {how(known, file, path.parent)}")
    if not is_published(path, known.files[file]):
        raise InputError(f"{path} differs from the published file (checksum): delete it and run `pliant data fetch "
                         f"{name}`")
    return path


def how(known: DataSet, file: str, folder: Path) -> str:
    """Return the end of a sentence that says how to download a published file into its local folder."""
    f = known.files[file]
    if not f.address:
        return f"download it by hand ({f.by_hand}) and put it into {folder}"
    return f"run `pliant data fetch {known.name}`, or download {file} from {f.address} and put it into {folder}"


def is_published(path: Path, published: Published) -> bool:
    """Return whether the file at `path` has the checksum of the published file: complete and unchanged."""
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest() == published.sha256


def fetch(name: str, *, mirror: str | None = None) -> list[Path]:
    """Download the files of a published data set that are missing in the local folder, and return the paths of all its
    files.

    Parameters
    ----------
    name : str
    mirror : str, optional
        Address (https, http or file) that serves the files as NAME/FILE. Default: PLIANT_DATA_MIRROR, else the
        address of publication.

    Returns
    -------
    list of Path
        All files of the set, with verified checksums.

    Raises
    ------
    InputError
        When a file cannot be downloaded; the message names the file, its address, and the folder for a manual download.
    """
    known, mirror = data_set(name), mirror or os.environ.get(MIRROR)
    if mirror and urlparse(mirror).scheme not in SCHEMES:
        raise InputError(f"the address of a mirror must begin with https://, http:// or file://, not {mirror[:80]!r}")
    folder = data_folder() / name
    return [brought(known, file, folder, mirror) for file in known.files]


def brought(known: DataSet, file: str, folder: Path, mirror: str | None) -> Path:
    """Download one published file, from `mirror` or from its address, unless the local folder has it, and return its
    path.
    """
    import pooch

    published, path = known.files[file], folder / file
    if path.is_file() and is_published(path, published):
        return path
    address = f"{mirror.rstrip('/')}/{known.name}/{quote(file)}" if mirror else published.address
    if not address:
        raise InputError(f"{known.name}/{file} is not on this machine: {how(known, file, folder)}")
    pooch.get_logger().setLevel("WARNING")  # the command tells what it does
    downloader = copied if urlparse(address).scheme == "file" else None
    try:
        pooch.retrieve(address, f"sha256:{published.sha256}", fname=file, path=folder, downloader=downloader)
    except (OSError, ValueError) as error:  # no network, no such file, another checksum
        reason = " ".join(str(error).split())
        source = published.address or "where it was published"
        raise InputError(f"cannot download {file} from {address} ({clipped(reason, 120)}): download it by hand "
                         f"from {source} and put it into {folder}") from None  # fmt: skip
    return path


def copied(address: str, output: str, _pooch: object) -> None:
    """Copy the local file with the address ``file://...`` to the path `output`."""
    shutil.copyfile(unquote(urlparse(address).path), output)
