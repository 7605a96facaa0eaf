"""What the simulations of a fit share, and what is computed again only where it changes."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter, poses
from pliant.identification.parameters import apply
from pliant.identification.plans import Plans
from pliant.identification.problem import Problem
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model, Station, chain_model
from pliant.simulation import Trace


def arm() -> Model:
    chambers = tuple(Chamber(torque=[1e-6], joint_gain=np.ones(2), cross_gain=cross, name=name)
                     for name, cross in (("left", 0.2), ("right", -0.3)))  # fmt: skip
    body = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.4, damping=4e-3, space=True, torque=[1e-6],
                       gravity=(0.0, 0.0, 9.81), stations=(Station("tip", 1, 0.05),))  # fmt: skip
    return body.with_(chambers=chambers)


def settled(model: Model) -> Experiment:
    rows = np.arange(4.0)
    drives = {name: Trace(rows, 1e4 * rows * factor) for name, factor in (("left", 1.0), ("right", 0.5))}
    bent = 0.1 * rows[:, None] * np.ones(model.size)
    place = mechanics_of(model).stations(bent)[0]
    return Experiment("rest", rows, place, ("tip",), "trace", drives=drives, poses=True)


@pytest.mark.parametrize(("change", "kept"), [({"tip.along": 0.03}, True), ({"stiffness": 0.5}, False),
                                              ({"left.gain_x": 1.1}, False)])  # fmt: skip
def test_a_model_whose_markers_alone_move_keeps_its_body(change, kept):
    values = {"stiffness": 0.4, "left.gain_x": 1.0, "tip.along": 0.05}
    plans = Plans()
    before, after = plans.at(arm(), values), plans.at(arm(), {**values, **change})
    assert (after.body is before.body) == kept
    fresh = apply(arm(), {**values, **change})
    assert after.model == fresh
    assert after.points == {p.name: p for p in fresh.points}
    assert np.array_equal(after.places(("tip",))[:, 0], fresh.points[0][2:])
    for entry, expected in zip((*after.body, *after.joints), (*mechanics_of(fresh).body, *mechanics_of(fresh).joints),
                               strict=True):  # fmt: skip
        assert np.array_equal(entry, expected)


def test_a_place_of_one_recording_is_not_that_of_another():
    plans = Plans()
    plans.at(arm(), {"stiffness": 0.4, "tip.along": 0.03})
    other = plans.at(arm(), {"stiffness": 0.4})
    assert other.points["tip"].along == pytest.approx(0.05)
    assert plans.at(arm(), {"stiffness": 0.4, "tip.along": 0.02}).points["tip"].along == pytest.approx(0.02)


def test_models_with_the_same_inputs_share_their_levers():
    plans = Plans()
    values = {"stiffness": 0.4, "left.gain_x": 1.0}
    one, other, third = (plans.at(arm(), {**values, **change}).model.actuation
                         for change in ({}, {"stiffness": 0.5}, {"left.gain_x": 1.2}))  # fmt: skip
    assert one is other
    assert third is not one
    assert not np.array_equal(third.gain, one.gain)


def test_settled_poses_are_solved_once_for_residual_and_derivatives(monkeypatch):
    solved: list[int] = []

    def counted(forward):
        solved.append(1)
        return computed(forward)

    computed = poses.computed_poses
    monkeypatch.setattr(poses, "computed_poses", counted)
    listed = [Parameter("stiffness", 0.5), Parameter("left.gain_x", 1.2), Parameter("tip.along", 0.04)]
    problem = Problem([settled(arm())], arm(), listed, 0.01, "travel")
    x = problem.start
    first = problem.data_residual(x), problem.data_jacobian(x)
    assert len(solved) == 1
    problem.data_residual(1.1 * x)
    assert len(solved) == 2
    for _ in range(60):  # more models than are kept
        problem.data_jacobian(1.1 * x)
        problem.latest = (b"", np.zeros(0))
        problem.data_residual(1.1 * x)
    assert len(solved) == 2
    again = Problem([settled(arm())], arm(), listed, 0.01, "travel")
    assert np.array_equal(first[1], again.data_jacobian(x))
    assert np.array_equal(first[0], again.data_residual(x))
