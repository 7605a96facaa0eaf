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
    """Return a loop of this module, compiled with the fastest version of its kernel for this number of links."""
    from numba import njit

    few = links <= MOST_LINKS
    return rebuild(loop, njit(**options(loop)), {kernel.__name__: straight(kernel, links)} if few else None)


def many_accelerations(count, phi, w, torque, parts, a):
    """Compute `count` right-hand sides; phi changes slightly each time, so that no call is optimised away."""
    for _ in range(count):
        acceleration(phi, w, torque, parts[0], parts[1], parts[2], a)
        phi[0] = phi[0] + 1e-18 * a[0]


def many_jacobians(count, phi, w, torque, parts, out):
    """Compute `count` right-hand sides with their full Jacobian."""
    for _ in range(count):
        acceleration_jacobian(phi, w, torque, parts[0], parts[1], parts[2], out)
        phi[0] = phi[0] + 1e-18 * out.a[0]
