"""Variables of an exported FMU: their names (structured naming convention), units and start values.

Names and the order of value references match `templates/fmu.c`: time, inputs, outputs, parameters.
"""

from __future__ import annotations

import re
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from pliant.exporters.c_functions import DERIVED, UNIT, parameters
from pliant.exporters.names import with_identifiers
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.text import identifiers

INSIDE = (*DERIVED, "dead_time")
BASE = {  # exponents of kg, m, s and rad
    "m": (0, 1, 0, 0), "kg": (1, 0, 0, 0), "s": (0, 0, 1, 0), "rad": (0, 0, 0, 1), "Pa": (1, -1, -2, 0),
    "J": (1, 2, -2, 0), "m/s2": (0, 1, -2, 0), "Pa/s": (1, -1, -3, 0), "1/rad": (0, 0, 0, -1),
    "N": (1, 1, -2, 0), "N.s": (1, 1, -1, 0), "N/m": (1, 0, -2, 0), "N/rad": (1, 1, -2, -1), "1/rad2": (0, 0, 0, -2),
    "m/s": (0, 1, -1, 0), "rad/s": (0, 0, -1, 1), "N/s": (1, 1, -3, 0),
    "N.m/rad": (1, 2, -2, -1), "N.m.s/rad": (1, 2, -1, -1),
}


class Variable(NamedTuple):
    """One variable of the FMU: name, causality, unit and start value."""

    name: str
    causality: str
    unit: str
    start: float | None = None


def variables(model: Model, pressure: ArrayLike) -> list[Variable]:
    """Return all variables of the FMU in the order of their value references, with unique names."""
    model = with_identifiers(model)
    chambers = model.actuation.labels("{kind}")
    scalars = [
        *mechanics_of(model).joint_names,
        *(f"{kind}_energy" for kind in ("kinetic", "elastic", "gravitational")),
    ]
    held = [name for name in parameters(model) if name not in INSIDE]
    chambers = list(identifiers(chambers, ["time", *scalars, *held]))
    behind = list(identifiers([f"{name}_behind_valve" for name in chambers], ["time", *chambers, *scalars, *held]))
    taken = ["time", *chambers, *behind, *scalars, *held]
    stations = identifiers([point.name for point in model.points], taken)
    rows = [Variable("time", "independent", "s")]
    inputs = list(zip(chambers, behind, model.actuation.units, strict=True))
    start = np.broadcast_to(pressure, len(inputs))
    rows += [Variable(name, "input", unit, float(p)) for (name, _, unit), p in zip(inputs, start, strict=True)]
    for station in stations:
        rows += [Variable(f"{station}.{k}", "output", unit) for k, unit in pose_of(model)]
    rows += [Variable(name, "output", coordinate_unit(name)) for name in scalars[: model.size]]
    rows += [Variable(name, "output", unit) for _, name, unit in inputs]
    rows += [Variable(name, "output", "J") for name in scalars[model.size :]]
    for field in held:
        value = parameters(model)[field]
        for index in np.ndindex(*value.shape):
            name = field + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
            rows.append(Variable(name, "parameter", unit_of(model, field, index), float(value[index])))
    return rows


def pose_of(model: Model) -> list[tuple[str, str]]:
    """Return the components of an observed point as (name, unit): its coordinates and the angle of its link."""
    return [*((axis, "m") for axis in "xyz"[: mechanics_of(model).dimension]), ("angle", "rad")]


def coordinate_unit(name: str) -> str:
    """Return the FMU unit of a joint coordinate: "rad" for an angle, "" for a strain."""
    return "" if name.startswith("strain") else "rad"


def unit_of(model: Model, field: str, index: tuple[int, ...]) -> str:
    """Return the FMU unit of one element of the parameter `field`; "" for a dimensionless number."""
    if field == "torque":
        return fmu_unit(model.chambers[index[0]].law_unit(index[-1]))
    if field == "joint_gain":
        return fmu_unit(model.chambers[index[0]].gain_unit)
    columns = UNIT[field].split(", ")
    if field == "valve":
        columns = [unit.replace("Pa", model.chambers[index[0]].unit) for unit in columns]
    return fmu_unit(columns[index[-1]] if len(columns) > 1 else columns[0])


def fmu_unit(unit: str) -> str:
    """Return a unit such as "N m/rad^2" in the notation of FMUs, "N.m/rad2"; "" for a dimensionless number."""
    return re.sub(r"\^(?=\d)", "", unit.replace(" ", ".")) if unit != "1" else ""


def unit_definitions(root: ET.Element, rows: list[Variable]) -> None:
    """Add the element UnitDefinitions, with the SI exponents of all units, to the FMU's model description."""
    group = ET.SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in rows if v.unit}):
        unit = ET.SubElement(group, "Unit", name=name)
        if (exponents := base_units(name)) is not None:
            named = zip(("kg", "m", "s", "rad"), exponents, strict=True)
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in named if power})


def base_units(unit: str) -> tuple[int, int, int, int] | None:
    """Return the exponents of kg, m, s and rad of a unit, or None if they are unknown, as for "1/rad^n", where n is a
    model parameter.
    """
    if unit.startswith("N.m/Pa"):
        k = int(unit.removeprefix("N.m/Pa") or 1)
        return 1 - k, 2 + k, 2 * k - 2, 0
    return BASE.get(unit)
