"""Reading and writing of model files: JSON with a versioned schema, which preserves every number exactly."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Collection
from dataclasses import fields
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeVar, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, create_model, field_validator

from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.errors import InputError, explain_validation, shown
from pliant.file_kinds import MODEL, refuse_other
from pliant.files import content_of, write_text
from pliant.model.chamber import Chamber
from pliant.model.extension import CURVES, Extension
from pliant.model.memory import Memory
from pliant.model.model import Model
from pliant.model.space import Space
from pliant.model.station import Station
from pliant.model.tendon import Tendon
from pliant.model.valve import Valve

SCHEMA: Literal["pliant-model"] = "pliant-model"
SCHEMA_VERSION: Literal[1] = 1
UNITS = {
    "link_length": "m", "rest_angle": "rad", "link_mass": "kg", "stiffness": "N m/rad", "damping": "N m s/rad",
    "torque": "N m/Pa^k", "tip_mass": "kg", "base_length": "m", "base_angle": "rad", "gravity": "m/s^2",
    "valve": "s, Hz", "valve rates": "Pa/s", "dead_band": "Pa",
    "stations": "m", "space": "rad, 1, m", "tendons": "m, N/m, N", "memory": "1, s, rad, 1/rad^n", "swell_time": "s",
    "inflation_limit": "Pa", "inflation_time": "s", "inflation_jm": "1", "axial_gain": "1/m",
    "extensions": "N, N s, m", **{name: term.unit for name, term in SPRING_TERMS.items()},
    SPRING_BOUND: "1",
}
MIRRORED = (  # D4
    "bend_sign is not an entry of a model file: models are in the base frame, where positive angles bend towards -x. "
    "Remove bend_sign and checksum. If bend_sign was -1, also change the sign of the x component of gravity, and give "
    "shapes and targets in the base frame"
)


class Table(BaseModel):
    """A table of a model file."""

    model_config = ConfigDict(extra="forbid", protected_namespaces=())


T = TypeVar("T", bound=Table)
GIVEN: Any = ...  # default value of a field that a file must state


def fields_of(
    described: Any, needed: tuple[str, ...] = (), without: Collection[str] = (), **kinds: Any
) -> Callable[[type[T]], type[T]]:
    """Return a decorator that gives a table the fields of the class which it describes, with their default values.

    Parameters
    ----------
    described : dataclass or named tuple
    needed : tuple of str
        Fields that a file must state although the class has a default value. They come first.
    without : collection of str
        Fields that the table lacks.
    **kinds
        Types of fields in the file, where they are not those of the class.
    """
    hints = get_type_hints(described)
    defaults = {**dict.fromkeys(needed), **defaults_of(described), **dict.fromkeys(needed, GIVEN)}

    def entry(name: str, default: Any) -> tuple[Any, Any]:
        if dataclasses.is_dataclass(default):
            default = kinds[name]()
        elif isinstance(default, np.ndarray | tuple):
            default = np.array(default).tolist()
        rows = hints[name] is np.ndarray or get_origin(hints[name]) is tuple
        return kinds.get(name, list[float] if rows else hints[name]), default

    entries: dict[str, Any] = {name: entry(name, value) for name, value in defaults.items() if name not in without}
    return lambda table: create_model(table.__name__, __base__=table, __doc__=table.__doc__, **entries)


def defaults_of(described: Any) -> dict[str, Any]:
    """Return the default values of the fields of a dataclass or named tuple by name; `GIVEN` for those without one."""
    if not dataclasses.is_dataclass(described):
        return {name: described._field_defaults.get(name, GIVEN) for name in described._fields}
    absent = dataclasses.MISSING
    made = {f.name: f.default if f.default_factory is absent else f.default_factory() for f in fields(described)}
    return {name: GIVEN if value is absent else value for name, value in made.items()}


@fields_of(Station)
class StationEntry(Table):
    """Table of one observed point in a model file."""


@fields_of(Space, rest_turn=list[list[float]])
class SpaceEntry(Table):
    """Table of the parameters of a chain in space in a model file."""


@fields_of(Valve)
class ValveEntry(Table):
    """Table of the valve parameters in a model file."""


@fields_of(Chamber, needed=("name", "torque", "joint_gain"), valve=ValveEntry)
class ChamberEntry(Table):
    """Table of one pressure chamber in a model file that has several inputs."""


@fields_of(
    Tendon, needed=("driven_by", "name", "joint_gain", "cross_gain", "lever"), valve=ValveEntry,
    without={f.name for f in fields(Chamber)} - {"name", "joint_gain", "cross_gain", "valve"},
    driven_by=Literal["tension", "displacement", "angle"],
)  # fmt: skip
class TendonEntry(Table):
    """Table of one tendon in a model file."""


@fields_of(Extension, needed=("name",))
class ExtensionEntry(Table):
    """Table of one extensible segment in a model file."""


@fields_of(Extension, without={f.name for f in fields(Extension)} - {*CURVES})
class AxialCurve(Table):
    """Entries of the nonlinear terms of an axial spring, for tables of other files."""


@fields_of(Memory)
class MemoryEntry(Table):
    """Table of the hysteresis parameters of joints and segments in a model file."""


class _Chain(Table):
    schema_name: Literal["pliant-model"] = SCHEMA
    schema_version: Literal[1] = SCHEMA_VERSION
    units: dict[str, str] = UNITS
    name: str = "model"
    link_length: list[float]
    rest_angle: list[float]
    link_mass: list[float]
    stiffness: list[float]
    damping: list[float]
    mass_at: Literal["rod", "tip"] = "rod"
    tip_mass: float = 0.0
    base_length: float = 0.0
    base_angle: float = 0.0
    gravity: list[float] = [0.0, 0.0]
    memory: MemoryEntry = MemoryEntry()
    extensions: list[ExtensionEntry] = []
    space: SpaceEntry | None = None
    chambers: list[ChamberEntry | TendonEntry] | None = None
    stations: list[StationEntry] = []
    source: dict[str, str] = {}
    checksum: str = ""

    @field_validator("units")
    @classmethod
    def units_are_ours(cls, units: dict[str, str]) -> dict[str, str]:
        """Check that the units stated in a model file are those of its schema, because all numbers are read in these
        units.
        """
        wrong = {name: unit for name, unit in units.items() if UNITS.get(name) != unit}
        if wrong:
            raise ValueError(f"must be those of the schema, {UNITS}; these differ: {shown(wrong, 200)}")
        return units


SPRINGS: dict[str, Any] = dict.fromkeys(CURVES, (list[float], [0.0]))  # nonlinear terms of the joints
SINGLE: dict[str, Any] = {  # entries of a model with one chamber, in place of `chambers`
    name: (field.annotation | None, None)
    for name, field in ChamberEntry.model_fields.items() if name != "name" and field.annotation
}  # fmt: skip
ModelFile = create_model(
    "ModelFile", __base__=_Chain, __doc__="All entries of a model file, with their types and default values.",
    **SPRINGS, **SINGLE,
)  # fmt: skip


def model_to_dict(model: Model) -> dict[str, Any]:
    """Return the entries of a model file for `model` as a dict of plain values."""
    content: dict[str, Any] = {"schema_name": SCHEMA, "schema_version": SCHEMA_VERSION, "units": UNITS}
    content |= plain(model)
    chambers = [input_entries(c) for c in model.chambers]
    if len(chambers) == 1 and model.chambers[0].name == Chamber.name:
        del content["chambers"], chambers[0]["name"]
        content |= chambers[0]
    else:
        content["chambers"] = chambers
    content["memory"] = dataclasses.asdict(model.memory)
    content["extensions"] = [dataclasses.asdict(e) for e in model.extensions]
    content["stations"] = [{k: v for k, v in s._asdict().items() if v or k != "aside"} for s in model.stations]
    if model.space:
        content["space"] = plain(model.space)
    else:
        del content["space"]
    return content


def input_entries(law: Chamber) -> dict[str, Any]:
    """Return the model-file entries of one chamber or tendon. For a tendon, values that follow from
    others are omitted.
    """
    entries = plain(law) | {"valve": dataclasses.asdict(law.valve)}
    if isinstance(law, Tendon):
        chamber = {field.name for field in fields(Chamber)} - {"name", "joint_gain", "cross_gain", "valve"}
        return {name: value for name, value in entries.items() if name not in chamber}
    return entries


def input_of(entries: dict[str, Any]) -> Chamber:
    """Return the chamber or tendon described by the `entries` of its table in a model file."""
    own = {**entries, "valve": Valve(**entries["valve"])}
    return Tendon(**own) if "driven_by" in own else Chamber(**own)


def plain(of: Any) -> dict[str, Any]:
    """Return the fields of a dataclass instance as a dict, with arrays as lists."""
    values = {field.name: getattr(of, field.name) for field in fields(of)}
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()}


def save_model(model: Model, path: str | Path) -> Path:
    """Write `model` to the file `path` as JSON with a checksum. `load_model` reads an equal model from it.

    The file is replaced atomically.

    Raises
    ------
    InputError
        When the file cannot be written.

    Examples
    --------
    >>> import pliant, tempfile, pathlib
    >>> from pliant.actuators import chen2018
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "model.json"
    ...     _ = pliant.save_model(chen2018.model(), path)
    ...     pliant.load_model(path).n
    5
    """
    content = model_to_dict(model)
    return write_text(path, json.dumps(content | {"checksum": checksum_of(content)}, indent=1) + "\n")


def checksum_of(content: dict[str, Any]) -> str:
    """Return the SHA-256 of the entries of a model file, without its checksum, independent of order and layout."""
    entries = {name: value for name, value in content.items() if name != "checksum"}
    return sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def load_model(path: str | Path) -> Model:
    """Read a `Model` from a model file.

    Parameters
    ----------
    path : str or Path
        A JSON file written by `save_model` or `pliant run`.

    Raises
    ------
    InputError
        When the file is absent, not JSON or of another schema, has a non-physical number, or has changed since it was
        saved (its checksum differs). The checksum of a file without one is not checked.

    Examples
    --------
    >>> import pliant, tempfile, pathlib
    >>> from pliant.actuators import chen2018
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "model.json"
    ...     _ = pliant.save_model(chen2018.model(), path)
    ...     pliant.load_model(path) == chen2018.model()
    True
    """
    text = content_of(path, "model file")
    refuse_other(Path(path), MODEL)
    return read_model(text, f"model file {path}")


def model_of(value: Model | str | Path) -> Model:
    """Return a model, or the model of a model file if `value` is a path.

    Raises
    ------
    InputError
        When `value` is neither, or the file cannot be read.
    """
    if isinstance(value, Model):
        return value
    if isinstance(value, str | PathLike):
        return load_model(value)
    raise InputError(f"expected a Model or the path of a model file, got {value!r:.80}")


def read_model(text: bytes | str, where: str) -> Model:
    """Return the `Model` described by the JSON text of a model file. `where` names the file in error messages."""
    try:
        entries = ModelFile.model_validate_json(text)
    except ValidationError as error:
        if any(e["loc"] == ("bend_sign",) for e in error.errors()):
            raise InputError(f"{where}: {MIRRORED}") from None
        raise explain_validation(error, where, ModelFile) from None
    values = entries.model_dump(exclude={"schema_name", "schema_version", "units", "checksum"}, exclude_none=True)
    values["stations"] = tuple(Station(**s) for s in values["stations"])
    try:
        values["extensions"] = tuple(Extension(**e) for e in values["extensions"])
        if "chambers" in values:
            values["chambers"] = tuple(input_of(c) for c in values["chambers"])
        if "valve" in values:
            values["valve"] = Valve(**values["valve"])
        model = Model(**{**values, "memory": Memory(**values["memory"])})
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if entries.checksum and entries.checksum != checksum_of(json.loads(text)):
        raise InputError(
            f"{where} was changed or damaged after it was saved: its checksum differs. Copy it again or, if you "
            "changed it on purpose, remove its entry 'checksum'"
        )
    return model
