"""Time a step in space beside plain C, and a motion beside MuJoCo at equal errors of the tip.

The body is an arm of 0.17 m and 69 g in five links, released from a bend in space under gravity across it. Each joint
has the same stiffness in its three directions, so that MuJoCo's ball joints carry the same springs; the difference
between the tips of the two models is printed. Every method is compared with itself at a tiny step. pliant's methods are
the midpoint rule and its extrapolation, with and without the short first steps of `simulate(..., graded=True)`, which
MuJoCo takes too where they help it. The step with six tendons, some of them taut and some slack, is compared with the
step without tendons. The shortest processor time of many runs counts; `--seconds S` sets the duration.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, partial
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from harness import parser_of, table
from numba import njit
from scipy.spatial.transform import Rotation
from speed.kernels import FLAGS, POINTER, shared_library
from speed.race import INTEGRATORS
from speed.timing import best, machine

from pliant.compiler.choose import twin
from pliant.compiler.twin import options, rebuild
from pliant.equations import motion, spatial
from pliant.mechanics import mechanics_of
from pliant.model import Model, Tendon, chain_model

Array = np.ndarray
LINKS, RADIUS, LENGTH, MASS = 5, 0.012, 0.17, 0.069
STIFFNESS, DAMPING = 1.6067, 8e-3  # N m/rad, N m s/rad, of each joint
END, LOOKS = 1.0, 100  # s, and how often the tip is compared
TENDONS = 6
TARGETS = (1.0, 0.1, 0.02)  # mm
STEPS = [1e-2 / k for k in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 64, 100, 160, 250, 400, 800)]  # s
FINEST = 1e-2 / 4000
FIRST = (1 / 32, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)  # parts of the first graded step; the second has two halves
METHODS = {"midpoint": {}, "midpoint, graded": {"graded": True}, "extrapolated": {"extrapolated": True},
           "extrapolated, graded": {"extrapolated": True, "graded": True}}  # fmt: skip
CALLS = 20_000


def body(turns: int, tendons: int = 0) -> Model:
    """Return the arm with 1 turn at each joint (in a plane), 2 or 3; without twist its links have the same inertia.

    Tendons run around it to its tip, every other one to its third joint, and are held where the arm is straight.
    """
    space = {"radius": RADIUS, "twist_ratio": float(turns - 2)} if turns > 1 else None
    passed = np.arange(LINKS) < 3
    cords = tuple(
        Tendon.at_azimuth(2 * np.pi * k / tendons, passed if k % 2 else np.ones(LINKS), driven_by="displacement",
                          lever=RADIUS, line_stiffness=2e3, name=f"tendon {k}")
        for k in range(tendons)
    )  # fmt: skip
    return chain_model(length=LENGTH, mass=MASS, links=LINKS, joint_placement="midsegment", stiffness=STIFFNESS,
                       damping=DAMPING, gravity=[9.81, 0.0, 0.0][: 3 - (turns == 1)], space=space,
                       **({"chambers": cords} if cords else {"torque": [1e-6]}))  # fmt: skip


@cache
def arm(turns: int, tendons: int = 0) -> Any:
    """Return the mechanics of `body`."""
    return mechanics_of(body(turns, tendons))


def start(turns: int) -> Array:
    """Return coordinates of a bend in space."""
    x = np.zeros(turns * LINKS)
    x[: 2 * LINKS : 2], x[1 : 2 * LINKS : 2] = np.linspace(0.1, 0.4, LINKS), np.linspace(0.3, -0.3, LINKS)
    return x


def many_steps(count, looks, x, v, h, torque, body, joints, work, seen):
    """Take `count` steps between outputs of the coordinates `seen` (looks, N)."""
    for k in range(looks):
        for _ in range(count):
            step(x, v, h, torque, body, joints, work)  # noqa: F821  given by `loop`
        for i in range(len(x)):
            seen[k, i] = x[i]


@cache
def loop(turns: int, tendons: int = 0) -> Any:
    """Return `many_steps` with the compiled step of the arm."""
    made = twin(motion.step, LINKS, 0, turns, tendons)  # what stands for it in space
    return rebuild(many_steps, njit(**options(many_steps)), {"step": made})


def timed(run: Callable[[Array, Array], Any], turns: int, seconds: float) -> float:
    """Return the time of one step, ns, of a function that takes `CALLS` steps of coordinates and their rates."""
    x, v = np.zeros(turns * LINKS), np.zeros(turns * LINKS)

    def job() -> None:
        x[:], v[:] = start(turns), 1.0
        run(x, v)

    return 1e9 * best(job, seconds=seconds, clock=process_time) / CALLS


def step_ns(turns: int, seconds: float, tendons: int = 0) -> float:
    """Return the time of one step, ns."""
    chain, march, size = arm(turns, tendons), loop(turns, tendons), turns * LINKS
    rest = 1e-4, np.zeros(size + tendons), chain.body, chain.joints, chain.workspace(), np.zeros((1, size))
    return timed(lambda x, v: march(CALLS, 1, x, v, *rest), turns, seconds)


def c_step_ns(turns: int, seconds: float) -> float:
    """Return the time of one step of speed/space.c, ns, after a comparison with pliant's step."""
    source = Path(__file__).parent / "speed" / "space.c"
    code = shared_library(source, *FLAGS, f"-DL={LINKS}", f"-DTWIST={turns - 2}")
    chain, still = arm(turns), np.zeros(turns * LINKS)
    b, j = chain.body, chain.joints
    parts = (b.length, b.mass, b.centre, b.lateral, b.axial, np.swapaxes(b.rest, 1, 2), b.base.T, b.gx, b.gy, b.gz,
             j.K, j.D, *j.hardening)  # fmt: skip
    constants = np.concatenate([np.ravel(part) for part in parts]).astype(float)

    def run(count: int, x: Array, v: Array) -> None:
        given = [a.ctypes.data_as(POINTER) for a in (constants, x, v, still)]
        code.many_steps(ctypes.c_long(count), *given[:3], ctypes.c_double(1e-4), given[3])

    ours, theirs = (start(turns), 0.0 * start(turns)), (start(turns), 0.0 * start(turns))
    loop(turns)(1000, 1, *ours, 1e-4, still, chain.body, chain.joints, chain.workspace(), np.zeros((1, still.size)))
    run(1000, *theirs)
    np.testing.assert_allclose(theirs[0], ours[0], rtol=0, atol=1e-9)
    return timed(partial(run, CALLS), turns, seconds)


def plan(h: float, *, graded: bool) -> list[list[tuple[float, int]]]:
    """Return the lengths [s] and numbers of the steps between all LOOKS outputs."""
    count = round(END / LOOKS / h)
    steps = [[(h, count)] for _ in range(LOOKS)]
    if graded:
        steps[0] = [(part * h, 1) for part in FIRST] + [(h, count - 1)]
        k = min(count - 1, 1)
        steps[1 - k] = [*steps[1 - k][:-1], (0.5 * h, 2), (h, steps[1 - k][-1][1] - 1)]
    return steps


def coordinates(h: float, turns: int, parts: int, *, graded: bool) -> Array:
    """Return coordinates (LOOKS, N) of the arm, by steps of h [s] that are each divided into `parts`."""
    chain, x, seen = arm(turns), start(turns), np.zeros((LOOKS, turns * LINKS))
    v, still, work, run = 0.0 * x, 0.0 * x, chain.workspace(), loop(turns)
    for k, steps in enumerate(plan(h, graded=graded)):
        for length, number in steps:
            run(parts * number, 1, x, v, length / parts, still, chain.body, chain.joints, work, seen[k : k + 1])
    return seen


def pliant_tips(h: float, turns: int = 3, *, graded: bool = False, extrapolated: bool = False) -> Array:
    """Return tips (LOOKS, 3) of the arm, with twist if each joint has 3 turns."""
    chain, rows = arm(turns), coordinates(h, turns, 1, graded=graded)
    if extrapolated:
        rows = (4 * coordinates(h, turns, 2, graded=graded) - rows) / 3
    tips, work = np.zeros((LOOKS, 3)), chain.workspace()
    for row, tip in zip(rows, tips, strict=True):
        spatial.pose_links(row, chain.body, work)
        tip[:] = work.r[-1] + chain.body.length[-1] * work.R[-1, :, 2]
    return tips


def quaternions() -> Array:
    """Return initial quaternions (LINKS, 4) of the ball joints, with the real part last."""
    x = start(2).reshape(LINKS, 2)
    return Rotation.from_rotvec(np.column_stack([x, np.zeros(LINKS)])).as_quat()


def mujoco_runner(integrator: int) -> Callable[..., Array]:
    """Return a function from a step [s], and whether the first ones are graded, to tips (LOOKS, 3) of ball joints."""
    import mujoco

    mujoco.set_mju_user_warning(lambda _text: None)
    body = arm(2).body
    links = "".join(
        f"<body pos='0 0 {body.length[k]:.17g}'><joint type='ball' stiffness='{STIFFNESS}' damping='{DAMPING}'/>"
        f"<inertial pos='0 0 {body.centre[k]:.17g}' mass='{body.mass[k]:.17g}' "
        f"diaginertia='{body.lateral[k]:.17g} {body.lateral[k]:.17g} {body.axial[k]:.17g}'/>"
        for k in range(LINKS)
    )
    tip = f"<site name='tip' pos='0 0 {body.length[-1]:.17g}'/>"
    head = "<mujoco><option gravity='9.81 0 0'><flag contact='disable' constraint='disable'/></option><worldbody>"
    model = mujoco.MjModel.from_xml_string(f"{head}{links}{tip}{'</body>' * LINKS}</worldbody></mujoco>")
    model.opt.integrator = integrator
    data, first = mujoco.MjData(model), np.roll(quaternions(), 1, axis=1).ravel()

    def solve(h: float, *, graded: bool = False) -> Array:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = first
        tips = np.zeros((LOOKS, 3))
        for row, steps in zip(tips, plan(h, graded=graded), strict=True):
            for length, number in steps:
                model.opt.timestep = length
                mujoco.mj_step(model, data, number)
            mujoco.mj_kinematics(model, data)
            row[:] = data.site_xpos[0]
        return tips

    return solve


def to_target(solve: Callable[[float], Array], truth: Array, target: float, steps: list[float]) -> tuple[float, float]:
    """Return the longest step [s] from which on the largest error of the tip is within `target` [mm], and the error."""
    kept = (np.nan, np.nan)
    for h in reversed(steps):
        with np.errstate(all="ignore"):
            tips = solve(h)
        error = 1e3 * np.linalg.norm(tips - truth, axis=1).max() if np.isfinite(tips).all() else np.inf
        if not error <= target:
            break
        kept = h, error
    return kept


def race(seconds: float) -> dict[str, dict[str, Any]]:
    """Return step, error and time of each method at each target."""
    found: dict[str, dict[str, Any]] = {}
    truth, each = pliant_tips(FINEST), step_ns(3, seconds)
    for name, settings in METHODS.items():
        for target in TARGETS:
            h, error = to_target(partial(pliant_tips, **settings), truth, target, STEPS)
            steps = (END / h + len(FIRST) * ("graded" in settings)) * (3 if "extrapolated" in settings else 1)
            row = {"step_ms": 1e3 * h, "error_mm": error, "ms": steps * each / 1e6}
            found[f"pliant, {name} {target} mm"] = row
    try:
        solvers = {f"MuJoCo {name}": mujoco_runner(number) for name, number in INTEGRATORS.items()}
    except ImportError:
        solvers = {}
    for (name, solve), graded in product(solvers.items(), (False, True)):
        own, run = solve(FINEST), partial(solve, graded=graded)
        for target in TARGETS:
            h, error = to_target(run, own, target, STEPS)
            row = {"step_ms": 1e3 * h, "error_mm": error, "from_pliant_mm": 1e3 * np.abs(own - truth).max()}
            if np.isfinite(h):
                row["ms"] = 1e3 * best(partial(run, h), seconds=seconds, clock=process_time)
            found[f"{name}{', graded' * graded} {target} mm"] = row
    return found


def main() -> None:
    """Print the results."""
    seconds = parser_of(__doc__, seconds=2.0).parse_args().seconds
    print(machine())
    for name, turns in (("swing, 10 coordinates", 2), ("swing and twist, 15", 3)):
        ours, floor, tense = step_ns(turns, seconds), c_step_ns(turns, seconds), step_ns(turns, seconds, TENDONS)
        print(f"one step, {name:<24} pliant {ours:7.0f} ns, C {floor:7.0f} ns, ratio {ours / floor:.2f}; "
              f"with {TENDONS} tendons {tense / ours:.2f} times as long", flush=True)  # fmt: skip
    print(table(race(seconds)))


if __name__ == "__main__":
    main()
