"""One step at a time, for real-time use: the same step as `simulate`, no allocation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import tuples, twin
from pliant.equations.symbols import Past
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.simulation import march_loops, state
from pliant.simulation.balance import EnergyWatch
from pliant.simulation.chamber_course import lag_of
from pliant.simulation.forces import PointForce, checked, link_loads
from pliant.simulation.solve import check_step
from pliant.simulation.time_step import warn_too_coarse

Array = np.ndarray

class Snapshot(NamedTuple):
    """State of a `Stepper`, from which it can continue."""

    angle: Array  # (n,) rad; with the strains of a body that lengthens behind them, (n + S,)
    rate: Array  # (n,) rad/s, as long
    memory: Array  # (n, branches) rad
    pressure: Array  # (C,) Pa, behind the valves
    chambers: Array  # (C, 2) slow states
    time: float  # s


class Stepper:
    """A model that moves one step of fixed length at each call. Paper: Eq. (5) [eq:eom], solver D14.

    Parameters
    ----------
    model : Model
        Its valves are applied to the pressures passed in: lag and limits of the rate exact for a pressure held over
        the step.
    step : float
        Length of a step, s.
    pressure : float, or array (C,) for several chambers
        Pressure at the start, Pa, under which the chain begins at rest.

    Attributes
    ----------
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s], updated in place by `step`; in space (N,) the joint coordinates.
    strain, strain_rate : array (S,)
        Of the segments that lengthen, and per second, updated in place by `step`.
    memory : array (n, branches)
        States of the model's memory, rad, updated in place; the last column is Bouc-Wen's. In space (m, branches), one
        row for each coordinate of a joint.
    pressure, stretch : float, or array (C,)
        Pressure behind the valve, Pa; hoop stretch of a chamber that inflates, 1 for a rigid wall.
    time : float
        s since the start.
    energy_gain, energy_loss : float
        Largest energy that came from nothing and that went to nothing, as fractions of the energy in play, balanced
        every 256 steps against the work of pressures and forces and the losses.

    Raises
    ------
    InputError
        When the step is not a positive time short enough for the model, or the valve is of second order or has a
        dead time.

    Warns
    -----
    AccuracyWarning
        When the step is too long for a mode that moves the tip; see `pliant.simulation.time_step.time_step`.
    EnergyWarning
        When more than 1 % of the energy in play appears or disappears while the chain is stepped.

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> stepper = pliant.Stepper(chen2018.model(), step=1e-3)
    >>> for _ in range(200):
    ...     state = stepper.step(50e3)  # Pa
    >>> bool(stepper.tips()[-1, 0] < 0)  # positive pressure bends towards -x
    True
    """

    def __init__(self, model: Model, step: float = 1e-3, pressure: float | Array = 0.0) -> None:
        for chamber in model.chambers:
            v = chamber.valve
            if v.dead_time or v.natural_frequency or v.settle_share or v.dead_band or v.opening_time:
                raise InputError(
                    "a Stepper takes an ideal or first-order valve: pass it the pressure behind another one"
                )
        check_step(model, step, "midpoint")
        warn_too_coarse(model, step)
        self.model = model
        self.length = step
        self._drives = march_loops.Drives(
            model.actuation.kernel(), np.array([lag_of(c.valve) for c in model.chambers]),
            np.zeros(model.actuation.count), np.zeros((model.actuation.count, 2)),
        )
        self._command = np.zeros(model.actuation.count)
        self._body, self._joints, self._work = mechanics_of(model).parts()
        self._law, self._held = model.memory.law(), mechanics_of(model).held()
        loop = march_loops.hold_with_memory if model.memory else march_loops.hold
        records: Any = type(self._body), type(self._joints), type(self._work), type(self._law)
        self._advance = twin(march_loops.of_records(loop, *records), *mechanics_of(model).sizes)
        self.reset(pressure)
        self.step(pressure)  # compiled here
        self.reset(pressure)

    def reset(
        self, pressure: float | Array = 0.0, *, joint_angle: Array | None = None, joint_rate: Array | None = None
    ) -> None:
        """Back to rest under `pressure` [Pa], or to `joint_angle` and `joint_rate` (n,) [rad, rad/s]; time 0.

        The memory is long at rest at these angles; a force is let go. Of a body that lengthens both are (n + S,),
        strains behind angles.

        Raises
        ------
        InputError
            When the angles or rates are not n finite numbers.
        """
        model = self.model
        q = state.equilibrium(model, pressure) if joint_angle is None else state.vector(model, joint_angle)
        dq = np.zeros(model.size) if joint_rate is None else state.vector(model, joint_rate)
        self._x, self._v = mechanics_of(model).coordinates(q), mechanics_of(model).rates(dq)
        turns = model.size - len(model.extensions)
        self.angle, self.strain = self._x[:turns], self._x[turns:]
        self.rate, self.strain_rate = self._v[:turns], self._v[turns:]
        self.memory = state.relaxed(self.model, q)
        self._drives.pressure[:] = self.model.actuation.pressures(pressure)
        self._drives.state[:] = self.model.actuation.rest_state(pressure)
        chain: tuple[Any, ...] = (self._body, self._joints)
        if self.model.memory:
            chain = (chain, Past(self._law, self.memory, self._held))
        self._parts = tuples((self._drives, *chain, self._work))
        self._load = mechanics_of(self.model).no_loads()[:0]
        self.time = 0.0
        self._watch = EnergyWatch(self.model)

    @property
    def position(self) -> Array:
        """Angles with strains behind them (N,): the coordinates that `mechanics_of` takes; the live array."""
        return self._x

    @property
    def velocity(self) -> Array:
        """Rates of `position` (N,); the live array."""
        return self._v

    @property
    def energy_gain(self) -> float:
        """Largest energy that came from nothing, as a fraction of the energy in play."""
        return self._watch.gain

    @property
    def energy_loss(self) -> float:
        """Largest energy that went to nothing, as a fraction of the energy in play."""
        return self._watch.loss

    @property
    def pressure(self) -> Array:
        """Pressures (C,) behind the valves, Pa; a copy."""
        return self._drives.pressure.copy()

    @property
    def stretch(self) -> Array:
        """Hoop stretch (C,) of the chambers."""
        return np.asarray(self._drives.state[:, 1] ** 0.25)

    def push(self, force: Array | None, at: str | Station | None = None) -> None:
        """From now on a force (2,) [N] in the base frame pulls at a point of the body; None lets go.

        The force keeps its direction and follows its point. Within a step it counts at the angles half a step ahead.

        Parameters
        ----------
        force : array (2,), (3,) in space, or None
        at : str or Station
            One of the model's observed points by its name, or a place on a link; default: the last observed point.

        Raises
        ------
        InputError
            When the force is not two finite numbers, or the model has no such point.
        """
        if force is None:
            self._load = mechanics_of(self.model).no_loads()[:0]
            return
        place = self.model.points[-1] if at is None else at
        wanted = mechanics_of(self.model).dimension
        pull = checked("Stepper", PointForce(np.zeros(1), np.atleast_2d(force), place), wanted)
        self._load = link_loads(self.model, [pull], pull.force[None])[0]

    def step(self, pressure: float | Array, steps: int = 1) -> tuple[Array, Array]:
        """Advance one step, or several at once, under `pressure` [Pa], (C,) for several chambers, held constant.

        Returns
        -------
        (angle, rate) : the live arrays

        Raises
        ------
        SimulationError
            When the pressure is not finite, or moves a link faster than the step can follow; `reset` before going on.
        """
        self._command[:] = pressure
        held = (self.length, steps, self._command, self._load, self._watch.total)
        failed = self._advance(self._x, self._v, held, *self._parts)
        self.time += self.length * (steps if failed < 0 else failed + 1)
        if failed >= 0:
            under = ", ".join(f"{p:.6g} {u}" for p, u in zip(self._command, self.model.actuation.units, strict=True))
            if lost := state.given_way(self.model, self._x):
                raise SimulationError(f"at {self.time:.6g} s, under {under}, {lost}")
            raise SimulationError(
                f"at {self.time:.6g} s, under {under}, a link turns by more than a radian within the step of "
                f"{self.length * 1e3:.3g} ms, or the pressure is not finite; use a shorter step or a smaller pressure"
            )
        self._watch.look(self._x, self._v, self.memory, self.length, steps)
        return self.angle, self.rate

    def tips(self) -> Array:
        """Tips of the links now (n, 2), m."""
        return mechanics_of(self.model).tips(self._x)

    def stations(self) -> tuple[Array, Array]:
        """Positions (S, 2) [m] and angles (S,) [rad] of the model's observed points now."""
        return mechanics_of(self.model).stations(self._x)

    def snapshot(self) -> Snapshot:
        """All that moves, copied: `restore` goes on from here."""
        return Snapshot(
            self._x.copy(), self._v.copy(), self.memory.copy(), self._drives.pressure.copy(),
            self._drives.state.copy(), self.time,
        )

    def restore(self, saved: Snapshot) -> None:
        """Go back to a `snapshot` of this stepper, or of one of an equal model.

        Raises
        ------
        InputError
            When the snapshot is of another kind of model.
        """
        held = (self._x, self._v, self.memory, self._drives.pressure, self._drives.state)
        if [a.shape for a in held] != [b.shape for b in saved[:5]]:
            raise InputError(f"this snapshot is of a model with {saved.angle.size} links or other memory or chambers")
        for own, value in zip(held, saved[:5], strict=True):
            own[...] = value  # in place: the compiled step holds these arrays
        self.time = saved.time
        self._watch.forget()
