"""Levers of a body that bends everywhere, against a beam; of a chain, against virtual work; the curve on an arc."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.contact.locate import curve_at, mean_moment_arm, moment_arms
from pliant.equations.contact import point_force
from pliant.model import chain_model

LENGTHS = np.array([0.034, 0.034, 0.034, 0.034, 0.017])


def chain(base=0.017, lengths=LENGTHS):
    made = chain_model(length=float(np.sum(lengths)), mass=0.07, links=len(lengths), stiffness=1.0, damping=5e-3,
                       torque=[1e-6])
    return made.with_(link_length=lengths, base_length=base)


@pytest.mark.parametrize(("base", "lengths"), [(0.017, LENGTHS), (0.01, np.array([0.05, 0.03, 0.04])),
                                               (0.02, np.array([0.06]))])  # fmt: skip
def test_a_force_on_a_beam_turns_its_chords_as_the_levers_say(base, lengths):
    """Euler and Bernoulli: angle between neighbouring chords under a force at s, over that under a force at the tip."""
    m = chain(base, lengths)
    nodes = base + np.append(0.0, np.cumsum(lengths))
    s = np.linspace(0.0, nodes[-1], 200001)

    def joints(place):
        slope = np.concatenate([[0.0], np.cumsum(0.5 * (np.maximum(place - s, 0)[1:] + np.maximum(place - s, 0)[:-1]))])
        rise = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]))])
        chord = np.diff(np.interp(nodes, s, rise)) / lengths
        return np.diff(chord, prepend=0.0)  # clamped along the base

    for place in (0.3, 0.55, 0.8, 1.0):
        at = place * nodes[-1]
        found = mean_moment_arm(m, np.arange(m.n), at - nodes[:-1])
        wanted = joints(at) / joints(nodes[-1]) * (nodes[-1] - nodes[:-1])
        np.testing.assert_allclose(found, wanted, atol=2e-6)


def test_a_chain_of_rigid_links_has_the_levers_of_virtual_work(rng):
    m = chain()
    angle = np.cumsum(rng.uniform(-0.4, 0.6, (3, 5)), axis=1)
    link, along = np.array([0, 2, 4]), np.array([0.02, 0.001, 0.015])
    found = moment_arms(m, angle, link, along, rigid=True)
    Q = np.empty(5)
    for t in range(3):
        c, s = np.cos(angle[t]), np.sin(angle[t])
        for p, (j, a) in enumerate(zip(link, along, strict=True)):
            for side, force in enumerate(((-c[j], -s[j]), (-s[j], c[j]))):
                point_force(angle[t], m.link_length, j, a, 0.0, *force, Q)
                np.testing.assert_allclose(found[t, p, side], np.cumsum(Q[::-1])[::-1], atol=1e-15)


def test_levers_of_a_body_are_the_chains_away_from_the_force():
    m = chain()
    angle = np.cumsum(np.full((1, 5), 0.25), axis=1)
    soft, rigid = (moment_arms(m, angle, np.array([3]), np.array([0.02]), rigid=r)[0, 0] for r in (False, True))
    np.testing.assert_allclose(soft[:, :3], rigid[:, :3], rtol=1e-12)
    assert soft[0, 3] > rigid[0, 3]
    assert soft[0, 4] > rigid[0, 4] == 0.0


def test_the_curve_lies_on_the_arc_that_its_nodes_lie_on():
    """LinkAngles of a circle of 8 1/m: the curve between its joints is the circle, with its tangent."""
    kappa, base, l = 8.0, 0.017, LENGTHS
    s = np.concatenate([[0.0], base + np.append(0.0, np.cumsum(l))])
    circle = lambda a: np.stack([(np.cos(kappa * a) - 1) / kappa, np.sin(kappa * a) / kappa], axis=-1)  # noqa: E731
    nodes = circle(s)
    chords = np.diff(nodes, axis=0)
    m = chain(float(np.linalg.norm(chords[0])), np.linalg.norm(chords[1:], axis=1))
    turn = float(np.arctan2(-chords[0, 0], chords[0, 1]))
    angle = np.arctan2(-chords[1:, 0], chords[1:, 1]) - turn  # in the frame of the first chord
    c, w = np.cos(turn), np.sin(turn)
    for place in (0.06, 0.1, 0.16):
        arc = float(np.interp(place, s, np.append(0.0, np.cumsum(np.linalg.norm(chords, axis=1)))))
        point, tangent = curve_at(m, angle, arc)
        wanted = circle(np.array(place)) @ np.array([[c, -w], [w, c]])
        assert np.linalg.norm(point - wanted) < 2e-4  # a straight chord is off by 1.2 mm
        heading = np.arctan2(-tangent[0], tangent[1]) + turn
        assert abs(heading - kappa * place) < 0.02
