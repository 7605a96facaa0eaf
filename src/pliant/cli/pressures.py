"""Pressures on the command line: a level for each chamber of a model, and which recorded pressure drives which."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pliant.errors import InputError

if TYPE_CHECKING:
    from pliant.model import Model

LEVELS = "kPa gauge; of several chambers one for each, as 80,30, or by name, as left=80: the others rest"
DRIVE = "Of several chambers: which recorded pressure drives which, as left=p1,right=p2; default: by their names."


def levels(model: Model, text: str) -> list[float]:
    """Pressure [Pa] of each chamber from numbers in kPa: in the order of the chambers, or by their names."""
    names = [c.name for c in model.chambers]
    if "=" in text:
        given = pairs("--level-kpa", text)
        if strange := [name for name in given if name not in names]:
            raise InputError(f"--level-kpa names the chamber {strange[0]!r}, and the model has {', '.join(names)}")
        return [1e3 * number(given.get(name, "0")) for name in names]
    found = [1e3 * number(part) for part in text.split(",")]
    if len(found) != len(names):
        raise InputError(
            f"--level-kpa gives {len(found)} pressure(s), and the model has {len(names)} chamber(s), "
            f"{', '.join(names)}: give one for each, as {','.join(['30'] * len(names))}, or by name, as {names[0]}=30"
        )
    return found


def number(text: str) -> float:
    """A pressure in kPa."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--level-kpa takes numbers in kPa, got {text.strip()!r:.60}") from None


def pairs(option: str, text: str) -> dict[str, str]:
    """The words of ``name=word,name=word``."""
    parts = [part.partition("=") for part in text.split(",")]
    found = {name.strip(): word.strip() for name, _, word in parts}
    if not all(found) or not all(found.values()) or len(found) != len(parts):
        raise InputError(f"{option} takes pairs as left=p1,right=p2, each chamber once, got {text!r:.80}")
    return found


def drives(text: str) -> dict[str, str | int] | None:
    """Chamber of the model to the recorded pressure that drives it, a name or an index from 0; None for no text."""
    if not text:
        return None
    return {name: int(word) if word.isdecimal() else word for name, word in pairs("--drive", text).items()}
