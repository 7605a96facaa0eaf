"""Choice of the compiled form of a kernel: `twin` returns the form whose time step is fastest for a chain's sizes.

A loop over time is compiled once for chains of all sizes. The step in it is machine code without loops, which is made
for each size from the recorded operations (`calls`). Chains with few links use the dense step, long chains articulated
bodies. Beyond a number of links this code would take too long to compile: another form of the loop then contains a step
with loops.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

from pliant.compiler import trace
from pliant.compiler.twin import compiled_twin, reached
from pliant.equations import (
    articulated,
    base,
    contact,
    elastic,
    energy,
    extension,
    extension_memory,
    linearised,
    memory,
    motion,
    observation,
    poses,
    spatial,
    spatial_extension_memory,
    spatial_memory,
    spatial_observation,
    spatial_points,
    spatial_springs,
    tendon,
)
from pliant.numerics import trig

MOST_LINKS = 12  # of a dense kernel: beyond, articulated bodies are faster, and the dense kernel compiles for seconds
STRAIGHT_LINKS = 64  # straight-line code of as many articulated bodies compiles in about 2 s
SOURCES = (  # files that transform the text of kernels
    trace.__file__, trig.__file__,
    *(str(Path(__file__).with_name(f"{name}.py")) for name in ("llvm", "simd", "__init__", "dual_numbers", "duals")),
)
# Not the steps in the plane, so that batches and single simulations give the same bits.
FUSED: set[Any] = {motion.acceleration, motion.acceleration_jacobian, spatial.step, spatial.build_step,
                   spatial.inertial_forces, tendon.factor_taut, tendon.solve_taut}
# Not inlined: they are so long that each caller would take as long to compile again.
CALLED: set[Any] = {
    spatial_memory.step_with_memory, spatial_memory.add_friction, spatial_memory.gap, spatial_memory.move_friction,
    spatial_extension_memory.step_with_axial_memory, poses.forces_after,
}
SPATIAL: dict[Any, Any] = {  # planar kernels and the kernels which replace them for a chain in space
    motion.step: spatial.step, motion.acceleration: tendon.accelerate, elastic.follows: spatial_springs.follows,
    energy.add_step_work: spatial_points.add_step_work, contact.add_link_loads: spatial_points.add_link_loads,
    observation.place_links: spatial_observation.place_links, observation.point_at: spatial_observation.point_at,
    observation.look: spatial_observation.look, observation.motion_of: spatial_observation.motion_of,
    observation.turned: spatial_observation.turned,
    memory.step_with_memory: spatial_memory.step_with_memory, memory.relax: spatial_memory.relax,
    memory.follow_change: spatial_memory.follow_change,
    base.begin_step: base.begin_step_in_space, base.end_step: base.end_step_in_space,
}  # fmt: skip
AXIAL: dict[Any, Any] = {  # replacements of the kernels of joints if segments have hysteresis too
    memory.step_with_memory: extension_memory.step_with_axial_memory, memory.relax: extension_memory.relax_all,
    memory.follow_change: extension_memory.follow_all,
}
SPATIAL_AXIAL: dict[Any, Any] = {  # those of a chain in space
    memory.step_with_memory: spatial_extension_memory.step_with_axial_memory,
    memory.relax: spatial_extension_memory.relax_all, memory.follow_change: spatial_extension_memory.follow_all,
}
MOST_TURNS = 24  # coordinates of a step in space as straight-line code: 24 take 4 s to compile, 30 take 6 s
MOST_DUAL_TURNS = 12  # the same on dual numbers: 7 take 2.6 s, 10 take 6 s, 18 take 13 s; a step with loops takes 11 s


class Family(NamedTuple):
    """Chains of all sizes for which a kernel is compiled to the same code."""

    lines: bool = True  # whether time steps are machine code of their own, without loops
    lengthens: bool = False  # in the plane: whether segments lengthen
    space: bool = False
    tendons: bool = False
    remembers: bool = False  # whether segments have hysteresis

    @property
    def tag(self) -> str:
        """Part of the names of compiled kernels that describes the family."""
        words = [word for word, holds in self._asdict().items() if holds and word != "lines"]
        return "_".join([*(words or ["plane"]), *["loops"] * (not self.lines)])


def family_of(links: int, segments: int, turns: int, tendons: int, laws: int, reading: str) -> Family:
    """Return the family of a chain, of the sizes that `twin` takes."""
    remembers = bool(laws & trace.REMEMBERS)
    if turns > 1:
        lines = links * turns + segments <= (MOST_DUAL_TURNS if reading == "_duals" else MOST_TURNS)
        return Family(lines, space=True, tendons=tendons > 0, remembers=remembers)
    most = MOST_LINKS if segments else STRAIGHT_LINKS
    return Family(links + segments <= most, lengthens=segments > 0, remembers=remembers)


def twin(
    kernel: Any, links: int | None = None, segments: int = 0, turns: int = 1, tendons: int = 0, laws: int = 0,
) -> Any:
    """Return the compiled form of a plain Python `kernel`, with the same arguments, optimised for a chain of the given
    size.

    With a number of `links`, the steps inside it are the fastest for this number, see `substitutes`. If `segments` > 0
    segments lengthen, the steps are those of `equations.extension`. If each joint has 2 or 3 rotational coordinates
    (`turns`), the steps are those of `equations.spatial`, or with `tendons` of `equations.tendon`. `laws` is a sum of
    `trace.CURVED` and `trace.REMEMBERS`, laws of segments beyond linear springs and dampers, `trace.BOUNDED`, a spring
    whose softening is bounded, and for a chain in space of `trace.TURNS`, a base that turns, and `trace.FRICTION`,
    hysteresis of joints or segments.
    """
    return ready(kernel, "", "float", links, segments, turns, tendons, laws)


def free_twin(
    kernel: Any, links: int | None, segments: int = 0, turns: int = 1, tendons: int = 0, laws: int = 0,
) -> Any:
    """Return the form of `twin` that releases Python's global lock."""
    return ready(kernel, "_free", "float", links, segments, turns, tendons, laws)


def lane_twin(
    kernel: Any, links: int, segments: int = 0, turns: int = 1, tendons: int = 0, laws: int = 0,
) -> Any:
    """Return a kernel compiled for SIMD vectors, which advances `WIDTH` chains at once and releases Python's global
    lock. The sizes are those of `twin`.
    """
    return ready(kernel, "_lanes", "vector", links, segments, turns, tendons, laws)


@cache
def dual_twin(
    kernel: Any, links: int | None, segments: int = 0, turns: int = 1, tendons: int = 0, laws: int = 0,
) -> Any:
    """Return a kernel compiled for dual numbers. Its array arguments have an additional last axis of `SLOTS` floats,
    which holds the value and the derivatives of one dual number.

    The sizes are those of `twin`. `duals.duals` makes such arrays.

    Integers and arrays of integers are passed unchanged. If the kernel returns a dual number, its value is returned.

    Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
    """
    return whole(ready(kernel, "_duals", "dual", links, segments, turns, tendons, laws))


@cache
def whole(inner: Any) -> Any:
    """Return a compiled kernel of dual numbers as one whose arrays are floats."""
    from pliant.compiler.cache import part
    from pliant.compiler.duals import from_floats

    return from_floats(part(inner))


@cache
def ready(
    kernel: Any, reading: str, kind: str, links: int | None, segments: int = 0, turns: int = 1, tendons: int = 0,
    laws: int = 0,
) -> Any:
    """Return the compiled form of a kernel for a family of chains, after the machine code of the steps that it calls
    is ready for chains of this size. `kind` is that of the numbers, as in `calls.provide`.
    """
    if links is None:
        return made(kernel, reading)
    sizes = links, segments, turns, tendons, laws
    family = family_of(*sizes, reading)
    if family.lines:
        make_ready(kernel, kind, *sizes)
    return made(kernel, reading, family)


def make_ready(kernel: FunctionType, kind: str, *sizes: int) -> None:
    """Make the machine code of the straight-line parts of a kernel ready for a chain of the given sizes."""
    from pliant.compiler.calls import provide

    used, (links, segments, turns, tendons, laws) = reached(kernel), sizes
    written: dict[Any, Any] = {}  # kernels that loops call, and those whose text is their machine code
    if motion.step in used:
        if turns > 1:
            written = {part: part for part in (parts_with_tendons() if tendons else (spatial.step,))}
        elif segments:
            written = {extension.step: extension.step}
        else:
            written = {motion.step: motion.step if links <= MOST_LINKS else articulated.step_articulated}
    if energy.add_step_work in used and turns == 1:
        written[energy.add_step_work] = energy.add_step_work
    for called, text in written.items():
        examples = trace.examples_of(called, *sizes, remembers=bool(laws & trace.FRICTION))
        provide(called, text, examples, kind, SOURCES, fused=called in FUSED)


def straight(kernel: Any, *sizes: int) -> Any:
    """Return a plain kernel compiled as straight-line code, without loops, with the same arguments as the kernel. The
    code is ready for a chain of the `sizes` which `trace.examples_of` takes.
    """
    from pliant.compiler.calls import provide

    provide(kernel, kernel, trace.examples_of(kernel, *sizes), "float", SOURCES, fused=kernel in FUSED)
    return calling(kernel)


def calling(kernel: Any) -> Any:
    """Return a kernel for compiled loops which calls the machine code of `kernel` for the sizes of its arguments."""
    from pliant.compiler.calls import caller

    return caller(kernel, SOURCES, fused=kernel in FUSED)


@cache
def made(kernel: FunctionType, reading: str, family: Family | None = None) -> Any:
    """Return the compiled form of a plain Python kernel, created once for each family of chains and `reading`: "" for
    floats, "_free" for the same without Python's global lock, "_lanes" for SIMD vectors, "_duals" for dual numbers.
    """
    fast = substitutes(kernel, family) if family else {}
    if kernel in fast:
        return fast[kernel]
    if family != (fewest := fewest_families(kernel, family, fast)):
        return made(kernel, reading, fewest)
    return compiled_twin(
        kernel, (family.tag if family else "n") + reading, lambda callee: made(callee, reading, family),
        SOURCES, replaced=fast, forceinline=kernel not in CALLED, nogil=reading in ("_lanes", "_free"),
    )


def fewest_families(kernel: FunctionType, family: Family | None, fast: dict[Any, Any]) -> Family | None:
    """Return the simplest family for which `kernel` is compiled to the same code as for the given one, whose
    `substitutes` are `fast`.

    Most kernels that call no step are compiled once for all chains, because the kernels in them that are replaced
    depend only on whether the chain lengthens or moves in space.
    """
    if not family or not fast:
        return None
    few = Family(lengthens=family.lengthens, space=family.space)
    return few if substitutes(kernel, few) == fast else family


@cache
def jacobian_twin(family: Family) -> Any:
    """Return `linearised.step_jacobian` compiled on dual numbers, with loops that fit any number of links."""
    from pliant.compiler.duals import CARRYING

    jacobian: Any = linearised.step_jacobian
    step: Any = extension.step if family.lengthens else articulated.step_articulated
    if family.space:
        step = tendon.step if family.tendons else spatial.step
    replaced: dict[Any, Any] = {motion.step: twin(step)}
    return compiled_twin(
        jacobian, family.tag, replaced.__getitem__, SOURCES, replaced=replaced, names=CARRYING, forceinline=False,
    )


@cache
def rows_twin(*, space: bool) -> Any:
    """Return `observation.observe_rows` compiled on dual numbers, for any chain in the plane or in space."""
    from pliant.compiler.duals import CARRYING

    rows: Any = observation.observe_rows
    own = SPATIAL if space else {}
    return compiled_twin(
        rows, "space" if space else "plane", lambda callee: twin(own.get(callee, callee)), SOURCES, replaced=list(own),
        names=CARRYING, forceinline=False,
    )


def substitutes(kernel: FunctionType, family: Family) -> dict[Any, Any]:
    """Return {plain kernel: compiled replacement} for all functions called by `kernel` that have a faster or another
    form for this family of chains.
    """
    used, table = reached(kernel), {}
    if linearised.step_jacobian in used:
        table[linearised.step_jacobian] = jacobian_twin(Family(True, family.lengthens, family.space, family.tendons))
    if observation.observe_rows in used:
        table[observation.observe_rows] = rows_twin(space=family.space)
    if family.space:
        kernels = SPATIAL | (SPATIAL_AXIAL if family.remembers else {})
        return table | {planar: spatial_twin(variant, family) for planar, variant in kernels.items() if planar in used}
    if motion.step in used:
        table[motion.step] = planar_step(family)
    if energy.add_step_work in used and family.lines:
        table[energy.add_step_work] = calling(energy.add_step_work)
    if family.remembers:
        table |= {plain: axial_twin(variant, family) for plain, variant in AXIAL.items() if plain in used}
    if family.lengthens and contact.add_link_loads in used:
        table[contact.add_link_loads] = twin(extension.add_link_loads)
    return table


def planar_step(family: Family) -> Any:
    """Return the compiled time step of a planar chain."""
    if family.lines:
        return calling(extension.step if family.lengthens else motion.step)
    return twin(extension.step if family.lengthens else articulated.step_articulated)


@cache
def axial_twin(kernel: Any, family: Family) -> Any:
    """Return the compiled form of a kernel for planar chains whose segments have hysteresis."""
    steps: dict[Any, Any] = {extension.step: planar_step(family)}
    return compiled_twin(
        kernel, family.tag, lambda callee: steps.get(callee) or twin(callee), SOURCES, replaced=steps,
    )


@cache
def spatial_twin(kernel: Any, family: Family) -> Any:
    """Return the compiled form of a kernel for chains in space."""
    if kernel is spatial.step:
        return spatial_step(family)
    remembering: tuple[Any, ...] = (
        spatial_memory.step_with_memory, spatial_extension_memory.step_with_axial_memory,
    )
    if kernel not in remembering or not (family.lines or family.tendons):
        return twin(kernel)
    steps: dict[Any, Any] = {spatial.step: spatial_step(family)}
    return compiled_twin(
        kernel, family.tag, lambda callee: steps.get(callee) or twin(callee), SOURCES, replaced=steps,
        forceinline=False,
    )


def parts_with_tendons() -> tuple[Any, ...]:
    """Return the parts without tendons of a time step with tendons, which are straight-line code."""
    return spatial.build_step, spatial.inertial_forces, tendon.factor_taut, tendon.solve_taut


@cache
def spatial_step(family: Family) -> Any:
    """Return the compiled time step of a chain in space. With tendons, only the parts of the step without tendons are
    straight-line code.
    """
    if not family.lines:
        return twin(tendon.step if family.tendons else spatial.step)
    if not family.tendons:
        return calling(spatial.step)
    step: Any = tendon.step
    fast = {part: calling(part) for part in parts_with_tendons()}
    return compiled_twin(step, "lines", lambda callee: fast.get(callee) or twin(callee), SOURCES, replaced=fast)


def tuples(record: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a record, and all records in it, as plain tuples, which compiled kernels accept faster from Python."""
    return tuple(tuples(x) if isinstance(x, tuple) else x for x in record)
