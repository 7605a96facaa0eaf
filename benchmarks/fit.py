"""Time fits beside other programs: K and D from 3 s of five tips, and 13 to 15 parameters from 18 s.

All programs use the same data in the same run on one core. The other programs are SciPy's least squares with finite
differences around a compiled LSODA right-hand side (as a careful user writes it), and mujoco.sysid if `pip install
"mujoco[sysid]"` is installed. mujoco.sysid receives the planar data once unchanged, with z = 0 throughout, and once
rotated in space so that no coordinate is zero.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import sys
import time

import numpy as np
from scipy.optimize import least_squares

from pliant.identification import Experiment, Parameter, fit
from pliant.model import Model, Valve, chain_model
from pliant.simulation import Trace, simulate

K, D, NOISE = 1.6067, 8e-3, 3e-4
START = {"stiffness": 1.3 * K, "damping": 0.7 * D}
PULSE = Trace([0.1, 0.1, 1.6, 1.6], [0.0, 119e3, 119e3, 0.0])


def body(**changes) -> Model:
    """Return the paper's chain as a rod, which every program can model."""
    return chain_model(length=0.17, mass=0.069, links=5, stiffness=K, damping=D, torque=[6.6667e-7]).with_(**changes)


def recorded(model: Model, name: str, pressure: Trace, times: np.ndarray, seed: int = 0) -> Experiment:
    """Return tips simulated by LSODA at a tolerance of 1e-9, with white noise."""
    clean = simulate(model, pressure, times=times, method="LSODA", rtol=1e-9)["station_position"].values
    noise = NOISE * np.random.default_rng(seed).standard_normal(clean.shape)
    return Experiment(name, times, clean + noise, tuple(p.name for p in model.points), "trace", pressure)


def best_of(job, repeats: int = 3, clock=time.perf_counter):
    """Return the best time [s] of a few warm runs (wall time by default) and their result."""
    job()
    times = []
    for _ in range(repeats):
        began = clock()
        result = job()
        times.append(clock() - began)
    return min(times), result


def with_scipy(exp: Experiment) -> tuple[float, float]:
    """Fit K and D by finite differences around LSODA."""
    def residual(x):
        model = body(stiffness=np.full(5, x[0] * K), damping=np.full(5, x[1] * D))
        run = simulate(model, exp.pressure, times=exp.time, method="LSODA", rtol=1e-6)
        return (run["station_position"].values - exp.position).ravel()

    x = least_squares(residual, [1.3, 0.7], bounds=([0.1, 0.0], [10, 10]), diff_step=1e-4).x
    return x[0] * K, x[1] * D


def chain_xml(turned: bool) -> str:
    """Return the chain as MuJoCo XML; with `turned`, rotated in space so that no coordinate of a tip is zero."""
    m = body()
    l, mass = float(m.link_length[0]), float(m.link_mass[0])
    euler = "0.5 0.6 0.4" if turned else "0 0 0"
    links = "".join(
        f'<body name="b{i}" pos="0 {l if i else 0} 0"><joint name="j{i}" type="hinge" axis="0 0 1" stiffness="{K}" '
        f'damping="{D}"/><inertial pos="0 {l / 2} 0" mass="{mass}" diaginertia="1e-6 1e-6 {mass * l**2 / 12}"/>'
        f'<site name="s{i}" pos="0 {l} 0"/>' for i in range(5)
    )
    return (
        '<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="0 0 0" integrator="implicitfast">'
        '<flag contact="disable"/></option><worldbody>'
        f'<body euler="{euler}">{links}{"</body>" * 5}</body></worldbody><actuator>'
        + "".join(f'<motor joint="j{i}"/>' for i in range(5)) + "</actuator><sensor>"
        + "".join(f'<framepos name="p{i}" objtype="site" objname="s{i}"/>' for i in range(5)) + "</sensor></mujoco>"
    )


def with_mujoco(exp: Experiment, turned: bool) -> tuple[float, float]:
    """Fit K and D by mujoco.sysid."""
    import mujoco
    from mujoco import sysid

    spec = mujoco.MjSpec.from_string(chain_xml(turned))
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    R = data.xmat[compiled.body("b0").id].reshape(3, 3)
    points = np.concatenate([exp.position, np.zeros((*exp.position.shape[:2], 1))], axis=2) @ R.T
    torque = body().torque_at(exp.pressure(exp.time))
    control = sysid.TimeSeries(exp.time, np.repeat(torque[:, None], 5, axis=1))
    sensed = sysid.TimeSeries.from_names(exp.time[1:], points.reshape(len(points), -1)[1:], compiled)
    start = sysid.create_initial_state(compiled, data.qpos, data.qvel, data.act)

    def put(field, wide):
        def into(s, p):
            for i in range(5):
                joint = s.joint(f"j{i}")
                old = np.atleast_1d(getattr(joint, field))
                setattr(joint, field, np.r_[p.value[0], np.zeros(old.size - 1)] if wide(old) else p.value[0])
        return into

    params = sysid.ParameterDict()
    for name, size in (("stiffness", K), ("damping", D)):
        params.add(sysid.Parameter(name, nominal=size, min_value=0.1 * size, max_value=10 * size,
                                   modifier=put(name, lambda old: old.size > 1)))
        params[name].value[:] = START[name]
    sequences = sysid.ModelSequences("chain", spec, "pulse", start, control, sensed)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    found, _ = sysid.optimize(initial_params=params, residual_fn=residual, optimizer="mujoco", verbose=False)
    return float(found["stiffness"].value[0]), float(found["damping"].value[0])


def shown(name: str, seconds: float, stiffness: float, damping: float) -> None:
    """Return one line of the table."""
    off = 100 * (stiffness / K - 1), 100 * (damping / D - 1)
    print(f"{name:<46} {seconds:8.3f} s   K {off[0]:+7.3f} %   D {off[1]:+7.3f} %")


def race() -> None:
    """Fit K and D from 3 s of five tips at 1 kHz with 0.3 mm of noise, with every program."""
    exp = recorded(body(), "p", PULSE, np.arange(0.0, 3.0005, 1e-3))
    started = [Parameter(n, v) for n, v in START.items()]
    seconds, found = best_of(lambda: fit([exp], body(), started, time_step=1e-3, starts=1), 5)
    shown("pliant, target 0.1 s", seconds, found.values["stiffness"], found.values["damping"])
    seconds, pair = best_of(lambda: with_scipy(exp), 1)
    shown("SciPy least squares around compiled LSODA", seconds, *pair)
    for turned in (True, False):
        where = "turned in space" if turned else "planar, z zero"
        try:
            seconds, pair = best_of(lambda turned=turned: with_mujoco(exp, turned), 1)
        except (ImportError, AttributeError) as error:
            print(f"mujoco.sysid, {where}: not run ({error})")
            continue
        shown(f"mujoco.sysid, {where}", seconds, *pair)


def three_pulses() -> list[Experiment]:
    """Return three records of 6 s at 100 Hz of a body with different joints behind a valve."""
    truth = body(
        stiffness=K * np.array([1.1, 0.95, 1.0, 1.05, 0.9]), damping=D * np.array([0.9, 1.0, 1.1, 1.0, 1.0]),
        torque=[5e-7, 1e-12], valve=Valve(rise_time=0.03, fall_time=0.05), base_angle=0.02,
    )
    times = np.arange(0.0, 6.0, 0.01)
    return [recorded(truth, f"r{i}", Trace(PULSE.time * 2, PULSE.pressure * s), times, i)
            for i, s in enumerate((0.5, 1.0, 1.5))]


def timed(told: str, exps: list[Experiment], free: list[str], repeats: int, **how: int) -> None:
    """Return one line about a fit of three pulses, in processor time."""
    guess, times = body(torque=[6.6667e-7]), []
    fit(exps, guess, free, starts=1, max_evaluations=2)  # compiles
    for _ in range(repeats):
        began = time.process_time()
        found = fit(exps, guess, free, **how)
        times.append(time.process_time() - began)
    seconds = min(times)
    count = sum(p.free for p in found.parameters)
    print(f"{count} parameters, three 6 s records, {told}: {seconds:.2f} s CPU; {found.evaluations} evaluations; "
          f"rise {found.values['valve_rise_time']:.4f} s (0.03); {found.status}", flush=True)


def large(quick: bool) -> None:
    """Fit parameters of each joint, of the torque law and of the valve, from one start and from three, then with creep.
    """
    exps = three_pulses()
    wanted = ["stiffness_*", "damping_*", "torque_1", "valve_rise_time", "valve_fall_time"]
    timed("three starts, target 3 s", exps, wanted, 1)
    timed("one start", exps, [*wanted, "torque_2", "base_angle"], 2, starts=1)
    if not quick:
        timed("three starts, target 6 s", exps, [*wanted, "creep_share_1", "creep_time_1"], 1)


if __name__ == "__main__":
    race()
    large(quick="--quick" in sys.argv)
