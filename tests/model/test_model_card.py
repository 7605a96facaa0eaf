"""What a model says of itself, word for word: the numbers that one checks at a glance."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.model import Chamber, Memory, Model, Station, Valve, chain_model
from pliant.model.summary import chain

PLAIN = chain_model(length=0.2, mass=0.05, links=2, stiffness=1.5, damping=0.01, torque=[1e-6])


def test_equal_links_are_one_row_and_a_lone_link_is_itself():
    card = PLAIN.card()
    assert card.title == "Model 'model': 2 link(s), 200 mm, 50 g"
    assert list(card.rows) == [["1 to 2", "100", "25", "1.5", "0.01", "0"]]
    lone = chain_model(length=0.1, mass=0.05, links=1, stiffness=1.5, damping=0.01, torque=[1e-6]).card()
    assert [row[0] for row in lone.rows] == ["1"]
    apart = PLAIN.with_(stiffness=[1.5, 1.6]).card()
    assert [row[:4] for row in apart.rows] == [["1", "100", "25", "1.5"], ["2", "100", "25", "1.6"]]
    assert card.lines[0].startswith("torque at each joint: 1e-06 p N m, p in Pa gauge")
    assert "no gravity" in card.lines
    assert not any(word in line for line in card.lines for word in ("tip", "springs", "memory", "observed", "valve"))


def test_what_is_more_than_links_is_said_with_its_numbers():
    body = Model(
        link_length=[0.1, 0.1], link_mass=[0.02, 0.03], stiffness=1.5, damping=0.01, rest_angle=[0.0, np.radians(5.0)],
        torque=[1e-6, 2e-12], valve=Valve(rise_time=0.02, dead_time=0.01), swell_share=0.25, swell_time=0.5,
        inflation_limit=3e5, inflation_time=0.05, stiffening=[0.5, 0.25], cubic_stiffening=2.0, stiffening_bound=0.3,
        memory=Memory((0.1,), (0.5,)), tip_mass=0.01, mass_at="tip", gravity=[0.0, -9.81],
        stations=[Station("middle", 0, 0.1), Station("tip", 1, 0.1)], name="all",
    )
    lines = "\n".join(body.card().lines)
    for part in (
        "torque at each joint: 1e-06 p + 2e-12 p^2 N m, p in Pa gauge",
        "valve: rise_time 0.02, dead_time 0.01", "viscoelastic lag: fraction 0.25, 0.5 s",
        "inflation: limit 3e+05 Pa, 0.05 s",
        "s in 1/rad: 0.25, 0.5", "a in 1/rad^2: 2", "at most 30 % of K", "hysteresis: creep_1", "tip mass: 10 g",
        "mass of a link at its tip", "gravity: (0, -9.81) m/s^2", "observed: middle, tip", "EI = K l: 0.15 N m^2",
    ):
        assert part in lines, (part, lines)
    assert body.card().rows[1][-1] == "5"


def test_chambers_are_told_apart():
    near = Chamber(torque=[6e-7], joint_gain=[1.0, 0.0], valve=Valve(rise_time=0.02), name="near")
    far = Chamber(torque=[5e-7], joint_gain=[0.0, 1.0], name="far")
    lines = PLAIN.with_(chambers=(near, far)).card().lines
    assert lines[0].startswith("near: torque at joints 1: 6e-07 p N m")
    assert "near: valve: rise_time 0.02" in lines
    assert "far: torque at joints 2: 5e-07 p N m, p in Pa gauge" in lines


def test_the_drawn_chain_turns_each_joint_from_its_rest():
    body = PLAIN.with_(rest_angle=[0.2, -0.1])
    angle = np.array([0.3, 0.3])  # 0.2 + 0.1, and -0.1 + 0.1 more
    tips = 0.1 * np.cumsum(np.stack([-np.sin(angle), np.cos(angle)], axis=1), axis=0)
    np.testing.assert_allclose(chain(body, 0.1), [[0.0, 0.0], *tips], atol=1e-15)


@pytest.mark.parametrize("swell", [0.0, 0.4])
@pytest.mark.parametrize("law", [[2e-6], [2e-6, 3e-12], [2e-6, 3e-12, -4e-18]])
def test_the_slope_of_a_torque_law_is_its_derivative_less_what_swells(law, swell):
    """Of a p + b p^2 + c p^3 the lever a + b p + c p^2 is there at once, its growth in the share that does not lag."""
    body, p = Chamber(law, swell_share=swell, swell_time=1.0), 5e4
    a, b, c = (*law, 0.0, 0.0)[:3]
    assert body.torque_slope(p) == pytest.approx(a + b * p + c * p**2 + (1 - swell) * p * (b + 2 * c * p), rel=1e-12)
    assert body.torque_slope(0.0) == pytest.approx(a, rel=1e-12)
