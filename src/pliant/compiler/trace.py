"""Recording of a kernel's arithmetic operations as straight-line code without loops. The kernel is run once on symbols,
for a chain of n links.

The recording has no loops over links, its intermediate results are local variables instead of array elements, and
operations without effect on the result are dropped. The compiler sees no memory that might be shared, which halves the
time of a step. The source is still that in `motion.py`; `llvm` compiles the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.elastic import ROWS, TERMS
from pliant.equations.symbols import (
    Body,
    ExtensibleBody,
    ExtensibleJoints,
    ExtensibleWorkspace,
    Joints,
    Slopes,
    SpatialBody,
    SpatialJoints,
    SpatialWorkspace,
    Workspace,
)

# Scratch arrays which a kernel leaves as results for its caller; for kernels not listed, only work.a.
POSE = ("q", "t", "A", "P", "R", "S", "series", "stretch", "length", "centre", "lateral")
KEPT = {"build_step": tuple(f"work.{name}" for name in POSE)}
READ = {"inertial_forces": KEPT["build_step"]}  # scratch arrays from which a kernel takes results of another


CURVED, REMEMBERS = 1, 2  # laws of segments that lengthen: springs that soften or stiffen, hysteresis
TURNS, FRICTION = 4, 8  # in space: the base turns in a prescribed way; joints or segments have hysteresis
BOUNDED = 16  # a spring of a joint or segment whose softening is bounded


class Tape:
    """Ordered list of the arithmetic operations of a kernel. An operation that occurs again is recorded only once."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, tuple[Any, ...]]] = []
        self.known: dict[tuple[str, tuple[Any, ...]], Mark] = {}

    def write(self, what: str, *operands: Any) -> Mark:
        """Record one operation, unless it is recorded already, and return its symbolic result."""
        key = (what, tuple(float(o) if isinstance(o, (int, float, np.number)) else o for o in operands))
        if key not in self.known:
            self.known[key] = Mark(self, len(self.rows))
            self.rows.append(key)
        return self.known[key]


class Mark:
    """The symbolic result of a recorded operation. Arithmetic on it is recorded as well."""

    __slots__ = ("row", "tape")

    def __init__(self, tape: Tape, row: int) -> None:
        self.tape = tape
        self.row = row

    def __add__(self, other: Any) -> Mark:
        return self.tape.write("+", self, other)

    def __radd__(self, other: Any) -> Mark:
        return self.tape.write("+", other, self)

    def __sub__(self, other: Any) -> Mark:
        return self.tape.write("-", self, other)

    def __rsub__(self, other: Any) -> Mark:
        return self.tape.write("-", other, self)

    def __mul__(self, other: Any) -> Mark:
        return self.tape.write("*", self, other)

    def __rmul__(self, other: Any) -> Mark:
        return self.tape.write("*", other, self)

    def __truediv__(self, other: Any) -> Mark:
        return self.tape.write("/", self, other)

    def __rtruediv__(self, other: Any) -> Mark:
        return self.tape.write("/", other, self)

    def __neg__(self) -> Mark:
        return self.tape.write("-", self)

    def cos(self) -> Mark:
        """Record the cosine of this symbolic number; np.cos calls this method."""
        return self.tape.write("cos", self)

    def sin(self) -> Mark:
        """Record the sine of this symbolic number; np.sin calls this method."""
        return self.tape.write("sin", self)

    def sqrt(self) -> Mark:
        """Record the square root of this symbolic number; np.sqrt calls this method."""
        return self.tape.write("sqrt", self)

    def rint(self) -> Mark:
        """Record the rounding of this symbolic number to the nearest integer; np.rint calls this method."""
        return self.tape.write("rint", self)

    def __floor__(self) -> Mark:
        """Record the largest integer not above this symbolic number; np.floor calls this method."""
        return self.tape.write("floor", self)


def marks(tape: Tape, name: str, example: Any) -> Any:
    """Return an argument of a kernel (number, array or named tuple) with a symbol in place of every number."""
    if isinstance(example, tuple) and hasattr(example, "_fields"):
        return type(example)(*(marks(tape, f"{name}.{f}", v) for f, v in zip(example._fields, example, strict=True)))
    if isinstance(example, np.ndarray):
        symbols = np.empty(example.shape, dtype=object)
        for index in np.ndindex(*example.shape):
            symbols[index] = tape.write(f"{name}[{', '.join(map(str, index))}]")
        return symbols
    return tape.write(name)


def shapes_of(name: str, example: Any) -> dict[str, tuple[int, ...]]:
    """Return the shapes of all arrays and numbers in an argument of a kernel, by their paths, such as ``body.B``."""
    if isinstance(example, tuple):
        parts = zip(getattr(example, "_fields", ()), example, strict=True)
        return {path: shape for f, part in parts for path, shape in shapes_of(f"{name}.{f}", part).items()}
    return {name: np.shape(example)}


def changed(argument: Any, before: Any, name: str, kept: tuple[str, ...]) -> list[tuple[str, Mark]]:
    """Return (element name, symbol) for every array element that a kernel has written. Of the scratch arrays, only
    those named in `kept` count.
    """
    if isinstance(argument, tuple) and hasattr(argument, "_fields"):
        parts = zip(argument._fields, argument, before, strict=True)
        return [row for f, a, b in parts for row in changed(a, b, f"{name}.{f}", kept)]
    if not isinstance(argument, np.ndarray) or (name.startswith("work.") and name not in kept):
        return []
    marked: Any = argument
    moved = [i for i in np.ndindex(*argument.shape) if marked[i] is not before[i] and isinstance(marked[i], Mark)]
    return [(f"{name}[{', '.join(map(str, i))}]", marked[i]) for i in moved]


class KernelProgram(NamedTuple):
    """The recorded operations of a kernel for arguments of given shapes."""

    names: tuple[str, ...]  # of the arguments
    rows: list[tuple[str, tuple[Any, ...]]]  # operation and operands: a mark is the row that it comes from
    needed: list[int]  # the rows on which the results depend, in order
    stores: list[tuple[str, Mark]]  # array elements and the marks of their final values
    shapes: dict[str, tuple[int, ...]]  # of the arrays and numbers among the arguments, by their paths, in order


def record(kernel: Callable[..., Any], examples: dict[str, Any], kept: tuple[str, ...]) -> KernelProgram:
    """Run `kernel` on symbols and return its recorded operations, for arguments with the shapes of `examples`.

    Of the scratch arrays, only those in `kept` are results.
    """
    tape = Tape()
    arguments = {name: marks(tape, name, example) for name, example in examples.items()}
    before = {name: marks(tape, name, example) for name, example in examples.items()}
    kernel(**arguments)
    stores = [row for name, a in arguments.items() for row in changed(a, before[name], name, kept)]
    needed: set[int] = set()
    todo = [mark.row for _, mark in stores]
    while todo:
        row = todo.pop()
        if row not in needed:
            needed.add(row)
            todo += [o.row for o in tape.rows[row][1] if isinstance(o, Mark)]
    shapes = {path: shape for name, e in examples.items() for path, shape in shapes_of(name, e).items()}
    return KernelProgram(tuple(examples), tape.rows, sorted(needed), stores, shapes)


def planar_workspace(n: int, segments: int = 0, kind: type = float) -> Any:
    """Return new scratch arrays, of the number type `kind`, for a time step of a planar chain with n links and
    `segments` extensible segments.
    """
    if not segments:
        shapes = ((n, n), (n, n), n, n, n + 1, n, n, n)
        return Workspace(*(np.zeros(shape, dtype=kind) for shape in shapes))
    N = n + segments
    sizes = {"A": (N, N), "t": (N + 1,), **dict.fromkeys(("stretch", "ax", "ay", "bx", "by"), (n + 1,))}
    return ExtensibleWorkspace(*(np.zeros(sizes.get(f, (N,)), dtype=kind) for f in ExtensibleWorkspace._fields))


def spring_rows(laws: int) -> int:
    """Return the number of rows of `hardening` in the joints of a chain with the given laws."""
    return ROWS if laws & BOUNDED else TERMS


def example_arguments(n: int, laws: int = 0) -> dict[str, Any]:
    """Return {name: zeros} with the shapes of all arguments that the kernels of a planar chain of n links may have."""

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    return {
        "phi": zeros(n), "w": zeros(n), "h": 0.0, "torque": zeros(n),
        "body": Body(zeros(n, n), zeros(n), zeros(n), 0.0, 0.0),
        "joints": Joints(0.0, zeros(n), zeros(n), zeros(n), zeros(spring_rows(laws), n), zeros(n)),
        "work": planar_workspace(n),
        "a": zeros(n), "total": zeros(3), "out": Slopes(zeros(n), zeros(n, n), zeros(n, n)),
    }


def extensible_arguments(n: int, segments: int, laws: int = 0) -> dict[str, Any]:
    """Return {name: zeros} with the shapes of all arguments that the kernels of an extensible planar chain of n links
    may have.

    These are the kernels of `equations.extension`, for `segments` segments.
    """
    size = n + segments
    curved, moved = n + segments * bool(laws & CURVED), segments * bool(laws & REMEMBERS)

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    return {
        "x": zeros(size), "v": zeros(size), "h": 0.0, "torque": zeros(size), "a": zeros(size),
        "w": zeros(size), "total": zeros(3),
        "body": ExtensibleBody(zeros(n + 1, n + 1), zeros(n + 1), zeros(n + 1), zeros(n + 1, segments), 0.0, 0.0),
        "joints": ExtensibleJoints(
            0.0, zeros(n), zeros(size), zeros(size), zeros(spring_rows(laws), curved), zeros(n), zeros(moved),
        ),
        "work": planar_workspace(n, segments),
    }


def spatial_workspace(
    n: int, turns: int, segments: int = 0, tendons: int = 0, kind: type = float,
) -> SpatialWorkspace:
    """Return new scratch arrays for a chain in space of n links, with 2 or 3 angles (`turns`) at each joint.

    `segments` is the number of segments that lengthen, `kind` the type of the numbers.
    """
    turned, size = turns * n, turns * n + segments
    shapes: dict[str, tuple[int, ...]] = {
        "A": (size, size), "B": (size, size), "tau": (size + tendons,), "R": (n + 1, 3, 3), "r": (n + 1, 3),
        "P": (n, 3, 3), "series": (n, 4), "J": (n, 3, 3),
        **dict.fromkeys(("tension", "slope", "start"), (tendons,)), **dict.fromkeys(("felt", "arm"), (tendons, size)),
        **dict.fromkeys(("run", "ease", "kept"), (tendons, n + 1)),
        **dict.fromkeys("SEFN", (turned, 3)), **dict.fromkeys("CLM", (n, 3)),
        **dict.fromkeys(("omega", "alpha", "lift", "turn"), (3,)),
        **dict.fromkeys(("stretch", "growth", "length", "h", "second", "along"), (n + 1,)),
        **dict.fromkeys(("centre", "lateral"), (n,)),
    }
    return SpatialWorkspace(*(np.zeros(shapes.get(f, (size,)), dtype=kind) for f in SpatialWorkspace._fields))


def spatial_arguments(
    n: int, segments: int, turns: int, tendons: int, laws: int = 0, *, remembers: bool = False,
) -> dict[str, Any]:
    """Return {name: zeros} with the shapes of all arguments that the kernels of a chain in space of
    n links may have.

    Each joint has 2 or 3 angles (`turns`).
    """
    size, curved = n * turns + segments, segments * bool(laws & CURVED)
    rows = remembers * (n * turns + segments * bool(laws & REMEMBERS))

    def zeros(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    masses = (zeros(n), zeros(n), zeros(n), zeros(n))
    constants = (zeros(tendons) for _ in range(5))
    spin = zeros(2 if laws & TURNS else 0, 3)
    behind = (zeros(tendons, size), zeros(tendons, size), *constants, zeros(size, n + 1), zeros(n + 1, segments), spin)
    return {
        "x": zeros(size), "v": zeros(size), "h": 0.0, "torque": zeros(size + tendons), "a": zeros(size),
        "total": zeros(3), **{name: zeros(size) for name in ("t", "f", "pull")}, "B": zeros(size, size),
        "body": SpatialBody(
            zeros(n + 1), *masses, zeros(n, 3, 3), zeros(3, 3), 0.0, 0.0, 0.0, *behind,
        ),
        "joints": SpatialJoints(
            0.0, zeros(size), zeros(size), zeros(size), zeros(spring_rows(laws), n * turns + curved), zeros(n),
            zeros(rows, 3), zeros(n, curved),
        ),
        "work": spatial_workspace(n, turns, segments, tendons),
    }


def kept_by(kernel: FunctionType) -> tuple[str, ...]:
    """Return the paths of the scratch arrays which a kernel leaves as results for its caller."""
    return KEPT.get(kernel.__name__, ("work.a",))


def passed(kernel: FunctionType, paths: Iterable[str]) -> list[str]:
    """Return the paths of a kernel's inputs and results. Scratch arrays are left out, unless the kernel reads from them
    what another kernel wrote, or leaves results in them.
    """
    results = {*kept_by(kernel), *READ.get(kernel.__name__, ())}
    return [path for path in paths if not path.startswith("work.") or path in results]


def examples_of(
    kernel: FunctionType, n: int, segments: int = 0, turns: int = 1, tendons: int = 0, laws: int = 0, *,
    remembers: bool = False,
) -> dict[str, Any]:
    """Return {name: zeros} with the shapes of the arguments of a kernel for a chain of n links with the given numbers
    of segments that lengthen, angles and tendons.

    `laws`: laws of the segments and of bounded springs, as in `choose.twin`. With `remembers`, a step in space
    includes the linear functions of the hysteresis states.
    """
    if turns > 1:
        examples = spatial_arguments(n, segments, turns, tendons, laws, remembers=remembers)
    else:
        examples = extensible_arguments(n, segments, laws) if segments else example_arguments(n, laws)
    names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
    return {name: examples[name] for name in names}


def recording(kernel: FunctionType, *sizes: int, remembers: bool = False) -> KernelProgram:
    """Return the recorded operations of a kernel for a chain of the sizes that `examples_of` takes."""
    return record(kernel, examples_of(kernel, *sizes, remembers=remembers), kept=kept_by(kernel))
