"""Values of inputs that the names of files state, such as pulse_60kPa or m1_-3mm: with their signs, or not at all where
a name is ambiguous.
"""

from __future__ import annotations

import re

from pliant.units import METRE, NEWTON, PASCAL, RADIAN, pascal_per

LEVEL = re.compile(rf"(\d+(?:\.\d+)?)[ _-]?({'|'.join(map(re.escape, PASCAL))})(?![a-z])", re.IGNORECASE)
NAMED = re.compile(r"(?<![A-Za-z0-9.])(\d+(?:\.\d+)?)[ _-]?(N|mN|mm|cm|deg|rad)(?![A-Za-z0-9])")
NEGATIVE = re.compile(r"[-\u2212\u2013]$")
UNCLEAR = re.compile(  # before a number: a sign or a hyphen, a decimal comma, a sign in words
    r"(?:[^\s_(\[=][-+\u2212\u2013]|\d,|(?:minus|neg|negative|vac|vacuum)[_ -]?)$", re.IGNORECASE)
NUMBERED = re.compile(r"(?<![A-Za-z0-9.])(0|[1-9]\d*)[_ ]$")  # another number before, or the whole part of a decimal
OF_TENDONS = {"tension": ("N", NEWTON), "displacement": ("m", METRE), "angle": ("rad", RADIAN)}  # SI unit, known units
LEAST = 3e3  # Pa: a smaller pressure moves no soft body, so that 1_60kPa is 60 kPa


def named_pressure(stem: str) -> float | None:
    """Return the gauge pressure [Pa] that the name of a file states, such as pulse_60kPa or vent_-20kPa; None if it
    states none or several, or if its sign or its decimals are unclear, as in p-20kPa, 12,5kPa or 2_5bar.
    """
    values = set()
    for match in LEVEL.finditer(stem):
        number, unit = match.groups()
        before = stem[: match.start()]
        part = NUMBERED.search(before)
        decimal = float(f"{part[1]}.{number.replace('.', '')}") if part else 0.0
        if UNCLEAR.search(before) or decimal * pascal_per(unit) > LEAST:
            return None
        values.add(float(number) * pascal_per(unit) * (-1 if NEGATIVE.search(before) else 1))
    return values.pop() if len(values) == 1 else None


def named_pressures(stem: str) -> dict[str, float]:
    """Return the gauge pressures [Pa] that the name of a file states with a label before each, such as A10kPa_B0kPa, by
    these labels; {} if it states fewer than two so, or if one is unclear.
    """
    labelled, end = dict[str, float](), 0
    for match in LEVEL.finditer(stem):
        label = stem[end : match.start()].strip("_- ")
        if not label[:1].isalpha() or label in labelled or UNCLEAR.search(stem[: match.start()]):
            return {}
        sign = -1 if NEGATIVE.search(stem[: match.start()]) else 1
        labelled[label], end = sign * float(match[1]) * pascal_per(match[2]), match.end()
    return labelled if len(labelled) > 1 else {}


def named_tendon(stem: str) -> tuple[str, float] | None:
    """Return the kind and the value [SI] of the input of a tendon that the name of a file states, such as m1_2.5N
    or m1_-3mm; None if it states none, or if its sign or its decimals are unclear, as in motor-20deg or 2_5N.
    """
    stated = [*NAMED.finditer(stem)]
    before = stem[: stated[-1].start()] if stated else ""
    if not stated or UNCLEAR.search(before) or NUMBERED.search(before):
        return None
    number, unit = stated[-1].groups()
    kind, scale = next((kind, units[unit.lower()]) for kind, (_, units) in OF_TENDONS.items() if unit.lower() in units)
    return kind, float(number) * (-scale if NEGATIVE.search(before) else scale)
