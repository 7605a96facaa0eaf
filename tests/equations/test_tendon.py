"""Tendons of a chain in space: tension and slack, friction along the path and its account, a step with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.derivatives import complex_step
from oracles.space import random_joints, random_space_chain, with_tendons
from scipy.integrate import solve_ivp

import pliant
from pliant.compiler.choose import twin
from pliant.compiler.trace import BOUNDED
from pliant.compiler.twin import makes_arrays, reached
from pliant.equations import motion, spatial, spatial_points, spatial_springs, tendon
from pliant.mechanics import mechanics_of
from pliant.model import Space, Tendon, chain_model, load_model, save_model

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

DRAWN = (2.0, 1.0, -1.0)  # N, what draws the tendons in


def command(chain):
    return np.append(np.zeros(len(chain.x)), DRAWN)


def swinging(rng, **options):
    """A chain and tendons that go slack and taut as it swings."""
    chain = random_space_chain(rng, 2)
    chain = chain._replace(joints=random_joints(rng, 2, 4), v=0.3 * chain.v)
    return with_tendons(chain, rng, **({"stiffness": 3e3, "pretension": 0.5} | options))


def run(chain, h, steps):
    """Coordinates and rates (2, N) after so many compiled steps."""
    x, v, work, step = chain.x.copy(), chain.v.copy(), chain.work(), twin(tendon.step)
    for _ in range(steps):
        step(x, v, h, command(chain), chain.body, chain.joints, work)
    return np.stack([x, v])


@pytest.mark.parametrize("s0", [-3.0, 0.0, 2.0])
@pytest.mark.parametrize("s1", [-1.0, 0.0, 0.7, 5.0])
def test_mean_tension_of_a_step(s0, s1):
    T, slope = tendon.mean_tension(s0, s1)
    way = np.linspace(s0, s1, 200001)
    assert pytest.approx(np.maximum(way, 0.0).mean(), abs=1e-4) == T
    h = 1e-6
    if s1 != 0.0:
        near = [tendon.mean_tension(s0, s1 + e)[0] for e in (-h, h)]
        assert slope == pytest.approx((near[1] - near[0]) / (2 * h), abs=1e-6)


def pulled(chain, x, v=None, run=None):
    """Workspace with the torques of the tendons at x: friction by rates v, or as `run` (R, n) says."""
    work = chain.work(np.asarray(x).dtype.type)
    if run is not None:
        work.run[:] = run
    tendon.write_arms(x, chain.body, work)
    for r in range(0 if v is None else 3):
        tendon.slip(r, v, chain.body, work)
    tendon.tendon_torques(x, command(chain), chain.body, work)
    return work


@pytest.mark.parametrize("chord", [0.0, 3e-3])
def test_without_friction_torques_are_the_slope_of_the_stored_energy(rng, chord):
    chain = swinging(rng, chord=chord)
    body = chain.body

    def energy(x):
        drawn = np.array(DRAWN) + body.pretension - body.tendon_stiffness * (body.lever @ x + body.chord @ x**2)
        return np.array([(np.where(drawn.real > 0.0, drawn, 0.0) ** 2 / (2 * body.tendon_stiffness)).sum()])

    for x in rng.normal(0, 0.5, (5, 4)):
        work = pulled(chain, x, chain.v)
        assert work.pull == pytest.approx(-complex_step(energy, x)[0], abs=1e-13)
        assert not work.rub.any()


def test_friction_leaves_what_the_capstan_formula_says(rng):
    """A planar bend of many joints by one tendon: the torque at a bend of phi so far is g T exp(-+ mu phi)."""
    n, total, mu = 60, 2.0, 0.4
    chain = with_tendons(random_space_chain(rng, n), rng, friction=mu)
    lever = np.zeros((3, 2 * n))
    lever[0, ::2] = -0.01
    body = chain.body._replace(lever=lever, tendon_stiffness=np.zeros(3), pretension=np.zeros(3))
    x = np.zeros(2 * n)
    x[::2] = -total / n
    bend = (np.arange(n) + 0.5) * total / n
    for run in (1.0, -1.0, 0.0):
        work = pulled(chain._replace(body=body), x, run=run)
        torque = work.pull + work.rub
        assert torque[::2] == pytest.approx(-0.01 * DRAWN[0] * np.exp(-mu * run * bend), rel=1e-4)


@pytest.mark.parametrize("run", [1.0, -1.0, 0.3])
def test_at_the_entry_the_tension_falls_by_the_force_of_friction_but_never_below_zero(rng, run):
    chain = with_tendons(random_space_chain(rng, 2), rng, entry=1.5)
    body = chain.body._replace(tendon_stiffness=np.zeros(3), pretension=np.zeros(3))
    lost = {2.0: 1.5, 1.0: 1.0, -1.0: 0.0}  # of the tensions DRAWN
    wanted = sum(body.lever[r] * (max(T, 0.0) - run * lost[T]) for r, T in enumerate(DRAWN))
    work = pulled(chain._replace(body=body), chain.x, run=np.array([run, 0.0, 0.0]))
    assert work.pull + work.rub == pytest.approx(wanted, rel=1e-12)


def test_a_tendon_between_guides_is_as_long_as_the_chords_between_them():
    """A body bent to an arc of 1.2 rad: the chords of a path beside its axis, from its circle's geometry."""
    length, spacing, lever, bend, azimuth = 0.18, 0.02, 5e-3, 1.2, 0.7
    cord = Tendon.at_azimuth(azimuth, np.ones(6), driven_by="displacement", lever=lever, line_stiffness=1e3,
                             spacing=spacing)  # fmt: skip
    body = mechanics_of(chain_model(length=length, mass=0.01, links=6, joint_placement="midsegment", stiffness=0.02,
                                    damping=1e-3, chambers=[cord], space=Space())).body  # fmt: skip
    for way in (0.0, 0.7, 2.0):  # direction of the bend
        x = np.tile(bend / 6 * np.array([-np.sin(way), np.cos(way)]), 6)
        turn = bend * spacing / length
        chord = 2.0 * np.sin(turn / 2.0) * (length / bend - lever * np.cos(way - azimuth))
        shorter = (body.lever @ x + body.chord @ x**2)[0]
        assert shorter == pytest.approx(length - length / spacing * chord, abs=1.01 * lever * bend * turn**2 / 24.0)
        assert abs(shorter - (body.lever @ x)[0]) > 20.0 * lever * bend * turn**2 / 24.0


def test_friction_never_supplies_power_in_five_hundred_random_motions(rng):
    chain = swinging(rng, friction=0.4, slip_rate=1e-3, entry=1.2)
    power = np.array([-pulled(chain, x, v).rub @ v for x, v in rng.normal(0, 0.5, (500, 2, 4))])
    assert power.min() >= 0.0
    assert power.max() > 1e-3


@pytest.mark.parametrize(("friction", "entry", "chord"), [
    (0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (0.4, 0.3, 0.0), (0.0, 0.0, 3e-3), (0.4, 0.3, 3e-3),
])  # fmt: skip
def test_closed_cycles_give_nothing_back(rng, friction, entry, chord):
    """Random closed paths of coordinates: friction takes what is put in, at every moment, and never gives."""
    chain = swinging(rng, friction=friction, slip_rate=1e-3, entry=entry, chord=chord)
    samples, harmonics = 2000, np.arange(1, 4)[:, None]
    for _ in range(3):
        a, b = rng.normal(0, 0.3, (2, 3, 4))
        work = loss = 0.0
        for time in np.arange(samples) * 2 * np.pi / samples:
            s, c = np.sin(harmonics * time), np.cos(harmonics * time)
            x, v = (a * s + b * c).sum(0), (harmonics * (a * c - b * s)).sum(0)
            found = pulled(chain, x, v)
            power = -found.rub @ v
            assert power >= 0.0
            work, loss = work - (found.pull + found.rub) @ v, loss + power
        scale = 2 * np.pi / samples
        assert work * scale == pytest.approx(loss * scale, abs=1e-4)
        assert (loss * scale > 1e-3) if friction or entry else (loss == 0.0)


def reference(chain, end):
    """Coordinates and rates (2, N), work of the tendons and loss to friction at the end, by a method of order 8."""
    size, a, work = chain.x.size, np.empty(chain.x.size), chain.work()
    accelerate = twin(tendon.accelerate)

    def rate(_, y):
        x, v = y[:size], y[size : 2 * size]
        accelerate(x, v, command(chain), chain.body, chain.joints, work, a)
        return np.concatenate([v, a, [work.pull @ v, -work.rub @ v]])

    start = np.concatenate([chain.x, chain.v, [0.0, 0.0]])
    found = solve_ivp(rate, (0, end), start, "DOP853", rtol=1e-8, atol=1e-10)
    return found.y[:-2, -1].reshape(2, size), *found.y[-2:, -1]


@pytest.mark.parametrize(("friction", "chord"), [(0.0, 0.0), (0.4, 0.0), (0.0, 5e-4)])
def test_second_order_through_slack_and_taut(rng, friction, chord):
    chain, end, steps = swinging(rng, friction=friction, chord=chord), 0.05, np.array([150, 300, 600, 1200])
    exact, _, _ = reference(chain, end)
    errors = [np.abs(run(chain, end / k, k)[0] - exact[0]).max() for k in steps]
    s = [[tendon.signed_tension(r, run(chain, end / 200, k)[0], command(chain), chain.body) for r in range(3)]
         for k in range(0, 200, 10)]  # fmt: skip
    assert (np.diff(np.sign(s), axis=0) != 0).sum() >= 3  # some go slack and come back within the time
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2), errors


@pytest.mark.parametrize(("friction", "entry", "chord"), [
    (0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.2, 0.5, 0.0), (0.0, 0.0, 3e-3),
])  # fmt: skip
def test_account_of_a_motion(rng, friction, entry, chord):
    """Work of the tendons and loss to friction as the step counts them, against an accurate solution and the energy."""
    chain, end = swinging(rng, friction=friction, entry=entry, chord=chord), 0.05
    chain = chain._replace(joints=chain.joints._replace(D=np.zeros(4)))

    def stored(x, v):
        value = spatial_points.kinetic_energy(x, v, chain.body, chain.work())
        value += spatial_points.gravity_energy(x, chain.body, chain.work())
        return value + spatial_springs.elastic_energy(x, chain.joints)

    exact, pull, lost = reference(chain, end)
    assert stored(*exact) - stored(chain.x, chain.v) == pytest.approx(pull - lost, abs=1e-6)
    assert (lost > 1e-3) if friction else (lost == 0.0)
    steps = 1600
    x, v, work, total = chain.x.copy(), chain.v.copy(), chain.work(), np.zeros(2)
    for _ in range(steps):
        twin(tendon.step)(x, v, end / steps, command(chain), chain.body, chain.joints, work)
        spatial_points.add_step_work(v, end / steps, command(chain), chain.joints, work, total)
    assert total == pytest.approx([pull, lost], abs=2e-5)
    assert stored(x, v) - stored(chain.x, chain.v) == pytest.approx(total[0] - total[1], abs=2e-5)


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_a_tendon_that_stops_a_swing_gives_its_energy_back(rng, h):
    """Slack and taut within a step, any stiffness: a step stores what it takes, so the swing goes on as fast."""
    chain = with_tendons(random_space_chain(rng, 1, springs=False), rng, stiffness=1e5, pretension=0.0)
    body = chain.body._replace(gx=0.0, gy=0.0, gz=0.0, lever=np.array([[0.0, 0.0], [0.0, 0.0], [-0.02, 0.0]]),
                               pretension=np.array([0.0, 0.0, -DRAWN[2]]))  # fmt: skip
    chain = chain._replace(body=body, x=np.array([-0.3, 0.0]), v=np.array([6.0, 0.0]))
    speeds = [run(chain, h, steps)[1, 0] for steps in (0, round(0.2 / h))]
    assert speeds[1] == pytest.approx(-speeds[0], rel=1e-3)


@pytest.mark.parametrize("friction", [0.0, 0.45])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_stiff_tendons_need_no_small_step(rng, h, friction):
    """Tendons of 10^6 N/m that turn slack within 3 um: a chain that begins to hang comes to rest."""
    chain = swinging(rng, stiffness=1e6, friction=friction, slip_rate=1e-3)
    body = chain.body._replace(base=np.eye(3), rest=np.stack([np.eye(3)] * 2), gx=0.0, gy=0.0, gz=9.81)
    chain = chain._replace(body=body, joints=chain.joints._replace(D=np.full(4, 0.05)), x=np.zeros(4), v=np.zeros(4))
    x, v = run(chain, h, 500)
    assert np.abs(v).max() < 2e-3
    assert 0.0 < np.abs(x).max() < 0.3


def test_slopes_of_a_step_by_what_tendons_have(rng):
    """Complex steps through Newton's method, with friction, against differences of the converged step."""
    chain = swinging(rng, friction=0.4, slip_rate=0.01, entry=0.2, chord=3e-3)
    names = ("lever", "chord", "tendon_stiffness", "pretension", "friction", "entry_friction")
    given = {name: getattr(chain.body, name) for name in names}
    given |= {"x": chain.x, "v": chain.v, "drawn": np.array(DRAWN)}

    def after(z, name, way):
        moved = {key: value.astype(complex) + (z * way if key == name else 0) for key, value in given.items()}
        x, v, drawn = (moved.pop(key) for key in ("x", "v", "drawn"))
        torque = np.append(np.zeros(4), drawn)
        tendon.step(x, v, 5e-3, torque, chain.body._replace(**moved), chain.joints, chain.work(complex))
        return np.concatenate([x, v])

    for name, value in given.items():
        way = rng.normal(size=value.shape) * np.abs(value).mean()
        slope = after(1e-30j, name, way).imag / 1e-30
        difference = (after(1e-5, name, way) - after(-1e-5, name, way)).real / 2e-5
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(slope).max(), err_msg=name)


def test_the_compiled_step_is_the_text_and_makes_no_arrays(rng):
    chain = swinging(rng, friction=0.2)
    x, v = chain.x.copy(), chain.v.copy()
    tendon.step(x, v, 1e-3, command(chain), chain.body, chain.joints, chain.work())
    assert np.stack([x, v]) == pytest.approx(run(chain, 1e-3, 1), rel=1e-12, abs=1e-12)
    straight = twin(motion.step, 2, 0, 2, 3, BOUNDED)
    y, w = chain.x.copy(), chain.v.copy()
    straight(y, w, 1e-3, command(chain), chain.body, chain.joints, chain.work())
    assert np.stack([y, w]) == pytest.approx(np.stack([x, v]), rel=1e-9, abs=1e-12)
    assert not [kernel for kernel in reached(tendon.step) if makes_arrays(kernel)]


def test_taut_tendons_without_friction_cost_one_factorisation(rng, monkeypatch):
    chain, count, factor = swinging(rng, pretension=200.0), [], tendon.ldl_factor
    monkeypatch.setattr(tendon, "ldl_factor", lambda B: count.append(factor(B)))
    monkeypatch.setattr(tendon, "eliminate", lambda B, b: pytest.fail("a move of Newton's method"))
    chain.body.pretension[:] = 200.0
    for _ in range(5):
        tendon.step(chain.x, chain.v, 1e-4, command(chain), chain.body, chain.joints, chain.work())
    assert len(count) == 5


def test_the_linear_step_of_taut_tendons_is_the_end_of_newtons_method(rng, monkeypatch):
    chain = swinging(rng, pretension=200.0)
    chain.body.pretension[:] = 200.0
    ends = []
    for newton in (False, True):
        if newton:
            monkeypatch.setattr(tendon, "rubs", lambda _: 1.0)
        x, v, work = chain.x.copy(), chain.v.copy(), chain.work()
        for _ in range(5):
            tendon.step(x, v, 1e-3, command(chain), chain.body, chain.joints, work)
        ends.append([*x, *v, *work.pull, *work.rub])
    assert ends[0] == pytest.approx(ends[1], rel=1e-9, abs=1e-11)


def test_slack_tendons_leave_the_step_of_the_chain(rng):
    chain = swinging(rng)
    chain.body.pretension[:] = -1e6
    y, w, work = chain.x.copy(), chain.v.copy(), chain.work()
    for _ in range(20):
        twin(spatial.step)(y, w, 1e-3, np.zeros(4), chain.body, chain.joints, work)
    assert run(chain, 1e-3, 20) == pytest.approx(np.stack([y, w]), rel=1e-8, abs=1e-9)


def arm(**more):
    cord = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3, "pretension": 2.0}
    tendons = [Tendon.at_azimuth(a, np.ones(3), name=name, **cord) for name, a in (("a", 0.3), ("b", 2.4), ("c", 4.5))]
    return pliant.chain_model(**({
        "length": 0.3, "mass": 0.1, "links": 3, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 4e-3,
        "space": Space(), "chambers": tendons,
    } | more))  # fmt: skip


def test_a_tendon_draws_the_tip_towards_its_azimuth_and_hangs_slack_when_let_out():
    model = arm()
    q = pliant.equilibrium(model, np.array([4e-3, -9e-3, -9e-3]))  # the two others are let out
    tip = mechanics_of(model).tips(q)[-1]
    assert np.arctan2(tip[1], tip[0]) == pytest.approx(0.3, abs=2e-2)
    # one taut tendon of stiffness k at lever g and n equal joints K: K q = g (k (u - n g q) + T_0)
    swing = 8e-3 * (2e3 * 4e-3 + 2.0) / (0.5 + 3 * 2e3 * 8e-3**2)
    assert np.allclose(np.hypot(*q.reshape(3, 2).T), swing, rtol=2e-3)


def test_a_pair_on_one_motor_is_a_spring_both_ways(tmp_path):
    motor = {"driven_by": "angle", "pulley": 0.01, "lever": 8e-3, "line_stiffness": 2e3, "pair": True}
    model = arm(chambers=[Tendon.at_azimuth(np.pi / 2, np.ones(3), **motor)])
    forth, back = (pliant.equilibrium(model, np.array([angle])) for angle in (0.4, -0.4))
    assert np.allclose(forth, -back, atol=1e-12)
    assert forth[0] == pytest.approx(-8e-3 * 2e3 * 0.01 * 0.4 / (0.5 + 3 * 2e3 * 8e-3**2), rel=1e-9)
    assert model.actuation.units == ("rad",)
    assert load_model(save_model(model, tmp_path / "m.json")) == model


@pytest.mark.parametrize("pretension", [0.0, 1.0, -3.0])
def test_an_imbalance_of_a_pair_shifts_the_zero_of_its_motor(pretension):
    """Taut or slack: both tendons of the pair are k r theta shorter and longer, so d / 2 = k r theta."""
    motor = {"driven_by": "angle", "pulley": 0.01, "lever": 8e-3, "line_stiffness": 2e3, "pair": True}
    even = Tendon.at_azimuth(0.6, np.ones(3), pretension=pretension, **motor)
    uneven = arm(chambers=[replace(even, imbalance=2.4)])
    for angle in (0.4, 0.0, -0.6):
        shifted = pliant.equilibrium(arm(chambers=[even]), np.array([angle + 2.4 / (2.0 * 2e3 * 0.01)]))
        assert np.allclose(pliant.equilibrium(uneven, np.array([angle])), shifted, rtol=1e-9, atol=1e-12)
    assert not np.allclose(shifted, pliant.equilibrium(arm(chambers=[even]), np.array([-0.6])), atol=1e-3)


@pytest.mark.parametrize(("wrong", "sentence"), [
    ({"driven_by": "voltage"}, "driven_by must be"), ({"driven_by": "displacement"}, "needs a line_stiffness"),
    ({"driven_by": "angle", "line_stiffness": 1e3}, "needs the radius of the pulley"),
    ({"pulley": 0.01}, "has no pulley"),
    ({"lever": 0.0}, "lever must be positive"),
])  # fmt: skip
def test_tendons_that_cannot_be_are_refused(wrong, sentence):
    with pytest.raises(pliant.InputError, match=sentence):
        Tendon(**({"lever": 8e-3} | wrong))


def test_a_tendon_is_refused_in_a_plane():
    with pytest.raises(pliant.InputError, match="set space"):
        arm(space=None)
