"""Construct the receiver at the valve from the table ``[receiver]`` of a task file."""

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
    """Return a listening `ValveReceiver` with the settings of the table ``[receiver]`` of a task file.

    Parameters
    ----------
    path : str or Path
        Path of the task file. Its `key_file` is relative to the folder of the task file.
    drive : callable
        ``drive(pressures)`` sets the valves to the pressures (C,) [Pa]; (1,) for one chamber.
    clock : Clock, optional
        Default: `SystemClock`.

    Raises
    ------
    InputError
        When the task has no ``[receiver]``, an entry is wrong, the key cannot be read or the port cannot be opened.

    Examples
    --------
    >>> receiver_of("task.toml", set_valve_pa).run()        # doctest: +SKIP

    See Also
    --------
    pliant.loop.ValveReceiver : explains the limits
    """
    task = read_task(path)
    entry = task.receiver
    if entry is None:
        raise InputError(f"task {path} has no table [receiver]: add it with the limits of the accepted commands")
    if task.unit != "Pa":
        raise InputError(f"task {path}: a receiver sets pressures, and the task limits {LIMITS_IN[task.unit]}")
    listed = entry.highest_kpa or task.highest_kpa
    given = np.ravel(listed)
    chambers = entry.chambers or given.size
    if given.size not in (1, chambers):
        raise InputError(
            f"task {path}: [receiver] has {chambers} chambers and highest_kpa {given.size} pressures: "
            "give one, or one for each chamber"
        )
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
