"""Base class for the options of all readers. It checks them and reports an unknown key or a wrong value in one
sentence.

Options of several files in one mapping: tables for the files whose names contain a text or match a pattern.

The options above the tables hold for all files; those of one table are added for its files::

    delimiter = ";"
    [files.track]                # of every file with "track" in its name
    length_unit = "mm"
    [files."*.tdms"]             # a pattern with * or ?
    pressure = ["counts"]
    [files.track_3]              # of several tables that fit, the one with the longest name holds
    rows = [0, 500]
"""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from pliant.errors import InputError, clipped, known_entries

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

class FileMapping(BaseModel):
    """Base class for the options of a reader, which cannot be changed after creation. Unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def load(cls, mapping: Mapping[str, Any] | None, name: str, what: str = "mapping for") -> Self:
        """Check the options `mapping` of the file `name` and return them as an object. If a key or value is wrong,
        raise InputError, which names the first wrong key.
        """
        try:
            return cls.model_validate(dict(mapping or {}))
        except ValidationError as error:
            first = error.errors()[0]
            key = clipped(".".join(map(str, first["loc"]))) or "as a whole"
            if first["type"] == "extra_forbidden":
                table = key.rpartition(".")[0]
                keys = ", ".join(known_entries(cls, first["loc"]))
                problem = f"unknown key {key!r}; the known keys{f' of {table}' * bool(table)} are {keys}"
            else:
                problem = f"{key}: {first['msg'].removeprefix('Value error, ')}"
            raise InputError(f"the {what} {name} is invalid: {problem}") from None


def shorten(names: Sequence[object], most: int = 20) -> str:
    """Return the first `most` names as a comma-separated text, with each name cut to 60 characters."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(str(name)[:60] for name in names[:most]) + more


class PressureChannels(FileMapping):
    """Names of the channels of a file that hold gauge pressure, with their unit."""

    channels: list[str]
    unit: str
    chamber: list[str] | None = None


KEY = "files"
DEEPEST = 8  # tables within tables


def options_of(path: Path, mapping: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the options of one file: those of the mapping outside its table `files`, and those of the table whose name
    fits the name of the file. Return None if there are none.

    Raises
    ------
    InputError
        When `files` does not consist of tables.
    """
    options = dict(mapping or {})
    for _ in range(DEEPEST):
        if KEY not in options:
            return options or None
        tables = options.pop(KEY)
        if not isinstance(tables, Mapping) or not all(isinstance(table, Mapping) for table in tables.values()):
            raise InputError(f"the mapping for {path.name}: {KEY} must hold a table for each kind of file, such as "
                             f"[{KEY}.track]")
        fitting = [str(name) for name in tables if fits(str(name), path)]
        options |= tables[max(fitting, key=len)] if fitting else {}
    raise InputError(f"the mapping for {path.name} has {KEY} within {KEY} {DEEPEST} times: write them side by side")


def fits(name: str, path: Path) -> bool:
    """Return whether a table of `files` holds for a file: the file's name matches the pattern `name` or contains it."""
    return fnmatchcase(path.name, name) if set(name) & set("*?[") else name in path.name


def joined_mappings(named: Sequence[tuple[str, Mapping[str, Any]]]) -> dict[str, Any] | None:
    """Return one mapping for several kinds of files from pairs of a name, as in `files`, and options. A pair with the
    name "" holds for the files that no name fits.

    Raises
    ------
    InputError
        When a name occurs twice.
    """
    if len(named) == 1 and not named[0][0]:
        return dict(named[0][1])
    names = [name for name, _ in named]
    if names.count("") > 1:
        raise InputError("several mappings have no name: state for which files each one is, as in --mapping "
                         "track=track.toml --mapping log=log.toml, where track and log are parts of the files' names")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two mappings are for files named {clipped(repeated[0])!r}: give one")
    return {KEY: {name or "*": dict(options) for name, options in named}} if named else None


def refuse_idle(mapping: Mapping[str, Any] | None, paths: Sequence[Path]) -> None:
    """Raise InputError if a table `files` of the mapping fits none of the files, since its name is then misspelt."""
    for name in (mapping or {}).get(KEY, {}):
        if name != "*" and not any(fits(str(name), path) for path in paths):
            raise InputError(f"the mapping is for files named {clipped(str(name))!r}, but no file is: "
                             f"{shorten([path.name for path in paths], 6)}; the name must be a part of a file's name")


def named_in(entry: Any) -> set[str]:
    """Return all texts in an entry of a mapping."""
    inner = entry.values() if isinstance(entry, Mapping) else entry if isinstance(entry, list) else ()
    return {entry} if isinstance(entry, str) else set().union(*(named_in(one) for one in inner))
