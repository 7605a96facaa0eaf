"""The receiver at the valve, as the task file of the rig describes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pliant.control.task import LIMITS_IN, read_task
from pliant.errors import InputError
from pliant.loop.clock import Clock, SystemClock
from pliant.loop.keyed import read_key
from pliant.loop.network import UdpSource
from pliant.loop.receiver import ValveReceiver


def receiver_of(
    path: str | Path, drive: Callable[[np.ndarray], None], clock: Clock | None = None
) -> ValveReceiver:
    """Return the receiver that the table ``[receiver]`` of a task file describes; it listens already.

    Parameters
    ----------
    path : str or Path
        Of the task file; `key_file` is looked for in its folder.
    drive : callable
        ``drive(pressures)`` sets the valves, (C,) Pa, also of one chamber.
    clock : Clock, optional
        Default: that of the machine.

    Raises
    ------
    InputError
        When the task has no ``[receiver]``, an entry is wrong, the key cannot be read or the port not be opened.

    Examples
    --------
    >>> receiver_of("task.toml", set_valve_pa).run()        # doctest: +SKIP

    See Also
    --------
    pliant.loop.ValveReceiver : what its limits do
    """
    task = read_task(path)
    entry = task.receiver
    if entry is None:
        raise InputError(f"task {path} has no table [receiver]: state there what the receiver lets through")
    if task.unit != "Pa":
        raise InputError(f"task {path}: a receiver sets pressures, and the task limits {LIMITS_IN[task.unit]}")
    listed = entry.highest_kpa or task.highest_kpa
    given = np.ravel(listed)
    chambers = entry.chambers or given.size
    if given.size not in (1, chambers):
        raise InputError(f"task {path}: [receiver] has {chambers} chambers and highest_kpa {given.size} pressures")
    highest = 1e3 * np.broadcast_to(given, (chambers,))
    key = None if entry.key_file is None else read_key(Path(path).parent / entry.key_file)
    hold, longest = 1e-3 * entry.hold_ms, 1e-3 * entry.longest_hold_ms
    window = None if entry.window_ms is None else 1e-3 * entry.window_ms
    source = UdpSource((entry.host, entry.port), key, private_link=entry.private_link, senders=entry.senders)
    try:
        return ValveReceiver(
            source, drive, highest.tolist(), clock or SystemClock(), hold=hold,
            longest_hold=longest, window=window,
        )
    except InputError:
        source.close()
        raise
