"""`simulate`: a model and a pressure input in, a labelled trajectory out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pliant.compiler.choose import twin
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import march_loops, memory, state
from pliant.simulation.balance import tell_gain
from pliant.simulation.drive import LONGEST, Drive, drive, inputs_of, too_fast
from pliant.simulation.extrapolated import Marched, march_extrapolated
from pliant.simulation.forces import PointForce, checked, loads_at, mean_loads
from pliant.simulation.inputs import Input
from pliant.simulation.reference import METHODS, Start, solve_reference
from pliant.simulation.result import Motion, by_chamber, trajectory

Array = np.ndarray
STEPS_PER_PERIOD = 8  # of the first mode: below, a step cannot draw the oscillation that it claims to follow


def simulate(
    model: Model,
    pressure: Input | Sequence[Input],
    *,
    duration: float | None = None,
    times: Array | None = None,
    step: float = 1e-3,
    method: str = "midpoint",
    initial_angle: Array | None = None,
    initial_rate: Array | None = None,
    initial_memory: Array | None = None,
    forces: Sequence[PointForce] = (),
    rtol: float = 1e-8,
) -> xr.Dataset:
    """Simulate the chain under a pressure input. Paper: Eq. (5) [eq:eom], solver D14.

    Parameters
    ----------
    model : Model
    pressure : Input, or one for each chamber in their order
        What is commanded, Pa gauge: `Pulse`, `Trace`, `Chirp`, ... or any object with the same three members.
    duration : float
        s from time 0, output every `step`; or give `times`.
    times : array (T,)
        Output times, s, strictly increasing; the first is the start.
    step : float
        Longest step, s. Steps end at every output time and at every jump of the pressure.
    method : {"midpoint", "extrapolated", "LSODA", "BDF", "Radau"}
        The linearly implicit midpoint rule of fixed cost (second order, stable); the same extrapolated to fourth order
        from two marches, where errors below a hundredth of a millimetre count; or a SciPy solver with the compiled
        right-hand side and Jacobian as reference (relative tolerance `rtol`).
    initial_angle, initial_rate : array (n,)
        Joint angles and rates at the start, rad and rad/s; default: at rest under gravity and the
        pressure just before the first time, so that a step at the first time moves the chain. Of a body that lengthens
        (n + S,): the strains of its segments and their rates behind them.
    initial_memory : array (n, memory)
        States of the model's memory at the start, rad, as ``memory_state`` holds them; default: long at rest there,
        creep relaxed, slip elements and Bouc-Wen unstretched.
    forces : sequence of `pliant.simulation.forces.PointForce`
        That pull at points of the body, N in the base frame; their mean over each step acts at the angles half a step
        ahead, and their work is part of the input work. By ``method="midpoint"`` alone.

    Returns
    -------
    xarray.Dataset
        joint_angle, joint_rate (time, joint); tip_position (time, link, axis); station_position (time, station,
        axis), station_angle; pressure; kinetic, elastic and gravitational energy, input work, dissipated energy (time).
        With memory also memory_state (time, joint, memory), memory_torque (time, joint), memory_energy,
        memory_dissipation (time). Where segments lengthen also axial_strain, axial_strain_rate and extension [m]
        (time, segment). Kinetic + elastic + gravitational + memory energy then balance input work less both
        losses. Of a fixed step the attribute energy_gain: the share of energy that came from nothing; beyond 1 % an
        `EnergyWarning` tells it.

    Raises
    ------
    InputError
        When times, step or method are not usable, or the step is too long for the model's first mode.
    SimulationError
        When a value stops being finite, or no rest exists to start from.
    """
    inputs_of(model, pressure)
    check_step(model, step, method)
    times = output_times(duration, times, step)
    forces = [checked("simulate", force) for force in forces]
    plan = pulled(model, drive(model, pressure, times, step), forces, times, method)
    before = loads_before(model, forces, times)
    rest = initial_angle is None
    q0 = state.equilibrium(model, plan.initial, link_load=before) if rest else state.vector(model, initial_angle)
    dq0 = np.zeros(model.size) if initial_rate is None else state.vector(model, initial_rate)
    start = (mechanics_of(model).coordinates(q0), mechanics_of(model).rates(dq0))
    states = memory.first_states(model, q0, initial_memory)
    stretch = None

    def marched(plan: Drive) -> Marched:
        if model.memory:
            return memory.march_with_memory(model, plan, start, states, times.size)
        return *march(model, plan, start, times.size), states

    if method in METHODS:
        phi, w, work, kept, stretch = solve_reference(
            model, pressure, times, Start(*start, plan.initial, states), method, rtol
        )
    elif method == "extrapolated":
        phi, w, work, kept = march_extrapolated(model, pressure, times, step, marched)
    else:
        phi, w, work, kept = marched(plan)
    if lost := state.first_given_way(model, times, phi):
        raise SimulationError(lost)
    told = memory.told(model, phi, kept, work[:, -1])
    if plan.stretch is not None:
        told["hoop_stretch"] = by_chamber(plan.stretch if stretch is None else stretch)
    motion = trajectory(
        model, Motion(times, plan.pressure, phi, w), energies(model, phi, w, work), told, method=method, step=step
    )
    return motion if method in METHODS else tell_gain(motion, step)


def pulled(model: Model, plan: Drive, forces: Sequence[PointForce], times: Array, method: str) -> Drive:
    """The plan with the mean loads of forces on the links; InputError for a method that takes none."""
    if not forces:
        return plan
    if method != "midpoint":
        raise InputError("forces pull at a body by method='midpoint' alone")
    return plan._replace(load=mean_loads(model, forces, times[0] + np.append(0.0, np.cumsum(plan.h))))


def loads_before(model: Model, forces: Sequence[PointForce], times: Array) -> Array | None:
    """Loads (n, 2) of the links before anything happens at the first time, N m; None where no force pulls."""
    return loads_at(model, forces, float(np.nextafter(times[0], -np.inf))) if forces else None


def output_times(duration: float | None, times: Array | None, step: float) -> Array:
    """The output times, from a duration or as given."""
    if (duration is None) == (times is None):
        raise InputError("give either duration (s) or times (s), not both and not neither")
    if times is not None:
        return np.asarray(times, dtype=float)
    if duration is None or not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be a positive time in seconds, got {duration}")
    if duration / step > LONGEST:
        raise InputError(f"{duration:.6g} s in steps of {step:.3g} s are too many steps: use a longer step")
    return np.linspace(0.0, duration, max(2, round(duration / step) + 1))


def check_step(model: Model, step: float, method: str) -> None:
    """Refuse a step that is none, an unknown method, and a fixed step that cannot draw the model's first mode."""
    if not (np.isfinite(step) and step > 0):
        raise InputError(f"the step must be a positive time in seconds, got {step}")
    if method in METHODS:
        return
    if method not in ("midpoint", "extrapolated"):
        raise InputError(f"unknown method {method!r}: use midpoint, extrapolated, {', '.join(METHODS)}")
    first = float(state.modes(model)[0][0])
    longest = 1.0 / (STEPS_PER_PERIOD * first)
    if step > longest:
        raise InputError(
            f"a step of {step * 1e3:.3g} ms is too long: the first mode rings at {first:.3g} Hz and needs at least "
            f"{STEPS_PER_PERIOD} steps a period; use a step of {longest * 1e3:.3g} ms or less"
        )


def march(model: Model, plan: Drive, start: tuple[Array, Array], rows: int) -> tuple[Array, Array, Array]:
    """Absolute angles and rates (rows, n) and input work and loss (rows, 2) by the compiled march.

    A model with memory starts relaxed at these angles.
    """
    if model.memory:
        states = state.relaxed(model, mechanics_of(model).joint_angles(start[0]))
        return memory.march_with_memory(model, plan, start, states, rows)[:3]
    out = march_loops.rows_for(rows, model.size, (model.n, 0), 2)
    out.phi[0], out.w[0] = start
    now = start[0].copy()
    failed = twin(march_loops.march, model.n, len(model.extensions))(
        now, start[1].copy(), plan.steps, *mechanics_of(model).parts(), out
    )
    if failed >= 0:
        raise too_fast(plan, failed, state.given_way(model, now))
    return out.phi, out.w, out.energy


def energies(model: Model, phi: Array, w: Array, work: Array) -> dict[str, Array]:
    """Energies (T,) [J] along a trajectory: kinetic, elastic, gravitational, input work, dissipated."""
    stored = mechanics_of(model).energy(phi, w)
    return {
        "kinetic_energy": np.asarray(stored.kinetic),
        "elastic_energy": np.asarray(stored.elastic),
        "gravitational_energy": np.asarray(stored.gravity),
        "input_work": work[:, 0],
        "dissipated_energy": work[:, 1],
    }
