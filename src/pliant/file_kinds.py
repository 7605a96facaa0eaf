"""What a file is, for messages about a file given to the wrong command: its kind, and the commands that take it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pliant.errors import InputError
from pliant.files import read_entries


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
RECORDINGS = (".csv", ".tsv", ".txt", ".dat", ".log", ".nc", ".nc4", ".cdf", ".h5", ".hdf5", ".c3d", ".npz", ".mat",
              ".lvm", ".tdms", ".mcap", ".db3")  # fmt: skip


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
