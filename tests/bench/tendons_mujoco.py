"""Arms with tendons in space, and the same arms with the spatial tendons of MuJoCo.

MuJoCo computes the body and the tendons: rods on ball joints with MuJoCo's springs and dampers, and `spatial` tendons
through sites on the rods. An actuator on each tendon pulls with a known tension T, or, at a known displacement u, with
T = max(0, k (u + change of length) + T_0).

In pliant, a tendon shortens by g . x, as along an arc. In MuJoCo, a tendon is straight between two guides, at a
distance e before and behind a joint and r from the axis. If the joint swings by theta towards the tendon, the guides
are 2 e cos(theta/2) - 2 r sin(theta/2) apart instead of 2 e - r theta, and the lever is
r cos(theta/2) + e sin(theta/2) instead of r. To first order, a chord therefore acts as a spring of stiffness -e T / 2
at each joint. A twist c lengthens the chord by about (r c)^2 / (4 e). At theta = 2 arctan(e / r) the two guides meet.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from pliant.mechanics import mechanics_of
from pliant.model import Model, Space, Station, Tendon, chain_model
from pliant.simulation import equilibrium

LENGTH, MASS, RADIUS = 0.3, 0.09, 0.02  # m, kg, m
REACH, GAP = 0.012, 0.75e-3  # m, distances of the guides from the axis and from a joint
AZIMUTHS = {"red": 0.4, "green": 2.3}
BENDING, RETARDATION = 0.06, 1.0 / 300.0  # N m^2; s, damping in parts of the stiffness
ELASTIC = {"line_stiffness": 4e3, "pretension": 1.0}  # N/m, N, of tendons with a known displacement
STRONGEST = 1e6  # N, limit of an actuator
TINY = 1e-60  # under a root, so that it has a derivative at 0


def arm(driven_by: str, links: int, coarse: int = 5) -> Model:
    """Return the chain of so many links in the middle of all ranges.

    The stations are where segments end in a chain of `coarse` links, of which `links` is a multiple.
    """
    cord = {"driven_by": driven_by, "lever": REACH, **(ELASTIC if driven_by != "tension" else {})}
    ends = links // coarse * (np.arange(1, 4) * coarse // 3) - 1  # links whose segments end at the stations
    stiffness, along = BENDING * links / LENGTH, 0.5 * LENGTH / links
    return chain_model(
        length=LENGTH, mass=MASS, links=links, joint_placement="midsegment", gravity=(0.0, 0.0, 9.81),
        stiffness=stiffness, damping=RETARDATION * stiffness, space=Space(twist_ratio=1.0, radius=RADIUS),
        chambers=[Tendon.at_azimuth(a, np.ones(links), name=name, **cord) for name, a in AZIMUTHS.items()],
        stations=[Station("mid", int(ends[0]), along), Station("side", int(ends[1]), along, 0.0, 0.03),
                  Station("tip", int(ends[2]), along)],
    )  # fmt: skip


def lever_of(tendon: Tendon) -> np.ndarray:
    """Return the levers (2,) of a tendon at the two bends of a joint, m."""
    return tendon.lever * np.array([np.mean(tendon.joint_gain), np.mean(tendon.cross_gain)])


def in_mujoco(model: Model, gap: float = GAP) -> mujoco.MjModel:
    """Return the arm of a model: a rod for each link, guides at a `gap` [m] before and behind each joint."""

    def sites(rod: int, *along: float) -> str:
        places = [(c.name, i, *lever_of(c), z) for c in model.chambers for i, z in enumerate(along)]
        return "".join(f'<site name="{c}_{rod}_{i}" pos="{y:.17g} {-x:.17g} {z:.17g}"/>' for c, i, x, y, z in places)

    before, rods, end = model.base_length, sites(0, model.base_length - gap), "</body>" * model.n
    for k, (length, m) in enumerate(zip(model.link_length, model.link_mass, strict=True), start=1):
        across, along = m * (length**2 / 12 + RADIUS**2 / 4), 0.5 * m * RADIUS**2
        rods += (
            f'<body pos="0 0 {before:.17g}">'
            f'<joint type="ball" stiffness="{model.stiffness[k - 1]:.17g}" damping="{model.damping[k - 1]:.17g}"/>'
            f'<inertial pos="0 0 {length / 2:.17g}" mass="{m:.17g}" diaginertia="{across} {across} {along}"/>'
            + sites(k, *([gap, length - gap] if k < model.n else [gap]))
        )
        before = length
    paths = drives = ""
    for c in model.chambers:
        path = ["0_0", *(f"{k}_{i}" for k in range(1, model.n) for i in (0, 1)), f"{model.n}_0"]
        paths += f'<spatial name="{c.name}">' + "".join(f'<site site="{c.name}_{s}"/>' for s in path) + "</spatial>"
        gain = c.line_stiffness if c.elastic else 1.0
        drives += f'<general tendon="{c.name}" gainprm="{-gain}" biastype="affine" forcerange="{-STRONGEST} 0"/>'
    text = f'<option gravity="0 0 9.81" integrator="RK4"/><worldbody>{rods}{end}</worldbody><tendon>{paths}</tendon>'
    made = mujoco.MjModel.from_xml_string(f"<mujoco>{text}<actuator>{drives}</actuator></mujoco>")
    for i, c in enumerate(model.chambers):
        if c.elastic:
            made.actuator_biasprm[i, :2] = c.line_stiffness * made.tendon_length0[i] - c.pretension, -c.line_stiffness
    return made


def at_rest(made: mujoco.MjModel, level: np.ndarray) -> mujoco.MjData:
    """Return the arm at rest under constant inputs (C,): dampers so strong that it creeps there in large steps."""
    slow = copy.copy(made)
    slow.opt.integrator, slow.opt.timestep = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, 0.05
    slow.dof_damping[:] = slow.jnt_stiffness[0]  # N m s
    data = mujoco.MjData(slow)
    data.ctrl[:] = level
    mujoco.mj_step(slow, data, 800)
    mujoco.mj_forward(slow, data)
    if np.abs(data.qvel).max() > 1e-9:
        raise RuntimeError(f"MuJoCo's arm still moves by {np.abs(data.qvel).max():.1e} rad/s")
    return data


def shown(model: Model, data: mujoco.MjData) -> np.ndarray:
    """Return the positions (S, 3) of a model's stations on MuJoCo's arm, m."""
    turned = data.xmat.reshape(-1, 3, 3)
    return np.array([data.xpos[s.link + 1] + turned[s.link + 1] @ (s.aside, 0.0, s.along) for s in model.stations])


def chord_excess(x: np.ndarray, model: Model, gap: float) -> np.ndarray:
    """Return how much longer than arcs the chords are, (..., R, n), m, of tendons R at coordinates x (..., 3 n)."""
    n = model.n
    lever = np.array([lever_of(c) for c in model.chambers])
    bent, c = x[..., : 2 * n].reshape(*x.shape[:-1], 1, n, 2), x[..., None, 2 * n :]
    theta = np.sqrt((bent**2).sum(axis=-1) + TINY)
    a, b = bent[..., 0] / theta, bent[..., 1] / theta  # the axis of the swing
    X, Y = lever[:, 1, None], -lever[:, 0, None]
    x2, y2 = np.cos(c) * X - np.sin(c) * Y, np.sin(c) * X + np.cos(c) * Y  # the guide behind, after the twist
    cos, sin, along = np.cos(theta), np.sin(theta), (1.0 - np.cos(theta)) * (a * x2 + b * y2)
    chord = [cos * x2 + sin * b * gap + along * a - X, cos * y2 - sin * a * gap + along * b - Y,
             cos * gap + sin * (a * y2 - b * x2) + gap]  # fmt: skip
    arc = 2.0 * gap - (bent * lever[:, None]).sum(axis=-1)
    return np.sqrt(sum(part * part for part in chord)) - arc


def with_chords(x: np.ndarray, level: np.ndarray, model: Model, gap: float) -> np.ndarray:
    """Return torques (3 n,) [N m] and commands (R,) [N] behind them that make pliant's tendons follow the chords."""
    n, columns = model.n, (slice(0, 2 * model.n, 2), slice(1, 2 * model.n, 2), slice(2 * model.n, None))
    moved = np.tile(x.astype(complex), (3, 1))
    for row, column in zip(moved, columns, strict=True):
        row[column] += 1e-30j
    excess, slope = chord_excess(moved, model, gap), np.empty((len(model.chambers), 3 * n))
    for ways, column in zip(excess.imag / 1e-30, columns, strict=True):
        slope[:, column] = ways
    k, T0, *_ = model.actuation.tendon_constants
    command = model.actuation.joint_torques(level)[3 * n :] + k * excess[0].real.sum(axis=1)
    T = np.maximum(0.0, T0 + command - k * (model.actuation.levers @ x))
    return np.append(-T @ slope, command)


def rest_with_chords(model: Model, level: np.ndarray, gap: float) -> np.ndarray:
    """Return coordinates (3 n,) of a chain at rest whose tendons follow chords, by Newton's method with a part step."""
    chain, x, change = mechanics_of(model), equilibrium(model, level), np.inf
    for _ in range(200):
        torque = with_chords(x, level, model, gap)
        change = np.linalg.solve(-chain.static_slope(x, None, torque), chain.static_forces(x, torque))
        if np.abs(change).max() < 1e-13:
            return x
        x = x + 0.7 * change
    raise RuntimeError(f"no rest found with chords: the last change is {np.abs(change).max():.1e} rad")
