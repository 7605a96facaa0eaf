"""The receiver at the valve: commands that arrive set the valve, and the valve is vented when none arrives in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pliant.control.task import LIMITS_IN, read_task
from pliant.errors import InputError
from pliant.loop.clock import Clock, SystemClock
from pliant.loop.keyed import read_key
from pliant.loop.network import UdpSource
from pliant.loop.sample import COMMAND, Sample, Sender, Source, nanoseconds
from pliant.loop.watchdog import ended_by_signals
from pliant.shapes import Float
from pliant.units import PASCAL

Array = np.ndarray
MOST = 256  # most samples read at once, so that a flood cannot delay the receiver
LONGEST_HOLD = 5.0  # s, longest time for which a command may be held
DRIFT = 1000  # 1 / the largest difference of two clocks' rates: ten times that of quartz clocks


@dataclass
class _InForce:
    """The sender whose commands are accepted, and the estimate of the sender's clock."""

    sender: Sender | None
    newest: int  # ns, newest time stamp
    fastest: int  # ns, smallest difference of arrival time (this clock) and time stamp
    heard: int  # ns, time of the last update of `fastest`


class ValveReceiver:
    """Sets a valve to the commands that arrive. Each carries a hold time; without a newer command the valve is vented
    when this time is over.

    The receiver runs where the valve is. A kill or crash of the loop's program, a power loss of its machine or a pulled
    cable leaves the valve under pressure no longer than a command's `Sample.hold`. The hardware must handle a failure
    of the receiver itself: the valve must close without current. `receiver_of` takes the limits from a task file.

    While a command is held, only its sender may command. The hold time counts from when the command was sent: the
    sender's clock is compared with this one's by the fastest packet. A vent (a command of 0 for all chambers) is always
    obeyed, whatever its time stamp and sender. A vent from another sender also keeps the valve vented for its hold
    time. The source (`UdpSource`) decides who may send at all.

    Parameters
    ----------
    source : Source
        Source of samples named "command", e.g. `UdpSource`.
    drive : callable
        ``drive(pressures)`` sets the valves to the pressures (C,) [Pa]; (1,) for one chamber.
    highest : float or sequence of float
        Highest pressure [Pa] of one chamber, or of each chamber (C,). A command above it, or for another number of
        chambers, is rejected.
    clock : Clock
    hold : float
        Hold time [s] of commands without one.
    longest_hold : float
        Longest hold time [s], at most 5; longer hold times are shortened to it.
    window : float, optional
        Time [s], at most 5, by which a time stamp may be ahead of the sender's earlier commands. Default:
        `longest_hold`.

    Attributes
    ----------
    command : array (C,)
        The present command [Pa].
    rejected, late, ahead, foreign, shortened : int
        Numbers of commands that were not used: wrong unit, size or limit (`rejected`); not newer than an earlier one,
        or older than their hold time (`late`); time stamp in the future (`ahead`); from another sender (`foreign`).
        `shortened` counts commands whose hold time was shortened.
    vented : int
        Number of times that the valve was vented because no command arrived.

    Raises
    ------
    InputError
        When a limit is not positive, or `longest_hold` or `window` exceeds 5 s.
    """

    def __init__(
        self, source: Source, drive: Callable[[Float[Array, " C"]], None], highest: float | Sequence[float],
        clock: Clock, *, hold: float = 0.1, longest_hold: float = 0.5, window: float | None = None,
    ) -> None:
        limits = np.array(highest, dtype=float, ndmin=1)
        if limits.ndim > 1 or not (limits.size and np.isfinite(limits).all() and (limits > 0).all()):
            raise InputError(f"a receiver needs a positive highest pressure for each chamber, got {highest} Pa")
        if not 0 < hold <= longest_hold <= LONGEST_HOLD:
            raise InputError(
                f"a receiver needs 0 < hold <= longest_hold <= {LONGEST_HOLD:g} s, got {hold} s and {longest_hold} s"
            )
        window = longest_hold if window is None else window
        if not 0 < window <= LONGEST_HOLD:
            raise InputError(f"a receiver needs 0 < window <= {LONGEST_HOLD:g} s, got {window} s")
        self._window = nanoseconds(window)
        self._source, self._drive, self._highest, self._clock = source, drive, limits, clock
        self._hold, self._longest, self._until = hold, longest_hold, clock.now()
        self._held_down = clock.now()  # until when another sender's vent keeps the valve vented
        self._in_force: _InForce | None = None
        vent = np.zeros(limits.shape)
        vent.setflags(write=False)
        self._vent = self.command = vent
        self.rejected = self.late = self.ahead = self.foreign = self.shortened = self.vented = 0

    def poll(self) -> Float[Array, " C"]:
        """Read the commands that have arrived, set the valves of the C chambers, and return the present commands (C,)
        [Pa].

        Call this method about every millisecond.
        """
        self._vent_after_silence(self._clock.now())  # first: packets delayed until now belong to an ended session
        for _ in range(MOST):
            arrived = self._source.read()
            if arrived is None:
                break
            if arrived.name == COMMAND:
                self._take(arrived, self._clock.now())
        self._vent_after_silence(self._clock.now())
        self._drive(self.command)
        return self.command

    def _vent_after_silence(self, now: int) -> Sender | None:
        """Vent if the last command's hold time is over, and return its sender; otherwise return None."""
        if self._in_force is None or now < self._until:
            return None
        self.vented += bool(np.any(self.command))
        self.command, ended, self._in_force = self._vent, self._in_force.sender, None
        if ended is not None and hasattr(self._source, "end_session"):
            self._source.end_session(ended)
        return ended

    def _take(self, arrived: Sample, now: int) -> None:
        pressure = self._pressure(arrived)
        vent = pressure is self._vent
        if vent:
            self.command = self._vent
        if pressure is None or not arrived.hold >= 0.0:
            self.rejected += 1
            return
        hold = arrived.hold or self._hold
        if hold > self._longest:
            hold, self.shortened = self._longest, self.shortened + 1
        ended = self._vent_after_silence(now)
        if ended is not None and ended.session and ended == arrived.sender:
            self.late += 1
            return
        if self._in_force is None:
            self._in_force = _InForce(arrived.sender, arrived.time_ns - 1, now - arrived.time_ns, now)
        elif self._in_force.sender != arrived.sender:
            self.foreign += 1
            self._held_down = max(self._held_down, now + nanoseconds(hold)) if vent else self._held_down
            return
        until = self._expiry(self._in_force, arrived.time_ns, now, nanoseconds(hold))
        if until is not None:
            self.command, self._until = self._vent if now < self._held_down else pressure, until

    def _expiry(self, of: _InForce, stamp: int, now: int, hold: int) -> int | None:
        """Return when a command with the time stamp `stamp` expires [ns, own clock], or None for a bad time stamp."""
        delay = now - stamp
        fastest = min(delay, of.fastest + (now - of.heard) // DRIFT)
        if of.fastest - delay > self._window:
            self.ahead += 1
        elif stamp <= of.newest or stamp + fastest + hold <= now:
            self.late += 1
        else:
            of.newest, of.fastest, of.heard = stamp, fastest, now
            return stamp + fastest + hold
        return None

    def _pressure(self, arrived: Sample) -> Array | None:
        """Return the command in Pa, the vent for a command of 0 in any unit and size, or None if it is not valid."""
        values = arrived.array.ravel()
        if values.size and not values.any():
            return self._vent
        pressure = values * PASCAL.get(arrived.unit.lower(), math.nan)
        if pressure.size != self._highest.size or not ((pressure >= 0.0) & (pressure <= self._highest)).all():  # or NaN
            return None
        return pressure

    def run(self, duration: float | None = None, *, period: float = 1e-3) -> None:
        """Poll for `duration` [s], or until the source ends, and vent the valve at the end in any case."""
        deadline = self._clock.now()
        stop = None if duration is None else deadline + nanoseconds(duration)
        with ended_by_signals():
            try:
                while (stop is None or deadline < stop) and not self._source.finished:
                    self._clock.sleep_until(deadline)
                    self.poll()
                    deadline = max(deadline + nanoseconds(period), self._clock.now())
            finally:
                self.command = self._vent
                self._drive(self.command)


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
        raise InputError(f"task {path}: a receiver limits pressures, but the task gives {LIMITS_IN[task.unit]}: give "
                         "highest_kpa instead")
    listed = entry.highest_kpa or task.highest_kpa
    pressures = np.ravel(listed)
    chambers = entry.chambers or pressures.size
    if pressures.size not in (1, chambers):
        raise InputError(
            f"task {path}: [receiver] has {chambers} chambers, but highest_kpa lists {pressures.size} pressures: "
            "give one for all chambers, or one for each"
        )
    highest = 1e3 * np.broadcast_to(pressures, (chambers,))
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
