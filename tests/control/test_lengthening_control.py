"""Tip and length of a body that lengthens, by two chambers side by side: on point masses that share no equation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.stretching import Stretching
from scipy.integrate import solve_ivp
from scipy.optimize import root

from pliant.control import (
    Limits,
    Lqr,
    Mpc,
    Pipeline,
    Task,
    design_outputs,
    prepare_control,
    read_task,
    steady_inputs,
)
from pliant.control.model_plant import ModelPlant
from pliant.errors import InputError
from pliant.estimation import Frame, KalmanFilter, State, frozen, rows_of
from pliant.estimation.link_angles import with_rest_shape
from pliant.linear.linearisation import linearise
from pliant.loop import Bounds, ControlLoop, LoopLog, VirtualActuator, VirtualClock, Watchdog, log_columns
from pliant.loop.task import run_task
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Valve, chain_model

PERIOD, LATE, LAG = 4e-3, 2, 0.02  # s, periods, s
BOTH, LIMITS = ("tip_x", "tip_y"), Limits(1e5)
AREA, OFFSETS = [2e-4] * 2, [0.02, -0.02]


def pair(softer=1.0):
    """Three links that lengthen, hanging, between two chambers behind valves."""
    valve = Valve(rise_time=LAG, fall_time=LAG, dead_time=LATE * PERIOD)
    chambers = [Chamber.at_offset(2e-4, r, np.ones(3), name=n, valve=valve) for r, n in zip(OFFSETS, "ab", strict=True)]
    return chain_model(
        length=0.2, mass=0.1, links=3, joint_placement="midsegment", stiffness=softer, damping=0.015,
        chambers=chambers, gravity=[0.0, 9.81], base_angle=0.1,
        extensions=(Extension(130.0 * softer, 0.6, 0.0, 0.1, "near"), Extension(110.0 * softer, 0.6, 0.1, name="far")),
    )


class Masses:
    """The body as point masses behind its valves and dead times, with noise on its link tips: a plant of a loop."""

    def __init__(self, body, noise=0.0):
        self.own, self.period, self.time, self.arc_length = masses(body), PERIOD, 0.0, None
        self.x, self.waiting = np.append(at_rest(self.own, np.zeros(2)), np.zeros(5 + 2)), [np.zeros(2)] * LATE
        self.rows = np.array([self.own.place(k + 1, body.link_length[k]) for k in range(3)])
        self.noise, self.rng = noise, np.random.default_rng(1)

    def advance(self, command):
        """Hold commands for a period."""
        *self.waiting, asked = command * np.ones(2), *self.waiting

        def rates(_t, y):
            x, v, p = np.split(y, [5, 10])
            return np.concatenate([v, self.own.acceleration(x, v, p), (asked - p) / LAG])

        self.x = solve_ivp(rates, (0.0, PERIOD), self.x, rtol=1e-5, atol=1e-8).y[:, -1]
        self.time += PERIOD
        tips = self.own.points(self.x[:5], self.rows)
        return self.time, tips + self.noise * self.rng.standard_normal(tips.shape), self.x[10:]

    @property
    def tip(self):
        return self.own.points(self.x[:5], self.rows[-1])


def test_a_controller_s_model_has_the_stiffness_of_all_hysteresis():
    """About the straight rest without weight, the linear model is that of the body, before anything slips or creeps."""
    memory = Memory((0.1,), (0.5,), (0.2,), (0.02,), axial_creep_share=(0.2,), axial_creep_time=(0.3,),
                    axial_slip_share=(0.3,), axial_slip_strain=(0.01,))  # fmt: skip
    near, far = pair().extensions
    curved = replace(near, stiffening=-0.5, cubic_stiffening=3.0, stiffening_bound=0.6)
    body = pair().with_(gravity=[0.0, 0.0], extensions=(curved, far), memory=memory)
    np.testing.assert_allclose(linearise(frozen(body)).A, linearise(body).A, rtol=1e-12, atol=1e-12)
    x = mechanics_of(body).coordinates(np.array([0.1, -0.2, 0.3, 0.05, -0.1]))
    springs, held = (mechanics_of(m).linear_parts(x)[1] for m in (frozen(body), body))
    np.testing.assert_allclose(springs, held, rtol=1e-12, atol=1e-12)


def masses(body):
    return Stretching(body, AREA, OFFSETS, np.ones((2, 3)), np.ones((2, 2)))


def at_rest(own, pressure):
    """Where nothing accelerates (5,), by a root find."""
    found = root(lambda x: 1e-3 * own.acceleration(x, np.zeros(5), pressure), np.zeros(5), tol=1e-12)
    assert np.abs(found.fun).max() < 1e-6
    return found.x


def tip_at(body, pressure):
    own = masses(body)
    return own.points(at_rest(own, np.asarray(pressure)), own.length)


def test_steady_inputs_bend_and_lengthen():
    """Both chambers lengthen, their difference bends: pressures found again from the tip of resting point masses."""
    body = pair()
    for pressure in ([9e4, 2e4], [7e4, 7e4], [1e4, 1.2e5]):
        found = steady_inputs(body, BOTH, tip_at(body, pressure), np.full(2, 1.5e5), np.zeros(2))
        np.testing.assert_allclose(found.pressure, pressure, atol=20.0)
    with pytest.raises(InputError, match="out of reach"):
        steady_inputs(body, BOTH, np.array([0.0, 0.3]), np.full(2, 1.5e5), np.zeros(2))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Lqr, Mpc])
def test_the_tip_goes_where_bending_alone_does_not_lead(kind):
    """From rest to 12 mm further out, then to the side at that length; the state is known."""
    body = pair()
    still = tip_at(body, [0.0, 0.0])
    first, second = tip_at(body, [4.4e4, 4.4e4]) - still, tip_at(body, [9e4, 2e4]) - still
    assert first[1] > 0.012
    wanted = np.where(np.arange(240)[:, None] < 80, first, second)
    law, plant, off = kind(design_outputs(body, BOTH, wanted, LIMITS, PERIOD), LIMITS), Masses(body), []
    for k in range(len(wanted)):
        x, v, p = np.split(plant.x, [5, 10])
        none = np.zeros((2, 3))
        known = State(
            k * PERIOD, x[:3], v[:3], *none, np.zeros((10, 10)), strain=x[3:], strain_rate=v[3:],
            strain_shift=np.zeros(2),
        )
        plant.advance(law.step(k * PERIOD, known, p))
        off.append(np.linalg.norm(plant.tip - still - wanted[k]))
    assert np.max(off[65:80]) < 3e-4
    assert np.max(off[220:]) < 3e-4
    assert (law.command <= 1e5).all()
    assert law.saturated + getattr(law, "solved", 0) > 0


@pytest.mark.slow
def test_a_filter_and_a_regulator_make_up_for_an_unlike_body(tmp_path):
    """Stiffness of joints and segment smaller by 8 %, noise on three link tips: in the loop, to 1 mm."""
    model, plant, clock = pair(), Masses(pair(0.92), noise=2e-4), VirtualClock()
    start, wanted = plant.tip, tip_at(model, [8e4, 3e4]) - tip_at(model, [0.0, 0.0])
    rows, variance = rows_of(model, model.points), np.full(6, 2e-4**2)
    seeing = KalmanFilter(model, time=-np.inf)
    law = Lqr(design_outputs(model, BOTH, wanted[None], LIMITS, PERIOD), LIMITS)
    pipeline = Pipeline(lambda shape: Frame(rows, shape.ravel(), variance), seeing, law)
    arm, log = VirtualActuator(plant, clock), LoopLog(tmp_path / "log.csv", log_columns(3, 2, BOTH))
    loop = ControlLoop([arm], arm, pipeline, Watchdog(Bounds(1.3e5)), PERIOD, clock, log)
    assert loop.run(1.0) == ""
    log.close()
    assert np.linalg.norm(plant.tip - start - wanted) < 1e-3
    written = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True, skip_header=1, comments="#")[-1]
    q = np.diff([written[f"phi_{i}_rad"] for i in (1, 2, 3)], prepend=model.base_angle)
    torque, sd = (np.array([written[f"{name}_{i}_nm"] for i in (1, 2, 3)]) for name in ("torque", "torque_sd"))
    assert (np.abs(torque - 0.08 * q) < 4.0 * sd).all()  # what softer springs do not hold


def test_the_points_of_a_model_plant_are_those_of_the_body():
    """Under 80 and 30 kPa held for 2 s: its base, first joint and tips where point masses rest."""
    body = pair()
    plant = ModelPlant(body, noise=0.0)
    for _ in range(500):
        _, points, _ = plant.advance(np.array([8e4, 3e4]))
    own = masses(body)
    x, ends = at_rest(own, np.array([8e4, 3e4])), np.cumsum(own.length)
    rows = np.array([own.place(k, own.length[k]) for k in range(4)])
    found = np.stack([np.interp(ends, plant.arc_length, column) for column in points.T], axis=1)
    np.testing.assert_allclose(found, own.points(x, rows), atol=3e-4)


def test_commands_that_see_a_dense_curve_refuse():
    task = Task(np.zeros(1), np.zeros((1, 2)), 0.1, outputs=BOTH)
    with pytest.raises(InputError, match="a Pipeline of the stations"):
        prepare_control(pair(), np.linspace(0.0, 0.2, 20), np.zeros((6, 20, 2)), task, LIMITS, PERIOD)


@pytest.mark.slow
def test_a_task_brings_a_body_that_lengthens_there_from_a_plant_whose_markers_ride_on_it(tmp_path):
    """Point masses softer than the model by 8 %, their tips as markers; what a task file asks of `pliant control`."""
    model, plant = pair(), Masses(pair(0.92), noise=2e-4)
    plant.arc_length, plant.rides = model.base_length + np.cumsum(model.link_length), True
    wanted = tip_at(model, [8e4, 3e4]) - tip_at(model, [0.0, 0.0])
    (tmp_path / "t.toml").write_text(
        f"highest_kpa = 100.0\nduration_s = 1.0\n[[setpoint]]\ntime_s = 0.1\ntip_x_mm = {1e3 * wanted[0]}\n"
        f"tip_y_mm = {1e3 * wanted[1]}\n"
    )
    task = read_task(tmp_path / "t.toml")
    with pytest.raises(InputError, match=r"does not support .*lengthens.*estimator filter"):
        run_task(model, plant, task, tmp_path)
    start = plant.tip
    done = run_task(model, plant, task, tmp_path, estimator="filter")
    assert done.summary["fault"] == ""
    assert np.linalg.norm(plant.tip - start - wanted) < 1e-3
    assert plant.tip[1] > start[1] + 0.005


def test_rest_angles_are_found_from_points_that_ride(rng):
    """Turned rest angles of a hanging body, whose springs and segments its weight moves, from noisy points."""
    turned = pair().with_(rest_angle=[0.05, -0.04, 0.03])
    plant = ModelPlant(turned, noise=1e-5)
    frames = np.array([plant.advance(np.zeros(2))[1] for _ in range(20)])
    body, places = with_rest_shape(pair(), plant.arc_length, frames)
    assert body.rest_angle == pytest.approx(turned.rest_angle, abs=2e-3)  # points 5 mm apart cut the joints' corners
    assert places.frame(frames[0]).values.reshape(-1, 2)[-1] == pytest.approx(plant.tip, abs=2e-4)
    frames[:16] = np.nan
    with pytest.raises(InputError, match="at least 5 complete frames, got 4 of 20"):
        with_rest_shape(pair(), plant.arc_length, frames)
    with pytest.raises(InputError, match="must lie along the body"):
        with_rest_shape(pair(), plant.arc_length[:20], frames[:, :20])
    with pytest.raises(InputError, match=r"41 points, \(x, y\) each"):
        places.frame(np.zeros((3, 2)))
