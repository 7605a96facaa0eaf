"""Plausibility checks of recordings, stated data and models, for mistakes that give a wrong model silently.

Each check is one function in a list, and `doubts` runs them. A check only warns and changes nothing.
"""

from __future__ import annotations

from pliant.preprocessing.plausibility import body, clock, fitted, pressure, shape
from pliant.preprocessing.plausibility.contract import Case, Check, Subject

CHECKS: tuple[Check, ...] = (*clock.CHECKS, *pressure.CHECKS, *shape.CHECKS, *body.CHECKS, *fitted.CHECKS)

UNITS = tuple(check.name for check in CHECKS if check.name.startswith("unit of "))

__all__ = ["CHECKS", "UNITS", "Case", "Check", "doubts"]


def doubts(case: Case, *subjects: Subject) -> dict[str, str]:
    """Return the sentences of all checks of `subjects` (default: all) that found a problem, by name of the check."""
    chosen = [c for c in CHECKS if not subjects or c.subject in subjects]
    return {c.name: sentence for c in chosen if (sentence := c.find(case))}
