"""Whether compiled code takes memory."""

from __future__ import annotations


def allocations(compiled, arguments, counts=(1, 1000)):
    """Arrays and blocks of memory that `compiled(count, arguments)` takes from Numba for each count, once compiled."""
    from numba.core.runtime import _nrt_python, rtsys

    compiled(1, arguments)
    _nrt_python.memsys_enable_stats()
    taken = []
    for count in counts:
        before = rtsys.get_allocation_stats()
        compiled(count, arguments)
        after = rtsys.get_allocation_stats()
        taken.append((after.alloc - before.alloc, after.mi_alloc - before.mi_alloc))
    return taken
