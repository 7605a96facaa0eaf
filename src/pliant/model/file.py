"""Reading and writing of model files: JSON with a versioned schema, which preserves every number exactly."""

from __future__ import annotations

import dataclasses
import json
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, create_model, field_validator

from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.errors import InputError, explain_validation, shown
from pliant.files import write_text
from pliant.model.chamber import Chamber
from pliant.model.extension import CURVES, Extension
from pliant.model.memory import Memory
from pliant.model.model import Model
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


if TYPE_CHECKING:

    class JointCurve(BaseModel):
        """Entries of the nonlinear terms of the joints' springs."""

    class AxialCurve(BaseModel):
        """Entries of the nonlinear terms of an axial spring."""

else:  # one entry for each term of `SPRING_TERMS`
    JointCurve = create_model("JointCurve", **dict.fromkeys(CURVES, (list[float], [0.0])))
    AxialCurve = create_model("AxialCurve", **dict.fromkeys(CURVES, (float | None, None)))


class StationEntry(BaseModel):
    """Table of one observed point in a model file."""

    model_config = ConfigDict(extra="forbid")
    name: str
    link: int
    along: float
    across: float = 0.0
    aside: float = 0.0


class SpaceEntry(BaseModel):
    """Table of the parameters of a chain in space in a model file."""

    model_config = ConfigDict(extra="forbid")
    stiffness_ratio: float = 1.0
    twist_ratio: float = 0.0
    rest_turn: list[list[float]] = [[0.0, 0.0, 0.0]]
    base_tilt: list[float] = [0.0, 0.0]
    radius: float = 0.0


class ValveEntry(BaseModel):
    """Table of the valve parameters in a model file."""

    model_config = ConfigDict(extra="forbid")
    rise_time: float = 0.0
    fall_time: float = 0.0
    dead_time: float = 0.0
    natural_frequency: float = 0.0
    damping_ratio: float = 0.7
    rise_rate: float = 0.0
    fall_rate: float = 0.0
    settle_share: float = 0.0
    settle_time: float = 1.0
    dead_band: float = 0.0
    opening_time: float = 0.0


class ChamberEntry(BaseModel):
    """Table of one pressure chamber in a model file that has several inputs."""

    model_config = ConfigDict(extra="forbid")
    name: str
    torque: list[float]
    joint_gain: list[float]
    valve: ValveEntry = ValveEntry()
    swell_share: float = 0.0
    swell_time: float = 1.0
    inflation_limit: float = 0.0
    inflation_time: float = 0.1
    inflation_jm: float = 0.0
    axial_gain: list[float] = [0.0]
    cross_gain: list[float] = [0.0]
    law: str = "polynomial"


class TendonEntry(BaseModel):
    """Table of one tendon in a model file."""

    model_config = ConfigDict(extra="forbid")
    driven_by: Literal["tension", "displacement", "angle"]
    name: str
    joint_gain: list[float]
    cross_gain: list[float]
    lever: float
    line_stiffness: float = 0.0
    pretension: float = 0.0
    pulley: float = 0.0
    pair: bool = False
    friction: float = 0.0
    slip_rate: float = 1e-3
    valve: ValveEntry = ValveEntry()


class ExtensionEntry(AxialCurve, BaseModel):
    """Table of one extensible segment in a model file."""

    model_config = ConfigDict(extra="forbid")
    name: str
    stiffness: float
    damping: float = 0.0
    start: float = 0.0
    stop: float | None = None


class MemoryEntry(BaseModel):
    """Table of the hysteresis parameters of joints and segments in a model file."""

    model_config = ConfigDict(extra="forbid")
    creep_share: list[float] = []
    creep_time: list[float] = []
    slip_share: list[float] = []
    slip_angle: list[float] = []
    boucwen_share: float = 0.0
    boucwen_beta: float = 50.0
    boucwen_gamma: float = 50.0
    boucwen_exponent: float = 1.0
    axial_creep_share: list[float] = []
    axial_creep_time: list[float] = []
    axial_slip_share: list[float] = []
    axial_slip_strain: list[float] = []


class ModelFile(JointCurve, BaseModel):
    """All entries of a model file, with their types and default values."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True, protected_namespaces=())
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
    torque: list[float] | None = None  # this and the next ten are of a single chamber; else `chambers`
    joint_gain: list[float] | None = None
    valve: ValveEntry | None = None
    swell_share: float | None = None
    swell_time: float | None = None
    inflation_limit: float | None = None
    inflation_time: float | None = None
    inflation_jm: float | None = None
    axial_gain: list[float] | None = None
    cross_gain: list[float] | None = None
    law: str | None = None
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
        chamber = {field.name for field in dataclasses.fields(Chamber)} - {"name", "joint_gain", "cross_gain", "valve"}
        return {name: value for name, value in entries.items() if name not in chamber}
    return entries


def input_of(entries: dict[str, Any]) -> Chamber:
    """Return the chamber or tendon described by the `entries` of its table in a model file."""
    own = {**entries, "valve": Valve(**entries["valve"])}
    return Tendon(**own) if "driven_by" in own else Chamber(**own)


def plain(of: Any) -> dict[str, Any]:
    """Return the fields of a dataclass instance as a dict, with arrays as lists."""
    values = {field.name: getattr(of, field.name) for field in dataclasses.fields(of)}
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
    path = Path(path)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the model file {path}: {error.strerror or error}") from None
    return read_model(text, f"model file {path}")


def read_model(text: bytes | str, where: str) -> Model:
    """Return the `Model` described by the JSON text of a model file. `where` names the file in error messages."""
    try:
        entries = ModelFile.model_validate_json(text)
    except ValidationError as error:
        if any(e["loc"] == ("bend_sign",) for e in error.errors()):
            raise InputError(f"{where}: {MIRRORED}") from None
        raise explain_validation(error, where) from None
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
