import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planar_bodies import LENGTH, arc, wavy

from pliant.errors import InputError
from pliant.recording import make_recording
from pliant.reduction import links_of, spline_shape
from pliant.reduction.links import chain_of, forward_tips, wrap


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_a_circle_has_known_links(n):
    angle = 1.2
    links = links_of(arc(angle), n)
    h = LENGTH / n
    kappa = angle / LENGTH
    np.testing.assert_allclose(links.link_length, 2 * np.sin(kappa * h / 2) / kappa, rtol=1e-7)
    np.testing.assert_allclose(links.rest_angle, [kappa * h / 2] + [kappa * h] * (n - 1), atol=1e-6)
    np.testing.assert_allclose(links.joint_angle, 0, atol=1e-14)
    np.testing.assert_allclose(links.node_arc_length, np.linspace(0, LENGTH, n + 1))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 8))
def test_chain_and_nodes_are_inverse(seed, n):
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-3, 3, (7, n))
    lengths = rng.uniform(0.01, 0.1, (7, n))
    tips = forward_tips(turns, lengths)
    found_length, found = chain_of(np.concatenate((np.zeros((7, 1, 2)), tips), axis=1))
    np.testing.assert_allclose(found_length, lengths, rtol=1e-9)
    np.testing.assert_allclose(found, turns, atol=1e-9)


def test_positive_turn_moves_the_tip_to_negative_x():
    tip = forward_tips(np.array([[0.3]]), np.array([0.1]))[0, 0]
    np.testing.assert_allclose(tip, [-0.1 * np.sin(0.3), 0.1 * np.cos(0.3)])


def test_same_tips_as_the_chain_of_the_equations():
    from pliant.equations.chain import forward

    rng = np.random.default_rng(0)
    q, theta0, l = rng.normal(size=4), rng.normal(size=4), rng.uniform(0.02, 0.05, 4)
    R, p, R_abs, p_abs = np.empty((4, 2, 2)), np.empty((4, 2)), np.empty((4, 2, 2)), np.empty((4, 2))
    forward(q, theta0, l, R, p, R_abs, p_abs)
    np.testing.assert_allclose(forward_tips((q + theta0)[None], l)[0], p_abs, atol=1e-15)


def test_angles_stay_continuous_over_more_than_half_a_turn():
    t = np.linspace(0, 1, 60)
    turns = np.stack([np.zeros_like(t), 4.5 * t, -5.0 * t], axis=1)
    tips = forward_tips(turns, np.full(3, 0.05))
    position = np.concatenate((np.zeros((60, 1, 2)), tips), axis=1)
    links = links_of(
        make_recording(t, position, frame="planar"), stations=["s000", "s001", "s002", "s003"], rest=(0.0, 0.0)
    )
    np.testing.assert_allclose(links.joint_angle, turns, atol=1e-12)
    np.testing.assert_allclose(links.residual, 0, atol=1e-15)
    np.testing.assert_allclose(links.length_variation, 0, atol=1e-12)


def test_constant_lengths_leave_a_residual_that_is_told():
    recording, _ = wavy(frames=40, bend=3)
    rest, mean = links_of(recording, 5), links_of(recording, 5, length="mean")
    assert mean.residual.max() < rest.residual.max() < 7e-3
    lengths, _ = chain_of(np.concatenate((np.zeros((40, 1, 2)), rest.tips), axis=1))
    exact = forward_tips(rest.joint_angle + rest.rest_angle, lengths)
    np.testing.assert_allclose(exact, rest.tips, atol=1e-15)
    np.testing.assert_allclose(np.ptp(lengths, axis=0) / rest.link_length, rest.length_variation)


def test_rest_window_and_pressure_in_it():
    recording, _ = wavy(frames=40)
    pushed = make_recording(
        recording["time"].values,
        recording["position"].values,
        frame="planar",
        pressure=np.linspace(0, 1e5, 40),
    )
    assert not any("pressure" in note for note in links_of(pushed, 3, rest=(0, 0.02)).notes)
    late = links_of(pushed, 3, rest=(0.3, 0.4))
    assert any("pressure reaches" in note for note in late.notes)
    inside = (late.time >= 0.3) & (late.time <= 0.4)
    np.testing.assert_allclose(late.joint_angle[inside].mean(axis=0), 0, atol=5e-3)
    with pytest.raises(InputError, match="rest window 7 to 8 s contains no complete frame"):
        links_of(pushed, 3, rest=(7, 8))


def test_bad_nodes_are_refused():
    recording, _ = wavy()
    with pytest.raises(InputError, match="exactly one of"):
        links_of(recording)
    with pytest.raises(InputError, match="must increase"):
        links_of(recording, node_arc_length=[0, 0.1, 0.05])
    with pytest.raises(InputError, match="between 0 and"):
        links_of(recording, node_arc_length=[0, 0.1, 0.5])
    with pytest.raises(InputError, match="no station tip"):
        links_of(recording, stations=["s000", "tip"])
    with pytest.raises(InputError, match="must be 1 or more"):
        links_of(recording, 0)
    with pytest.raises(InputError, match="'rest' or 'mean'"):
        links_of(recording, 3, length="median")
    with pytest.raises(InputError, match="aligned recording"):
        links_of(make_recording([0.0], np.zeros((1, 5, 3))), 3)
    three = make_recording([0.0], np.array([[[0, 0], [0, 0.1], [0, 0.2]]], dtype=float), frame="planar")
    with pytest.raises(InputError, match="has 3 stations, but nodes between stations need at least 4"):
        links_of(three, node_arc_length=[0, 0.15, 0.2])


@given(angle=st.floats(-1e6, 1e6))
def test_wrap(angle):
    wrapped = wrap(np.array([angle]))[0]
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-6)


def test_a_reconstruction_comes_close_to_the_body():
    recording, _ = wavy(frames=20)
    s = recording["arc_length"].values
    links = links_of(recording, 6)
    spline = spline_shape(links.tips, links.node_arc_length, s, base=links.base)
    body = recording["position"].values
    assert np.linalg.norm(spline - body, axis=2).max() < 0.5e-3
    from pliant.reduction import select_order

    expected = select_order(recording, max_order=6).max_error[-1]
    np.testing.assert_allclose(np.linalg.norm(spline - body, axis=2).max(axis=1), expected, rtol=1e-9)


def test_reconstruction_refuses_what_does_not_fit():
    with pytest.raises(InputError, match="need n \\+ 1 node"):
        spline_shape(np.zeros((1, 3, 2)), [0, 0.1, 0.2], [0])
    with pytest.raises(InputError, match="a spline needs at least two links, got 1"):
        spline_shape(np.zeros((1, 1, 2)), [0, 0.1], [0])
    with pytest.raises(InputError, match="boundary must be one of"):
        spline_shape(np.zeros((1, 2, 2)), [0, 0.1, 0.2], [0], boundary="periodic")
