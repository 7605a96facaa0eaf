"""Random arms in space: MuJoCo's motion, and the errors of a fit to it in standard errors.

The body is MuJoCo's: three rods on ball joints, driven by three chambers. Its mechanics share no code with pliant. The
torques at a joint, a spring and a damper on swing and twist, are computed here in MuJoCo's angular velocities, at every
stage of its Runge-Kutta steps. Each seed draws stiffness, damping, and the gain and azimuth of each chamber, within
25 % and 0.15 rad of the middle. Two records show three stations, one of them beside the axis, with white noise of 1 mm.
With twist, the torsional stiffness is drawn and fitted too, and in a third record a known force pulls at the station
beside the axis: without it the data hardly determine the torsional stiffness.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from harness import in_standard_errors

from pliant.identification import Experiment, Parameter, fit
from pliant.model import Chamber, Model, Space, Station, chain_model
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce

LINKS, LENGTH, MASS, RADIUS, LAW = 3, 0.3, 0.09, 0.02, 2e-6  # m, kg, m, N m/Pa
PARTS = np.array([LENGTH / 6, LENGTH / 3, LENGTH / 3, LENGTH / 6])  # m, the rigid one at the base first
TIMES = np.arange(0.0, 1.0, 0.01)  # s
KNOTS = np.array([0.05, 0.15, 0.4, 0.5, 0.7, 0.8])  # s
RECORDS = {
    "first": {"red": (0.0, 6e4, 6e4, 0.0, 0.0, 2e4), "green": (0.0, 0.0, 3e4, 6e4, 0.0, 0.0)},
    "second": {"blue": (0.0, 6e4, 6e4, 0.0, 0.0, 4e4), "red": (0.0, 0.0, 5e4, 5e4, 1e4, 0.0)},
}  # Pa
PULLED = {"pulled": {"green": (0.0, 2e4, 4e4, 0.0, 0.0, 2e4)}}  # beside a force
FORCE = np.array([0.0, 0.4, -0.4, 0.2, 0.2, 0.0])[:, None] * [0.0, 1.0, 0.0]  # N, at the knots, at the point `side`
AZIMUTHS = {"red": np.pi / 2, "green": np.pi * 7 / 6, "blue": np.pi * 11 / 6}
MIDDLE = {"stiffness": 0.6, "damping": 4e-3}
POINTS = (("mid", 0, 0.08, 0.0), ("side", 1, 0.05, 0.03), ("tip", 2, 0.05, 0.0))  # name, link, along and aside it, m
FAR = 2.5  # root-mean-square distances of a fit that ended elsewhere, in noise: sqrt(3) where it did not
NOISE, STEP, TICK = 1e-3, 2e-3, 5e-4  # m, s of a step of the fit and of MuJoCo


def chain() -> Model:
    """Return the chain in the middle of all ranges."""
    chambers = [Chamber(torque=[LAW], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=n) for n, a in AZIMUTHS.items()]
    return chain_model(
        length=LENGTH, mass=MASS, links=LINKS, joint_placement="midsegment", gravity=(0.0, 0.0, 9.81), **MIDDLE,
        chambers=chambers, space=Space(twist_ratio=1.0, radius=RADIUS),
        stations=[Station(name, link, along, 0.0, aside) for name, link, along, aside in POINTS],
    )


def middle() -> dict[str, float]:
    """Return the values of all parameters in the middle of their ranges."""
    gains = {n: {f"{n}.gain_x": np.sin(a), f"{n}.gain_y": -np.cos(a)} for n, a in AZIMUTHS.items()}
    return {**MIDDLE, "stiffness_ratio": 1.0, **{k: v for pair in gains.values() for k, v in pair.items()}}


def drawn(rng: np.random.Generator, *, twist: bool = False) -> dict[str, float]:
    """Return random values of all parameters of one body."""
    truth = {name: value * rng.uniform(0.75, 1.25) for name, value in MIDDLE.items()}
    truth["stiffness_ratio"] = 1.0
    for name, azimuth in AZIMUTHS.items():
        a, size = azimuth + rng.uniform(-0.15, 0.15), rng.uniform(0.75, 1.25)
        truth |= {f"{name}.gain_x": size * np.sin(a), f"{name}.gain_y": -size * np.cos(a)}
    return truth | ({"twist_ratio": rng.uniform(0.6, 1.0)} if twist else {})


def arm() -> mujoco.MjModel:
    """Return the arm in MuJoCo, hanging from the origin along +z; `moved` adds the torques of the joints' springs."""
    density = MASS / LENGTH
    text = end = ""
    for length, before in zip(PARTS[1:], PARTS[:-1], strict=True):
        m = density * length
        across, along = m * (length**2 / 12 + RADIUS**2 / 4), 0.5 * m * RADIUS**2
        text += (
            f'<body pos="0 0 {before}"><joint type="ball"/><inertial pos="0 0 {length / 2}" mass="{m}" '
            f'diaginertia="{across} {across} {along}"/>'
        )
        end += "</body>"
    option = f'<option timestep="{TICK}" gravity="0 0 9.81" integrator="RK4"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{text}{end}</worldbody></mujoco>")


def moment_of(q: np.ndarray, rate: np.ndarray, force: np.ndarray, spring: np.ndarray, damper: np.ndarray) -> np.ndarray:
    """Return the moment in the frame of a joint at quaternion q whose body turns at `rate` (3,) [rad/s].

    Its work is (force - spring x - damper x') . dx for x = (a, b, c), the swing before a twist c about the link: its
    angular velocity there is Rz(c)^T J_r (da, db, 0) + z dc.
    """
    c = 2.0 * np.arctan2(q[3], q[0])
    bent = np.hypot(q[1], q[2])
    size = 2.0 * np.arcsin(min(bent, 1.0))
    cos, sin = np.cos(0.5 * c), np.sin(0.5 * c)
    axis = np.array([q[1] * cos - q[2] * sin, q[2] * cos + q[1] * sin]) / (bent or 1.0)
    a, b = size * axis
    K = np.array([[0.0, 0.0, b], [0.0, 0.0, -a], [-b, a, 0.0]])
    y = size * size
    second, third = (0.5, 1 / 6) if y < 1e-8 else ((1 - np.cos(size)) / y, (size - np.sin(size)) / (y * size))
    right = np.eye(3) - second * K + third * K @ K
    turn = np.array([[np.cos(c), np.sin(c), 0.0], [-np.sin(c), np.cos(c), 0.0], [0.0, 0.0, 1.0]])
    turns = np.column_stack([(turn @ right)[:, :2], [0.0, 0.0, 1.0]])
    held = spring * (a, b, c) + damper * np.linalg.solve(turns, rate)
    return np.linalg.solve(turns.T, [force[0] - held[0], force[1] - held[1], -held[2]])


def moved(
    truth: dict[str, float], levels: dict[str, tuple[float, ...]],
    forces: Callable[[np.ndarray, mujoco.MjData], np.ndarray], tick: float = TICK, pull: np.ndarray | None = None,
) -> np.ndarray:
    """Positions (T, S, 3) of the stations, m: MuJoCo's motion from rest, in steps of a `tick` [s].

    `forces` makes the generalised forces of the joints (LINKS, 2) or (2,) [N m] from the inputs (C,) of a moment and
    the state; `pull` (K, 3) [N] is a force at the station `side`, at the knots. All act at each of the four stages of a
    step, as the springs do: held over a step they would lag by half of it.
    """
    model = arm()
    model.opt.timestep = tick
    data = mujoco.MjData(model)
    every = round((TIMES[1] - TIMES[0]) / tick)
    alike = np.array([1.0, 1.0, truth.get("twist_ratio", 1.0)])
    spring, damper = truth["stiffness"] * alike, truth["damping"] * alike
    _, link, along, aside = POINTS[1]

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        inputs = np.array([np.interp(data.time, KNOTS, p) for p in levels.values()])
        for j, force in enumerate(np.broadcast_to(forces(inputs, data), (LINKS, 2))):
            mine = slice(3 * j, 3 * j + 3)
            data.qfrc_applied[mine] = moment_of(data.qpos[4 * j : 4 * j + 4], data.qvel[mine], force, spring, damper)
        if pull is not None:
            now = np.array([np.interp(data.time, KNOTS, row) for row in pull.T])
            mujoco.mj_applyFT(model, data, now, np.zeros(3), place(data, link, along, aside), link + 1,
                              data.qfrc_applied)  # fmt: skip

    out = np.empty((TIMES.size, len(POINTS), 3))
    mujoco.set_mjcb_control(act)
    try:
        for k in range(TIMES.size):
            mujoco.mj_kinematics(model, data)
            out[k] = [place(data, *point[1:]) for point in POINTS]
            mujoco.mj_step(model, data, every)
    finally:
        mujoco.set_mjcb_control(None)
    return out


def place(data: mujoco.MjData, link: int, along: float, aside: float) -> np.ndarray:
    """Return the position (3,) of a point of a link, m."""
    return data.xpos[link + 1] + data.xmat[link + 1].reshape(3, 3) @ (aside, 0.0, along)


def seen(
    truth: dict[str, float], levels: dict[str, tuple[float, ...]], pull: np.ndarray | None = None,
) -> np.ndarray:
    """Return positions (T, S, 3) of the stations under pressures, m."""
    gains = LAW * np.array([[truth[f"{n}.gain_x"], truth[f"{n}.gain_y"]] for n in levels])
    return moved(truth, levels, lambda pressure, _: pressure @ gains, pull=pull)


def record(
    name: str, shape: np.ndarray, levels: dict[str, tuple[float, ...]], rng: np.random.Generator,
    pull: np.ndarray | None = None,
) -> Experiment:
    """Return a record of a shape (T, S, 3) [m] with noise, under inputs of given levels and a known force at `side`."""
    drives = {c: Trace(KNOTS, np.array(p)) for c, p in levels.items()}
    noisy = shape + NOISE * rng.standard_normal(shape.shape)
    forces = () if pull is None else (PointForce(KNOTS, pull, "side"),)
    return Experiment(name, TIMES, noisy, tuple(p[0] for p in POINTS), "trace", drives=drives, forces=forces)


def errors(seed: int, *, twist: bool = False, stated: bool = True) -> dict[str, float]:
    """Return errors of all parameters of one body in standard errors; {} if the fit does not reach the noise.

    Without `stated`, the fit has no start values, and a model whose stiffness is wrong by a factor of 1/100 to 100.
    """
    rng = np.random.default_rng([seed, 3])
    truth, records = drawn(rng, twist=twist), []
    for name, levels in (RECORDS | (PULLED if twist else {})).items():
        pull = FORCE if name in PULLED else None
        records.append(record(name, seen(truth, levels, pull), levels, rng, pull))
    begin = middle() | ({"twist_ratio": 0.8} if twist else {})
    start = [Parameter(name, value if stated else None) for name, value in begin.items()]
    off = 1.0 if stated else 10.0 ** rng.uniform(-2, 2)
    model = chain().with_(stiffness=off * MIDDLE["stiffness"], damping=off * MIDDLE["damping"])
    result = fit(records, model, start, time_step=STEP, starts=1)
    if max(result.rmse.values()) > FAR * NOISE:
        return {}
    return in_standard_errors(result, truth)
