"""Translation of Python expressions in the source of a numerical kernel to C expressions.

The module `compiler.c` translates statements.
"""

from __future__ import annotations

import ast
import builtins
import operator
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from types import FunctionType
from typing import Any

import numpy as np

from pliant.errors import InputError

OPERATORS: dict[type, tuple[str, Any]] = {
    ast.Add: ("+", operator.add), ast.Sub: ("-", operator.sub), ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv), ast.FloorDiv: ("//", operator.floordiv), ast.Pow: ("**", operator.pow),
    ast.Mod: ("%", operator.mod),
}
COMPARISONS: dict[type, tuple[str, Any]] = {
    ast.Lt: ("<", operator.lt), ast.LtE: ("<=", operator.le), ast.Gt: (">", operator.gt), ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq), ast.NotEq: ("!=", operator.ne),
}
NAMES = re.compile(r"[A-Za-z_]\w*")
SET = re.compile(r"\s*(\w+) = .*;$")
ASSIGNED = re.compile(r"^(\s*)\w+ = ")  # the name which a line assigns; an assignment is not a use
LIBRARY = {"exp": "exp", "expm1": "expm1", "sqrt": "sqrt", "floor": "floor", "rint": "rint", "abs": "fabs"}


class Real(str):
    """A C expression for a number whose value is not known when the C code is written."""

    __slots__ = ()


class Truth(str):
    """A C expression for a condition whose value is not known when the C code is written."""

    __slots__ = ()


class Turn:
    """The counter variable of a `for` loop in the written C code."""

    def __init__(self, name: str) -> None:
        self.name = name


def cells(name: str, shape: tuple[int, ...], pattern: str = "[{}]") -> np.ndarray:
    """Return an array of `shape` with the C expressions of an array's elements: ``phi[0]``, ``phi[1]``, ..."""
    array = np.empty(shape, dtype=object)
    for index in np.ndindex(*shape):
        array[index] = Real(name + "".join(pattern.format(i) for i in index))
    return array


class CScope:
    """State of one inlined function call in the C code: its local names, its return label and its result."""

    def __init__(self, number: int, scope: dict[str, Any]) -> None:
        self.number, self.scope = number, scope
        self.names: dict[str, Any] = {}
        self.result: Any = None
        self.label = f"return_{number}"
        self.jumped = False
        self.breaks: list[list[Any]] = []
        self.depth = 0  # number of enclosing branches with an unknown condition


class Expressions:
    """Writer that translates the Python expressions of a kernel to C, and collects the lines of one C function."""

    def __init__(
        self, single: bool = False, constants: dict[str, float] | None = None, prefix: str = "",
        instead: Mapping[Any, Any] | None = None,
    ) -> None:
        self.lines: list[str] = []
        self.locals: dict[str, None] = {}
        self.suffix = "f" if single else ""
        self.constants, self.prefix = constants or {}, prefix
        self.instead = instead or {}  # kernels and their replacements
        self.shared: set[str] = set()  # elements of arrays, which a kernel may change
        self.count = 0
        self.indent = 1
        self.angle: tuple[str, int, tuple[Real, Real]] = ("", -9, (Real(""), Real("")))

    def say(self, line: str) -> None:
        """Append one line to the C function, with the present indentation."""
        self.lines.append("    " * self.indent + line)

    def number(self, value: Any) -> str:
        """Return `value`, a number or a C expression, as the text of a C expression."""
        if isinstance(value, Real):
            return str(value)
        if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)):
            raise InputError(f"C export: a kernel uses {value!r:.60} where C needs a number: use only numbers there")
        return f"{float(value)!r}{self.suffix}" if value >= 0 else f"({float(value)!r}{self.suffix})"

    def local(self, name: str) -> Real:
        """Declare the local C variable `name`, and return it as an expression."""
        self.locals[name] = None
        return Real(name)

    def scratch(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """Declare one local C variable for each element of a scratch array, and return the variables as an array of
        `shape`.
        """
        array = cells(name, shape, "_{}")
        for cell in array.ravel():
            self.locals[cell] = None
            self.shared.add(cell)
        return array

    def keep(self, value: Any, name: str) -> Any:
        """Copy a value to a new local C variable and return this variable. Later changes of the original do not affect
        it.
        """
        if isinstance(value, Real):
            variable = self.local(name)
            self.say(f"{variable} = {value};")
            return variable
        if isinstance(value, tuple):
            parts = [self.keep(v, f"{name}_{i}") for i, v in enumerate(value)]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        return value

    def fresh(self) -> int:
        """Return a number that is not yet part of any C variable's name."""
        self.count += 1
        return self.count

    def call(self, kernel: Any, *arguments: Any) -> Any:
        """Write the C code of a kernel call; implemented by the subclass `compiler.c.CWriter`."""
        raise NotImplementedError

    def value(self, frame: CScope, node: ast.expr) -> Any:
        """Translate a Python expression: return its value if it is known, else a C expression or an array of C
        expressions.
        """
        return getattr(self, f"of_{type(node).__name__}")(frame, node)

    def of_Constant(self, _frame: CScope, node: ast.Constant) -> Any:
        return node.value

    def of_Name(self, frame: CScope, node: ast.Name) -> Any:
        if node.id in frame.names:
            return frame.names[node.id]
        return frame.scope[node.id] if node.id in frame.scope else getattr(builtins, node.id)

    def of_Tuple(self, frame: CScope, node: ast.Tuple) -> Any:
        return tuple(self.value(frame, part) for part in node.elts)

    def of_Attribute(self, frame: CScope, node: ast.Attribute) -> Any:
        owner = self.value(frame, node.value)
        if node.attr == "real" and isinstance(owner, (Real, int, float)):
            return owner
        return getattr(owner, node.attr)

    def of_Subscript(self, frame: CScope, node: ast.Subscript) -> Any:
        return self.value(frame, node.value)[self.value(frame, node.slice)]

    def of_Slice(self, frame: CScope, node: ast.Slice) -> slice:
        return slice(*(self.value(frame, part) if part else None for part in (node.lower, node.upper, node.step)))

    def of_UnaryOp(self, frame: CScope, node: ast.UnaryOp) -> Any:
        value = self.value(frame, node.operand)
        if isinstance(node.op, ast.Not):
            return Truth(f"!({value})") if isinstance(value, Truth) else not value
        return Real(f"(-{value})") if isinstance(value, Real) else -value

    def of_BinOp(self, frame: CScope, node: ast.BinOp) -> Any:
        left, right = self.value(frame, node.left), self.value(frame, node.right)
        sign, known = OPERATORS[type(node.op)]
        if not isinstance(left, Real) and not isinstance(right, Real):
            return known(left, right)
        if sign == "**":
            return self.power(left, right)
        if sign == "*" and not isinstance(left, Real) and left == 0.0:  # kernels' zero of the type of another number
            return 0.0
        return Real(f"({self.number(left)} {sign} {self.number(right)})")

    def power(self, base: Any, exponent: Any) -> Real:
        """Return the C expression of `base` to the power of `exponent`. A square is written as a product."""
        if exponent == 2:
            factor = self.keep(base, f"square_{self.fresh()}")
            return Real(f"({factor} * {factor})")
        return Real(f"pow{self.suffix}({self.number(base)}, {self.number(exponent)})")

    def of_Compare(self, frame: CScope, node: ast.Compare) -> Any:
        sides = [self.value(frame, side) for side in (node.left, *node.comparators)]
        several = [self.compared(*pair) for pair in zip(sides, node.ops, sides[1:], strict=False)]
        return several[0] if len(several) == 1 else self.both(several)

    def compared(self, left: Any, operation: ast.cmpop, right: Any) -> Any:
        """Return the result of comparing two values: True or False if both are known, else a C condition."""
        sign, known = COMPARISONS[type(operation)]
        if isinstance(left, Turn):
            return Truth(f"{left.name} {sign} {int(right)}")
        if not isinstance(left, Real) and not isinstance(right, Real):
            return known(left, right)
        return Truth(f"{self.number(left)} {sign} {self.number(right)}")

    def of_BoolOp(self, frame: CScope, node: ast.BoolOp) -> Any:
        return self.both((self.value(frame, part) for part in node.values), stops=isinstance(node.op, ast.Or))

    def both(self, values: Iterable[Any], *, stops: bool = False) -> Any:
        """Join conditions by "and", or by "or" if `stops` is True. Return True or False if the result is known, else a
        C condition.
        """
        open_ones = []
        for value in values:
            if isinstance(value, Truth):
                open_ones.append(f"({value})")
            elif bool(value) is stops:
                return stops
        if not open_ones:
            return not stops
        return Truth((" || " if stops else " && ").join(open_ones))

    def of_IfExp(self, frame: CScope, node: ast.IfExp) -> Any:
        test = self.value(frame, node.test)
        if not isinstance(test, Truth):
            return self.value(frame, node.body if test else node.orelse)
        yes, no = (self.number(self.value(frame, part)) for part in (node.body, node.orelse))
        return Real(f"(({test}) ? {yes} : {no})")

    def of_Call(self, frame: CScope, node: ast.Call) -> Any:
        function = self.value(frame, node.func)
        arguments = [self.value(frame, a) for a in node.args]
        if isinstance(function, FunctionType) and function.__module__.startswith("pliant."):
            return self.call(function, *arguments)
        if isinstance(function, type) and hasattr(function, "_fields"):
            return self.keep(function(*arguments), f"made_{self.fresh()}")
        if not any(isinstance(a, Real) for a in arguments):
            return function(*arguments)
        return self.library(function.__name__, arguments)

    def library(self, name: str, arguments: list[Any]) -> Real:
        """Return the C expression that calls the math function `name` (min, max, cos, sin, exp, sqrt, ...)."""
        if name in ("min", "max"):
            least, *others = (self.number(self.keep(a, f"of_{self.fresh()}")) for a in arguments)
            for other in others:
                chosen = f"({other} {'<' if name == 'min' else '>'} {least} ? {other} : {least})"
                least = chosen if other is others[-1] else self.number(self.keep(Real(chosen), f"of_{self.fresh()}"))
            return Real(least)
        if name in ("cos", "sin"):
            return self.cosine_and_sine(self.number(arguments[0]))[name == "sin"]
        return Real(f"{LIBRARY[name if name != 'absolute' else 'abs']}{self.suffix}({self.number(arguments[0])})")

    def cosine_and_sine(self, angle: str) -> tuple[Real, Real]:
        """Return two C variables that hold cosine and sine of `angle`, computed by one C call. The call is not repeated
        if it was just written for the same angle.
        """
        if self.angle[0] != angle or len(self.lines) - self.angle[1] > 1:
            number = self.fresh()
            pair = self.local(f"cosine_{number}"), self.local(f"sine_{number}")
            self.say(f"{self.prefix}cos_sin({angle}, &{pair[0]}, &{pair[1]});")
            self.angle = (angle, len(self.lines), pair)
        return self.angle[2]

    def unread(self) -> None:
        """Remove assignments to local C variables that are never read from the written code."""
        while True:
            read = Counter(w for line in self.lines for w in NAMES.findall(ASSIGNED.sub(r"\1", line)))
            idle = {name for name in self.locals if not read[name]}
            remaining = [line for line in self.lines if not ((m := SET.match(line)) and m[1] in idle)]
            if len(remaining) == len(self.lines):
                break
            self.lines = remaining
        self.locals = {name: None for name in self.locals if read[name]}

    def body(self, kind: str) -> str:
        """Return the C code written so far. Declarations of its local variables, whose C type is `kind`, come first."""
        self.unread()
        names = sorted(self.locals)
        rows = [f"    {kind} {', '.join(f'{n} = 0' for n in names[i : i + 8])};" for i in range(0, len(names), 8)]
        return "\n".join([*rows, *self.lines])
