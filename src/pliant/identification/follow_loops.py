"""Compiled loops of a fit: simulate the chain and record positions and angles of the observed points.

This module is plain Python. `pliant.compiler.choose.twin` compiles it for real numbers, and
`pliant.compiler.choose.dual_twin` for dual numbers, which carry several exact derivatives along.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.base import begin_step, end_step
from pliant.equations.chamber import share_out
from pliant.equations.contact import add_link_loads
from pliant.equations.elastic import follows
from pliant.equations.memory import relax, step_with_memory
from pliant.equations.motion import step
from pliant.equations.observation import observe
from pliant.equations.symbols import ObservedChain, SpatialBody, SpatialWorkspace


class Course(NamedTuple):
    """Time steps of a simulation. Each has a length, the mean torques of the chambers and the mean link loads of known
    forces during the step, and the output row for the state at its end.
    """

    h: np.ndarray  # (steps,) s
    torque: np.ndarray  # (steps, C) N m, mean of each chamber over each step
    gain: np.ndarray  # (C, n) factor on that torque at each joint
    keep: np.ndarray  # (steps,) row of the output after the step, negative: none
    load: np.ndarray  # (steps, n, 2) N m, mean loads of the links by known forces; no rows where there are none
    base: np.ndarray  # (steps, 5), in space (steps, 6), motion of the base, see `base.begin_step`; no rows at rest


class Before(NamedTuple):
    """Pose in which a chain is held during the first output rows, before it is let go or driven."""

    rows: int  # number of output rows in this pose
    phi: np.ndarray  # (n,) rad
    base_angle: float  # rad


class Places(NamedTuple):
    """Positions of the observed points on the links of a chain, with the offset of the recording's frame."""

    chain: ObservedChain | SpatialBody
    links: np.ndarray | SpatialWorkspace  # scratch of `place_links`
    carrier: np.ndarray  # (S,) index of the link that carries each point, -1 the base
    along: np.ndarray  # (S,) m
    across: np.ndarray  # (S,) m
    aside: np.ndarray  # (S,) m
    shift: np.ndarray  # (3,) of the observed coordinates: m; in the plane m, m, and rad


class Seen(NamedTuple):
    """Observed points of the chain, with the array (rows, S, 3) to which a simulation writes their coordinates."""

    places: Places
    rows: np.ndarray


def follow(phi, w, course, before, chain, work, seen, past=None):
    """Simulate a chain over all steps of `course`, and write the coordinates of the observed points to seen.rows.
    Angles phi, rates w and the hysteresis states in `past` (None: no hysteresis) change in place; creep starts at rest.

    The first rows of seen.rows show the chain as it was held `before` (`Before`); the state after step k goes to row
    keep[k] - 1 + before.rows where keep[k] >= 0. `chain` is (body, joints).
    Returns the index of the first step in which a link turns by more than a radian, a spring has lost its stiffness or
    the hysteresis branches do not converge, or -1.
    """
    body, joints = chain
    look_before(before, seen)
    if past is not None:
        relax(phi, joints, past)
    for k in range(len(course.h)):
        h = course.h[k]
        if len(course.base) > 0:
            begin_step(course.base[k], w, body, joints)
        take_torques(k, phi, w, course, body, joints, work)
        if past is None:  # Numba compiles one of the two branches
            step(phi, w, h, work.tau, body, joints, work)
        else:
            lost = step_with_memory(phi, w, h, work.tau, body, joints, past, work)
            if not lost.real > -0.5:  # the square of an imaginary part may be slightly below zero
                return k
        if not follows(phi, w, h, joints):
            return k
        if len(course.base) > 0:
            end_step(course.base[k], phi, w, body, joints)
        if course.keep[k] >= 0:
            observe(phi, joints.base_angle, seen.places, seen.rows[course.keep[k] - 1 + before.rows])
    return -1


def take_torques(k, phi, w, course, body, joints, work):
    """Write the torques (n,) [N m] that chambers and known forces exert on n joints in step k to work.tau."""
    for c in range(len(course.gain)):
        share_out(c, course.torque[k, c], course.gain, work.tau)
    if len(course.load) > 0:
        add_link_loads(phi, w, 0.5 * course.h[k], course.load[k], body, joints, work)


def look_before(before, seen):
    """Write the observed points of the held chain to the first rows of seen.rows, before the motion starts."""
    for row in range(before.rows):
        observe(before.phi, before.base_angle, seen.places, seen.rows[row])
