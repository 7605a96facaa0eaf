"""Exact derivatives of a simulated experiment with respect to its parameters, propagated with the time steps.

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
from pliant.identification.following import moved, moved_slopes
from pliant.identification.forward_model import reattached, set_up
from pliant.identification.loop_inputs import APART, Numbers, SetUp, from_one_row, in_one_row
from pliant.identification.observation_kind import TINY
from pliant.identification.parameters import OF_A_RECORD
from pliant.identification.plans import Plans
from pliant.identification.poses import pose_slopes
from pliant.mechanics import Mechanics, mechanics_of
from pliant.model import Model
from pliant.simulation.drive import Drive

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray
SHARE = 1e-5  # step of the finite differences of the inputs, over the size of the parameter
EDGES = ("start", "stop")
MOVE_STEPS = OF_A_RECORD | {"valve_dead_time"}  # parameters that may change the time steps too
STENCILS = (((-1.0, -0.5), (1.0, 0.5)), ((0.0, -1.5), (1.0, 2.0), (2.0, -0.5)), ((0.0, 1.5), (-1.0, -2.0), (-2.0, 0.5)))


class Slope(NamedTuple):
    """Derivative of `Numbers` with respect to one parameter: one vector for all but the `APART` entries, and these.

    An entry of 0 means no change. A torque of None is computed later from the derivatives of `h` and `chambers`.
    """

    row: Any
    h: Any
    torque: Any
    load: Any
    chambers: Any


def sensitivities(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], step: float,
) -> tuple[Array, Array]:
    """Return the observed rows (T, S, 3) of an experiment and their derivatives (P, T, S, 3) by parameters.

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
    here = set_up(model, exp, values, step)
    stations = len(exp.stations)  # axis points of links follow them
    rows, slopes = moved(here, here.numbers, exp.time.size), slopes_of(model, exp, values, sizes, step)
    return rows[:, :stations], slopes[:, :, :stations]


def slopes_of(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], step: float,
    plans: Plans | None = None,
) -> Array:
    """Return the derivatives (P, T, S + 2 m, 3) of `sensitivities`, with those of the m oriented links' axis points."""
    plans = Plans() if plans is None else plans
    rows = exp.time.size
    here = set_up(model, exp, values, step, plans)
    slopes = np.zeros((len(sizes), rows, here.carrier.size, 3))
    q = mechanics_of(here.model).joint_coordinates(here.numbers.phi)
    resting = (q, rest_stiffness(here)) if here.from_rest else None
    alike = shares(exp, values, here)
    found: list[tuple[int, Slope]] = []
    for k, (name, size) in enumerate(sizes.items()):
        owner, dot, own = name.partition(".")
        if (own if dot and owner == exp.name else name) in exp.known:
            continue
        drive = here.drive if name.rpartition(".")[2] not in MOVE_STEPS else None
        key = (name, *alike) if alike and drive else None

        def at(value: float, drive: Drive | None, name: str = name) -> SetUp:
            rest = resting[0] if resting else None
            return set_up(model, exp, {**values, name: value}, step, plans, rest, drive)

        base, slope = here, plans.slopes.get(key) or edge_slope(here, exp, values, name)
        if slope is None:
            base, slope = input_slopes(at, here, values[name], SHARE * max(abs(values[name]), size), drive)
            if resting and np.any(slope.row):
                slope = at_rest(base, slope, resting[1] if base is here else rest_stiffness(base))
            if key and slope.torque is None:
                plans.slopes[key] = slope
        if base is here:
            found.append((k, slope))
        else:
            slopes[k] = carried(base, [slope], rows)[0]
    found = [(k, slope) for k, slope in with_torques(here, found) if any(np.any(v) for v in slope)]
    if found:
        slopes[[k for k, _ in found]] = carried(here, [slope for _, slope in found], rows)
    return slopes


def shares(exp: Experiment, values: Mapping[str, float], here: SetUp) -> tuple[Any, ...]:
    """Return the cache key of recordings with equal derivatives, torques excluded; () if none can be shared."""
    own = {n.rpartition(".")[2] for n in values if n.startswith(f"{exp.name}.")}
    if not here.from_rest or exp.forces or exp.own_places or exp.known or own - {"start", "stop"}:
        return ()
    same = (here.numbers.torque_before, here.numbers.phi, here.numbers.chambers)
    return (exp.stations, exp.angle_reference, exp.oriented.tobytes(), *(a.tobytes() for a in same))


def with_torques(made: SetUp, slopes: Sequence[tuple[int, Slope]]) -> list[tuple[int, Slope]]:
    """Return the numbered slopes with the missing derivatives of the torques, from those of steps and chambers."""
    done = {k: s if s.torque is not None else s._replace(torque=0.0, chambers=0.0) for k, s in slopes}
    left = [(k, s) for k, s in slopes if s.torque is None and (np.any(s.chambers) or np.any(s.h))]
    if not (left and made.drive and made.drive.layout):
        return list(done.items())
    from pliant.compiler.duals import WIDTH  # loads the compiler

    for some in (left[first : first + WIDTH] for first in range(0, len(left), WIDTH)):
        rows = beside(made.numbers.chambers, [s.chambers for _, s in some])
        h = beside(made.numbers.h, [s.h for _, s in some])
        rates = made.drive.layout.torque_slopes(made.model.chambers, rows, h)
        for j, (k, _) in enumerate(some):
            done[k] = done[k]._replace(torque=rates[..., j])
    return list(done.items())


def edge_slope(made: SetUp, exp: Experiment, values: Mapping[str, float], name: str) -> Slope | None:
    """Return the derivative by an edge time of a nominal pressure; None for other parameters or at a step edge."""
    kind, laid = name.removeprefix(f"{exp.name}."), made.drive.layout if made.drive else None
    if laid is None or kind not in EDGES or (name == kind and f"{exp.name}.{kind}" in values):
        return None
    moved = exp.pressure is not None or made.model.actuation.count > 1 or exp.forces  # more than these steps
    if moved or (laid.jumps[0].size > 1 and np.ptp(laid.jumps[0]) < 2.0 * SHORTEST):  # edges this close interact
        return None
    h = laid.jump_slope(0, EDGES.index(kind))
    return None if h is None else Slope(np.zeros(in_one_row(made.numbers).size), h, None, 0.0, 0.0)


def carried(made: SetUp, slopes: Sequence[Slope], rows: int) -> Array:
    """Return the derivatives (P, T, S, 3) of the observed rows, given those of the forward problem's inputs."""
    if made.poses:
        return pose_slopes(made, [tilted_by(made, slope) for slope in slopes])
    from pliant.compiler.duals import WIDTH  # loads the compiler

    blocks = [slopes[first : first + WIDTH] for first in range(0, len(slopes), WIDTH)]
    return np.concatenate([carried_together(made, some, rows) for some in blocks])


def carried_together(made: SetUp, slopes: Sequence[Slope], rows: int) -> Array:
    """Return the result of `carried` for as many slopes as one run of the compiled loop can hold."""
    from pliant.compiler.duals import duals

    numbers = made.numbers
    row = duals(in_one_row(numbers), np.stack([s.row for s in slopes], axis=-1))
    bent: dict[str, Any] = {name: beside(getattr(numbers, name), [getattr(s, name) for s in slopes]) for name in APART}
    return moved_slopes(made, from_one_row(row, numbers)._replace(**bent), rows, len(slopes))


def tilted_by(made: SetUp, slope: Slope) -> Numbers:
    """Return the inputs of settled poses as complex numbers with `TINY` times their derivative as imaginary parts."""
    numbers = made.numbers
    row = in_one_row(numbers) + 1j * TINY * slope.row
    return from_one_row(row, numbers)._replace(torque=numbers.torque + 1j * TINY * slope.torque)


def beside(value: Array, rates: Sequence[Any]) -> Array:
    """Return a dual array with the given value (...) and derivatives (...), any of which may be the number 0."""
    from pliant.compiler.duals import WIDTH, duals  # loads the compiler

    made = duals(value)
    for k, rate in enumerate(rates):
        if np.ndim(rate):
            made[..., WIDTH + k] = rate
    return made


def input_slopes(
    at: Callable[[float, Drive | None], SetUp], here: SetUp, value: float, size: float, drive: Drive | None,
) -> tuple[SetUp, Slope]:
    """Return a forward problem and the finite-difference derivative of its numbers, by one parameter at `value`.

    The derivative is taken close beside `value` if the time steps change exactly there. With a `drive`, the derivative
    of the torques is left to that of the chambers where possible.
    """
    if drive and (made := tried(at, value, size, STENCILS[0], drive)):
        return here, combined(made, STENCILS[0], size)._replace(torque=None)
    for stencil in STENCILS:
        made = tried(at, value, size, stencil)
        if made and all(same_steps(here, m) for m in made):
            return here, combined(made, stencil, size)._replace(chambers=0.0)
    for side, stencil in zip((1.0, -1.0), STENCILS[1:], strict=True):  # an edge on a frame: differentiate beside it
        made = tried(at, value + side * size, size, stencil)
        if made and all(same_steps(made[0], m) for m in made):
            return made[0], combined(made, stencil, size)._replace(chambers=0.0)
    raise FitError(f"no derivative exists at the value {value:.6g}: move the start value or its bounds")


def tried(
    at: Callable[[float, Drive | None], SetUp], value: float, size: float, stencil: Any, drive: Drive | None = None,
) -> list[SetUp] | None:
    """Return the forward problems at the points of a finite-difference stencil; None if one cannot be set up."""
    try:
        return [at(value + offset * size, drive) for offset, _ in stencil]
    except PliantError:
        return None


def same_steps(a: SetUp, b: SetUp) -> bool:
    """Return whether two forward problems have the same time steps and output rows."""
    return a.still == b.still and np.array_equal(a.keep, b.keep)


def combined(made: list[SetUp], stencil: Any, size: float) -> Slope:
    """Return the finite difference of the inputs of some forward problems, with the weights of a stencil."""
    weights = [weight / size for _, weight in stencil]

    def mix(*entries: Array) -> Any:
        if all(e is entries[0] for e in entries):  # as set-ups that share their steps do
            return 0.0
        return sum(w * e for w, e in zip(weights, entries, strict=True))

    numbers = [m.numbers for m in made]
    return Slope(mix(*map(in_one_row, numbers)), *(mix(*(getattr(m, name) for m in numbers)) for name in APART))


def rest_stiffness(made: SetUp) -> Array:
    """Return the derivative (N, N) of the generalised forces at equilibrium by the coordinates, negative definite."""
    numbers = made.numbers
    return at_rest_of(made, numbers).static_slope(numbers.phi, numbers.load_before, numbers.torque_before)


def at_rest(made: SetUp, slope: Slope, stiffness: Array) -> Slope:
    """Return the slope with the derivative of the equilibrium added, and of everything that follows from it.

    `slope` was taken at constant equilibrium; `stiffness` is the `rest_stiffness` of the forward problem.
    """
    turned = equilibrium_slope(made, slope, stiffness)
    tilted = from_one_row(in_one_row(made.numbers) + 1j * TINY * slope.row, made.numbers)
    phi = made.numbers.phi + 1j * TINY * turned
    row = in_one_row(reattached(made, tilted._replace(held=phi, phi=phi)))
    return slope._replace(row=row.imag / TINY)


def equilibrium_slope(made: SetUp, slope: Slope, stiffness: Array) -> Array:
    """Return the derivative (N,) of the equilibrium coordinates, by the implicit function theorem.

    `slope` is the derivative of the numbers of the forward problem, `stiffness` its `rest_stiffness`.
    """
    tilted = from_one_row(in_one_row(made.numbers) + 1j * TINY * slope.row, made.numbers)
    chain, x = at_rest_of(made, tilted), made.numbers.phi
    push = chain.static_forces(x, tilted.torque_before) + chain.load_forces(x, tilted.load_before)
    return -np.linalg.solve(stiffness, push.imag / TINY)


def at_rest_of(made: SetUp, numbers: Numbers) -> Mechanics:
    """Return the mechanics of a forward problem with the constants of `numbers`, which may be complex."""
    return mechanics_of(made.model).with_constants(numbers.body, numbers.joints)
