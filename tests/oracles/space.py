"""Chains in space to try the kernels on: random ones, those of the plane, and what the kernels need to run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pliant.compiler.trace import spatial_workspace
from pliant.equations.elastic import ROWS
from pliant.equations.symbols import SpatialBody, SpatialJoints


class SpaceChain(NamedTuple):
    """A chain of n links and how it moves: coordinates x and rates v (N,)."""

    body: SpatialBody
    joints: SpatialJoints
    x: np.ndarray
    v: np.ndarray

    @property
    def n(self):
        return len(self.body.mass)

    def work(self, kind=float):
        return workspace(self.n, len(self.x), kind, self.body.share.shape[1], len(self.body.friction))


def no_tendons(n, size):
    """The last entries of a body of n links without tendons whose length does not change."""
    return *np.zeros((2, 0, size)), *np.zeros((5, 0)), np.zeros((size, 1)), np.zeros((n + 1, 0))


def beyond_joints(n, size):
    """Part (N, n + 1) of what a swing, or a twist, draws in that lies beyond the entry and each joint's middle."""
    joint = np.append(np.repeat(np.arange(n), 2), np.arange(size - 2 * n))[:, None]
    arcs = np.where(joint > np.arange(n), 1.0, np.where(joint == np.arange(n), 0.5, 0.0))
    return np.hstack([np.ones((size, 1)), arcs])


def with_tendons(chain, rng, *, stiffness=800.0, pretension=1.5, friction=0.0, slip_rate=0.05, entry=0.0, chord=0.0):
    """The chain with three tendons, the second of which hangs slack at rest; none turns a twist."""
    lever = rng.normal(0, 0.01, (3, len(chain.x)))
    lever[:, 2 * chain.n :] = 0.0
    swings = np.arange(len(chain.x)) < 2 * chain.n
    body = chain.body._replace(
        lever=lever, chord=chord * np.tile(swings, (3, 1)), tendon_stiffness=np.full(3, stiffness),
        pretension=pretension * np.array([1.0, -1.0, 1.0]),
        friction=np.full(3, friction), slip_rate=np.full(3, slip_rate), beyond=beyond_joints(chain.n, len(chain.x)),
        entry_friction=np.full(3, entry),
    )
    return chain._replace(body=body)


def workspace(n, size, kind=float, segments=0, tendons=0):
    """Scratch arrays for n links, `size` coordinates, of which `segments` are strains, and so many tendons."""
    return spatial_workspace(n, (size - segments) // n, segments, tendons, kind)


def random_space_chain(rng, n, *, twist=False, springs=True):
    """Unequal links with rest rotations, gravity along all axes and a tilted base, in fast motion."""
    size = 3 * n if twist else 2 * n
    length = rng.uniform(0.02, 0.06, n + 1)
    turns = Rotation.from_rotvec(rng.normal(0, 0.4, (n + 1, 3))).as_matrix()
    axial = rng.uniform(1e-6, 1e-5, n)
    body = SpatialBody(
        length, rng.uniform(0.005, 0.03, n), length[1:] * rng.uniform(0.2, 1.0, n),
        0.5 * axial + rng.uniform(1e-6, 1e-5, n), axial, turns[1:], turns[0], *rng.normal(0, 5, 3),
        *no_tendons(n, size),
    )  # fmt: skip
    return SpaceChain(body, random_joints(rng, n, size) if springs else free_joints(n, size),
                      rng.uniform(-0.9, 0.9, size), rng.normal(0, 8.0, size))  # fmt: skip


def lengthening(chain, rng, segments, *, springs=True):
    """The chain with so many segments that lengthen, each part of several links and of what lies before them."""
    share = rng.uniform(0.2, 1.0, (chain.n + 1, segments)) / segments
    joints, size = chain.joints, len(chain.x) + segments

    def behind(values, strains):
        return np.append(values, strains * springs)

    joints = joints._replace(
        theta0=np.zeros(size), K=behind(joints.K, rng.uniform(1.0, 3.0, segments)),
        D=behind(joints.D, rng.uniform(1e-3, 1e-2, segments)),
    )
    lever = np.zeros((len(chain.body.lever), size))
    lever[:, : len(chain.x)] = chain.body.lever
    chord = np.pad(chain.body.chord, ((0, 0), (0, segments)))
    lever[:, len(chain.x) :] = -rng.uniform(0.05, 0.1, (len(lever), segments))
    along = np.tile(np.linspace(0.9, 0.1, chain.body.beyond.shape[1]), (segments, 1))
    beyond = np.concatenate([chain.body.beyond, along])
    return SpaceChain(chain.body._replace(share=share, lever=lever, chord=chord, beyond=beyond), joints,
                      np.append(chain.x, rng.uniform(-0.3, 0.4, segments)),
                      np.append(chain.v, rng.normal(0, 5.0, segments)))  # fmt: skip


def random_joints(rng, n, size, *, isotropic=True):
    """Springs that soften and then stiffen, and dampers."""
    K, D = rng.uniform(0.1, 2.0, size), rng.uniform(1e-3, 1e-2, size)
    if isotropic:
        K[1 : 2 * n : 2], D[1 : 2 * n : 2] = K[: 2 * n : 2], D[: 2 * n : 2]
    hardening = np.stack([-0.3 * K, 0.4 * K, np.full(size, 0.25)])
    return SpatialJoints(0.0, np.zeros(size), K, D, hardening, np.zeros(n), np.zeros((0, 3)), np.zeros((n, 0)))


def free_joints(n, size):
    """Joints without springs and dampers."""
    still = np.zeros(size)
    return SpatialJoints(0.0, still, still.copy(), still.copy(), np.zeros((ROWS, size)), np.zeros(n), np.zeros((0, 3)),
                         np.zeros((n, 0)))  # fmt: skip


def rotation_about_x(angle):
    return Rotation.from_rotvec(np.multiply.outer(np.atleast_1d(angle), [1.0, 0.0, 0.0])).as_matrix()


def of_the_plane(chain, q, dq, *, twist=False, base_length=0.0):
    """A planar chain (`oracles.chains.Chain`) at joint angles q and rates dq in space: planar (x, y) = (Y, Z)."""
    n, size = chain.n, (3 if twist else 2) * chain.n
    m, c, lateral = chain.m.copy(), chain.c.copy(), np.array(chain.I, float)
    m[-1] += chain.m_tip
    c[-1] = (chain.m[-1] * chain.c[-1] + chain.m_tip * chain.l[-1]) / m[-1]
    lateral[-1] += chain.m[-1] * (chain.c[-1] - c[-1]) ** 2 + chain.m_tip * (chain.l[-1] - c[-1]) ** 2
    body = SpatialBody(
        np.append(base_length, chain.l), m, c, lateral, 0.3 * lateral + 1e-8,
        rotation_about_x(chain.theta0), rotation_about_x(chain.base_angle)[0], 0.0, chain.gx, chain.gy,
        *no_tendons(n, size),
    )  # fmt: skip

    def spread(values, beyond=0.0):
        return np.append(np.repeat(values, 2), np.full(size - 2 * n, beyond))

    hardening = np.stack([spread(row) for row in chain.joints().hardening])
    joints = SpatialJoints(0.0, np.zeros(size), spread(chain.K, 0.5), spread(chain.D, 1e-3), hardening, np.zeros(n),
                           np.zeros((0, 3)), np.zeros((n, 0)))  # fmt: skip
    x, v = np.zeros(size), np.zeros(size)
    x[: 2 * n : 2], v[: 2 * n : 2] = q, dq
    return SpaceChain(body, joints, x, v)
