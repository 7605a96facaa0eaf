"""Declaration of a physical parameter: unit, bounds, typical size and meaning, stated in the annotation of a field.

A field of a record such as `pliant.model.Valve` is annotated as ``Annotated[float, Quantity("s", "dead time", ...)]``.
Everything that needs names, units or bounds of parameters reads them from these annotations by `quantities`.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, TypeVar, get_type_hints

from pliant.errors import InputError

R = TypeVar("R")
Sign = Literal["positive", "not negative", "any"]
Per = Literal["", "vector", "joint", "segment", "branch", "power", "axis", "axis and joint"]


@dataclass(frozen=True)
class Quantity:
    """Unit, bounds, typical size and meaning of a parameter, all in SI units.

    Parameters
    ----------
    unit : str
        SI unit, "1" for a ratio. ``^k`` stands for the power that numbers the parameter.
    meaning : str
        What the parameter is, as a phrase for tables and reports.
    per : str
        What the field has one value for, and what numbers the parameter in a fit: "joint" (``stiffness_2``; without
        number: all joints), "branch" of hysteresis (``creep_share_1``), "power" of pressure (``torque_2``), "axis"
        (``base_tilt_x``) or "axis and joint" (``rest_turn_x_2``). Values of a "vector" or of each "segment" are not
        numbered. "": a single value.
    sign : str
        Sign that the value must have: "positive", "not negative" or "any".
    least, most : float
        Smallest and largest absolute value of a physical body. Beyond them, a unit is wrong or a file is damaged.
    zero : bool
        Whether 0 is allowed as well, where `least` is positive.
    lower, upper : float
        Bounds in a fit.
    scale : float
        Typical size in a fit. 0: the start value of the fit.
    start : float or None
        Start value in a fit. None: estimated from the recordings, or to be given.
    guess : float or None
        Start value in a fit where the recordings and the model do not tell one.
    growth : float
        Ratio of the start values of a branch and the branch before it, since a fit could not separate equal ones.
    fitted : bool
        Whether a fit may estimate the parameter.
    alike : bool
        Whether a fit may also set one value for all joints, with a name without number.
    only : str
        Where a chain moves that has the parameter: "in a plane" or "in space". "": in both.
    scales : str
        "springs" or "inputs", if the parameter scales their forces. Without weight or a known force, slow recordings
        show only the ratio of the two. (Of numbered parameters only the first is in proportion to the input.)
    log_offset : float or None
        Offset added to the value, whose logarithm a fit then varies instead. None: the value itself.
    formerly : tuple of str
        Names of the parameter in older studies, which are refused with the present one.
    source : str
        Where the definition comes from, such as an equation of the paper or a standard.
    """

    unit: str
    meaning: str = ""
    per: Per = ""
    sign: Sign = "any"
    least: float = 0.0
    most: float = float("inf")
    zero: bool = False
    lower: float = float("-inf")
    upper: float = float("inf")
    scale: float = 0.0
    start: float | None = None
    guess: float | None = None
    growth: float = 1.0
    fitted: bool = True
    alike: bool = True
    only: Literal["", "in a plane", "in space"] = ""
    scales: Literal["", "springs", "inputs"] = ""
    log_offset: float | None = None
    formerly: tuple[str, ...] = ()
    source: str = ""

    def check_limit(self, what: str, name: str, value: float) -> None:
        """Raise InputError if the absolute value of a parameter is outside its physical limits.

        Parameters
        ----------
        what, name : str
            Owner and name of the parameter, for the message: "model", "valve", "memory".
        value : float
            A finite number of any sign.
        """
        size = abs(value)
        if self.least <= size <= self.most or (size == 0.0 and self.zero):
            return
        zero = ", or be 0" if self.zero else ""
        unit = "" if self.unit == "1" else f" {self.unit}"
        raise InputError(
            f"{what} {name} must have a size of {self.least:g} to {self.most:g}{unit}{zero}, got {value:g}: check its "
            "unit"
        )

    def start_of(self, branch: int) -> float | None:
        """Return the start value in a fit of the branch with this number, counted from 1."""
        return None if self.start is None else self.start * self.growth ** (branch - 1)


def read_quantities(record: Any) -> dict[str, Quantity]:
    """Return the declared parameters of a record or function by the names of its fields or arguments, in their order.

    Fields without a `Quantity` in their annotation are left out.
    """
    hints = get_type_hints(record, include_extras=True)
    named = {name: (m for m in getattr(hint, "__metadata__", ()) if isinstance(m, Quantity))
             for name, hint in hints.items()}  # fmt: skip
    return {name: quantity for name, row in named.items() for quantity in row}


quantities: Callable[[Any], dict[str, Quantity]] = cache(read_quantities)


def fields_per(record: Any, *per: Per) -> tuple[str, ...]:
    """Return the names of the parameters of a record which have one value for each joint, branch, ..."""
    return tuple(name for name, quantity in quantities(record).items() if quantity.per in per)


def scalars(record: Any) -> tuple[str, ...]:
    """Return the names of the parameters of a record that have a single value."""
    return fields_per(record, "")


def declaring(record: type[R]) -> type[R]:
    """Return a dataclass whose signature shows the plain types of its fields, without their `Quantity`. Its docstring
    explains also those parameters that it does not name, from their declarations.
    """
    kinds = record.__init__.__annotations__
    for name, kind in kinds.items():
        tree = ast.parse(kind, mode="eval").body if isinstance(kind, str) else None
        if isinstance(tree, ast.Subscript) and isinstance(tree.slice, ast.Tuple) and kind.startswith("Annotated["):
            kinds[name] = ast.unparse(tree.slice.elts[0])
    head, section, rest = inspect.cleandoc(record.__doc__ or "").partition("\n\nRaises\n")
    inherited = {name for base in record.__mro__[1:] for name in getattr(base, "__annotations__", ())}
    rows = [
        f"\n{name} : {kinds[name]}\n    {q.meaning[:1].upper()}{q.meaning[1:]}"
        f"{'' if q.unit == '1' else f', {q.unit}'}." for name, q in quantities(record).items()
        if name not in inherited and not re.search(rf"^[\w, ]*\b{name}\b[\w, ]* : ", head, re.MULTILINE)
    ]
    record.__doc__ = f"{head}{''.join(rows)}{section}{rest}"
    return record


MOST_LINKS = 128  # beyond, compiling and stepping take minutes, and a chain is not a reduced model
MOST_TERMS = 16  # of the torque law, and branches of each kind of hysteresis
MOST_STATIONS = 4096
