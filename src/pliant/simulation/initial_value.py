"""Initial value problem of a simulation: its definition, and its integration by the midpoint rule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.errors import SimulationError
from pliant.mechanics import mechanics_of
from pliant.mechanics.lengths import check_lengths
from pliant.model import Model
from pliant.simulation import march_loops, state
from pliant.simulation.base_motion import BaseMotion, base_rows, check_base, resting_load
from pliant.simulation.chamber_course import delivered
from pliant.simulation.drive import Drive, before, check_times, drive, inputs_of, too_fast
from pliant.simulation.forces import PointForce, checked, loads_at, mean_loads
from pliant.simulation.inputs import Input

Array = np.ndarray
Marched = tuple[Array, Array, Array, Array]  # angles, rates, work, hysteresis states, at the output times


class Solution(NamedTuple):
    """A simulated motion with its pressures, longest time step and estimated error."""

    pressure: Array  # (T, C) Pa, behind the valves
    marched: Marched
    time_step: float  # s, longest step
    stretch: Array | None = None  # (T, C) hoop stretch, if a chamber inflates
    error: float = np.nan  # upper estimate of the error of the tip, over the length; NaN: not estimated
    energies: dict[str, Array] | None = None  # J, by name, see `balance.energies`; None: not computed


class InitialValueProblem(NamedTuple):
    """A simulation to be computed: model, inputs, output times, forces and initial state."""

    model: Model
    pressure: tuple[Input, ...]
    times: Array  # (T,) s
    forces: tuple[PointForce, ...]
    initial: Array  # (C,) Pa, just before the first time
    start: tuple[Array, Array] = (np.zeros(0), np.zeros(0))  # absolute angles and rates (N,)
    states: Array = np.zeros((0, 0))  # (n, branches) rad, hysteresis states; in space (m, branches)
    graded: bool = False  # whether the first two steps after each jump are divided
    base: BaseMotion | None = None  # prescribed motion of the base; None: the base rests

    def started(self, angle: Array | None, rate: Array | None, states: Array | None) -> InitialValueProblem:
        """Return the problem with its initial state set: joint angles, rates and hysteresis states. None stands for the
        equilibrium angles, rates of 0 and relaxed hysteresis.
        """
        model, before = self.model, float(np.nextafter(self.times[0], -np.inf))
        load = loads_before(model, self.forces, self.base, before, float(self.times[0]))
        rest = angle is None
        q = state.equilibrium(model, self.initial, link_load=load) if rest else state.vector(model, angle)
        dq = np.zeros(model.size) if rate is None else state.vector(model, rate)
        start = mechanics_of(model).coordinates(q), mechanics_of(model).rates(dq)
        return self._replace(start=start, states=state.first_states(model, q, states))

    def plan(self, time_step: float, times: Array | None = None) -> Drive:
        """Return time steps of at most `time_step` that end at all `times`, with the mean torques and forces in them.
        By default `times` are the output times.
        """
        times = self.times if times is None else times
        return self.loaded(drive(self.model, self.pressure, times, time_step, graded=self.graded))

    def loaded(self, plan: Drive) -> Drive:
        """Return the time steps `plan` together with the motion of the base, and the loads [N m] on the links by known
        forces and by this motion. The loads are averages over each time step.
        """
        if not self.forces and self.base is None:
            return plan
        nodes = self.times[0] + np.append(0.0, np.cumsum(plan.h))
        load, base = loads_and_base(self.model, self.forces, self.base, nodes)
        return plan._replace(load=load, base=base)

    def marched(self, plan: Drive, rows: int | None = None) -> Marched:
        """Integrate over the time steps `plan` by the midpoint rule; return the motion as arrays with one row for each
        of `rows` output times.
        """
        rows = len(plan.pressure) if rows is None else rows
        return march(self.model, plan, self.start, rows, self.states)

    def tips(self, phi: Array) -> Array:
        """Return the tip positions at T instants, (T, 2) or in space (T, 3), divided by the length of the body, from
        the chain's N coordinates phi (T, N).
        """
        return np.asarray(mechanics_of(self.model).tips(phi)[:, -1] / self.model.length)

    def repeated(self, plan: Drive, phi: Array, factor: float) -> tuple[Array, Array]:
        """Return tip positions of a motion and of its repetition with steps `factor` times as long, at equal times."""
        every = 2 if factor > 1.0 and self.times.size > 2 else 1  # half of the output times, since no step passes one
        other = self.plan(factor * float(plan.h.max()), self.times[::every])
        if factor > 1.0 and other.h.size > 0.75 * plan.h.size:
            raise SimulationError(
                "the simulation cannot be repeated with longer steps, because its output times and the jumps of its "
                "inputs are too close together: use fewer output times"
            )
        return self.tips(phi[::every]), self.tips(self.marched(other)[0])


def posed(
    model: Model, pressure: Input | Sequence[Input], times: Array, forces: Sequence[PointForce],
    base: BaseMotion | None = None,
) -> InitialValueProblem:
    """Return the initial value problem for a model under inputs, known forces and a motion of its base. Its initial
    state is set separately.

    Raises
    ------
    InputError
        When the inputs do not fit the model, the times do not increase, or a force is invalid.
    """
    chain = mechanics_of(model)  # refuses what is no model
    if base is not None:
        check_base(model, base)
        model = model.with_(moving_base=True)
    inputs, times = inputs_of(model, pressure), check_times(times)
    pull = tuple(checked("simulate", force, chain.dimension) for force in forces)
    valves = [c.valve for c in model.chambers]
    initial = [delivered(v, before(u, v.dead_time, times)) for u, v in zip(inputs, valves, strict=True)]
    return InitialValueProblem(model, inputs, times, pull, np.array(initial), base=base)


def loads_before(
    model: Model, forces: Sequence[PointForce], base: BaseMotion | None, before: float, first: float,
) -> Array | None:
    """Return the loads [N m] on the links under which a body rests: those of known forces at `before` [s], and of the
    pose of a moving base at `first` [s], at which it has been at rest; None if there are none.
    """
    load = loads_at(model, forces, before) if forces else None
    if base is None:
        return load
    turned = resting_load(mechanics_of(model), base, first)
    return turned if load is None else load + turned


def loads_and_base(
    model: Model, forces: Sequence[PointForce], base: BaseMotion | None, nodes: Array, late: float = 0.0,
) -> tuple[Array, Array]:
    """Return the mean loads [N m] on the links in each of the m steps between `nodes` (m + 1,) [s], and the motion of
    the base in them (m, 5), in space (m, 6), without rows for a base at rest. The clock of its poses is `late` [s]
    late.
    """
    loads = mean_loads(model, forces, nodes) if forces else np.zeros((0, *mechanics_of(model).no_loads().shape))
    if base is None:
        return loads, np.zeros((0, 5))
    rows, beside = base_rows(mechanics_of(model), base, nodes + late)
    return (loads + beside if forces else beside), rows


def march(
    model: Model, plan: Drive, start: tuple[Array, Array], rows: int, states: Array | None = None,
) -> Marched:
    """Integrate over the time steps `plan` by the midpoint rule; return absolute angles, rates, energies and hysteresis
    states.

    Angles and rates are (rows, n). The energies (rows, 2) [J] are input work and dissipation; with hysteresis there is
    a third, that of hysteresis. The hysteresis states (rows, n, branches) begin with `states`. By default, a model with
    hysteresis begins in equilibrium at the initial angles.
    """
    chain = mechanics_of(model).with_own_base() if len(plan.base) else mechanics_of(model)
    check_lengths(chain, x=start[0], v=start[1], torque=plan.gain)
    if states is None:
        states = state.relaxed(model, chain.joint_coordinates(start[0])) if model.memory else np.zeros((model.n, 0))
    past = chain.past(states.copy())
    out = march_loops.rows_for(rows, model.size, states.shape, 2 + len(past))
    out.phi[0], out.w[0], out.state[0] = *start, states
    now = start[0].copy()
    failed = twin(march_loops.march, *chain.sizes)(now, start[1].copy(), plan.steps, *chain.parts(), out, *past)
    if failed >= 0:
        after, length = float(plan.h[: failed + 1].sum()), float(plan.h[failed])
        raise too_fast(after, length, state.given_way(model, now))
    if failed < -1:
        raise SimulationError(
            f"{plan.h[: -1 - failed].sum():.6g} s after the start the iteration for slip elements does not converge "
            f"within a step of {plan.h[-2 - failed] * 1e3:.3g} ms; use a shorter step"
        )
    return out.phi, out.w, out.energy, out.state
