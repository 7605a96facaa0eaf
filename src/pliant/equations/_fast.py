"""Which twin of a step runs for how many links: the dense step for few, articulated bodies for many, as straight lines.

Compiling a straight line takes the longer the more links it has, so beyond some number the loops run.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from pliant.equations import articulated, linearised, motion
from pliant.equations._compiled import reached, twin
from pliant.equations._straight import MOST_LINKS, straight
from pliant.equations._straight import SOURCES as STRAIGHT_SOURCES

STRAIGHT_LINKS = 64  # a straight line of so many articulated bodies compiles in about 2 s
JACOBIAN_LINKS = 8  # so does the Jacobian of a step
SOURCES = (__file__, articulated.__file__, *STRAIGHT_SOURCES)  # of a twin, beside the kernels that it reaches


def substitutes(kernel: FunctionType, links: int) -> dict[Any, Any]:
    """Compiled twins for so many links that stand in for kernels that `kernel` reaches, itself included."""
    found, made = reached(kernel), {}
    if motion.step in found:
        made[motion.step] = fast_step(links)
    if linearised.step_jacobian in found:
        jacobian = linearised.step_jacobian  # as loops it needs the scratch arrays of a looped step, whatever `step` is
        made[jacobian] = straight(jacobian, links) if links <= JACOBIAN_LINKS else twin(jacobian)
    return made


def fast_step(links: int) -> Any:
    """The fastest compiled `motion.step` for so many links."""
    if links <= MOST_LINKS:
        return straight(motion.step, links)
    if links <= STRAIGHT_LINKS:
        return straight(articulated.step_articulated, links)
    return twin(articulated.step_articulated)
