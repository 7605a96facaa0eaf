"""Levels of the inputs of exported models that an option states."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.model import Model
from pliant.units import in_words

Array = np.ndarray


def stated_levels(target: str, option: str, text: str, model: Model) -> Array:
    """Return the levels (C,) [SI] of C inputs that the text of an option states. One number holds for all inputs if
    these have the same unit, or if it is 0.
    """
    levels, actuation = levels_in(target, option, text), model.actuation
    if levels.size == actuation.count or (levels.size == 1 and (not levels[0] or len(set(actuation.units)) == 1)):
        return np.broadcast_to(levels, actuation.count)
    named = ", ".join(f"{name} [{unit}]" for name, unit in zip(actuation.names, actuation.units, strict=True))
    raise InputError(f"{target} option {option} gives {levels.size} number(s) for the inputs {named}: give one for "
                     "each, separated by commas")  # fmt: skip


def range_note(model: Model, highest: Array) -> str:
    """Return the note of an export that states the default range of its controls, up to `highest` (C,) [SI]."""
    names, units = model.actuation.names, model.actuation.units
    words = [in_words(*one) for one in zip(highest, units, strict=True)]
    several = len(set(units)) > 1
    upper = ", ".join(f"{word} ({name})" for word, name in zip(words, names, strict=True)) if several else words[0]
    listed = ", ".join(units) if several else units[0]
    return f"controls range from 0 to {upper}: set highest ({listed}) for another range"


def levels_in(target: str, option: str, text: str) -> Array:
    """Return the levels (C,) [SI] that the text of an option states: one number, or numbers separated by commas."""
    try:
        return np.array([float(part) for part in text.strip("[]() ").split(",")])
    except ValueError:
        raise InputError(f"{target} option {option} must be a number in Pa for each chamber (N, m or rad for each "
                         f"tendon), separated by commas, got {text!r:.60}") from None  # fmt: skip
