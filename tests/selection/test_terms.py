"""Every term at its null values leaves the motion as it is, in a plane and in space; names, groups and restrictions."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter
from pliant.model import Chamber, Extension, Model, Station, chain_model
from pliant.model.space import Space
from pliant.selection import TERMS, Term, terms_for
from pliant.selection.fitted import FitSetting
from pliant.simulation import Trace, simulate

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIMES = np.arange(0.0, 0.6, 0.02)
NO_EFFECT = 1e-5  # of the residuals' size: a share of 1e-6 is not quite nothing
STRETCHED = 0.02  # the same for a segment with a stiffness of 1 kN, which the body's own motion stretches


def body(*, space: bool) -> Model:
    one = chain_model(length=0.12, mass=0.03, links=3, stiffness=0.5, damping=3e-3, torque=[6e-7],
                      stations=(Station("tip", 2, 0.04),))  # fmt: skip
    if not space:
        return one
    gains = {"left": (0.9, 0.3), "right": (-0.5, 0.8)}
    chambers = tuple(Chamber([6e-7], np.full(3, x), cross_gain=np.full(3, y), name=n) for n, (x, y) in gains.items())
    return one.with_(space=Space(), gravity=[0.0, 0.0, 9.81], chambers=chambers)


def seen(model: Model) -> Experiment:
    trace = Trace([0.05, 0.08, 0.3, 0.33], [0.0, 6e4, 6e4, 1e4])
    if model.space is None:
        path = simulate(model, trace, times=TIMES)["station_position"].values
        return Experiment("seen", TIMES, path, ("tip",), "trace", trace)
    other = Trace(trace.time, 0.5 * trace.pressure[::-1])
    path = simulate(model, [trace, other], times=TIMES)["station_position"].values
    return Experiment("seen", TIMES, path, ("tip",), "trace", drives={"left": trace, "right": other})


@pytest.fixture(scope="module", params=[False, True], ids=["plane", "space"])
def case(request):
    model = body(space=request.param)
    return model.with_(stiffness=0.6), seen(model)


def parent_of(model: Model) -> list[Parameter]:
    law = ["torque_1"] if model.space is None else ["left.gain_x", "left.gain_y", "right.gain_x", "right.gain_y"]
    values = {"stiffness": 0.6, "damping": 3e-3, "torque_1": 6e-7, "left.gain_x": 0.9, "left.gain_y": 0.3,
              "right.gain_x": -0.5, "right.gain_y": 0.8}  # fmt: skip
    return [Parameter(n, values[n]) for n in ("stiffness", "damping", *law)]


def residual(setting: FitSetting, model: Model, parameters: list[Parameter]) -> np.ndarray:
    problem = setting.problem(model, parameters)
    return problem.data_residual(problem.start)


def test_no_term_has_an_effect_at_its_null_values(case):
    model, exp = case
    setting, parent = FitSetting((exp,), 2e-3), parent_of(model)
    before = residual(setting, model, parent)
    values = {p.name: p.value for p in parent}
    every = terms_for(model, [exp])
    assert len(every) > 10
    for term in every:
        others = [p for p in parent if p.name not in {q.name for q in term.adds}]
        before_it = next((t for t in every if t.name == term.needs), term)
        needed = [] if before_it is term else before_it.at_null(before_it.grid[0], values)
        for row in term.grid if term.null else ():
            at_null = [*others, *needed, *term.at_null(row, values)]
            after = residual(setting, term.model(before_it.model(model)), at_null)
            bound = STRETCHED if term.segments or before_it.segments else NO_EFFECT
            assert np.abs(after - before).max() < bound * np.abs(before).max(), (term.name, row)


def test_every_term_has_an_effect_beyond(case):
    """Away from its null values each term moves the body, so that a null value of no meaning is noticed."""
    model, exp = case
    setting, parent = FitSetting((exp,), 2e-3), parent_of(model)
    values = {p.name: p.value for p in parent}
    for term in (t for t in terms_for(model, [exp]) if t.null and not t.needs):
        row = term.grid[0]
        at_null = term.at_null(row, values)
        away = [p.with_(value=p.value + (0.2 * p.value or p.scale or 1e-13)) if p.free else p for p in at_null]
        if term.name.endswith(("torque_2", "torque_3")):
            away = [p.with_(value=1e-12 if term.name.endswith("2") else 1e-17) for p in at_null]
        if term.segments:
            away = [p.with_(value=20.0) if p.free else p for p in at_null]
        if term.name == "clock":
            away = [p.with_(value=0.02) for p in at_null]
        others = [p for p in parent if p.name not in {q.name for q in term.adds}]
        moved = residual(setting, term.model(model), [*others, *away])
        still = residual(setting, term.model(model), [*others, *at_null])
        assert np.abs(moved - still).max() > 1e-9, term.name


def test_names_are_those_of_the_table_and_chambers_have_their_own(case):
    model, exp = case
    every = terms_for(model, [exp])
    names = [t.name for t in every]
    assert len(set(names)) == len(names)
    assert {n.rpartition(".")[2] for n in names} <= set(TERMS)
    chambers = {n.partition(".")[0] for n in names if "." in n}
    assert chambers == ({"left", "right"} if model.space is not None else set())
    for term in every:
        assert set(term.null) <= {p.name for p in term.adds}
        assert term.null or all(set(row) == {p.name for p in term.adds} for row in term.grid)
        assert isinstance(term, Term)


def test_only_and_without(case):
    model, exp = case
    assert [t.name for t in terms_for(model, [exp], only=["creep", "slip"])] == ["creep", "slip"]
    rest = [t.name for t in terms_for(model, [exp], without=["torque_2"])]
    assert not any(n.endswith("torque_2") for n in rest)
    if model.space is not None:
        assert [t.name for t in terms_for(model, [exp], only=["left.torque_2"])] == ["left.torque_2"]
    with pytest.raises(InputError, match="moon"):
        terms_for(model, [exp], only=["moon"])


def test_a_release_asks_for_no_term_of_an_input():
    model = body(space=False)
    rest = Trace([0.0, 1.0], [0.0, 0.0])
    swing = simulate(model, rest, times=TIMES, initial_angle=np.full(3, 0.1))["station_position"].values
    names = {t.name for t in terms_for(model, [Experiment("free", TIMES, swing, ("tip",), "release")])}
    assert "creep" in names
    assert not names & {"lag", "settle", "clock", "torque_2"}


def test_creep_of_bend_and_length_stands_for_both():
    model = body(space=False).with_(extensions=(Extension(900.0, 2.0),))
    terms = {t.name: t for t in terms_for(model, [seen(model)], only=["creep", "axial_creep", "wall_creep"])}
    both = terms["wall_creep"]
    assert both.includes == ("creep", "axial_creep")
    assert {p.name for p in both.adds} == {p.name for n in both.includes for p in terms[n].adds}
    assert all(len(set(row.values())) == 1 for row in both.grid)  # one time for both
