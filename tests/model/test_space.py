"""A model in space: its parameters, its file, and what it refuses."""

import numpy as np
import pytest

import pliant
from pliant.control import design_lqr
from pliant.errors import InputError
from pliant.estimation import AdaptiveObserver
from pliant.model import Chamber, Model, Space, Station
from pliant.simulation import modes

BODY = {"length": 0.3, "mass": 0.1, "links": 4, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 1e-3}


def in_space(**more):
    return pliant.chain_model(**BODY, **({"torque": (1e-6,), "space": True} | more))


def test_the_model_file_gives_back_an_equal_model_in_space(tmp_path):
    rest = [[0.1, 0.2, 0.3]] * 4
    space = Space(stiffness_ratio=1.3, twist_ratio=0.7, rest_turn=rest, base_tilt=(0.1, -0.2, 0.3), radius=0.01)
    model = in_space(
        space=space, gravity=(1.0, 2.0, 3.0), torque=(1e-6,), cross_gain=(0.1, 0.2, 0.3, 0.4),
        stations=[Station("tip", 3, 0.03, 0.01, 0.02)],
    )
    assert pliant.load_model(pliant.save_model(model, tmp_path / "m.json")) == model


def test_a_tilt_of_two_numbers_does_not_turn_the_base_about_its_tangent():
    assert Space(base_tilt=(0.1, -0.2)) == Space(base_tilt=(0.1, -0.2, 0.0)) != Space(base_tilt=(0.1, -0.2, 0.3))


def test_a_model_in_a_plane_says_nothing_of_space_in_its_file(tmp_path):
    model = pliant.chain_model(**BODY, torque=(1e-6,))
    assert "aside" not in (text := pliant.save_model(model, tmp_path / "m.json").read_text())
    assert '"space": {' not in text
    assert model.space is None
    assert model.gravity.shape == (2,)


def test_coordinates_are_two_or_three_for_each_joint():
    assert in_space().size == 8
    assert in_space(space=Space(twist_ratio=0.7, radius=0.01)).size == 12
    assert in_space().gravity.shape == (3,)


def test_gains_of_a_chamber_are_those_of_its_azimuth():
    """A chamber on +y pushes the tip towards -y, about +x: joint_gain sin(alpha), cross_gain -cos(alpha)."""
    alpha = 0.4
    chamber = Chamber(torque=(1e-6,), joint_gain=np.sin(alpha), cross_gain=-np.cos(alpha))
    gain = pliant.chain_model(**BODY, chambers=(chamber,), space=Space(twist_ratio=1.0, radius=0.01)).actuation.gain
    assert gain.shape == (1, 12)
    assert np.allclose(gain[0, :8].reshape(4, 2), [np.sin(alpha), -np.cos(alpha)], rtol=1e-15)
    assert not gain[0, 8:].any()


@pytest.mark.parametrize(("wrong", "sentence"), [
    ({"space": {"stiffnes_ratio": 2.0}}, "space has no parameter 'stiffnes_ratio'"),
    ({"space": Space(), "gravity": (0.0, -9.81)}, "gravity must be 3 numbers"),
    ({"space": None, "gravity": (0.0, 0.0, -9.81)}, "gravity must be 2 numbers"),
    ({"space": None, "stations": [Station("tip", 3, 0.03, 0.0, 0.01)]}, "lies out of the bending plane"),
    ({"space": None, "cross_gain": 0.5}, "set space"),
    ({"rest_angle": 0.1}, "has no rest_angle: set rest_turn of its space"),
    ({"base_angle": 0.1}, "set base_tilt of its space"),
    ({"space": "yes"}, "must be a Space"),
    ({"space": {"rest_turn": [[0.1, 0.0, 0.0]] * 3}}, "one row or 4"),
])  # fmt: skip
def test_what_belongs_to_the_other_kind_of_chain_is_refused(wrong, sentence):
    with pytest.raises(InputError, match=sentence):
        in_space(**wrong)


@pytest.mark.parametrize(("values", "sentence"), [
    ({"twist_ratio": 0.7}, "needs a radius"),
    ({"stiffness_ratio": 0.0}, "stiffness_ratio.* must be 0 to"),
    ({"rest_turn": [[np.pi, 0.0, 0.0]]}, "less than pi"),
    ({"rest_turn": [0.1, 0.2]}, "shape"),
    ({"base_tilt": (np.nan, 0.0)}, "finite"),
    ({"radius": -1.0}, "radius.* must be"),
])  # fmt: skip
def test_parameters_that_no_body_has_are_refused(values, sentence):
    with pytest.raises(InputError, match=sentence):
        Space(**values)


@pytest.mark.parametrize("use", [
    lambda model: AdaptiveObserver(model, 4e-3),
    lambda model: design_lqr(model, 1e5, 1e-3),
])  # fmt: skip
def test_what_takes_planar_chains_alone_refuses_one_in_space(use):
    with pytest.raises(InputError, match=r"needs a planar chain|does not support a body in space"):
        use(in_space())


@pytest.mark.parametrize(("mass", "radius"), [(0.0, 0.01), (1e-9, 1e-6)])
def test_a_last_link_that_twists_needs_inertia_about_its_axis(mass, radius):
    """A tip mass is a point on the axis. Without twist the link may be without mass."""
    body = {"link_length": [0.05, 0.05], "link_mass": [0.02, mass], "tip_mass": 0.01, "stiffness": 0.5, "damping": 5e-3,
            "torque": (6e-7,)}  # fmt: skip
    with pytest.raises(InputError, match=r"the last link of a chain that twists has .* set twist_ratio to 0"):
        Model(**body, space=Space(twist_ratio=0.7, radius=radius))
    assert Model(**body, space=Space(radius=0.01)).n == 2
    thin = Model(**body | {"link_mass": [0.02, 0.001]}, space=Space(twist_ratio=0.7, radius=1e-4))
    assert np.isfinite(modes(thin)[0]).all()
