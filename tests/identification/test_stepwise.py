"""Model selection: each stage earns its place on held-out records, or says why it cannot stand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import MORE_STAGES, STAGES, Experiment, Parameter, Stage, select_model
from pliant.identification.model_selection import Follows
from pliant.identification.parameters import check_names, kind_of
from pliant.identification.stage_fit import StageResult, entry_name
from pliant.identification.stages import of_chambers
from pliant.identification.stepwise import fit_stages
from pliant.model import Chamber, Memory, Model, Space, Valve, chain_model

STEP = 2e-3


@pytest.mark.slow
def test_the_stage_of_the_truth_is_picked(truth: Model, traced: Any) -> None:
    real = truth.with_(torque=[3e-7, 3e-12])
    train = [traced(real, "low", 6e4), traced(real, "high", 1.4e5)]
    held = [traced(real, "held", 1e5)]
    guess = truth.with_(stiffness=1.3, damping=2e-3, torque=[5e-7], valve=Valve())
    found = select_model(train, held, guess, time_step=STEP, stages=STAGES[:6])
    errors = [s.error for s in found.stages]
    assert [s.stage.name for s in found.stages] == [r.name for r in STAGES[:6]]
    assert found.chosen == "lag"
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[3] < 0.5
    assert "one stage lower" in found.reason
    assert found.result.values["torque_2"] == pytest.approx(3e-12, rel=0.02)
    content = found.to_dict()["stages"]
    assert content["lag"]["bic"] < content["torque"]["bic"]
    assert {"stiffness", "damping", "torque_1", "torque_2"} <= set(content["torque"]["free"])
    assert [stage["stands_on"] for stage in content.values()] == ["", "given", "elastic", "torque", "lag", "lag"]
    assert 0 < content["torque"]["step_ns"] < 1e6


def test_one_level_frees_a_linear_law_and_pulses_keep_their_edges(truth: Model, pulse: Any) -> None:
    found = select_model([pulse(truth)], [], truth.with_(stiffness=1.2), time_step=STEP, stages=STAGES[:3])
    assert found.stages[0].freed == ("p.start", "p.stop")
    assert "no recording is held out" in found.reason


def test_a_stage_that_the_records_cannot_tell_says_so(truth: Model, traced: Any) -> None:
    stages = (STAGES[1], Stage("all", "+ everything", (("gain", "torque_1", "mass"),)))
    found = select_model([traced(truth)], [], truth, time_step=STEP, stages=stages)
    assert found.stages[1].result is None
    assert "share one scale" in found.stages[1].reason or "one product" in found.stages[1].reason
    assert found.chosen == "elastic"


@pytest.mark.slow
def test_a_lag_far_from_the_first_guess_is_found(truth: Model, traced: Any) -> None:
    """Without a lag the damping takes it up; a fit from there stays there, so the selection begins afresh as well."""
    slow = truth.with_(valve=Valve(rise_time=0.6, fall_time=0.6))
    stages = (STAGES[1], STAGES[3])
    found = select_model(
        [traced(slow)], [], truth.with_(valve=Valve()), common=["torque_1"], time_step=STEP, stages=stages
    )
    assert found.result.values["valve_rise_time"] == pytest.approx(0.6, rel=0.02)
    assert found.result.values["valve_fall_time"] == pytest.approx(0.6, rel=0.02)


@pytest.mark.slow
def test_a_wall_takes_the_place_of_a_curved_law_and_predicts_beyond_it(truth: Model, traced: Any) -> None:
    """Taught by 20 and 50 kPa; at 80 kPa the quadratic law that the wall replaces has run out of curvature."""
    tube = truth.with_(valve=Valve(), torque=[5e-7], inflation_limit=1.6e5, inflation_time=0.05)
    wall = next(r for r in MORE_STAGES if r.name == "wall")
    train, held = [traced(tube, "a", 2e4), traced(tube, "b", 5e4)], [traced(tube, "beyond", 8e4)]
    two = (STAGES[2], wall._replace(scan=()))
    found = select_model(train, held, truth.with_(valve=Valve()), time_step=STEP, stages=two)
    torque, chosen = found.stages
    assert found.chosen == "wall"
    assert "torque_2" in torque.freed
    assert "torque_2" not in chosen.freed
    assert found.result.values["inflation_limit"] == pytest.approx(1.6e5, rel=0.03)
    assert chosen.error < 0.3 * torque.error


@pytest.mark.slow
def test_creep_is_found(truth: Model, traced: Any) -> None:
    soft = truth.with_(valve=Valve(), memory=Memory(creep_share=(0.4,), creep_time=(0.15,)))
    stages = (STAGES[1], STAGES[6])
    train, held = [traced(soft, "a", 6e4)], [traced(soft, "b", 1e5)]
    found = select_model(train, held, truth.with_(valve=Valve()), time_step=STEP, stages=stages)
    assert found.chosen == "creep"
    assert found.result.values["creep_share_1"] == pytest.approx(0.4, rel=0.05)
    assert found.result.values["creep_time_1"] == pytest.approx(0.15, rel=0.05)
    assert found.chosen_stage.error < 0.1
    assert found.to_dict()["stages"]["creep"]["step_ns"] > 0


def test_where_nothing_rings_stiffness_stays_simulable(truth: Model, traced: Any) -> None:
    """A body that follows a slow pressure shows K, D and torque as one product: a fit alone drives them up for ever."""
    over = truth.with_(damping=0.5, valve=Valve(rise_time=0.1, fall_time=0.1))
    start = truth.with_(valve=Valve())
    found = select_model([traced(over)], [], start, common=["torque_1"], time_step=STEP, stages=STAGES[1:2])
    assert found.result.model.stiffness.max() < 1e3


def test_what_the_recordings_leave_open_stays_as_given(truth: Model, traced: Any) -> None:
    """Nothing rings, and only K, D and torque as parts of each other show: K as given, the rest is determined."""
    rng = np.random.default_rng(0)
    over = truth.with_(damping=0.5, valve=Valve(rise_time=0.1, fall_time=0.1))

    def noisy(name: str, level: float) -> Experiment:
        exp = traced(over, name, level)
        return replace(exp, position=exp.position + 5e-4 * rng.standard_normal(exp.position.shape))

    train, held = [noisy("a", 6e4), noisy("c", 1.2e5)], [noisy("b", 9e4)]
    guess = over.with_(stiffness=1.8, damping=0.1, torque=[1e-7])
    found = select_model(train, held, guess, time_step=STEP, stages=(STAGES[0], STAGES[2]))
    assert found.chosen == "torque"
    assert found.chosen_stage.given == ("stiffness",)
    assert "stiffness" not in found.chosen_stage.freed
    assert not found.chosen_stage.open
    assert found.result.model.stiffness.tolist() == [1.8] * 3
    for name, scale in (("damping", 0.5), ("torque_1", 6e-7)):
        assert found.result.values[name] == pytest.approx(2.0 * scale, rel=0.05)
    assert found.reason.endswith("The recordings do not determine stiffness: held at the given model's values.")
    assert found.to_dict()["stages"]["torque"]["as_given"] == ["stiffness"]


def test_stages_need_names(truth: Model, traced: Any) -> None:
    with pytest.raises(InputError, match="names differ"):
        select_model([traced(truth)], [], truth, stages=(STAGES[0], STAGES[0]))


class Told:
    """A fitter whose fits are as good as `follows` says of what is free; no record is simulated."""

    def __init__(self, follows: dict[frozenset[str], float]) -> None:
        self.follows = follows

    def fit_stage(self, stage: Stage, below: StageResult, free: dict[str, Any]) -> tuple[StageResult, dict[str, Any]]:
        taken = {n: e for n, e in free.items() if n not in stage.drops} | {str(n): n for n in stage.frees[0]}
        square = self.follows[frozenset(taken)]
        fitted = StageResult(stage, result=object(), stands_on=below.stage.name)  # type: ignore[arg-type]
        return replace(fitted, follows=Follows(square, 1000.0, len(taken))), taken


def test_a_finer_stage_that_pays_only_on_a_later_one_is_tried_again_once() -> None:
    """Each joint's stiffness pays where creep is free; a lag that paid nowhere, and one that joints replace, do not."""
    k, d, j, c, v = "stiffness", "damping", "stiffness_*", "creep_time_1", "valve_rise_time"
    stages = [Stage("elastic", "", ((k, d),)), Stage("lag", "", ((v,),)), Stage("joints", "", ((j,),), drops=(k,)),
             Stage("creep", "", ((c,),)), Stage("coarse", "", ((k,),), drops=(v,))]  # fmt: skip
    squares = {(k, d): 1.0, (k, d, v): 1.0, (j, d): 1.0, (k, d, c): 0.5, (j, d, c): 0.3}
    fitter: Any = Told({frozenset(n): s for n, s in squares.items()})
    said: list[str] = []
    found = fit_stages(fitter, stages, {}, late=True, progress=said.append)
    assert [(s.stage.name, s.stands_on) for s in found] == [
        ("elastic", ""), ("lag", "elastic"), ("joints", "elastic"), ("creep", "elastic"), ("coarse", "creep"),
        ("joints_late", "creep"),
    ]  # fmt: skip
    assert len(said) == len(found)
    assert len(fit_stages(fitter, stages, {}, late=False, progress=said.append)) == len(stages)


def test_stages_in_space_name_parameters_that_an_arm_in_space_has() -> None:
    chambers = [Chamber(torque=[2e-6], joint_gain=1.0, name=name) for name in ("red", "green")]
    model = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, chambers=chambers,
                        gravity=(0.0, 0.0, 9.81), space=Space(twist_ratio=0.8, radius=0.02))  # fmt: skip
    named = {s.name: of_chambers(s, model) for s in MORE_STAGES}
    assert named["azimuths"].frees == (("red.gain_x", "green.gain_x", "red.gain_y", "green.gain_y"),)
    assert named["azimuths"].drops == ("red.torque_1", "green.torque_1")
    frees = (entry for n in ("azimuths", "directions", "twist") for entry in named[n].frees[0])
    listed = [Parameter(entry) for entry in frees if isinstance(entry, str)]
    check_names(listed, model, {"r"}, {"tip"})
    with pytest.raises(InputError, match="needs a chain in space"):
        check_names([Parameter("stiffness_ratio")], chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5,
                    damping=5e-3, torque=[1e-6], gravity=(0.0, 9.81)), {"r"}, {"tip"})  # fmt: skip


def test_every_stage_names_parameters_that_exist() -> None:
    chambers = [Chamber(torque=[2e-6], joint_gain=1.0, name=name) for name in ("red", "green")]
    model = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, chambers=chambers)
    for stage in (of_chambers(s, model) for s in (*STAGES, *MORE_STAGES)):
        frees = [entry_name(entry) for choice in stage.frees for entry in choice]
        for name in (*frees, *stage.drops, *(name for name, _ in stage.scan)):
            kind_of(name)
