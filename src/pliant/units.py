"""The only place where units other than SI are known: the doors of the house convert here."""

from __future__ import annotations

from pliant.errors import InputError, shown

PASCAL = {"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": 6894.757293168361}
METRE = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}


def _factor(table: dict[str, float], unit: str, what: str) -> float:
    try:
        return table[unit.strip().lower()]
    except KeyError:
        raise InputError(f"unknown unit of {what} {shown(unit)}: use one of {', '.join(table)}") from None


def pascal_per(unit: str) -> float:
    """Pascals in one `unit` of gauge pressure; InputError when the unit is unknown."""
    return _factor(PASCAL, unit, "pressure")


def metre_per(unit: str) -> float:
    """Metres in one `unit` of length; InputError when the unit is unknown."""
    return _factor(METRE, unit, "length")
