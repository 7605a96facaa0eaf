"""Functions by which commands read recordings, and the numbers and inputs in their options."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.terminal import busy, in_unit
from pliant.errors import InputError
from pliant.files import read_entries
from pliant.units import inputs_word, number_in, shown_in

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from pliant.model import Model
    from pliant.simulation import BaseMotion

LEVELS = "kPa gauge, or N, mm or rad of a tendon; for several inputs one each, as 80,30, or as left=80 (others: 0)"
MAPPING = "TOML file with columns, units and format. For several kinds of files: NAME=FILE each, NAME in their names."
DRIVE = "For several inputs: which recorded input drives which, as left=p1,right=p2; default: by equal names."

BaseFile = Annotated[Path | None, typer.Option(
    "--base", help="Motion of the base: poses over time, such as t_s, x_m, y_m, angle_deg, or t_s, x_m, y_m, z_m, qx, "
                   "qy, qz, qw in space; relative to the first pose.",
)]  # fmt: skip
BaseMapping = Annotated[list[str] | None, typer.Option(
    "--base-mapping", metavar="<path>", help="TOML file with columns and units of --base.",
)]  # fmt: skip
BaseCutoff = Annotated[float | None, typer.Option(
    "--base-cutoff-hz", parser=in_unit("Hz"), show_default="none",
    help="Frequency of which half passes the smoothing of noisy poses, Hz.",
)]  # fmt: skip


def base_motion(path: Path | None, model: Model, mapping: list[str] | None, cutoff: float | None) -> BaseMotion | None:
    """Return the motion of a base that the options --base, --base-mapping and --base-cutoff-hz state; None without one.

    Raises
    ------
    InputError
        When the file shows no motion of a base, or the other options are given without it.
    """
    from pliant.mechanics import mechanics_of
    from pliant.recording.mapping import options_of
    from pliant.simulation import read_base

    if path is not None:
        return read_base(path, mechanics_of(model).dimension, options_of(path, load_mapping(mapping)), cutoff)
    if mapping or cutoff is not None:
        raise InputError("--base-mapping and --base-cutoff-hz describe a file of the base's poses: give it by --base")
    return None


def load_mapping(paths: Sequence[Path | str] | Path | None) -> dict[str, Any] | None:
    """Return the mapping (columns and units of recordings) that TOML files state; None without a file.

    Of several files, each is given as NAME=FILE and holds for the recordings with NAME in their file names; one without
    a name holds for all others.
    """
    from pliant.recording.mapping import joined_mappings

    listed = [paths] if isinstance(paths, Path) else paths or ()
    split = [[entry] if Path(entry).exists() else entry.split(",") for entry in map(str, listed)]
    named = []
    for entry in (part for parts in split for part in parts):
        name, _, file = entry.rpartition("=") if not Path(entry).exists() else ("", "", entry)
        named.append((name.strip(), read_entries(Path(file.strip()), "mapping")))
    return joined_mappings(named)


def read_with_mapping(path: Path, mapping: Sequence[Path | str] | Path | None) -> xr.Dataset:
    """Read the recording in the file `path`. `mapping` names optional TOML files that state the columns and units of
    that file; see `load_mapping`.
    """
    from pliant.sensing import read_shape

    with busy(f"reading {path.name}"):
        return read_shape(path, mapping=load_mapping(mapping))


def read_in_base_frame(path: Path, mapping: Sequence[Path | str] | None) -> xr.Dataset:
    """Read an aligned recording for use with a model. Angles without positions are taken relative to the rest at the
    start of the recording, as studies take them.
    """
    from pliant.preprocessing.angles import from_rest

    recording = read_with_mapping(path, mapping)
    return from_rest(recording) if "angle" in recording and "position" not in recording else recording


def levels(model: Model, text: str) -> list[float]:
    """Return the level [SI] of each input of a model from a text in kPa, N, mm or rad: "30,20" in the order of the
    inputs, or "left=30" by name with 0 for the others.
    """
    names, units = model.actuation.names, model.actuation.units
    what = inputs_word(model.actuation.kinds)
    if "=" in text:
        named = pairs("--level", text)
        if strange := [name for name in named if name not in names]:
            raise InputError(
                f"--level names the {what} {strange[0]!r}, but the model has {', '.join(names)}: use these names"
            )
        parts = [named.get(name, "0") for name in names]
    else:
        parts = text.split(",")
    if len(parts) != len(names):
        raise InputError(
            f"--level gives {len(parts)} value(s), but the model has {len(names)} {what}(s), "
            f"{', '.join(names)}: give one for each, as {','.join(['30'] * len(names))}, or by name, as {names[0]}=30"
        )
    return [number(part, unit) for part, unit in zip(parts, units, strict=True)]


def number(text: str, unit: str) -> float:
    """Return the value in an SI `unit` of a text such as "30", a number in the unit that plots use, or "30kPa". A text
    that is not a number raises InputError.
    """
    factor, display_unit = shown_in(unit)
    try:
        return number_in(text, display_unit) * (1.0 / factor)
    except InputError as error:
        raise InputError(f"--level must be numbers in {display_unit}, got {text.strip()!r:.60}: {error}") from None


def vector(text: str, count: int, refusal: str, unit: str = "1") -> list[float]:
    """Return `count` numbers in `unit` from a text such as "1,2,3" or "1mm,2mm,3mm"; any other text raises InputError
    with the message `refusal`.
    """
    try:
        values = [number_in(part, unit) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise InputError(refusal)
    return values


def pairs(option: str, text: str) -> dict[str, str]:
    """Parse a text such as "left=p1,right=p2" and return its pairs as a dictionary."""
    parts = [part.partition("=") for part in text.split(",")]
    entries = {name.strip(): word.strip() for name, _, word in parts}
    if not all(entries) or not all(entries.values()) or len(entries) != len(parts):
        raise InputError(f"{option} must be pairs as left=p1,right=p2, each chamber once, got {text!r:.80}")
    return entries


def drives(text: str) -> dict[str, str | int] | None:
    """Return which recorded pressure (name, or index from 0) drives each chamber, from a text such as
    "left=p1,right=0". For an empty text return None.
    """
    if not text:
        return None
    return {name: int(word) if word.isdecimal() else word for name, word in pairs("--drive", text).items()}
