"""Prescribed motion of the base: how a time step takes it into account, for a planar chain.

The coordinates and rates of a chain are relative to the base at every output time. A time step of a planar chain uses
the axes of the base at the start of the step, which do not turn with it: the rates of the links are then absolute, and
the angle of the base grows at its mean rate, `Joints.spin`. The acceleration of the origin and the turned direction of
gravity enter as loads on the links, since they act as weight does. In space the rates stay relative to the base, whose
angular velocity and acceleration, `SpatialBody.spin`, are the start values of the recursion `spatial.inertial_forces`.

Source: Featherstone, Rigid Body Dynamics Algorithms, Sec. 5.3 and 9.1 (a base in motion as start of the recursion)
"""

from __future__ import annotations


def begin_step(motion, w, body, joints):
    """Prepare a time step of a planar chain whose base turns: write the spin of the base to `joints`, and make the
    rates w of its links absolute.

    `motion` (5,) holds the base's mean rate and acceleration, its rates at the start and the end of the step, and its
    turn over the step, all about +z.
    """
    joints.spin[0] = motion[0]
    joints.spin[1] = motion[1]
    for i in range(len(joints.theta0)):
        w[i] = w[i] + motion[2]


def end_step(motion, phi, w, body, joints):
    """Return angles phi and rates w of the links of a planar chain to the axes of the base, after a time step that
    `begin_step` prepared.
    """
    for i in range(len(joints.theta0)):
        phi[i] = phi[i] - motion[4]
        w[i] = w[i] - motion[3]


def begin_step_in_space(motion, v, body, joints):
    """Prepare a time step of a chain in space whose base moves: write its spin to `body`.

    `motion` (6,) holds the angular velocity and the angular acceleration of the base in its own axes. The rates v (N,)
    are relative to the base and do not change.
    """
    for i in range(2):
        for j in range(3):
            body.spin[i, j] = motion[3 * i + j]


def end_step_in_space(motion, x, v, body, joints):
    """Leave the coordinates x and rates v (N,) of a chain in space as they are, relative to the base.

    It stands in place of `end_step`.
    """
