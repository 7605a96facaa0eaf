"""Simulation step by step for use in real time. A step is computed as in `simulate`, without allocation of memory."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import tuples, twin
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.model.features import FIRST_ORDER, RESTING, VALVES, Consumer
from pliant.shapes import Float
from pliant.simulation import march_loops, state
from pliant.simulation.balance import EnergyWatch, Unwatched
from pliant.simulation.base_motion import BaseMotion, BaseSteps, base_rows, check_base
from pliant.simulation.chamber_course import lag_of
from pliant.simulation.forces import PointForce, checked, link_loads
from pliant.simulation.solve import check_step
from pliant.simulation.time_step import warn_too_coarse

Array = np.ndarray

STEPPER = Consumer(
    "a Stepper", (RESTING - VALVES) | FIRST_ORDER,
    remedy={
        **dict.fromkeys(VALVES - FIRST_ORDER, "give the model an ideal or first-order valve, and pass the pressure "
                        "behind your valve to `step`"),
        "base_motion": "state the motion of its base: Stepper(model, base=BaseMotion(...)), or set moving_base to "
                       "false for a body whose base rests",
    },
)  # fmt: skip


class Snapshot(NamedTuple):
    """Saved state of a `Stepper`, from which the simulation can continue."""

    angle: Array  # (n,) rad; (n + S,) with strains behind, for a body that lengthens
    rate: Array  # rad/s, of the same shape
    memory: Array  # (n, branches) rad, hysteresis states
    pressure: Array  # (C,) Pa, behind the valves
    chambers: Array  # (C, 2) slow states
    time: float  # s


class Stepper:
    """A simulation that advances by one or more steps of fixed length at each call.

    Paper: Eq. (5) [eq:eom], solver D14.

    Parameters
    ----------
    model : Model
        The model. Its valves act on the commanded pressures; lag and rate limits are exact for a command that is
        constant over the step.
    time_step : float
        Length of a step, s.
    pressure : float, or array (C,) for several chambers
        Initial pressure, Pa, under which the chain starts in equilibrium.
    base : BaseMotion, optional
        Prescribed motion of the base. Coordinates, rates and positions are then relative to the moved base, and the
        energies below stay 0. By default the base rests.
    start : float
        Time at the start on the clock of `base`, s.

    Attributes
    ----------
    angle, rate : array (n,)
        Absolute link angles [rad] and rates [rad/s], updated in place by `step`; in space (N,) the joint coordinates.
    strain, strain_rate : array (S,)
        Strains of the segments that lengthen and their rates [1/s], updated in place by `step`.
    memory : array (n, branches)
        Hysteresis states, rad, updated in place; the last column is Bouc-Wen's. In space (m, branches), one row for
        each coordinate of a joint.
    pressure, stretch : array (C,)
        Pressure behind the valve, Pa; hoop stretch of a chamber that inflates, 1 for a rigid wall.
    time : float
        Time since the start plus `start`, s.
    energy_gain, energy_loss : float
        Largest energy gained without a source and lost without dissipation, as fractions of the largest change of any
        form of energy. The balance with the work of pressures and forces and the losses is computed every 256 steps.

    Raises
    ------
    InputError
        When the step is not a positive time short enough for the model, or the valve is of second order or has a
        dead time, or `base` does not fit the model.

    Warns
    -----
    AccuracyWarning
        When the step is too long for a mode that moves the tip; see `pliant.simulation.time_step.resolving_step`.
    EnergyWarning
        When energy appears or disappears by more than 1 % of the largest change of any form of energy.

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> stepper = pliant.Stepper(chen2018.model(), time_step=1e-3)
    >>> for _ in range(200):
    ...     state = stepper.step(50e3)  # Pa
    >>> bool(stepper.tips()[-1, 0] < 0)  # positive pressure bends towards -x
    True
    """

    def __init__(
        self, model: Model, time_step: float = 1e-3, pressure: float | Float[Array, " C"] = 0.0, *,
        base: BaseMotion | None = None, start: float = 0.0,
    ) -> None:
        model = model if base is None else model.with_(moving_base=False)
        STEPPER.check(model)
        check_step(model, time_step, "midpoint")
        warn_too_coarse(model, time_step)
        self._base = None if base is None else BaseSteps(model, base)
        self.model = model if self._base is None else self._base.model
        self._chain = mechanics_of(model) if self._base is None else self._base.chain
        self.time_step, self.start = time_step, float(start)
        self._drives = march_loops.Drives(
            model.actuation.kernel(), np.array([lag_of(c.valve) for c in model.chambers]),
            np.zeros(model.actuation.count), np.zeros((model.actuation.count, 2)),
        )
        self._command = np.zeros(model.actuation.count)
        self._body, self._joints, self._work = self._chain.parts()
        records: Any = type(self._body), type(self._joints), type(self._work), type(model.memory.law())
        self._advance = twin(march_loops.of_records(march_loops.hold, *records), *self._chain.sizes)
        self.reset(pressure)
        self.step(pressure)  # compiled here
        self.reset(pressure)

    def reset(
        self, pressure: float | Float[Array, " C"] = 0.0, *, joint_angle: Float[Array, " N"] | None = None,
        joint_rate: Float[Array, " N"] | None = None, start: float | None = None,
    ) -> None:
        """Reset the time to `start` [s] and the state to equilibrium under `pressure` [Pa], or to given joint angles
        and rates.

        `joint_angle` and `joint_rate` are (n,) [rad, rad/s]. `start` replaces that of the constructor, as newer poses
        of the base need.

        Hysteresis states are in equilibrium at these angles, and a force of `push` is removed. For a body that
        lengthens both arrays are (n + S,), with strains behind angles.

        Raises
        ------
        InputError
            When the angles or rates are not n finite numbers, or the motion of the base is not known at `start`.
        """
        model, begin = self.model, self.start if start is None else float(start)
        q = self._rest(pressure, begin) if joint_angle is None else state.vector(model, joint_angle)
        dq = np.zeros(model.size) if joint_rate is None else state.vector(model, joint_rate)
        self._x, self._v = mechanics_of(model).coordinates(q), mechanics_of(model).rates(dq)
        turns = model.size - len(model.extensions)
        self.angle, self.strain = self._x[:turns], self._x[turns:]
        self.rate, self.strain_rate = self._v[:turns], self._v[turns:]
        self.memory = state.relaxed(self.model, q)
        self._drives.pressure[:] = self.model.actuation.pressures(pressure)
        self._drives.state[:] = self.model.actuation.rest_state(pressure)
        past = self._chain.past(self.memory)
        self._parts = tuples((self._drives, self._body, self._joints, self._work, *past))
        self._load = mechanics_of(self.model).no_loads()[:0]
        self.time = self.start = begin
        self._watch = EnergyWatch(self.model) if self._base is None else Unwatched(self.model)

    def _rest(self, pressure: float | Array, begin: float) -> Array:
        if self._base is None:
            return state.equilibrium(self.model, pressure)
        try:
            return self._base.rest(pressure, begin)
        except InputError as error:
            raise InputError(f"{error}; to begin at another time, state its `start`") from None

    @property
    def position(self) -> Float[Array, " N"]:
        """Present coordinates (N,) of the chain, absolute angles [rad] and then strains; `step` updates the array in
        place.
        """
        return self._x

    @property
    def velocity(self) -> Float[Array, " N"]:
        """Present rates (N,) of the chain's coordinates; `step` updates the array in place."""
        return self._v

    @property
    def energy_gain(self) -> float:
        """Largest energy that the simulation gained without a source, as a fraction of the largest change of any form
        of energy.
        """
        return self._watch.gain

    @property
    def energy_loss(self) -> float:
        """Largest energy that the simulation lost without dissipation, as a fraction of the largest change of any form
        of energy.
        """
        return self._watch.loss

    @property
    def pressure(self) -> Float[Array, " C"]:
        """Present pressures (C,) [Pa] of C chambers behind their valves, as a copy."""
        return self._drives.pressure.copy()

    @property
    def stretch(self) -> Float[Array, " C"]:
        """Present hoop stretch (C,) of C chambers, 1 for a rigid wall."""
        return np.asarray(self._drives.state[:, 1] ** 0.25)

    def push(self, force: Float[Array, " d"] | None, at: str | Station | None = None) -> None:
        """Apply a constant force (2,) [N], in the base frame, at a point of the body from now on.
        None removes the force.

        The force keeps its direction and follows its point. In each step it acts at the mid-step angles.

        Parameters
        ----------
        force : array (2,), (3,) in space, or None
        at : str or Station
            Name of an observed point of the model, or another point; default: the last observed point.

        Raises
        ------
        InputError
            When the force is not two (in space three) finite numbers, or the model has no such point.
        """
        if force is None:
            self._load = mechanics_of(self.model).no_loads()[:0]
            return
        point = self.model.points[-1] if at is None else at
        wanted = mechanics_of(self.model).dimension
        pull = checked("Stepper", PointForce(np.zeros(1), np.atleast_2d(force), point), wanted)
        self._load = link_loads(self.model, [pull], pull.force[None])[0]

    def move_base(self, motion: BaseMotion) -> None:
        """Prescribe another motion of the base from now on, such as one with newer poses. Where it does not cover the
        time at the start, a later `reset` needs its `start`.

        Raises
        ------
        InputError
            When this stepper has no `base`, or the motion does not fit the model.
        """
        if self._base is None:
            raise InputError("the base of this Stepper rests: make a Stepper(model, base=BaseMotion(...))")
        check_base(self.model, motion)
        self._base.motion = motion

    def step(
        self, pressure: float | Float[Array, " C"], steps: int = 1,
    ) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
        """Advance by `steps` time steps (default 1) under a constant `pressure` [Pa], (C,) for C chambers.

        Returns
        -------
        angle, rate : array (n,)
            The attributes of the same names, rad and rad/s.

        Raises
        ------
        InputError
            When the number of values is not that of the inputs; a single 0 sets all inputs to 0. When the motion of the
            base is not known for these steps; nothing changes then.
        SimulationError
            When the pressure is not finite or a link moves too fast for the step; call `reset` before further steps.
        """
        self._command[:] = self._checked(pressure)
        failed = self._held(steps, self._load) if self._base is None else self._carried(self._base, steps)
        self.time += self.time_step * (steps if failed < 0 else failed + 1)
        if failed >= 0:
            under = ", ".join(f"{p:.6g} {u}" for p, u in zip(self._command, self.model.actuation.units, strict=True))
            if lost := state.given_way(self.model, self._x):
                raise SimulationError(f"at {self.time:.6g} s, under {under}, {lost}")
            if not np.isfinite(self._command).all():
                raise SimulationError(f"at {self.time:.6g} s the input is not finite ({under}): give finite numbers")
            if not (np.isfinite(self._x).all() and np.isfinite(self._v).all() and np.isfinite(self._load).all()):
                raise SimulationError(
                    f"at {self.time:.6g} s the state or the force of `push` is not finite: call `reset`"
                )
            raise SimulationError(
                f"at {self.time:.6g} s, under {under}, a link turns by more than a radian within the step of "
                f"{self.time_step * 1e3:.3g} ms; use a shorter step or a smaller pressure"
            )
        self._watch.look(self._x, self._v, self.memory, self.time_step, steps)
        return self.angle, self.rate

    def _held(self, steps: int, load: Array) -> int:
        """Advance under constant commands and loads; return the index of a failed step, or -1."""
        arguments = (self.time_step, steps, self._command, load, self._watch.total)
        return int(self._advance(self._x, self._v, arguments, *self._parts))

    def _carried(self, base: BaseSteps, steps: int) -> int:
        """Advance on the moving base under constant commands and forces; return the index of a failed step, or -1."""
        rows, loads = base_rows(self._chain, base.motion, self.time + self.time_step * np.arange(steps + 1))
        loads = loads + self._load if len(self._load) else loads
        for k in range(steps):
            if base.advance(partial(self._held, 1, loads[k]), rows[k], self._x, self._v) >= 0:
                return k
        return -1

    def _checked(self, pressure: float | Array) -> Array:
        """Return the value of each input as an array (C,)."""
        p = np.asarray(pressure, dtype=float)
        return p if p.shape == self._command.shape else self.model.actuation.pressures(p)

    def tips(self) -> Float[Array, "n d"]:
        """Return the present positions (n, 2) [m] of the tips of the n links."""
        return mechanics_of(self.model).tips(self._x)

    def stations(self) -> tuple[Float[Array, "S d"], Float[Array, " S"]]:
        """Return the present positions (S, 2) [m] and angles (S,) [rad] of the S observed points."""
        return mechanics_of(self.model).stations(self._x)

    def snapshot(self) -> Snapshot:
        """Return a copy of the whole state of the simulation, for `restore`."""
        return Snapshot(
            self._x.copy(), self._v.copy(), self.memory.copy(), self._drives.pressure.copy(),
            self._drives.state.copy(), self.time,
        )

    def restore(self, saved: Snapshot) -> None:
        """Set the state to a `snapshot` of this stepper, or of another stepper with an equal model.

        Raises
        ------
        InputError
            When the snapshot does not fit this model.
        """
        arrays = (self._x, self._v, self.memory, self._drives.pressure, self._drives.state)
        if [a.shape for a in arrays] != [b.shape for b in saved[:5]]:
            raise InputError(
                f"this snapshot does not fit the model: the number of coordinates ({saved.angle.size} in the snapshot, "
                f"{self._x.size} in the model), the hysteresis or the chambers differ: restore a snapshot of an equal "
                "model"
            )
        for array, value in zip(arrays, saved[:5], strict=True):
            array[...] = value  # in place, since the compiled step refers to these arrays
        self.time = saved.time
        self._watch.forget()
