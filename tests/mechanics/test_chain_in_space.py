"""The chain in space behind the interface of mechanics: equal to the plane where it bends in one, else consistent."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pliant
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Space, Station, Tendon
from pliant.simulation.forces import PointForce

BODY = {"length": 0.3, "mass": 0.1, "links": 5, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 2e-3,
        "torque": (1e-6,), "tip_mass": 0.01}  # fmt: skip


def pair(**more):
    """The same chain in a plane and in space; gravity along the base."""
    plane = pliant.chain_model(**BODY, gravity=(0.3, -9.81), **more)
    return plane, pliant.chain_model(**BODY, gravity=(0.0, 0.3, -9.81), space=True, **more)


def turned_chain(rng, *, twist=True):
    space = Space(
        stiffness_ratio=1.4, twist_ratio=0.8 * twist, radius=0.02, rest_turn=rng.normal(0, 0.2, (5, 3)),
        base_tilt=rng.normal(0, 0.3, 3),
    )
    return pliant.chain_model(**BODY, gravity=(1.0, -2.0, -9.0), space=space, cubic_stiffening=0.4)


def test_rest_and_modes_are_those_of_the_plane_twice():
    plane, space = pair()
    q = pliant.equilibrium(space, 50e3).reshape(5, 2)
    assert np.allclose(q[:, 0], pliant.equilibrium(plane, 50e3), rtol=0, atol=1e-11)
    assert np.abs(q[:, 1]).max() < 1e-12
    assert np.allclose(pliant.modes(space, q.ravel())[0][::2], pliant.modes(plane, q[:, 0])[0], rtol=0.05)
    assert np.allclose(np.sort(pliant.modes(pair()[1].with_(gravity=(0, 0, 0)))[0])[::2],
                       pliant.modes(pair()[0].with_(gravity=(0, 0)))[0], rtol=1e-12)  # fmt: skip


@pytest.mark.slow  # compiles the step
def test_a_motion_in_one_plane_is_that_of_the_planar_chain():
    plane, space = pair(cubic_stiffening=0.3)
    push = pliant.Pulse(100e3, 0.05, 1.0)
    a, b = (pliant.simulate(m, push, duration=0.4) for m in (plane, space))
    assert np.abs(a.tip_position.values - b.tip_position.values[..., 1:]).max() < 1e-12
    assert np.abs(b.tip_position.values[..., 0]).max() < 1e-15
    for name in ("kinetic_energy", "elastic_energy", "input_work", "dissipated_energy"):
        assert np.allclose(a[name], b[name], rtol=1e-9, atol=1e-13)


def test_jacobians_of_points_are_those_of_differences():
    rng = np.random.default_rng(3)
    model = turned_chain(rng).with_(stations=[Station("m", 2, 0.02, 0.01, -0.02)])
    chain, x = mechanics_of(model), rng.normal(0, 0.5, 15)
    J = chain.position_jacobian(x, model.points[0])
    moved = [chain.stations(x + h)[0][0] - chain.stations(x - h)[0][0] for h in np.eye(15) * 1e-6]
    assert np.allclose(J, np.array(moved).T / 2e-6, atol=1e-9)
    place, slopes = chain.points_and_slopes(x)
    assert np.allclose(place, chain.stations(x)[0], atol=1e-14)
    assert np.allclose(slopes[0], J, atol=1e-14)
    v = rng.normal(0, 2.0, (1, 15))
    rows, rates = chain.tip_jacobian(x[None], v)
    ahead, behind = (chain.tip_jacobian(x[None] + s * v, v)[0] for s in (1e-6, -1e-6))
    assert np.allclose(rates, (ahead - behind) / 2e-6, atol=1e-6)
    moved = (chain.tips(x + 1e-6 * v[0]) - chain.tips(x - 1e-6 * v[0]))[-1]
    assert np.allclose(rows[0] @ v[0], moved / 2e-6, atol=1e-7)


def test_points_beside_links_are_found_where_stations_put_them():
    rng = np.random.default_rng(4)
    model = turned_chain(rng).with_(stations=[Station("a", 3, 0.02, 0.01, -0.02), Station("b", -1, 0.01, 0.0, 0.03)])
    chain, x = mechanics_of(model), rng.normal(0, 0.5, 15)
    places, _ = chain.stations(x)
    beside = chain.beside_links(x, places)
    for station, row in zip(model.points, beside, strict=True):
        assert np.allclose(row[station.link + 1], station[2:], atol=1e-15)


def test_forces_are_the_slopes_of_the_energies():
    rng = np.random.default_rng(5)
    model = turned_chain(rng)
    chain, x = mechanics_of(model), rng.normal(0, 0.4, 15)
    def potential(x):
        energy = chain.energy(x, 0.0 * x)
        return energy.elastic + energy.gravity
    slope = [(potential(x + h) - potential(x - h)) / 2e-5 for h in np.eye(15) * 1e-5]
    assert np.allclose(chain.static_forces(x, np.zeros(15)), -np.array(slope), atol=2e-9)
    pull, place = np.array([0.3, -0.2, 0.5]), Station("p", 3, 0.02, 0.01, -0.015)
    load = chain.link_loads([place], pull[None, None])[0]
    assert np.allclose(chain.load_forces(x, load), pull @ chain.position_jacobian(x, place), atol=1e-14)
    ahead = [chain.load_forces(x + h, load) - chain.load_forces(x - h, load) for h in np.eye(15) * 1e-6]
    assert np.allclose(chain.load_stiffness(x, load), np.array(ahead) / 2e-6, atol=1e-8)


def test_kinetic_energy_is_half_of_v_inertia_v_along_whole_motions():
    rng = np.random.default_rng(6)
    chain = mechanics_of(turned_chain(rng))
    x, v = rng.normal(0, 0.5, (3, 15)), rng.normal(0, 2.0, (3, 15))
    whole = chain.energy(x, v).kinetic
    assert np.allclose(whole, [0.5 * b @ chain.inertia(a) @ b for a, b in zip(x, v, strict=True)], rtol=1e-12)
    assert np.allclose(np.linalg.norm(chain.directions(x), axis=-1), 1.0)


def test_a_body_turned_with_gravity_rests_in_the_turned_shape():
    """The base tilted by some angle under gravity turned the same way: the same joint angles, the shape turned."""
    model = pliant.chain_model(**BODY, gravity=(2.0, 1.0, 6.0), space=True)
    tilt = np.array([0.4, -0.7, 0.5])
    R = Rotation.from_rotvec(tilt)
    turned = model.with_(gravity=R.as_matrix() @ model.gravity, space=Space(base_tilt=tilt))
    q, same = pliant.equilibrium(model, 60e3), pliant.equilibrium(turned, 60e3)
    assert np.allclose(q, same, atol=1e-11)
    assert np.allclose(R.apply(mechanics_of(model).tips(q)), mechanics_of(turned).tips(same), atol=1e-12)


def test_a_turn_of_the_base_about_its_tangent_is_a_turn_of_all_azimuths():
    def pulled(turn, **space):
        cords = [Tendon.at_azimuth(a + turn, np.ones(5), name=f"{a}", lever=0.01) for a in (0.5, 2.6)]
        return pliant.chain_model(**{k: v for k, v in BODY.items() if k != "torque"}, chambers=cords,
                                  gravity=(0.0, 0.0, 6.0), space=Space(**space))  # fmt: skip

    moved, turned = pulled(-0.3), pulled(0.0, base_tilt=(0.0, 0.0, -0.3))
    tips = [mechanics_of(m).tips(pliant.equilibrium(m, [9.0, 4.0])) for m in (moved, turned)]
    assert np.allclose(*tips, atol=1e-10)
    assert np.abs(tips[0] - mechanics_of(moved).tips(pliant.equilibrium(pulled(0.0), [9.0, 4.0]))).max() > 1e-2


def test_a_force_at_the_tip_of_a_round_section_bends_it_in_the_plane_of_the_force():
    model = pliant.chain_model(**BODY, space=True)
    q = pliant.equilibrium(model, 0.0, np.array([0.3, 0.4, 0.0])).reshape(5, 2)
    assert np.allclose(q[:, 1] / q[:, 0], -0.75, atol=1e-9)


@pytest.mark.slow  # compiles the step of a chain that twists
def test_a_stepper_pushed_out_of_plane_balances_its_energy():
    rng = np.random.default_rng(7)
    model = turned_chain(rng)
    stepper = pliant.Stepper(model, time_step=5e-4)
    stepper.push(np.array([0.05, 0.02, 0.0]))
    for _ in range(600):
        stepper.step(30e3)
    assert stepper.energy_gain < 1e-3
    assert stepper.energy_loss < 1e-3
    push = PointForce(np.zeros(1), np.array([[0.05, 0.02, 0.0]]), model.points[-1])
    motion = pliant.simulate(
        model, pliant.Pulse(30e3, 0.0, 9.0), duration=0.3, time_step=5e-4, check=False, forces=[push],
        initial_angle=pliant.equilibrium(model),
    )
    assert np.allclose(stepper.tips()[-1], motion.tip_position.values[-1, -1], atol=1e-9)


def test_a_linear_model_in_space_moves_as_the_chain_does():
    """Static gains against the rests under a little more of each input; poles against the modes."""
    cord = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3, "name": "cord"}
    tendon = Tendon.at_azimuth(0.7, np.ones(5), **cord)
    body = {k: v for k, v in BODY.items() if k != "torque"} | {"chambers": [Chamber((1e-6,), cross_gain=0.4), tendon]}
    model = pliant.chain_model(**body, gravity=(1.0, -2.0, -9.0), space=True)
    rest = np.array([30e3, 3e-3])
    linear = pliant.linearise(model, rest)
    assert linear.outputs[:3] == ("tip_x", "tip_y", "tip_z")
    for c, more in enumerate((10.0, 1e-6)):
        beside = [pliant.equilibrium(model, rest + s * more * np.eye(2)[c]) for s in (1, -1)]
        up, down = (mechanics_of(model).tips(q)[-1] for q in beside)
        gains = [linear.static_gain(name, c) for name in linear.outputs[:3]]
        assert np.allclose(gains, (up - down) / (2 * more), rtol=1e-4, atol=1e-6 * np.abs(gains).max())
    assert linear.poles().real.max() < 0
