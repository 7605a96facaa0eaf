"""Names of the parameters of a fit: paths of owner, field and number, such as ``left.creep_share_1``.

What a name means follows from the declarations: of the fields of a model's parts (`pliant.model.parts`), of the
quantities below, which a fit changes in place of such fields or which a recording has, and of the torque laws.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache, cached_property
from typing import Annotated, NamedTuple

from pliant.errors import InputError
from pliant.model.parts import PARTS, Declared, ModelPart, declared
from pliant.model.quantity import Per, Quantity
from pliant.model.torque_law import law_parameters


class OfTheBody(NamedTuple):
    """Quantities that stand for several fields of the whole body."""

    body_stiffness: Annotated[float, Quantity(
        "N m/rad", "stiffness of the first joint; others and EA in proportion", lower=1e-9, scales="springs")]
    joint_share: Annotated[float, Quantity(
        "1", "position of a joint in its segment, 0 at base", lower=0.0, upper=0.99, scale=0.1, only="in a plane")]
    gravity_angle: Annotated[float, Quantity(
        "rad", "angle of gravity from the base tangent", lower=-6.3, upper=6.3, scale=0.05, only="in a plane")]
    gravity_x: Annotated[float, Quantity("m/s^2", "gravity in the base frame, x", scale=0.5)]
    gravity_y: Annotated[float, Quantity("m/s^2", "gravity in the base frame, y", scale=0.5)]
    gravity_z: Annotated[float, Quantity(
        "m/s^2", "gravity in the base frame, z, in space", scale=0.5, only="in space")]


class OfAnInput(NamedTuple):
    """Means of the gains of an input at all joints."""

    gain: Annotated[float, Quantity(
        "1", "mean of the joints' gains: a factor on the whole torque law", scale=1.0, scales="inputs")]
    gain_x: Annotated[float, Quantity(
        "1", "mean factor on the torque about x, in space", scale=0.3, scales="inputs", only="in space")]
    gain_y: Annotated[float, Quantity(
        "1", "mean factor on the torque about y, in space", scale=0.3, scales="inputs", only="in space")]


class OfARecording(NamedTuple):
    """Quantities of a recording that no model has."""

    base_x: Annotated[float, Quantity("m", "offset of the recording's frame, x", scale=1e-3, guess=0.0)]
    base_y: Annotated[float, Quantity("m", "offset of the recording's frame, y", scale=1e-3, guess=0.0)]
    base_z: Annotated[float, Quantity(
        "m", "offset of the recording's frame, z, in space", scale=1e-3, guess=0.0, only="in space")]
    start: Annotated[float, Quantity(
        "s", "when the pulse begins, or the pressure clock's offset", scale=0.01, guess=0.0)]
    stop: Annotated[float, Quantity("s", "when the pulse ends", scale=0.01)]
    latency: Annotated[float, Quantity(
        "s", "delay of the shape's time stamps behind pressure", lower=-5.0, upper=5.0, scale=5e-3, guess=0.0)]
    release: Annotated[float, Quantity("s", "when the held body is let go", scale=0.01)]
    release_time: Annotated[float, Quantity(
        "s", "time that the hand takes to let go", lower=0.0, upper=0.2, scale=0.01, guess=0.04)]
    base_turn: Annotated[float, Quantity(
        "rad", "turn of a clamp that yields at release", lower=-0.2, upper=0.2, scale=0.01, guess=0.0,
        only="in a plane")]
    hold_force: Annotated[float, Quantity(
        "N", "force at the tip, along x, that holds the body before its release", scale=0.05, guess=0.0)]


class OfASensor(NamedTuple):
    """Quantities of the sensor of a recording or station."""

    sensor_lag: Annotated[float, Quantity(
        "s", "time constant of the shape's sensor", lower=0.0, upper=10.0, scale=0.02, guess=0.05)]


BODY_MEANS, INPUT_MEANS = ModelPart(OfTheBody), ModelPart(OfAnInput, "", "chamber")
RECORDING, SENSOR, LAW = ModelPart(OfARecording), ModelPart(OfASensor), ModelPart(None, "", "chamber")
NUMBERS: dict[Per, str] = {"joint": "_<i>", "branch": "_<k>", "power": "_<k>", "axis": "_<axis>",
                           "axis and joint": "_<axis>_<i>"}  # fmt: skip


@dataclass(frozen=True)
class ParameterPath:
    """A parameter's name, read: ``left.creep_share_1`` has the owner "left", the stem "creep_share" and the number "1".

    Attributes
    ----------
    owner : str
        Name of the recording, chamber, segment or station before the dot; "" without one.
    stem : str
        Name without owner and number.
    numbers : tuple of str
        What numbers the parameter: a joint or "*", a branch, a power, an axis, or an axis and a joint; () for none.
    declared : Declared
        The declaration: part, field, unit, bounds and meaning.
    """

    owner: str
    stem: str
    numbers: tuple[str, ...]
    declared: Declared

    @property
    def part(self) -> ModelPart:
        """The part of a model, or other record, that declares the parameter."""
        return self.declared.part

    @property
    def field(self) -> str:
        """The field of this part."""
        return self.declared.field

    @property
    def own(self) -> str:
        """Name without the owner, such as ``creep_share_1``."""
        return "_".join((self.stem, *self.numbers))

    @property
    def family(self) -> str:
        """Readable name of the parameters that differ in owner and number alone, such as ``creep_share_<k>``."""
        station = "<station>." if self.part.owner == "station" else ""
        return station + self.stem + (NUMBERS[self.declared.quantity.per] if self.numbers else "")

    @property
    def number(self) -> int:
        """Number of the joint, branch or power, from 1; 0 if the parameter has none, or stands for each joint."""
        return int(self.numbers[-1]) if self.numbers and self.numbers[-1].isdecimal() else 0

    @property
    def of_one_joint(self) -> bool:
        """Whether the parameter is that of a single joint, or of each joint in turn (``*``)."""
        return self.declared.quantity.per == "joint" and bool(self.numbers)

    @cached_property
    def quantity(self) -> Quantity:
        """Unit, bounds and meaning of the parameter."""
        quantity = self.declared.quantity
        if not self.of_one_joint:
            return quantity
        which = "one joint" if self.number else "each joint"
        return replace(quantity, meaning=quantity.meaning.replace("every joint", which))


@cache
def declarations() -> dict[str, Declared]:
    """Return the declarations of all parameters that a fit may change, by their names without owner and number."""
    parts = (*PARTS, BODY_MEANS, INPUT_MEANS, RECORDING, SENSOR)
    rows = {d.name: d for d in declared(*parts) if d.quantity.fitted}
    laws = {name: Quantity(row.unit, row.meaning, lower=row.lower, upper=row.upper, scale=row.scale)
            for name, row in law_parameters().items()}  # fmt: skip
    return rows | {name: Declared(LAW, name, quantity) for name, quantity in laws.items()}


def takes(quantity: Quantity, numbers: tuple[str, ...]) -> bool:
    """Return whether a parameter may have these numbers, such as ("2",) for one of joints, or () for none."""
    joint = numbers[-1:] and (numbers[-1].isascii() and numbers[-1].isdecimal())
    match quantity.per:
        case "joint":
            return (not numbers and quantity.alike) or (len(numbers) == 1 and (bool(joint) or numbers == ("*",)))
        case "branch" | "power":
            return len(numbers) == 1 and numbers[0] in tuple("123456789")
        case "axis":
            return len(numbers) == 1 and numbers[0] in tuple("xyz")
        case "axis and joint":
            return len(numbers) == 2 and numbers[0] in tuple("xyz") and bool(joint)
        case _:
            return not numbers


@cache
def find_path(name: str) -> ParameterPath | None:
    """Return the parts of a parameter's name, or None for a name that no declaration has."""
    owner, _, parameter = name.rpartition(".")
    words = parameter.split("_")
    for size in range(min(3, len(words))):
        stem, numbers = "_".join(words[: len(words) - size]), tuple(words[len(words) - size :])
        row = declarations().get(stem)
        if row and takes(row.quantity, numbers):
            possible = bool(owner) if row.part.owner == "station" else "." not in owner
            return ParameterPath(owner, stem, numbers, row) if possible else None
    return None


def path_of(name: str) -> ParameterPath:
    """Return the parts of a parameter's name: owner, field and number.

    Raises
    ------
    InputError
        When no such parameter is declared; the message names the parameter that is meant, or all.
    """
    if path := find_path(name):
        return path
    readable = families()
    last = name[:80].rpartition(".")[2]
    if former := [d.name for d in declarations().values() if last in d.quantity.formerly]:
        raise InputError(f"unknown parameter {name!r}: use its present name, {name.removesuffix(last) + former[0]!r}")
    near = get_close_matches(last, readable, 1, 0.6)
    meant = f"did you mean {near[0]!r}? Known are " if near else "use one of "
    raise InputError(
        f"unknown parameter {name!r}: {meant}{', '.join(readable)}, some also with the name of a recording or chamber "
        "and a dot in front"
    )


def stem_of(name: str) -> str:
    """Return a parameter's name without owner and number, such as "torque"; "" for an unknown name."""
    path = find_path(name)
    return path.stem if path else ""


@cache
def families() -> dict[str, Quantity]:
    """Return the parameters that a fit may change by readable names, in which ``<i>`` stands for the number of a joint,
    ``<k>`` for that of a branch or power.
    """
    rows = {}
    for name, row in declarations().items():
        quantity = row.quantity
        if quantity.per not in NUMBERS or (quantity.per == "joint" and quantity.alike):
            rows[ParameterPath("", name, (), row).family] = quantity
        if quantity.per in NUMBERS:
            numbered = ParameterPath("", name, ("1",), row)
            rows[numbered.family] = numbered.quantity
    return rows


def paths(names: Iterable[str], *parts: ModelPart) -> Iterator[tuple[str, ParameterPath]]:
    """Yield those of `names` that are parameters of the given parts, each with its path. Unknown names are left out."""
    for name in names:
        path = find_path(name)
        if path and path.part in parts:
            yield name, path
