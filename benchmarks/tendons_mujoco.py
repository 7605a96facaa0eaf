"""Compare tendons in space with the spatial tendons of MuJoCo, and count how often intervals contain the true values.

MuJoCo computes the body and the tendons: rods on ball joints with MuJoCo's springs and dampers, and `spatial` tendons
through sites on the rods. An actuator on each tendon pulls with a known tension T, or, at a known displacement u, with
T = max(0, k (u + change of length) + T_0). Python only sets the inputs, at every stage of a Runge-Kutta step.

In pliant, a tendon shortens by g . x, as along an arc. In MuJoCo, a tendon is straight between two guides, at a
distance e before and behind a joint and r from the axis. If the joint swings by theta towards the tendon, the guides
are 2 e cos(theta/2) - 2 r sin(theta/2) apart instead of 2 e - r theta, and the lever is
r cos(theta/2) + e sin(theta/2) instead of r. To first order, a chord therefore acts as a spring of stiffness -e T / 2
at each joint. A twist c lengthens the chord by about (r c)^2 / (4 e). At theta = 2 arctan(e / r) the two guides meet.

`check` prints how far the motions of MuJoCo and pliant are apart, and how far if the same chords are added to pliant's
equations. The rest is due to the springs and dampers of a ball joint, which act on one rotation vector and on the
angular velocity, and not on swing, twist and their rates.

In a count, each seed draws stiffness and damping of the body, and distance and azimuth of both tendons; with known
displacements, also line stiffness and pretension. Two records show three stations, one of them beside the axis, with
noise of 1 mm. Percentages are as in intervals_in_space.py. The bias is the mean error of a parameter, in % of its value
and in standard errors of one fit. With a gap of 0, pliant simulates the records, with tendons along arcs. What is
left of the bias then comes from fitting fewer links than the body has.

Usage: python benchmarks/tendons_mujoco.py check
       python benchmarks/tendons_mujoco.py tension|displacement [seeds] [first] [links,links] [rods] [gap in mm]
"""

from __future__ import annotations

import copy
import sys
from functools import cache

import mujoco
import numpy as np
from intervals_in_space import FAR, KNOTS, LENGTH, MASS, NOISE, RADIUS, STEP, TIMES, count, record
from scipy.integrate import solve_ivp

from pliant.identification import FitResult, Parameter, fit, predict
from pliant.identification.parameters import apply
from pliant.mechanics import mechanics_of
from pliant.model import Model, Space, Station, Tendon, chain_model
from pliant.simulation import equilibrium

REACH, GAP = 0.012, 0.75e-3  # m, distances of the guides from the axis and from a joint
AZIMUTHS = {"red": 0.4, "green": 2.3}
BENDING, RETARDATION = 0.06, 1.0 / 300.0  # N m^2; s, damping in parts of the stiffness
ELASTIC = {"line_stiffness": 4e3, "pretension": 1.0}  # N/m, N, of tendons with a known displacement
RECORDS = {
    "tension": {
        "first": {"red": (0.0, 5.5, 5.5, 1.5, 0.0, 2.5), "green": (0.0, 0.0, 2.5, 5.5, 2.0, 0.0)},
        "second": {"red": (0.0, 2.5, 5.5, 3.0, 4.0, 0.0), "green": (0.0, 4.5, 1.0, 0.0, 3.0, 1.5)},
    },  # N
    "displacement": {
        "first": {"red": (0.0, 4e-3, 4e-3, 0.0, -1e-3, 2e-3), "green": (0.0, -1e-3, 2e-3, 4e-3, 2e-3, -1e-3)},
        "second": {"red": (0.0, 2e-3, 4e-3, 3e-3, 4e-3, -1e-3), "green": (0.0, 4e-3, -1e-3, -1e-3, 3e-3, 1e-3)},
    },  # m; slack where it is let out
}
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


def moved(model: Model, levels: dict[str, tuple[float, ...]], gap: float = GAP) -> np.ndarray:
    """Return positions (T, S, 3) of the stations, m: MuJoCo's motion from rest, with the links of a model as rods."""
    made = in_mujoco(model, gap)
    fastest = 4.0 * model.damping[0] / (0.5 * model.link_mass[-1] * RADIUS**2)  # 1/s, decay of a twist of the last rod
    every = int(np.ceil((TIMES[1] - TIMES[0]) * fastest / 2.6))  # Runge-Kutta steps are stable up to 2.78
    made.opt.timestep = (TIMES[1] - TIMES[0]) / every
    halves = 0.5 * made.opt.timestep * np.arange(2 * every * TIMES.size + 1)
    inputs = np.column_stack([np.interp(halves, KNOTS, levels[c.name]) for c in model.chambers])
    data = mujoco.MjData(made)
    data.qpos[:] = at_rest(made, inputs[0]).qpos
    out = np.empty((TIMES.size, len(model.stations), 3))
    widest = 2.0 * np.arctan(gap / max(np.hypot(*lever_of(c)) for c in model.chambers))  # rad, where two guides meet

    def act(made: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.ctrl[:] = inputs[round(2.0 * data.time / made.opt.timestep)]

    mujoco.set_mjcb_control(act)
    try:
        for k in range(TIMES.size):
            mujoco.mj_kinematics(made, data)
            out[k] = shown(model, data)
            if np.abs(data.qpos[::4]).min() < np.cos(0.5 * widest):
                raise RuntimeError(f"a joint swings by {widest:.3f} rad or more, where two guides meet: widen the gap")
            mujoco.mj_step(made, data, every)
    finally:
        mujoco.set_mjcb_control(None)
    if any(w.number for w in data.warning):
        raise RuntimeError("MuJoCo's motion is unstable: widen the gap")
    return out


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


def motion_with_chords(model: Model, levels: dict[str, tuple[float, ...]], gap: float) -> np.ndarray:
    """Return positions (T, S, 3) [m] of a chain whose tendons follow chords: pliant's equations, by SciPy's LSODA."""
    chain, n = mechanics_of(model), model.size
    (body, joints, work), kernel, a = chain.parts(), chain.acceleration(), np.empty(model.size)

    def level(time: float) -> np.ndarray:
        return np.array([np.interp(time, KNOTS, levels[c.name]) for c in model.chambers])

    def rates(time: float, state: np.ndarray) -> np.ndarray:
        x, v = state[:n].copy(), state[n:].copy()
        kernel(x, v, with_chords(x, level(time), model, gap), body, joints, work, a)
        return np.append(v, a)

    start = np.append(rest_with_chords(model, level(0.0), gap), np.zeros(n))
    states = solve_ivp(rates, (0.0, TIMES[-1]), start, method="LSODA", t_eval=TIMES, rtol=1e-7, atol=1e-9).y.T
    return np.array([chain.stations(x)[0] for x in states[:, :n]])


def drawn(driven_by: str, links: int, rng: np.random.Generator | None = None) -> dict[str, float]:
    """Return random values of all parameters of one body; values in the middle without `rng`."""

    def near(value: float, part: float = 0.25) -> float:
        return value * (1.0 if rng is None else rng.uniform(1.0 - part, 1.0 + part))

    stiffness = BENDING * links / LENGTH
    values = {"stiffness": near(stiffness), "damping": near(RETARDATION * stiffness)}
    for name, middle in AZIMUTHS.items():
        size, azimuth = near(1.0), middle + 0.15 * (near(1.0, 1.0) - 1.0)
        values |= {f"{name}.gain_x": -size * np.sin(azimuth), f"{name}.gain_y": size * np.cos(azimuth)}
        if driven_by != "tension":
            values |= {f"{name}.{number}": near(value) for number, value in ELASTIC.items()}
    return values


@cache
def seen(driven_by: str, seed: int, rods: int, coarse: int, gap: float) -> dict[str, np.ndarray]:
    """Return the motions (T, S, 3) [m] of one body of so many rods; `coarse` places the stations as in `arm`.

    With a gap of 0, pliant simulates the body, with tendons along arcs.
    """
    truth = drawn(driven_by, rods, np.random.default_rng([seed, 5]))
    body = apply(arm(driven_by, rods, coarse), truth)
    if gap:
        return {name: moved(body, levels, gap) for name, levels in RECORDS[driven_by].items()}
    return {name: of_pliant(body, levels) for name, levels in RECORDS[driven_by].items()}


def of_pliant(model: Model, levels: dict[str, tuple[float, ...]]) -> np.ndarray:
    """Return positions (T, S, 3) of the stations, m: pliant's motion from rest in small steps."""
    still = np.zeros((TIMES.size, len(model.stations), 3))
    return np.asarray(predict(model, record("levels", still, levels, np.random.default_rng(0)), {}, 2.5e-4)["position"])


def check() -> None:
    """Print how far the motions of MuJoCo and pliant are apart for the same parameters."""

    def rms(difference: np.ndarray) -> float:
        return 1e3 * float(np.sqrt((difference**2).sum(axis=-1).mean()))

    print("rms distance of the stations, mm")
    print("driven by     rods  gap (mm)  pliant   pliant with chords")
    cases = [(kind, rods, part, False) for kind in RECORDS for rods in (5, 10) for part in (2, 20)]
    for driven_by, rods, part, alone in [*cases, ("tension", 5, 20, True)]:
        levels = dict(RECORDS[driven_by]["first"])
        if alone:
            levels["green"] = (0.0,) * KNOTS.size  # the arm stays in a plane
        model, gap = arm(driven_by, rods), LENGTH / rods / part
        true = moved(model, levels, gap)
        off = rms(of_pliant(model, levels) - true), rms(motion_with_chords(model, levels, gap) - true)
        print(
            f"{driven_by:12} {rods:4} {1e3 * gap:9.3g} {off[0]:8.4f} {off[1]:12.2g}",
            *["one tendon"] * alone,
            flush=True,
        )


def main(driven_by: str, seeds: range, links: int, rods: int, coarse: int, gap: float) -> None:
    """Count the intervals of arms with tendons, and print the bias of each parameter."""
    begin = drawn(driven_by, links)
    errors = []

    def fitted(seed: int) -> tuple[dict[str, float], FitResult]:
        rng, motions = np.random.default_rng([seed, 6]), seen(driven_by, seed, rods, coarse, gap)
        truth = drawn(driven_by, links, np.random.default_rng([seed, 5]))
        records = [record(name, motions[name], levels, rng) for name, levels in RECORDS[driven_by].items()]
        start = [Parameter(name, value) for name, value in begin.items()]
        found = fit(records, arm(driven_by, links, coarse), start, time_step=STEP, starts=1)
        if max(found.rmse.values()) <= FAR * NOISE:
            std = {p.name: p.std for p in found.parameters}
            off = {n: found.values[n] - truth[n] for n in begin}
            errors.append([(100.0 * off[n] / abs(truth[n]), off[n] / std[n]) for n in begin])
        return truth, found

    print(f"{driven_by}, {links} links, {rods} rods, gap {1e3 * gap:.3g} mm")
    count(seeds, list(begin), fitted)
    (part, score), root = np.moveaxis(np.array(errors), 2, 0), np.sqrt(len(errors))
    for n, values, z in zip(begin, part.T, score.T, strict=True):
        bias = f"{values.mean():+6.2f} +- {values.std(ddof=1) / root:.2f} %"
        print(f"  {n:24} bias {bias}, {z.mean():+5.2f} standard errors", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["check"]:
        check()
    else:
        kind, *words = sys.argv[1:] or ["tension"]
        given = dict(zip(("seeds", "first", "links", "rods", "gap"), words, strict=False))
        chains = [int(n) for n in given.get("links", "10,5").split(",")]
        first, number = int(given.get("first", 0)), int(given.get("seeds", 20))
        for n in chains:
            main(kind, range(first, first + number), n, int(given.get("rods", 10)), min(chains),
                 1e-3 * float(given.get("gap", 1e3 * GAP)))  # fmt: skip
