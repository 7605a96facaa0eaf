"""Checks that parameters of a model or a chamber are finite numbers of the right sign and size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import fields
from math import inf
from typing import Any, ClassVar

import numpy as np

from pliant.errors import InputError
from pliant.model.quantity import quantities

Array = np.ndarray


class EqualByFields:
    """Equality of dataclasses some of whose fields are arrays, by class and fields."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return all(np.array_equal(a, b) if isinstance(a, Array) else a == b for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]


def numbers(name: str, value: Any) -> Array:
    """Return `value` as a new one-dimensional array of floats; raise InputError if this is impossible."""
    try:
        a = np.atleast_1d(np.array(value, dtype=float))
    except (TypeError, ValueError):
        raise InputError(f"model {name} must be numbers, got {value!r:.80}") from None
    if a.ndim != 1:
        raise InputError(f"model {name} must be one number or one row of numbers, got shape {a.shape}")
    return a


def check_names(what: str, names: Sequence[str]) -> None:
    """Raise InputError if two of the `names` are equal. `what` says what has these names."""
    if len(set(names)) < len(names):
        name, count = Counter(names).most_common(1)[0]
        raise InputError(f"{what} must have different names, but {name[:60]!r} is the name of {count} of {len(names)}")


def one_number(name: str, value: Any) -> float:
    """Return `value` as a float; raise InputError unless it is exactly one number."""
    if type(value) is float:
        return value
    a = numbers(name, value)
    if a.size != 1:
        raise InputError(f"model {name} must be one number, got {a.size} numbers")
    return float(a[0])


def check_numbers(of: Any, what: str, names: Iterable[str]) -> None:
    """Raise InputError if one of the declared parameters `names` of the record `of` is not finite, has the wrong sign
    or exceeds its physical limit. `what` begins the message.
    """
    declared = quantities(type(of))
    for name in names:
        value, quantity = getattr(of, name), declared[name]
        least, most = (value.min(initial=inf), value.max(initial=-inf)) if isinstance(value, Array) else (value, value)
        if not (-inf < least and most < inf):  # False for NaN
            raise InputError(f"{what} {name} must be finite, got {value}")
        if least <= 0 and quantity.sign == "positive":
            raise InputError(f"{what} {name} must be positive, got {value}")
        if least < 0 and quantity.sign == "not negative":
            raise InputError(f"{what} {name} must not be negative, got {value}")
        if least < quantity.least or max(most, -least) > quantity.most:
            quantity.check_limit(what, name, least)
            quantity.check_limit(what, name, most)
