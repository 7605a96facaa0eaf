"""Exact derivatives of a simulated experiment with respect to its parameters, propagated with the steps.

The inputs of the compiled loop are closed forms of the parameters; their derivatives come from central differences,
good to ten digits, since they are smooth and cheap. They are carried through the steps as dual numbers, several beside
one motion, so no difference is taken of two motions and no equation is written twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import motion
from pliant.equations.symbols import Body, ExtensibleBody, Slopes
from pliant.errors import FitError, PliantError
from pliant.identification.following import TINY, moved, moved_slopes
from pliant.identification.forward_model import drive_of, set_up
from pliant.identification.loop_inputs import LONG, Numbers, SetUp, from_one_row, in_one_row
from pliant.identification.parameters import OF_A_RECORD
from pliant.identification.plans import Plans
from pliant.model import Model
from pliant.simulation import lengthened, state
from pliant.simulation.forces import joint_loads

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray
SHARE = 1e-5  # step of the differences of the inputs, in sizes of the parameter
STENCILS = (((-1.0, -0.5), (1.0, 0.5)), ((0.0, -1.5), (1.0, 2.0), (2.0, -0.5)), ((0.0, 1.5), (-1.0, -2.0), (-2.0, 0.5)))


class Slope(NamedTuple):
    """Derivative of `Numbers`: of all but the long ones in one row, and of these; 0 where they do not change."""

    row: Any
    h: Any
    torque: Any
    load: Any


def sensitivities(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], step: float,
) -> tuple[Array, Array]:
    """Observed rows (T, S, 3) of an experiment and their derivatives (P, T, S, 3), one for each name in `sizes`.

    Parameters
    ----------
    values : mapping
        All parameters by name, SI.
    sizes : mapping
        Those to differentiate by, with their typical sizes, SI.

    Returns
    -------
    rows, derivatives : arrays
        x [m], y [m] and angle [rad]; derivatives per SI unit of the parameter.

    Raises
    ------
    SimulationError
        When the parameters cannot be simulated.
    FitError
        When a derivative exists on neither side of a value.
    """
    here = set_up(model, exp, values, step)
    return moved(here, here.numbers, exp.time.size), slopes_of(model, exp, values, sizes, step)


def slopes_of(
    model: Model, exp: Experiment, values: Mapping[str, float], sizes: Mapping[str, float], step: float,
    plans: Plans | None = None,
) -> Array:
    """The derivatives of `sensitivities` alone."""
    plans = Plans() if plans is None else plans
    rows = exp.time.size
    here = set_up(model, exp, values, step, plans)
    slopes = np.zeros((len(sizes), rows, len(exp.stations), 3))
    rest = state.relative(here.model, here.numbers.phi) if here.from_rest else None
    stiffness = rest_stiffness(here) if here.from_rest else None
    beside: list[tuple[int, Slope]] = []
    alike = shares(exp, values, here)
    for k, (name, size) in enumerate(sizes.items()):
        owner, dot, own = name.partition(".")
        if (own if dot and owner == exp.name else name) in exp.known:
            continue

        def at(value: float, name: str = name) -> SetUp:
            return set_up(model, exp, {**values, name: value}, step, plans, rest)

        away = SHARE * max(abs(values[name]), size)
        key = (name, *alike) if alike and own not in OF_A_RECORD else None
        base, slope = here, shared_slope(model, exp, values, (name, away), step, plans, key)
        if slope is None:
            base, slope = input_slopes(at, here, values[name], away)
            if stiffness is not None and any(np.any(v) for v in slope):
                turned = equilibrium_slope(base, slope, stiffness if base is here else rest_stiffness(base))
                slope.row[: 2 * turned.size] = np.tile(turned, 2)  # held and phi, the first of all numbers
            if base is here and key:
                plans.rows[key] = slope.row
        if not any(np.any(v) for v in slope):
            continue
        if base is here:
            beside.append((k, slope))
        else:
            slopes[k] = carried(base, [slope], rows)[0]
    if beside:
        slopes[[k for k, _ in beside]] = carried(here, [slope for _, slope in beside], rows)
    return slopes


def shares(exp: Experiment, values: Mapping[str, float], here: SetUp) -> tuple[Any, ...]:
    """What recordings have alike whose numbers, but the long ones, have the same derivatives; empty for one alone."""
    own = {n.rpartition(".")[2] for n in values if n.startswith(f"{exp.name}.")}
    if not here.from_rest or exp.forces or exp.own_places or exp.known or own - {"start", "stop"}:
        return ()
    return (exp.stations, exp.angle_reference, here.numbers.torque_before.tobytes(), here.numbers.phi.tobytes())


def shared_slope(
    model: Model, exp: Experiment, values: Mapping[str, float], by: tuple[str, float], step: float, plans: Plans,
    key: tuple[Any, ...] | None,
) -> Slope | None:
    """The derivative by a parameter, `by` its name with a step, where a recording alike (`shares`) has found it before.

    Only the torques over the steps are this recording's own. None where there is none yet, or the steps change.
    """
    if key is None or key not in plans.rows:
        return None
    name, away = by
    try:
        made = [drive_of(model, exp, {**values, name: values[name] + side}, step, plans) for side in (-away, away)]
    except PliantError:
        return None
    if made[0].h is not made[1].h:
        return None
    low, high = (m.torque for m in made)
    rate = 0.0 if low is high else -0.5 / away * low + 0.5 / away * high
    return Slope(plans.rows[key].copy(), 0.0, rate, 0.0)


def carried(made: SetUp, slopes: Sequence[Slope], rows: int) -> Array:
    """Derivatives (P, T, S, 3) of the observed rows from those of the numbers of a set-up, some beside each motion."""
    from pliant.compiler.duals import WIDTH  # loads the compiler

    blocks = [slopes[first : first + WIDTH] for first in range(0, len(slopes), WIDTH)]
    return np.concatenate([carried_together(made, some, rows) for some in blocks])


def carried_together(made: SetUp, slopes: Sequence[Slope], rows: int) -> Array:
    """As `carried`, of no more than one motion carries."""
    from pliant.compiler.duals import duals

    numbers = made.numbers
    row = duals(in_one_row(numbers), np.stack([s.row for s in slopes], axis=-1))
    bent: dict[str, Any] = {}
    for name in LONG:
        value = getattr(numbers, name)
        own = [getattr(s, name) for s in slopes]
        rates = np.stack([np.broadcast_to(v, value.shape) for v in own], axis=-1) if any(map(np.ndim, own)) else 0.0
        bent[name] = duals(value, rates)
    return moved_slopes(made, from_one_row(row, numbers)._replace(**bent), rows, len(slopes))


def input_slopes(at: Callable[[float], SetUp], here: SetUp, value: float, size: float) -> tuple[SetUp, Slope]:
    """A set-up and the derivative of its numbers: at `value`, or where the steps change there, close beside it."""
    for stencil in STENCILS:
        made = tried(at, value, size, stencil)
        if made and all(same_steps(here, m) for m in made):
            return here, combined(made, stencil, size)
    for side, stencil in zip((1.0, -1.0), STENCILS[1:], strict=True):  # an edge exactly on a frame: look beside it
        made = tried(at, value + side * size, size, stencil)
        if made and all(same_steps(made[0], m) for m in made):
            return made[0], combined(made, stencil, size)
    raise FitError(f"no derivative exists at the value {value:.6g}: move the start value or its bounds")


def tried(at: Callable[[float], SetUp], value: float, size: float, stencil: Any) -> list[SetUp] | None:
    """The set-ups of a stencil; None where one of them is not possible."""
    try:
        return [at(value + offset * size) for offset, _ in stencil]
    except PliantError:
        return None


def same_steps(a: SetUp, b: SetUp) -> bool:
    """Whether two set-ups take the same steps and show the same rows."""
    return a.still == b.still and np.array_equal(a.keep, b.keep)


def combined(made: list[SetUp], stencil: Any, size: float) -> Slope:
    """The weighted sum of the numbers of some set-ups, over `size`."""
    weights = [weight / size for _, weight in stencil]

    def mix(*entries: Array) -> Any:
        if all(e is entries[0] for e in entries):  # as set-ups that share their steps do
            return 0.0
        return sum(w * e for w, e in zip(weights, entries, strict=True))

    numbers = [m.numbers for m in made]
    return Slope(mix(*map(in_one_row, numbers)), *(mix(*(getattr(m, name) for m in numbers)) for name in LONG))


def rest_stiffness(made: SetUp) -> Array:
    """How fast what pulls at the angles at rest (and strains) grows with each of them, row by variable, negative."""
    numbers = made.numbers
    x = numbers.phi
    if isinstance(numbers.body, ExtensibleBody):
        around = x + 1j * TINY * np.eye(x.size)
        return np.stack([push_at_rest(at, numbers) for at in around], axis=1).imag / TINY
    n = len(x)
    out = Slopes(np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))
    loaded = bool(np.any(numbers.load_before))
    real = beside_loads(numbers, x) if loaded else numbers
    twin(motion.acceleration_jacobian)(
        x, np.zeros(n), real.torque_before, real.body, real.joints, state.workspace(n), out
    )
    if loaded:
        out.a_phi[:] += load_stiffness(numbers)
    return out.a_phi.T


def equilibrium_slope(made: SetUp, slope: Slope, stiffness: Array) -> Array:
    """Derivative (n,) of the absolute angles at rest: those at which the acceleration (or what pulls) stays zero.

    `slope` is that of the numbers of a set-up, `stiffness` its `rest_stiffness`.
    """
    x = made.numbers.phi
    tilted = from_one_row(in_one_row(made.numbers) + 1j * TINY * slope.row, made.numbers)
    if isinstance(tilted.body, ExtensibleBody):
        push = push_at_rest(x, tilted)
        return -np.linalg.solve(stiffness, push.imag / TINY)
    if np.any(tilted.load_before):
        tilted = beside_loads(tilted, x)
    push = np.zeros(x.size, dtype=complex)
    twin(motion.acceleration)(
        x.astype(complex), np.zeros(x.size, dtype=complex), tilted.torque_before, tilted.body, tilted.joints,
        state.workspace(x.size, complex), push,
    )
    return -np.linalg.solve(stiffness, push.imag / TINY)


def push_at_rest(x: Array, numbers: Numbers) -> Array:
    """What drive, springs, weight and loads do to angles and strains x (n + S,) of a body at rest, N m."""
    body = ExtensibleBody(*numbers.body)
    push = lengthened.forces_at_rest(x, numbers.torque_before, body, numbers.joints)
    return push + lengthened.pull_of(x, numbers.load_before, body.share, numbers.joints.base_angle)


def beside_loads(numbers: Numbers, phi: Array) -> Numbers:
    """The numbers with the torques of the loads at rest beside those of the pressure."""
    return numbers._replace(torque_before=numbers.torque_before + joint_loads(phi, numbers.load_before))


def load_stiffness(numbers: Numbers) -> Array:
    """What the loads at rest add to the Jacobian (n, n) of the acceleration, row by variable."""
    phi, load, body = numbers.phi, numbers.load_before, Body(*numbers.body)
    M = body.B * np.cos(phi[:, None] - phi) + np.diag(body.I)
    return np.linalg.solve(M, np.diag(load[:, 0] * np.sin(phi) - load[:, 1] * np.cos(phi))).T

