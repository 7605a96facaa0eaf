"""Bodies in space that follow their inputs at once: the first model from settled shapes, and the step of its motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pliant.identification import Experiment
from pliant.model import Chamber, Model, Station, chain_model
from pliant.selection import select_model, start, terms_for
from pliant.selection.fitted import FitSetting, fitted, tried_step, with_checked_step
from pliant.selection.start import EXPLAINED, SETTLED, explained_at_once, fit_begun_at
from pliant.simulation import Trace, simulate

TIMES = np.arange(0.0, 12.0, 0.05)
NOISE = 2e-5  # m


def ramps(rng: np.random.Generator) -> Trace:
    """Lines between random levels, one each 1.5 s."""
    edges = np.arange(0.0, 13.0, 1.5)
    return Trace(edges, rng.uniform(1e4, 6e4, edges.size))


def arm(**changes) -> Model:
    chambers = [Chamber(torque=[1e-6], joint_gain=np.ones(2), name="left"),
                Chamber(torque=[1e-6], joint_gain=np.zeros(2), cross_gain=0.5 * np.ones(2), name="right")]
    return chain_model(length=0.2, mass=0.05, links=2, stiffness=0.4, damping=4e-3, space=True, torque=[1e-6],
                       gravity=(0.0, 0.0, 9.81), stations=(Station("tip", 1, 0.05),)).with_(
        chambers=tuple(chambers)).with_(**changes)  # fmt: skip


def recorded(rng: np.random.Generator, model: Model | None = None) -> Experiment:
    drives = {"left": ramps(rng), "right": ramps(rng)}
    path = simulate(model or arm(), [*drives.values()], times=TIMES, time_step=1e-3)["station_position"].values
    return Experiment("one", TIMES, path + NOISE * rng.normal(size=path.shape), ("tip",), "trace", drives=drives)


def tilted(exp: Experiment, tilt: float) -> Experiment:
    """The positions turned about the x axis."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]])
    return replace(exp, position=exp.position @ turn.T)


def lagging(constant: float, rng: np.random.Generator) -> Experiment:
    """A point whose first-order lag behind its input another library integrates."""
    trace = ramps(rng)
    state = solve_ivp(lambda t, y: (trace(np.array([t])) - y) / constant, (0.0, TIMES[-1]), trace(TIMES[:1]),
                      t_eval=TIMES, max_step=0.02)  # fmt: skip
    path = 1e-6 * state.y[0][:, None, None] * np.array([1.0, 0.3, 0.1])
    drives = {"left": trace, "right": Trace(trace.time, 0.0 * trace.time)}
    return Experiment("one", TIMES, path, ("tip",), "trace", drives=drives)


@pytest.mark.parametrize(("constant", "low", "high"), [(0.01, SETTLED, 1.0), (0.7, EXPLAINED, SETTLED),
                                                       (3.0, 0.0, EXPLAINED)])  # fmt: skip
def test_the_inputs_of_each_frame_explain_less_of_a_point_farther_behind_them(rng, constant, low, high):
    assert low < explained_at_once([lagging(constant, rng)], arm()) < high


def test_settled_shapes_lead_to_the_model_of_a_body_that_rings_faster_than_its_inputs_change(rng):
    given = arm(stiffness=1.0, damping=1e-3)
    given = given.with_(chambers=tuple(Chamber(torque=[1e-6], joint_gain=np.ones(2), name=c.name)
                                       for c in given.chambers))  # fmt: skip
    lines: list[str] = []
    found = select_model([recorded(rng)], given, terms=[], progress=lines.append)
    assert "settled shapes come first" in lines[0]
    values = found.result.values
    assert values["left.gain_x"] / values["stiffness"] == pytest.approx(1.0 / 0.4, rel=0.01)
    assert values["right.gain_y"] / values["stiffness"] == pytest.approx(0.5 / 0.4, rel=0.01)
    assert abs(values["left.gain_y"]) < 0.01 * values["left.gain_x"]
    assert found.result.time_step > 2e-3  # frames are 50 ms apart, and the fit has compared steps


def test_settled_shapes_hold_nothing_that_only_a_motion_shows(rng):
    """Frames stamped 50 ms late, and no gravity that would show the stiffness of a body at rest."""
    exp = recorded(rng, arm(gravity=(0.0, 0.0, 0.0)))
    late = replace(exp, time=exp.time + 0.05)
    found = select_model([late], arm(gravity=(0.0, 0.0, 0.0)), terms=[], common=["latency"]).result
    assert all(p.free for p in found.parameters)
    assert found.values["latency"] == pytest.approx(0.05, abs=1e-4)
    assert found.values["stiffness"] == pytest.approx(0.4, rel=0.05)


@pytest.mark.slow
def test_settled_shapes_choose_the_terms_that_they_show(rng):
    """Recorded positions are turned about the base by 0.03 rad: the shapes show it before the motion is fitted."""
    model, tilt = arm(gravity=(0.0, 0.0, 0.0)), 0.03
    exp = recorded(rng, model)
    train = [tilted(exp, tilt)]
    lines: list[str] = []
    result = select_model(train, model, terms=terms_for(model, train, only=["base", "creep"]), progress=lines.append)
    assert any(line.startswith("settled shapes, error of the base tangent") for line in lines)
    assert result.terms == ("base",)
    assert abs(result.result.values["base_tilt_x"]) == pytest.approx(tilt, rel=0.02)
    assert abs(result.result.values["base_tilt_y"]) < 0.02 * tilt


@pytest.mark.parametrize(("moment", "terms"), [("settled shapes, stiffness", ()),
                                               ("settled shapes, error of the base", ("base",))])  # fmt: skip
def test_an_interrupt_while_settled_shapes_choose_leaves_the_model_so_far(rng, moment, terms):
    lines: list[str] = []

    def interrupt(line: str) -> None:
        lines.append(line)
        if line.startswith(moment):
            raise KeyboardInterrupt

    train, model = [tilted(recorded(rng, arm(gravity=(0.0, 0.0, 0.0))), 0.03)], arm(gravity=(0.0, 0.0, 0.0))
    found = select_model(train, model, terms=terms_for(model, train, only=["base", "rest"]), progress=interrupt)
    assert found.terms == terms
    assert "interrupted" in found.reason
    assert sum("interrupted" in line for line in lines) == 1
    assert not found.complete
    assert found.result.values["damping"] == pytest.approx(4e-3, rel=0.3)
    assert found.result.values["left.gain_x"] / found.result.values["stiffness"] == pytest.approx(2.5, rel=0.15)


def test_an_interrupt_of_the_first_fit_of_the_motion_leaves_the_settled_shapes(rng, monkeypatch):
    started: list[int] = []

    def interrupt(*args, **options):
        started.append(1)
        if len(started) == 1:
            raise KeyboardInterrupt
        return fit_begun_at(*args, **options)

    monkeypatch.setattr(start, "fit_begun_at", interrupt)
    found = select_model([recorded(rng)], arm(), terms=[])
    assert "interrupted" in found.reason
    assert found.result.values["damping"] == pytest.approx(4e-3, rel=0.1)


def test_a_term_of_the_caller_is_kept_as_given_among_settled_shapes(rng):
    """A tilt about x alone, under the name of the usual term, which tilts about y too."""
    train, model = [tilted(recorded(rng, arm(gravity=(0.0, 0.0, 0.0))), 0.03)], arm(gravity=(0.0, 0.0, 0.0))
    (usual,) = terms_for(model, train, only=["base"])
    given = usual._replace(adds=usual.adds[:1], null={usual.adds[0].name: 0.0}, title="tilt about x")
    found = select_model(train, model, terms=[given])
    assert found.terms == ("base",)
    assert "tilt about x" in found.reason
    assert {p.name for p in found.result.parameters} & {"base_tilt_x", "base_tilt_y"} == {"base_tilt_x"}


def test_a_step_that_is_too_long_for_the_motion_is_shortened_unless_it_is_stated(rng):
    """A body of 9 Hz that is hit: steps of 50 ms miss its ringing, and 1 ms is that of the recording."""
    model = arm(damping=4e-4)
    train = recorded(rng, model)
    train = replace(train, drives={n: Trace(TIMES[:20], np.where(TIMES[:20] < 0.4, 0.0, 5e4)) for n in train.drives})
    path = simulate(model, [*train.drives.values()], times=TIMES, time_step=1e-3)["station_position"].values
    setting = FitSetting((replace(train, position=path),), 0.05)
    coarse = fitted(setting, model, ["stiffness"], evaluations=0)
    assert tried_step(coarse, 1e-3) < 0.02
    checked = with_checked_step(coarse, setting)
    assert checked.time_step < 0.02
    assert np.abs(checked.data_residual(coarse.x)).max() < 0.1 * np.abs(coarse.residual).max()
    assert with_checked_step(coarse, replace(setting, stated_step=True)).time_step == 0.05


def test_settled_poses_alone_have_no_step_to_choose(rng):
    model = arm()
    drives = {n: Trace(np.arange(6.0), rng.uniform(0.0, 5e4, 6)) for n in ("left", "right")}
    moments = np.array([0.0, 1e-3])
    shapes = [simulate(model, [Trace([0.0], d(np.array([k]))) for d in drives.values()], times=moments)
              for k in np.arange(6.0)]  # fmt: skip
    path = np.stack([shape["station_position"].values[0] for shape in shapes])
    poses = Experiment("poses", np.arange(6.0), path, ("tip",), "trace", drives=drives, poses=True)
    found = select_model([poses], model, terms=[], common=["left.gain_x"])
    assert found.result.rmse["poses"] < 1e-4
