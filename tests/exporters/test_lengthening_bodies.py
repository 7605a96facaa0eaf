"""Bodies that lengthen in MuJoCo and URDF: places, inertia, rests and motions of pliant, in a plane and in space."""

from __future__ import annotations

import numpy as np
import pytest

import pliant
from pliant.exporters.mjcf import branches, control, controls, mjcf
from pliant.exporters.mjcf_step import bounded_by, checked_step, linear_chain
from pliant.exporters.provenance import Provenance
from pliant.exporters.rigid_chain import carrier_of, rigid_chain
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Space, Tendon, chain_model
from pliant.simulation import equilibrium, simulate

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
BODY = {"length": 0.3, "mass": 0.1, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 2e-3,
        "tip_mass": 0.01, "tip_inertia": 2e-6}  # fmt: skip
HALVES = (Extension(60.0, 0.05, 0.0, 0.15, "lower"), Extension(40.0, 0.03, 0.15, None, "upper"))
WITHIN = (Extension(60.0, 0.05, 0.09, 0.13, "near"), Extension(40.0, 0.03, 0.13, None, "far"))  # both move one link
PUSHING = Chamber((1e-6,), axial_gain=30.0, name="a")
TIMES = np.arange(301) * 1e-3  # s


def flat(links: int, **more):
    """In a plane, two chambers, of which one pushes; a point at the side of a link, one at the base."""
    stations = [("side", 0, 0.03, 0.002), ("base", -1, 0.01, 0.001), ("tip", links - 1, 0.15 / links)]
    bends = Chamber((4e-7,), name="b")
    return chain_model(**{**BODY, "links": links, "extensions": HALVES, "chambers": (PUSHING, bends),
                          "gravity": (0.3, -9.81), "stations": stations, **more})  # fmt: skip


def in_space(links: int, *, turned: bool = False, **more):
    """In space, a chamber that pushes and a tendon that presses; all in one plane, or turned, tilted and twisting."""
    azimuth, space = 0.5 * np.pi, Space(1.2, radius=0.012)
    if turned:
        azimuth, space = 0.3, Space(1.2, 0.7, [0.1, -0.05, 0.2], [0.2, -0.1], 0.012)
    cord = Tendon.at_azimuth(azimuth, np.ones(links), driven_by="displacement", lever=8e-3, line_stiffness=2e3,
                             pretension=0.5, name="b")  # fmt: skip
    stations = [("side", 0, 0.03, 0.002, 0.003), ("base", -1, 0.01, 0.001), ("tip", links - 1, 0.15 / links)]
    return chain_model(**{**BODY, "links": links, "extensions": HALVES, "chambers": (PUSHING, cord), "space": space,
                          "gravity": (0.0, 0.3, -9.81), "stations": stations, **more})  # fmt: skip


def compiled(model, **options):
    """A MuJoCo model and its state."""
    xml = mjcf(model, Provenance(model, "mjcf", "test"), **{"time_step": 1e-4, "highest": 1e6, **options})
    loaded = mujoco.MjModel.from_xml_string(xml)
    return loaded, mujoco.MjData(loaded)


def dofs(model, m):
    """How MuJoCo's joints move with the joint coordinates, (nv, N), by the words of the law alone."""
    P, share, turns = np.zeros((m.nv, model.size)), model.stretch_share, model.size - len(model.extensions)
    for row, name in enumerate(mechanics_of(model).joint_names[:turns]):
        for joint in [name, *(f"{b.name}_{row + 1}" for b in branches(model))]:
            P[m.joint(joint).dofadr[0], row] = 1.0
    for j in range(m.njnt):
        if m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
            name = m.joint(j).name
            if name.startswith("point_"):
                point = next(p for p in model.points if name == f"point_{p.name}")
                k, part = point.link + 1, point.along / np.append(model.base_length, model.link_length)[point.link + 1]
            else:
                k = 0 if name == "base_end" else int(name.split("_")[1])
                part = 1.0 if k == 0 or model.mass_at == "tip" else 0.5
            P[j, turns:] = part * np.append(model.base_length, model.link_length)[k] * share[k]
    return P


def place(model, m, d, q):
    """Put MuJoCo's joints where the joint coordinates are."""
    d.qpos[:] = dofs(model, m) @ q
    mujoco.mj_forward(m, d)


def spots(model, m, d):
    """Positions of the observed points, (S, dimension)."""
    return d.site_xpos[[m.site(p.name).id for p in model.points], : 3 if model.space else 2].copy()


def motion(model, pulses, step, integrator):
    """Positions of the observed points in MuJoCo, every millisecond, and by how much constraints were missed, m."""
    m, d = compiled(model, time_step=step, integrator=integrator)
    place(model, m, d, equilibrium(model, np.zeros(2)))
    path, missed = [spots(model, m, d)], 0.0
    for k in range(round(TIMES[-1] / step)):
        for name, c, power in controls(model):
            d.actuator(name).ctrl[0] = control(float(pulses[c]((k + 0.5) * step)), power)
        mujoco.mj_step(m, d)
        if (k + 1) % round(1e-3 / step) == 0:
            missed = max(missed, float(np.abs(d.efc_pos[: d.ne]).max(initial=0.0)))
            mujoco.mj_kinematics(m, d)
            path.append(spots(model, m, d))
    return np.array(path), missed


def levels(model):
    """A pulse of the chamber, and later one of the second input."""
    return pliant.Pulse(90e3, 0.02, 0.12), pliant.Pulse(3e-3 if model.space else 60e3, 0.1, 0.1)


CASES = {
    "plane": flat, "within": lambda n: flat(n, extensions=WITHIN), "tip": lambda n: flat(n, mass_at="tip"),
    "one": lambda n: flat(n, extensions=HALVES[:1]), "space": in_space,
}


@pytest.mark.parametrize("links", [2, 5])
@pytest.mark.parametrize("case", [*CASES, "turned"])
def test_places_and_inertia_are_those_of_the_model(case, links):
    """At coordinates drawn at random; in space with one swing at each joint, where two hinges are a rotation vector."""
    model = in_space(links, turned=True) if case == "turned" else CASES[case](links)
    m, d = compiled(model)
    chain, P, rng = mechanics_of(model), dofs(model, m), np.random.default_rng(links)
    for _ in range(3):
        q = rng.normal(0.0, 0.3, model.size)
        if model.space:
            q[1 : 2 * links : 2], q[2 * links : model.size - 2] = 0.0, 0.0
        x = chain.coordinates(q)
        place(model, m, d, q)
        assert spots(model, m, d) == pytest.approx(chain.stations(x)[0], abs=1e-12)
        M, T = np.zeros((m.nv, m.nv)), chain.from_joints
        mujoco.mj_fullM(m, d, M)
        rows = [k for k in range(model.size) if not model.space or k >= 2 * links or k % 2 == 0]
        own = (T.T @ chain.inertia(x) @ T)[np.ix_(rows, rows)]
        near = 1e-7 if case != "tip" else 1e-4  # what stands at the first joint, where all mass is at the tips
        assert np.abs((P.T @ M @ P)[np.ix_(rows, rows)] - own).max() < near * np.abs(own).max()


@pytest.mark.parametrize("links", [2, 3, 5])
@pytest.mark.parametrize("make", [flat, in_space])
def test_a_rest_is_pliants(make, links):
    """Held under weight and both inputs, forces along the coordinates vanish; strains are those of the model."""
    model = make(links)
    inputs = [60e3, 2e-3 if model.space else 30e3]
    q = equilibrium(model, inputs)
    m, d = compiled(model)
    for name, c, power in controls(model):
        d.actuator(name).ctrl[0] = control(inputs[c], power)
    place(model, m, d, q)
    left = dofs(model, m).T @ (d.qfrc_actuator + d.qfrc_passive - d.qfrc_bias)
    assert np.abs(left / mechanics_of(model).joints.K).max() < 1e-7
    strains = [d.sensor(f"strain_{e.name}_pos").data[0] for e in model.extensions]
    assert strains == pytest.approx(q[-2:], abs=1e-12)
    assert np.abs(q[-2:]).min() > 5e-3
    mujoco.mj_step(m, d, 500)
    assert np.abs(spots(model, m, d) - mechanics_of(model).stations(mechanics_of(model).coordinates(q))[0]).max() < 1e-6


def test_the_keyframe_is_the_rest():
    model = flat(3, memory=Memory((0.2,), (0.1,)), gravity=(2.0, -9.81))
    m, d = compiled(model)
    mujoco.mj_resetDataKeyframe(m, d, m.key("rest").id)
    assert d.qpos == pytest.approx(dofs(model, m) @ equilibrium(model, [0.0, 0.0]), abs=1e-15)


@pytest.mark.parametrize(("case", "links", "bound"), [("plane", 2, 1e-7), ("within", 2, 1e-7)])
def test_runge_and_kutta_keep_to_a_tenth_of_a_micrometre(case, links, bound):
    moves_as_pliant(CASES[case](links), 2e-4, "RK4", bound)


def moves_as_pliant(model, step, integrator, bound, reference=2e-5):
    """Run both; return the largest difference of a point, m."""
    run = simulate(model, levels(model), times=TIMES, time_step=reference, check=False)
    seen, wanted = motion(model, levels(model), step, integrator), run.station_position.values
    assert np.ptp(wanted[:, -1], axis=0).max() > 0.05
    assert np.ptp(run.axial_strain.values, axis=0).max() > 0.04
    assert seen[1] < max(5e-6, 0.3 * bound)
    apart = float(np.abs(seen[0] - wanted).max())
    assert apart < bound
    return apart


@pytest.mark.slow
@pytest.mark.parametrize("links", [2, 3, 5])
@pytest.mark.parametrize("case", list(CASES))
def test_motions_of_all_bodies(case, links):
    """RK4 to a micrometre, the method of first order to a tenth of a millimetre, half of it at half the step."""
    model = CASES[case](links)
    moves_as_pliant(model, 1e-4, "RK4", 2e-6 if case == "tip" else 1e-6)
    coarse, fine = (moves_as_pliant(model, step, "Euler", 5e-4) for step in (2e-4, 1e-4))
    assert fine < 0.6 * coarse


@pytest.mark.slow
@pytest.mark.parametrize("links", [2, 3])
def test_in_space_hinges_are_all_that_differs(links):
    """Turned, tilted and twisting: as far from the model as the same body where nothing lengthens."""
    model = in_space(links, turned=True)
    stiff = model.with_(extensions=())
    run = simulate(stiff, levels(stiff), times=TIMES, time_step=1e-4, check=False)
    hinges = np.abs(motion(stiff, levels(stiff), 1e-4, "RK4")[0] - run.station_position.values).max()
    assert moves_as_pliant(model, 1e-4, "RK4", 3e-3, reference=1e-4) < 2.0 * hinges


def test_creep_beside_what_lengthens():
    """Hidden hinges stand beside those of the joints; strains have none."""
    model = flat(2, memory=Memory((0.2,), (0.1,)))
    moves_as_pliant(model, 2e-4, "Euler", 5e-4)


@pytest.mark.parametrize("segments", [
    HALVES, (Extension(5e4, 40.0, name="stiff"),), (Extension(60.0, 5.0, name="damped"),),
])
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_the_longest_step_is_the_longest(integrator, segments, tmp_path, monkeypatch):
    """Euler takes dampers of segments at the beginning of a step, those of joints at its end."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log into the working folder
    model = flat(2, extensions=segments, gravity=(0.0, 0.0))
    chain = linear_chain(model, [])
    stays, low, high = bounded_by(chain, integrator), 1e-8, 1.0
    for _ in range(60):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if stays(middle) else (low, middle)
    chosen = checked_step(chain, integrator, 0.0)
    assert chosen <= 0.5 * low
    for part, bounded in ((0.8, True), (2.5, False)):
        m, d = compiled(model, time_step=chosen, integrator=integrator)
        m.opt.timestep = part * low
        place(model, m, d, np.append([0.1, 0.1], np.full(len(segments), 1e-3)))
        mujoco.mj_step(m, d, 3000)
        lost = not np.abs(d.qpos).max() < 1.0 or d.warning[mujoco.mjtWarning.mjWARN_BADQACC].number > 0
        assert lost != bounded or (integrator == "RK4" and not bounded)  # whose bound is on the safe side here


def test_implicit_integrators_are_refused():
    assert compiled(flat(2))[0].opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    for integrator in ("implicit", "implicitfast"):
        with pytest.raises(pliant.InputError, match="take integrator=Euler or integrator=RK4"):
            compiled(flat(2), integrator=integrator)


def test_a_point_at_a_body_needs_no_slide_of_its_own():
    model = flat(2)
    bodies = rigid_chain(model)
    names = [carrier_of(model, bodies, p)[0] for p in model.points]
    slides = [carrier_of(model, bodies, p)[2] for p in model.points]
    assert (names[-1], slides[-1]) == ("link_2_end", None)
    assert [s.name for s in slides[:2] if s] == ["point_side", "point_base"]


@pytest.mark.parametrize("case", [*CASES, "turned"])
def test_urdf_has_the_places_of_the_model(case, tmp_path):
    """Joints are named as the coordinates; those along links follow the strains."""
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed: pip install 'pliant[export]'")
    model = in_space(3, turned=True) if case == "turned" else CASES[case](3)
    done = pliant.export(model, "urdf", tmp_path / "arm.urdf")
    robot = yourdfpy.URDF.load(str(done.files[0]), build_scene_graph=True, load_meshes=False)
    assert robot.validate()
    chain, rng = mechanics_of(model), np.random.default_rng(3)
    assert set(robot.actuated_joint_names) == set(chain.joint_names)
    for _ in range(4):
        q = rng.normal(0.0, 0.3, model.size)
        if model.space:
            q[1:6:2], q[6 : model.size - 2] = 0.0, 0.0
        robot.update_cfg(dict(zip(chain.joint_names, q, strict=True)))
        for point, spot in zip(model.points, chain.stations(chain.coordinates(q))[0], strict=True):
            name = "base_point" if point.name == "base" else point.name
            assert robot.get_transform(name)[: spot.size, 3] == pytest.approx(spot, abs=1e-12)
    mass = sum(link.inertial.mass for link in robot.robot.links if link.inertial)
    assert mass == pytest.approx(model.mass, rel=1e-4 if case == "tip" else 1e-7)
