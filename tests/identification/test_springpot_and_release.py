"""A springpot laid out in branches, and a hand that takes its time: closed forms and SciPy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit, predict, sensitivities
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import apply
from pliant.model import Memory, Model, Station
from pliant.model.memory import springpot
from pliant.simulation import Pulse, Trace, simulate

BAND = (0.1, 100.0)  # Hz
POT = {"fractional_share": 0.2, "fractional_order": 0.3, "fractional_low": 0.3, "fractional_high": 50.0}
TIMES = np.arange(0.0, 0.8, 0.01)


@pytest.mark.parametrize("order", [0.1, 0.25, 0.5])
def test_the_branches_answer_as_a_springpot_does_over_the_band(order: float) -> None:
    made = springpot(0.2, order, *BAND)
    w = 2 * np.pi * np.geomspace(*BAND, 500)
    turn = 1j * w[:, None] * np.array(made.creep_time)
    ratio = (made.spring + (turn / (1 + turn)) @ np.array(made.creep_share)) / (0.2 * (1j * w) ** order)
    assert len(made.creep_time) == 9
    assert np.abs(np.abs(ratio) - 1).max() <= 0.016
    assert np.abs(np.angle(ratio, deg=True)).max() <= 2.3


@pytest.mark.parametrize("order", [0.1, 0.25, 0.5])
def test_the_branches_relax_as_a_springpot_does(order: float) -> None:
    """Its relaxation after a step of 1 is share t^-a / gamma(1 - a), a closed form in time."""
    made = springpot(0.2, order, *BAND)
    t = np.geomspace(0.01, 0.5, 50)  # later the slow end of the band shows
    found = made.spring + np.exp(-t[:, None] / np.array(made.creep_time)) @ np.array(made.creep_share)
    np.testing.assert_allclose(found, 0.2 * t**-order / gamma(1 - order), rtol=0.02)


def mittag_leffler(x: np.ndarray, order: float) -> np.ndarray:
    """E_a(-x^a) for 0 < a < 1, as the sum of decays that it is."""
    log_rate = np.linspace(-120, 60, 60001)
    rate = np.exp(log_rate)
    weight = np.sin(np.pi * order) / np.pi / (rate**order + 2 * np.cos(np.pi * order) + rate**-order)
    return np.trapezoid(weight * np.exp(-rate * x[:, None]), log_rate, axis=1)


@pytest.mark.parametrize("order", [0.25, 0.5])
def test_a_joint_creeps_as_mittag_leffler_says(order: float) -> None:
    """A spring beside a springpot under a constant torque: q = torque / K0 (1 - E_a(-(K0 / c) t^a)), inertia small."""
    share, torque = 0.3, 0.01
    made = springpot(share, order, 0.01, 50.0)
    model = Model(
        link_length=[0.05], link_mass=0.06, stiffness=1.0, damping=0.0, torque=[1e-6],
        memory=Memory(made.creep_share, made.creep_time),
    )
    times = np.array([0.0, 0.5, 1.0, 2.0, 5.0, 10.0])
    q = simulate(model, Pulse(torque / 1e-6, 0.0, 100.0), times=times, time_step=5e-4).joint_angle.values[1:, 0]
    own = 1.0 - made.spring
    x = times[1:] * (own / share) ** (1 / order)
    np.testing.assert_allclose(q, torque / own * (1 - mittag_leffler(x, order)), rtol=0.01)


def bent(**changes: Any) -> Model:
    """A chain of three links under gravity with a springpot and friction."""
    entries: dict[str, Any] = {
        "link_length": np.full(3, 0.04), "link_mass": 0.012, "stiffness": 0.9, "damping": 1e-3, "torque": [4e-7],
        "gravity": [9.81, 0.0], "stations": (Station("tip", 2, 0.04),),
    }
    return Model(**entries | changes)


def test_no_energy_is_ever_gained() -> None:
    model = apply(bent(damping=0.0, gravity=[0.0, 0.0]), POT | {"fractional_share": 0.5})
    rng = np.random.default_rng(5)
    pressure = Trace(np.arange(41) * 0.1, np.append(rng.uniform(-8e4, 8e4, 40), 0.0))
    run = simulate(model, pressure, duration=5.0, time_step=2e-3)
    stored = run.kinetic_energy + run.elastic_energy + run.memory_energy
    lost = run.memory_dissipation.values
    assert np.diff(lost).min() >= -1e-15
    assert lost[-1] > 1e-4
    gap = (stored - stored[0] + run.memory_dissipation + run.dissipated_energy - run.input_work).values
    assert np.abs(gap).max() < 1e-7 * np.abs(run.input_work.values).max()


def released(model: Model, pose: float | None = None, name: str = "r") -> Experiment:
    """A body that a hand lets go at an unknown time, with its tip held at [pose, 0.1] or in its unloaded shape."""
    seen = np.cumsum(np.full((TIMES.size, 1, 2), 1e-3), axis=0)
    held = None if pose is None else np.array([[pose, 0.1]])
    return Experiment(name, TIMES, seen, ("tip",), "release", held=held)


def test_the_springpot_lies_over_the_band_of_the_recordings_and_is_fixed() -> None:
    exp = released(bent())
    model, listed = prepare([exp], bent(), ["fractional_share", "fractional_order", "stiffness"])
    named = {p.name: p for p in listed}
    assert named["fractional_low"].value == pytest.approx(1 / 0.79)
    assert named["fractional_high"].value == pytest.approx(50.0)
    assert not named["fractional_low"].free
    assert not named["fractional_high"].free
    values = {p.name: p.value for p in listed}
    once = apply(model, values)
    assert len(once.memory.creep_share) == len(once.memory.creep_time) == 7
    assert apply(once, values).memory == once.memory


@pytest.mark.parametrize(("values", "sentence"), [
    ({"fractional_share": 0.1, "fractional_order": 0.2}, "fractional_low, fractional_high is missing"),
    (POT | {"creep_share_1": 0.1, "creep_time_1": 0.1}, "leave out either"),
    (POT | {"fractional_low": 60.0}, "0 < low < high in Hz"),
    (POT | {"fractional_low": 1e-6}, "choose a narrower band"),
])
def test_a_springpot_that_makes_no_sense_is_told(values: dict[str, float], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        apply(bent(), values)


def test_a_band_is_not_fitted() -> None:
    free = ["fractional_share", "fractional_order", Parameter("fractional_low", 0.5)]
    with pytest.raises(InputError, match="cannot be fitted"):
        prepare([released(bent())], bent(), free)


@pytest.mark.parametrize("held", ["unloaded", "measured", "force"])
@pytest.mark.parametrize("memory", [False, True])
def test_every_parameter_agrees_with_differences(held: str, memory: bool) -> None:
    slip = Memory(slip_share=(0.2,), slip_angle=(0.01,)) if memory else Memory()
    model = bent(memory=slip, stiffening=-0.3)
    exp = released(model, 0.03 if held == "measured" else None)
    values = {"stiffness": 0.9, "damping": 1e-3, "tip_mass": 0.004, "release_time": 0.043, "r.release": 0.1033}
    values |= {"hold_force": 0.2} if held == "force" else {}
    values |= POT if memory else {}
    for name in set(values) - {"fractional_low", "fractional_high"}:
        value = values[name]
        _, slopes = sensitivities(model, exp, values, {name: abs(value)}, 1e-3)
        d = 2e-5 * abs(value)
        high, low = (predict(model, exp, {**values, name: value + side * d}, 1e-3)["position"] for side in (1, -1))
        expected = (high - low) / (2 * d)
        assert np.abs(slopes[0, ..., :2] - expected).max() < 2e-5 * np.abs(expected).max(), name


L, MASS, K, D, G = 0.1, 0.05, 0.8, 2e-3, 9.81


def link() -> Model:
    """One link, a point mass at its tip, that gravity pulls aside."""
    return Model(
        link_length=[L], link_mass=MASS, mass_at="tip", stiffness=K, damping=D, gravity=[-G, 0.0],
        torque=[1e-6], stations=(Station("tip", 0, L),),
    )


def swing(at: float, length: float, angle: float) -> np.ndarray:
    """Angles (T,) of `link`, held at `angle` [rad] until the time `at` and let go within `length`; SciPy."""
    pull = K * angle - MASS * G * L * np.cos(angle)

    def rate(t: float, y: np.ndarray) -> list[float]:
        left = 0.5 * (1 + np.cos(np.pi * min((t - at) / length, 1.0)))
        torque = pull * left - K * y[0] - D * y[1] + MASS * G * L * np.cos(y[0])
        return [y[1], torque / (MASS * L**2)]

    out = np.full(TIMES.size, angle)
    after = at + length
    during, later = (at < TIMES) & (after >= TIMES), after < TIMES
    tight: dict[str, Any] = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
    one = solve_ivp(rate, (at, after), [angle, 0.0], t_eval=np.append(TIMES[during], after), **tight)
    two = solve_ivp(rate, (after, TIMES[-1] + 1e-9), one.y[:, -1], t_eval=TIMES[later], **tight)
    out[during], out[later] = one.y[0, :-1], two.y[0]
    return out


@pytest.mark.parametrize("angle", [0.0, -0.3])
def test_a_link_let_go_by_hand_moves_as_scipy_says(angle: float) -> None:
    model, expected = link(), swing(0.1033, 0.0517, angle)
    tip = L * np.column_stack([-np.sin(expected), np.cos(expected)])
    exp = released(model)
    exp = replace(exp, held=tip[:1]) if angle else exp
    steps = np.array([2e-3, 1e-3, 5e-4])
    values = {"r.release": 0.1033, "release_time": 0.0517}
    wrong = [np.abs(predict(model, exp, values, h)["position"][:, 0] - tip).max() for h in steps]
    assert np.ptp(tip, axis=0).max() > 0.005
    assert wrong[-1] < 2e-5
    assert 1.8 < np.polyfit(np.log(steps), np.log(wrong), 1)[0] < 2.3


@pytest.mark.parametrize("extra", [{}, {"hold_force": 0.2}, POT])
def test_a_release_without_duration_is_the_sudden_one(extra: dict[str, float]) -> None:
    model, values = bent(), {"r.release": 0.1033, **extra}
    sudden = predict(model, released(model), values, 1e-3)["position"]
    for length, most in ((0.0, 1e-15), (1e-9, 1e-9)):
        found = predict(model, released(model), {**values, "release_time": length}, 1e-3)["position"]
        assert np.abs(found - sudden).max() < most
    slow = predict(model, released(model), {**values, "release_time": 0.2}, 1e-3)["position"]
    assert np.abs(slow - sudden).max() > 1e-3
    assert np.abs(slow[TIMES < 0.12] - slow[0]).max() < 1e-4  # it begins in equilibrium


def test_springpot_and_release_time_come_back_from_two_loads() -> None:
    truth = bent(damping=0.0)
    values = POT | {"fractional_share": 0.06, "fractional_low": 1 / 0.79} | {"release_time": 0.045}
    made = []
    for name, mass, at in (("r", 0.0, 0.1033), ("s", 0.02, 0.0871)):
        exp = replace(released(truth, name=name), known={"tip_mass": mass})
        seen = predict(truth, exp, {**values, f"{name}.release": at}, 2e-3)["position"]
        noise = 2e-5 * np.random.default_rng(3).standard_normal(seen.shape)
        made.append(replace(exp, position=seen + noise))
    free = ["stiffness", "fractional_share", "fractional_order", "release_time"]
    found = fit(made, truth, free, time_step=2e-3, starts=1)
    for p in found.parameters:
        if p.name in values | {"stiffness": 0.9} and p.free:
            right = (values | {"stiffness": 0.9})[p.name]
            assert p.std < 0.25 * right, p
            assert abs(p.value - right) < 4 * p.std, p


def test_a_motion_depends_continuously_on_the_time_of_its_release() -> None:
    """With one step more or less before the first frame, the positions would jump by the error of a step."""
    model = Model(
        link_length=[0.1], link_mass=0.05, stiffness=0.5, damping=1e-3, torque=[1e-6],
        stations=(Station("tip", 0, 0.1, 0.0),),
    )  # fmt: skip
    exp = released(model, 0.05)
    paths = [predict(model, exp, {"r.release": 0.052 + change, "release_time": 0.0}, 2e-3)["position"]
             for change in (-2e-9, -1e-9, 1e-9, 2e-9)]  # fmt: skip
    first, second, third = (np.abs(np.diff(paths, axis=0)[k]).max() for k in range(3))
    assert first > 0.0
    assert second < 4.0 * first
    assert third < 2.0 * first
