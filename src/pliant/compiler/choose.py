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
    contact,
    elastic,
    energy,
    extension,
    extension_linearised,
    extension_memory,
    linearised,
    memory,
    motion,
    observation,
    poses,
    spatial,
    spatial_extension,
    spatial_linearised,
    spatial_memory,
    spatial_observation,
    spatial_points,
    spatial_springs,
    tendon,
)
from pliant.numerics import trig

MOST_LINKS = 12  # of a dense kernel: beyond, articulated bodies are faster, and the dense kernel compiles for seconds
STRAIGHT_LINKS = 64  # straight-line code of as many articulated bodies compiles in about 2 s
JACOBIAN_LINKS = 8  # the same for the Jacobian of a step
STRAIGHT_SOURCES = (
    trace.__file__, trig.__file__,
    *(str(Path(__file__).with_name(f"{name}.py")) for name in ("llvm", "trig", "simd", "dual_numbers", "duals")),
)
# Not the steps in the plane, so that batches and single simulations give the same bits.
FUSED: set[Any] = {motion.acceleration, motion.acceleration_jacobian, linearised.step_jacobian, spatial.step,
                   spatial.build_step, spatial.inertial_forces, tendon.factor_taut, tendon.solve_taut}
# Not inlined: they are so long that each caller would take as long to compile again.
CALLED: set[Any] = {
    linearised.step_jacobian, extension_linearised.step_jacobian, spatial_linearised.step_jacobian,
    spatial_memory.step_with_memory,
    spatial_memory.add_friction, spatial_memory.gap, spatial_memory.move_friction,
    poses.forces_after,
}
SPATIAL: dict[Any, Any] = {  # planar kernels and the kernels which replace them for a chain in space
    motion.step: spatial.step, motion.acceleration: tendon.accelerate, elastic.follows: spatial_springs.follows,
    energy.add_step_work: spatial_points.add_step_work, contact.add_link_loads: spatial_points.add_link_loads,
    observation.observe: spatial_points.observe, observation.observe_rows: spatial_observation.observe_rows,
    observation.motion_of: spatial_linearised.motion_of,
    observation.tip_outputs: spatial_linearised.tip_outputs, observation.turned: spatial_linearised.turned,
    linearised.step_jacobian: spatial_linearised.step_jacobian,
    memory.step_with_memory: spatial_memory.step_with_memory, memory.relax: spatial_memory.relax,
    memory.follow_change: spatial_memory.follow_change,
}  # fmt: skip
AXIAL: dict[Any, Any] = {  # replacements of the kernels of joints if segments have hysteresis too
    memory.step_with_memory: extension_memory.step_with_axial_memory, memory.relax: extension_memory.relax_all,
    memory.follow_change: extension_memory.follow_all,
}
MOST_TURNS = 24  # coordinates of a step in space as straight-line code: 24 take 4 s to compile, 30 take 6 s
SOURCES = (  # source files of a compiled kernel with replaced steps
    __file__, articulated.__file__, extension.__file__, extension_linearised.__file__, extension_memory.__file__,
    spatial.__file__,
    spatial_extension.__file__, spatial_linearised.__file__, spatial_memory.__file__,
    spatial_observation.__file__, spatial_points.__file__, spatial_springs.__file__, tendon.__file__, *STRAIGHT_SOURCES,
)


def twin(
    kernel: Any, links: int | None = None, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0,
) -> Any:
    """Return the compiled form of a plain Python `kernel`, with the same arguments, optimised for a chain of the given
    size.

    With a number of `links`, the steps inside it are the fastest for this number, see `substitutes`. If `segments` > 0
    segments lengthen, the steps are those of `equations.extension`. If each joint has 2 or 3 rotational coordinates
    (`turns`), the steps are those of `equations.spatial`, which are the same for any number of `tendons` but none.
    `axial` is the sum of `trace.CURVED` and `trace.REMEMBERS`: laws of segments beyond linear springs and dampers.
    """
    return made(kernel, links, segments, turns, min(tendons, 1), axial)


@cache
def made(kernel: FunctionType, links: int | None, *sizes: int) -> Any:
    """Return the compiled form of a plain Python kernel, created once for each chain size."""
    fast = substitutes(kernel, links, *sizes) if links else {}
    if kernel in fast:
        return fast[kernel]
    if links and fast and (links, *sizes) != (few := fewest(kernel, links, *sizes)):
        return made(kernel, *few)
    if fast:
        tag = size_tag(links, *sizes)
        return compiled_twin(kernel, tag, lambda callee: twin(callee, links, *sizes), SOURCES, replaced=fast)
    if links:
        return twin(kernel)
    return compiled_twin(kernel, "n", twin, STRAIGHT_SOURCES, forceinline=kernel not in CALLED)  # duals use these too


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
    name = f"{kernel.__name__}_{size}_{fingerprint(kernel, *STRAIGHT_SOURCES)}"
    recorded = partial(trace.recording, kernel, n, segments, turns, tendons, axial, remembers=remembers)
    return compiled(name, recorded, fused=kernel in FUSED)


def size_tag(links: int | None, segments: int, turns: int = 1, tendons: int = 0, axial: int = 0) -> str:
    """Return the part of a compiled kernel's name that describes the chain: its numbers of links, extensible segments,
    angles per joint and tendons, and whether the segments have nonlinear springs or hysteresis.
    """
    behind = [segments, turns, tendons] if turns > 1 else [segments] * (segments > 0)
    return "_".join(map(str, [links or "n", *behind, *[f"axial{axial}"] * (axial > 0)]))


def substitutes(
    kernel: FunctionType, links: int, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0, *,
    loops: bool = False,
) -> dict[Any, Any]:
    """Return {plain kernel: compiled replacement} for all functions called by `kernel` that have a faster form for this
    chain size.

    Kernels which need no replacement are left out. `loops` replaces straight-line code in space by loops, since
    straight-line code on dual numbers takes minutes to compile.
    """
    found, made = reached(kernel), {}
    if turns > 1:
        sizes = links, segments, turns, tendons, axial
        return {planar: spatial_twin(own, sizes, loops) for planar, own in SPATIAL.items() if planar in found}
    if motion.step in found:
        made[motion.step] = extensible_step(links, segments, axial) if segments else fast_step(links)
    if linearised.step_jacobian in found:
        jacobian = linearised.step_jacobian  # as loops it needs the scratch arrays of a looped step, whatever `step` is
        made[jacobian] = straight(jacobian, links) if links <= JACOBIAN_LINKS else twin(jacobian)
        if segments:
            made[jacobian] = twin(extension_linearised.step_jacobian)
    if energy.add_step_work in found and links + segments <= STRAIGHT_LINKS:
        made[energy.add_step_work] = straight(energy.add_step_work, links, segments)
    if axial & trace.REMEMBERS:
        steps: dict[Any, Any] = {extension.step: extensible_step(links, segments, axial)}
        for plain, own in AXIAL.items():
            if plain in found:
                made[plain] = compiled_twin(
                    own, size_tag(links, segments, axial=axial), lambda callee: steps.get(callee) or twin(callee),
                    SOURCES, replaced=steps,
                )
    if segments and contact.add_link_loads in found:
        made[contact.add_link_loads] = twin(extension.add_link_loads)
    return made


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
    remembering: Any = spatial_memory.step_with_memory
    jacobian: Any = spatial_linearised.step_jacobian
    steps: dict[Any, Any] = {}
    if kernel is remembering and (lines or sizes[3]):
        steps = {spatial.step: spatial_step(*sizes, lines=lines, remembers=True)}
    elif kernel is jacobian and sizes[3]:
        steps, sizes = {spatial.step: twin(tendon.step)}, (1, 0, 2, 1, 0)  # on complex numbers, the same for any size
    if not steps:
        return twin(kernel)
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
