"""Checks for mistakes that would silently give a wrong model, such as a wrong unit in a recording, in the stated data
or in a fitted model.

Each check is one function in a list, and `doubts` runs them. A check only warns and changes nothing.
"""

from __future__ import annotations

from pliant.preprocessing.plausibility import body, pressure, shape
from pliant.preprocessing.plausibility.contract import Case, Check, Subject

CHECKS: tuple[Check, ...] = (*pressure.CHECKS, *shape.CHECKS, *body.CHECKS)

UNITS = tuple(check.name for check in CHECKS if check.name.startswith("unit of "))

__all__ = ["CHECKS", "UNITS", "Case", "Check", "doubts"]


def doubts(case: Case, *subjects: Subject) -> dict[str, str]:
    """Run the plausibility checks of the given subjects (recording, body, model; default: all) and return, by name of
    the check, a sentence on each problem found.
    """
    chosen = [c for c in CHECKS if not subjects or c.subject in subjects]
    return {c.name: sentence for c in chosen if (sentence := c.find(case))}
