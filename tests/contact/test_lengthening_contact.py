"""Touch of a body that lengthens: levers by virtual work, a beam's, forces in motions that point masses made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.derivatives import complex_step
from oracles.stretching import Stretching
from scipy.optimize import root

import pliant
from pliant.contact import find_contact, free_motion, locate, static_residual
from pliant.contact.locate import curve_at, moment_arms
from pliant.errors import InputError
from pliant.estimation import Noise
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, chain_model
from pliant.recording import make_recording
from pliant.simulation import Trace, equilibrium

PERIOD, SECONDS = 1 / 75, 1.5  # s; the noise is the default, but for the places
NOISE = Noise(position=1e-4, torque=2e-5, random_walk=3e-3, motion_growth=30.0, initial_disturbance=0.01)
OFFSETS, ALL = [0.02, -0.02], np.ones((2, 3))
BEGIN, END = 0.6, 1.2  # s, of the touch


@pytest.fixture(scope="module")
def arm():
    """Chambers on both sides of three links behind a stub; a link lies in both segments."""
    chambers = (Chamber.at_offset(2e-4, r, np.ones(3), name=n) for r, n in zip(OFFSETS, ("a", "b"), strict=True))
    return chain_model(
        length=0.2, mass=0.12, links=3, stiffness=1.0, damping=0.01, chambers=tuple(chambers), gravity=[0.0, 9.81],
        base_length=0.01, extensions=(Extension(150.0, 0.5, 0.0, 0.1, "near"), Extension(120.0, 0.4, 0.1, None, "far")),
    )


def masses(arm):
    return Stretching(arm, [2e-4] * 2, OFFSETS, ALL, np.ones((2, 2)))


def torques_of(arm, x, link, along, force):
    """Joint torques and what works on the strains, by complex steps through the place of the point."""
    own = masses(arm)
    row = own.place(link + 1, along)
    Q = complex_step(lambda at: np.array([force @ own.points(at, row)]), x)[0]
    return np.append(np.cumsum(Q[2::-1])[::-1], Q[3:])


X = np.array([0.2, 0.6, 1.1, 0.15, -0.05])


def test_levers_are_those_of_virtual_work(arm):
    link, along = np.array([0, 1, 2]), np.array([0.02, 0.05, 0.06])
    found = moment_arms(arm, X[None], link, along, rigid=True)[0]
    for p, (j, a) in enumerate(zip(link, along, strict=True)):
        c, s = np.cos(X[j]), np.sin(X[j])
        for side, force in enumerate(np.array([[-c, -s], [-s, c]])):
            np.testing.assert_allclose(found[p, side], torques_of(arm, X, j, a, force), atol=1e-15)


def test_a_stretched_beam_has_the_levers_of_a_longer_one(arm):
    """A uniform strain of 20 % makes arms of a soft body, and the curve through its joints, longer by as much."""
    long = arm.with_(extensions=(), link_length=1.2 * arm.link_length, base_length=1.2 * arm.base_length)
    x, link, along = np.append(X[:3], [0.2, 0.2]), np.array([1, 2]), np.array([0.05, 0.06])
    found, wanted = moment_arms(arm, x[None], link, along), moment_arms(long, X[None, :3], link, 1.2 * along)
    np.testing.assert_allclose(found[..., :3], wanted, atol=1e-15)
    np.testing.assert_allclose(curve_at(arm, x, 0.13), curve_at(long, X[:3], 1.2 * 0.13), atol=1e-12)


def test_a_straight_body_that_lengthens_shows_the_force_along_itself(arm):
    """The strains tell it; without them it is hidden."""
    x, force = np.array([0.0, 0.0, 0.0, 0.1, 0.05]), np.array([-0.5, -0.2])
    torque = torques_of(arm, x, 2, 0.03, force)
    push = locate(arm, x, torque, 1e-10 * np.eye(5), rigid=True)
    assert push.hidden == ()
    np.testing.assert_allclose(push.force, force, atol=2e-3)
    assert push.arc_length == pytest.approx(0.01 + 2 * 0.2 / 3 + 0.03, abs=5e-4)
    fixed = arm.with_(extensions=())
    assert locate(fixed, x[:3], torque[:3], 1e-10 * np.eye(3), rigid=True).hidden == ("tangential",)
    with pytest.raises(InputError, match="needs 3 angles and 2 strains, 5 torques and their covariance"):
        locate(arm, x[:3], torque[:3], np.eye(3))


def test_the_shape_at_rest_shows_a_force_at_the_tip(arm):
    """Where point masses rest under pressures, gravity and a force, found by a root of their accelerations."""
    own, force, pressure = masses(arm), np.array([0.2, -0.3]), np.array([3e4, 1e4])
    rest = root(lambda x: 1e-3 * own.acceleration(x, np.zeros(5), pressure, force, own.length), np.zeros(5), tol=1e-13)
    found = static_residual(arm, rest.x[None], pressure[None])
    np.testing.assert_allclose(found[0], torques_of(arm, rest.x, 2, arm.link_length[2], force), atol=1e-9)
    with pytest.raises(InputError, match=r"hold 3 joint angles and 2 strains, \(T, 5\), got shape \(1, 3\)"):
        static_residual(arm, np.zeros((1, 3)), np.zeros((1, 2)))


def pulses(seed):
    """Two pressures, none at first, that go to others every 0.4 s, within 0.1 s."""
    levels = np.random.default_rng(seed).uniform(0.0, 4e4, (17, 2)) * (np.arange(17) > 0)[:, None]
    clock = np.add.outer(0.4 * np.arange(16), [0.0, 0.1]).ravel()
    return [Trace(clock, column) for column in np.repeat(levels, 2, axis=0)[1:-1].T]


def seen(tips, traces, seed):
    """Link tips with noise, and the pressures, as a recording."""
    clock = np.arange(0.0, PERIOD * len(tips), 2e-3)
    noisy = tips + NOISE.position * np.random.default_rng(100 + seed).standard_normal(tips.shape)
    return make_recording(
        PERIOD * np.arange(len(tips)), noisy, station=["link_1", "link_2", "link_3"], frame="planar",
        pressure=np.stack([trace(clock) for trace in traces], axis=1), pressure_time=clock, chamber=["a", "b"],
    )


def softer(arm, share):
    segments = [replace(e, stiffness=share * e.stiffness) for e in arm.extensions]
    return arm.with_(stiffness=share * arm.stiffness, extensions=segments)


def free(arm, seed):
    times = PERIOD * np.arange(400)
    run = pliant.simulate(arm, pulses(seed), times=times, time_step=1e-3)
    return seen(run.tip_position.values, pulses(seed), seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "link", "along", "force", "error"),
    [(0.9, 1, 0.05, (0.3, 0.1), 0.06), (1.0, 2, 0.19 / 3, (0.05, -0.4), 0.05)], ids=["softer", "end"],
)
def test_a_force_on_a_moving_body_is_found(arm, share, link, along, force, error):
    """Point masses under gravity, pressures and that force from 0.6 to 1.2 s.

    Pushed in the middle, all springs softer than the model's by a tenth; pressed at its end, nearly along itself.
    """
    body = softer(arm, share)
    learnt = free_motion([free(body, seed) for seed in range(3)], arm, noise=NOISE)
    own, traces, times = masses(body), pulses(7), PERIOD * np.arange(round(SECONDS / PERIOD))
    row = own.place(link + 1, along)
    start = np.append(mechanics_of(body).coordinates(equilibrium(body)), np.zeros(5))
    moved = own.motion(
        times, start, lambda t: np.array([float(trace(t)) for trace in traces]),
        lambda t: np.array(force) * (BEGIN <= t < END), row,
    )
    tips = np.array([own.points(y[:5], np.array([own.place(k + 1, arm.link_length[k]) for k in range(3)]))
                     for y in moved])  # fmt: skip
    found = find_contact(seen(tips, traces, 8), arm, free=learnt, noise=NOISE)
    assert BEGIN <= found.attrs["alarm_s"][0] <= BEGIN + 0.06
    assert abs(found.attrs["onset_s"][0] - BEGIN) < 0.03
    steady = (times > BEGIN + 0.15) & (times < END)
    assert found.in_contact.values[steady].all()
    held, x = found.isel(time=np.flatnonzero(steady)).median("time"), moved[steady][-1, :5]
    off, sd = held.contact_force.values - force, np.sqrt(np.diag(held.force_covariance))
    pull = torques_of(arm, x, link, along, np.array(force))[3:] / arm.segment_length
    assert abs(float(held.contact_arc_length) - row.sum()) < 0.01  # levers are those of a body that bends everywhere
    assert (np.abs(off) < error).all(), (off, sd)
    assert (np.abs(off) < 3.0 * sd).all(), (off, sd)
    assert not held.hidden_tangential
    np.testing.assert_allclose(held.external_axial_force, pull, atol=0.06)
    assert held.external_torque.shape == (3,)
    assert not find_contact(free(body, 9), arm, free=learnt, noise=NOISE).in_contact.any()
