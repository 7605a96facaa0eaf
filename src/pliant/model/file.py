"""Reading and writing of model files: JSON with a versioned schema, which preserves every number exactly."""

from __future__ import annotations

import json
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, create_model, field_validator

from pliant.errors import InputError, explain_validation, shown
from pliant.files import MODEL, content_of, refuse_other, write_text
from pliant.model.actuation_input import ActuationInput
from pliant.model.chamber import Chamber
from pliant.model.extension import Extension
from pliant.model.memory import Memory
from pliant.model.model import Model
from pliant.model.parameters import MassAt, ModelParameters, Station
from pliant.model.quantity import quantities
from pliant.model.space import Space
from pliant.model.tables import Table, TableLayout, fields_of
from pliant.model.tendon import Tendon
from pliant.model.valve import Valve
from pliant.plain import plain
from pliant.units import DrivenBy

SCHEMA: Literal["pliant-model"] = "pliant-model"
SCHEMA_VERSION: Literal[1] = 1
TABLES = {"valve": Valve, "memory": Memory, "extensions": Extension, "space": Space, "stations": Station,
          "chambers": Chamber, "tendons": Tendon}  # fmt: skip
UNITS = {name: q.unit for name, q in {**quantities(Chamber), **quantities(ModelParameters)}.items()} | {
    f"{table}.{name}": q.unit for table, part in TABLES.items() for name, q in quantities(part).items()
    if table != "chambers" and (part is not Tendon or name not in quantities(Chamber))
}
INNER_UNITS = {f".{name.rpartition('.')[2]}={unit}" for name, unit in UNITS.items() if "." in name}


def unit_of(name: str) -> str:
    """Return the unit of an entry of a model file, or those of all parameters in a table, as in "s, Hz"."""
    inner = (unit for known, unit in UNITS.items() if known.startswith(f"{name}."))
    return UNITS.get(name) or ", ".join(dict.fromkeys(inner))


MIRRORED = (  # D4
    "bend_sign is not an entry of a model file: models are in the base frame, where positive angles bend towards -x. "
    "Remove bend_sign and checksum. If bend_sign was -1, also change the sign of the x component of gravity, and give "
    "shapes and targets in the base frame"
)


@fields_of(Station)
class StationEntry(Table):
    """Table of one observed point in a model file."""


@fields_of(Space, rest_turn=list[list[float]])
class SpaceEntry(Table):
    """Table of the parameters of a chain in space in a model file."""


@fields_of(Valve)
class ValveEntry(Table):
    """Table of the valve parameters in a model file."""


@fields_of(Chamber, TableLayout(("name", "torque", "joint_gain")), valve=ValveEntry)
class ChamberEntry(Table):
    """Table of one pressure chamber in a model file that has several inputs."""


@fields_of(
    Tendon, TableLayout(("driven_by", "name", "joint_gain", "cross_gain", "lever")), valve=ValveEntry,
    driven_by=DrivenBy,
)
class TendonEntry(Table):
    """Table of one tendon in a model file."""


@fields_of(Extension, TableLayout(("name",)))
class ExtensionEntry(Table):
    """Table of one extensible segment in a model file."""


@fields_of(Memory)
class MemoryEntry(Table):
    """Table of the hysteresis parameters of joints and segments in a model file."""


@fields_of(
    ModelParameters, TableLayout(("link_length", "rest_angle", "link_mass", "stiffness", "damping"), ("chambers",)),
    mass_at=MassAt, memory=MemoryEntry, extensions=list[ExtensionEntry], space=SpaceEntry | None,
    stations=list[StationEntry],
)
class _Chain(Table):
    schema_name: Literal["pliant-model"] = SCHEMA
    schema_version: Literal[1] = SCHEMA_VERSION
    units: dict[str, str] = Field(default={})
    chambers: list[ChamberEntry | TendonEntry] | None = None
    checksum: str = ""

    @field_validator("units")
    @classmethod
    def units_are_ours(cls, units: dict[str, str]) -> dict[str, str]:
        """Check that the units stated in a model file are those of its schema, because all numbers are read in these
        units.
        """
        wrong = {name: unit for name, unit in units.items() if not is_unit(name, unit)}
        if wrong:
            raise ValueError(f"must be those of the schema, {UNITS}; these differ: {shown(wrong, 200)}")
        return units


def is_unit(name: str, stated: str) -> bool:
    """Return whether the unit that a model file states is that of the parameter `name`. For the name of a table, or a
    phrase that begins with it, the file may list units that the parameters of this table have, such as "s, Hz".
    """
    part = TABLES.get(name.partition(" ")[0])
    if part and "." not in name:
        return set(stated.split(", ")) <= {q.unit for q in quantities(part).values()}
    return stated == UNITS.get(name) if name in UNITS else f".{name}={stated}" in INNER_UNITS


SINGLE: dict[str, Any] = {  # entries of a model with one chamber, in place of `chambers`
    name: (field.annotation | None, Field(
        None, description=field.description, json_schema_extra=field.json_schema_extra))
    for name, field in ChamberEntry.model_fields.items() if name != "name" and field.annotation
}  # fmt: skip
ModelFile = create_model(
    "ModelFile", __base__=_Chain, __doc__="All entries of a model file, with their types and default values.",
    **SINGLE,
)  # fmt: skip


def model_to_dict(model: Model) -> dict[str, Any]:
    """Return the entries of a model file for `model` as a dict of plain values."""
    content: dict[str, Any] = {"schema_name": SCHEMA, "schema_version": SCHEMA_VERSION, "units": {}}
    content |= plain(model)
    chambers = content["chambers"]
    if len(chambers) == 1 and model.chambers[0].name == Chamber.name:
        del content["chambers"], chambers[0]["name"]
        content |= chambers[0]
    for station in content["stations"]:
        if not station["aside"]:
            del station["aside"]
    for name in ("space", "moving_base"):
        if not content[name]:
            del content[name]
    content["units"] = units_in(content)
    return content


def units_in(content: dict[str, Any]) -> dict[str, str]:
    """Return the units of all parameters in the entries of a model file, by name, with the table's name and a dot in
    front for those in tables.
    """
    names: set[str] = set()
    tables: list[tuple[str, Any]] = [("", content)]
    while tables:
        table, entries = tables.pop()
        names |= {*entries} if table in ("", "chambers") else {f"{table}.{name}" for name in entries}
        if "driven_by" in entries:
            names |= {f"tendons.{name}" for name in entries}
        for name, value in entries.items():
            tables += [(name, row) for row in (value if isinstance(value, list) else [value]) if isinstance(row, dict)]
    return {name: unit for name, unit in UNITS.items() if name in names}


def input_of(entries: dict[str, Any]) -> ActuationInput:
    """Return the chamber or tendon described by the `entries` of its table in a model file."""
    arguments = {**entries, "valve": Valve(**entries["valve"])}
    return Tendon(**arguments) if "driven_by" in arguments else Chamber(**arguments)


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
        A JSON file written by `save_model`, or the results folder of `pliant run`, which holds a `model.json`.

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
    path = Path(path)
    file = path / "model.json" if path.is_dir() else path
    text = content_of(file, "model file")
    refuse_other(file, MODEL)
    return read_model(text, f"model file {file}")


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
