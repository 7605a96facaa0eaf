"""PyElastica's Cosserat rod with pressure chambers as loads. This is the only module that imports PyElastica."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import elastica
import numpy as np

if TYPE_CHECKING:
    from pliant.testbed.space import BodyInSpace

Array = np.ndarray
GRAVITY = 9.80665  # m/s^2, along -z


class World(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping, elastica.CallBacks
):
    """PyElastica system of a clamped rod under gravity and chamber pressures."""


class Pressures(elastica.NoForces):
    """Loads of the chamber pressures: a moment on the last cross-section and a thrust on every element.

    On the cap of a chamber at the azimuth a, the force p A acts along the tangent. It makes a moment of p A times the
    chamber's offset times (sin a, -cos a) about the axes of the cross-section. The chamber's side wall transmits the
    thrust along the bent body.
    """

    def __init__(self, body: BodyInSpace, pressure: Array) -> None:
        super().__init__()
        turn = np.stack([np.sin(body.azimuth), -np.cos(body.azimuth)], axis=-1)
        self.moment = body.torque * pressure @ turn  # (T, 2) N m
        self.push = body.area * pressure.sum(axis=1)  # (T,) N
        self.time_step = body.time_step

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        """Add the thrust of the chambers to the nodes of every element."""
        push = self.push[min(round(time / self.time_step), len(self.push) - 1)] * system.tangents
        system.external_forces[:, 1:] += push
        system.external_forces[:, :-1] -= push

    def apply_torques(self, system: Any, time: float = 0.0) -> None:
        """Add the chambers' moment to the last cross-section; the clamp carries the reaction."""
        system.external_torques[:2, -1] += self.moment[min(round(time / self.time_step), len(self.moment) - 1)]


class Keeper(elastica.CallBackBaseClass):
    """Callback that stores node positions, directors and curvature at every `every`-th step."""

    def __init__(self, every: int, kept: list[tuple[Array, ...]]) -> None:
        super().__init__()
        self.every, self.kept = every, kept

    def make_callback(self, system: Any, time: float, current_step: int) -> None:  # noqa: ARG002  PyElastica's
        """Store the present state of the rod at every `every`-th step."""
        if current_step % self.every == 0:
            kappa = system.kappa  # a turn about d1 bends towards -d2
            state = (system.position_collection.T, system.director_collection.transpose(2, 0, 1),
                     np.stack([kappa[1], -kappa[0]], axis=-1))  # fmt: skip
            self.kept.append(tuple(a.copy() for a in state))


def integrate(body: BodyInSpace, pressure: Array, *, every: int) -> tuple[Array, Array, Array, Array, Array]:
    """Simulate the body from rest under chamber pressures; return times, pressures, node positions, directors and
    curvature.

    Returns time (T,) [s], pressure (T, C) [Pa], node positions (T, E + 1, 3) [m], directors (T, E, 3, 3) and curvature
    (T, E - 1, 2) [1/m], sampled at every `every`-th step. `pressure` (P, C) [Pa] gives the pressures at each time step
    of the body.
    """
    rod = elastica.CosseratRod.straight_rod(
        body.elements, np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]), body.length, body.radius,
        body.density, youngs_modulus=body.youngs_modulus, shear_modulus=body.youngs_modulus / 3.0,
    )  # fmt: skip
    rod.shear_matrix[2, 2] *= body.sleeve
    world, snapshots = World(), list[tuple[Array, ...]]()
    world.append(rod)
    world.constrain(rod).using(elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    world.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -GRAVITY]))
    world.add_forcing_to(rod).using(Pressures, body=body, pressure=pressure)
    world.dampen(rod).using(elastica.AnalyticalLinearDamper, uniform_damping_constant=body.damping,
                            time_step=body.time_step)  # fmt: skip
    world.collect_diagnostics(rod).using(Keeper, every=every, kept=snapshots)
    world.finalize()
    steps = len(pressure) - 1
    elastica.integrate(elastica.PositionVerlet(), world, steps * body.time_step, steps, progress_bar=False)
    position, directors, curvature = (np.array(a) for a in zip(*snapshots, strict=True))
    time = every * body.time_step * np.arange(len(position))
    return time, pressure[::every][: len(position)], position, directors, curvature
