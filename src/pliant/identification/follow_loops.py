"""The loop that a fit runs compiled: the chain's motion, seen at the observed points.

Plain text here; `pliant.compiler.choose.twin` makes what runs, on real numbers for the motion and on complex
numbers for its derivatives: what is put into the imaginary parts of the inputs comes out as a derivative, exactly.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.contact import add_link_loads
from pliant.equations.elastic import tangent
from pliant.equations.motion import step


def follow(phi, w, base_angle, h, torque, keep, still, held, held_base, pull, body, joints, work, places, out):
    """Take len(h) steps as `simulation.march_loops.march` does, from phi and w (n,), and observe the chain.

    The first `still` rows of out (rows, S, 3) show the chain held at the absolute angles `held` (n,); the state after
    step k goes to row keep[k] - 1 + still where keep[k] >= 0. `pull` is what known forces do, see `pulled`. Rows are
    x [m], y [m] and angle [rad] of each point.
    Returns the index of the first step in which a link turns by more than a radian or a spring holds nothing, or -1.
    """
    n = len(phi)
    for row in range(still):
        observe(held, held_base, places, work.c, work.s, out[row])
    for k in range(len(h)):
        step(phi, w, base_angle, h[k], pulled(k, phi, w, 0.5 * h[k], torque[k], pull, joints), body, joints, work)
        for i in range(n):
            if not (abs((w[i] * h[k]).real) <= 1.0 and tangent(i, phi, base_angle, joints).real > 0.0):
                return k  # as does what is not a number
        if keep[k] >= 0:
            observe(phi, base_angle, places, work.c, work.s, out[keep[k] - 1 + still])
    return -1


def pulled(k, phi, w, ahead, torque, pull, joints):
    """The torque of step k; with known forces the joints take theirs beside it, and the torque is 1 for all of them."""
    if len(pull.load) == 0:
        return torque
    for i in range(len(phi)):
        joints.gain[i] = pull.gain[i] * torque
    add_link_loads(phi, w, ahead, pull.load[k], joints.gain)
    return 1.0 + 0.0 * torque


def observe(phi, base_angle, places, c, s, seen):
    """Position [m] and angle [rad] of the observed points, seen (S, 3), at absolute angles phi (n,).

    p = joint + along e(phi) + across n(phi), as `equations.chain.station`, with every joint found once; x mirrored by
    `places.sign`; angles less `places.reference`.
    """
    n = len(phi)
    S = len(places.carrier)
    before = np.sin(base_angle)
    along = np.cos(base_angle)
    x = -places.base_length * before
    y = places.base_length * along
    for j in range(S):
        if places.carrier[j] < 0:
            seen[j, 0] = -places.along[j] * before - places.across[j] * along
            seen[j, 1] = places.along[j] * along - places.across[j] * before
            seen[j, 2] = base_angle
    for i in range(n):
        c[i] = np.cos(phi[i])
        s[i] = np.sin(phi[i])
        for j in range(S):
            if places.carrier[j] == i:
                seen[j, 0] = x - places.along[j] * s[i] - places.across[j] * c[i]
                seen[j, 1] = y + places.along[j] * c[i] - places.across[j] * s[i]
                seen[j, 2] = phi[i]
        x = x - places.length[i] * s[i]
        y = y + places.length[i] * c[i]
    for j in range(S):
        seen[j, 0] = places.sign * seen[j, 0] + places.shift_x
        seen[j, 1] = seen[j, 1] + places.shift_y
        seen[j, 2] = places.sign * (seen[j, 2] - places.reference)
