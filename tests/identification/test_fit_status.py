"""The status of a fit says what a user must know, and what cannot be fitted is refused in one sentence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import FitError, InputError, PliantError
from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.identification.fit import parameters_from
from pliant.model import Model

STEP = 1e-3


@pytest.fixture(scope="module")
def exp(truth: Model, pulse: Any) -> Experiment:
    return pulse(truth)


def run(exp: Experiment, model: Model, *parameters: Parameter | str, **options: Any) -> FitResult:
    return fit([exp], model, parameters, **{"time_step": STEP, "starts": 1, **options})


def hidden(found: FitResult) -> set[str]:
    return {p.name for p in found.parameters if p.free and p.std is None}


def test_torque_and_its_gain_cannot_be_told_apart(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, "gain", "torque_1", "stiffness", "damping", regularise=True)
    assert hidden(found) == {"gain", "torque_1"}
    assert "the data do not show the effect of: gain, torque_1" in found.status
    assert found.values["gain"] * found.values["torque_1"] == pytest.approx(6e-7, rel=1e-3)


def test_mass_stiffness_damping_and_gain_share_a_scale(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, "gain", "stiffness", "damping", "mass", regularise=True)
    assert hidden(found) == {"gain", "stiffness", "damping", "mass"}
    assert found.values["stiffness"] / found.values["mass"] == pytest.approx(0.9 / 0.047, rel=1e-3)


def test_gravity_does_not_break_the_scale_but_a_known_load_does(truth: Model, pulse: Any) -> None:
    hanging = truth.with_(gravity=[0.0, 9.81])
    assert hidden(run(pulse(hanging), hanging, "gain", "stiffness", "damping", "mass", regularise=True))
    loaded = truth.with_(tip_mass=0.02)
    assert not hidden(run(pulse(loaded), loaded, "gain", "stiffness", "damping", "mass"))


def test_dead_time_hides_behind_free_edges(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, "stiffness", "valve_dead_time", regularise=True)
    assert hidden(found) == {"valve_dead_time", "p.start", "p.stop"}


def test_a_fall_that_never_happens_is_not_shown(truth: Model, traced: Any) -> None:
    whole = traced(truth)
    keep = whole.time < 0.45  # before the pressure falls
    rising = replace(whole, time=whole.time[keep], position=whole.position[keep])
    found = run(rising, truth, "stiffness", "valve_rise_time", "valve_fall_time", regularise=True)
    assert hidden(found) == {"valve_fall_time"}
    assert found.values["valve_rise_time"] == pytest.approx(0.03, rel=1e-2)


def test_a_value_on_its_bound_is_named(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, Parameter("stiffness", 0.5, upper=0.7), "damping")
    assert found.values["stiffness"] == pytest.approx(0.7)
    assert "at a bound: stiffness" in found.status


@pytest.mark.parametrize(("name", "side", "bound", "start"), [
    ("stiffness", "upper", 0.7, 0.5), ("damping", "lower", 0.013, 0.02),
])  # fmt: skip
def test_a_value_that_ends_at_a_bound_is_on_it_and_no_success(
    exp: Experiment, truth: Model, name: str, side: str, bound: float, start: float
) -> None:
    p = Parameter(name, start, scale=0.05, prior=0.4, prior_std=90.0, **{side: bound})
    found = run(exp, truth, p, *({"stiffness", "damping"} - {name}))
    assert found.values[name] == pytest.approx(bound, rel=1e-15)
    assert not found.converged
    assert found.status.startswith(f"The fit did not reach an optimum within the bounds; at a bound: {name}")
    assert f"{name} ends at its {side} bound of {bound:g} N m" in found.status
    assert "in spite of its prior 0.4 +- 90" in found.status
    assert "hold it constant at a known one" in found.status


def test_a_term_without_effect_at_its_bound_of_zero_is_a_success(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, "stiffness", "damping", Parameter("creep_share_1", 0.2),
                Parameter("creep_time_1", 0.2, free=False))
    assert found.values["creep_share_1"] == pytest.approx(0.0, abs=1e-3)
    assert found.converged


def test_values_never_pass_their_bounds_by_rounding(exp: Experiment, truth: Model) -> None:
    from pliant.identification.problem import Problem

    edges = [Parameter("p.start", 0.12, free=False), Parameter("p.stop", 0.6, free=False)]
    for scale in np.linspace(0.04, 0.09, 200):
        p = Parameter("base_x", 0.0, lower=-0.7, upper=0.7, scale=float(scale))
        problem = Problem([exp], truth, [p, *edges], STEP, "travel")
        for x in problem.bounds:
            p.with_(value=problem.values(x)["base_x"])


def test_bounds_are_never_passed(exp: Experiment, truth: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    from pliant.identification import problem

    tried = []
    original = problem.forward_problem
    monkeypatch.setattr(problem, "forward_problem", lambda *a: (tried.append(a[2]["damping"]), original(*a))[1])

    run(exp, truth, Parameter("damping", 5e-3, lower=4e-3, upper=5.5e-3), starts=3)
    assert len(tried) > 10
    assert min(tried) >= 4e-3 * (1 - 1e-12)
    assert max(tried) <= 5.5e-3 * (1 + 1e-12)


def test_the_limit_of_evaluations_is_no_convergence(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth.with_(stiffness=2.0), Parameter("stiffness", 1.8), max_evaluations=2)
    assert not found.converged
    assert "raise max_evaluations" in found.status


def test_starts_of_zero_are_no_trap(exp: Experiment, truth: Model) -> None:
    found = run(exp, truth, "stiffness", Parameter("damping", 0.0), Parameter("torque_1", 0.0))
    assert found.values["damping"] == pytest.approx(6e-3, rel=2e-3)
    assert found.values["torque_1"] == pytest.approx(6e-7, rel=2e-3)
    found = run(exp, truth, "stiffness", "damping", "tip_mass", "base_x", "base_angle")
    assert found.values["tip_mass"] == pytest.approx(0.0, abs=1e-4)
    assert found.values["stiffness"] == pytest.approx(0.9, rel=5e-3)


def test_a_result_reads_as_text_and_as_plain_numbers(exp: Experiment, truth: Model) -> None:
    lines: list[str] = []
    sheet = Parameter("damping", 6e-3, free=False, source="data sheet")
    found = run(exp, truth, "stiffness", sheet, progress=lines.append)
    content = found.to_dict()
    assert content["parameters"]["stiffness"]["unit"] == "N m/rad"
    assert content["parameters"]["stiffness"]["upper"] is None  # infinite: no number of JSON
    assert content["parameters"]["stiffness"]["source"] == "estimated"
    assert content["parameters"]["damping"]["source"] == "data sheet"
    assert content["rmse_mm"]["p"] == pytest.approx(1e3 * found.rmse["p"])
    assert {"stiffness", "data", "given"} <= set(str(found).split())
    assert [line[:12] for line in lines] == ["start 1 of 1"]


REFUSED = {
    "unknown name": (["stiffnes"], "unknown parameter 'stiffnes'"),
    "unknown record": (["q.stiffness"], "no recording or station is called 'q'"),
    "no such joint": (["stiffness_4"], "joints 1 to 3"),
    "joint zero": (["damping_0"], "joints 1 to 3"),
    "torque of power zero": (["torque_0"], "unknown parameter"),
    "twice": (["stiffness", "stiffness"], "listed twice"),
    "edge of a trace": (["p.release"], "needs a start value"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_parameter_that_makes_no_sense_is_refused(exp: Experiment, truth: Model, case: str) -> None:
    names, sentence = REFUSED[case]
    with pytest.raises(PliantError, match=sentence):
        run(exp, truth, *names)


@pytest.mark.parametrize(("entry", "sentence"), [
    ({"value": -1.0}, "not within its bounds"), ({"value": float("nan")}, "not within its bounds"),
    ({"lower": 2.0, "upper": 1.0}, "not below upper bound"), ({"upper": 0.0}, "not below upper bound"),
    ({"free": False}, "is fixed and needs a value"),
])
def test_a_parameter_must_be_possible(entry: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Parameter("stiffness", **entry)


def test_nothing_free_is_refused(exp: Experiment, truth: Model) -> None:
    fixed = [Parameter(n, v, free=False) for n, v in (("stiffness", 1.0), ("p.start", 0.1), ("p.stop", 0.6))]
    with pytest.raises(FitError, match="nothing to fit"):
        run(exp, truth, *fixed)


def test_a_start_that_cannot_be_simulated_is_refused(exp: Experiment, truth: Model) -> None:
    with pytest.raises(FitError, match=r"with any of the fit's start values: .*turns by more than a radian"):
        run(exp, truth, Parameter("torque_1", 1e-2), starts=2)


def test_a_body_that_its_load_buckles_is_refused(exp: Experiment, truth: Model) -> None:
    with pytest.raises(PliantError, match="buckles"):
        run(exp, truth.with_(gravity=[0.0, -500.0], stiffness=0.01), Parameter("damping", 1e-3))


def test_a_step_that_cannot_draw_the_motion_is_refused(exp: Experiment, truth: Model) -> None:
    with pytest.raises(InputError, match="too long: the first mode rings at"):
        run(exp, truth, "stiffness", time_step=0.05)


@pytest.mark.parametrize("options", [{"loss": "l7"}, {"weighting": "equal"}])
def test_an_unknown_choice_is_refused(exp: Experiment, truth: Model, options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"unknown .*: use one of"):
        run(exp, truth, "stiffness", **options)


def test_experiments_need_names_of_their_own(exp: Experiment, truth: Model) -> None:
    for experiments in ([], [exp, exp]):
        with pytest.raises(InputError, match="each needs a name of its own"):
            fit(experiments, truth, ["stiffness"])
    with pytest.raises(InputError, match="names a recording and a station"):
        run(replace(exp, name="tip"), truth, "stiffness")


def test_parameters_come_from_numbers_words_and_tables() -> None:
    made = parameters_from({"stiffness": "free", "damping": 1e-3, "gain": {"value": 1.0, "free": False}})
    assert [(p.name, p.value, p.free) for p in made] == [
        ("stiffness", None, True), ("damping", 1e-3, True), ("gain", 1.0, False),
    ]


def test_values_put_in_twice_change_nothing(truth: Model) -> None:
    from pliant.identification.parameters import apply

    values = {"stiffness": 1.3, "damping_2": 1e-3, "gain": 1.7, "torque_2": 1e-12, "mass": 0.05, "tip_mass": 0.01,
              "valve_rise_time": 0.01, "base_angle": 0.1, "tip.along": 0.02}
    once = apply(truth, values)
    twice = apply(once, values)
    for name in ("stiffness", "damping", "torque", "joint_gain", "link_mass"):
        np.testing.assert_allclose(getattr(twice, name), getattr(once, name), rtol=1e-15)
    assert once.torque_at(1e5) * once.joint_gain[0] == pytest.approx(1.7 * (6e-7 * 1e5 + 1e-12 * 1e10))
    assert twice.stations == once.stations
    assert once.mass == pytest.approx(0.06)


def test_an_optimum_far_from_its_recording_is_no_success(exp: Experiment, truth: Model) -> None:
    """The optimiser ends at its optimum; the body bends the other way."""
    mirrored = replace(exp, position=exp.position * [-1.0, 1.0])
    found = run(mirrored, truth, "damping")
    assert not found.converged
    assert found.status.startswith("The fit failed: the model does not follow its training recordings (error p ")
    assert "signs and units" in found.status
    good = run(exp, truth, "damping")
    assert good.converged
    assert "failed" not in good.status


def test_an_optimum_far_above_the_noise_is_doubted_until_a_second_start_confirms_it(
    exp: Experiment, truth: Model
) -> None:
    noise = 1e-4 * np.random.default_rng(0).standard_normal(exp.position.shape)
    noisy = replace(exp, position=exp.position + noise)
    wrong = [Parameter("stiffness", 2.0, free=False), Parameter("torque_1", 5.5e-7), Parameter("damping", 5e-3)]
    alone = run(noisy, truth, *wrong)
    assert "times the noise of the recordings and only one start was tried" in alone.status
    assert "times the noise" not in run(noisy, truth, *wrong, starts=3).status
    right = [Parameter("stiffness", 0.8), Parameter("damping", 5e-3)]
    assert "times the noise" not in run(noisy, truth, *right).status
