"""Several outputs by several pressures: against closed forms, SciPy, and bodies integrated by LSODA."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import odeint
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize, root

from pliant.cli.control import reached
from pliant.control import (
    Limits,
    Lqr,
    Mpc,
    MpcTuning,
    SupplyValve,
    Task,
    Tuning,
    design_lqr,
    design_outputs,
    prepare_control,
    read_task,
    steady_inputs,
)
from pliant.control.horizon import Horizon
from pliant.control.model_plant import ModelPlant
from pliant.control.mpc import QuadraticProgram
from pliant.errors import InputError
from pliant.estimation import State
from pliant.linear import linearise
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.loop.task import run_task
from pliant.model import Chamber, Extension, Memory, Valve, chain_model

PERIOD = 4e-3
BOTH = ("tip_x", "tip_y")
LIMITS = Limits(2e5, chambers=(2e5, 1.8e5))


def segments(late=(8e-3, 5e-3)):
    """Two segments that bend to opposite sides, each with a valve of its own."""
    valves = Valve(natural_frequency=8.0, damping_ratio=0.8, dead_time=late[0]), Valve(
        natural_frequency=11.0, damping_ratio=0.9, dead_time=late[1])  # fmt: skip
    low = Chamber(torque=[3e-6], joint_gain=[1.0, 1.0, 0.0, 0.0], valve=valves[0], name="low")
    high = Chamber(torque=[3e-6], joint_gain=[0.0, 0.0, -1.0, -1.0], valve=valves[1], name="high")
    body = chain_model(length=0.16, mass=0.06, links=4, stiffness=1.2, damping=15e-3, torque=[0.0])
    return body.with_(chambers=(low, high))


def lengthening():
    """Three links that lengthen, hanging, between two chambers."""
    lag = Valve(rise_time=0.02, fall_time=0.02, dead_time=6e-3)
    pair = [Chamber.at_offset(2e-4, r, np.ones(3), name=n, valve=lag) for r, n in ((0.02, "a"), (-0.02, "b"))]
    return chain_model(
        length=0.2, mass=0.1, links=3, joint_placement="midsegment", stiffness=1.0, damping=0.015, chambers=pair,
        gravity=[0.0, 9.81], base_angle=0.1,
        extensions=(Extension(130.0, 0.6, 0.0, 0.1, "near"), Extension(110.0, 0.6, 0.1, name="far")),
    )


def antagonists():
    """Two chambers on opposite sides of the same joints."""
    body = chain_model(length=0.16, mass=0.06, links=4, stiffness=1.2, damping=15e-3, torque=[0.0])
    pair = [Chamber(torque=[2e-6], joint_gain=sign * np.ones(4), name=name, valve=Valve(rise_time=0.02, fall_time=0.02))
            for sign, name in ((1.0, "left"), (-1.0, "right"))]  # fmt: skip
    return body.with_(chambers=pair)


def tip_at(body, pressure):
    """Change of the tip at rest, in closed form: without gravity K q = gain torque."""
    phi = np.cumsum(sum(c.joint_gain * c.torque[0] * p for c, p in zip(body.chambers, pressure, strict=True))
                    / body.stiffness)  # fmt: skip
    return np.array([-body.link_length @ np.sin(phi), body.link_length @ (np.cos(phi) - 1.0)])


class Lsoda:
    """The chain by Lagrange's equations, uniform rods, linear springs, and its valves: integrated by LSODA."""

    def __init__(self, body):
        n, length, mass = body.n, body.link_length, body.link_mass
        levers = np.tril(np.tile(length, (n, 1)), -1) + 0.5 * np.diag(length)
        self.inertia, self.rotary = levers.T @ (mass[:, None] * levers), np.diag(mass * length**2 / 12.0)
        self.body, self.time, self.x = body, 0.0, np.zeros(2 * n + 4)
        self.sent, valves = np.zeros((0, 2)), [c.valve for c in body.chambers]
        self.gain = np.array([c.joint_gain * c.torque[0] for c in body.chambers]).T
        self.omega = 2 * np.pi * np.array([v.natural_frequency for v in valves])
        self.zeta = np.array([v.damping_ratio for v in valves])
        self.pull = np.eye(n) - np.eye(n, k=1)  # what the joints' torques are to the links

    def rates(self, x, _time, asked):
        n, omega = self.body.n, self.omega
        phi, w, p, v = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 2], x[2 * n + 2 :]
        between = np.subtract.outer(phi, phi)
        torque = self.gain @ p - self.body.stiffness * (self.pull.T @ phi) - self.body.damping * (self.pull.T @ w)
        pull = self.pull @ torque - (self.inertia * np.sin(between)) @ w**2
        turning = np.linalg.solve(self.inertia * np.cos(between) + self.rotary, pull)
        return np.concatenate([w, turning, v, omega**2 * (asked - p) - 2 * self.zeta * omega * v])

    def advance(self, command):
        """Hold commands for a period."""
        self.sent, begin = np.vstack([self.sent, command]), self.time
        late = [c.valve.dead_time for c in self.body.chambers]
        cuts = np.unique([begin, *(begin + d % PERIOD for d in late), begin + PERIOD])
        for a, b in pairwise(cuts):
            if b - a < 1e-9:
                continue
            which = [int(np.floor((0.5 * (a + b) - d) / PERIOD)) for d in late]
            asked = np.array([self.sent[k, c] if k >= 0 else 0.0 for c, k in enumerate(which)])
            self.x = odeint(self.rates, self.x, (a, b), args=(asked,), rtol=1e-6, atol=1e-9)[-1]  # by LSODA
        self.time = begin + PERIOD

    @property
    def tip(self):
        phi = self.x[: self.body.n]
        return np.array([-self.body.link_length @ np.sin(phi), self.body.link_length @ (np.cos(phi) - 1.0)])


def closed(law, body, periods):
    """Tips and commands of a law on the integrated body, its state known."""
    plant, n = Lsoda(body), body.n
    tips, commands = [], []
    for k in range(periods):
        state = State(k * PERIOD, *plant.x[: 2 * n].reshape(2, n).copy(), *np.zeros((2, n)), np.zeros((2 * n, 2 * n)))
        command = law.step(k * PERIOD, state, plant.x[2 * n : 2 * n + 2])
        tips.append(plant.tip)
        commands.append(command)
        plant.advance(command)
    return np.array(tips), np.array(commands)


def test_steady_inputs_are_those_of_a_root_find():
    body, highest = segments(), np.array([2e5, 1.8e5])
    for share in ([0.5, 0.6], [0.9, 0.8], [0.2, 0.7]):
        wanted = tip_at(body, share * highest)
        found = steady_inputs(body, BOTH, wanted + np.array([0.0, 0.16]), highest, np.zeros(2))
        exact = root(lambda x, aim=wanted: (tip_at(body, 1e5 * x) - aim) / 0.1, found.pressure * 1e-5, tol=1e-12)
        assert np.abs(exact.fun).max() < 1e-9  # not its flag, which may complain that it can come no nearer
        np.testing.assert_allclose(found.pressure, 1e5 * exact.x, atol=20.0)
        np.testing.assert_allclose(tip_at(body, found.pressure), wanted, atol=2e-6)


def test_what_outputs_leave_free_is_not_pressed():
    """Antagonists on one output: the one that pulls the other way rests; beyond a limit the nearest is told."""
    body, highest = antagonists(), np.array([1.5e5, 1.5e5])
    for side in (0, 1):
        alone = 6e4 * np.eye(2)[side]
        found = steady_inputs(body, ("tip_x",), tip_at(body, alone)[:1], highest, np.array([5e4, 5e4]))
        np.testing.assert_allclose(found.pressure, alone, atol=30.0)
    with pytest.raises(InputError, match=r"tip_x 0\.15 .* out of reach .* reaches, tip_x 0\.0\d+, under 0, 150 kPa"):
        steady_inputs(body, ("tip_x",), np.array([0.15]), highest, np.zeros(2))


def test_the_gain_is_scipys_with_two_inputs():
    """Whole dead times put into the state by hand, integrals of both outputs, and SciPy's Riccati solution."""
    body, tuning = segments(late=(8e-3, 4e-3)), Tuning()
    rest = tip_at(body, [1e5, 9e4])
    design = design_outputs(body, BOTH, rest[None], LIMITS, PERIOD, tuning=tuning)
    made = design.gains[0]
    linear, n = linearise(body, made.rest.pressure), body.n
    np.testing.assert_allclose(made.driven, np.eye(2), atol=1e-12)
    N, u = linear.A.shape[0], 1e3  # kPa
    step = expm(PERIOD * np.block([[linear.A, linear.B], [np.zeros((2, N + 2))]]))
    A, B = np.zeros((N + 5, N + 5)), np.zeros((N + 5, 2))
    A[:N, :N] = step[:N, :N]
    A[:N, N + 1], A[:N, N + 2] = u * step[:N, N], u * step[:N, N + 1]  # the oldest command of each arrives
    B[N, 0] = A[N + 1, N] = B[N + 2, 1] = 1.0
    rows = np.array([linear.row(name) for name in BOTH])
    A[N + 3 :, :N], A[N + 3 :, N + 3 :] = PERIOD * rows, np.eye(2)
    Q, gain = np.zeros((N + 5, N + 5)), -rows @ np.linalg.solve(linear.A, linear.B)
    Q[:n, :n] = rows[:, :n].T @ rows[:, :n]
    Q[n : 2 * n, n : 2 * n] = tuning.damping_time**2 * Q[:n, :n]
    Q[N + 3 :, N + 3 :] = np.eye(2) / tuning.integral_time**2
    R = tuning.effort * np.diag(np.sum(gain**2, axis=0)) * u**2
    P = solve_discrete_are(A, B, 1e6 * Q, 1e6 * R)
    K = np.linalg.solve(1e6 * R + B.T @ P @ B, B.T @ P @ A)
    unit = np.where((np.arange(N + 5) >= 2 * n) & (np.arange(N + 5) < N), u, 1.0)
    np.testing.assert_allclose(made.K, K * unit, rtol=2e-4, atol=1e-5 * np.abs(K * unit).max())


def test_one_chamber_gets_the_gain_of_one():
    """About the straight rest, where the tip's path is its x, both designs solve one problem."""
    body = chain_model(length=0.16, mass=0.06, links=3, stiffness=1.2, damping=15e-3, torque=[3e-6])
    body = body.with_(valve=Valve(natural_frequency=8.0, damping_ratio=0.8, dead_time=9e-3))
    many = design_outputs(body, ("tip_x",), np.zeros((1, 1)), Limits(1e5), PERIOD).gains[0]
    one = design_lqr(body, 1e5, PERIOD, grid=2).gains[0]
    np.testing.assert_allclose(one.driven, np.diag([1.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(one.K[:, -2:], many.K[:, -1:] * [1.0, 0.0], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(one.K[:, :-2], many.K[:, :-1], rtol=1e-6)


def circle(duration):
    """A path of the tip in the plane, from its rest: what slowly changing pressures in quadrature make of it."""
    clock = np.arange(0.0, duration, PERIOD)
    share, turn = np.clip(clock / 0.6, 0.0, 1.0), 2 * np.pi * clock / 1.5
    pressure = np.stack([1e5 + 5e4 * np.sin(turn), 9e4 + 5e4 * np.cos(turn)], axis=1)
    return np.array([tip_at(segments(), p) for p in (share * share * (3 - 2 * share))[:, None] * pressure])


@pytest.fixture(scope="module")
def course():
    wanted = circle(2.1)
    return wanted, design_outputs(segments(), BOTH, wanted, LIMITS, PERIOD, path=True)


@pytest.mark.slow
def test_two_segments_follow_a_path_of_the_tip(course):
    """72 mm wide, 20 mm high, a turn in 1.5 s, on the body integrated by LSODA."""
    wanted, design = course
    assert (np.ptp(wanted[150:], axis=0) > [0.07, 0.019]).all()
    for law in (Lqr(design, LIMITS), Mpc(design, LIMITS)):
        tips, commands = closed(law, segments(), len(wanted))
        off = np.linalg.norm(tips - wanted, axis=1)[150:]
        assert np.sqrt(np.mean(off**2)) < 1e-3
        assert off.max() < 2e-3
        assert (commands >= 0.0).all()
        assert (commands <= [2e5, 1.8e5]).all()
    blind = replace(design, lead=0 * design.lead, ahead=0 * design.ahead)
    late = np.linalg.norm(closed(Lqr(blind, LIMITS), segments(), len(wanted))[0] - wanted, axis=1)[150:]
    assert np.sqrt(np.mean(late**2)) > 2 * np.sqrt(np.mean(off**2))  # what looking ahead is worth


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Lqr, Mpc])
def test_limits_of_each_chamber_hold_and_the_tip_settles(kind):
    """A level just within the second chamber's limit, with a slew limit: the body comes to rest without windup."""
    body, limits = segments(), Limits(2e5, slew=2e6, chambers=(2e5, 1e5))
    level = tip_at(body, [1.2e5, 9.5e4])
    k = np.arange(375)[:, None]
    wanted = np.where(k < 20, 0.0, np.where(k < 240, level, tip_at(body, [5e4, 4e4])))
    law = kind(design_outputs(body, BOTH, wanted, limits, PERIOD), limits)
    tips, commands = closed(law, body, len(wanted))
    assert (commands >= 0.0).all()
    assert (commands <= [2e5, 1e5]).all()
    assert np.abs(np.diff(commands, axis=0)).max() <= 2e6 * PERIOD * (1 + 1e-9)
    assert law.saturated + getattr(law, "solved", 0) > 5
    off = np.linalg.norm(tips - wanted, axis=1)
    assert off[170:240].max() < 5e-4
    assert off[355:].max() < 5e-4


def put_at_rest(law, pressure):
    """A law that has long commanded what it reads."""
    law.command[:] = pressure
    for waiting, valve, p in zip(law._waiting, law._valves, pressure, strict=True):
        waiting[:], valve._queue = p, [p] * len(valve._queue)
        valve.value[:1] = p
    if isinstance(law, Mpc):
        law.plan[:] = pressure


def known(angle, rate=0.0, **more):
    n = len(angle)
    return State(0.0, angle, rate * np.ones(n), *np.zeros((2, n)), np.zeros((2 * n, 2 * n)), **more)


def test_prediction_without_limits_is_the_regulator():
    """Near a rest and far from limits the program's first command is the regulator's, nearer for short periods."""
    body, far = segments(late=(6e-3, 3e-3)), []
    level = tip_at(body, [1e5, 9e4])[None]
    for period in (4e-3, 1e-3):
        design = design_outputs(body, BOTH, level, LIMITS, period)
        laws = Lqr(design, LIMITS), Mpc(design, LIMITS, MpcTuning(period, 12))
        for law in laws:
            put_at_rest(law, design.pressure[0])
        off = known(design.angle[0] + 1e-3 * np.array([1.0, -0.5, 0.2, 0.7]), 5e-3, torque_scale=1.1)
        one, other = (law.step(0.0, off, design.pressure[0]) - design.pressure[0] for law in laws)
        assert laws[1].solved == 1
        far.append(np.abs(one - other).max() / np.abs(one).max())
    assert far[0] < 0.05
    assert far[1] < 0.012


def test_a_prediction_is_the_integrated_body():
    """Commands straight between nodes, through valves and dead times, the first of them on their way: against LSODA."""
    body, rng = segments(), np.random.default_rng(4)
    design, exact = design_outputs(body, BOTH, np.zeros((1, 2)), LIMITS, PERIOD), Lsoda(body)
    horizon, sent = Horizon(design, 3, 6), rng.uniform(0.0, 1e5, (20, 2))
    for asked in sent:
        exact.advance(asked)
    valves = list(exact.x[8:].reshape(2, 2).T.copy())
    start, waiting = known(exact.x[:4].copy(), exact.x[4:8].copy()), [sent[-1:-3:-1, 0], sent[-1:-3:-1, 1]]
    nodes = rng.uniform(0.0, 1.5e5, (6, 2))
    ahead = horizon.predict(start, valves, waiting, nodes)
    assert horizon.periods == 16
    for k, asked in enumerate(ahead.command):
        node, share = divmod(k, 3)
        np.testing.assert_allclose(asked, nodes[node] + share / 3 * (nodes[min(node + 1, 5)] - nodes[node]))
        exact.advance(asked)
        np.testing.assert_allclose(ahead.position[k], exact.x[:4], atol=3e-3)
    np.testing.assert_allclose(ahead.valve, exact.x[8:].reshape(2, 2).T.ravel(), rtol=1e-4)
    np.testing.assert_allclose(ahead.waiting, [*ahead.command[:-3:-1, 0], *ahead.command[:-3:-1, 1]])


@pytest.mark.parametrize(
    ("body", "strains"), [(segments(), 0), pytest.param(lengthening(), 2, marks=pytest.mark.slow)],
    ids=["fixed", "lengthens"],
)  # fmt: skip
def test_slopes_of_a_prediction_are_differences(body, strains):
    """By every node, at a state that moves, with shifts of the rests and a factor on the torque."""
    rng, C = np.random.default_rng(1), 2
    design = design_outputs(body, BOTH, np.zeros((1, 2)), LIMITS, PERIOD, latency=3e-3)
    horizon, n = Horizon(design, 3, 4), body.n
    small = {name: 0.03 * rng.standard_normal(strains) for name in ("strain", "strain_rate", "strain_shift")}
    start = known(0.2 * rng.standard_normal(n), rng.standard_normal(n), torque_scale=1.1, **small)
    start = start._replace(rest_shift=0.05 * rng.standard_normal(n))
    valves = [np.append(rng.uniform(2e4, 6e4, 1), np.zeros(order - 1)) for order in design.orders]
    waiting, nodes = [rng.uniform(1e4, 9e4, w) for w in design.waiting], rng.uniform(2e4, 1e5, (4, C))
    ahead = horizon.predict(start, valves, waiting, nodes)
    for j in range(4 * C):
        step = 20.0 * np.eye(4 * C)[j].reshape(4, C)
        up, down = (horizon.predict(start, valves, waiting, nodes + side * step) for side in (1.0, -1.0))
        for value, slope in (("position", ahead.slope[:, : body.size, j]), ("rate", ahead.slope[:, body.size :, j]),
                             ("valve", ahead.valve_slope[:, j]), ("waiting", ahead.waiting_slope[:, j])):  # fmt: skip
            found = (getattr(up, value) - getattr(down, value)) / 40.0
            np.testing.assert_allclose(found, slope, atol=1e-7 * max(np.abs(slope).max(), 1e-9))


def cost_of(law, design, start, valves, waiting, nodes):
    """The regulator's errors summed over the horizon, as `Tuning` has them, and its cost of the last state; SI."""
    made, tuning = design.gains[0], design.tuning
    ahead = law.horizon.predict(start, valves, waiting, nodes)
    phi, length = np.vstack([start.angle, ahead.position]), design.model.link_length
    error = np.stack([-np.sin(phi) @ length, (np.cos(phi) - 1.0) @ length], axis=1) - design.wanted[0]
    z = np.cumsum(PERIOD * error[:-1], axis=0)
    speed = [(-np.cos(p) * w @ length, -np.sin(p) * w @ length) for p, w in zip(phi[1:], ahead.rate, strict=True)]
    total = np.sum(error[1:-1] ** 2) + tuning.damping_time**2 * np.sum(np.square(speed[:-1]))
    total += np.sum(z[:-1] ** 2) / tuning.integral_time**2
    v = (ahead.command - design.pressure[0]) / 1e3
    pressures = np.append(ahead.valve, ahead.waiting) / 1e3
    full = np.concatenate([phi[-1] - design.angle[0], ahead.rate[-1], pressures, z[-1]])
    full -= design.resting @ design.pressure[0] / 1e3
    return total + 1e-6 * (np.sum((v @ made.R) * v) + full @ made.P @ full)


class Seen:
    """A quadratic program that remembers the last problem and its solution."""

    def __init__(self, program):
        self.program = program

    def solve(self, *problem):
        self.problem, self.found = [np.array(part) for part in problem], self.program.solve(*problem)
        return self.found


def test_the_program_is_the_cost_s_own_and_its_solution_the_least():
    """Slope against differences of the sum written out; the solution against SciPy's SLSQP, box and slew limits met."""
    body, limits = segments(), Limits(2e5, slew=1e6, chambers=(2e5, 1.2e5))
    design = design_outputs(body, BOTH, tip_at(body, [1.6e5, 1.1e5])[None], limits, PERIOD)
    law = Mpc(design, limits, MpcTuning(3 * PERIOD, 5))
    put_at_rest(law, np.array([1.5e5, 1e5]))
    law.program = seen = Seen(law.program)
    start = known(np.array([0.3, 0.5, 0.3, -0.1]), 0.4)
    valves, waiting, plan = [v.value.copy() for v in law._valves], [w.copy() for w in law._waiting], law.plan.copy()
    law.step(0.0, start, np.array([1.5e5, 1e5]))
    H, g, low, high, guess = seen.problem
    np.testing.assert_allclose(guess, plan.ravel() / 1e3)
    slope = np.empty(10)
    for j in range(10):
        nodes = [plan + side * 50.0 * np.eye(10)[j].reshape(5, 2) for side in (1, -1)]
        up, down = (cost_of(law, design, start, valves, waiting, made) for made in nodes)
        slope[j] = 0.5 * 1e6 * (up - down) / 0.1  # the program's cost is half the sum, in mm and kPa
    np.testing.assert_allclose(g + H @ guess, slope, atol=1e-5 * np.abs(slope).max())
    change = np.kron(np.eye(5) - np.eye(5, k=-1), np.eye(2))
    inside = [{"type": "ineq", "fun": lambda z: change @ z - low}, {"type": "ineq", "fun": lambda z: high - change @ z}]
    best = minimize(
        lambda z: 1e-3 * (0.5 * z @ H @ z + g @ z), guess, jac=lambda z: 1e-3 * (H @ z + g), method="SLSQP",
        bounds=[(0.0, 200.0), (0.0, 120.0)] * 5, constraints=inside, options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(seen.found, best.x, atol=2e-2)
    met = np.isclose(change @ best.x, high, atol=1e-6) | np.isclose(change @ best.x, low, atol=1e-6)
    assert met.any()
    assert (np.abs(best.x - np.tile([200.0, 120.0], 5)) < 1e-6).any()


def test_a_program_that_is_not_solved_is_a_fault_and_the_last_plan_goes_on():
    """Two periods without a solution: the commands are the last plan's, straight between its nodes, within limits."""
    body, limits = segments(), Limits(2e5, slew=2e6, chambers=(2e5, 1.8e5))
    law = Mpc(design_outputs(body, BOTH, tip_at(body, [1e5, 9e4])[None], limits, PERIOD), limits, MpcTuning(3 * PERIOD))
    still = known(np.zeros(4))
    for k in range(4):
        law.step(k * PERIOD, still, law.command)
    assert (law.failed, law.fault) == (0, "")
    plan, program = law.plan.copy(), law.program
    law.program = type("Unsolved", (), {"status": "maximum iterations reached", "solve": lambda *_: None})()
    for k in (1, 2):
        command = law.step((3 + k) * PERIOD, still, law.command)
        np.testing.assert_allclose(command, plan[0] + k / 3 * (plan[1] - plan[0]), rtol=1e-12)
    assert np.abs(plan[1] - plan[0]).max() > 1e4
    assert law.failed == 2
    assert "not solved (maximum iterations reached): the last plan is continued" in law.fault
    law.program = program
    law.step(6 * PERIOD, still, law.command)
    assert (law.failed, law.fault) == (2, "")
    bad = known(np.full(4, np.nan))
    assert np.isfinite(law.step(7 * PERIOD, bad, law.command)).all()
    assert "the prediction is not finite" in law.fault


def test_unsolved_periods_are_in_the_summary_of_a_task(tmp_path):
    (tmp_path / "t.toml").write_text(
        'feedback = "mpc"\nhighest_kpa = [200, 180]\nduration_s = 0.2\n[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\n'
    )
    solve, calls, begun = QuadraticProgram.solve, [], []

    def now_and_then(self, *problem):
        calls.extend([problem] * bool(begun and "running" in begun[-1]))  # none of the rehearsal
        return None if len(calls) in (20, 21) else solve(self, *problem)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QuadraticProgram, "solve", now_and_then)
        task, plant = read_task(tmp_path / "t.toml"), ModelPlant(segments())
        done = run_task(segments(), plant, task, tmp_path, progress=begun.append)
    assert done.summary["controller_faults"] == 2
    assert str(done.summary["fault"]).startswith("in 2 periods the quadratic program of the predictive control was not")
    remarks = done.log.attrs["remarks"]
    assert [r.split(":")[0].split(" at ")[0] for r in remarks] == ["design", "fault"]
    assert not done.log["vented"].any()
    assert "in 2 periods the quadratic program" in str(reached(done)["fault"])


def test_the_model_as_a_plant_is_the_integrated_body():
    """Open loop: two commands through their valves and dead times, against LSODA."""
    body, rng = segments(), np.random.default_rng(1)
    plant, exact = ModelPlant(body, time_step=5e-4, noise=0.0, pressure_noise=0.0), Lsoda(body)
    for k in range(150):
        if k % 30 == 0:
            command = rng.uniform(0.0, 1.5e5, 2)
        _, shape, pressure = plant.advance(command)
        exact.advance(command)
        np.testing.assert_allclose(shape[-1], exact.tip + np.array([0.0, 0.16]), atol=2e-4)
        np.testing.assert_allclose(pressure, exact.x[8:10], atol=1e3)


@pytest.mark.parametrize(
    ("feedback", "estimator"),
    [("lqr", "observer"), ("lqr", "differences"), ("mpc", "observer"),
     *(pytest.param(*p, marks=pytest.mark.slow)
       for p in (("lqr", "filter"), ("mpc", "filter"), ("mpc", "differences")))],
)  # fmt: skip
def test_the_loop_brings_an_unlike_body_to_its_place(feedback, estimator):
    """A body softer by a tenth that creeps, with noise: estimator and controller make up for it, or the integral."""
    model, creep = segments(), Memory(creep_share=(0.05,), creep_time=(0.3,))
    unlike = model.with_(stiffness=0.92 * model.stiffness, memory=creep)
    plant = ModelPlant(unlike)
    frames = np.array([plant.advance(np.zeros(2))[1] for _ in range(20)])
    level = tip_at(model, [1e5, 9e4])
    task = Task(np.array([0.0]), level[None], 1.4, feedback=feedback, outputs=BOTH, tuning=Tuning(integral_band=2e-3))
    ready = prepare_control(model, plant.arc_length, frames, task, LIMITS, PERIOD, estimator=estimator)
    assert "low: gain margin" in str(ready.design)
    clock, start = VirtualClock(), plant.tip
    arm = VirtualActuator(plant, clock)
    loop = ControlLoop([arm], arm, ready.pipeline, Watchdog(Bounds(2.3e5)), PERIOD, clock)
    assert loop.run(1.4) == ""
    assert np.linalg.norm(plant.tip - start - level) < (6e-3 if estimator == "differences" else 1e-3)
    assert loop.command.shape == (2,)


def test_a_rig_s_valve_of_one_chamber_is_followed_by_its_own_equation():
    """Without a gauge: x'' = w^2 (u - x) - 2 z w x', w by whether u lies above x, by SciPy; the other as modelled."""
    body, rig = segments(late=(8e-3, 0.0)), SupplyValve(9.0, 5.0, 0.7, 2 * PERIOD)
    plant = ModelPlant(body)
    frames = np.array([plant.advance(0.0)[1] for _ in range(8)])
    task = Task(np.zeros(1), np.array([[-0.02]]), 0.1, outputs=("tip_x",))
    made = prepare_control(model=body, arc_length=plant.arc_length, frames=frames, task=task, limits=LIMITS,
                           period=PERIOD, supply={"low": rig})  # fmt: skip
    assert [c.valve for c in made.body.chambers] == [rig.mean, body.chambers[1].valve]
    assert made.design.supply == (rig, None)
    command = np.repeat([8e4, 2e4, 5e4], 25)
    seen = np.array([made.control._valves[0].update(u, np.nan)[0] for u in command])

    def rates(x, t):
        u = command[min(int(t / PERIOD + 1e-9), 74)]
        w = 2 * np.pi * (9.0 if u > x[0] else 5.0)
        return [x[1], w * w * (u - x[0]) - 2 * 0.7 * w * x[1]]

    times = PERIOD * np.arange(76)
    true = odeint(rates, [0.0, 0.0], times, hmax=5e-4)[1:, 0]
    assert seen[:2] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(seen[2:], true[:-2], atol=200.0)


def test_what_does_not_fit_is_refused(tmp_path):
    body = segments()
    plant = ModelPlant(body)
    frames = np.array([plant.advance(0.0)[1] for _ in range(8)])

    def ready(model=body, limits=LIMITS, supply=None, **task):
        wanted = {"time": np.zeros(1), "displacement": np.zeros((1, 2)), "duration": 0.1, "outputs": BOTH} | task
        return prepare_control(model, plant.arc_length, frames, Task(**wanted), limits, PERIOD, supply=supply)

    with pytest.raises(InputError, match="'pid' needs one chamber and a fixed length: use lqr or mpc"):
        ready(feedback="pid")
    with pytest.raises(InputError, match=r"several chambers \(low, high\), so its task must name outputs"):
        ready(displacement=np.zeros(1), outputs=())
    with pytest.raises(InputError, match=r"valves name chamber 'mid', the model has low, high"):
        ready(supply={"mid": SupplyValve(9.0, 6.0, 0.7)})
    valve = "rise_hz = 9\nfall_hz = 6\ndamping_ratio = 0.7\ndead_time_ms = 8\n"
    point = "[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\n"
    (tmp_path / "v.toml").write_text(f"{point}[valves.low]\n{valve}")
    assert read_task(tmp_path / "v.toml").supply == {"low": SupplyValve(9.0, 6.0, 0.7, 8e-3)}
    (tmp_path / "v.toml").write_text(f"{point}[valve]\n{valve}[valves.low]\n{valve}")
    with pytest.raises(InputError, match=r"all chambers or \[valves.NAME\] for each, not both"):
        read_task(tmp_path / "v.toml")
    with pytest.raises(InputError, match="limits have 3 chambers, the model has 2"):
        ready(limits=Limits(2e5, chambers=(1e5, 1e5, 1e5)))
    with pytest.raises(InputError, match="unknown output 'tip_z'"):
        ready(outputs=("tip_x", "tip_z"))
    with pytest.raises(InputError, match="one chamber must give displacements of the tip"):
        ready(model=body.with_(chambers=body.chambers[:1]), limits=Limits(2e5))
    limits = "highest_kpa = [200, 180]\n"
    (tmp_path / "t.toml").write_text(f"{limits}[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\nangle_deg = 5\n")
    task = read_task(tmp_path / "t.toml")
    assert task.task.outputs == ("tip_x", "angle_sum")
    np.testing.assert_allclose(task.task.displacement, [[-0.02, np.deg2rad(5.0)]])
    assert (task.limits.highest, task.limits.chambers) == (2e5, (2e5, 1.8e5))
    (tmp_path / "t.toml").write_text("[[setpoint]]\ntime_s = 0\ntip_x_mm = 3\ndisplacement_mm = 4\n")
    with pytest.raises(InputError, match="needs displacement_mm for one chamber, or some of tip_x_mm"):
        read_task(tmp_path / "t.toml")
