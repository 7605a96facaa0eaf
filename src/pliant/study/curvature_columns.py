"""Recognition of the columns of a table that hold curvatures along a fibre, by names that share a beginning and go on
with arc lengths, such as `Curvature 10 mm`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from pliant.recording.column_names import is_time, standard_names, unitless_pressures, words_of
from pliant.recording.curvature import ARC, PER_METRE
from pliant.study.shorthand import OPEN

CURVATURE = {"k", "kappa", "curvature", "curv", "curvatures", "\u03ba"}
DIRECTION = {"a", "angle", "direction", "dir", "phi", "theta", "orientation"}
COMPONENT = re.compile(r"(?:k|kappa|curv\w*?|\u03ba)[\s_]*([xy])\W*", re.IGNORECASE)  # Kx, curvature_y
FEWEST = 4  # arc lengths that are no numbers of stations
ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "\u00b0": "deg", "rad": "rad", "radian": "rad",
          "radians": "rad"}  # fmt: skip


class Columns(NamedTuple):
    """Columns whose names share a beginning: their arc lengths as they are written, and the units behind these, "" if
    none is stated.
    """

    start: str
    arcs: tuple[str, ...]
    unit: str  # of the arc length
    bracket: str  # unit of the values


def curvature_columns(names: Sequence[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the entries of a mapping for the columns of curvature in the names of a table, and a question for each
    entry that they leave open, which is "?"; empty if no columns of curvature have a time beside them.
    """
    groups = along(names)
    axes = {match[1].lower(): g for g in groups if (match := COMPONENT.fullmatch(g.start.strip()))}
    parts = [axes[axis] for axis in sorted(axes)]
    both = len(parts) == 2 and parts[0][1:] == parts[1][1:]
    curved = parts[0] if both else next((g for g in groups if CURVATURE & {*words_of(g.start)}), None)
    if curved is None or not any(map(is_time, names)):
        return {}, {}
    directions = (g for g in groups if DIRECTION & {*words_of(g.start)} and g.arcs == curved.arcs and not both)
    turned = next(directions, None)
    per_metre = curved.bracket.replace("rad/", "1/").replace("m^-1", "1/m")
    named = {"components": [g.start for g in parts]} if both else {"curvature": curved.start}
    entries = {**named, "curvature_unit": per_metre if per_metre in PER_METRE else OPEN,
               "arc_unit": curved.unit or OPEN}  # fmt: skip
    if turned is not None:
        entries |= {"direction": turned.start, "direction_unit": ANGLES.get(turned.bracket.lower(), OPEN)}
    starts = tuple(columns.start for columns in (curved, turned, *parts) if columns is not None)
    beside = [name for name in names if not name.startswith(starts) and not is_time(name)]
    if pressures := unitless_pressures(standard_names(beside, "the table").names):
        entries["pressure_unit"] = OPEN
    questions = {"curvature_unit": f"unit of the curvatures: {', '.join(PER_METRE)}",
                 "arc_unit": "unit of the arc lengths in the names of the columns: m, cm, mm",
                 "direction_unit": "unit of the directions of bending: deg or rad",
                 "pressure_unit": f"unit (gauge) of {', '.join(pressures)}: kPa, mbar, bar, psi or Pa"}  # fmt: skip
    return entries, {name: questions[name] for name, value in entries.items() if value == OPEN}


def along(names: Sequence[str]) -> list[Columns]:
    """Return the groups of at least four columns whose names have the same beginning and rising arc lengths. Successive
    whole numbers from 0 or 1 without a unit are numbers of segments instead.
    """
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for name in names:
        for k, letter in enumerate(name):
            if (letter.isdigit() or letter in "+-.") and (match := ARC.fullmatch(name[k:])):
                bracket = name[k:].rpartition("[")[2] if "[" in name[k:] else name[k:].rpartition("(")[2]
                unit = bracket.rstrip(" )]").strip() if name[k:].rstrip().endswith((")", "]")) else ""
                groups.setdefault(name[:k], []).append((match[1], (match[2] or "").lower(), unit))
                break
    listed = []
    for start, columns in groups.items():
        arcs = tuple(arc for arc, _, _ in columns)
        rising = all(float(a) < float(b) for a, b in pairwise(arcs))
        numbers = [float(arc) for arc in arcs]
        counted = not columns[0][1] and numbers in ([*range(len(arcs))], [*range(1, len(arcs) + 1)])
        if len(columns) >= FEWEST and rising and not counted and len({unit for _, unit, _ in columns}) == 1:
            listed.append(Columns(start, arcs, columns[0][1], columns[0][2]))
    return listed
