"""The loop that a fit runs compiled: the chain's motion, seen at the observed points.

Plain text here; `pliant.compiler.choose.twin` makes what runs on real numbers for the motion, and
`pliant.compiler.duals.dual_twin` on dual numbers, which carry several derivatives beside it, exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.chamber import share_out
from pliant.equations.contact import add_link_loads
from pliant.equations.elastic import follows
from pliant.equations.memory import relax, step_with_memory
from pliant.equations.motion import step
from pliant.equations.observation import observe
from pliant.equations.symbols import ObservedChain, SpatialBody, SpatialWorkspace


class Course(NamedTuple):
    """The steps of a march (`simulation.march_loops.Steps`), with known forces."""

    h: np.ndarray  # (steps,) s
    torque: np.ndarray  # (steps, C) N m, mean of each chamber over each step
    gain: np.ndarray  # (C, n) share of it that each joint feels
    keep: np.ndarray  # (steps,) row of the output after the step, negative: none
    load: np.ndarray  # (steps, n, 2) N m, mean loads of the links by known forces; no rows where there are none


class Before(NamedTuple):
    """A chain that is held before it moves."""

    rows: int  # how many
    phi: np.ndarray  # (n,) rad
    base_angle: float  # rad


class Places(NamedTuple):
    """Where the observed points are."""

    chain: ObservedChain
    links: np.ndarray  # (5, n + 1) scratch of `place_links`
    carrier: np.ndarray  # (S,) index of the link that carries each point, -1 the base
    along: np.ndarray  # (S,) m
    across: np.ndarray  # (S,) m
    shift_x: float  # m
    shift_y: float  # m
    reference: float  # rad, what angles are measured from


class SpatialPlaces(NamedTuple):
    """Where the observed points are, in space."""

    body: SpatialBody
    work: SpatialWorkspace
    carrier: np.ndarray  # (S,) index of the link that carries each point, -1 the base
    along: np.ndarray  # (S,) m
    across: np.ndarray  # (S,) m
    aside: np.ndarray  # (S,) m
    shift: np.ndarray  # (3,) m


class Seen(NamedTuple):
    """What is observed: points, and rows (rows, S, 3) that take x [m], y [m], angle [rad] of each; in space x, y, z."""

    places: Places | SpatialPlaces
    rows: np.ndarray


def follow(phi, w, course, before, body, joints, work, seen):
    """Take all steps of a `Course` as `simulation.march_loops.march` does, from phi and w (n,), and observe the chain.

    The first rows of seen.rows show the chain as it was held `before` (`Before`); the state after step k goes to row
    keep[k] - 1 + before.rows where keep[k] >= 0.
    Returns the index of the first step in which a link turns by more than a radian or a spring holds nothing, or -1.
    """
    look_before(before, seen)
    for k in range(len(course.h)):
        h = course.h[k]
        take_torques(k, phi, w, course, body, joints, work)
        step(phi, w, h, work.tau, body, joints, work)
        if not follows(phi, w, h, joints):
            return k
        if course.keep[k] >= 0:
            observe(phi, joints.base_angle, seen.places, seen.rows[course.keep[k] - 1 + before.rows])
    return -1


def follow_with_memory(phi, w, course, before, chain, past, work, seen):
    """As `follow`, with the memory of the joints (`symbols.Past`), whose creep is set to rest at phi.

    `chain` is (body, joints). Returns the index of the first step in which a link turns by more than a radian or the
    branches find no agreement, or -1.
    """
    body, joints = chain
    look_before(before, seen)
    relax(phi, joints, past)
    for k in range(len(course.h)):
        h = course.h[k]
        take_torques(k, phi, w, course, body, joints, work)
        lost = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
        if not lost.real > -0.5:  # the square of an imaginary part may stand a trifle below zero
            return k
        if not follows(phi, w, h, joints):
            return k
        if course.keep[k] >= 0:
            observe(phi, joints.base_angle, seen.places, seen.rows[course.keep[k] - 1 + before.rows])
    return -1


def take_torques(k, phi, w, course, body, joints, work):
    """Torques work.tau (n,) [N m] of the joints in step k: of the chambers, and of known forces half a step ahead."""
    for c in range(len(course.gain)):
        share_out(c, course.torque[k, c], course.gain, work.tau)
    if len(course.load) > 0:
        add_link_loads(phi, w, 0.5 * course.h[k], course.load[k], body, joints, work)


def look_before(before, seen):
    """The rows of a chain that is held before it moves."""
    for row in range(before.rows):
        observe(before.phi, before.base_angle, seen.places, seen.rows[row])
