"""Translation of numerical Python kernels to C: the Python source is interpreted on symbolic values, and C code is
written.

Unlike `trace`, it keeps branches: a condition on numbers which are unknown at translation time becomes an ``if``, a
``goto`` or a loop of C. Shapes, indices and loops over links are known and are unrolled: every element of an array is a
separate name, and scratch arrays become local variables. Every call is inlined, so that one kernel becomes one function
of C without allocation. The operations and their order are those of the kernel compiled by Numba.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from contextlib import suppress
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np

from pliant.compiler.c_values import CScope, Expressions, Real, Truth, Turn
from pliant.errors import InputError
from pliant.numerics import trig

LONG = 16  # a loop with more iterations than this, an early exit and no indexing by its counter is not unrolled


class Stop(Exception):  # control flow of the interpreted source, known at translation time
    """Exception that ends the interpretation of a Python block at an unconditional `return` or `break`."""


class Returned(Stop):
    """Exception for an unconditional `return` in the interpreted Python source."""


class Broken(Stop):
    """Exception for an unconditional `break` in the interpreted Python source."""


@cache
def tree_of(kernel: FunctionType) -> ast.FunctionDef:
    """Return the syntax tree of the source code of a Python function."""
    return ast.parse(textwrap.dedent(inspect.getsource(kernel))).body[0]  # type: ignore[return-value]


class CWriter(Expressions):
    """Writer that translates a Python kernel, with its calls, branches and loops, to the body of one C function."""

    def call(self, kernel: Any, *arguments: Any) -> Any:
        """Write the C code of a call of `kernel` with symbolic arguments, inlined, and return the symbolic result."""
        self.count += 1
        kernel = self.instead.get(kernel, kernel)
        frame = CScope(self.count, {**kernel.__globals__, **self.constants})
        tree = tree_of(kernel)
        defaults = kernel.__defaults__ or ()
        values = (*arguments, *defaults[len(defaults) - (len(tree.args.args) - len(arguments)) :])
        changed = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        for parameter, value in zip(tree.args.args, values, strict=True):
            name = f"{parameter.arg}_{frame.number}"
            frame.names[parameter.arg] = self.passed(value, name, changes=parameter.arg in changed)
        with suppress(Returned):
            self.block(frame, tree.body)
        if frame.jumped:
            self.say(f"{frame.label}:;")
        return frame.result

    def passed(self, value: Any, name: str, *, changes: bool) -> Any:
        """Return an argument of an inlined call as a C variable. It is a copy if the called function might change the
        original.
        """
        if changes and isinstance(value, (Real, float)):
            variable = self.local(name)
            self.say(f"{variable} = {self.number(value)};")
            return variable
        if isinstance(value, Real) and value in self.locals and value not in self.shared:
            return value
        if isinstance(value, tuple):
            parts = [self.passed(v, f"{name}_{i}", changes=False) for i, v in enumerate(value)]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        return self.keep(value, name)

    def block(self, frame: CScope, statements: list[ast.stmt]) -> None:
        """Write the C code of Python statements, one after the other."""
        for statement in statements:
            getattr(self, f"do_{type(statement).__name__}")(frame, statement)

    def do_Expr(self, frame: CScope, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.value(frame, node.value)

    def do_Assign(self, frame: CScope, node: ast.Assign) -> None:
        value = self.value(frame, node.value)
        for target in node.targets:
            self.assign(frame, target, value)

    def assign(self, frame: CScope, target: ast.expr, value: Any) -> None:
        """Write the C code that assigns a value to a name, an array element or a tuple of these."""
        if isinstance(target, ast.Tuple):
            if len(target.elts) > 1:
                value = self.keep(tuple(value), f"pair_{self.fresh()}")
            for part, part_value in zip(target.elts, value, strict=True):
                self.assign(frame, part, part_value)
        elif isinstance(target, ast.Subscript):
            array, index = self.value(frame, target.value), self.value(frame, target.slice)
            self.say(f"{array[index]} = {self.number(value)};")
        elif isinstance(value, (Real, float)):
            name = self.local(f"{target.id}_{frame.number}")  # type: ignore[attr-defined]
            self.say(f"{name} = {self.number(value)};")
            frame.names[target.id] = name  # type: ignore[attr-defined]
        elif isinstance(value, tuple):
            frame.names[target.id] = self.keep(value, f"{target.id}_{frame.number}")  # type: ignore[attr-defined]
        else:
            frame.names[target.id] = value  # type: ignore[attr-defined]

    def do_Return(self, frame: CScope, node: ast.Return) -> None:
        value = self.value(frame, node.value) if node.value else None
        if not frame.depth and not frame.jumped:  # the only `return`, without a condition
            frame.result = self.keep(value, f"result_{frame.number}")
            raise Returned
        frame.result = self.returned(value, f"result_{frame.number}")
        if not frame.depth:
            raise Returned
        frame.jumped = True
        self.say(f"goto {frame.label};")

    def returned(self, value: Any, name: str) -> Any:
        """Copy the result of an inlined call to C variables that all its `return` statements share, and return these
        variables.
        """
        if isinstance(value, tuple):
            parts = [self.returned(v, f"{name}_{i}") for i, v in enumerate(value)]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        if value is None or isinstance(value, np.ndarray):
            return value
        variable = self.local(name)
        if isinstance(value, (bool, Truth)):
            yes = f"({value}) ? 1 : 0" if isinstance(value, Truth) else str(int(value))
            self.say(f"{variable} = {yes};")
            return Truth(f"{variable} > 0")
        self.say(f"{variable} = {self.number(value)};")
        return variable

    def do_If(self, frame: CScope, node: ast.If) -> None:
        test = self.value(frame, node.test)
        if not isinstance(test, Truth):
            self.block(frame, node.body if test else node.orelse)
            return
        self.say(f"if ({test}) {{")
        self.branch(frame, node.body)
        if node.orelse:
            self.say("} else {")
            self.branch(frame, node.orelse)
        self.say("}")

    def branch(self, frame: CScope, statements: list[ast.stmt]) -> None:
        """Write the C code of statements that are executed only under a condition.

        An array name which the branch binds to another array raises InputError, since C has no names for arrays here.
        """
        frame.depth += 1
        self.indent += 1
        before = dict(frame.names)
        self.block(frame, statements)
        for name, value in before.items():
            if not isinstance(value, Real) and frame.names[name] is not value and isinstance(value, np.ndarray):
                raise InputError(f"C export: a condition at run time selects the whole array {name}, which the C "
                                 "writer cannot translate: select each of its elements by the condition")
        self.indent -= 1
        frame.depth -= 1

    def do_For(self, frame: CScope, node: ast.For) -> None:
        turns = self.value(frame, node.iter)
        leaves = any(isinstance(n, (ast.Return, ast.Break)) for n in ast.walk(node))
        name = node.target.id  # type: ignore[attr-defined]
        mark: list[Any] = [f"break_{self.fresh()}", False, frame.depth]
        frame.breaks.append(mark)
        if leaves and len(turns) > LONG and only_counts(node, name):
            self.loop(frame, node, name, turns)
        else:
            try:
                for i in turns:
                    frame.names[name] = i
                    self.block(frame, node.body)
            except Broken:
                pass
        frame.breaks.pop()
        if mark[1]:
            self.say(f"{mark[0]}:;")

    def loop(self, frame: CScope, node: ast.For, name: str, turns: range) -> None:
        """Write a Python loop over the range `turns` as a `for` loop of C."""
        turn = f"{name.strip('_') or 'turn'}_{self.fresh()}"
        self.say(f"for (int {turn} = {turns.start}; {turn} < {turns.stop}; {turn}++) {{")
        frame.names[name] = Turn(turn)
        self.branch(frame, node.body)
        self.say("}")

    def do_Break(self, frame: CScope, _node: ast.Break) -> None:
        mark = frame.breaks[-1]
        if frame.depth == mark[2]:
            raise Broken
        mark[1] = True
        self.say(f"goto {mark[0]};")


def only_counts(loop: ast.For, name: str) -> bool:
    """Return whether a Python loop uses its counter `name` in comparisons only, not as an array index."""
    nodes = [node for statement in loop.body for node in ast.walk(statement)]
    compared = {id(node.left) for node in nodes if isinstance(node, ast.Compare)}
    return all(id(node) in compared for node in nodes if isinstance(node, ast.Name) and node.id == name)


def cosine_and_sine(kind: str, prefix: str, *, single: bool) -> str:
    """Return the source of a C function that computes cosine and sine of one angle with the same operations as the
    Python kernels.

    The operations are those of `numerics.trig.cos_sin`.

    `kind` is the C type of its numbers, `prefix` the prefix of its name.
    """
    writer = CWriter(single)
    pair = writer.call(trig.cos_sin, Real("x"))
    for target, name in zip(pair, "cs", strict=True):
        writer.say(f"*{name} = {target};")
    return f"static void {prefix}cos_sin({kind} x, {kind} *c, {kind} *s)\n{{\n{writer.body(kind)}\n}}\n"
