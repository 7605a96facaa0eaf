"""Levels of the inputs of exported models: those of an option, and the range of controls."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.exporters.registry import levels_in
from pliant.model import Model
from pliant.simulation.state import typical_pressure
from pliant.units import in_words

Array = np.ndarray


def default_levels(model: Model) -> Array:
    """Return the level (C,) [SI] up to which the controls of C inputs reach by default: twice the level of the first
    input that bends the body by half a radian, or for inputs of different units, twice that of each.
    """
    each = range(model.actuation.count if len(set(model.actuation.units)) > 1 else 1)
    return np.broadcast_to([2.0 * typical_pressure(model, c) for c in each], model.actuation.count)


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
