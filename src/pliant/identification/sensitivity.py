"""Exact derivatives of a simulated experiment with respect to its fitted parameters, computed along with the motion.

The constants of body, chambers and observed points are closed forms of the parameters. Their derivatives come from
central differences, good to ten digits, since these functions are smooth and cheap. They are carried through valves,
chambers and time steps as dual numbers, several at a time. No difference of two motions is taken, and no equation is
written twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import FitError, PliantError
from pliant.identification.drives import SHORTEST
from pliant.identification.edges import EDGES
from pliant.identification.following import observed_rows, observed_slopes
from pliant.identification.forward_model import forward_problem, reattached
from pliant.identification.loop_inputs import APART, ForwardProblem, Numbers, from_one_row, in_one_row
from pliant.identification.observation import TINY
from pliant.identification.parameters import OF_A_RECORD
from pliant.identification.plans import Plans
from pliant.identification.poses import pose_slopes
from pliant.mechanics import Mechanics, mechanics_of
from pliant.model import Model
from pliant.parallel import side_by_side
from pliant.simulation.drive import Drive

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray
SHARE = 1e-5  # step of the finite differences of the inputs, over the size of the parameter
MOVE_STEPS = OF_A_RECORD | {"valve_dead_time"}  # parameters that may change the time steps too
STENCILS = (((-1.0, -0.5), (1.0, 0.5)), ((0.0, -1.5), (1.0, 2.0), (2.0, -0.5)), ((0.0, 1.5), (-1.0, -2.0), (-2.0, 0.5)))


ProblemAt = Callable[[float, Drive | None], ForwardProblem]


class Slope(NamedTuple):
    """Derivative of all inputs of a simulation (`Numbers`) with respect to one parameter. The derivatives of the
    entries `APART` have fields of their own; `row` holds all others.

    An entry of 0 means no change. A torque of None is computed later from the derivatives of `h` and `chambers`.
    """

    row: Any
    h: Any
    torque: Any
    load: Any
    chambers: Any
    base: Any = 0.0


def sensitivities(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], time_step: float,
) -> tuple[Array, Array]:
    """Return the positions and angles (T, S or more, 3) of S stations in T frames of a simulated experiment, and of
    auxiliary points behind them, with their derivatives (P, T, S or more, 3) with respect to P parameters.

    Parameters
    ----------
    values : mapping
        All parameters by name, SI.
    sizes : mapping
        Names of the parameters by which to differentiate, with their typical sizes, SI.

    Returns
    -------
    rows, derivatives : arrays
        x [m], y [m] and angle [rad]; derivatives per SI unit of the parameter.

    Raises
    ------
    SimulationError
        When the parameters cannot be simulated.
    FitError
        When no derivative exists on either side of a value.
    """
    forward = forward_problem(model, exp, values, time_step)
    rows = observed_rows(forward, forward.numbers, exp.time.size)
    slopes = slopes_of(model, exp, values, sizes, time_step)
    return rows, slopes


def slopes_of(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], time_step: float,
    plans: Plans | None = None,
) -> Array:
    """Return the derivatives (P, T, S + 2 m, 3), with respect to P parameters, of the positions and angles of observed
    points in T frames: S stations, and two auxiliary points on axes of each of the m links whose orientation is
    observed.
    """
    plans = Plans() if plans is None else plans
    rows = exp.time.size
    forward = forward_problem(model, exp, values, time_step, plans)
    slopes = np.zeros((len(sizes), rows, forward.carrier.size, 3))
    q = mechanics_of(forward.model).joint_coordinates(forward.numbers.phi)
    resting = (q, rest_stiffness(forward)) if forward.from_rest else None
    shared = shared_key(exp, values, forward)
    slopes_at_base: list[tuple[int, Slope]] = []
    for k, (name, size) in enumerate(sizes.items()):
        owner, dot, parameter = name.partition(".")
        if (parameter if dot and owner == exp.name else name) in exp.known:
            continue
        drive = forward.drive if name.rpartition(".")[2] not in MOVE_STEPS else None
        key = (name, *shared) if shared and (drive or forward.poses) else None

        def problem_at(value: float, drive: Drive | None, name: str = name) -> ForwardProblem:
            rest = resting[0] if resting else None
            return forward_problem(model, exp, {**values, name: value}, time_step, plans, rest, drive)

        base, slope = forward, plans.slopes.get(key) or edge_slope(forward, exp, values, name)
        if slope is None:
            change = SHARE * max(abs(values[name]), size)
            base, slope = input_slopes(name, problem_at, forward, values[name], change, drive)
            if resting and np.any(slope.row):
                slope = with_equilibrium_slope(base, slope, resting[1] if base is forward else rest_stiffness(base))
            if key and (slope.torque is None or np.ndim(slope.torque) == 0):
                plans.slopes[key] = slope
        if base is forward:
            slopes_at_base.append((k, slope))
        else:
            slopes[k] = propagated(base, [slope], rows)[0]
    slopes_at_base = [(k, slope) for k, slope in with_torques(forward, slopes_at_base) if any(np.any(v) for v in slope)]
    if slopes_at_base:
        slopes[[k for k, _ in slopes_at_base]] = propagated(forward, [slope for _, slope in slopes_at_base], rows)
    return slopes


def shared_key(exp: Experiment, values: Mapping[str, float], forward: ForwardProblem) -> tuple[Any, ...]:
    """Return a cache key for the derivatives of a simulation's inputs, those of torques excluded. Recordings with equal
    keys share these derivatives; () means that they are not shared.
    """
    of_record = {n.rpartition(".")[2] for n in values if n.startswith(f"{exp.name}.")}
    begins_alike = forward.from_rest or forward.poses
    if not begins_alike or exp.forces or exp.base or exp.own_places or exp.known or of_record - {*EDGES}:
        return ()
    same = (forward.numbers.torque_before, forward.numbers.phi, forward.numbers.chambers)
    return (exp.stations, exp.angle_reference, exp.framed.tobytes(), *(a.tobytes() for a in same))


def with_torques(forward: ForwardProblem, slopes: Sequence[tuple[int, Slope]]) -> list[tuple[int, Slope]]:
    """Return the derivatives `slopes` of a simulation's inputs. Missing derivatives of the torques are computed from
    those of the time steps and chambers.
    """
    done = {k: s if s.torque is not None else s._replace(torque=0.0, chambers=0.0) for k, s in slopes}
    left = [(k, s) for k, s in slopes if s.torque is None and (np.any(s.chambers) or np.any(s.h))]
    if not (left and forward.drive and forward.drive.layout):
        return list(done.items())
    from pliant.compiler.duals import WIDTH  # loads the compiler

    for some in (left[first : first + WIDTH] for first in range(0, len(left), WIDTH)):
        rows = dual_array(forward.numbers.chambers, [s.chambers for _, s in some])
        h = dual_array(forward.numbers.h, [s.h for _, s in some])
        rates = forward.drive.layout.torque_slopes(forward.model.chambers, rows, h)
        for j, (k, _) in enumerate(some):
            done[k] = done[k]._replace(torque=rates[..., j])
    return list(done.items())


def edge_slope(forward: ForwardProblem, exp: Experiment, values: Mapping[str, float], name: str) -> Slope | None:
    """Return the derivative of a simulation's inputs with respect to an edge time of a nominal pressure. Return None
    for any other parameter, or if the derivative does not exist at this time.
    """
    kind, layout = name.removeprefix(f"{exp.name}."), forward.drive.layout if forward.drive else None
    if layout is None or kind not in EDGES or (name == kind and f"{exp.name}.{kind}" in values):
        return None
    moved = exp.pressure or forward.model.actuation.count > 1 or exp.forces or exp.base  # more than these steps
    if moved or (layout.jumps[0].size > 1 and np.ptp(layout.jumps[0]) < 2.0 * SHORTEST):  # edges this close interact
        return None
    h = layout.jump_slope(0, EDGES.index(kind))
    return None if h is None else Slope(np.zeros(in_one_row(forward.numbers).size), h, None, 0.0, 0.0)


def propagated(forward: ForwardProblem, slopes: Sequence[Slope], rows: int) -> Array:
    """Return the derivatives (P, T, S, 3) of the positions and angles of S observed points in T frames with respect to
    P parameters, from those of the simulation's inputs.
    """
    if forward.poses:
        return pose_slopes(forward, [with_imaginary_slope(forward, slope) for slope in slopes])
    from pliant.compiler.duals import WIDTH  # loads the compiler

    blocks = [slopes[first : first + WIDTH] for first in range(0, len(slopes), WIDTH)]
    return np.concatenate(side_by_side(lambda some: propagated_together(forward, some, rows), blocks))


def propagated_together(forward: ForwardProblem, slopes: Sequence[Slope], rows: int) -> Array:
    """Return the derivatives (P, T, S, 3) of the positions and angles of S observed points in T frames with respect to
    P parameters, from one run with dual numbers. P is at most `WIDTH`, the number of derivatives in a dual number.
    """
    from pliant.compiler.duals import duals

    numbers = forward.numbers
    row = duals(in_one_row(numbers), np.stack([s.row for s in slopes], axis=-1))
    apart: dict[str, Any] = {n: dual_array(getattr(numbers, n), [getattr(s, n) for s in slopes]) for n in APART}
    return observed_slopes(forward, from_one_row(row, numbers)._replace(**apart), rows, len(slopes))


def with_imaginary_slope(forward: ForwardProblem, slope: Slope) -> Numbers:
    """Return the inputs of settled poses as complex numbers, for a complex-step derivative. The imaginary part is
    `TINY` times `slope`, the derivative of the inputs with respect to one parameter.
    """
    numbers = forward.numbers
    row = in_one_row(numbers) + 1j * TINY * slope.row
    return from_one_row(row, numbers)._replace(torque=numbers.torque + 1j * TINY * slope.torque)


def dual_array(value: Array, rates: Sequence[Any]) -> Array:
    """Return an array of dual numbers from an array of values and a list of their derivatives. Each derivative is an
    array of the same shape, or 0.
    """
    from pliant.compiler.duals import WIDTH, duals  # loads the compiler

    array = duals(value)
    for k, rate in enumerate(rates):
        if np.ndim(rate):
            array[..., WIDTH + k] = rate
    return array


def input_slopes(
    name: str, problem_at: ProblemAt, forward: ForwardProblem, value: float, size: float, drive: Drive | None,
) -> tuple[ForwardProblem, Slope]:
    """Return a simulation's inputs at `value` of the parameter `name`, and their derivative with respect to this
    parameter from finite differences.

    The derivative is taken close beside `value` if the time steps change exactly there. With a `drive`, the derivative
    of the torques is left to that of the chambers where possible.
    """
    if drive and (problems := stencil_problems(problem_at, value, size, STENCILS[0], drive)):
        return forward, finite_difference(problems, STENCILS[0], size)._replace(torque=None)
    for stencil in STENCILS:
        problems = stencil_problems(problem_at, value, size, stencil)
        if problems and all(same_steps(forward, m) for m in problems):
            return forward, finite_difference(problems, stencil, size)._replace(chambers=0.0)
    for side, stencil in zip((1.0, -1.0), STENCILS[1:], strict=True):  # an edge on a frame: differentiate beside it
        problems = stencil_problems(problem_at, value + side * size, size, stencil)
        if problems and all(same_steps(problems[0], m) for m in problems):
            return problems[0], finite_difference(problems, stencil, size)._replace(chambers=0.0)
    raise FitError(f"parameter {name}: the motion has no derivative with respect to it at its value {value:.6g}: "
                   "change its start value, or its bounds")  # fmt: skip


def stencil_problems(
    problem_at: ProblemAt, value: float, size: float, stencil: Any, drive: Drive | None = None,
) -> list[ForwardProblem] | None:
    """Return the simulation inputs at each point of a finite-difference stencil; None if one point is invalid."""
    try:
        return [problem_at(value + offset * size, drive) for offset, _ in stencil]
    except PliantError:
        return None


def same_steps(a: ForwardProblem, b: ForwardProblem) -> bool:
    """Return whether two simulations of an experiment have the same output row for every time step."""
    return a.still == b.still and np.array_equal(a.keep, b.keep)


def finite_difference(problems: list[ForwardProblem], stencil: Any, size: float) -> Slope:
    """Return the derivative of a simulation's inputs with respect to one parameter, as a weighted sum of the inputs at
    the points of a finite-difference stencil. It is exactly 0 for inputs that do not change.
    """
    weights = [weight / size for _, weight in stencil]

    def mix(first: Array, *others: Array) -> Any:
        if all(e is first for e in others):  # as set-ups that share their steps do
            return 0.0
        return sum(w * (e - first) for w, e in zip(weights[1:], others, strict=True))

    numbers = [m.numbers for m in problems]
    return Slope(mix(*map(in_one_row, numbers)), *(mix(*(getattr(m, name) for m in numbers)) for name in APART))


def rest_stiffness(forward: ForwardProblem) -> Array:
    """Return the derivative (N, N) of the N generalised forces by the N coordinates at equilibrium. It is negative
    definite.
    """
    numbers = forward.numbers
    return mechanics_at(forward, numbers).static_slope(numbers.phi, numbers.load_before, numbers.torque_before)


def with_equilibrium_slope(forward: ForwardProblem, slope: Slope, stiffness: Array) -> Slope:
    """Return the derivative of a simulation's inputs with respect to a parameter that also changes the initial
    equilibrium shape. `slope` is the derivative at constant shape.

    `stiffness` is the `rest_stiffness` of the forward problem.
    """
    if forward.first_seen is None and not acts_at_rest(forward, slope):
        return slope
    turned = equilibrium_slope(forward, slope, stiffness)
    if forward.first_seen is None:
        rates = from_one_row(slope.row, forward.numbers)._replace(held=turned, phi=turned)
        return slope._replace(row=in_one_row(rates))
    tilted = from_one_row(in_one_row(forward.numbers) + 1j * TINY * slope.row, forward.numbers)
    phi = forward.numbers.phi + 1j * TINY * turned
    row = in_one_row(reattached(forward, tilted._replace(held=phi, phi=phi)))
    return slope._replace(row=row.imag / TINY)


def acts_at_rest(forward: ForwardProblem, slope: Slope) -> bool:
    """Return whether a parameter changes any entry of a simulation's inputs on which the equilibrium shape depends."""
    rates = from_one_row(slope.row, forward.numbers)
    return any(np.any(rate) for rate in (rates.torque_before, rates.load_before, *rates.body, *rates.joints))


def equilibrium_slope(forward: ForwardProblem, slope: Slope, stiffness: Array) -> Array:
    """Return the derivative (N,) of the N equilibrium coordinates with respect to a parameter, from the implicit
    function theorem.

    `slope` is the derivative of the numbers of the forward problem, `stiffness` its `rest_stiffness`.
    """
    tilted = from_one_row(in_one_row(forward.numbers) + 1j * TINY * slope.row, forward.numbers)
    chain, x = mechanics_at(forward, tilted), forward.numbers.phi
    push = chain.static_forces(x, tilted.torque_before) + chain.load_forces(x, tilted.load_before)
    return -np.linalg.solve(stiffness, push.imag / TINY)


def mechanics_at(forward: ForwardProblem, numbers: Numbers) -> Mechanics:
    """Return the equations of motion of an experiment's chain with the constants in `numbers`, which may be complex."""
    return mechanics_of(forward.model).with_constants(numbers.body, numbers.joints)
