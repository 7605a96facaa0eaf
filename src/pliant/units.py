"""Conversion of units to and from SI. All other modules use SI units only."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any, Literal, get_args

from pliant.errors import InputError, shown

PASCAL = {"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": 6894.757293168361, "hpa": 1e2,
          "mmhg": 133.322387415, "inhg": 3386.388640341, "torr": 101325.0 / 760.0, "cmh2o": 98.0665, "atm": 101325.0,
          "kgf/cm2": 98066.5}  # fmt: skip
RADIAN = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}
NEWTON = {"n": 1.0, "mn": 1e-3, "kn": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605}
METRE = {"m": 1.0, "dm": 1e-1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
PIXEL = "px"
SECOND = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
SPELLINGS = {  # unit: other spellings of it, in lower case
    "s": "sec secs second seconds", "ms": "msec msecs millisecond milliseconds",
    "us": "usec microseconds \u00b5s \u03bcs",
    "ns": "nsec nanoseconds", "min": "mins minute minutes", "h": "hr hrs hour hours",
    "m": "meter meters metre metres", "cm": "centimeter centimeters centimetre centimetres",
    "mm": "millimeter millimeters millimetre millimetres", "um": "micron microns micrometers \u00b5m \u03bcm",
    "in": "inch inches", "ft": "foot feet", "px": "pixel pixels pix",
    "deg": "degree degrees \u00b0", "rad": "radian radians",
    "rev": "turn turns revs revolution revolutions", "n": "newton newtons", "pa": "pascal", "kpa": "kilopascal",
    "inhg": "in.hg", "cmh2o": "cmh\u2082o", "kgf/cm2": "kgf/cm^2 kgf/cm\u00b2 kg/cm2 kg/cm^2 kg/cm\u00b2",
}  # fmt: skip
SPELLED = {other: unit for unit, others in SPELLINGS.items() for other in others.split()}
GAUGE = re.compile(r"(.+?)[\s_-]*(?:\(?(?:g|gauge|gage|rel|relative)\)?)")
ABSOLUTE = re.compile(r"(.+?)[\s_-]*(?:\(?(?:a|abs|absolute)\)?)")
KILOGRAM = {"kg": 1.0, "g": 1e-3, "mg": 1e-6}
OF_ONE_KIND = (  # units that can be converted to each other
    PASCAL, RADIAN, NEWTON, METRE, SECOND, KILOGRAM, {"n m": 1.0, "mn m": 1e-3, "nm": 1.0, "mnm": 1e-3},
    {"1/m": 1.0, "1/mm": 1e3}, {"m/s^2": 1.0}, {"1/h": 1.0, "1/min": 60.0},
)  # fmt: skip
NUMBER_WITH_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+|nan\b|inf\b)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
ENDINGS = {  # of names that carry their unit, longer ones first
    "rad_s": "rad/s", "mn_m": "mN m", "us_per_sample": "us", "ns_per_step_one_core": "ns", "percent": "%", "mm": "mm",
    "kpa": "kPa", "pa": "Pa", "hz": "Hz", "deg": "°", "rad": "rad", "us": "us", "ms": "ms", "ns": "ns", "s": "s",
    "n": "N", "m": "m", "g": "g",
}


def standard_unit(text: str) -> str:
    """Return the spelling of a unit that the tables of this module use: "Inches" gives "in", and "bar(g)", a gauge
    pressure, "bar". An unknown unit is returned in lower case.
    """
    unit = " ".join(text.lower().split())
    unit = SPELLED.get(unit, unit)
    if unit not in PASCAL and (match := GAUGE.fullmatch(unit)) and match[1] in PASCAL:
        return match[1]
    joined = unit.replace(" ", "")  # mm Hg
    return joined if joined in PASCAL else unit


def absolute_unit(text: str) -> str:
    """Return the unit of a pressure whose unit says that it is absolute, such as "bar" for "bar(a)"; "" for others."""
    match = ABSOLUTE.fullmatch(" ".join(text.lower().split()))
    return match[1] if match and match[1] in PASCAL else ""


def quantity(name: str) -> tuple[str, str]:
    """Split a name that ends with a unit into words and unit: "largest_rate_rad_s" gives ("largest rate", "rad/s")."""
    for ending, unit in ENDINGS.items():
        if name.endswith(f"_{ending}"):
            return name.removesuffix(f"_{ending}").replace("_", " "), unit
    return name.replace("_", " "), ""


def number_in(text: str, unit: str) -> float:
    """Return the number, in `unit`, of a text such as "25", "25 kPa" or "0.25bar". A number alone is in `unit` already.

    Raises
    ------
    InputError
        When the text is not a number, or its unit is unknown or of another kind.
    """
    match = NUMBER_WITH_UNIT.fullmatch(text)
    if match is None:
        raise InputError(f"{shown(text.strip())} is not a number in {unit}: write it as 25 or 25{unit}")
    known = next((table for table in OF_ONE_KIND if unit.lower() in table), {unit.lower(): 1.0})
    stated = match[2].lower() or unit.lower()
    if stated not in known:
        raise InputError(f"{shown(text.strip())} is not in {unit}: use one of {', '.join(known)}, or a number alone")
    return float(match[1]) * (known[stated] / known[unit.lower()])


def _factor(table: dict[str, float], unit: str, what: str) -> float:
    try:
        return table[standard_unit(unit)]
    except KeyError:
        raise InputError(f"unknown unit of {what} {shown(unit)}: use one of {', '.join(table)}") from None


def pascal_per(unit: str) -> float:
    """Return the number of pascals in one `unit` of pressure ("kPa", "bar", "psi", ...).

    Raises InputError if the unit is unknown.
    """
    return _factor(PASCAL, unit, "pressure")


def radian_per(unit: str) -> float:
    """Return the number of radians in one `unit` of angle ("rad" or "deg").

    Raises InputError if the unit is unknown.
    """
    return _factor(RADIAN, unit, "angle")


def newton_per(unit: str) -> float:
    """Return the number of newtons in one `unit` of force ("N", "mN", "kN", "gf", "kgf" or "lbf").

    Raises InputError if the unit is unknown.
    """
    return _factor(NEWTON, unit, "tension")


def input_per(unit: str) -> float:
    """Return the number of newtons, metres or radians in one `unit` of tension, displacement or angle.

    Raises InputError if the unit is unknown.
    """
    return _factor({**NEWTON, **METRE, **RADIAN}, unit, "tension, displacement or angle")


def shown_in(unit: str) -> tuple[float, str]:
    """Return the plot unit for an SI `unit` as (factor from SI, name): "Pa" gives (1e-3, "kPa"),
    "m" gives (1e3, "mm").
    """
    return {"Pa": (1e-3, "kPa"), "m": (1e3, "mm")}.get(unit, (1.0, unit))


DrivenBy = Literal["tension", "displacement", "angle"]  # of a tendon
KIND_OF = {"Pa": "pressure", **dict(zip(("N", "m", "rad"), get_args(DrivenBy), strict=True))}  # of an input, by SI unit


def inputs_word(kinds: Iterable[str]) -> str:
    """Return what inputs of these kinds are called: "chamber" if all are pressures, else "input"."""
    return "chamber" if all(kind == "pressure" for kind in kinds) else "input"


def input_words(units: Iterable[str]) -> tuple[str, str]:
    """Return a word for inputs of these SI units, such as "pressure" for Pa, and the units in which figures show them,
    such as kPa.
    """
    distinct = list(dict.fromkeys(units))
    word = (KIND_OF | {"rad": "motor angle"})[distinct[0]] if len(distinct) == 1 else "input"
    return word, ", ".join(shown_in(unit)[1] for unit in distinct)


def in_words(values: Any, unit: str) -> str:
    """Return input values in the SI unit `unit` as text in the unit used by plots, such as "190 kPa" or "2.5, 3 N"."""
    import numpy as np  # here, so that --help stays fast

    factor, word = shown_in(unit)
    return ", ".join(f"{factor * value:.4g}" for value in np.ravel(values)) + f" {word}"


def metre_per(unit: str) -> float:
    """Return the number of metres in one `unit` of length ("m", "cm", "mm", "um" or "in").

    Raises InputError if the unit is unknown.
    """
    return _factor(METRE, unit, "length")
