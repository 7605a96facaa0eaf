"""Recognition of the columns of a table that hold curvatures along a fibre, by names that share a beginning and go on
with arc lengths, such as `Curvature 10 mm`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from pliant.recording.column_names import is_time, words_of
from pliant.recording.curvature import ARC, PER_METRE
from pliant.study.shorthand import OPEN

CURVATURE = {"k", "kappa", "curvature", "curv", "curvatures", "\u03ba"}
DIRECTION = {"a", "angle", "direction", "dir", "phi", "theta", "orientation"}
FEWEST = 4  # arc lengths that are no numbers of stations


class Columns(NamedTuple):
    """Columns whose names share a beginning: their arc lengths as they are written, and the units behind these."""

    start: str
    arcs: tuple[str, ...]
    unit: str  # of the arc length, "" if none is stated
    curvature_unit: str


def curvature_columns(names: Sequence[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the entries of a mapping for the columns of curvature in the names of a table, and a question for each
    entry that they leave open, which is "?"; empty if no columns of curvature have a time beside them.
    """
    groups = along(names)
    curved = next((g for g in groups if CURVATURE & {*words_of(g.start)}), None)
    if curved is None or not any(map(is_time, names)):
        return {}, {}
    turned = next((g for g in groups if DIRECTION & {*words_of(g.start)} and g.arcs == curved.arcs), None)
    entries = {"curvature": curved.start, "curvature_unit": curved.curvature_unit or OPEN,
               "arc_unit": curved.unit or OPEN}  # fmt: skip
    if turned is not None:
        entries["direction"] = turned.start
    questions = {"curvature_unit": f"unit of the curvatures: {', '.join(PER_METRE)}",
                 "arc_unit": "unit of the arc lengths in the names of the columns: m, cm, mm"}  # fmt: skip
    return entries, {name: questions[name] for name, value in entries.items() if value == OPEN}


def along(names: Sequence[str]) -> list[Columns]:
    """Return the groups of at least four columns whose names have the same beginning and rising arc lengths."""
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for name in names:
        for k, letter in enumerate(name):
            if (letter.isdigit() or letter in "+-.") and (match := ARC.fullmatch(name[k:])):
                bracket = name[k:].rpartition("[")[2] if "[" in name[k:] else name[k:].rpartition("(")[2]
                unit = bracket.rstrip(" )]").replace("rad/", "1/").replace("m^-1", "1/m")
                groups.setdefault(name[:k], []).append((match[1], (match[2] or "").lower(),
                                                        unit if unit in PER_METRE else ""))  # fmt: skip
                break
    listed = []
    for start, columns in groups.items():
        arcs = tuple(arc for arc, _, _ in columns)
        rising = all(float(a) < float(b) for a, b in pairwise(arcs))
        if len(columns) >= FEWEST and rising and len({unit for _, unit, _ in columns}) == 1:
            listed.append(Columns(start, arcs, columns[0][1], columns[0][2]))
    return listed
