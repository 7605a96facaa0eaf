"""Terms of a body that tendons pull, on settled poses: friction along the tendons and at their entries, and guides."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter
from pliant.identification.fit import fit
from pliant.identification.prediction import predict
from pliant.model import Space, Station, Tendon, chain_model
from pliant.selection import Term, terms_for
from pliant.selection.fitted import FitSetting
from pliant.simulation import Trace

pytestmark = pytest.mark.slow  # kernels of their own are compiled first
FRICTION = ("tendon_friction", "entry_friction")
LENGTHS = 1e-3 * np.array([1.0, 3.0, 5.0, 4.0, 2.5, 1.0, 2.0, 4.5, 4.4, 3.0])  # m, drawn in and let out


def case(**cord):
    """One joint under a displacement-driven tendon, and its poses."""
    pull = Tendon.at_azimuth(0.4, [1], driven_by="displacement", name="pull", lever=5e-3, line_stiffness=800.0, **cord)
    model = chain_model(length=0.1, mass=0.01, links=1, joint_placement="midsegment", stiffness=0.02, damping=1e-3,
                        chambers=[pull], space=Space(), gravity=(0.0, 0.0, 0.0))  # fmt: skip
    model = model.with_(stations=[Station("tip", 0, 0.05)])
    time = np.arange(float(LENGTHS.size))
    blank = Experiment("poses", time, 0.01 * np.arange(3.0 * time.size).reshape(-1, 1, 3), ("tip",), "trace",
                       drives={"pull": Trace(time, LENGTHS)}, poses=True)  # fmt: skip
    path = predict(model, blank, {}, 1e-3)["position"]
    return model, Experiment("poses", time, path, ("tip",), "trace", drives=blank.drives, poses=True)


def offered(model, exp) -> dict[str, Term]:
    return {t.name: t for t in terms_for(model, [exp])}


def test_both_frictions_are_terms_without_effect_at_their_null_values():
    model, exp = case()
    setting, parent = FitSetting((exp,), 1e-3), [Parameter("stiffness", 0.02)]

    def residual(parameters):
        problem = setting.problem(model, [*parent, *parameters])
        return problem.data_residual(problem.start)

    terms, still = offered(model, exp), residual([])
    for name in FRICTION:
        held = terms[name].at_null({}, {"stiffness": 0.02})
        assert np.abs(residual(held) - still).max() < 1e-5, name
        assert np.abs(residual([p.with_(value=0.2) for p in held]) - still).max() > 1e-2, name


@pytest.mark.parametrize(("name", "value"), [("friction", 0.4), ("entry_friction", 0.15), ("spacing", 0.03)])
def test_poses_determine_what_made_them(name, value):
    _, exp = case(**{name: value})
    model, _ = case()
    parameters = [Parameter("stiffness", 0.025), Parameter(name, 0.05)]
    found = fit([exp], model, parameters, time_step=1e-3, starts=1, weighting="metre")
    assert found.values["stiffness"] == pytest.approx(0.02, rel=1e-3)
    assert found.values[name] == pytest.approx(value, rel=1e-3)


def test_an_imbalance_that_the_model_states_is_where_its_term_has_no_effect():
    model, exp = case(pair=True, imbalance=2.0)
    assert dict(offered(model, exp)["imbalance"].null) == {"pull.imbalance": 2.0}
    setting, stiffness = FitSetting((exp,), 1e-3), Parameter("stiffness", 0.02)
    still = setting.problem(model, [stiffness])
    held = setting.problem(model, [stiffness, *offered(model, exp)["imbalance"].at_null({}, {"stiffness": 0.02})])
    np.testing.assert_allclose(held.data_residual(held.start), still.data_residual(still.start), atol=1e-12)


def test_a_distance_between_guides_is_tried_at_fractions_of_a_link():
    terms = offered(*case())
    assert [row["spacing"] for row in terms["spacing"].grid] == pytest.approx([0.05, 0.1])
    assert not terms["spacing"].null
    assert "spacing" not in offered(*case(spacing=0.03))
