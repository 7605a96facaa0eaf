"""Columns of a table that nobody described in which actuation inputs are: their kind, unit and scale, from names, units
and values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pliant.recording.column_names import bracketed_unit, is_command, unit_of, words_of
from pliant.recording.vocabulary import AMBIENT, NOT_INSIDE, PRESSED, in_english
from pliant.study.shorthand import OPEN
from pliant.study.table_columns import PlainTable
from pliant.units import METRE, NEWTON, PASCAL, RADIAN, absolute_unit, pascal_per

TURNED = {"roll", "pitch", "yaw", "euler", "rx", "ry", "rz", "rot", "heading"}
UNITS = {"pressure": PASCAL, "displacement": METRE, "angle": RADIAN, "tension": NEWTON}  # the most frequent first
WORDS = {
    "pressure": {"pressure", "press", "chamber", "pouch", "valve", "air"},
    "tension": {"tension", "force", "load"},
    "steps": {"step", "steps", "stepper", "count", "counts", "tick", "ticks"},
    "displacement": {"tendon", "cable", "wire", "stroke", "displacement", "pull", "elongation"},
    "angle": {"phi", "theta", "motor", "angle", "encoder", "enc", "servo"},
}  # fmt: skip
OTHER_WORDS = set().union(*(words for kind, words in WORDS.items() if kind != "pressure"))
DEFAULT_UNITS = {"angle": "deg", "displacement": "mm", "tension": "N"}
DEGREES, TWO_TURNS = {"angle", "theta", "phi", "servo"}, 720.0  # names of angles, which may be whole degrees
METRES = 0.5  # a smaller range of displacements without a unit is in metres
VALVES = {*WORDS["pressure"], "p", "solenoid", "pwm", "duty", "regulator", "pump", "compressor", "inflate", "inflation"}
ABSOLUTES = {"abs", "absolute"}
PERCENT = {"%", "percent", "pct"}  # of a valve's duty or opening, which is 0 without pressure
CONVERTER = re.compile(r"(?:.*[\W_])?(?:adc|ai)_?[0-9]{1,2}(?:[ _]?[\[(]?(?:v|volts?|counts?|raw)[\])]?)?",
                       re.IGNORECASE)  # fmt: skip
MOVING = 0.2  # of the variance of a signal: mean squared step from row to row, which is 2 for noise alone
SERVOS = {"dxl", "dynamixel"}  # whose positions are angles
COUNTED = {"v", "volt", "volts", "mv", "ma", "counts", "count", "adc", "dac", "raw", "bit", "bits", "lsb"}
OTHER_UNITS = {*COUNTED, *PERCENT, "a", "w", "hz", "ohm", "kohm", "rpm", "m/s", "mm/s", "cm/s", "deg/s", "rad/s"}
RATES = {"q", "r"}  # names of rates of turning, beside which p is another
ZERO = "the reading at rest at atmospheric pressure"
VARIES = 0.2  # of its largest value: the air around a body varies less
WEIGHED = {"g": "gf", "gram": "gf", "grams": "gf", "kg": "kgf", "lb": "lbf", "lbs": "lbf"}  # of load cells
RAW, ABSOLUTE = "raw", "absolute"  # kinds of columns that become gauge pressures by numbers that a laboratory knows


def kind_of(table: PlainTable, k: int) -> tuple[str, str]:
    """Return the kind and the unit ("" if unknown) of the input in column k, by unit, words and integer steps of its
    name and values; ("", "") if nothing shows that it is an input.

    The kind of a valve's state or duty, and of a pressure sensor's volts or counts, is `RAW`, with their unit.
    """
    name, words = table.names[k], words_of(table.names[k])
    raw = ("", "") if TURNED & set(words) else pneumatic(table, k)
    if raw is not None:
        return raw
    for kind, units in UNITS.items():
        if len(words) > 1 and (unit := unit_of(name, units)) and (unit != "m" or kind == "displacement"):
            return kind, unit
        if len(words) <= 2 and words and words[0] in units and kind == "pressure":
            return kind, words[0]
    if DEGREES & set(words) and np.nanmax(np.abs(table.values[:, k])) <= TWO_TURNS:
        return "angle", ""
    return named_input(table, k, words)


def named_input(table: PlainTable, k: int, words: Sequence[str]) -> tuple[str, str]:
    """Return the kind of the input that the words of the name of a column k say, and the unit of a load cell, or of a
    pressure if it is among the words; ("", "") if there is none, or its unit is that of another quantity.
    """
    stated, whole = bracketed_unit(table.names[k]), table.whole(k)
    for kind, known in WORDS.items():
        if not known & set(words) or (kind == "steps" and not whole):
            continue
        if whole and kind in ("steps", "angle", "displacement"):
            return "steps", ""
        if stated in OTHER_UNITS and not is_label(table, k, stated):
            return "", ""
        weight = stated or (words[-1] if len(words) > 1 else "")
        if kind == "tension" and weight in WEIGHED and not is_label(table, k, weight):
            return kind, WEIGHED[weight]
        return kind, pressure_unit_among(words) if kind == "pressure" and not stated else ""
    return "", ""


def lone_input(table: PlainTable, k: int) -> tuple[str, str]:
    """Return the kind and the unit of the input that a column k may be where no other column is one: the position of a
    servo, a pressure p, or a duty.
    """
    words = words_of(table.names[k])
    if is_place_of_servo(words):
        return "steps" if table.whole(k) else "angle", ""
    if is_bare_pressure(table, k):
        return "pressure", ""
    return (RAW, "%") if "pwm" in words and not OTHER_WORDS & set(words) else ("", "")


def converted_input(table: PlainTable, k: int) -> tuple[str, str]:
    """Return the kind and the unit of a column k that is the reading of a converter, such as adc0, and moves beyond its
    noise, which may be a pressure where nothing else is an input.
    """
    known = table.values[np.isfinite(table.values[:, k]), k]
    moves = known.size > 1 and np.mean(np.diff(known) ** 2) < MOVING * np.var(known)
    return (RAW, "adc") if moves and CONVERTER.fullmatch(table.names[k]) else ("", "")


def is_place_of_servo(words: Sequence[str]) -> bool:
    """Return whether words such as dxl, 1, present, position say the angle of a servo, not its current or load."""
    others = {word for word in words if not word.isdigit()} - SERVOS
    if words[:1] == ["present"] and {"position", "pos"} & others:  # beside goal_position, of a servo
        return True
    return bool(SERVOS & set(words)) and (not others or bool({"position", "pos"} & others))


def is_label(table: PlainTable, k: int, letter: str) -> bool:
    """Return whether a letter in the name of a column k tells it from another column, as A and B do in motor (A) and
    motor (B), and is no unit.
    """
    name = table.names[k]
    unlike = [[(a, b) for a, b in zip(name, other, strict=True) if a != b] for other in table.names
              if len(other) == len(name)]  # fmt: skip
    return any(len(pairs) == 1 and pairs[0][0].lower() == letter and pairs[0][1].isalpha() for pairs in unlike)


def is_bare_pressure(table: PlainTable, k: int) -> bool:
    """Return whether a column k is named p, p1 or the like and can be a pressure: not the likelihood of a point or a
    rate of turning.
    """
    name, names = in_english(table.names[k]).lower(), {other.lower() for other in table.names}
    likelihood = f"x{name[1:]}" in names - {"x"} or np.nanmax(np.abs(table.values[:, k])) <= 1.0
    return PRESSED.fullmatch(name) is not None and not likelihood and not RATES & names


def pressure_unit_among(words: Sequence[str]) -> str:
    """Return the unit of pressure that is one of the words of a name such as /chamber_kpa/data; "" for none or several,
    and for atm, which may say the atmosphere.
    """
    units = {word for word in words if word in PASCAL and word != "atm"}
    return units.pop() if len(units) == 1 else ""


def pneumatic(table: PlainTable, k: int) -> tuple[str, str] | None:
    """Return the kind and the unit of a column k with an absolute pressure, or with the state or reading of a valve or
    pressure sensor in a unit that is none of pressure; None for another column.
    """
    name = table.names[k]
    words = [part for word in words_of(name) for part in (word, word.rstrip("0123456789"))]
    stated = bracketed_unit(name)
    of_pressure = unit_of(name, PASCAL) or next((w for w in words if w in PASCAL and w != "atm"), "")
    absolute = next((unit for word in words_of(name) if word not in PASCAL and (unit := absolute_unit(word))), "")
    if unit := absolute_unit(stated) or absolute or (of_pressure if ABSOLUTES & set(words) else ""):
        return ABSOLUTE, unit
    if of_pressure or not VALVES & set(words):
        return None
    known = table.values[np.isfinite(table.values[:, k]), k]
    if set(np.unique(known)) == {0.0, 1.0}:
        return RAW, "0 or 1"
    if "pwm" in words and "valve" in words:
        return RAW, "%"
    unit = next((u for u in (stated, *words) if u in COUNTED | PERCENT), "%" if "%" in name else "")
    return (RAW, "%" if unit in PERCENT else unit) if unit else None


def input_entries(table: PlainTable, columns: Sequence[int]) -> tuple[dict[str, Any], list[int], list[str]]:
    """Return the mapping entries of the inputs in the columns, the columns that are none, and sentences. Of an input
    that was measured, the command is left out, as is a supply or an atmosphere beside the pressures of a body.
    """
    notes: list[str] = []
    inside = [k for k in columns if not is_ambient(table, k)]
    kinds = next(filter(None, (grouped({k: of(table, k) for k in inside})
                               for of in (kind_of, lone_input, converted_input))), {})  # fmt: skip
    left = [k for k in columns if not any(k in members for members in kinds.values())]
    for is_idle, what in ((is_command, "commands beside measured inputs"),
                          (is_outside, "supplies beside pressures of a body")):  # fmt: skip
        for key, members in kinds.items():
            idle = [k for k in members if is_idle(table.names[k])]
            if idle and len(idle) < len(members):
                kinds[key] = [k for k in members if k not in idle]
                notes.append(f"{what} are not used: {', '.join(table.names[k] for k in idle)}")
    pressures = {unit: members for (kind, unit), members in kinds.items() if kind == "pressure"}
    if len(pressures) > 1:
        left += pressures.pop("", [])
    signals = {key: members for key, members in kinds.items() if key[0] in (RAW, ABSOLUTE)}
    if pressures and signals:
        unused = ", ".join(table.names[k] for members in signals.values() for k in members)
        notes.append(f"valves and sensors beside measured pressures are not used: {unused}")
    mapping: dict[str, Any] = {}
    if pressures:
        mapping["pressure"] = pressure_entry(table, pressures)
    elif signals:
        (kind, unit), members = next(iter(signals.items()))
        mapping["pressure"] = signal_entry([table.names[k] for k in members], kind, unit)
    others = {key: members for key, members in kinds.items() if key[0] not in ("pressure", RAW, ABSOLUTE)}
    for (kind, unit), members in others.items():
        entry, note = input_entry(table, members, kind, unit)
        mapping.setdefault("inputs", []).append(entry)
        notes += [note] if note else []
        if kind == "steps":
            mapping["linear"] = {"actuation": {"scale": OPEN}} if len(kinds) == 1 else {
                name: {"scale": OPEN} for name in entry["columns"]}  # fmt: skip
    return mapping, left, notes


def grouped(known: Mapping[int, tuple[str, str]]) -> dict[tuple[str, str], list[int]]:
    """Return the columns that are inputs by their kind and unit."""
    kinds: dict[tuple[str, str], list[int]] = {}
    for k, kind in known.items():
        if kind[0]:
            kinds.setdefault(kind, []).append(k)
    return kinds


def is_ambient(table: PlainTable, k: int) -> bool:
    """Return whether a column k holds the pressure of the air around a body; p_atm is a pressure in atm if it varies
    much.
    """
    name, values = in_english(table.names[k]).partition("[")[0].partition("(")[0].strip(), table.values[:, k]
    width = np.nanmax(values) - np.nanmin(values)
    in_atm = table.names[k].lower().endswith("atm") and bool(width > VARIES * np.nanmax(np.abs(values)))
    return AMBIENT.fullmatch(name) is not None and not in_atm


def is_outside(name: str) -> bool:
    """Return whether the name of a column says a pressure that is not in the body, such as a supply."""
    return NOT_INSIDE.fullmatch(in_english(name)) is not None and not is_command(name)


def pressure_entry(table: PlainTable, groups: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """Return the entry `pressure` for columns by their unit ("" if unknown): in this unit or, of several, in Pa."""
    columns = [table.names[k] for members in groups.values() for k in members]
    if len(groups) == 1:
        return {"columns": columns, "unit": next(iter(groups)) or OPEN}
    scale = [pascal_per(unit) for unit, members in groups.items() for _ in members]
    return {"columns": columns, "unit": "Pa", "scale": scale}


def signal_entry(columns: list[str], kind: str, unit: str) -> dict[str, Any]:
    """Return the entry `pressure` for columns that become gauge pressures by numbers that only the laboratory knows."""
    if kind == ABSOLUTE:
        return {"columns": columns, "unit": unit, "zero": OPEN}
    return {"columns": columns, "unit": "kPa", "scale": OPEN, **({"zero": OPEN} if unit in COUNTED else {})}


def input_entry(table: PlainTable, members: Sequence[int], kind: str, unit: str) -> tuple[dict[str, Any], str]:
    """Return an entry of `inputs` for columns of one kind, and a sentence if their unit was assumed."""
    names = [table.names[k] for k in members]
    if kind == "steps":
        values = table.values[:, members]
        width = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
        first = values[np.isfinite(values).all(axis=1)][:1]
        far = f"{', '.join(names)}: far from 0 at first; if nothing pulls then, add zero = {first.ravel().tolist()}"
        entry = {"columns": names, "kind": "displacement", "unit": "mm"}
        return entry, far if (np.abs(first) > width).any() else ""
    if unit:
        return {"columns": names, "kind": kind, "unit": unit}, ""
    widest = float(np.nanmax(np.abs(table.values[:, list(members)])))
    unit = "m" if kind == "displacement" and widest < METRES else DEFAULT_UNITS[kind]
    note = f"{', '.join(names)}: taken in {unit}, as no name states a unit; correct unit if they are not"
    return {"columns": names, "kind": kind, "unit": unit}, note


def pressure_question(table: PlainTable, pressure: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the entry `pressure` with values assumed for its open numbers, and the question about them ("" if none is
    open).
    """
    columns = [table.names.index(c) for c in pressure["columns"]]
    values = table.values[:, columns]
    high = float(np.nanmax(values))
    if pressure["unit"] == OPEN:
        return ({**pressure, "unit": likely_unit(high)},
                f"unit (gauge): kPa, mbar, bar, psi or Pa; the highest value is {high:.4g}")  # fmt: skip
    if "scale" in pressure and pressure["scale"] == OPEN:
        low = float(np.nanmin(values)) if "zero" in pressure else 0.0
        zeros = {"zero": low} if "zero" in pressure else {}
        asked = f"; zero: {ZERO}" if zeros else "; of a valve or duty: the supply pressure over its highest value"
        return {**pressure, **zeros, "scale": 50.0 / ((high - low) or 1.0)}, \
            f"scale: kPa for each 1 of {pressure['columns'][0]}, whose highest value is {high:.4g}{asked}"
    if pressure.get("zero") == OPEN:
        unit = pressure["unit"]
        atmosphere = 101325.0 / pascal_per(unit)
        return {**pressure, "zero": atmosphere}, (f"zero: the atmosphere in {unit}, near {atmosphere:.4g}, since the "
                                                  f"name says absolute pressure; the lowest is {np.nanmin(values):.4g}")
    return dict(pressure), ""


def likely_unit(high: float) -> str:
    """Return the unit with which a highest pressure moves a soft body: 5 to 500 kPa."""
    return next((u for u in ("kPa", "psi", "mbar", "bar", "Pa") if 5e3 <= high * PASCAL[u.lower()] <= 5e5), "kPa")
