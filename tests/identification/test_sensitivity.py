"""Exact sensitivities: held to differences of motions, to an adaptive solver, and to themselves where steps change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter, fit, plans, predict, sensitivities
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import apply
from pliant.identification.problem import Problem
from pliant.identification.sensitivity import slopes_of
from pliant.model import Model, Valve
from pliant.simulation import Pulse, simulate

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

STEP = 1e-3
VALUES = {
    "p.start": 0.1234, "p.stop": 0.6012, "stiffness": 0.9, "stiffness_2": 0.8, "damping": 6e-3, "mass": 0.05,
    "tip_mass": 0.01, "valve_rise_time": 0.03, "valve_fall_time": 0.05, "valve_dead_time": 0.003, "torque_1": 6e-7,
    "torque_2": 1e-13, "gain": 1.1, "base_angle": 0.02, "base_x": 1e-3, "tip.along": 0.03, "tip.across": -0.005,
    "rest_angle_3": 0.07, "gravity_angle": 2.7, "latency": 4.2e-3,
}


@pytest.fixture
def hanging(truth: Model) -> Model:
    return truth.with_(gravity=[3.0, -6.0], base_length=0.01)


def differences(
    model: Model, exp: Experiment, values: dict[str, float], name: str, size: float, step: float = STEP,
) -> np.ndarray:
    """Central differences (T, S, 2) of the predicted positions."""
    high, low = (predict(model, exp, {**values, name: values[name] + d}, step)["position"] for d in (size, -size))
    return (high - low) / (2 * size)


@pytest.mark.parametrize("name", VALUES)
def test_every_parameter_agrees_with_differences(hanging: Model, pulse: Any, name: str) -> None:
    exp = pulse(hanging)
    size = abs(VALUES[name])
    rows, slopes = sensitivities(hanging, exp, VALUES, {name: size}, STEP)
    expected = differences(hanging, exp, VALUES, name, 2e-5 * size)
    assert np.abs(slopes[0, ..., :2] - expected).max() < 3e-6 * np.abs(expected).max()
    np.testing.assert_allclose(rows[..., :2], predict(hanging, exp, VALUES, STEP)["position"], rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["joint_gain_2", "latency"])
def test_gains_of_joints_and_latency_agree_with_differences(hanging: Model, traced: Any, name: str) -> None:
    exp = traced(hanging)
    values = {"joint_gain_1": 1.2, "joint_gain_2": 0.7, "latency": 0.0117, "stiffness": 0.9, "damping": 6e-3}
    size = abs(values[name])
    _, slopes = sensitivities(hanging, exp, values, {name: size}, STEP)
    expected = differences(hanging, exp, values, name, 2e-5 * size)
    assert np.abs(slopes[0, ..., :2] - expected).max() < 3e-6 * np.abs(expected).max()


RUBBER = {"torque_1": 4e-7, "torque_2": 2e-12, "swell_share": 0.3, "swell_time": 0.2, "inflation_limit": 1.7e5,
          "inflation_time": 0.04}  # fmt: skip
SLOW_VALVE = {"valve_rise_time": 0.03, "valve_fall_time": 0.05, "valve_rise_rate": 1.5e6, "valve_fall_rate": 9e5,
              "valve_settle_share": 0.2, "valve_settle_time": 0.3}  # fmt: skip


@pytest.mark.parametrize("values", [RUBBER | SLOW_VALVE, RUBBER, SLOW_VALVE | {"torque_2": 2e-12}])
@pytest.mark.parametrize("kind", ["pulse", "traced"])
def test_all_of_a_chamber_agrees_with_differences(
    hanging: Model, request: pytest.FixtureRequest, kind: str, values: dict[str, float]
) -> None:
    exp = request.getfixturevalue(kind)(hanging)
    edges = {"p.start": 0.1234, "p.stop": 0.6012} if kind == "pulse" else {"t.start": 0.0017}
    values = {**values, **edges}
    _, slopes = sensitivities(hanging, exp, values, {n: abs(v) for n, v in values.items()}, STEP)
    for slope, (name, value) in zip(slopes, values.items(), strict=True):
        expected = differences(hanging, exp, values, name, 2e-5 * abs(value))
        assert np.abs(slope[..., :2] - expected).max() < 3e-6 * np.abs(expected).max(), name


@pytest.mark.parametrize("damping_ratio", [0.4, 1.0, 3.0])
def test_a_law_behind_a_valve_of_second_order_agrees_with_differences(
    hanging: Model, pulse: Any, damping_ratio: float
) -> None:
    model = hanging.with_(valve=Valve(natural_frequency=6.0, damping_ratio=damping_ratio), torque=[4e-7, 2e-12])
    exp = pulse(model)
    values = {"p.start": 0.1234, "p.stop": 0.6012, "torque_1": 4e-7, "torque_2": 2e-12}
    _, slopes = sensitivities(model, exp, values, {n: abs(v) for n, v in values.items()}, STEP)
    for slope, (name, value) in zip(slopes, values.items(), strict=True):
        expected = differences(model, exp, values, name, 2e-5 * abs(value))
        assert np.abs(slope[..., :2] - expected).max() < 3e-6 * np.abs(expected).max(), name


@pytest.mark.parametrize("name", ["stiffness", "damping", "torque_1", "valve_rise_time"])
def test_sensitivities_are_those_of_an_adaptive_solver(truth: Model, pulse: Any, name: str) -> None:
    field = {"stiffness": "stiffness", "damping": "damping", "torque_1": "torque"}
    values = {"p.start": 0.1, "p.stop": 0.6, "stiffness": 0.9, "damping": 6e-3, "torque_1": 6e-7,
              "valve_rise_time": 0.03}
    exp = pulse(truth, start=0.1, stop=0.6)

    def tip(value: float) -> np.ndarray:
        if name == "valve_rise_time":
            moved = truth.with_(valve=Valve(rise_time=value, fall_time=0.05))
        else:
            moved = truth.with_(**{field[name]: [value] if name == "torque_1" else value})
        run = simulate(moved, Pulse(1e5, 0.1, 0.5), times=exp.time, method="LSODA", rtol=1e-11)
        return np.asarray(run["station_position"].values)

    size = 1e-3 * values[name]
    expected = (tip(values[name] + size) - tip(values[name] - size)) / (2 * size)
    _, slopes = sensitivities(truth, exp, values, {name: values[name]}, 2e-4)
    assert np.abs(slopes[0, ..., :2] - expected).max() < 2e-4 * np.abs(expected).max()


@pytest.mark.parametrize("edge", [0.12, 0.12 + 1e-12, 0.122, 0.125])
def test_an_edge_on_a_frame_or_on_a_step_has_a_derivative(hanging: Model, pulse: Any, edge: float) -> None:
    exp = pulse(hanging)
    values = {**VALUES, "p.start": edge}
    _, here = sensitivities(hanging, exp, values, {"p.start": 0.01}, 2e-3)
    _, beside = sensitivities(hanging, exp, {**values, "p.start": edge + 1e-4}, {"p.start": 0.01}, 2e-3)
    assert np.abs(here - beside).max() < 0.05 * np.abs(here).max()


@pytest.mark.parametrize("name", ["p.stop", "valve_dead_time"])
def test_an_edge_that_hands_a_step_from_one_side_to_the_other_has_a_derivative(
    hanging: Model, pulse: Any, name: str
) -> None:
    """A hair before, the steps of the frame are as many, but four of them lie behind the edge instead of two."""
    exp = pulse(hanging)
    values = {**VALUES, "p.start": 0.1234, "p.stop": 0.599 + 1e-7, "latency": 0.0}  # acts 2 ms after a frame
    _, slopes = sensitivities(hanging, exp, values, {name: 0.01}, 2e-3)
    expected = differences(hanging, exp, values, name, 5e-8, 2e-3)
    assert np.abs(slopes[0, ..., :2] - expected).max() < 1e-5 * np.abs(expected).max()


def test_a_zero_on_its_bound_has_a_derivative(hanging: Model, pulse: Any) -> None:
    exp = pulse(hanging)
    at_bound = {"tip_mass": 0.0, "valve_rise_time": 0.0, "valve_fall_time": 0.0, "valve_dead_time": 0.0, "damping": 0.0}
    _, slopes = sensitivities(hanging, exp, {**VALUES, **at_bound}, dict.fromkeys(at_bound, 1e-3), STEP)
    assert np.isfinite(slopes).all()
    assert (np.abs(slopes).max(axis=(1, 2, 3)) > 0).all()


def test_what_a_recording_knows_and_what_is_another_s_has_no_derivative(truth: Model, released: Any) -> None:
    exp = released(truth, known={"tip_mass": 0.01})
    values = {"r.release": 0.2071, "tip_mass": 0.0, "other.start": 0.1, "stiffness": 0.9}
    _, slopes = sensitivities(truth, exp, values, dict.fromkeys(values, 0.01), STEP)
    np.testing.assert_array_equal(np.abs(slopes).max(axis=(1, 2, 3)) > 0, [True, False, False, True])


@pytest.mark.parametrize("force", [0.0, 0.4])
def test_a_release_agrees_with_differences(truth: Model, released: Any, force: float) -> None:
    heavy = truth.with_(gravity=[3.0, -6.0], tip_mass=0.01)
    exp = released(heavy, force=force or None)
    values = {"r.release": 0.2071, "r.hold_force": force, "r.base_turn": -0.03, "stiffness": 0.9, "rest_angle": 0.1}
    for name, value in values.items():
        size = abs(value) or 0.05
        _, slopes = sensitivities(heavy, exp, values, {name: size}, STEP)
        expected = differences(heavy, exp, values, name, 2e-5 * size)
        assert np.abs(slopes[0, ..., :2] - expected).max() < 3e-6 * np.abs(expected).max()


def test_observed_angles_help_and_are_followed(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    rows = predict(truth, exp, {}, 1e-4)
    angle = rows["angle"] - rows["angle"][0]
    turned = Experiment(
        "t", exp.time, exp.position, exp.stations, "trace", exp.pressure, angle=angle, angle_reference="rest")
    start = truth.with_(rest_angle=[0.12, 0.1, 0.1])
    names = ["rest_angle_*", Parameter("stiffness", 1.1), "damping"]
    found = fit([turned], start, names, time_step=1e-4, starts=1)
    np.testing.assert_allclose(found.model.rest_angle, truth.rest_angle, atol=1e-5)
    from_base = Experiment(
        "t", exp.time, exp.position, exp.stations, "trace", exp.pressure, angle=rows["angle"] - 0.05,
        angle_reference="base")
    found = fit([from_base], truth, ["stiffness", "rest_angle_3"], time_step=1e-3, starts=1)
    assert found.values["rest_angle_3"] < truth.rest_angle[2] - 0.01


def test_all_records_share_the_models_that_derivatives_ask_for(
    truth: Model, pulse: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Model] = []
    monkeypatch.setattr(plans, "apply", lambda model, *values: made.append(model) or apply(model, *values))
    edges = {"a.start": 0.1234, "a.stop": 0.6012, "b.start": 0.1234, "b.stop": 0.6012}
    free = [Parameter(n, v) for n, v in {**edges, "stiffness": 0.9, "damping": 6e-3}.items()]
    problem = Problem([pulse(truth, "a"), pulse(truth, "b")], truth, free, STEP, "travel")
    problem.residual(problem.start)
    problem.jacobian(problem.start)
    assert len(made) == 1 + 2 * 2  # here, and to both sides in stiffness and in damping


def test_recordings_that_begin_alike_share_what_is_not_their_own(truth: Model, pulse: Any) -> None:
    """A Jacobian of several recordings has for each the derivatives that it has alone, though most are found once."""
    tame = truth.with_(torque=[6e-7], valve=Valve(rise_time=0.03, fall_time=0.05), stations=truth.points[-1:])
    exps = [replace(pulse(tame, level=level), name=f"r{k}") for k, level in enumerate((4e4, 6e4, 8e4))]
    names = ["stiffness", "damping", "torque_1", "valve_rise_time", "base_angle", "creep_share_1", "creep_time_1"]
    model, filled = prepare(exps, tame, names)
    problem = Problem(exps, model, filled, STEP, "travel")
    J = problem.data_jacobian(problem.start)
    assert len(problem.plans.slopes) == len(names)
    values, sizes = problem.values(problem.start), {p.name: s for p, s in zip(problem.free, problem.scale, strict=True)}
    alone = [o.slopes(slopes_of(model, o.exp, values, sizes, STEP)) for o in problem.observed]
    np.testing.assert_array_equal(J, np.concatenate(alone, axis=1).T * problem.scale)
    own = [k for k, p in enumerate(problem.free) if p.name.startswith("r1.")]
    assert own
    assert not J[: problem.ends[0], own].any()
    assert J[problem.ends[0] : problem.ends[1], own].any()
