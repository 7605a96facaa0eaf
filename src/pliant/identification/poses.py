"""Simulation of recordings in which the body rests in every row (settled poses), and its derivatives with respect to
parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pliant.compiler.choose import free_twin, twin
from pliant.equations.poses import Settling, settle_all, show_all
from pliant.errors import InputError, SimulationError
from pliant.identification.drives import check_driven
from pliant.identification.loop_inputs import ForwardProblem, Numbers
from pliant.identification.observation import TINY, NumberKind, in_kind, places_of
from pliant.mechanics import mechanics_of
from pliant.mechanics.complex_slopes import of_kind
from pliant.mechanics.rest import settling
from pliant.parallel import side_by_side
from pliant.simulation.drive import Drive

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment
    from pliant.identification.plans import ModelAt

Array = np.ndarray


def pose_inputs(model_at: ModelAt, exp: Experiment) -> Drive:
    """Return the pressures and chamber torques under which the body rests in each row of a
    recording of settled poses. Models of one fit share what their parameters do not change.
    """
    model, parts = model_at.model, model_at.parts
    key = (pose_inputs, exp.name)
    if key not in parts:
        check_driven(model, [exp])
        if model.space is None:
            raise InputError(
                f"experiment {exp.name}: poses need a model in space, and {model.name!r} is planar: leave out poses"
            )
        traces = [exp.driving(name) for name in model.actuation.names]
        parts[key] = np.stack([np.zeros(exp.time.size) if t is None else t(exp.time) for t in traces], axis=1)
    values: Array = parts[key]
    laws = (*key, *(c.key for c in model.chambers))
    if laws not in parts:
        parts[laws] = np.stack([c.torque_at(v) for c, v in zip(model.chambers, values.T, strict=True)], axis=1)
    still = np.zeros(values.shape[1])
    return Drive(np.zeros(0), parts[laws], model.actuation.columns, np.arange(exp.time.size), values, still)


COMPLEX = NumberKind(partial(of_kind, kind=complex), np.real, twin)


def equilibrium_poses(forward: ForwardProblem) -> Settling:
    """Return the equilibrium shape for each row of a recording of settled poses. Each search starts from the shape
    found for the previous row, the first one from the equilibrium without input. They are computed once for a model.

    Raises
    ------
    SimulationError
        When a pose has no stable equilibrium.
    """
    computed: list[Settling] = [] if forward.settled is None else forward.settled
    if not computed:
        computed.append(computed_poses(forward))
    return computed[0]


def computed_poses(forward: ForwardProblem) -> Settling:
    """Return what `equilibrium_poses` returns, computed anew."""
    chain, numbers = mechanics_of(forward.model), in_kind(forward.numbers, COMPLEX)
    torque = commands(numbers)
    slip = numbers.memory.slip_share, numbers.memory.slip_angle
    turns = forward.model.turns * forward.model.n
    poses = settling(len(torque) - 1, chain.size, torque.shape[1], chain.no_loads(), slip, turns)
    poses.x[0] = chain.equilibrium(torque[0].real, np.zeros(chain.dimension), None)
    failed = twin(settle_all)(torque, numbers.body, numbers.joints, chain.workspace(complex), poses)
    if failed >= 0:
        raise SimulationError(
            f"pose {failed} of {len(torque) - 1} has no stable equilibrium: the body buckles; raise the stiffness or "
            "lower the inputs"
        )
    return poses


def commands(numbers: Numbers) -> Array:
    """Return the torques and tendon commands (T + 1, N + R) of T settled poses, for N coordinates and R tendons. The
    first row is zero (no input); the rows of the poses follow.
    """
    rows = numbers.torque @ numbers.gain
    return np.concatenate([0.0 * rows[:1], rows])


def observed_poses(forward: ForwardProblem, numbers: Numbers, poses: Settling) -> Array:
    """Return the positions (T, S, 3) [m] of S observed points in T settled poses, as complex numbers. If the imaginary
    parts of `numbers` are a small change of the inputs, those of the positions are the resulting change.
    """
    numbers = in_kind(numbers, COMPLEX)
    out = np.zeros((len(poses.x), forward.carrier.size, 3), dtype=complex)
    chain = mechanics_of(forward.model)
    points = places_of(forward, numbers, COMPLEX)
    show = free_twin(show_all, *chain.sizes)
    slip, turns = (numbers.memory.slip_share, numbers.memory.slip_angle), forward.model.turns * forward.model.n
    scratch = settling(len(poses.x) - 1, chain.size, numbers.gain.shape[1], chain.no_loads(), slip, turns)
    poses = scratch._replace(x=poses.x, K=poses.K)
    show(commands(numbers), numbers.body, numbers.joints, chain.workspace(complex), poses, points, out)
    return out[1:]


def pose_rows(forward: ForwardProblem, numbers: Numbers) -> Array:
    """Return the positions x, y, z (T, S, 3) [m] of S observed points in T settled poses.

    Raises
    ------
    SimulationError
        When a pose has no stable equilibrium.
    """
    return observed_poses(forward, numbers, equilibrium_poses(forward)).real


def pose_slopes(forward: ForwardProblem, tilted: Sequence[Numbers]) -> Array:
    """Return the derivatives (P, T, S, 3) of the positions of S observed points in T settled poses with respect to P
    parameters. `tilted` holds the simulation inputs once for each parameter; their imaginary part is `TINY` times their
    derivative with respect to this parameter.
    """
    poses = equilibrium_poses(forward)
    return np.stack(side_by_side(lambda numbers: observed_poses(forward, numbers, poses).imag / TINY, tilted))
