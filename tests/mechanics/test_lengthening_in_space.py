"""Models in space whose segments lengthen: the plane's motion, closed forms of a bar, forces and their energies."""

from itertools import pairwise

import numpy as np
import pytest

from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Space, Station, Tendon, chain_model, load_model, save_model
from pliant.simulation import Pulse, equilibrium, modes, simulate
from pliant.simulation.forces import PointForce

BODY = {"length": 0.3, "mass": 0.1, "links": 4, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 2e-3,
        "tip_mass": 0.01}  # fmt: skip
HALVES = (Extension(60.0, 0.05, 0.0, 0.15, "lower"), Extension(40.0, 0.03, 0.15, None, "upper"))
CHAMBERS = (Chamber((1e-6,), axial_gain=30.0, name="a"), Chamber((4e-7,), joint_gain=(0, 0, 1, 1), name="b"))
CORD = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3}


def pair():
    """The same chain in a plane and in space."""
    body = {**BODY, "extensions": HALVES, "chambers": CHAMBERS}
    return chain_model(**body, gravity=(0.3, -9.81)), chain_model(**body, gravity=(0.0, 0.3, -9.81), space=True)


def turned_chain(**more):
    rng = np.random.default_rng(2)
    space = Space(stiffness_ratio=1.4, twist_ratio=0.8, radius=0.02, rest_turn=rng.normal(0, 0.2, (4, 3)),
                  base_tilt=rng.normal(0, 0.3, 3))  # fmt: skip
    return chain_model(**{**BODY, "extensions": HALVES, "chambers": CHAMBERS, "gravity": (1.0, -2.0, -9.0),
                          "space": space, "cubic_stiffening": 0.4, **more})  # fmt: skip


def test_rest_and_modes_are_those_of_the_plane():
    plane, space = pair()
    pressure = np.array([50e3, 30e3])
    flat, q = equilibrium(plane, pressure), equilibrium(space, pressure)
    assert np.allclose(q[:8:2], flat[:4], rtol=0, atol=1e-11)
    assert np.allclose(q[8:], flat[4:], rtol=0, atol=1e-11)
    assert np.abs(q[1:8:2]).max() < 1e-12
    assert np.abs(flat[4:]).min() > 1e-3
    found = modes(space, q)[0]
    assert all(np.abs(found / f - 1).min() < 1e-9 for f in modes(plane, flat)[0])


@pytest.mark.slow  # compiles the step
def test_a_motion_in_one_plane_is_that_of_the_planar_chain():
    plane, space = pair()
    push, none = Pulse(80e3, 0.05, 1.0), Pulse(20e3, 0.2, 0.1)
    a, b = (simulate(m, (push, none), duration=0.3, time_step=1e-3) for m in (plane, space))
    assert np.abs(a.tip_position.values - b.tip_position.values[..., 1:]).max() < 1e-11
    for name in ("kinetic_energy", "elastic_energy", "input_work", "dissipated_energy", "axial_strain", "extension"):
        assert np.allclose(a[name], b[name], rtol=1e-8, atol=1e-11), name
    assert np.abs(a.axial_strain).max() > 0.01


def hanging(links, segments, load):
    """A bar that hangs by its own weight and a load at its end; EA 50 N, 0.4 m, 0.2 kg."""
    edges = np.linspace(0.0, 0.4, segments + 1)
    parts = tuple(Extension(50.0, 0.0, a, b, f"s{k}") for k, (a, b) in enumerate(pairwise(edges)))
    return chain_model(length=0.4, mass=0.2, links=links, stiffness=1.0, damping=1e-3, torque=(1e-6,), space=True,
                       extensions=parts, tip_mass=load, gravity=(0, 0, 9.81))  # fmt: skip


@pytest.mark.parametrize(("links", "segments"), [(1, 1), (4, 1), (4, 2), (6, 3)])
def test_a_bar_that_hangs_lengthens_as_the_closed_form_says(links, segments):
    """By (m / 2 + M) g L / EA, each part of it by the mean tension there."""
    model = hanging(links, segments, 0.03)
    q = equilibrium(model)
    end = mechanics_of(model).tips(q)[-1]
    assert end == pytest.approx([0.0, 0.0, 0.4 * (1 + (0.1 + 0.03) * 9.81 / 50.0)], rel=1e-12)
    below = 0.2 * (1 - (np.arange(segments) + 0.5) / segments)
    assert q[2 * links :] == pytest.approx((below + 0.03) * 9.81 / 50.0, rel=1e-12)


def test_a_bar_rings_along_itself_as_the_closed_form_says():
    """One uniform strain, a mass M at the end: omega^2 = EA / (L (M + m / 3)); and its own weight changes nothing."""
    model = hanging(3, 1, 0.05)
    omega = np.sqrt(50.0 / (0.4 * (0.05 + 0.2 / 3)))
    found = 2 * np.pi * modes(model, equilibrium(model))[0]
    assert np.abs(found / omega - 1).min() < 1e-10


def test_forces_are_the_slopes_of_the_energies():
    chain = mechanics_of(turned_chain())
    rng = np.random.default_rng(5)
    x, size = np.append(rng.normal(0, 0.4, 12), [0.2, -0.1]), 14

    def potential(x):
        energy = chain.energy(x, 0.0 * x)
        return energy.elastic + energy.gravity

    slope = [(potential(x + h) - potential(x - h)) / 2e-5 for h in np.eye(size) * 1e-5]
    assert np.allclose(chain.static_forces(x, np.zeros(size)), -np.array(slope), atol=2e-9)
    pull, place = np.array([0.3, -0.2, 0.5]), Station("p", 2, 0.02, 0.01, -0.015)
    load = chain.link_loads([place], pull[None, None])[0]
    assert np.allclose(chain.load_forces(x, load), pull @ chain.position_jacobian(x, place), atol=1e-14)
    moved = [chain.load_forces(x + h, load) - chain.load_forces(x - h, load) for h in np.eye(size) * 1e-6]
    assert np.allclose(chain.load_stiffness(x, load), np.array(moved) / 2e-6, atol=1e-8)


def test_kinetic_energy_nodes_and_points():
    model = turned_chain(stations=[Station("a", 3, 0.02, 0.01, -0.02), Station("b", -1, 0.01, 0.0, 0.03)])
    chain, rng = mechanics_of(model), np.random.default_rng(6)
    x, v = rng.normal(0, 0.3, (3, 14)), rng.normal(0, 2.0, (3, 14))
    whole = chain.energy(x, v).kinetic
    assert np.allclose(whole, [0.5 * b @ chain.inertia(a) @ b for a, b in zip(x, v, strict=True)], rtol=1e-12)
    spans = np.linalg.norm(np.diff(chain.nodes(x), axis=-2), axis=-1)
    assert np.allclose(spans, chain.stretches(x) * chain.length, rtol=1e-12)
    places, _ = chain.stations(x[0])
    for station, row in zip(model.points, chain.beside_links(x[0], places), strict=True):
        assert np.allclose(row[station.link + 1], station[2:], atol=1e-15)


def test_names_and_the_file(tmp_path):
    model = turned_chain()
    chain = mechanics_of(model)
    assert chain.names[-4:] == ("twist_3", "twist_4", "strain_lower", "strain_upper")
    assert [k.noun for k in chain.kinds] == ["joint angle about x", "joint angle about y", "joint twist", "strain"]
    assert load_model(save_model(model, tmp_path / "m.json")) == model


def arm(*tendons, **more):
    return chain_model(**{**BODY, "tip_mass": 0.0, "mass": 1e-3, "space": True, "extensions": HALVES,
                          "chambers": tendons, **more})  # fmt: skip


def test_a_tendon_follows_its_path_along_what_lengthens():
    """Its lever is how its length changes: of the path along arcs at a lever from the axis, up to its last joint."""
    whole = Tendon.at_azimuth(0.7, np.ones(4), name="whole", **CORD)
    half = Tendon.at_azimuth(2.0, [1, 1, 0, 0], name="half", **CORD)
    pulled = Tendon.at_azimuth(2.0, [1, 1, 0, 0], name="pulled", lever=8e-3)
    twice = Tendon.at_azimuth(2.0, np.ones(4), name="twice", pair=True, **CORD)
    gain = arm(whole, half, pulled, twice).actuation.gain
    assert gain[:, 8:] == pytest.approx(np.array([[-0.15, -0.15], [-0.15, 0], [-0.15, 0], [-0.15, -0.15]]), abs=1e-15)
    one = (Extension(60.0, name="whole"),)
    assert arm(half, extensions=one).actuation.gain[0, 8:] == pytest.approx([-0.15])


def test_three_equal_tendons_shorten_the_body():
    """Drawn in alike they press: EA e = -3 T, T = k (u + L e) + T0."""
    cords = [Tendon.at_azimuth(a, np.ones(4), name=f"t{k}", pretension=0.5, **CORD)
             for k, a in enumerate((0.3, 0.3 + 2 * np.pi / 3, 0.3 + 4 * np.pi / 3))]  # fmt: skip
    model = arm(*cords, extensions=(Extension(60.0),), stiffness=50.0)
    q = equilibrium(model, np.full(3, 2e-3))
    strain = -3 * (2e3 * 2e-3 + 0.5) / (60.0 + 3 * 2e3 * 0.3)
    assert q[8] == pytest.approx(strain, rel=1e-3)
    assert np.abs(q[:8]).max() < 1e-9


def test_a_chamber_lengthens_where_it_bends():
    """Torque p A d at the axis and force p A: without stiffness of the joints' own plane, e = p A / EA."""
    area, offset = 2e-4, 5e-3
    chamber = Chamber((area * offset,), joint_gain=0.0, cross_gain=1.0, axial_gain=1 / offset)
    model = chain_model(**{**BODY, "space": True, "extensions": HALVES, "chambers": (chamber,)})
    q = equilibrium(model, 40e3)
    assert q[8:] == pytest.approx(40e3 * area / np.array([60.0, 40.0]), rel=1e-9)
    assert q[1:8:2] == pytest.approx(np.full(4, 40e3 * area * offset / 0.5), rel=1e-9)


@pytest.mark.slow  # compiles the step of a chain that twists
def test_a_push_out_of_plane_balances_its_energy():
    model = turned_chain()
    push = PointForce(np.zeros(1), np.array([[0.05, 0.02, 0.1]]), model.points[-1])
    motion = simulate(model, (Pulse(30e3, 0.0, 9.0), Pulse(0.0)), duration=0.3, time_step=2e-4, check=False,
                      forces=[push], initial_angle=equilibrium(model))  # fmt: skip
    assert motion.energy_gain < 2e-3
    assert motion.energy_loss < 2e-3
    assert np.ptp(motion.axial_strain.values, axis=0).min() > 1e-3


@pytest.mark.parametrize("tied", [False, True])
def test_a_compressed_tube_bends_by_the_tangent_of_its_axial_spring(tied):
    """Three equal tensions compress it to the root of the cubic; a small moment then bends it by 1 / (K g'(e))."""
    s, a, EA = -2.0, 70.0, 60.0
    wall = (Extension(EA, 0.05, 0.0, None, "wall", s, a, stiffens_bending=tied),)
    cords = [Tendon.at_azimuth(np.radians(90 + 120 * k), np.ones(4), lever=8e-3, name=f"cord {k}") for k in range(3)]
    model = chain_model(**BODY, extensions=wall, chambers=cords, space=True)
    tension, more = 1.5, 1e-4
    e = np.roots([a, s, 1.0, 3 * tension / EA])
    e = float(e[np.abs(e.imag) < 1e-12].real[0])
    straight, bent = (equilibrium(model, np.array([tension, tension, tension]) + d) for d in ([0, 0, 0], [more, 0, 0]))
    assert straight[-1] == pytest.approx(e, rel=1e-10)
    assert e < -0.05
    factor = 1 + 2 * s * e + 3 * a * e * e if tied else 1.0
    assert bent[:8:2] == pytest.approx(np.full(4, -more * 8e-3 / (0.5 * factor)), rel=1e-4)


def test_a_model_file_keeps_a_tie(tmp_path):
    wall = Extension(60.0, stiffening=-2.0, stiffens_bending=True)
    model = chain_model(**BODY, extensions=(wall,), torque=(1e-6,), space=True)
    again = load_model(save_model(model, tmp_path / "tube.json"))
    assert again.extensions == (wall,)
    assert "and so does the bending stiffness" in repr(model)
