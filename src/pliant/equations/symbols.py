"""Parameter records of the compiled kernels: named tuples with the symbols, shapes and units of the equations.

Two coordinate sets describe the same motion: the joint angles q of the paper, relative to the rest shape, and
the absolute link angles phi_i = base_angle + sum_{k<=i} (q_k + theta0_k), from the base tangent +y.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

AT_REST = np.zeros(2)  # rate [rad/s] and acceleration [rad/s^2] of a base that does not turn, in the plane
STILL = np.zeros((0, 3))  # no rows: a base in space that does not turn


class Body(NamedTuple):
    """Constants of the inertia of a planar chain, in absolute link angles.

    `inertia.body_constants` computes them.

    In absolute angles the kinetic energy is 1/2 sum_kl B_kl cos(phi_k - phi_l) w_k w_l + 1/2 sum_k I_k w_k^2 with
    constant B. Only the cosine depends on the shape (Sec. III-C; derived, see docs/equations.md).
    """

    B: np.ndarray  # (n, n) kg m^2, coupling of the link directions
    I: np.ndarray  # (n,)   kg m^2, rotary inertia of each link about its centre of mass
    h: np.ndarray  # (n,)   kg m, first moment of link k and all mass beyond it
    gx: float  # m/s^2, gravity along x of the base frame
    gy: float  # m/s^2, gravity along y of the base frame


class ExtensibleBody(NamedTuple):
    """Constants of the inertia of a planar chain whose segments lengthen.

    The module `equations.extension` uses them.

    Link 0 is the part before the first joint.
    """

    B: np.ndarray  # (n + 1, n + 1) kg m^2, rotary inertia on its diagonal
    l: np.ndarray  # (n + 1,) m, lengths of the links unstretched
    h: np.ndarray  # (n + 1,) kg m, first moment of link k and all mass beyond it
    share: np.ndarray  # (n + 1, S) fraction of each link that lies in each segment
    gx: float  # m/s^2
    gy: float  # m/s^2
    tip_inertia: float = 0.0  # kg m^2, of the payload about the tip of the last link, with which it turns


class SpatialBody(NamedTuple):
    """Constants of a chain in space: geometry and inertia of its links, gravity, and tendons. The last link carries a
    tip mass.

    Links are bodies of revolution. The module `equations.spatial` uses these constants.
    """

    length: np.ndarray  # (n + 1,) m, the part before the first joint first
    mass: np.ndarray  # (n,)   kg, of the links behind joints; the part before the first joint is fixed
    centre: np.ndarray  # (n,)   m, from the joint to the centre of mass, on the link's axis
    lateral: np.ndarray  # (n,)   kg m^2, moment of inertia about an axis across the link through its centre of mass
    axial: np.ndarray  # (n,)   kg m^2, about the link's own axis
    rest: np.ndarray  # (n, 3, 3) rotation at each joint in the rest shape
    base: np.ndarray  # (3, 3) rotation of the part before the first joint; its third column is the base tangent
    gx: float  # m/s^2, gravity in fixed axes
    gy: float  # m/s^2
    gz: float  # m/s^2
    lever: np.ndarray  # (R, N) m, lever arm of each tendon at each coordinate, see `tendon`; no rows without tendons
    chord: np.ndarray  # (R, N) m, by which its path is shorter for each square of a coordinate: chords between guides
    tendon_stiffness: np.ndarray  # (R,) N/m
    pretension: np.ndarray  # (R,) N
    friction: np.ndarray  # (R,) coefficient of friction along the path
    slip_rate: np.ndarray  # (R,) m/s, over which friction changes its direction
    entry_friction: np.ndarray  # (R,) N, friction where the tendon enters the body
    beyond: np.ndarray  # (N, n + 1) fraction of a coordinate's path beyond the entry (1), then beyond each mid-arc
    share: np.ndarray  # (n + 1, S) fraction of each link that lies in each segment that lengthens; S may be 0
    spin: np.ndarray = STILL  # (2, 3) angular velocity and acceleration of the base in its axes, rad/s^1,2; or (0, 3)


class Links(NamedTuple):
    """Length, rest angle, mass and inertia of each link of a planar chain, for the recursion of the paper."""

    l: np.ndarray  # (n,) m
    theta0: np.ndarray  # (n,) rad
    m: np.ndarray  # (n,) kg
    c: np.ndarray  # (n,) m, from the joint to the centre of mass
    I: np.ndarray  # (n,) kg m^2, about it
    m_tip: float  # kg
    gx: float  # m/s^2
    gy: float  # m/s^2
    base_angle: float  # rad


class Joints(NamedTuple):
    """Springs and dampers of the joints of a planar chain, and the direction of the base tangent."""

    base_angle: float  # rad, the base tangent from +y
    theta0: np.ndarray  # (n,) rad, rest angle of each joint; theta0[0] is measured from the base tangent
    K: np.ndarray  # (n,) N m/rad
    D: np.ndarray  # (n,) N m s/rad
    hardening: np.ndarray  # (terms, n) K2 [N m/rad^2], K3 [N m/rad^3] ... and, if a spring has one, bound R [1/rad^2]
    unloaded: np.ndarray  # (n,) rad, theta0 without the shift by hysteresis; K2, K3 ... act on the angle from here
    spin: np.ndarray = AT_REST  # (2,) rate [rad/s] and acceleration [rad/s^2] of the base's turn, see `base`


class ExtensibleJoints(NamedTuple):
    """Springs and dampers of a planar chain whose segments lengthen: those of the n joints, then the axial ones of the
    S segments.

    Where no segment softens or stiffens, `hardening` has the columns of the joints alone; where no segment has
    hysteresis, `rest` is empty.
    """

    base_angle: float  # rad
    theta0: np.ndarray  # (n,) rad
    K: np.ndarray  # (n + S,) N m/rad; EA L [N m] of the segments
    D: np.ndarray  # (n + S,) N m s/rad; axial damping times L [N m s]
    hardening: np.ndarray  # (terms, n) or (terms, n + S), and R, see `Joints`; of the segments EA L times s and a
    unloaded: np.ndarray  # (n,) rad
    rest: np.ndarray  # (S,) strains at which the linear axial springs hold nothing, which hysteresis moves; or (0,)
    spin: np.ndarray = AT_REST  # (2,) rate [rad/s] and acceleration [rad/s^2] of the base's turn, see `base`


class SpatialJoints(NamedTuple):
    """Springs and dampers of a chain in space, for N coordinates: two swings and optionally a twist of each of n
    joints, then strains.

    For the plane there is `Joints`.
    """

    base_angle: float  # 0
    theta0: np.ndarray  # (N,) rad, 0
    K: np.ndarray  # (N,) N m/rad
    D: np.ndarray  # (N,) N m s/rad
    hardening: np.ndarray  # (terms, T + S), and R, of T angles and S strains; S = 0 if all axial springs are linear
    unloaded: np.ndarray  # (n,) 0
    line: np.ndarray  # (m, 3) linear functions of hysteresis in a step, see `spatial_memory`; no rows without it
    tied: np.ndarray  # (n, S) 1 where the strain of a segment changes the stiffness of a joint, else 0; S as above


class ObservedChain(NamedTuple):
    """Lengths of base part and links, from which the positions of points on a planar chain are computed.

    The module `equations.observation` uses them.
    """

    base_length: float  # m, from the origin to the first joint
    length: np.ndarray  # (n,) m, of the links, unstretched
    share: np.ndarray  # (n + 1, S) fraction of each link that lies in each segment that lengthens; S may be 0


class MemoryLaw(NamedTuple):
    """Parameters of the joints' hysteresis: creep, slip and Bouc-Wen branches, equal for all joints. The stiffness of a
    branch is given as a fraction of the joint's stiffness K.
    """

    creep_share: np.ndarray  # (P,) stiffness of each Prony branch, as a fraction of K
    creep_time: np.ndarray  # (P,) s, its relaxation time
    slip_share: np.ndarray  # (S,) stiffness of each Maxwell-slip element, as a fraction of K
    slip_angle: np.ndarray  # (S,) rad, the stretch at which it slips
    boucwen_share: float  # stiffness of the Bouc-Wen branch at z = 0, as a fraction of K
    boucwen_beta: float  # 1/rad^n
    boucwen_gamma: float  # 1/rad^n, at most beta in size
    boucwen_exponent: float  # n, at least 1


class AxialMemoryLaw(NamedTuple):
    """Parameters of the hysteresis of joints and of segments that lengthen. The stiffness of a branch is given as a
    fraction of the joint's stiffness K or of the segment's axial stiffness EA.
    """

    creep_share: np.ndarray  # (P,)
    creep_time: np.ndarray  # (P,) s
    slip_share: np.ndarray  # (S,)
    slip_angle: np.ndarray  # (S,) rad
    boucwen_share: float
    boucwen_beta: float  # 1/rad^n
    boucwen_gamma: float  # 1/rad^n
    boucwen_exponent: float
    axial_creep_share: np.ndarray  # (Q,)
    axial_creep_time: np.ndarray  # (Q,) s
    axial_slip_share: np.ndarray  # (R,)
    axial_slip_strain: np.ndarray  # (R,)


class ChamberConstants(NamedTuple):
    """Constants of one pressure chamber: torque law, viscoelastic lag and inflation of the wall.

    The module `equations.chamber` uses them.
    """

    law: np.ndarray  # (k,) numbers of the static torque law; of the polynomial in N m/Pa^i
    swell_share: float  # lagging fraction of the growth of the lever arm with pressure
    swell_time: float  # s, time constant of this lag
    inflation_limit: float  # Pa, pressure at which a neo-Hookean wall expands without bound; 0: a rigid wall
    inflation_time: float  # s, time constant of the wall
    inflation_jm: float  # J_m of a Gent wall, which limits its stretch; 0: neo-Hookean
    form: float  # number of the law in `equations.laws`


class ActuationConstants(NamedTuple):
    """Constants of all C pressure chambers of an actuator, and the gains of their torques at the n joints.

    A row of `law` and of `rubber` together are a `ChamberConstants`.
    """

    law: np.ndarray  # (C, k) numbers of the laws
    gain: np.ndarray  # (C, n) fraction of each chamber's torque at each joint; 1 by virtual work
    rubber: np.ndarray  # (C, 6) the last six entries of each `ChamberConstants`


class Interval(NamedTuple):
    """The pressure [Pa] of a chamber over a time interval: its values at the start, middle and end, and its mean."""

    start: float
    middle: float
    end: float
    mean: float


class Lag(NamedTuple):
    """A first-order valve with limits on the rates at which its pressure rises and falls."""

    rise: float  # s, time constant at rising pressure
    fall: float  # s, time constant at falling pressure
    rise_rate: float  # Pa/s
    fall_rate: float  # Pa/s


class Slopes(NamedTuple):
    """Link accelerations of a planar chain, and their derivatives by link angles and rates. Row l holds the derivatives
    by angle or rate l.

    `motion.acceleration_jacobian` writes them: entry [l, k] of a matrix is da_k / dphi_l or da_k / dw_l.
    """

    a: np.ndarray  # (n,) rad/s^2
    a_phi: np.ndarray  # (n, n)
    a_w: np.ndarray  # (n, n)


class Held(NamedTuple):
    """Scratch arrays of one time step with hysteresis of a planar chain: state at the start, joint turns, and modified
    springs.
    """

    phi: np.ndarray  # (n,) rad, at the start
    w: np.ndarray  # (n,) rad/s, at the start
    q: np.ndarray  # (n,) rad, at the start
    dq: np.ndarray  # (n,) rad, turn of each joint over the step
    creep_slope: np.ndarray  # (n,) slope of the creep part of r in the mid-step angle
    creep_offset: np.ndarray  # (n,) rad, offset of the same
    slope: np.ndarray  # (n,) slope of r of all branches
    offset: np.ndarray  # (n,) rad, offset of the same
    K: np.ndarray  # (n,) N m/rad, K of `springs`
    theta0: np.ndarray  # (n,) rad, theta0 of `springs`
    springs: Joints


class ExtensibleHeld(NamedTuple):
    """Scratch arrays of one time step of a planar chain in which all N = n + S coordinates have hysteresis: n joints,
    and S segments that lengthen.
    """

    phi: np.ndarray  # (N,) at the start
    w: np.ndarray  # (N,) at the start
    q: np.ndarray  # (N,) joint angles and strains at the start
    dq: np.ndarray  # (N,) their changes over the step
    creep_slope: np.ndarray  # (N,)
    creep_offset: np.ndarray  # (N,)
    slope: np.ndarray  # (N,)
    offset: np.ndarray  # (N,)
    K: np.ndarray  # (N,) that of `springs`
    theta0: np.ndarray  # (n,) that of `springs`
    rest: np.ndarray  # (S,) that of `springs`
    springs: ExtensibleJoints


class SpatialHeld(NamedTuple):
    """Scratch arrays of one time step with hysteresis of a chain in space, in which m of the N coordinates have
    hysteresis states: the joint angles or, where segments remember, all.
    """

    x: np.ndarray  # (N,) rad, at the start
    v: np.ndarray  # (N,) rad/s, at the start
    dq: np.ndarray  # (m,) rad, motion over the step
    line: np.ndarray  # (m, 3) r in mid-step: offset [rad], slope by the coordinate and by its partner
    springs: SpatialJoints  # springs of the step, with `line`


class Past(NamedTuple):
    """Hysteresis law of a chain, the present hysteresis states of its joints and segments, and scratch arrays of a
    step.
    """

    memory: MemoryLaw | AxialMemoryLaw
    state: np.ndarray  # (n, branches) rad; (n + S, branches) where segments remember; in space (m, branches)
    held: Held | ExtensibleHeld | SpatialHeld


class Workspace(NamedTuple):
    """Scratch arrays of one time step of a planar chain. The caller allocates them once, so that no kernel allocates
    memory.
    """

    A: np.ndarray  # (n, n)
    S: np.ndarray  # (n, n)
    c: np.ndarray  # (n,)
    s: np.ndarray  # (n,)
    t: np.ndarray  # (n + 1,)
    r: np.ndarray  # (n,)
    a: np.ndarray  # (n,)
    tau: np.ndarray  # (n,) N m, torque of the chambers at each joint


class ExtensibleWorkspace(NamedTuple):
    """Scratch arrays of one time step of a planar chain of n links with S extensible segments, N =
    n + S coordinates.
    """

    A: np.ndarray  # (N, N)
    c: np.ndarray  # (N,) of which n + 1 hold cosines
    s: np.ndarray  # (N,)
    t: np.ndarray  # (N + 1,)
    r: np.ndarray  # (N,)
    a: np.ndarray  # (N,)
    tau: np.ndarray  # (N,) N m, torque of the chambers at each joint and strain
    f: np.ndarray  # (N,)
    v: np.ndarray  # (N,)
    stretch: np.ndarray  # (n + 1,)
    ax: np.ndarray  # (n + 1,)
    ay: np.ndarray  # (n + 1,)
    bx: np.ndarray  # (n + 1,)
    by: np.ndarray  # (n + 1,)


class SpatialWorkspace(NamedTuple):
    """Scratch arrays of one time step of a chain in space with n links, N coordinates and R tendons.

    The module `equations.spatial` uses them.

    The first T = 2 n of its N coordinates (3 n with twist) are angles of joints, the last S are strains of segments.
    """

    A: np.ndarray  # (N, N)
    a: np.ndarray  # (N,)
    t: np.ndarray  # (N,)
    f: np.ndarray  # (N,)
    q: np.ndarray  # (N,) the coordinates in the middle of the step
    v: np.ndarray  # (N,) the rates there
    tau: np.ndarray  # (N + R,) inputs: torque along each coordinate [N m], then force k u or tension of each tendon [N]
    pull: np.ndarray  # (N,) N m, torques of the tendons without friction
    rub: np.ndarray  # (N,) N m, change of these torques by friction along the tendons
    start: np.ndarray  # (R,) N, forces of `tendon.signed_tension` at the start of the step
    tension: np.ndarray  # (R,) N, mean tensions at the base
    slope: np.ndarray  # (R,) their derivatives by the force at the end of the step
    arm: np.ndarray  # (R, N) m, lever arms of the tendons at the present coordinates
    run: np.ndarray  # (R, n + 1) 1 where a tendon slips towards the base, at its entry and at joints; -1 to the tip
    ease: np.ndarray  # (R, n + 1) s/m, slope of `run` by the rate of slip
    kept: np.ndarray  # (R, n + 1) fraction of the tension behind the entry and behind each joint
    felt: np.ndarray  # (R, N) fraction of the tension that acts on each coordinate
    B: np.ndarray  # (N, N) matrix of a move of Newton's method
    move: np.ndarray  # (N,) the move
    R: np.ndarray  # (n + 1, 3, 3) rotations of the links, the part before the first joint first
    r: np.ndarray  # (n + 1, 3) m, where they start
    P: np.ndarray  # (n, 3, 3) frames of the joints
    series: np.ndarray  # (n, 4) c2, c3 and their derivatives, of `spatial.stumpff`
    S: np.ndarray  # (T, 3) axes of the coordinates that turn
    E: np.ndarray  # (T, 3)
    F: np.ndarray  # (T, 3)
    N: np.ndarray  # (T, 3)
    C: np.ndarray  # (n, 3) kg m, first moment of each link with all beyond it
    J: np.ndarray  # (n, 3, 3) kg m^2, its inertia
    L: np.ndarray  # (n, 3) N
    M: np.ndarray  # (n, 3) N m
    omega: np.ndarray  # (3,) rad/s
    alpha: np.ndarray  # (3,) rad/s^2
    lift: np.ndarray  # (3,) m/s^2, acceleration of a joint, less gravity
    turn: np.ndarray  # (3,) rad/s
    stretch: np.ndarray  # (n + 1,) of each link, the part before the first joint first
    growth: np.ndarray  # (n + 1,) 1/s, rates of the stretches
    length: np.ndarray  # (n + 1,) m, stretched
    centre: np.ndarray  # (n,) m, stretched
    lateral: np.ndarray  # (n,) kg m^2, stretched
    h: np.ndarray  # (n + 1,) kg m, first moment along each link of its mass and the mass beyond it, unstretched
    second: np.ndarray  # (n + 1,) kg m^2, second moment of the same
    along: np.ndarray  # (n + 1,) N m or kg m^2, inertial force along each link's axis times its length


class Sight(NamedTuple):
    """What a row of a measurement may depend on, and the scratch arrays from which it is computed. All hold numbers
    that carry derivatives.

    Entries that a body does not have are NaN: z and turn in the plane; in space angles and axes, except for further
    kinds.
    """

    x: np.ndarray  # (N,) coordinates
    links: np.ndarray | SpatialWorkspace  # (5, n + 1) of `observation.place_links`, or a pose in space
    p: np.ndarray  # (3,) m, of the point
    angle: np.ndarray  # (2,) rad, of its link and of the link before it; in space from the base's axis
    turn: np.ndarray  # (3,) rad, orientation of its link, see `spatial_observation.look`
    E: np.ndarray  # (3, 3) measured rotation of its link
    axes: np.ndarray  # (3, 3) axes of its link in fixed axes, as columns; in the plane the first two rows and columns


class StepSlopes(NamedTuple):
    """Jacobian of one time step of a chain, and the scratch arrays with which it is computed.

    The arrays except J hold numbers that carry derivatives. `linearised.step_jacobian` writes the Jacobian.
    """

    J: np.ndarray  # (3N + R, 2N) by coordinates, rates, torques and commands of tendons
    x: np.ndarray  # (N,)
    v: np.ndarray  # (N,)
    work: Workspace | ExtensibleWorkspace | SpatialWorkspace
