"""Loops that call a kernel many times, so that a call can be timed without the overhead of Python."""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import Any

from pliant.compiler.choose import MOST_LINKS, straight
from pliant.compiler.twin import options, rebuild
from pliant.equations.motion import acceleration, acceleration_jacobian


@cache
def compiled(loop: FunctionType, kernel: FunctionType, links: int) -> Any:
    """Return a loop of this module compiled by Numba, which calls the version of `kernel` that is fastest for this
    number of links.
    """
    from numba import njit

    few = links <= MOST_LINKS
    return rebuild(loop, njit(**options(loop)), {kernel.__name__: straight(kernel, links)} if few else None)


def many_accelerations(count, phi, w, torque, parts, a):
    """Compute the joint accelerations `count` times into `a`. The angle phi[0] changes slightly each time, so that the
    compiler cannot skip a call.
    """
    for _ in range(count):
        acceleration(phi, w, torque, parts[0], parts[1], parts[2], a)
        phi[0] = phi[0] + 1e-18 * a[0]


def many_jacobians(count, phi, w, torque, parts, out):
    """Compute the joint accelerations and their Jacobian `count` times into `out`."""
    for _ in range(count):
        acceleration_jacobian(phi, w, torque, parts[0], parts[1], parts[2], out)
        phi[0] = phi[0] + 1e-18 * out.a[0]
