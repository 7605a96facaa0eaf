"""The other end of the wire: commands that arrive drive a valve, and silence vents it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.loop.clock import Clock
from pliant.loop.endings import ended_by_signals
from pliant.loop.sample import COMMAND, Sample, Sender, Source, nanoseconds
from pliant.units import PASCAL

Array = np.ndarray
MOST = 256  # samples read at once: a flood cannot hold up the receiver
LONGEST_HOLD = 5.0  # s that a receiver may let a command be in force
DRIFT = 1000  # 1 / the largest difference of two clocks' rates: ten times what quartz does


@dataclass
class _InForce:
    """The sender whose commands count, and what is known of its clock."""

    sender: Sender | None
    newest: int  # ns, its stamp
    fastest: int  # ns from its stamp to this clock's time of arrival, by the packet that came fastest
    heard: int  # ns, when that was last judged


class ValveReceiver:
    """Drives a valve by commands that arrive, and vents it when none comes within the time that the last one holds.

    It runs where the valve is: nothing that happens to the loop's program, its machine or the network (a kill, a crash,
    a lost supply, a pulled cable) leaves the valve at pressure for longer than a command's `Sample.hold`. What happens
    to this program itself is the hardware's part: the valve that it drives must close without current. `receiver_of`
    takes the limits from a task file.

    The sender of the command in force is the only one that commands until that command's time is over. A command counts
    from when it was sent: the sender's clock is set against this one's by the packet that came fastest. A vent, a
    command of 0 for all chambers, always wins, whatever its time and whoever sends it; that of another sender also
    keeps the valve vented for the time that it holds. Who may send at all is the source's part (`UdpSource`).

    Parameters
    ----------
    source : Source
        Of samples named "command", e.g. `UdpSource`.
    drive : callable
        ``drive(pressures)`` sets the valves, (C,) Pa, also of one chamber.
    highest : float or sequence of float
        Pa; a number for one chamber, one each (C,) for several. A command beyond, or of another number of chambers, is
        not a command.
    clock : Clock
    hold : float
        s that a command is in force that does not say it itself.
    longest_hold : float
        s, at most 5; a command that would hold for longer, holds for this.
    window : float, optional
        s, at most 5: a sender's time that lies further ahead of what its earlier commands led to expect is not used.
        Default: `longest_hold`.

    Attributes
    ----------
    command : array (C,)
        Pa, in force.
    rejected, late, ahead, foreign, shortened : int
        Commands that were none (unit, number, limit); those not newer than one before, or older than they hold; those
        of a time that has not come; those of a sender other than the one in force. None of these is used. And commands
        whose hold was shortened.
    vented : int
        How often silence vented the valve.

    Raises
    ------
    InputError
        When a limit is not positive, or `longest_hold` or `window` exceeds 5 s.
    """

    def __init__(
        self, source: Source, drive: Callable[[Array], None], highest: float | Sequence[float], clock: Clock,
        *, hold: float = 0.1, longest_hold: float = 0.5, window: float | None = None,
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

    def poll(self) -> Array:
        """Take what has arrived and set the valves; call it every millisecond or so. Returns the commands in force."""
        self._vent_after_silence(self._clock.now())  # first: what was held back until now is of a session that ended
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
        """Vent when the last command's time is over; return whose it was. The next sender may have another clock."""
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
        """Return when a command of that stamp expires, ns of the own clock; None, and counted, for a bad stamp."""
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
        """The command in Pa; 0 where it vents, in whatever unit and for how many chambers; None where it is none."""
        values = arrived.array.ravel()
        if values.size and not values.any():
            return self._vent
        pressure = values * PASCAL.get(arrived.unit.lower(), math.nan)
        if pressure.size != self._highest.size or not ((pressure >= 0.0) & (pressure <= self._highest)).all():  # or NaN
            return None
        return pressure

    def run(self, duration: float | None = None, *, period: float = 1e-3) -> None:
        """Poll for `duration` [s], or until the source ends; whatever ends it, the valve is vented."""
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
