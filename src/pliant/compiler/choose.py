"""Choice of the compiled form of a kernel: `twin` returns the form whose time step is fastest for the chain's number of
links.

Chains with few links use the dense step, long chains use articulated bodies. Both are compiled as straight-line code up
to a number of links, beyond which compiling takes too long and loops are used.
"""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

from pliant.compiler import trace
from pliant.compiler.twin import compiled_twin, fingerprint, reached
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
    *(str(Path(__file__).with_name(f"{name}.py")) for name in ("llvm", "trig", "simd", "dual_numbers", "duals")),
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


def twin(
    kernel: Any, links: int | None = None, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0,
) -> Any:
    """Return the compiled form of a plain Python `kernel`, with the same arguments, optimised for a chain of the given
    size.

    With a number of `links`, the steps inside it are the fastest for this number, see `substitutes`. If `segments` > 0
    segments lengthen, the steps are those of `equations.extension`. If each joint has 2 or 3 rotational coordinates
    (`turns`), the steps are those of `equations.spatial`, which are the same for any number of `tendons` but none.
    `axial` is the sum of `trace.CURVED` and `trace.REMEMBERS`, laws of segments beyond linear springs and dampers, and
    of `trace.TURNS` for a chain in space whose base turns.
    """
    return made(kernel, "", links, segments, turns, min(tendons, 1), axial)


def lane_twin(
    kernel: Any, links: int, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0,
) -> Any:
    """Return a kernel compiled for SIMD vectors, which advances `WIDTH` chains at once and releases Python's global
    lock.

    The sizes are those of `twin`.
    """
    return made(kernel, "_lanes", links, segments, turns, min(tendons, 1), axial)


@cache
def dual_twin(
    kernel: Any, links: int | None, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0,
) -> Any:
    """Return a kernel compiled for dual numbers. Its array arguments have an additional last axis of `SLOTS` floats,
    which holds the value and the derivatives of one dual number.

    The sizes are those of `twin`. `duals.duals` makes such arrays.

    Integers and arrays of integers are passed unchanged. If the kernel returns a dual number, its value is returned.

    Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
    """
    from pliant.compiler.cache import part
    from pliant.compiler.duals import from_floats

    sizes: tuple[Any, ...] = (links, segments, turns, 0, axial)
    if turns > 1:  # loops fit any size
        sizes = 1, 0, 2, min(tendons, 1), axial & trace.REMEMBERS
    return from_floats(part(made(kernel, "_duals", *sizes)))


@cache
def made(kernel: FunctionType, reading: str, links: int | None, *sizes: int) -> Any:
    """Return the compiled form of a plain Python kernel, created once for each chain size and `reading`: "" for floats,
    "_lanes" for SIMD vectors, "_duals" for dual numbers themselves, without straight-line code in space.
    """
    loops = reading == "_duals"
    fast = substitutes(kernel, links, *sizes, loops=loops) if links else {}
    if kernel in fast:
        return fast[kernel]
    few = fewest(kernel, links, *sizes, loops=loops) if links and fast else (None, 0, 1, 0, 0)
    if few != (links, *sizes):
        return made(kernel, reading, *few)
    return compiled_twin(
        kernel, size_tag(links, *sizes) + reading, lambda callee: made(callee, reading, links, *sizes),
        SOURCES, replaced=fast, forceinline=kernel not in CALLED, nogil=reading == "_lanes",
    )


@cache
def jacobian_twin(segments: int, turns: int, tendons: int) -> Any:
    """Return `linearised.step_jacobian` compiled on dual numbers, with loops that fit any number of links.

    `segments`, `turns` and `tendons` are those of `twin`.
    """
    from pliant.compiler.duals import CARRYING

    jacobian: Any = linearised.step_jacobian
    step: Any = extension.step if segments else articulated.step_articulated
    if turns > 1:
        step = tendon.step if tendons else spatial.step
    replaced: dict[Any, Any] = {motion.step: twin(step)}
    return compiled_twin(
        jacobian, size_tag(None, segments, turns, tendons), replaced.__getitem__, SOURCES,
        replaced=replaced, names=CARRYING, forceinline=False,
    )


@cache
def straight(
    kernel: FunctionType, n: int, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0, *,
    remembers: bool = False,
) -> Any:
    """Return a plain kernel compiled as straight-line code, without loops, for a chain of n links, with the same
    arguments as the kernel.

    `trace.example_arguments` lists the arguments that a kernel may have. The kernel is recorded only if the cache on
    disk does not contain the result.
    """
    from pliant.compiler.llvm import compiled

    size = size_tag(n, segments, turns, tendons, axial) + "_fused" * (kernel in FUSED) + "_memory" * remembers
    name = f"{kernel.__name__}_{size}_{fingerprint(kernel, *SOURCES)}"
    recorded = partial(trace.recording, kernel, n, segments, turns, tendons, axial, remembers=remembers)
    return compiled(name, recorded, fused=kernel in FUSED)


def size_tag(links: int | None, segments: int, turns: int = 1, tendons: int = 0, axial: int = 0) -> str:
    """Return the part of a compiled kernel's name that describes the chain: its numbers of links, extensible segments,
    angles per joint and tendons, and whether the segments have nonlinear springs or hysteresis.
    """
    behind = [segments, turns, tendons] if turns > 1 else [segments] * (segments > 0)
    return "_".join(map(str, [links or "n", *behind, *[f"axial{axial}"] * (axial > 0)]))


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


def substitutes(
    kernel: FunctionType, links: int, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0, *,
    loops: bool = False,
) -> dict[Any, Any]:
    """Return {plain kernel: compiled replacement} for all functions called by `kernel` that have a faster form for this
    chain size.

    Kernels which need no replacement are left out. `loops` replaces straight-line code in space by loops, since
    straight-line code on dual numbers takes minutes to compile.
    """
    used, table = reached(kernel), {}
    if linearised.step_jacobian in used:
        table[linearised.step_jacobian] = jacobian_twin(min(segments, int(turns == 1)), min(turns, 2), min(tendons, 1))
    if observation.observe_rows in used:
        table[observation.observe_rows] = rows_twin(space=turns > 1)
    if turns > 1:
        sizes = links, segments, turns, tendons, axial
        kernels = SPATIAL | (SPATIAL_AXIAL if axial & trace.REMEMBERS else {})
        return table | {planar: spatial_twin(own, sizes, loops) for planar, own in kernels.items() if planar in used}
    if motion.step in used:
        table[motion.step] = extensible_step(links, segments, axial) if segments else fast_step(links)
    if energy.add_step_work in used and links + segments <= STRAIGHT_LINKS:
        table[energy.add_step_work] = straight(energy.add_step_work, links, segments)
    if axial & trace.REMEMBERS:
        steps: dict[Any, Any] = {extension.step: extensible_step(links, segments, axial)}
        for plain, own in AXIAL.items():
            if plain in used:
                table[plain] = compiled_twin(
                    own, size_tag(links, segments, axial=axial), lambda callee: steps.get(callee) or twin(callee),
                    SOURCES, replaced=steps,
                )
    if segments and contact.add_link_loads in used:
        table[contact.add_link_loads] = twin(extension.add_link_loads)
    return table


def fewest(
    kernel: FunctionType, links: int, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0, *,
    loops: bool = False,
) -> tuple[int, ...]:
    """Return the smallest chain size for which `kernel` is compiled to the same code as for the given size.

    Most kernels that call no step are compiled once for all sizes, because the kernels in them that are replaced depend
    only on whether the chain lengthens or moves in space.
    """
    sizes = links, segments, turns, tendons, axial
    few = 1, min(segments, int(turns == 1)), min(turns, 2), 0, 0
    same = substitutes(kernel, *few, loops=loops) == substitutes(kernel, *sizes, loops=loops)
    return few if same else sizes


def spatial_twin(kernel: Any, sizes: tuple[int, int, int, int, int], loops: bool) -> Any:
    """Return the compiled form of a kernel for chains in space. `sizes` are the numbers of links, extensible segments,
    angles per joint, and tendons, then the laws of the segments as in `twin`.
    """
    lines = not loops and sizes[0] * sizes[2] + sizes[1] <= MOST_TURNS
    if kernel is spatial.step:
        return spatial_step(*sizes, lines=lines)
    remembering: tuple[Any, ...] = (
        spatial_memory.step_with_memory, spatial_extension_memory.step_with_axial_memory,
    )
    if kernel not in remembering or not (lines or sizes[3]):
        return twin(kernel)
    steps: dict[Any, Any] = {spatial.step: spatial_step(*sizes, lines=lines, remembers=True)}
    return compiled_twin(
        kernel, size_tag(*sizes) + "_loops" * (not lines), lambda callee: steps.get(callee) or twin(callee), SOURCES,
        replaced=steps, forceinline=False,
    )


@cache
def spatial_step(
    links: int, segments: int, turns: int, tendons: int, axial: int, *, lines: bool, remembers: bool = False,
) -> Any:
    """Return the compiled time step of a chain in space, as straight-line code if `lines`, else as loops.

    With tendons, only the parts of the step without tendons are straight-line code.
    """
    if not lines:
        return twin(tendon.step if tendons else spatial.step)
    if not tendons:
        return straight(spatial.step, links, segments, turns, axial=axial, remembers=remembers)
    step: Any = tendon.step
    parts: tuple[Any, ...] = (spatial.build_step, spatial.inertial_forces, tendon.factor_taut, tendon.solve_taut)
    fast = {part: straight(part, links, segments, turns, axial=axial, remembers=remembers) for part in parts}
    tag = size_tag(links, segments, turns, 1, axial) + "_memory" * remembers  # any number of tendons
    return compiled_twin(step, tag, lambda callee: fast.get(callee) or twin(callee), SOURCES, replaced=fast)


def fast_step(links: int) -> Any:
    """Return the fastest compiled time step for a planar chain of `links` links and constant length."""
    if links <= MOST_LINKS:
        return straight(motion.step, links)
    if links <= STRAIGHT_LINKS:
        return straight(articulated.step_articulated, links)
    return twin(articulated.step_articulated)


def extensible_step(links: int, segments: int, axial: int = 0) -> Any:
    """Return the compiled time step of a planar chain of `links` links with `segments` extensible segments."""
    if links + segments <= MOST_LINKS:
        return straight(extension.step, links, segments, axial=axial)
    return twin(extension.step)


def tuples(record: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a record, and all records in it, as plain tuples, which compiled kernels accept faster from Python."""
    return tuple(tuples(x) if isinstance(x, tuple) else x for x in record)
