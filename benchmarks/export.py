"""Measure exported models: C beside pliant's integration, plain C and MuJoCo; environments beside MuJoCo.

The C code of `pliant export --to c99` takes steps of 1 ms, of the paper's model and of one with softening springs and
hysteresis; `speed/floor.c` is the same mathematics in hand-written C, and MuJoCo runs the exported MJCF without contact
detection. Environments are free motion of the paper's five links with 20 ms between actions: pliant's vector
environment, and MuJoCo by `mj_step` and by `mujoco.rollout` on one thread, with observations by the same NumPy code, at
1 ms and at the longest step at which one of its integrators is as accurate as pliant at 1 ms. Times are the best of
several.

    python benchmarks/export.py c99
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from harness import Case, measured
from speed.kernels import floor, shared_library
from speed.timing import best

from pliant.actuators import chen2018
from pliant.exporters.c99 import code
from pliant.exporters.mjcf import mjcf
from pliant.exporters.provenance import Provenance
from pliant.model import Memory, Model, load_model
from pliant.simulation import Pulse, Trace, simulate

STEP, STEPS, HIGHEST = 1e-3, 100_000, 1e5  # s, steps, Pa
PERIOD, ACTIONS = 0.02, 50  # s between actions
MODELS = Path(__file__).parents[1] / "examples" / "state"
MARCH = """
void many(arm_state *s, const arm_parameters *p, double pressure, long steps)
{
    double u[ARM_CHAMBERS] = {pressure};
    for (long k = 0; k < steps; k++) arm_step(s, p, u);
}
"""
CORE = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-Os", "-std=c99"]
timed = partial(best, seconds=0.3, clock=process_time)


def body(name: str) -> Model:
    """Return the paper's model, or a virtual actuator's with or without its hysteresis."""
    if name == "paper":
        return chen2018.model()
    model = load_model(MODELS / "model_a.json")
    return model if name == "memory" else model.with_(memory=Memory())


def source(model: Model, folder: Path, precision: str) -> str:
    """Return the exported C code; its header is written into the folder."""
    exported = code(model, Provenance(model, "c99", "benchmark"), time_step=STEP, precision=precision, pressure=0.0,
                    prefix="arm")  # fmt: skip
    (folder / "arm.h").write_text(exported.header, encoding="utf-8")
    return exported.source


def c99(name: str) -> dict[str, Any]:
    """Return the time of a step of the C code, and of pliant's."""
    model = body(name)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "arm.c"
        path.write_text(source(model, path.parent, "double") + MARCH, encoding="utf-8")
        library = shared_library(path, "-std=c99", "-O2")
    s, p = (ctypes.c_double * 65536)(), (ctypes.c_double * 65536)()
    library.arm_defaults(p)
    library.arm_init(s)
    library.many.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_long]
    ends = np.array([0.0, STEPS * STEP])
    row = {"exported C (ns)": 1e9 / STEPS * timed(lambda: library.many(s, p, 5e4, STEPS)),
           "pliant (ns)": 1e9 / STEPS * timed(lambda: simulate(model, Pulse(5e4), times=ends, time_step=STEP))}
    if name == "paper":
        row["hand-written C (ns)"] = floor(model, STEPS, STEP, np.full(model.n, model.torque_at(5e4))).get("c_step_ns")
        row["MuJoCo (ns)"] = mujoco_ns(model)
    return row


def mujoco_ns(model: Model) -> float | None:
    """Return the nanoseconds that MuJoCo takes for a step of 1 ms of the exported MJCF."""
    if find_spec("mujoco") is None:
        return None
    import mujoco

    m = in_mujoco(model, STEP, "implicitfast")
    d = mujoco.MjData(m)
    d.ctrl[:] = 5e4
    return 1e5 * timed(lambda: mujoco.mj_step(m, d, 10000))


def flash() -> dict[str, Any]:
    """Return bytes of code, state and parameters of the paper's model in single precision on a Cortex-M4."""
    if shutil.which("arm-none-eabi-gcc") is None:
        return {"flash (bytes)": None}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "chip.c"
        text = source(chen2018.model(), path.parent, "single")
        path.write_text(f"{text}arm_state ram_state; arm_parameters ram_parameters;", encoding="utf-8")
        binary = str(path.with_suffix(".o"))
        subprocess.run(["arm-none-eabi-gcc", *CORE, "-c", str(path), "-o", binary], check=True)
        sizes = subprocess.run(["arm-none-eabi-size", binary], capture_output=True, text=True, check=True).stdout
    text_bytes, _, bss = (int(v) for v in sizes.splitlines()[1].split()[:3])
    return {"flash (bytes)": text_bytes, "RAM (bytes)": bss}


def in_mujoco(model: Model, step: float, integrator: str) -> Any:
    """Return MuJoCo's model without collisions."""
    import mujoco

    m = mujoco.MjModel.from_xml_string(mjcf(model, Provenance(model, "mjcf", "benchmark"), time_step=step))
    m.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
    m.geom_contype[:], m.geom_conaffinity[:] = 0, 0
    return m


def pressures() -> np.ndarray:
    """Return the pressures of an episode, Pa."""
    return np.random.default_rng(1).uniform(0.0, HIGHEST, ACTIONS)


def pliant_tips(model: Model, method: str) -> np.ndarray:
    """Return tips after each action, m."""
    edges = np.arange(ACTIONS + 1) * PERIOD
    trace = Trace(np.repeat(edges, 2)[1:-1], np.repeat(pressures(), 2))
    run = simulate(model, trace, times=edges, time_step=STEP, method=method, initial_angle=np.zeros(model.n))
    return run.tip_position.values[1:, -1]


def mujoco_error(model: Model, step: float, integrator: str, true: np.ndarray) -> float:
    """Return the largest tip error, mm."""
    import mujoco

    m, tips = in_mujoco(model, step, integrator), []
    d = mujoco.MjData(m)
    for p in pressures():
        d.ctrl[:] = p
        mujoco.mj_step(m, d, round(PERIOD / step))
        mujoco.mj_kinematics(m, d)
        tips.append(d.site_xpos[-1, :2].copy())
    return 1e3 * float(np.abs(np.array(tips) - true).max())


@cache
def as_accurate() -> tuple[float, float, str]:
    """Return pliant's error at 1 ms [mm], and step and integrator of MuJoCo with at most this error."""
    import mujoco

    mujoco.set_mju_user_warning(lambda _: None)  # Runge-Kutta is unstable at long steps
    model = chen2018.model()
    true = pliant_tips(model, "Radau")
    error = 1e3 * float(np.abs(pliant_tips(model, "midpoint") - true).max())
    for parts in (20, 25, 32, 40, 50, 80, 100, 200, 400, 800, 2000, 4000):
        for integrator in ("rk4", "implicitfast"):
            if mujoco_error(model, PERIOD / parts, integrator, true) <= error:
                return error, PERIOD / parts, integrator
    raise RuntimeError("MuJoCo does not reach pliant's accuracy at 5 us")


def mujoco_environments(*, accurate: bool) -> dict[str, Any]:
    """Return MuJoCo's environment steps per second: one environment by mj_step, 256 by rollout."""
    import mujoco
    import mujoco.rollout

    model, size = chen2018.model(), 256
    _, step, integrator = as_accurate() if accurate else (0.0, STEP, "implicitfast")
    m, count = in_mujoco(model, step, integrator), round(PERIOD / step)
    d, kind = mujoco.MjData(m), mujoco.mjtState.mjSTATE_FULLPHYSICS
    width = mujoco.mj_stateSize(m, kind)
    now, out = np.zeros((size, width)), np.zeros((size, count, width))
    sensed = np.zeros((size, count, m.nsensordata))
    mujoco.mj_getState(m, d, now[0], kind)
    now[:] = now[0]
    target = np.array([0.05, 0.15])

    def one() -> None:
        for p in pressures():
            d.ctrl[:] = p
            mujoco.mj_step(m, d, count)
            np.concatenate([d.qpos, d.qvel * PERIOD, d.site_xpos[-1, :2], d.ctrl]).astype(np.float32)

    def many() -> None:
        for p in pressures()[:10]:
            control = np.full((size, count, m.nu), p)
            mujoco.rollout.rollout([m] * size, [d], now, control, state=out, sensordata=sensed, skip_checks=True,
                                   nstep=count, initial_warmstart=None)  # fmt: skip
            now[:] = out[:, -1]
            tip, q, dq = sensed[:, -1, :2], now[:, 1 : 1 + m.nq], now[:, 1 + m.nq : 1 + m.nq + m.nv]
            rows = [q, dq * PERIOD, tip, np.broadcast_to(target, tip.shape), control[:, 0]]
            np.concatenate(rows, axis=1).astype(np.float32)
            np.linalg.norm(tip - target, axis=1)

    return {"step (ms)": 1e3 * step, "one, per s": ACTIONS / timed(one), "batch, per s": 10 * size / timed(many)}


def environments(size: int, **options: Any) -> dict[str, Any]:
    """Return pliant's environment steps per second: one environment, and a batch."""
    import gymnasium

    import pliant.exporters.gymnasium  # noqa: F401  registers

    model = chen2018.model()
    env = gymnasium.make("pliant/Reach-v0", model=model, highest=HIGHEST).unwrapped
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=size, model=model, highest=HIGHEST, **options)
    env.reset(seed=1)
    envs.reset(seed=1)
    actions = np.random.default_rng(1).uniform(-1, 1, (ACTIONS, size, 1)).astype(np.float32)

    def episode(step: Callable[[Any], Any], rows: np.ndarray) -> None:
        for a in rows:
            step(a)

    return {"step (ms)": 1e3 * STEP, "one, per s": ACTIONS / timed(lambda: episode(env.step, actions[:, 0])),
            "batch, per s": ACTIONS * size / timed(lambda: episode(envs.step, actions))}  # fmt: skip


if __name__ == "__main__":
    measured(__doc__, {
        "c99": [*(Case(name, partial(c99, name)) for name in ("paper", "softening", "memory")), Case("flash", flash)],
        "environments": [
            Case("pliant, batch of 1024", partial(environments, 1024)),
            Case("pliant, 256 bodies drawn", partial(environments, 256, fit={"stiffness": 0.05})),
            Case("MuJoCo", partial(mujoco_environments, accurate=False)),
            Case("MuJoCo as accurate", partial(mujoco_environments, accurate=True)),
        ],
    })  # fmt: skip
