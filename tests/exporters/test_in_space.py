"""Bodies in space: each target against pliant's own motion, and what it says that it leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from binding import Arm
from target_models import EVERY_BRANCH, in_space, longer, pulled, tied, twisting

import pliant
from pliant.errors import InputError
from pliant.exporters.c99 import code
from pliant.exporters.features import without
from pliant.exporters.mjcf import controls, mjcf
from pliant.exporters.provenance import Provenance
from pliant.exporters.rigid_chain import hinge_difference, rigid_chain, tip_by_hinges
from pliant.exporters.state_space import matrices
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Memory, Model, Space, Valve, chain_model
from pliant.simulation import Stepper, equilibrium
from pliant.simulation.state import typical_pressure

INPUTS = {"longer": [30e3, 10e3, 2e-3], "tied": [30e3, 10e3, 2e-3],
          "in_space": [30e3, 10e3, 0.0], "twisting": [30e3, 10e3, 0.0], "pulled": [2e-3, 0.3, 1.0]}  # fmt: skip


def bent_alike(links: int, swing: float) -> Model:
    """A body in space whose joints bend by `swing` [rad] about both axes under one chamber."""
    model = chain_model(
        length=0.3, mass=0.1, links=links, joint_placement="midsegment", stiffness=0.5, damping=5e-3,
        torque=[1e-6], cross_gain=1.0, space=Space(radius=0.01), name="arm",
    )
    return model.with_(torque=[model.stiffness[0] * swing / 1e5])


@pytest.mark.slow
def test_state_space_follows_small_steps(spatial):
    """From its rest under all inputs, a small change of the first one."""
    from scipy.linalg import expm

    level, h = np.array(INPUTS[spatial.name]), 1e-3
    content = matrices(spatial, level, 0.0)
    N, change = len(content["state"]), 0.01 * level[0]
    block = np.zeros((N + 1, N + 1))
    block[:N, :N], block[:N, N] = content["A"], content["B"][:, 0] * change
    move, x, stepper = expm(block * h), np.zeros(N), Stepper(spatial, h, level)
    rest, tip = stepper.angle.copy(), stepper.tips()[-1]
    assert content["operating_state"][: rest.size] == pytest.approx(rest, abs=1e-12)
    rows = []
    for _ in range(200):
        x = move[:N, :N] @ x + move[:N, N]
        stepper.step(level + np.array([change, 0.0, 0.0]))
        rows.append((stepper.tips()[-1] - tip, (content["C"] @ x)[:3]))
    moved, linear = np.moveaxis(rows, 1, 0)
    assert np.abs(moved - linear).max() < 0.02 * np.abs(moved).max()
    units = dict(zip(content["state"], content["state_unit"], strict=True))
    assert (units["bend_x_1"], units["bend_rate_y_2"]) == ("rad", "rad/s")
    if spatial.name == "pulled":
        assert (content["input_unit"], units["angle_pair"]) == (["m", "rad", "N"], "rad")


def guided() -> Model:
    """A body whose tendons run along chords between guides."""
    return pulled(2).with_(chambers=[replace(cord, spacing=0.05) for cord in pulled(2).chambers])


@pytest.mark.slow
@pytest.mark.parametrize("make", [longer, tied, guided])
def test_state_space_of_further_bodies_follows_small_steps(make):
    test_state_space_follows_small_steps(make())


def test_typical_input_bends_by_half_a_radian(spatial):
    level = typical_pressure(spatial)
    far = equilibrium(spatial, [level, 0.0, 0.0]) - equilibrium(spatial, [0.0, 0.0, 0.0])
    assert np.linalg.norm(far[: 2 * spatial.n].reshape(-1, 2).sum(axis=0)) == pytest.approx(0.5, rel=0.05)


def of_all_kinds() -> Model:
    """Two joints that twist, soften and remember, a chamber, a tendon that may hang slack, a pair, both with guides."""
    soft = {"stiffening": -0.2, "cubic_stiffening": 0.1, "stiffening_bound": 0.7}
    memory = Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1)
    cords = (replace(cord, spacing=0.05) for cord in pulled(2).chambers[:2])
    inputs = (twisting(2).chambers[0], *cords)
    return twisting(2).with_(chambers=inputs, memory=memory, name="all_kinds", **soft)


def remembering() -> Model:
    """Joints that twist and segments that lengthen, all with every branch of hysteresis; chambers and a tendon."""
    return longer(2).with_(memory=replace(EVERY_BRANCH, axial_slip_strain=(0.002, 0.03)), name="remembering")


@pytest.mark.slow  # compiles four texts of C
@pytest.mark.parametrize("make", [twisting, of_all_kinds])
def test_single_precision_follows_double(make, tmp_path):
    """Without a warning of the compiler, and with the tensions of tendons found in each step."""
    model, arms = make(), []
    for precision in ("double", "single"):
        (tmp_path / precision).mkdir()
        arms.append(Arm(model, tmp_path / precision, precision=precision))
    level = np.array(INPUTS.get(model.name, [30e3, 2e-3, 0.3]))
    for k in range(400):
        assert [arm.step(*(level * (k // 100 % 2 == 0))) for arm in arms] == [0, 0]
        assert np.abs(arms[1].angle - arms[0].angle).max() < 1e-5
    assert np.abs(arms[0].angle).max() > 0.05


@pytest.mark.parametrize(("make", "levels"), [
    pytest.param(of_all_kinds, [60e3, 4e-3, 0.8], marks=pytest.mark.slow),
    pytest.param(longer, [40e3, 10e3, 4e-3], marks=pytest.mark.slow),
    pytest.param(tied, [40e3, 10e3, 4e-3], marks=pytest.mark.slow),
    pytest.param(remembering, [40e3, 10e3, 4e-3], marks=pytest.mark.slow),
])  # fmt: skip
def test_c_takes_the_steps_of_the_stepper(tmp_path, make, levels):
    """Inputs that change; what the C says of its state."""
    model, levels = make(), np.array(levels)
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3, np.zeros(3))
    chain, worst, farthest = mechanics_of(model), 0.0, 0.0
    assert arm.angle == pytest.approx(stepper.position, abs=1e-14)
    for k in range(600):
        now = levels * (0.0, 1.0, -1.0)[k // 200]
        assert arm.step(*now) == 0
        stepper.step(now)
        worst = max(worst, np.abs(arm.angle - stepper.position).max(), 1e-3 * np.abs(arm.rate - stepper.velocity).max())
        farthest = max(farthest, np.abs(stepper.position).max())
    assert farthest > 0.2
    assert worst < 1e-13
    places, angles = stepper.stations()
    poses = arm.ask("stations", (len(model.points), 4))[0]
    assert poses == pytest.approx(np.column_stack([places, angles]), abs=1e-13)
    assert arm.ask("tips", (model.n, 3))[0] == pytest.approx(stepper.tips(), abs=1e-13)
    assert arm.ask("joint_angles", (model.size,))[0] == pytest.approx(arm.angle, abs=0.0)
    if model.memory.has_axial:
        creep, _, slip, _ = np.abs(stepper.memory[-2:, :4]).T
        assert creep.min() > 1e-3
        assert slip.max() == pytest.approx(0.002)  # its limit
    energies = chain.energy(stepper.position, stepper.velocity)
    assert arm.ask("energy", (3,))[0] == pytest.approx(list(energies), abs=1e-13)


def compiled(model, **options):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
    xml = mjcf(model, Provenance(model, "mjcf", "test"), **options)
    loaded = mujoco.MjModel.from_xml_string(xml)
    return mujoco, loaded, mujoco.MjData(loaded)


def put(model, m, d, q):
    for name, value in zip(mechanics_of(model).joint_names, q, strict=True):
        d.qpos[m.joint(name).qposadr[0]] = value


def driven(model, m, d, levels):
    for name, c, _ in controls(model):
        d.ctrl[m.actuator(name).id] = levels[c]


def test_mujoco_has_the_places_of_the_hinges_and_the_inertia(spatial):
    """Of hinges turned one by one, which for one angle at each joint are pliant's swings."""
    mujoco, m, d = compiled(spatial)
    chain = mechanics_of(spatial)
    one = np.zeros(spatial.size)
    one[: 2 * spatial.n].reshape(-1, 2)[:, 0] = np.linspace(0.3, -0.2, spatial.n)
    both = np.linspace(-0.2, 0.3, spatial.size)
    for x in (one, both):
        put(spatial, m, d, x)
        mujoco.mj_forward(m, d)
        tip = d.site_xpos[m.site("tip").id]
        assert tip == pytest.approx(tip_by_hinges(rigid_chain(spatial), x), abs=1e-12)
        if x is one:
            places, _ = chain.stations(x)
            for point, place in zip(spatial.points, places, strict=True):
                assert d.site_xpos[m.site(point.name).id] == pytest.approx(place, abs=1e-12)
            M = np.zeros((m.nv, m.nv))
            mujoco.mj_fullM(m, d, M)
            rows = [m.joint(name).dofadr[0] for name in chain.joint_names]
            axes = [h.row for h in rigid_chain(spatial).hinges]
            own = chain.inertia(x)
            bends = [k for k in range(spatial.size) if k < 2 * spatial.n and k % 2 == 0]
            assert M[np.ix_(rows, rows)][np.ix_(bends, bends)] == pytest.approx(own[np.ix_(bends, bends)], abs=1e-9)
            assert sorted(axes) == list(range(spatial.size))


@pytest.mark.parametrize("make", [in_space, pulled, pytest.param(twisting, marks=pytest.mark.slow)])
def test_mujoco_moves_as_pliant(make):
    """From rest, all inputs stepped; hinges are not swings, so within what they differ by."""
    model = make()
    levels, h = np.array(INPUTS[model.name]), 2e-4
    mujoco, m, d = compiled(model, time_step=h, highest=1e6)
    put(model, m, d, equilibrium(model, np.zeros(3)))
    stepper, rows = Stepper(model, h, np.zeros(3)), []
    driven(model, m, d, levels)
    for _ in range(2000):
        mujoco.mj_step(m, d)
        stepper.step(levels)
        mujoco.mj_kinematics(m, d)
        rows.append((d.site_xpos[m.site("tip").id].copy(), stepper.stations()[0][-1]))
    seen, wanted = np.moveaxis(rows, 1, 0)
    moved = np.linalg.norm(wanted - wanted[0], axis=1).max()
    apart = np.linalg.norm(seen - wanted, axis=1).max()
    assert moved > 0.03
    assert apart < 0.01 * moved


def test_hinges_the_other_way_round_at_half_of_the_joints_lie_nearer():
    """The twist of a pair of hinges cancels: with all x before y the tip lies several times as far away."""
    model = bent_alike(8, 0.1)
    x = np.full(model.size, 0.1)
    chain = rigid_chain(model)
    alike = chain._replace(links=tuple(
        link._replace(hinges=tuple(sorted(link.hinges, key=lambda h: h.row))) for link in chain.links
    ))
    tip = mechanics_of(model).tips(x)[-1]
    near, far = (np.linalg.norm(tip_by_hinges(c, x) - tip) for c in (chain, alike))
    assert near < 0.2 * far


def at_rest_in_mujoco(model, pressure, link):
    """The distance of MuJoCo's tip at rest from pliant's, from a start at pliant's rest."""
    mujoco, m, d = compiled(model, time_step=1e-3, highest=1e7)
    rest = equilibrium(model, pressure)
    put(model, m, d, rest)
    driven(model, m, d, [pressure])
    mujoco.mj_step(m, d, 4000)
    assert np.abs(d.qvel).max() < 1e-9
    mujoco.mj_kinematics(m, d)
    return np.linalg.norm(d.site_xpos[m.site(link).id] - mechanics_of(model).tips(rest)[-1])


def test_the_difference_of_hinges_is_that_of_mujoco_at_rest():
    """Bent by a torque without gravity, MuJoCo rests nearly as far from pliant's rest as in the worst direction."""
    model = bent_alike(4, 0.5 / np.sqrt(2.0) / 4)
    apart, stated = at_rest_in_mujoco(model, 1e5, "link_4"), hinge_difference(model)
    assert 0.9 * stated < apart <= stated * (1 + 1e-6)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_hinges_sag_no_further_than_the_file_states(n):
    """Under gravity across the body the hinges rest at other angles: with two, twice as far as at equal angles."""
    azimuth, ones = 0.3, np.ones(n)
    pull = Chamber(torque=(6e-7,), joint_gain=-np.sin(azimuth) * ones, cross_gain=np.cos(azimuth) * ones)
    model = Model(link_length=0.2 / n * ones, link_mass=0.15 / n * ones, stiffness=1.0, damping=0.2,
                  gravity=[0.0, -9.81, 0.0], space=Space(), chambers=(pull,))  # fmt: skip
    apart, stated = at_rest_in_mujoco(model, typical_pressure(model), f"link_{n}"), hinge_difference(model)
    assert apart <= stated * (1 + 1e-6)
    assert apart > (0.5 if n == 1 else 0.999) * stated


def test_dead_time_holds_at_shorter_steps():
    model = bent_alike(2, 0.1).with_(valve=Valve(dead_time=0.02))
    mujoco, m, d = compiled(model, time_step=1e-3, highest=1e6)
    for step in (2e-3, 1e-3, 1e-4, 1e-5):
        m.opt.timestep = step
        mujoco.mj_resetData(m, d)
        driven(model, m, d, [5e4])
        mujoco.mj_step(m, d, round(0.02 / step))
        assert not d.actuator_force.any()
        mujoco.mj_step(m, d, 2)
        assert d.actuator_force.any()


def test_a_slack_tendon_does_not_push():
    model = pulled()
    mujoco, m, d = compiled(model, highest=1.0)
    put(model, m, d, np.zeros(model.size))
    driven(model, m, d, [-0.01, -0.2, 0.0])
    d.act[:] = -0.2
    mujoco.mj_forward(m, d)
    forces = {m.actuator(a).name: d.actuator_force[a] for a in range(m.nu)}
    assert forces["displacement_long"] == 0.0
    assert forces["angle_pair"] == pytest.approx(-0.2 * 0.01 * 2e3)


@pytest.mark.parametrize("pretension", [0.0, 40.0])
def test_a_pair_in_mujoco_pulls_with_its_imbalance(pretension):
    """A pair with pretension is written with both tendons taut."""
    first, pair, last = pulled().chambers
    model = pulled().with_(chambers=[first, replace(pair, imbalance=5.0, pretension=pretension), last])
    mujoco, m, d = compiled(without(model, ("pair_pretension",)), highest=1.0)
    put(model, m, d, np.zeros(model.size))
    d.act[:] = 0.2
    mujoco.mj_forward(m, d)
    stiffness, T0, *_ = model.actuation.tendon_constants
    T = np.maximum(np.array([0.2, -0.2]) * 0.01 * stiffness[1:3] + T0[1:3], 0.0)
    assert d.actuator("angle_pair").force[0] == pytest.approx(T[0] - T[1])


def test_what_is_not_expressed_is_refused(tmp_path):
    soft = in_space().with_(stiffening=-0.1)
    with pytest.raises(InputError, match="soften with the size of a swing: not expressible in mjcf"):
        pliant.export(soft, "mjcf", tmp_path / "a.xml")
    done = pliant.export(soft, "mjcf", tmp_path / "a.xml", approximate=True)
    assert 0 < done.difference.rms < done.difference.largest
    assert "mm from the model's" in done.notes[-1]
    assert "its tangent along +z" in (tmp_path / "a.xml").read_text()


@pytest.mark.slow
def test_a_strain_that_changes_the_bending_stiffness_is_refused_where_nothing_writes_it(tmp_path):
    with pytest.raises(InputError, match="bending stiffness that changes with the strain of segment near"):
        pliant.export(tied(), "mjcf", tmp_path / "a.xml")
    done = pliant.export(tied(), "mjcf", tmp_path / "a.xml", approximate=True)
    assert 0 < done.difference.rms < done.difference.largest


def test_urdf_has_the_places_of_the_hinges(spatial, tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed: pip install 'pliant[export]'")
    done = pliant.export(spatial, "urdf", tmp_path / "arm.urdf")
    robot = yourdfpy.URDF.load(str(done.files[0]), build_scene_graph=True, load_meshes=False)
    assert robot.validate()
    x = np.zeros(spatial.size)
    x[1 : 2 * spatial.n : 2] = np.linspace(0.2, -0.1, spatial.n)
    robot.update_cfg(dict(zip(mechanics_of(spatial).joint_names, x, strict=True)))
    places, _ = mechanics_of(spatial).stations(x)
    for point, place in zip(spatial.points, places, strict=True):
        name = "base_point" if point.name == "base" else point.name
        assert robot.get_transform(name)[:3, 3] == pytest.approx(place, abs=1e-9)
    assert sum(link.inertial.mass for link in robot.robot.links if link.inertial) == pytest.approx(
        sum(link.mass for link in rigid_chain(spatial).links))


def test_a_rest_shape_that_turns_by_a_right_angle(tmp_path):
    """Where rotations about x, y and z are not unique."""
    model = in_space()
    turned = model.with_(space=replace(model.space, rest_turn=[0.0, np.pi / 2, 0.0]))
    pliant.export(turned, "urdf", tmp_path / "arm.urdf")


def test_the_control_of_each_input_reaches_its_own_level(tmp_path):
    """A displacement in m, an angle in rad and a tension in N: one number does not do for all."""
    model = pulled()
    mujoco, m, _ = compiled(model)
    ends = [2.0 * typical_pressure(model, c) for c in range(3)]
    ranges = [m.actuator(f"{kind}_{name}").ctrlrange for kind, name in zip(
        ("displacement", "angle", "tension"), ("long", "pair", "short"), strict=True)]  # fmt: skip
    np.testing.assert_allclose(ranges, [[-ends[0], ends[0]], [-ends[1], ends[1]], [0.0, ends[2]]], rtol=1e-9)
    written = pliant.export(model, "mjcf", tmp_path / "a.xml", approximate=True, highest=[0.004, 0.5, 3.0])
    m = mujoco.MjModel.from_xml_path(str(written.files[0]))
    assert [m.actuator(a).ctrlrange[1] for a in range(3)] == [0.004, 0.5, 3.0]
    assert not any("controls range" in line for line in written.notes)
    notes = pliant.export(model, "mjcf", tmp_path / "b.xml", approximate=True).notes
    upper = f"{1e3 * ends[0]:.4g} mm (long), {ends[1]:.4g} rad (pair), {ends[2]:.4g} N (short)"
    assert f"controls range from 0 to {upper}: set highest (m, rad, N) for another range" in notes
    with pytest.raises(InputError, match=r"the inputs long \[m\], pair \[rad\], short \[N\]: give one for each"):
        pliant.export(model, "mjcf", tmp_path / "c.xml", approximate=True, highest=1e5)


def test_the_header_and_the_origin_state_the_unit_of_each_input():
    model = pulled(2)
    origin = Provenance(model, "c99", "test")
    assert origin.to_dict()["frame"].endswith("its tangent along +z; inputs: long [m], pair [rad], short [N]")
    made = code(model, origin, time_step=1e-3, precision="double", pressure=[2e-3, 0.0, 1.0], prefix="arm")
    assert "equilibrium under 0.002 m, 0 rad, 1 N, for" in made.header
    declared = made.header.partition("typedef")[2]
    assert "/* N/m (input in m), N/rad (input in rad), 1 (input in N) */" in declared
    assert "/* s, s, m/s or rad/s or N/s, m/s or rad/s or N/s */" in declared
    assert "Pa/s" not in declared
