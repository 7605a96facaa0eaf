"""A model takes physical numbers of the right shape, keeps them, and never changes."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.model import Chamber, Extension, Model, Station, Valve, chain_model

GOOD = {"link_length": [0.05, 0.03], "link_mass": 0.01, "stiffness": [1.0, 0.5], "damping": 5e-3, "torque": 6e-7}


def test_one_number_stands_for_all_links():
    model = Model(**GOOD)
    assert model.n == 2
    assert model.link_mass.tolist() == [0.01, 0.01]
    assert model.rest_angle.tolist() == [0.0, 0.0]
    assert model.joint_gain.tolist() == [1.0, 1.0]
    assert model.length == pytest.approx(0.08)
    assert model.with_(base_length=0.02, tip_mass=0.005).length == pytest.approx(0.1)
    assert model.with_(base_length=0.02, tip_mass=0.005).mass == pytest.approx(0.025)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": -1.0}, "stiffness must be positive"),
        ({"stiffness": [1.0, 0.0]}, "stiffness must be positive"),
        ({"link_length": [0.0, 0.1]}, "link_length must be positive"),
        ({"link_mass": -0.1}, "link_mass must not be negative"),
        ({"link_mass": [0.0, 0.1]}, "link_mass must be positive for every link"),
        ({"link_mass": [0.1, 0.0]}, "link_mass must be positive for every link"),
        ({"damping": -1e-9}, "damping must not be negative"),
        ({"tip_mass": -1e-9}, "tip_mass must not be negative"),
        ({"base_length": -0.1}, "base_length must not be negative"),
        ({"rest_angle": np.nan}, "rest_angle must be finite"),
        ({"torque": [np.inf]}, "torque must be finite"),
        ({"gravity": [0.0, np.nan]}, "gravity must be finite"),
        ({"base_angle": np.inf}, "base_angle must be finite"),
        ({"joint_gain": [1.0, np.nan]}, "joint_gain must be finite"),
        ({"stiffness": [1.0, 2.0, 3.0]}, "must be one number or 3"),
        ({"stiffness": [[1.0, 2.0]]}, "one row of numbers, got shape"),
        ({"stiffness": "stiff"}, "must be numbers, got 'stiff'"),
        ({"stiffness": [[1.0], [1.0, 2.0]]}, "must be numbers"),
        ({"stiffness": []}, "must be one number or 2"),
        ({"torque": []}, "at least one coefficient"),
        ({"torque": [[1e-6, 0.0]]}, "one row of numbers"),
        ({"gravity": 9.81}, "gravity must be 2 numbers"),
        ({"gravity": [[0.0, 9.81]]}, "one row of numbers"),
        ({"tip_mass": [0.1, 0.2]}, "tip_mass must be one number"),
        ({"tip_mass": None}, "tip_mass must be"),
        ({"mass_at": "middle"}, "'rod' or 'tip'"),
        ({"stations": [Station("a", 2, 0.0)]}, "must sit on a link 0..1 or the base"),
        ({"stations": [Station("a", -2, 0.0)]}, "must sit on a link"),
        ({"stations": [Station("a", 0, np.nan)]}, "must sit on a link"),
        ({"stations": [("a", 0.5, 0.0)]}, "an integer link"),
        ({"stations": [("a",)]}, "a station is"),
        ({"stations": [("a", 0, 0.01), ("a", 1, 0.01)]}, "must have different names"),
    ],
)
def test_what_is_not_physical_is_refused(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        Model(**{**GOOD, **changes})
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=words):
        Model(**GOOD).with_(**changes)


def test_all_empty_is_refused():
    names = ("link_length", "link_mass", "stiffness", "damping", "rest_angle", "joint_gain")
    empty = {name: [] for name in names}
    with pytest.raises(InputError, match="must be one number"):
        Model(**empty, torque=1e-6)


def test_a_massless_last_link_may_carry_a_cap():
    assert Model(**{**GOOD, "link_mass": [0.01, 0.0], "tip_mass": 0.005}).mass == pytest.approx(0.015)


def test_a_model_never_changes():
    length, source = np.array([0.05, 0.03]), {"stiffness": "measured"}
    model = Model(**{**GOOD, "link_length": length, "source": source})
    length[0], source["stiffness"] = 9.0, "guessed"
    assert model.link_length.tolist() == [0.05, 0.03]
    assert model.source == {"stiffness": "measured"}
    with pytest.raises(ValueError, match="read-only"):
        model.link_length[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        model.tip_mass = 1.0
    other = model.with_(stiffness=2.0)
    assert model.stiffness.tolist() == [1.0, 0.5]
    assert other.stiffness.tolist() == [2.0, 2.0]


def test_models_are_equal_when_their_numbers_are():
    assert Model(**GOOD) == Model(**GOOD)
    for changes in (
        {"damping": 6e-3}, {"valve": Valve(rise_time=0.1)}, {"name": "other"}, {"gravity": [0.0, 1.0]},
        {"stations": [("a", 0, 0.01)]}, {"source": {"damping": "x"}}, {"torque": [6e-7, 0.0]},
    ):
        assert Model(**GOOD) != Model(**{**GOOD, **changes})
    a, b = (Model(**GOOD, stations=[("a", np.int64(0), along)]) for along in (1, np.float32(1.0)))
    assert a == b
    assert Model(**GOOD) != "a model"


def test_torque_law():
    law = Model(**{**GOOD, "torque": [6e-7, 2e-12, -1e-18]})
    assert law.torque_at(1e5) == pytest.approx(6e-2 + 2e-2 - 1e-3)
    assert law.torque_at(np.zeros((2, 3))).shape == (2, 3)


def test_a_uniform_body_is_cut_into_equal_links():
    body = chain_model(length=0.2, mass=0.1, links=4, stiffness=1.0, damping=1e-3, torque=1e-6)
    assert body.link_length == pytest.approx(np.full(4, 0.05))
    assert body.mass == pytest.approx(0.1)
    middle = chain_model(
        length=0.2, mass=0.1, links=4, joint_placement="midsegment", base_length=0.01, stiffness=1.0, damping=1e-3,
        torque=1e-6,
    )
    assert middle.link_length == pytest.approx([0.05, 0.05, 0.05, 0.025])
    assert middle.base_length == pytest.approx(0.035)
    assert middle.length == pytest.approx(0.21)
    assert middle.mass == pytest.approx(0.1 * 7 / 8)  # the stub before the first joint does not move
    assert chain_model(length=0.2, mass=0.1, links=1, stiffness=1.0, damping=0.0, torque=1e-6).n == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"links": 0}, "at least one link"), ({"length": 0.0}, "must be positive"),
        ({"mass": -1.0}, "must be positive"),
        ({"length": np.nan}, "must be positive"), ({"joint_placement": "tip"}, "'base' or 'midsegment'"),
        ({"stiffness": [1.0, 2.0]}, "must be one number or 5"),
    ],
)
def test_a_body_that_is_none_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        chain_model(**{"length": 0.2, "mass": 0.1, "stiffness": 1.0, "damping": 1e-3, "torque": 1e-6, **changes})


def test_a_changed_number_of_the_papers_model_does_not_claim_the_paper():
    assert "stiffness" in chen2018.model().source
    assert "stiffness" not in chen2018.model(stiffness=2.0).source


def test_an_extension_stops_after_its_start_or_at_the_tip():
    assert Extension(200.0, start=0.03).stop is None
    assert Extension(200.0, start=0.03, stop=0.04).stop == 0.04
    for stop in (0.03, 0.02):
        with pytest.raises(InputError, match=r"must stop after its start at 0\.03 m"):
            Extension(200.0, start=0.03, stop=stop)


def test_torques_over_a_record_take_one_pressure_for_each_chamber():
    one = Model(**GOOD).actuation
    np.testing.assert_allclose(one.torques_over([1e5, 2e5])[:, 0], [0.06, 0.12], rtol=1e-12)
    two = Model(**{k: v for k, v in GOOD.items() if k != "torque"}, chambers=(
        Chamber(torque=[6e-7], name="a"), Chamber(torque=[4e-7], name="b"))).actuation  # fmt: skip
    np.testing.assert_allclose(two.torques_over([[1e5, 2e5]]), [[0.06, 0.08]], rtol=1e-12)
    for wrong in ([1e5, 2e5], np.zeros((3, 1)), np.zeros((1, 2, 2))):
        with pytest.raises(InputError, match=r"expected pressures \(T, 2\): 2 pressure\(s\) in Pa"):
            two.torques_over(wrong)
