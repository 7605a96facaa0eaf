"""Plausibility checks: mistakes in the input that would give a wrong model without an error, named before they do.

Each check is one function in one list; `doubts` runs them. A check warns, it changes nothing.
"""

from __future__ import annotations

from pliant.preprocessing.plausibility import body, clock, fitted, pressure, shape
from pliant.preprocessing.plausibility.contract import Case, Check, Subject

CHECKS: tuple[Check, ...] = (*clock.CHECKS, *pressure.CHECKS, *shape.CHECKS, *body.CHECKS, *fitted.CHECKS)

UNITS = tuple(check.name for check in CHECKS if check.name.startswith("unit of "))

__all__ = ["CHECKS", "UNITS", "Case", "Check", "doubts"]


def doubts(case: Case, *subjects: Subject) -> dict[str, str]:
    """Sentences of the checks of these subjects that find something, by the name of the check; default: all."""
    chosen = [c for c in CHECKS if not subjects or c.subject in subjects]
    return {c.name: sentence for c in chosen if (sentence := c.find(case))}
