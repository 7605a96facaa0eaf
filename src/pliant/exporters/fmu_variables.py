"""Variables of an exported FMU: their names (structured naming convention), units and start values.

Names and the order of value references match `templates/fmu.c`: time, inputs, outputs, parameters.
"""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from pliant.equations.laws import LAWS
from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.exporters.c_functions import DERIVED, parameters
from pliant.exporters.names import with_identifiers
from pliant.mechanics import mechanics_of
from pliant.model import Model, Tendon
from pliant.model.extension import CURVES
from pliant.text import identifiers

INSIDE = (*DERIVED, "dead_time")
UNIT_OF = {  # unit of each parameter; one unit per column if the columns of an array differ
    "link_length": "m", "link_mass": "kg", "tip_mass": "kg", "stiffness": "N.m/rad", "damping": "N.m.s/rad",
    "rest_angle": "rad", "base_length": "m", "base_angle": "rad",
    "gravity": "m/s2", "joint_gain": "", "valve": ("s", "s", "Pa/s", "Pa/s"), "rubber": ("", "s", "Pa", "s", ""),
    "rest_turn": "rad", "base_tilt": "rad", "radius": "m", "stiffness_ratio": "", "twist_ratio": "",
    "lever": "m", "tendon_stiffness": "N/m", "pretension": "N", "friction": "", "slip_rate": "m/s", "beyond": "",
    "axial_stiffness": "N", "axial_damping": "N.s", "share": "", **{f"axial_{name}": "" for name in CURVES},
    "axial_creep_share": "", "axial_creep_time": "s", "axial_slip_share": "", "axial_slip_strain": "",
    "creep_share": "", "creep_time": "s", "slip_share": "", "slip_angle": "rad",
    "boucwen": ("", "1/rad^n", "1/rad^n", ""),
    **{name: term.unit.replace("^", "") for name, term in SPRING_TERMS.items()}, SPRING_BOUND: "",
}
BASE = {  # exponents of kg, m, s and rad
    "m": (0, 1, 0, 0), "kg": (1, 0, 0, 0), "s": (0, 0, 1, 0), "rad": (0, 0, 0, 1), "Pa": (1, -1, -2, 0),
    "J": (1, 2, -2, 0), "m/s2": (0, 1, -2, 0), "Pa/s": (1, -1, -3, 0), "1/rad": (0, 0, 0, -1),
    "N": (1, 1, -2, 0), "N.s": (1, 1, -1, 0), "N/m": (1, 0, -2, 0), "N/rad": (1, 1, -2, -1), "1/rad2": (0, 0, 0, -2),
    "N.m/rad": (1, 2, -2, -1), "N.m.s/rad": (1, 2, -1, -1),
}


class Variable(NamedTuple):
    """One variable of the FMU: name, causality, unit and start value."""

    name: str
    causality: str
    unit: str
    start: float | None = None


def variables(model: Model, pressure: float) -> list[Variable]:
    """Return all variables of the FMU in the order of their value references, with unique names."""
    model = with_identifiers(model)
    chambers = model.actuation.labels("pressure")
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
    rows += [Variable(name, "input", unit, pressure) for name, _, unit in inputs]
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
        chamber = model.chambers[index[0]]
        if isinstance(chamber, Tendon):
            return {"N": "m", "m": "N/m", "rad": "N/rad"}[chamber.unit]
        own = {law.name: [row.unit.replace(" ", ".") for row in law.parameters.values()] for law in LAWS}
        if units := own.get(chamber.law):
            return units[index[-1]] if index[-1] < len(units) else ""
        return "N.m/Pa" + (str(index[-1] + 1) if index[-1] else "")
    unit = UNIT_OF[field]
    return unit if isinstance(unit, str) else unit[index[-1]]


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
