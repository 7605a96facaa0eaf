"""Time fits beside other programs: K and D from 3 s of five tips, and 13 to 15 parameters from 18 s.

All programs use the same data in the same run on one core. The other programs are SciPy's least squares with finite
differences around a compiled LSODA right-hand side (as a careful user writes it), and mujoco.sysid if `pip install
"mujoco[sysid]"` is installed; it receives the planar data rotated in space, so that no coordinate is zero throughout.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from harness import Case, measured
from scipy.optimize import least_squares
from speed.timing import in_turn

from pliant.identification import Experiment, Parameter, fit
from pliant.model import Model, Valve, chain_model
from pliant.simulation import Trace, simulate

K, D, NOISE = 1.6067, 8e-3, 3e-4
START = {"stiffness": 1.3 * K, "damping": 0.7 * D}
PULSE = Trace([0.1, 0.1, 1.6, 1.6], [0.0, 119e3, 119e3, 0.0])
EACH = ("stiffness_*", "damping_*", "torque_1", "valve_rise_time", "valve_fall_time")


def body(**changes: Any) -> Model:
    """Return the paper's chain as a rod, which every program can model."""
    return chain_model(length=0.17, mass=0.069, links=5, stiffness=K, damping=D, torque=[6.6667e-7]).with_(**changes)


def recorded(model: Model, name: str, pressure: Trace, times: np.ndarray, seed: int = 0) -> Experiment:
    """Return tips simulated by LSODA at a tolerance of 1e-9, with white noise."""
    clean = simulate(model, pressure, times=times, method="LSODA", rtol=1e-9)["station_position"].values
    noise = NOISE * np.random.default_rng(seed).standard_normal(clean.shape)
    return Experiment(name, times, clean + noise, tuple(p.name for p in model.points), "trace", pressure)


@cache
def one_pulse() -> Experiment:
    """Return 3 s of five tips at 1 kHz with 0.3 mm of noise."""
    return recorded(body(), "p", PULSE, np.arange(0.0, 3.0005, 1e-3))


def with_pliant() -> tuple[float, float]:
    """Fit K and D by pliant."""
    start = [Parameter(n, v) for n, v in START.items()]
    values = fit([one_pulse()], body(), start, time_step=1e-3, starts=1).values
    return values["stiffness"], values["damping"]


def with_scipy() -> tuple[float, float]:
    """Fit K and D by finite differences around LSODA."""
    exp = one_pulse()

    def residual(x: np.ndarray) -> np.ndarray:
        model = body(stiffness=np.full(5, x[0] * K), damping=np.full(5, x[1] * D))
        run = simulate(model, exp.pressure, times=exp.time, method="LSODA", rtol=1e-6)
        return (run["station_position"].values - exp.position).ravel()

    x = least_squares(residual, [1.3, 0.7], bounds=([0.1, 0.0], [10, 10]), diff_step=1e-4).x
    return x[0] * K, x[1] * D


def chain_xml() -> str:
    """Return the chain as MuJoCo XML, rotated in space so that no coordinate of a tip is zero."""
    m = body()
    l, mass = float(m.link_length[0]), float(m.link_mass[0])
    links = "".join(
        f'<body name="b{i}" pos="0 {l if i else 0} 0"><joint name="j{i}" type="hinge" axis="0 0 1" stiffness="{K}" '
        f'damping="{D}"/><inertial pos="0 {l / 2} 0" mass="{mass}" diaginertia="1e-6 1e-6 {mass * l**2 / 12}"/>'
        f'<site name="s{i}" pos="0 {l} 0"/>' for i in range(5)
    )  # fmt: skip
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 0" integrator="implicitfast">'
        '<flag contact="disable"/></option><worldbody>'
        f'<body euler="0.5 0.6 0.4">{links}{"</body>" * 5}</body></worldbody><actuator>'
        + "".join(f'<motor joint="j{i}"/>' for i in range(5)) + "</actuator><sensor>"
        + "".join(f'<framepos name="p{i}" objtype="site" objname="s{i}"/>' for i in range(5)) + "</sensor></mujoco>"
    )  # fmt: skip


def with_mujoco() -> tuple[float, float]:
    """Fit K and D by mujoco.sysid."""
    import mujoco
    from mujoco import sysid

    exp, spec = one_pulse(), mujoco.MjSpec.from_string(chain_xml())
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    R = data.xmat[compiled.body("b0").id].reshape(3, 3)
    points = np.concatenate([exp.position, np.zeros((*exp.position.shape[:2], 1))], axis=2) @ R.T
    torque = body().torque_at(exp.pressure(exp.time))
    control = sysid.TimeSeries(exp.time, np.repeat(torque[:, None], 5, axis=1))
    sensed = sysid.TimeSeries.from_names(exp.time[1:], points.reshape(len(points), -1)[1:], compiled)

    def put(field: str, s: Any, p: Any) -> None:
        for i in range(5):
            size = np.atleast_1d(getattr(s.joint(f"j{i}"), field)).size
            setattr(s.joint(f"j{i}"), field, np.r_[p.value[0], np.zeros(size - 1)] if size > 1 else p.value[0])

    params = sysid.ParameterDict()
    for name, size in (("stiffness", K), ("damping", D)):
        params.add(sysid.Parameter(name, nominal=size, min_value=0.1 * size, max_value=10 * size,
                                   modifier=partial(put, name)))  # fmt: skip
        params[name].value[:] = START[name]
    start = sysid.create_initial_state(compiled, data.qpos, data.qvel, data.act)
    sequences = sysid.ModelSequences("chain", spec, "pulse", start, control, sensed)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    result, _ = sysid.optimize(initial_params=params, residual_fn=residual, optimizer="mujoco", verbose=False)
    return float(result["stiffness"].value[0]), float(result["damping"].value[0])


def race(job: Callable[[], tuple[float, float]], repeats: int) -> dict[str, Any]:
    """Return the best wall time of a few warm runs, and the errors of K and D."""
    try:
        stiffness, damping = job()
    except (ImportError, AttributeError) as error:
        return {"time (s)": f"not run: {error}"}
    errors = {"error of K (%)": 100 * (stiffness / K - 1), "error of D (%)": 100 * (damping / D - 1)}
    return {"time (s)": float(in_turn([job], repeats, clock=time.perf_counter).min()), **errors}


def large(free: list[str], starts: int) -> dict[str, Any]:
    """Fit three records of 6 s at 100 Hz of a body with different joints behind a valve, in processor time."""
    truth = body(
        stiffness=K * np.array([1.1, 0.95, 1.0, 1.05, 0.9]), damping=D * np.array([0.9, 1.0, 1.1, 1.0, 1.0]),
        torque=[5e-7, 1e-12], valve=Valve(rise_time=0.03, fall_time=0.05), base_angle=0.02,
    )
    exps = [recorded(truth, f"r{i}", Trace(PULSE.time * 2, PULSE.pressure * s), np.arange(0.0, 6.0, 0.01), i)
            for i, s in enumerate((0.5, 1.0, 1.5))]  # fmt: skip
    fit(exps, body(), free, starts=1, max_evaluations=2)  # compiles
    began = time.process_time()
    result = fit(exps, body(), free, starts=starts)
    return {"time (s)": time.process_time() - began, "parameters": sum(p.free for p in result.parameters),
            "evaluations": result.evaluations, "rise time (true 0.03 s)": result.values["valve_rise_time"]}  # fmt: skip


if __name__ == "__main__":
    goal = {"time (s)": (0.1, True)}
    measured(__doc__, {
        "fit": [Case("pliant", partial(race, with_pliant, 5), goal),
                Case("mujoco.sysid", partial(race, with_mujoco, 1)),
                Case("SciPy around LSODA", partial(race, with_scipy, 1))],
        "fit of 15": [
            Case("three starts", partial(large, [*EACH], 3), {"time (s)": (3.0, True)}),
            Case("one start", partial(large, [*EACH, "torque_2", "base_angle"], 1)),
            Case("three starts, creep", partial(large, [*EACH, "creep_share_1", "creep_time_1"], 3)),
        ],
    })  # fmt: skip
