"""Pose of a body that is held: joint angles from the positions of its points, as a regularised least-squares problem.

A pose q minimises |p(q) - m|^2 / s^2 + (q - c)^T W (q - c), with the S points p(q) of the model, their measured
positions m, a distance s, and weights W proportional to the stiffness of the joints. The centre c is the unloaded shape
in the first stage, and the pose of the stage before in each later one (proximal point iteration, or iterated Tikhonov
regularisation). The points determine what they can; what they leave open stays at the unloaded shape.

The distance is large, so that each stage has one minimum and a positive definite second derivative: the pose has
bounded derivatives also where the points are as far from the base as the straight chain reaches, or farther. A single
stage with a small distance would fit as well, but angles would go there as the root of the missing length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import SimulationError
from pliant.mechanics import Mechanics, mechanics_of
from pliant.model import Model, Station

Array = np.ndarray
STAGES = 12
DISTANCE = 0.04  # s, of the body's length; all stages together weigh as one with DISTANCE / sqrt(STAGES)
BENDS = 0.9  # rad, expected bend of a whole body that is held
MOST_STEPS = 100  # Newton steps of a stage
LONGEST_STEP, LONG_STEP, REACHED = 0.5, 1e-3, 1e-12  # rad: at most; after it second derivatives change; ends a stage
CHANGE = 1e-6  # rad, of the differences that give second derivatives
SAME_POSE = 1e-4  # rad and m: changes after which the pose is followed from the latest one
BEYOND = 0.01  # of the body's length: distance beyond reach that is reported


def pose_through(chain: Mechanics, positions: Array, cache: dict[Any, Any], centre: Array | None = None) -> Array:
    """Return the joint coordinates (N,) of a chain whose S points are held at `positions` (S, 2 or 3) [m].

    `solved_stages` describes the search. The pose depends on lengths, the unloaded shape, ratios of stiffnesses, the
    positions and the `centre` (N,) of the first stage alone, and is cached in `cache`. If they differ from the latest
    ones by the step of a finite difference, the search starts from the latest pose: the derivative is that of the
    minimum (implicit function theorem).
    """
    model, centre = chain.model, np.zeros(chain.size) if centre is None else centre
    points = np.array([p[1:] for p in model.stations], dtype=float)
    key_values = np.concatenate([[model.base_length], model.link_length, points.ravel(),
                            prior_weights(chain), centre, chain.rest_turns.ravel(), positions.ravel()])  # fmt: skip
    if (key := key_values.tobytes()) not in cache:
        latest = cache.get("latest", key_values[:0])
        near = latest.size == key_values.size and np.abs(key_values - latest).max() < SAME_POSE
        cache[key] = solved_stages(chain, positions, cache[latest.tobytes()] if near else (), centre)
        if not near:
            cache["latest"] = key_values
    return np.array(cache[key][-1].pose)


def chain_of(model: Model, stations: list[Station]) -> Mechanics:
    """Return the mechanics of a chain that carries S points."""
    return mechanics_of(model.with_(stations=tuple(stations)))


def solved_pose(model: Model, stations: list[Station], positions: Array) -> Array:
    """Return the joint angles [rad] of a model whose S points are held at `positions` (S, 2 or 3) [m]."""
    return solved_stages(chain_of(model, stations), positions)[-1].pose


def rates_through(chain: Mechanics, q: Array, velocities: Array) -> Array:
    """Return the rates (N,) of the joint coordinates q (N,) of a chain whose S points move at `velocities` (S, 2 or 3)
    [m/s], with the distance and weights of all stages of a pose together, per second.
    """
    slopes = chain.points_and_slopes(chain.coordinates(q))[1].reshape(-1, q.size) @ chain.from_joints
    slopes, distance = np.sqrt(STAGES) * slopes, DISTANCE * chain.model.length
    normal = slopes.T @ slopes / distance**2 + np.diag(prior_weights(chain))
    return np.asarray(np.linalg.solve(normal, np.sqrt(STAGES) * slopes.T @ velocities.ravel() / distance**2))


def solved_stages(
    chain: Mechanics, positions: Array, near: Sequence[Minimum] = (), centre: Array | None = None,
) -> list[Minimum]:
    """Return the minimum of each stage, for S points held at `positions` (S, 2 or 3) [m]. The search of a stage starts
    from the minimum `near` if given, else from the pose of the stage before. The first stage is about `centre` (N,);
    default: the unloaded shape.

    Raises
    ------
    SimulationError
        When a stage finds no minimum.
    """
    problem = HeldPose(chain, positions, DISTANCE * chain.model.length, prior_weights(chain), chain.workspace())
    stages, centre = list[Minimum](), np.zeros(chain.size) if centre is None else centre
    for stage in range(STAGES):
        stages.append(problem.minimum(centre, near[stage] if near else Minimum(centre)))
        centre = stages[-1].pose
    return stages


def prior_weights(chain: Mechanics) -> Array:
    """Return the weights (N,) of the squared joint coordinates: the ratios of the joints' stiffnesses to their mean,
    scaled to the bend that a held body is expected to have.
    """
    K, model = chain.joints.K, chain.model
    return np.asarray(K / model.stiffness.mean() * (model.n / BENDS**2))


class Minimum(NamedTuple):
    """Joint coordinates (N,) of least cost, and the second derivatives (N, N) of the cost nearby, if known."""

    pose: Array
    second: Array | None = None


@dataclass(frozen=True)
class HeldPose:
    """The least-squares problem of one stage.

    Attributes
    ----------
    chain : Mechanics
        Chain whose S points are held.
    positions : array (S, 2 or 3)
        Where they are held, m.
    distance : float
        Deviation of a point that weighs as much as a joint's deviation of 1 / sqrt(weight), m.
    weight : array (N,)
        Weights of the squared joint coordinates.
    work : workspace of the chain
        Written over.
    """

    chain: Mechanics
    positions: Array
    distance: float
    weight: Array
    work: Any

    def minimum(self, centre: Array, start: Minimum) -> Minimum:
        """Return the minimum about `centre` (N,), searched from `start`.

        The second derivatives are computed again after long steps only: they set how fast the search ends, not where.
        """
        q, second = start
        for _ in range(MOST_STEPS):
            positions, slopes = self.placed(q)
            off = (positions - self.positions).ravel() / self.distance
            second = self.second_derivative(q, off, slopes) if second is None else second
            move = np.linalg.solve(second, -slopes.T @ off - self.weight * (q - centre))
            if np.abs(move).max() < REACHED:
                return Minimum(q + move, second)
            if np.abs(move).max() > LONG_STEP:
                move, second = self.lowering(q, move, centre), None
            q = q + move
        raise SimulationError(
            f"the pose in which the body is held was not found within {MOST_STEPS} steps: check the length, the base "
            "and the positions of the stations on the body"
        )

    def lowering(self, q: Array, move: Array, centre: Array) -> Array:
        """Return the part of a step `move` (N,) from q (N,) that is short enough to lower the cost."""
        cost = self.cost(q, centre)
        move = move * min(1.0, LONGEST_STEP / float(np.abs(move).max()))
        while self.cost(q + move, centre) > cost and np.abs(move).max() > LONG_STEP:
            move = 0.5 * move
        return move

    def cost(self, q: Array, centre: Array) -> float:
        """Return half the weighted sum of squares at the joint coordinates q (N,)."""
        off = (self.chain.stations(self.chain.coordinates(q))[0] - self.positions) / self.distance
        return 0.5 * float(np.sum(off**2) + np.sum(self.weight * (q - centre) ** 2))

    def second_derivative(self, q: Array, off: Array, slopes: Array) -> Array:
        """Return the second derivatives (N, N) of the cost at q (N,), with the deviations `off` of the points and their
        derivatives `slopes` by q; those of Gauss and Newton where the true ones are not positive definite.
        """
        first = slopes.T @ slopes + np.diag(self.weight)
        curved = np.stack([off @ (self.placed(q + CHANGE * row)[1] - slopes) for row in np.eye(q.size)]) / CHANGE
        second = first + 0.5 * (curved + curved.T)
        return np.asarray(second if np.linalg.eigvalsh(second)[0] > 0.0 else first)

    def placed(self, q: Array) -> tuple[Array, Array]:
        """Return positions (S, 2 or 3) [m] of the points, and their derivatives (2 S or 3 S, N) by q (N,) in units of
        `distance`.
        """
        positions, slopes = self.chain.points_and_slopes(self.chain.coordinates(q), self.work)
        return positions, slopes.reshape(-1, q.size) @ self.chain.from_joints / self.distance


def beyond_reach(model: Model, stations: list[Station], positions: Array) -> dict[str, float]:
    """Return the distances [m] by which S `positions` (S, 2 or 3) [m] lie beyond the reach of the model's points, by
    station; only those that are worth a message. A point that a body reaches because it lengthens is left out.
    """
    chain = chain_of(model, stations)
    joint = chain.nodes(chain.coordinates(np.zeros(chain.size)))[1]
    reach = [model.link_length[: p.link].sum() + float(np.linalg.norm(p[2:])) for p in stations]
    missed = chain.stations(chain.coordinates(solved_stages(chain, positions)[-1].pose))[0] - positions
    beyond = np.minimum(np.linalg.norm(positions - joint, axis=1) - reach, np.linalg.norm(missed, axis=1))
    return {p.name: float(d) for p, d in zip(stations, beyond, strict=True)
            if p.link >= 0 and d > BEYOND * model.length}  # fmt: skip
