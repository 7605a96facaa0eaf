"""Tendons: length and slope of a path, tension and slack, friction and its account, a step with them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from oracles.derivatives import complex_step
from oracles.space import SpaceChain, free_joints, no_tendons, random_joints, random_space_chain
from oracles.tendons import at_rest, guide_positions, measured, path_lengths, random_tendons, tendon_workspace, tendons
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pliant.compiler.choose import twin
from pliant.compiler.twin import makes_arrays, reached
from pliant.equations import spatial, spatial_points, spatial_springs, tendon
from pliant.equations.symbols import SpatialBody, TendonConstants, Tendons

DRIVE = (2.0, -2.0, -4.0, 1.0)  # N


@pytest.fixture(params=[(1, False), (3, False), (4, True)])
def chain(rng, request):
    n, twist = request.param
    return random_space_chain(rng, n, twist=twist)


def test_lengths_and_their_slopes(rng, chain):
    law = random_tendons(rng, chain)
    cords = measured(law, chain, chain.x)
    assert cords.l == pytest.approx(path_lengths(law, chain, chain.x), abs=1e-14)
    h = 1e-6
    slopes = [
        (path_lengths(law, chain, chain.x + h * e) - path_lengths(law, chain, chain.x - h * e)) / (2 * h)
        for e in np.eye(chain.x.size)
    ]
    assert cords.gradient == pytest.approx(np.transpose(slopes), abs=1e-9)
    exact = complex_step(lambda x: measured(law, chain, x, complex).l, chain.x)
    assert cords.gradient == pytest.approx(exact, abs=1e-14)


def test_what_lies_beyond_a_guide(rng, chain):
    """Row g of `beyond` is the slope of the length from guide g on."""
    law = random_tendons(rng, chain)

    def from_second_guide(x):
        p = measured(law, chain, x, complex).p[1:4]
        return np.sqrt((np.diff(p, axis=0) ** 2).sum(axis=1)).sum(keepdims=True)

    expected = complex_step(from_second_guide, chain.x)[0]
    assert measured(law, chain, chain.x).beyond[1] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("stretch", [-0.1, -1.1e-3, -0.9e-3, 0.1])
def test_tension_is_the_slope_of_its_energy_and_never_negative(rng, stretch):
    """Slack begins 1 mm below the rest length: 2 N of pretension at 2 N/mm."""
    law = random_tendons(rng, random_space_chain(rng, 2))
    l, h = law.rest_length[0] + stretch, 1e-6
    T, slope = tendon.tension(tendon.pull(0, l, np.zeros(4), law))
    assert pytest.approx(max(0.0, 2.0 + 2e3 * stretch)) == T
    near = [tendon.tendon_energy(0, l + e, np.zeros(4), law) for e in (-h, h)]
    assert pytest.approx((near[1] - near[0]) / (2 * h), rel=1e-8, abs=1e-12) == T
    near = [tendon.tension(tendon.pull(0, l + e, np.zeros(4), law))[0] for e in (-h, h)]
    assert 2e3 * slope == pytest.approx((near[1] - near[0]) / (2 * h), rel=1e-8)


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


def test_a_tension_as_drive(rng):
    """Without stiffness the drive is the tension, at any length."""
    law = random_tendons(rng, random_space_chain(rng, 2))
    law = law._replace(stiffness=np.zeros(4), pretension=np.zeros(4))
    drive, cords = np.array([0.0, 0.0, 4.0, 0.0]), tendon_workspace(law)
    cords.l[:] = 0.3
    tendon.tense(drive, law, cords)
    assert cords.T.tolist() == [0.0, 0.0, 4.0, 0.0]
    assert cords.slope.tolist() == [0.0] * 4
    assert tendon.tendon_energy(2, 0.3, drive, law) == 0.0


def test_two_tendons_of_a_motor_pull_in_turn(rng):
    law, cords = random_tendons(rng, random_space_chain(rng, 2)), None
    pulls = []
    for way in (10.0, -10.0):
        cords = tendon_workspace(law)
        cords.l[:] = law.rest_length
        tendon.tense(np.array([way, -way, 0.0, 0.0]), law, cords)
        pulls.append(cords.T[:2].tolist())
    assert pulls == [pytest.approx([12.0, 0.0]), pytest.approx([0.0, 12.0])]


def torques(chain, law, x, v, drive):
    """Generalised forces (N,) of all tendons, and the power of their friction."""
    cords = measured(law, chain, x)
    tendon.tense(np.asarray(drive), law, cords)
    tendon.slip(v, law, cords)
    tendon.tendon_torques(law, cords)
    return cords.t.copy(), tendon.friction_power(v, law, cords), cords


def test_without_friction_torques_are_the_slope_of_the_energy(rng, chain):
    law = random_tendons(rng, chain, friction=0.0)
    t, power, _ = torques(chain, law, chain.x, chain.v, DRIVE)

    def energy(x):
        l = measured(law, chain, x, complex).l
        return np.array([sum(tendon.tendon_energy(c, l[c], np.array(DRIVE), law) for c in range(4))])

    assert t == pytest.approx(-complex_step(energy, chain.x)[0], abs=1e-11)
    assert power == 0.0


def test_tension_falls_over_each_guide(rng):
    """Piece by piece, the capstan's exponential of the change of direction; towards the tip where the cord runs in."""
    chain = random_space_chain(rng, 3)
    law = random_tendons(rng, chain, friction=0.4)
    cords = measured(law, chain, chain.x)
    p = guide_positions(law, chain, chain.x)[:4]
    u = np.diff(p, axis=0) / np.linalg.norm(np.diff(p, axis=0), axis=1, keepdims=True)
    change = np.linalg.norm(np.diff(u, axis=0), axis=1)
    for run in (1.0, 0.0, -0.3):
        cords.run[:] = run
        assert tendon.drop_tension(0, 10.0, law, cords) == pytest.approx(10.0 * np.exp(-0.4 * run * change.sum()))
        assert cords.drop[1] == pytest.approx(10.0 * (1.0 - np.exp(-0.4 * run * change[0])))


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_closed_cycles_give_nothing_back(rng, friction):
    """Random closed paths of coordinates and drives: friction takes what chain and motors put in, and never gives."""
    chain = random_space_chain(rng, 2, twist=True)
    law = random_tendons(rng, chain, friction=friction)
    size, samples, harmonics = chain.x.size, 400, np.arange(1, 4)[:, None]
    for _ in range(2):
        a, b = rng.normal(0, 0.15, (2, 3, size + 4)) * np.append(np.ones(size), np.full(4, 10.0))
        work = loss = 0.0
        for time in np.arange(samples) * 2 * np.pi / samples:
            s, c = np.sin(harmonics * time), np.cos(harmonics * time)
            y, rate = (a * s + b * c).sum(0), (harmonics * (a * c - b * s)).sum(0)
            t, power, cords = torques(chain, law, y[:size], rate[:size], y[size:])
            assert power >= 0.0
            for i in range(4):
                work += cords.T[i] / law.stiffness[i] * rate[size + i]
            work += -t @ rate[:size]
            loss += power
        scale = 2 * np.pi / samples
        assert work * scale == pytest.approx(loss * scale, abs=1e-4)
        assert (loss * scale > 1e-3) if friction else (loss == 0.0)


def run(chain, law, h, steps, drive=DRIVE):
    """Coordinates and rates (2, N) after so many compiled steps."""
    x, v, step = chain.x.copy(), chain.v.copy(), twin(tendon.step_with_tendons)
    args = (np.zeros(x.size), tendons(law, drive), chain.body, chain.joints, chain.work())
    for _ in range(steps):
        step(x, v, h, *args)
    return np.stack([x, v])


def reference(chain, law, end, drive=DRIVE):
    """Coordinates, rates and the loss to friction at the end by an adaptive method of order 8."""
    given, work, size, a = tendons(law, drive), chain.work(), chain.x.size, np.empty(chain.x.size)
    accelerate, still = twin(tendon.acceleration_with_tendons), np.zeros(chain.x.size)

    def rate(_, y):
        x, v = y[:size], y[size:-1]
        accelerate(x, v, still, given, chain.body, chain.joints, work, a)
        return np.concatenate([v, a, [tendon.friction_power(v, law, given.work)]])

    start = np.concatenate([chain.x, chain.v, [0.0]])
    found = solve_ivp(rate, (0, end), start, "DOP853", rtol=1e-8, atol=1e-10)
    return found.y[:-1, -1].reshape(2, size), found.y[-1, -1]


def swinging(rng, **options):
    """A chain and tendons that go slack and taut as it swings."""
    chain = random_space_chain(rng, 2)
    chain = chain._replace(joints=random_joints(rng, 2, 4), v=0.3 * chain.v)
    law = random_tendons(rng, chain, **options)
    return chain, law._replace(slip_rate=np.full(4, 0.05))


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_second_order_through_slack_and_taut(rng, friction):
    chain, law = swinging(rng, friction=friction, pretension=0.1)
    end, steps = 0.05, np.array([150, 300, 600, 1200])
    exact, _ = reference(chain, law, end)
    errors = [np.abs(run(chain, law, end / k, k)[0] - exact[0]).max() for k in steps]
    pulls = []
    for k in range(0, 200, 10):
        l = measured(law, chain, run(chain, law, end / 200, k)[0]).l
        pulls.append([tendon.pull(c, l[c], np.array(DRIVE), law) for c in range(4)])
    crossings = (np.diff(np.sign(pulls), axis=0) != 0).sum()
    assert crossings >= 3  # some go slack and come back within the time
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15), errors


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_stiff_tendons_need_no_small_step(rng, h, friction):
    """Cords of 10^6 N/m that are slack 5 um below their rest length: a chain that begins to hang comes to rest."""
    chain, _ = swinging(rng)
    body = chain.body._replace(base=np.eye(3), rest=np.stack([np.eye(3)] * 2), gx=0.0, gy=0.0, gz=9.81)
    chain = SpaceChain(body, chain.joints._replace(D=np.full(4, 0.05)), 0.0 * chain.x, 0.0 * chain.v)
    law = random_tendons(rng, chain, stiffness=1e6, pretension=5.0, friction=friction)
    x, v = run(chain, law._replace(slip_rate=np.full(4, 0.05)), h, 300, np.zeros(4))
    assert np.abs(v).max() < 2e-3
    assert 0.0 < np.abs(x).max() < 0.3


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_a_cord_that_stops_a_swing_gives_its_energy_back(rng, h):
    """Slack and taut within a step, any stiffness: a step stores what it takes, so the swing goes on as fast."""
    chain = random_space_chain(rng, 1, springs=False)
    body = chain.body._replace(gx=0.0, gy=0.0, gz=0.0)
    law = random_tendons(rng, chain, friction=0.0, stiffness=1e5, pretension=0.0)
    gain = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.02, 0.0]])
    law = law._replace(first=np.zeros(5, int), link=law.link[:0], point=law.point[:0], gain=gain)
    chain = chain._replace(body=body, x=np.array([-0.3, 0.0]), v=np.array([6.0, 0.0]))
    speeds = [run(chain, law, h, steps, np.zeros(4))[1, 0] for steps in (0, round(0.2 / h))]
    assert speeds[1] == pytest.approx(-speeds[0], rel=1e-3)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_account_of_a_motion(rng, friction):
    """Energy at the start less energy at the end is what friction took, to the order of the step."""
    chain, law = swinging(rng, friction=friction)
    chain, end = chain._replace(joints=chain.joints._replace(D=np.zeros(4))), 0.05

    def stored(x, v):
        work, l = chain.work(), measured(law, chain, x).l
        value = spatial_points.kinetic_energy(x, v, chain.body, work)
        value += spatial_points.gravity_energy(x, chain.body, work)
        value += sum(tendon.tendon_energy(c, l[c], np.array(DRIVE), law) for c in range(4))
        return value + spatial_springs.elastic_energy(x, chain.joints)

    exact, lost = reference(chain, law, end)
    assert stored(chain.x, chain.v) - stored(*exact) == pytest.approx(lost, abs=1e-5)
    assert (lost > 1e-3) if friction else (lost == 0.0)
    steps = np.array([400, 800, 1600, 3200])
    errors = [abs(stored(chain.x, chain.v) - stored(*run(chain, law, end / k, k)) - lost) for k in steps]
    assert errors[-1] < 1e-5
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] > 1.7, errors


def mujoco_tendons(chain, law, drive=DRIVE):
    """The same chain and tendons in MuJoCo: ball joints, sites, spatial tendons with slack below a length."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    parent, matrix = spec.worldbody, chain.body.base
    bodies = [parent.add_body(quat=Rotation.from_matrix(matrix).as_quat(scalar_first=True))]
    for k in range(chain.n):
        turn = Rotation.from_matrix(chain.body.rest[k]).as_quat(scalar_first=True)
        body = bodies[-1].add_body(pos=[0, 0, chain.body.length[k]], quat=turn)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
        body.mass, body.ipos, body.inertia = chain.body.mass[k], [0, 0, chain.body.centre[k]], [1e-5] * 3
        body.explicitinertial = True
        bodies.append(body)
    for g, (aside, across, along) in enumerate(law.point):
        bodies[law.link[g] + 1].add_site(name=f"guide{g}", pos=[aside, -across, along])
    for c in range(min(3, len(law.stiffness))):
        slack = law.rest_length[c] - (law.pretension[c] + drive[c]) / law.stiffness[c]
        cord = spec.add_tendon(name=f"tendon{c}", stiffness=law.stiffness[c], springlength=[0, slack])
        for g in range(law.first[c], law.first[c + 1]):
            cord.wrap_site(f"guide{g}")
    return spec.compile()


def local_rates(chain, x, work, data):
    """Pose MuJoCo's chain at x; return the angular velocities of its joints (N, N) for a unit rate of each of x."""
    spatial.pose_links(x, chain.body, work)
    rates, n = np.zeros((x.size, x.size)), chain.n
    for k in range(n):
        turn, own = work.P[k].T @ work.R[k + 1], [2 * k, 2 * k + 1, 2 * n + k]
        data.qpos[4 * k : 4 * k + 4] = Rotation.from_matrix(turn).as_quat(scalar_first=True)
        rates[own, 3 * k : 3 * k + 3] = work.S[own] @ work.R[k + 1]
    return rates


def test_tendons_of_mujoco(rng):
    """Lengths, and power of the forces along any rates, slack or taut: MuJoCo's own tendons, without friction."""
    slack = 0
    for _ in range(6):
        chain = random_space_chain(rng, 3, twist=True)
        law = random_tendons(rng, chain, friction=0.0)
        law = law._replace(gain=0.0 * law.gain, pretension=np.array([2.0, 2.0, 2.0, -1e6]))
        model = mujoco_tendons(chain, law)
        data, work = mujoco.MjData(model), chain.work()
        rates = local_rates(chain, chain.x, work, data)
        mujoco.mj_forward(model, data)
        cords = measured(law, chain, chain.x)
        assert data.ten_length == pytest.approx(cords.l[:3], abs=1e-12)
        t, _, cords = torques(chain, law, chain.x, chain.v, DRIVE)
        assert rates @ data.qfrc_passive == pytest.approx(t, abs=1e-6 * np.abs(t).max())
        slack += (cords.T[:3] == 0.0).sum()
    assert 0 < slack < 18


def test_the_compiled_step_is_the_text_and_makes_no_arrays(rng):
    chain, law = swinging(rng)
    x, v = chain.x.copy(), chain.v.copy()
    tendon.step_with_tendons(x, v, 1e-3, np.zeros(4), tendons(law, DRIVE), chain.body, chain.joints, chain.work())
    assert np.stack([x, v]) == pytest.approx(run(chain, law, 1e-3, 1), rel=1e-12, abs=1e-12)
    assert not [kernel for kernel in reached(tendon.step_with_tendons) if makes_arrays(kernel)]


def test_taut_tendons_cost_two_factorisations(rng, monkeypatch):
    chain, law = swinging(rng, friction=0.0, pretension=200.0)
    factor, count = tendon.ldl_factor, []
    monkeypatch.setattr(tendon, "ldl_factor", lambda A: count.append(factor(A)))
    given = (np.zeros(4), tendons(law, DRIVE), chain.body, chain.joints, chain.work())
    for _ in range(5):
        tendon.step_with_tendons(chain.x, chain.v, 1e-4, *given)
    assert len(count) == 10


def test_a_step_without_tendons_is_that_of_the_chain(rng):
    """The same bits as `spatial.step`, or a last digit: the solves go another way."""
    chain = random_space_chain(rng, 3, twist=True)
    law = random_tendons(rng, chain, pretension=-1e9)
    x, v = run(chain, law, 1e-3, 20)
    y, w, work = chain.x.copy(), chain.v.copy(), chain.work()
    for _ in range(20):
        twin(spatial.step)(y, w, 1e-3, np.zeros(9), chain.body, chain.joints, work)
    assert x == pytest.approx(y, abs=1e-9)
    assert v == pytest.approx(w, abs=1e-7)


def test_slopes_of_a_step_by_complex_step(rng):
    """Every parameter of tendons has a derivative of the step: the text runs on complex numbers."""
    chain, law = swinging(rng, pretension=30.0)

    def after(values):
        given = law._replace(stiffness=values[:4], friction=values[4:8], pretension=values[8:12],
                             rest_length=law.rest_length + values[12:])  # fmt: skip
        cords, kind = tendon_workspace(given, complex), values.dtype.type
        x, v = chain.x.astype(kind), chain.v.astype(kind)
        given = Tendons(np.array(DRIVE), given, cords)
        tendon.step_with_tendons(x, v, 5e-3, np.zeros(4, kind), given, chain.body, chain.joints, chain.work(complex))
        return np.concatenate([x, v])

    values = np.concatenate([law.stiffness, law.friction, law.pretension, np.zeros(4)])
    exact, h = complex_step(after, values), 1e-6
    steps = h * np.maximum(1.0, np.abs(values))
    steps[12:] = 1e-9
    numeric = [(after(values + 0j + e) - after(values + 0j - e)).real / (2 * e.sum()) for e in np.diag(steps)]
    assert (np.abs(exact).max(axis=0) > 0.0).sum() >= 13
    assert exact == pytest.approx(np.transpose(numeric), rel=1e-4, abs=1e-5 * np.abs(exact).max())


def at_equilibrium(residual, size):
    """Root of forces (N,) by Newton's method with differences, its step halved while the forces grow."""
    x, r = np.zeros(size), residual(np.zeros(size))
    for _ in range(60):
        J = np.transpose([(residual(x + 1e-7 * e) - r) / 1e-7 for e in np.eye(size)])
        move = np.linalg.solve(J, -r)
        part = 0.5 / max(0.5, np.abs(move).max())
        while np.abs(last := residual(x + part * move)).max() > np.abs(r).max() > 1e-9 and part > 1e-3:
            part *= 0.5
        x, r = x + part * move, last
        if np.abs(move).max() < 1e-8:
            return x
    raise AssertionError(np.abs(r).max())


def equilibrium(law, chain, drive, run=0.0):
    """Coordinates at rest; `run`: which way the tendons slipped last."""
    given, forces, work = tendons(law, drive), np.empty(chain.x.size), chain.work()
    given.work.run[:] = run
    statics = twin(tendon.static_forces_with_tendons)

    def residual(x):
        statics(x, np.zeros(x.size), given, chain.body, chain.joints, work, forces)
        return forces.copy()

    return at_equilibrium(residual, chain.x.size)


def test_static_forces_hold_still(rng):
    """At rest under drives, nothing accelerates; where tendons were pulled in, friction leaves less for the links."""
    chain, law = swinging(rng)
    x = equilibrium(law, chain, DRIVE)
    a = np.empty(4)
    given = (np.zeros(4), tendons(law, DRIVE), chain.body, chain.joints, chain.work())
    tendon.acceleration_with_tendons(x, np.zeros(4), *given, a)
    assert np.abs(a).max() < 1e-6
    pulled, still = (np.zeros(4) for _ in range(2))
    cords = measured(law, chain, x)
    tendon.tense(np.array(DRIVE), law, cords)
    for run, ends in ((0.0, still), (1.0, pulled)):
        cords.run[:] = run
        ends[:] = [tendon.drop_tension(c, cords.T[c], law, cords) for c in range(4)]
    assert (pulled[:3] < still[:3])[still[:3] > 0.0].all()


def arm_in_mujoco(chain, law, drive):
    """Rest of a chain whose tendons and weight are MuJoCo's; its springs are those of the chain."""
    model = mujoco_tendons(chain, law, drive)
    model.opt.gravity[:] = [chain.body.gx, chain.body.gy, chain.body.gz]
    data, work = mujoco.MjData(model), chain.work()

    def residual(x):
        rates = local_rates(chain, x, work, data)
        mujoco.mj_forward(model, data)
        return rates @ (data.qfrc_passive - data.qfrc_bias) - chain.joints.K * x

    return at_equilibrium(residual, chain.x.size)


def test_an_arm_in_mujoco_is_identified(rng):
    """Three tendons 120 degrees apart, 8 poses: stiffness of tendons and joints, pretension and radius come back."""
    n, length = 3, 0.05
    K = np.array([0.4] * 6 + [0.3] * 3)
    body = SpatialBody(np.full(n + 1, length), np.full(n, 0.02), np.full(n, length / 2), np.full(n, 1e-5),
                       np.full(n, 1e-5), np.stack([np.eye(3)] * n), np.eye(3), 0.0, 0.0, 9.81,
                       *no_tendons(9))  # fmt: skip
    azimuth, link = np.repeat([0.3, 0.3 + 2 * np.pi / 3, 0.3 - 2 * np.pi / 3], n + 1), np.tile(np.arange(-1, n), 3)

    def arm(values):
        stiffness, pretension, joint, radius = values
        joints = free_joints(n, 9)._replace(K=joint * K)
        point = np.stack([radius * np.cos(azimuth), -radius * np.sin(azimuth), np.full(12, 0.5 * length)], axis=1)
        law = TendonConstants(np.full(3, stiffness), np.full(3, pretension), np.zeros(3), np.zeros((3, 9)), np.zeros(3),
                              np.ones(3), np.array([0, 4, 8, 12]), link, point)  # fmt: skip
        chain = SpaceChain(body, joints, np.zeros(9), np.zeros(9))
        return chain, at_rest(law, chain)

    def tips(values, pulls, rest):
        chain, law = arm(values)
        places = []
        for u in pulls:
            work = chain.work()
            spatial.pose_links(rest(chain, law, values[0] * u), chain.body, work)
            places.append(work.r[-1] + length * work.R[-1, :, 2])
        return np.array(places)

    truth, pulls = np.array([5e3, 1.0, 1.0, 0.01]), rng.uniform(-4e-3, 4e-3, (8, 3))
    pulls -= pulls.mean(axis=1, keepdims=True)  # some tendons go slack, and no pose buckles
    poses = tips(truth, pulls, arm_in_mujoco) + rng.normal(0, 2e-6, (8, 3))
    assert np.ptp(poses[:, 0]) > 0.03  # m

    def misfit(logs):
        rest = [tips(truth * np.exp(logs), pulls, lambda chain, law, drive: equilibrium(law, chain, drive)) - poses]
        return np.ravel(rest) / 2e-6

    found = least_squares(misfit, np.log([1.4, 0.6, 0.8, 1.1]), x_scale=[0.1, 0.1, 0.1, 0.01])
    error = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    assert error.max() < 0.05
    assert np.abs(found.x / error).max() < 3.5
