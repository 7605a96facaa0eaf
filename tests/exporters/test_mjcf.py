"""MuJoCo moves the exported chain as pliant does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from target_models import MODELS

import pliant
from pliant.exporters.mjcf import ARMATURE, branches, control, controls, mjcf
from pliant.exporters.mjcf_step import Hidden, bounded_by, checked_step, linear_chain
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of, springs
from pliant.model import Memory, load_model
from pliant.simulation import equilibrium, simulate
from pliant.simulation.state import typical_pressure

KINDS = Path(__file__).parents[2] / "examples" / "state"
mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
STEP = 1e-4  # s


def compiled(model, **options):
    xml = mjcf(model, Provenance(model, "mjcf", "test"), **{"time_step": STEP, "highest": 1e6, **options})
    loaded = mujoco.MjModel.from_xml_string(xml)
    return loaded, mujoco.MjData(loaded)


def put(model, m, d, q, prefix=""):
    """The chain at joint angles q, its creep relaxed there."""
    for i in range(model.n):
        d.qpos[m.joint(f"{prefix}q_{i + 1}").qposadr[0]] = q[i]
        for branch in branches(model):
            d.qpos[m.joint(f"{prefix}{branch.name}_{i + 1}").qposadr[0]] = q[i]
    mujoco.mj_forward(m, d)


def drive(m, d, pressure):
    for a in range(m.nu):
        power = m.actuator(a).name.rpartition("pressure")[2]
        d.ctrl[a] = pressure * (pressure / 1e5) ** (int(power[1:]) - 1 if power else 0)


@pytest.mark.parametrize(("model", "level", "integrator", "bound"), [
    *((name, 8e4, "implicitfast", 1e-4) for name in ("paper", "demo", "creeping")),
    *((name, 2.4e5, "RK4", 1e-6) for name in ("paper", "demo")),  # hidden hinges of creep are too stiff for it
], indirect=["model"])
def test_pulses_within_a_tenth_of_a_millimetre(model, level, integrator, bound):
    """The first-order integrator by some hundredths of a millimetre, Runge's and Kutta's by a micrometre."""
    m, d = compiled(model, integrator=integrator)
    put(model, m, d, equilibrium(model))
    pulse, times = pliant.Pulse(level, 0.05, 0.3), np.arange(6001) * STEP
    tip = m.site(model.points[-1].name).id
    path = [d.site_xpos[tip, :2].copy()]
    for t in times[:-1]:
        drive(m, d, float(pulse(t + 0.5 * STEP)))
        mujoco.mj_step(m, d)
        mujoco.mj_kinematics(m, d)
        path.append(d.site_xpos[tip, :2].copy())
    run = simulate(model, pulse, times=times, time_step=STEP)
    apart = np.abs(np.array(path) - run.station_position.values[:, -1])
    assert np.abs(run.station_position.values[:, -1] - path[0]).max() > 0.02
    assert apart.max() < bound


def stiff():
    """Natural frequencies up to 3 kHz, hardly damped: at 1 ms every integrator of MuJoCo diverges."""
    from pliant.actuators import chen2018

    return chen2018.model(stiffness=500.0, damping=1e-3, torque=[2e-4])


def grows(model, integrator, step, steps=3000):
    """Whether joints let go from 0.2 rad leave all bounds under MuJoCo."""
    m = mujoco.MjModel.from_xml_string(mjcf(model, Provenance(model, "mjcf", "test"), highest=1e5))
    m.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")  # past the check of the exporter
    m.opt.timestep = step
    d = mujoco.MjData(m)
    d.qpos[:] = 0.2
    mujoco.mj_step(m, d, steps)
    return not np.abs(d.qpos).max() < 0.5 or bool(d.warning[mujoco.mjtWarning.mjWARN_BADQACC].number)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("integrator", ["implicitfast", "Euler", "RK4"])
@pytest.mark.parametrize("which", ["demo", "creeping", "stiff"])
def test_the_longest_step_is_the_longest(which, integrator, tmp_path, monkeypatch):
    """A tenth below the limit the motion stays bounded, a half above it it does not; the step chosen is well below."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log into the working folder
    model = stiff() if which == "stiff" else MODELS[which]()
    chain = linear_chain(model, [Hidden(b.share, b.time, ARMATURE) for b in branches(model)])
    stays = bounded_by(chain, integrator)
    low, high = 1e-8, 1.0
    for _ in range(60):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if stays(middle) else (low, middle)
    assert not grows(model, integrator, 0.9 * low)
    assert grows(model, integrator, 1.5 * low)
    if (which, integrator) == ("creeping", "RK4"):
        assert low < 1e-6
        with pytest.raises(pliant.InputError, match=r"at all time steps down to 7\.8 us: use integrator=implicitfast"):
            checked_step(chain, integrator, 0.0)
    else:
        assert checked_step(chain, integrator, 0.0) <= min(0.5 * low, 1e-3)
        with pytest.raises(pliant.InputError, match="s this chain is unstable: use time_step="):
            checked_step(chain, integrator, 1.01 * low)


@pytest.mark.parametrize(("which", "integrator", "step", "bound"), [
    ("paper", "RK4", 1.25e-4, 1e-6), ("demo", "implicitfast", 1e-3, 1e-3), ("stiff", "implicitfast", 3.125e-5, 5e-4),
])
def test_the_step_that_is_chosen_stays_near_the_model(which, integrator, step, bound):
    model = stiff() if which == "stiff" else MODELS[which]()
    m, d = compiled(model, time_step=0.0, integrator=integrator)
    assert m.opt.timestep == step
    mujoco.mj_resetDataKeyframe(m, d, m.key("rest").id)
    times, level = np.arange(0.0, 0.2, step), 8e4
    tip, path = m.site(model.points[-1].name).id, []
    for _ in times:
        mujoco.mj_kinematics(m, d)
        path.append(d.site_xpos[tip, :2].copy())
        drive(m, d, level)
        mujoco.mj_step(m, d)
    run = simulate(model, pliant.Pulse(level, 0.0, 9.0), times=times, time_step=min(step, 1e-4))
    seen = run.station_position.values[:, -1]
    assert np.ptp(seen, axis=0).max() > 0.02
    assert np.abs(np.array(path) - seen).max() < bound


def test_a_step_that_diverges_is_refused(tmp_path):
    """RK4 at 1 ms, which was written before; creep, whose hidden hinges no explicit method follows."""
    with pytest.raises(pliant.InputError, match=r"time_step=0\.001 s this chain is unstable: use time_step=0\.000125"):
        pliant.export(MODELS["paper"](), "mjcf", tmp_path / "a.xml", integrator="RK4", time_step=1e-3)
    with pytest.raises(pliant.InputError, match="use integrator=implicitfast"):
        pliant.export(MODELS["creeping"](), "mjcf", tmp_path / "a.xml", integrator="RK4")
    assert not list(tmp_path.iterdir())


def test_the_keyframe_is_the_rest_and_controls_have_a_range(model):
    m, d = compiled(model, highest=0.0)
    mujoco.mj_resetDataKeyframe(m, d, m.key("rest").id)
    rest = equilibrium(model)
    for i in range(model.n):
        for name in ("q", *(branch.name for branch in branches(model))):
            assert d.joint(f"{name}_{i + 1}").qpos[0] == rest[i]
    mujoco.mj_step(m, d, 200)
    assert np.abs(d.qvel).max() < 1e-6
    assert m.actuator_ctrllimited.all()
    highest = 2.0 * typical_pressure(model)
    named = {m.actuator(a).name: m.actuator_ctrlrange[a] for a in range(m.nu)}
    for name, _, power in controls(model):
        assert named[name] == pytest.approx([0.0, control(highest, power)])
    text = mjcf(model, Provenance(model, "mjcf", "test"), prefix="left_")
    assert "keyframe" not in text


def test_two_chambers_and_creep(branched):
    m, d = compiled(branched)
    put(branched, m, d, equilibrium(branched, [0.0, 0.0]))
    pulses, times = (pliant.Pulse(8e4, 0.05, 0.3), pliant.Pulse(6e4, 0.15, 0.3)), np.arange(6001) * STEP
    tip = m.site(branched.points[-1].name).id
    named = {m.actuator(a).name: a for a in range(m.nu)}
    path = [d.site_xpos[tip, :2].copy()]
    for t in times[:-1]:
        for name, c, power in controls(branched):
            d.ctrl[named[name]] = control(float(pulses[c](t + 0.5 * STEP)), power)
        mujoco.mj_step(m, d)
        mujoco.mj_kinematics(m, d)
        path.append(d.site_xpos[tip, :2].copy())
    run = simulate(branched, pulses, times=times, time_step=STEP)
    seen = run.station_position.values[:, -1]
    assert np.ptp(seen, axis=0).max() > 0.02
    assert np.abs(np.array(path) - seen).max() < 1e-4


def test_slip_keeps_what_it_keeps_in_pliant():
    """After a pulse the elements hold the body away from its rest shape, in MuJoCo as in pliant; without them not."""
    model = load_model(KINDS / "model_b.json")
    paths, pulse = {}, pliant.Pulse(6e4, 0.05, 0.3)
    for name, body in (("all", model), ("none", model.with_(memory=Memory()))):
        m, d = compiled(body)
        put(body, m, d, equilibrium(body))
        for t in np.arange(12000) * STEP:
            drive(m, d, float(pulse(t + 0.5 * STEP)))
            mujoco.mj_step(m, d)
        mujoco.mj_kinematics(m, d)
        paths[name] = d.site_xpos[m.site(model.points[-1].name).id, :2].copy()
    run = simulate(model, pulse, duration=1.2, time_step=STEP)
    end = run.station_position.values[-1, -1]
    assert np.linalg.norm(paths["all"] - end) < 2e-5
    assert np.linalg.norm(paths["none"] - end) > 2e-4


def test_every_station_in_place(model):
    m, d = compiled(model)
    q = np.linspace(0.1, -0.2, model.n)
    put(model, m, d, q)
    places, _ = mechanics_of(model).stations(mechanics_of(model).coordinates(q))
    for point, place in zip(model.points, places, strict=True):
        assert d.site_xpos[m.site(point.name).id] == pytest.approx([*place, 0.0], abs=1e-12)


def test_static_to_a_millionth_of_a_radian(model):
    """Held at pliant's equilibrium, nothing accelerates; let fall from elsewhere, it comes to rest there."""
    level = 8e4
    q = equilibrium(model, level)
    m, d = compiled(model)
    drive(m, d, level)
    if m.na:
        d.act[:] = level
    put(model, m, d, q)
    slopes = springs.springs_of(model).slope(q)
    joints = [m.joint(f"q_{i + 1}").dofadr[0] for i in range(model.n)]
    history = d.qfrc_actuator[joints] if not model.valve.dead_time else model.joint_gain * model.torque_at(level)
    residual = history + d.qfrc_passive[joints] - d.qfrc_bias[joints]
    assert np.abs(residual / slopes).max() < 1e-6


def test_two_fingers_in_one_world():
    from pliant.actuators import chen2018

    model = chen2018.model()
    world = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 0"/><worldbody/></mujoco>'
    )
    for k in range(2):
        own = mujoco.MjSpec.from_string(mjcf(model, Provenance(model, "mjcf", "test")))
        world.worldbody.add_frame(pos=[0.1 * k, 0.0, 0.0]).attach_body(own.body("base"), f"finger{k}_", "")
    included = '<mujoco><include file="0.xml"/><include file="1.xml"/></mujoco>'
    origin = Provenance(model, "mjcf", "test")
    files = {f"{k}.xml": mjcf(model, origin, prefix=f"finger{k}_").encode() for k in range(2)}
    for m in (world.compile(), mujoco.MjModel.from_xml_string(included, files)):
        assert m.nq == 2 * model.n
        assert m.nu == 2
        assert {m.actuator(a).name for a in range(2)} == {"finger0_pressure", "finger1_pressure"}


def test_mass_and_inertia(model):
    m, d = compiled(model)
    q = np.full(model.n, 0.1)
    put(model, m, d, q)
    M = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, M)
    joints = [m.joint(f"q_{i + 1}").dofadr[0] for i in range(model.n)]
    from pliant.equations import inertia

    phi, body = mechanics_of(model).coordinates(q), mechanics_of(model).body
    X, own = np.empty((model.n, model.n)), np.empty((model.n, model.n))
    inertia.inertia_absolute(np.cos(phi), np.sin(phi), body.B, body.I, X)
    inertia.to_joint_angles(X, own)
    assert M[np.ix_(joints, joints)] == pytest.approx(own, rel=1e-6)
