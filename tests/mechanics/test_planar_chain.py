"""Mechanics of planar chains against differences of positions, energies and torques; springs against their law."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.equations import elastic
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of, springs
from pliant.model import Extension, Model, Station

H = 1e-6


def chain(seed, n, segments):
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.02, 0.05, n)
    half = 0.01 + 0.5 * lengths.sum()
    parts = [Extension(150.0, 0.4, 0.0, half, "lower"), Extension(90.0, 0.3, half, None, "upper")][:segments]
    return Model(
        link_length=lengths, link_mass=rng.uniform(0.005, 0.02, n), stiffness=rng.uniform(0.8, 2.0, n),
        damping=rng.uniform(2e-3, 9e-3, n), rest_angle=rng.uniform(-0.1, 0.1, n), stiffening=-0.3, cubic_stiffening=0.4,
        torque=(6e-7,), base_length=0.01, base_angle=0.1, gravity=(1.0, -9.0), tip_mass=0.003,
        extensions=parts, stations=[Station("a", n - 1, 0.01, 0.004), Station("base", -1, 0.006, 0.002)],
    )


CASES = [(1, 0), (3, 0), (6, 0), (2, 1), (5, 1), (5, 2)]


@pytest.fixture(params=CASES, ids=str)
def mechanics(request):
    n, segments = request.param
    return mechanics_of(chain(11 * n + segments, n, segments))


def moved(mechanics, seed=5):
    rng = np.random.default_rng(seed)
    q = np.append(rng.uniform(-0.3, 0.3, mechanics.n), rng.uniform(-0.05, 0.1, mechanics.segments))
    return mechanics.coordinates(q), rng.uniform(-2.0, 2.0, mechanics.size)


def differences(function, x):
    """Central differences (..., N) of a function of x (N,)."""
    columns = []
    for k in range(x.size):
        step = np.zeros(x.size)
        step[k] = H
        columns.append((function(x + step) - function(x - step)) / (2.0 * H))
    return np.stack(columns, axis=-1)


def test_coordinates_and_rates_go_there_and_back(mechanics):
    x, v = moved(mechanics)
    q, dq = mechanics.joint_coordinates(x), mechanics.joint_rates(v)
    np.testing.assert_allclose(mechanics.coordinates(q), x, atol=1e-15)
    np.testing.assert_allclose(mechanics.rates(dq), v, atol=1e-14)
    np.testing.assert_allclose(mechanics.to_joints @ v, dq, atol=1e-14)
    np.testing.assert_allclose(mechanics.from_joints @ dq, v, atol=1e-14)
    assert len(mechanics.names) == mechanics.size


def test_position_jacobian_is_the_slope_of_the_stations(mechanics):
    x, _ = moved(mechanics)
    slope = differences(lambda y: mechanics.stations(y)[0], x)
    for k, point in enumerate(mechanics.model.points):
        np.testing.assert_allclose(mechanics.position_jacobian(x, point), slope[k], atol=1e-9)


def test_kinetic_energy_is_that_of_the_inertia_and_weight_the_slope_of_its_potential(mechanics):
    x, v = moved(mechanics)
    assert mechanics.energy(x, v).kinetic == pytest.approx(0.5 * v @ mechanics.inertia(x) @ v, rel=1e-12)
    potential = differences(lambda y: np.array(mechanics.energy(y, v).gravity), x)
    np.testing.assert_allclose(mechanics.load_forces(x, mechanics.weight()), -potential, atol=1e-9)


def test_loads_do_the_work_of_their_force_and_have_its_slope(mechanics):
    x, _ = moved(mechanics)
    points, force = list(mechanics.model.points[:1]), np.array([[[0.3, -0.7]]])
    load = mechanics.link_loads(points, force)[0]
    by_work = mechanics.position_jacobian(x, points[0]).T @ force[0, 0]
    np.testing.assert_allclose(mechanics.load_forces(x, load), by_work, atol=1e-13)
    slope = differences(lambda y: mechanics.load_forces(y, load), x)
    np.testing.assert_allclose(mechanics.load_stiffness(x, load), slope, atol=1e-8)


def test_the_rest_under_load_balances_all_forces_and_its_stiffness_is_their_slope(mechanics):
    model = mechanics.model
    torque = model.actuation.joint_torques(30e3)
    q = mechanics.equilibrium(torque, np.zeros(2), None)
    left = mechanics.static_forces(mechanics.coordinates(q), torque)
    assert np.abs(left).max() < 1e-9 * np.abs(mechanics.joints.K).max()

    def by_joints(q):
        return -mechanics.from_joints.T @ mechanics.static_forces(mechanics.coordinates(q), torque)

    _, K = mechanics.linear_parts(q)
    np.testing.assert_allclose(K, differences(by_joints, q), atol=1e-7 * np.abs(K).max())


def test_a_motion_has_the_energies_of_its_moments(mechanics):
    pairs = [moved(mechanics, seed) for seed in (1, 2, 3)]
    whole = mechanics.energy(np.array([x for x, _ in pairs]), np.array([v for _, v in pairs]))
    for k, (x, v) in enumerate(pairs):
        np.testing.assert_allclose([part[k] for part in whole], mechanics.energy(x, v), rtol=1e-13)


def test_slope_and_energy_are_those_of_the_torque_of_a_spring():
    """The law stands in three functions; the others follow from the torque, by complex steps."""
    rng, tiny = np.random.default_rng(2), 1e-30
    terms = rng.uniform(-0.5, 0.7, (elastic.TERMS, 1))
    for k, q in enumerate(rng.uniform(-1.0, 1.0, 20)):
        law = 0, springs.Springs(np.array([1.6]), terms, np.array([0.3 * (k % 2)]))
        bend = q + 0.05
        slope = elastic.spring_torque(*law, q + 1j * tiny, bend + 1j * tiny).imag / tiny
        assert elastic.spring_slope(*law, bend) == pytest.approx(slope, rel=1e-13)
        work = elastic.spring_energy(*law, q + 1j * tiny, bend + 1j * tiny).imag / tiny
        assert elastic.spring_torque(*law, q, bend) == pytest.approx(work, rel=1e-13)


def test_the_angle_under_a_torque_undoes_the_springs():
    model = chain(3, 4, 0)
    q = np.array([0.1, -0.2, 0.4, 0.3])
    assert len(SPRING_TERMS) == elastic.TERMS
    np.testing.assert_allclose(springs.angle_under(model, springs.springs_of(model).torque(q)), q, rtol=1e-12)


def test_bounded_springs_hold_any_torque_and_no_slope_leaves_the_bound():
    """Twice the slope's size of s bend at rest, as without the bound; never below K (1 - f), never above K (1 + f)."""
    model = chain(3, 4, 0).with_(stiffening=-2.0, cubic_stiffening=0.0, stiffening_bound=0.75)
    q = np.array([0.1, -0.2, 0.4, 3.0])
    np.testing.assert_allclose(springs.angle_under(model, springs.springs_of(model).torque(q)), q, rtol=1e-12)
    turns = np.linspace(-50.0, 50.0, 2001)
    bent = springs.Springs(np.ones(2001), np.stack([np.full(2001, -2.0), np.zeros(2001)]), np.full(2001, 0.75))
    slope = bent.slope(turns)
    assert (np.diff(slope) < 0).all()
    assert slope[[-1, 0]] == pytest.approx([0.25, 1.75], abs=1e-3)
    small = springs.springs_of(model).slope(1e-5 * np.ones(4)) / model.stiffness
    assert small == pytest.approx(1.0 - 4e-5, rel=1e-8)
    assert not springs.softened(model, np.full(4, 50.0))
    again = model.with_(stiffening=0.5, cubic_stiffening=-0.3)  # stiffens, then gives way
    held = springs.springs_of(again).torque(np.full(4, 0.5))
    np.testing.assert_allclose(springs.angle_under(again, held), 0.5, rtol=1e-12)
    with pytest.raises(SimulationError, match=r"holds at most .* or bound it"):
        springs.angle_under(again, 50.0 * held)
    with pytest.raises(InputError, match="stiffening_bound must be below 1"):
        again.with_(stiffening_bound=1.0)


def test_without_a_bound_the_springs_are_the_polynomial():
    K, s, a = 1.3, -0.4, 0.2
    q = np.linspace(-1.0, 1.0, 101)
    law = springs.Springs(np.full(101, K), np.stack([np.full(101, s), np.full(101, a)]))
    np.testing.assert_array_equal(law.torque(q), K * q + (K * a * q + K * s) * q * q)
    np.testing.assert_allclose(law.slope(q), K + (2 * K * s + 3.0 * K * a * q) * q, rtol=1e-15)
