"""Several outputs by several pressures: against closed forms, SciPy, and bodies integrated by LSODA."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import odeint
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize, root

from pliant.control import (
    Limits,
    OutputLqr,
    OutputMpc,
    SupplyValve,
    Task,
    Tuning,
    design_lqr,
    design_outputs,
    prepare_control,
    read_task,
    steady_inputs,
)
from pliant.errors import InputError
from pliant.estimation import State
from pliant.linear import linearise
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.loop.model_plant import ModelPlant
from pliant.model import Chamber, Memory, Valve, chain_model

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
        assert exact.success
        np.testing.assert_allclose(found.pressure, 1e5 * exact.x, atol=20.0)
        np.testing.assert_allclose(tip_at(body, found.pressure), wanted, atol=2e-6)


def test_what_outputs_leave_free_is_not_pressed():
    """Antagonists on one output: the one that pulls the other way rests; beyond a limit the nearest is told."""
    body, highest = antagonists(), np.array([1.5e5, 1.5e5])
    for side in (0, 1):
        alone = 6e4 * np.eye(2)[side]
        found = steady_inputs(body, ("tip_x",), tip_at(body, alone)[:1], highest, np.array([5e4, 5e4]))
        np.testing.assert_allclose(found.pressure, alone, atol=30.0)
    with pytest.raises(InputError, match=r"tip_x 0\.15 .* out of reach .* as near as tip_x 0\.0\d+, under 0, 150 kPa"):
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
    one = design_lqr(body, 1e5, PERIOD, grid=2).gain[0]
    unit = np.where(np.arange(one.size) < 6, 1.0, 1e3)
    unit[-1] = -1.0  # the tip's path leads to -x
    np.testing.assert_allclose(1e3 * many.K[0] / unit, one, rtol=1e-4)  # the path's tangent is a difference


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
    for law in (OutputLqr(design, LIMITS), OutputMpc(design, LIMITS)):
        tips, commands = closed(law, segments(), len(wanted))
        off = np.linalg.norm(tips - wanted, axis=1)[150:]
        assert np.sqrt(np.mean(off**2)) < 1e-3
        assert off.max() < 2e-3
        assert (commands >= 0.0).all()
        assert (commands <= [2e5, 1.8e5]).all()
    blind = replace(design, lead=0 * design.lead, ahead=0 * design.ahead)
    late = np.linalg.norm(closed(OutputLqr(blind, LIMITS), segments(), len(wanted))[0] - wanted, axis=1)[150:]
    assert np.sqrt(np.mean(late**2)) > 2 * np.sqrt(np.mean(off**2))  # what looking ahead is worth


@pytest.mark.slow
@pytest.mark.parametrize("kind", [OutputLqr, OutputMpc])
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


def test_prediction_without_limits_is_the_regulator(course):
    """The quadratic program over the horizon, solved without its box, gives the Riccati solution, path included."""
    wanted, design = course
    still = replace(design, at=np.full_like(design.at, 40), ahead=design.ahead.copy(), lead=design.lead.copy())
    made = still.gains[40]
    for k in range(len(wanted) - 1, -1, -1):  # one set of gains throughout, so that horizon and regulator agree
        later = made.P @ still.shift(k) + still.ahead[k + 1]
        still.lead[k], still.ahead[k] = -made.answer @ later, (made.A - made.B @ made.K).T @ later
    law, rng = OutputMpc(still, LIMITS), np.random.default_rng(3)
    answer, weighed, H = law._program(made)
    away, k = rng.normal(0.0, 1e-2, made.A.shape[0]), 200
    free, frees = away, []
    for j in range(law.stages):
        free = made.A @ free + still.shift(k + j)
        frees.append(free)
    slope = weighed.T @ np.ravel(frees) + answer.T @ still.ahead[k + law.stages]
    found = np.linalg.solve(H, -slope)[:2]
    np.testing.assert_allclose(found, still.lead[k] - made.K @ away, rtol=1e-6, atol=1e-6)


def test_prediction_within_limits_is_the_least_cost():
    """Against a search of the same cost by SciPy, written as a sum over the horizon."""
    body = segments()
    design = design_outputs(body, BOTH, tip_at(body, [1e5, 9e4])[None], LIMITS, PERIOD)
    law, made = OutputMpc(design, LIMITS, stages=5), design.gains[0]
    away = np.zeros(made.A.shape[0])
    away[:4] = [0.3, 0.5, 0.3, -0.1]
    hold = design.pressure[0] / 1e3
    command = law._wish(0, away, hold, 1.0)
    assert law.solved == 1

    def cost(flat):
        x, total = away, 0.0
        for k, v in enumerate(flat.reshape(5, 2)):
            x = made.A @ x + made.B @ v
            total += v @ made.R @ v + x @ (made.P if k == 4 else made.Q) @ x
        return 1e-3 * total

    box = [(-h, top - h) for h, top in zip(hold, (200.0, 180.0), strict=True)] * 5
    fine = {"ftol": 1e-15, "gtol": 1e-10, "maxfun": 1e5}
    best = minimize(cost, np.zeros(10), method="L-BFGS-B", bounds=box, options=fine)
    np.testing.assert_allclose(command - hold, best.x[:2], atol=0.05)
    assert np.isclose(command, [0.0, 0.0], atol=1e-9).any() or np.isclose(command, [200.0, 180.0]).any()


def test_the_model_as_a_plant_is_the_integrated_body():
    """Open loop: two commands through their valves and dead times, against LSODA."""
    body, rng = segments(), np.random.default_rng(1)
    plant, exact = ModelPlant(body, step=5e-4, noise=0.0, pressure_noise=0.0), Lsoda(body)
    for k in range(150):
        if k % 30 == 0:
            command = rng.uniform(0.0, 1.5e5, 2)
        _, shape, pressure = plant.advance(command)
        exact.advance(command)
        np.testing.assert_allclose(shape[-1], exact.tip + np.array([0.0, 0.16]), atol=2e-4)
        np.testing.assert_allclose(pressure, exact.x[8:10], atol=1e3)


@pytest.mark.parametrize("estimator", ["observer", "filter", "differences"])
@pytest.mark.parametrize("feedback", ["lqr", "mpc"])
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

    with pytest.raises(InputError, match="'pid' takes one chamber and a fixed length: use lqr or mpc"):
        ready(feedback="pid")
    with pytest.raises(InputError, match=r"several chambers \(low, high\) or a body that lengthens names its outputs"):
        ready(displacement=np.zeros(1), outputs=())
    with pytest.raises(InputError, match=r"valves name 'mid', the model's chambers are low, high"):
        ready(supply={"mid": SupplyValve(9.0, 6.0, 0.7)})
    valve = "rise_hz = 9\nfall_hz = 6\ndamping_ratio = 0.7\ndead_time_ms = 8\n"
    point = "[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\n"
    (tmp_path / "v.toml").write_text(f"{point}[valves.low]\n{valve}")
    assert read_task(tmp_path / "v.toml").supply == {"low": SupplyValve(9.0, 6.0, 0.7, 8e-3)}
    (tmp_path / "v.toml").write_text(f"{point}[valve]\n{valve}[valves.low]\n{valve}")
    with pytest.raises(InputError, match=r"every chamber or \[valves.NAME\] for each, not both"):
        read_task(tmp_path / "v.toml")
    with pytest.raises(InputError, match="limits name 3 chambers, the model has 2"):
        ready(limits=Limits(2e5, chambers=(1e5, 1e5, 1e5)))
    with pytest.raises(InputError, match="unknown output 'tip_z'"):
        ready(outputs=("tip_x", "tip_z"))
    with pytest.raises(InputError, match="one chamber is given displacements of its tip"):
        ready(model=body.with_(chambers=body.chambers[:1]), limits=Limits(2e5))
    limits = "highest_kpa = [200, 180]\n"
    (tmp_path / "t.toml").write_text(f"{limits}[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\nangle_deg = 5\n")
    task = read_task(tmp_path / "t.toml")
    assert task.task.outputs == ("tip_x", "angle_sum")
    np.testing.assert_allclose(task.task.displacement, [[-0.02, np.deg2rad(5.0)]])
    assert (task.limits.highest, task.limits.chambers) == (2e5, (2e5, 1.8e5))
    (tmp_path / "t.toml").write_text("[[setpoint]]\ntime_s = 0\ntip_x_mm = 3\ndisplacement_mm = 4\n")
    with pytest.raises(InputError, match="takes displacement_mm for one chamber, or some of tip_x_mm"):
        read_task(tmp_path / "t.toml")
