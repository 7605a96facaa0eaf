"""LLVM instructions of a kernel from the list of its arithmetic operations, which the module `trace` has recorded.

The instructions are one function without loops. Its arguments are the `leaves` of the kernel's arguments: a pointer for
each array, and each number itself, a dual number in two parts. All numbers are of one kind: floats, `simd` vectors, or
dual numbers (`duals`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from pliant.compiler import SLOTS, WIDTH
from pliant.compiler.trace import KernelProgram, Mark, record
from pliant.numerics.trig import cos_sin

FLOATS = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)
LANES = ir.VectorType(DOUBLE, WIDTH)
PARTS: dict[str, list[Any]] = {"float": [DOUBLE], "vector": [LANES], "dual": [DOUBLE, LANES]}  # of a number
CONTRACT = ("contract",)  # a multiplication and the addition of its result may be one instruction with one rounding
ALIGN = 8 * WIDTH  # bytes, of vectors in memory


def declared(module: Any, kind: Any, name: str) -> Any:
    """Return the function `name` of the LLVM type `kind` in an LLVM module, declared there if it is not yet."""
    return module.globals.get(name) or ir.Function(module, kind, name)


def filled(kind: Any, parts: Iterable[Any], builder: Any) -> Any:
    """Return an LLVM value of a structure or array type `kind` with the given parts."""
    value = ir.Constant(kind, ir.Undefined)
    for k, part in enumerate(parts):
        value = builder.insert_value(value, part, k)
    return value


class Number(NamedTuple):
    """LLVM values of a number: a double or a vector, and its derivatives, None if they are 0."""

    real: Any
    slopes: Any = None


def given(path: str, shapes: dict[str, tuple[int, ...]]) -> tuple[str, int]:
    """Return the array that a path such as ``body.B[2, 1]`` names, and the position of the element in its memory."""
    leaf, _, numbers = path.removesuffix("]").partition("[")
    return leaf, int(np.ravel_multi_index(tuple(map(int, numbers.split(","))), shapes[leaf]))


class LlvmWriter:
    """Writer of a kernel's recorded operations as LLVM instructions of one function. `kind` is that of all numbers:
    "float", "vector" or "dual".
    """

    def __init__(self, program: KernelProgram, leaves: list[str], name: str, kind: str, *, fused: bool) -> None:
        self.program, self.kind, self.flags = program, kind, CONTRACT if fused else ()
        self.module = ir.Module(name)
        kinds = [[ir.PointerType()] if program.shapes[leaf] else PARTS[kind] for leaf in leaves]
        function = ir.Function(self.module, ir.FunctionType(ir.VoidType(), [k for parts in kinds for k in parts]), name)
        function.attributes.add("nounwind")
        values = iter(function.args)
        self.leaves = {leaf: [next(values) for _ in parts] for leaf, parts in zip(leaves, kinds, strict=True)}
        self.builder = ir.IRBuilder(function.append_basic_block())
        self.values: dict[int, Number] = {}
        self.angles: dict[int, tuple[Number, Number]] = {}

    def write(self) -> str:
        """Return the text of a module with the function, which computes the results of the kernel and stores them in
        the arrays among its arguments.
        """
        for row in self.program.needed:
            self.values[row] = self.number(*self.program.rows[row])
        for where, mark in self.program.stores:
            self.store(self.values[mark.row], where)
        self.builder.ret_void()
        return str(self.module)

    def number(self, what: str, operands: tuple[Any, ...]) -> Number:
        """Return the LLVM value of one recorded operation, or of one number among the kernel's arguments."""
        if not operands:
            return self.load(what)
        if what in ("cos", "sin"):
            return self.cosine_and_sine(operands[0])[what == "sin"]
        values = [self.values[o.row] if isinstance(o, Mark) else self.constant(o) for o in operands]
        if what == "sqrt":
            return self.square_root(values[0])
        if len(values) == 1:
            values = [self.constant(-0.0), *values]
        if self.kind == "dual":
            return self.dual(what, *values)
        a, b = values
        return Number(self.arithmetic(what, a.real, b.real, self.flags))

    def arithmetic(self, what: str, a: Any, b: Any, flags: tuple[str, ...] = ()) -> Any:
        """Return an operation on two doubles or two vectors."""
        return getattr(self.builder, FLOATS[what])(a, b, flags=flags)

    def dual(self, what: str, a: Number, b: Number) -> Number:
        """Return the LLVM values of an operation on two dual numbers."""
        real = self.arithmetic(what, a.real, b.real, self.flags)
        if what == "+":
            return Number(real, self.sum(a.slopes, b.slopes))
        if what == "-":
            return Number(real, self.difference(a.slopes, b.slopes))
        if what == "*":
            return Number(real, self.sum(self.scaled(a.slopes, b.real), self.scaled(b.slopes, a.real)))
        less = None if b.slopes is None else self.builder.fneg(self.scaled(b.slopes, real))
        share = self.arithmetic("/", ir.Constant(DOUBLE, 1.0), b.real)
        return Number(real, self.scaled(self.sum(a.slopes, less), share))  # (da - (a / b) db) / b

    def scaled(self, slopes: Any, factor: Any, flags: tuple[str, ...] = CONTRACT) -> Any:
        """Return derivatives times a double; None stands for derivatives that are 0."""
        return None if slopes is None else self.arithmetic("*", slopes, self.spread(factor), flags)

    def sum(self, a: Any, b: Any) -> Any:
        """Return the sum of two vectors of derivatives; None stands for derivatives that are 0."""
        if a is None or b is None:
            return a if b is None else b
        return self.arithmetic("+", a, b, CONTRACT)

    def difference(self, a: Any, b: Any) -> Any:
        """Return the difference of two vectors of derivatives; None stands for derivatives that are 0."""
        if a is None and b is not None:
            return self.builder.fneg(b)
        return a if b is None else self.arithmetic("-", a, b, CONTRACT)

    def spread(self, value: Any) -> Any:
        """Return a vector whose elements are all the double `value`."""
        none = ir.Constant(LANES, ir.Undefined)
        first = self.builder.insert_element(none, value, ir.Constant(ir.IntType(32), 0))
        return self.builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))

    def constant(self, value: float) -> Number:
        """Return a Python number as an LLVM constant."""
        if self.kind == "vector":
            return Number(ir.Constant(LANES, [float(value)] * WIDTH))
        return Number(ir.Constant(DOUBLE, float(value)))

    def function_of(self, name: str, x: Any) -> Any:
        """Return LLVM's function `name` of a double or a vector."""
        size = f"v{WIDTH}f64" if x.type == LANES else "f64"
        intrinsic = self.module.declare_intrinsic(f"llvm.{name}.{size}", (), ir.FunctionType(x.type, [x.type]))
        return self.builder.call(intrinsic, [x])

    def square_root(self, x: Number) -> Number:
        """Return the square root of a number."""
        root = self.function_of("sqrt", x.real)
        if x.slopes is None:
            return Number(root)
        return Number(root, self.scaled(x.slopes, self.arithmetic("/", ir.Constant(DOUBLE, 0.5), root), ()))

    def cosine_and_sine(self, angle: Mark) -> tuple[Number, Number]:
        """Return cosine and sine of an angle, computed once for each angle of the kernel."""
        if angle.row not in self.angles:
            x = self.values[angle.row]
            cosine, sine = self.pair(x.real)
            less = None if x.slopes is None else self.scaled(x.slopes, self.builder.fneg(sine), ())
            self.angles[angle.row] = Number(cosine, less), Number(sine, self.scaled(x.slopes, cosine, ()))
        return self.angles[angle.row]

    def pair(self, x: Any) -> tuple[Any, Any]:
        """Return cosine and sine of a double or a vector by the operations of `numerics.trig.cos_sin`."""
        values: dict[int, Any] = {}
        for row in PAIR.needed:
            what, operands = PAIR.rows[row]
            numbers = [values[o.row] if isinstance(o, Mark) else self.constant(o).real for o in operands]
            if not operands:
                values[row] = x
            elif what in FLOATS:
                values[row] = self.arithmetic(what, *numbers)
            else:
                values[row] = self.function_of(what, numbers[0])
        cosine, sine = (values[mark.row] for _, mark in PAIR.stores)
        return cosine, sine

    def pointer(self, path: str) -> Any:
        """Return the LLVM pointer to an element of an array among the kernel's arguments."""
        leaf, offset = given(path, self.program.shapes)
        size = {"float": 1, "vector": WIDTH, "dual": SLOTS}[self.kind]
        offset_bytes = ir.Constant(INDEX, offset * size)
        return self.builder.gep(self.leaves[leaf][0], [offset_bytes], source_etype=DOUBLE)

    def behind(self, pointer: Any) -> Any:
        """Return the LLVM pointer to the derivatives of the dual number at `pointer`."""
        return self.builder.gep(pointer, [ir.Constant(INDEX, WIDTH)], source_etype=DOUBLE)

    def load(self, path: str) -> Number:
        """Return the LLVM value of a number among the kernel's arguments."""
        if "[" not in path:
            return Number(*self.leaves[path])
        pointer = self.pointer(path)
        if self.kind == "vector":
            return Number(self.builder.load(pointer, typ=LANES, align=ALIGN))
        real = self.builder.load(pointer, typ=DOUBLE)
        if self.kind == "float":
            return Number(real)
        return Number(real, self.builder.load(self.behind(pointer), typ=LANES, align=ALIGN))

    def store(self, value: Number, path: str) -> None:
        """Store a number in an array among the kernel's arguments."""
        pointer = self.pointer(path)
        self.builder.store(value.real, pointer, align=ALIGN if self.kind == "vector" else None)
        if self.kind == "dual":
            slopes = ir.Constant(LANES, [0.0] * WIDTH) if value.slopes is None else value.slopes
            self.builder.store(slopes, self.behind(pointer), align=ALIGN)


def pair(x: Any, out: Any) -> None:
    """Write cosine and sine of x to `out`."""
    out[0], out[1] = cos_sin(x)


PAIR = record(pair, {"x": 0.0, "out": np.zeros(2)}, kept=())
