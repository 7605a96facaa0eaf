"""States of a chain: equilibrium shape, modes of vibration, hysteresis states, and typical pressure."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, product
from typing import Any

import numpy as np

from pliant.compiler.trace import CURVED
from pliant.equations import memory as kernels
from pliant.equations.symbols import MemoryLaw
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of, springs
from pliant.mechanics.lengths import input_length
from pliant.model import Model
from pliant.shapes import Float

Array = np.ndarray

UNSOLVED = 1e80  # size of coordinates after a step of tendons that did not converge, see `equations.tendon.step`
TINY = 1e-20  # imaginary step: its square vanishes beside 1
LET_OUT = 1e30  # N, less of which every tendon is slack
SIDES, MOST_STARTS = 20, 300  # iterations of which tendons of pairs are slack, and starts of them, at most
NO_TENSION = 1e-6  # N, below which a pair that hangs slack holds nothing
SLIGHT, HELD = 1e-5, 1e-4  # weight of small inputs; imbalance of a shape that is held, over its largest force
BENT = 0.5  # rad, sum of the joint angles from rest at the typical pressure
LEAST_BEND = 1e-3  # rad, at the end of the search: less is no bend
RANGES = {"Pa": (1e3, 1e7), "N": (1e-1, 1e3), "m": (1e-4, 1.0), "rad": (1e-2, 1e2)}  # start and end of the search


def relaxed(model: Model, q: Array) -> Array:
    """Return the hysteresis states that are in equilibrium at the N joint coordinates q (N,).

    Creep is relaxed, and the other branches are unstretched.

    They are (n, branches), in space (m, branches) with m joint coordinates.
    """
    memory, rows = model.memory, mechanics_of(model).remembering
    first = model.size - len(model.extensions)  # of the strains
    states = np.zeros((rows, max(len(memory.labels), len(memory.axial.labels)) + (not memory.boucwen_share)))
    for law, part in ((memory, slice(0, min(first, rows))), (memory.axial, slice(first, rows))):
        states[part, : len(law.creep_share)] = q[part, None]
    return states


def relaxed_as_stored(model: Model, q: Array) -> Array:
    """Return the states of `relaxed` as exported code stores them: without entries for a body without hysteresis."""
    rows, columns = mechanics_of(model).memory_shape
    return relaxed(model, q)[:rows, :columns]


def vector(model: Model, value: Any) -> Array:
    """Return `value` as an array of N joint coordinates; raise InputError unless it holds N finite numbers."""
    a = np.asarray(value, dtype=float)
    if a.shape != (model.size,) or not np.isfinite(a).all():
        counted = mechanics_of(model).counted
        raise InputError(f"expected {model.size} finite numbers for {counted}, got {value!r:.80}")
    return a


def equilibrium(
    model: Model, pressure: float | Float[Array, " C"] = 0.0, tip_force: Float[Array, " d"] | None = None,
    link_load: Array | None = None,
) -> Float[Array, " N"]:
    """Return the joint angles (n,) [rad] in equilibrium under constant `pressure` [Pa], gravity and a tip force.

    Paper: Eq. (5) [eq:eom] without motion.

    Parameters
    ----------
    model : Model
    pressure : float, Pa gauge; an array (C,) where there are several chambers
    tip_force : array (2,), (3,) in space
        Force on the last tip in the base frame, N; none by default.
    link_load : array (n, 2)
        Loads of the links by forces at other points, N m; (n + 1, 4) for a body that lengthens. See
        `pliant.simulation.forces.link_loads`.

    Returns
    -------
    array (n,)
        Stable equilibrium, by Newton's method with the exact tangent from the unloaded shape. For a body that lengthens
        (n + S,), with the strains of its segments behind the joint angles.

    Raises
    ------
    SimulationError
        When no stable equilibrium is found, because the chain buckles or the chamber's wall has no equilibrium.
    InputError
        When the pressure or the force is not finite.

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> pliant.equilibrium(chen2018.model(), 50e3).shape  # joint angles, rad
    (5,)
    """
    chain = mechanics_of(model)
    force = np.zeros(chain.dimension) if tip_force is None else np.asarray(tip_force, dtype=float)
    if not (np.isfinite(pressure).all() and np.isfinite(force).all()):
        raise InputError(f"an equilibrium needs finite pressure (Pa) and tip_force (N), got {pressure} and {tip_force}")
    torque = model.actuation.joint_torques(pressure)
    if not np.isfinite(torque).all():
        raise SimulationError(model.actuation.no_rest(pressure))
    return chain.equilibrium(torque, force, link_load)


def given_way(model: Model, phi: Array, least: float = 0.0) -> str:
    """Return a message if the tensions of the tendons were not found or a spring lost its stiffness at the N
    coordinates phi (N,) of the chain; '' if neither failed.

    Tendons fail where their iteration did not converge, a spring where its slope is at most `least` times K.
    """
    if model.actuation.tendons and not (np.abs(phi) < UNSOLVED).all():
        return (
            "the iteration for the tensions of the tendons does not converge within a step: use a shorter step, or a "
            "larger slip_rate where tendons have friction"
        )
    if lost := springs.softened(model, mechanics_of(model).joint_angles(phi), least):
        return lost
    return springs.softened_segment(model, phi[phi.size - len(model.extensions) :], least)


def first_given_way(model: Model, times: Array, phi: Array) -> str:
    """Return a message, with the time, on the first failure of a spring or tendon in a motion; '' if there is none.

    `phi` is (T, n), `times` (T,) [s].
    """
    slopes = springs.springs_of(model).slope(mechanics_of(model).joint_angles(phi))
    gone = (slopes <= 0).any(axis=1)
    if mechanics_of(model).laws & CURVED:
        strain = phi[:, phi.shape[1] - len(model.extensions) :]
        gone = gone | (springs.axial_springs_of(model).slope(strain) <= 0).any(axis=1)
    lost = np.flatnonzero(gone)
    return f"{times[lost[0]] - times[0]:.6g} s after the start {given_way(model, phi[lost[0]])}" if lost.size else ""


def modes(
    model: Model, q: Float[Array, " N"] | None = None, *, pressure: float | Float[Array, " C"] | None = None,
) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
    """Return undamped natural frequencies (n,) [Hz], in ascending order, and damping ratios (n,) of the n modes of
    small vibrations about the shape `q`.

    The default shape is the equilibrium under `pressure`.

    A body that lengthens has n + S modes, including those of its strains.

    The damping ratio is that of the modal diagonal of D, which is exact where D is proportional to K. Hysteresis adds
    its instantaneous stiffness: creep has no time to flow, slip elements stick. A tendon that is slack has no
    stiffness. The friction of tendons is not part of the damping. Paper: Eq. (5) [eq:eom], linearised.

    Parameters
    ----------
    model : Model
    q : (n,) array, rad, optional
        Joint angles of the shape; where segments lengthen, strains follow.
    pressure : float, array (C,) for several inputs, optional
        Values of the inputs [Pa; N, m or rad for tendons]. They decide which tendons are slack; otherwise only the
        default shape depends on them. Default: the smallest values that hold `q` without letting a tendon out, and 0
        without `q`.

    Raises
    ------
    InputError
        When no values of the inputs hold the shape `q` of a body with elastic tendons.
    SimulationError
        When the chain is not stable at this shape, or no equilibrium is found.

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> frequency, damping = pliant.modes(chen2018.model())
    >>> round(float(frequency[0]), 1), round(float(damping[0]), 2)  # Hz
    (5.0, 0.08)
    """
    shape = equilibrium(model, 0.0 if pressure is None else pressure) if q is None else vector(model, q)
    if pressure is None and q is not None:
        torque = holding_inputs(model, shape)
    else:
        torque = model.actuation.joint_torques(0.0 if pressure is None else pressure)
    omega, _, decay = modal(model, *mechanics_of(model).linear_parts(shape, torque))
    return omega / (2 * np.pi), decay / omega


def holding_inputs(model: Model, q: Array) -> Array:
    """Return the smallest static inputs (N + R,) that hold a body with elastic tendons in the shape q (N,), as the
    kernels take them: no single tendon is let out. For a body without such tendons the result is 0, since its stiffness
    does not depend on the inputs.

    The forces are linear in the tension of each single tendon, in the torque of each chamber, and, while the same
    tendons stay slack, in the difference of both tensions of a pair: bounded least squares with a slight preference for
    the values without inputs. Which tendons of pairs are slack matters only where the sum of both tensions of a pair
    acts, on chords between guides and on segments that lengthen. It follows by iteration, from other starts if needed.

    Raises
    ------
    InputError
        When no inputs hold the shape.
    """
    chain, actuation = mechanics_of(model), model.actuation
    stiffness, pretension, *_ = actuation.tendon_constants
    if not stiffness.any():
        return np.zeros(input_length(chain))
    x = chain.coordinates(q)
    let_out = np.append(np.zeros(model.size), np.full(stiffness.size, -LET_OUT))
    slack = chain.static_forces(x, let_out)
    largest = max(np.abs(slack).max(), np.abs(chain.static_forces(0.0 * x, let_out)).max())
    levers = actuation.levers + 2.0 * chain.body.chord * x
    still = pretension - stiffness * ((levers - chain.body.chord * x) @ x)  # signed forces without inputs
    cords = [np.flatnonzero(row[model.size :]) for row in actuation.columns]
    for net in net_tensions(actuation.columns[:, : model.size], slack, levers, [still[c] for c in cords], cords):
        values = [commanded(force, still[cord]) for force, cord in zip(net, cords, strict=True)]
        torque = np.asarray(values @ actuation.columns)
        if np.abs(chain.static_forces(x, torque)).max() <= HELD * largest:
            return torque
    raise InputError(
        f"no values of the inputs of {model.name!r} ({actuation.listing}) were found that hold this shape, so that "
        "it is unknown which tendons are slack: give the values as `pressure`"
    )


def net_tensions(
    torques: Array, slack: Array, levers: Array, still: list[Array], cords: list[Array],
) -> Iterator[Array]:
    """Yield net tensions [N] of the inputs, torques of chambers, that may balance the forces `slack` (N,) of a body
    without tension: one for each set of slack tendons with which the iteration begins.

    Parameters
    ----------
    torques : (C, N) array
        Forces of each input that is a chamber, 0 otherwise.
    levers : (tendons, N) array, m
    still : list of arrays, N
        Signed forces of the tendons of each input without the input.
    cords : list of arrays
        Numbers of the tendons of each input.
    """
    from scipy.optimize import lsq_linear

    effect = np.array([row + half_sum(levers[c], (1.0, -1.0)) for row, c in zip(torques, cords, strict=True)]).T
    pairs = [k for k, c in enumerate(cords) if c.size == 2]
    shared = np.array([half_sum(levers[cords[k]], (1.0, 1.0)) for k in pairs]).reshape(-1, slack.size)
    both = np.array([max(still[k].sum(), 0.0) for k in pairs])  # sum of the tensions of a pair while neither is slack
    lowest = np.array([max(s[0], 0.0) if s.size == 1 else -np.inf for s in still])
    weight = SLIGHT * float(np.abs(effect).max()) * np.eye(len(cords))
    wanted = weight @ np.where(np.isfinite(lowest), lowest, 0.0)
    acting = np.abs(shared).max(axis=1, initial=0.0) > 0.0
    begun = product(*((0.0, 1.0, -1.0) if acts else (0.0,) for acts in acting))
    for start in islice(begun, MOST_STARTS):
        side = np.array(start)  # 1 or -1: only the first or second tendon of the pair is taut
        for _ in range(SIDES):
            slopes = effect.copy()
            slopes[:, pairs] += (side[:, None] * shared).T
            rows = np.concatenate([slopes, weight]), np.append(-slack - (both * (side == 0.0)) @ shared, wanted)
            net = lsq_linear(*rows, bounds=(lowest, np.inf), tol=1e-14).x
            before, side = side, np.where(acting & (np.abs(net[pairs]) > both), np.sign(net[pairs]), 0.0)
            if (side == before).all():
                break
        yield net


def half_sum(arms: Array, signs: tuple[float, float]) -> Array | float:
    """Return the lever arms (N,) [m] on which a single tendon, or half of both tensions of a pair with `signs`, acts;
    0 without tendons. `arms` (tendons, N) are those of the input's tendons.
    """
    return 0.5 * (signs[0] * arms[0] + signs[1] * arms[1]) if len(arms) == 2 else arms[0] if len(arms) else 0.0


def commanded(net: float, still: Array) -> float:
    """Return the force [N] that an input commands for a net tension `net` [N]. `still` are the signed forces [N] of its
    tendons without the input: one of a single tendon, two of a pair. A chamber has none, and `net` is its torque.
    """
    if still.size == 0:
        return net
    if still.size == 1:
        return net - float(still[0]) if net > 0.0 else 0.0
    if still.sum() <= 0.0 and abs(net) < NO_TENSION:
        return float(np.clip(0.0, still[1], -still[0]))  # both are slack
    both = 0.5 * (net - still[0] + still[1])
    if both + still[0] >= 0.0 and still[1] - both >= 0.0:
        return float(both)
    return float(net - still[0] if net > 0.0 else net + still[1])


def modal(model: Model, M: Array, K: Array) -> tuple[Array, Array, Array]:
    """Return, for the n modes of a chain, the angular frequencies (n,) [rad/s] without damping, mode shapes (n, n) as
    columns, and decay rates (n,) [1/s].

    M and K (n, n) are inertia and stiffness, as of `Mechanics.linear_parts`.

    The shapes V have V'MV = 1. The decay rates are those of the modal diagonal of D.

    Raises
    ------
    SimulationError
        When the chain is not stable at this shape.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(M))
    squared, V = np.linalg.eigh(inverse @ K @ inverse.T)
    if squared[0] <= 0:
        raise SimulationError("the chain is not stable at this shape and has no natural frequencies: use another shape")
    shapes = inverse.T @ V
    return np.sqrt(squared), shapes, 0.5 * np.einsum("ik,i,ik->k", shapes, mechanics_of(model).joints.D, shapes)


def typical_pressure(model: Model, which: int = 0) -> float:
    """Return the pressure [Pa] that bends the chain by half a radian. If the chain has no equilibrium there, return 0.8
    of the largest pressure at which it has one. If no pressure bends it so far, as with a law that saturates, return
    the pressure that bends it by 0.9 of the largest bend.

    A model does not store the range of its recordings; this is the default level of a pulse. The result is 0 if no
    pressure bends the model by a milliradian.

    Only input `which` acts, the first by default. For a tendon the result is a tension [N], displacement [m] or angle
    [rad].
    """
    try:
        rest = equilibrium(model, first_alone(model, 0.0))
    except SimulationError:
        return 0.0
    low, (high, highest) = 0.0, RANGES[model.actuation.units[which]]
    target = BENT
    while (bend := bent(model, high, rest, which)) is not None and bend < target:
        low, high = high, 2.0 * high
        if high > highest:
            if bend < LEAST_BEND:
                return 0.0
            low, high, target = 0.0, low, 0.9 * bend
            break
    stable = bend is not None
    for _ in range(30):
        middle = 0.5 * (low + high)
        bend = bent(model, middle, rest, which)
        if bend is None or bend >= target:
            high, stable = middle, bend is not None
        else:
            low = middle
    return float(f"{low if stable else 0.8 * low:.2g}")


def first_alone(model: Model, pressure: float, which: int = 0) -> np.ndarray:
    """Return the pressures (C,) [Pa] of C chambers of which only one has the given `pressure`, by default the first,
    and the others 0.
    """
    return np.asarray(pressure * np.eye(model.actuation.count)[which])


def bent(model: Model, pressure: float, rest: np.ndarray, which: int = 0) -> float | None:
    """Return how far [rad] a pressure bends the chain from its rest shape; None if there is no equilibrium.

    In space it is the size of the bend in both directions.
    """
    try:
        q = equilibrium(model, first_alone(model, pressure, which)) - rest
    except SimulationError:
        return None
    return mechanics_of(model).total_bend(q)


Entry = tuple[tuple[str, ...], Array]


def first_states(model: Model, q0: Array, given: Array | None) -> Array:
    """Return the initial hysteresis states: those `given` or, if None, those in equilibrium at the N joint coordinates
    q0 (N,).
    """
    rest = relaxed(model, q0)
    if given is None:
        return rest
    shape = (len(rest), max(len(model.memory.labels), len(model.memory.axial.labels)))
    states = np.asarray(given, dtype=float)
    if states.shape != shape:
        raise InputError(
            f"initial_memory must be angles of shape ({model.memory.owners}, memory) = {shape}, got shape "
            f"{states.shape}"
        )
    if bad := int((~np.isfinite(states)).sum()):
        raise InputError(f"initial_memory must be finite, but {bad} of its {states.size} angles are not: correct them")
    rest[:, : shape[1]] = states
    return rest


def laws_of(model: Model) -> list[MemoryLaw]:
    """Return the hysteresis law of every coordinate that has hysteresis, first of the joints, then of the extensible
    segments.
    """
    joints, axial, segments = model.memory.law(), model.memory.axial.law(), len(model.extensions)
    rows = mechanics_of(model).remembering
    return [axial if i >= model.size - segments else joints for i in range(rows)]


def memory_energy(model: Model, x: Array, states: Array) -> Array:
    """Return the energy (T,) [J] that hysteresis branches hold at T instants."""
    chain = mechanics_of(model)
    rows = chain.remembering
    q, moved = chain.joint_coordinates(x)[:, :rows], np.moveaxis(states, 0, -1)  # (rows, branches, T)
    stored = [kernels.memory_stored(i, q[:, i], moved, law) for i, law in enumerate(laws_of(model))]
    return np.asarray(np.stack(stored, axis=1) @ chain.joints.K[:rows])


def memory_torques(model: Model, x: Array, states: Array) -> Array:
    """Return the torques [N m] of hysteresis against the bend, (T, m) of the first m coordinates at T instants."""
    chain = mechanics_of(model)
    rows = chain.remembering
    q, moved = chain.joint_coordinates(x)[:, :rows], np.moveaxis(states, 0, -1)  # (rows, branches, T) for the kernels
    laws = laws_of(model)
    angle = np.stack([kernels.memory_angle(i, q[:, i], moved, laws[i]) for i in range(rows)], axis=1)
    return np.asarray(chain.joints.K[:rows] * angle)


def memory_outputs(model: Model, x: Array, states: Array) -> dict[str, Entry]:
    """Return dataset variables, by name, for hysteresis states and torque; {} for a chain without hysteresis."""
    torque, labels = memory_torques(model, x, states), model.memory.coordinates
    values: dict[str, Entry] = {}
    for kind in mechanics_of(model).kinds:
        state, force, branch = kind.memory
        if branch in labels:
            values[state] = ("time", kind.over, branch), states[:, kind.rows, : len(labels[branch])]
            values[force] = ("time", kind.over), torque[:, kind.rows] / kind.lever
    return values
