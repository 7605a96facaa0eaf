"""A base that moves as prescribed: MuJoCo, closed forms, plane against space, and a base at rest."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Extension, Memory, Model, Space
from pliant.simulation import BaseMotion, PointForce, Pulse, equilibrium, simulate

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIME = np.linspace(0.0, 1.0, 2001)
ANGLE = 0.4 * np.sin(6 * TIME) + 0.2 * np.sin(13 * TIME)
SHAKEN = np.column_stack([0.05 * np.sin(9 * TIME), 0.03 * np.sin(7 * TIME)])
FLAT = BaseMotion(TIME, SHAKEN, angle=ANGLE)
ARM = {
    "link_length": [0.05, 0.04, 0.06], "link_mass": [0.01, 0.012, 0.008], "stiffness": [0.4, 0.3, 0.2],
    "damping": [2e-3, 1e-3, 1e-3], "torque": [1e-6], "base_length": 0.03,
}  # fmt: skip
NOTHING = Pulse(0.0, 0.0, 0.1)


def about_x(angle):
    """Quaternions of a rotation about +x of the space, which is +z of the plane."""
    return np.column_stack([np.sin(0.5 * angle), 0.0 * angle, 0.0 * angle, np.cos(0.5 * angle)])


def arm(*, space=False, **more):
    gravity = (0.5, 1.0, -9.81) if space else (0.5, -9.81)
    return Model(**ARM | {"gravity": gravity, "space": Space(radius=0.005) if space else None} | more)


def compared(model, motion, q0):
    """Largest differences from MuJoCo of joint coordinates, rates, forces and moments, over the largest values."""
    from oracles.moving_base import OnMovingBase

    times = np.linspace(0.0, 0.5, 101)
    expected = OnMovingBase(model, motion).run(times, q0)
    run = simulate(model, NOTHING, times=times, time_step=2.5e-4, base=motion)
    names = ("joint_angle", "joint_rate") if motion.dimension == 2 else ("joint_angle_{}", "joint_rate_{}")
    found = [run[names[k]].values if motion.dimension == 2 else
             np.stack([run[names[k].format(a)].values for a in "xy"], axis=-1).reshape(101, -1) for k in (0, 1)]
    found += [run.base_force.values, run.base_moment.values.reshape(101, -1)]
    return [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(found, expected, strict=True)]


def test_plane_against_mujoco():
    model = arm()
    assert max(compared(model, FLAT, equilibrium(model, 0.0))) < 1e-4


@pytest.mark.slow
def test_space_against_mujoco():
    """All six motions of the base, not small, with the body at rest in its equilibrium at the start."""
    from scipy.spatial.transform import Rotation

    turn = np.column_stack([0.5 * np.sin(5 * TIME), 0.4 * np.sin(7 * TIME), 0.6 * np.sin(4 * TIME)])
    place = np.column_stack([0.04 * np.sin(8 * TIME), 0.05 * np.sin(6 * TIME), 0.03 * np.sin(9 * TIME)])
    motion, model = BaseMotion(TIME, place, quaternion=Rotation.from_rotvec(turn).as_quat()), arm(space=True)
    assert max(compared(model, motion, equilibrium(model, 0.0))) < 1e-4


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("segments", [(), (Extension(stiffness=120.0, damping=0.5),)])
def test_base_at_rest_gives_the_numbers_of_a_fixed_base(space, segments):
    model = arm(space=space, extensions=segments, memory=Memory() if segments else Memory((0.2,), (0.1,)))
    pulse, still = Pulse(4e4, 0.05, 0.1), BaseMotion(TIME, np.zeros((TIME.size, 3 if space else 2)))
    fixed, moved = (simulate(model, pulse, duration=0.2, time_step=1e-3, **more) for more in ({}, {"base": still}))
    assert np.abs(fixed.station_position - moved.station_position).max() <= (1e-15 if space else 0.0)
    assert np.abs(fixed.input_work - moved.input_work).max() <= 1e-15
    assert "base_force" not in fixed
    assert "energy_gain" not in moved.attrs


@pytest.mark.parametrize("memory", [
    Memory(), Memory((0.3,), (0.2,)),
    pytest.param(Memory(slip_share=(0.3,), slip_angle=(0.01,)), marks=pytest.mark.slow),
])  # fmt: skip
@pytest.mark.parametrize("segments", [(), pytest.param((Extension(stiffness=3.0, damping=0.05),),
                                                       marks=pytest.mark.slow)])  # fmt: skip
def test_plane_and_space_agree(memory, segments):
    """Two different texts: absolute angles with a turning base, and a recursion that begins at the base."""
    more = {"memory": memory, "extensions": segments, "base_angle": 0.0}
    flat = arm(**more, gravity=(0.0, -9.81))
    deep = arm(**more, gravity=(0.0, 0.0, -9.81), space=True).with_(space=Space(radius=1e-6))
    motion = BaseMotion(TIME, np.column_stack([0.0 * TIME, SHAKEN]), quaternion=about_x(ANGLE))
    times, pulse = np.linspace(0.0, 1.0, 51), Pulse(3e4, 0.2, 0.3)
    one, other = (simulate(model, pulse, times=times, time_step=5e-4, base=base)
                  for model, base in ((flat, FLAT), (deep, motion)))  # fmt: skip
    assert np.abs(one.station_position.values - other.station_position.values[..., 1:]).max() < 1e-7
    assert np.abs(one.base_force.values - other.base_force.values[:, 1:]).max() < 1e-5
    assert np.abs(one.base_moment.values - other.base_moment.values[:, 0]).max() < 1e-6
    assert np.ptp(one.base_moment.values) > 5e-3


def test_constant_acceleration_is_tilted_gravity():
    """After the start has died out, a base that accelerates by a holds the shape of the body under g - a."""
    model, a = arm(damping=[2e-2] * 3), np.array([3.0, -1.5])
    time = np.linspace(0.0, 4.0, 401)
    run = simulate(model, NOTHING, times=time, base=BaseMotion(time, 0.5 * a * time[:, None] ** 2))
    tilted = model.with_(gravity=model.gravity - a)
    assert run.joint_angle.values[-1] == pytest.approx(equilibrium(tilted, 0.0), abs=1e-6)
    assert run.base_force.values[-1] == pytest.approx(-model.mass * tilted.gravity, rel=1e-5)


def test_tilted_base_at_rest_is_a_body_under_turned_gravity():
    model, tilt = arm(), 0.7
    base = BaseMotion(TIME, np.zeros((TIME.size, 2)), angle=np.full(TIME.size, tilt))
    c, s = np.cos(tilt), np.sin(tilt)
    turned = model.with_(gravity=np.array([[c, s], [-s, c]]) @ model.gravity)
    run = simulate(model, NOTHING, duration=0.2, base=base)
    assert np.abs(run.joint_angle.values - equilibrium(turned, 0.0)).max() < 1e-9


@pytest.mark.parametrize("space", [False, True])
def test_pendulum_with_a_moving_support(space):
    """I q'' = m c [(g + y'') sin q ... ]: a rod whose support moves along x, linearised for small swings."""
    length, mass, rate, size = 0.3, 0.05, 5.0, 1e-5
    rod = {"link_length": [length], "link_mass": [mass], "stiffness": [1e-9], "damping": [0.0], "torque": [0.0]}
    time = np.linspace(0.0, 2.0, 2001)
    shift = size * (1.0 - np.cos(rate * time))  # starts at rest
    place = np.column_stack([0.0 * time, shift, 0.0 * time] if space else [shift, 0.0 * time])
    gravity = (0.0, 0.0, 9.81) if space else (0.0, 9.81)  # hangs along the base tangent
    model = Model(**rod, gravity=gravity, space=Space(radius=1e-6) if space else None)
    run = simulate(model, NOTHING, times=time, time_step=1e-3, base=BaseMotion(time, place))
    q = run[["joint_angle", "joint_angle_x"][space]].values[:, 0]
    omega, drive = np.sqrt(1.5 * 9.81 / length), 1.5 * size * rate**2 / length  # q'' + omega^2 q = drive cos(rate t)
    expected = drive / (omega**2 - rate**2) * (np.cos(rate * time) - np.cos(omega * time))
    assert q == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_turning_base_pulls_a_rod_outward():
    """A rod along the base at the constant rate w needs m c w^2 towards the axis."""
    rate, time = 4.0, np.linspace(0.0, 1.0, 201)
    model = Model(link_length=[0.2], link_mass=[0.1], stiffness=[5.0], damping=[0.01], torque=[0.0], base_length=0.1)
    run = simulate(model, NOTHING, times=time, base=BaseMotion(time, np.zeros((201, 2)), angle=rate * time),
                   initial_angle=[0.0])  # fmt: skip
    assert run.base_force.values[100] == pytest.approx([0.0, -0.1 * 0.2 * rate**2], abs=1e-9)
    assert np.abs(run.joint_angle.values).max() < 1e-10


def test_known_force_is_left_to_the_force_itself():
    """A body that hangs from the base carries its weight; a thread that lifts it takes its part."""
    model = arm(gravity=(0.0, 9.81), damping=[5e-2] * 3)
    lift = PointForce(np.array([0.0]), np.array([[0.02, -0.1]]), "link_3")
    still = BaseMotion(TIME, np.zeros((TIME.size, 2)))
    run = simulate(model, NOTHING, duration=0.2, base=still, forces=[lift])
    assert run.base_force.values[-1] == pytest.approx([-0.02, 0.1 - 9.81 * model.mass], abs=1e-6)
    p = run.tip_position.values[-1, -1]
    weight = sum(m * np.mean([a, b], axis=0)[0] for m, a, b in zip(
        model.link_mass, [[0.0, 0.03], *run.tip_position.values[-1, :-1]], run.tip_position.values[-1], strict=True))
    assert run.base_moment.values[-1] == pytest.approx(p[1] * 0.02 + p[0] * 0.1 - 9.81 * weight, abs=1e-6)


def test_derivatives_of_quaternions_are_those_of_the_rotation():
    from scipy.spatial.transform import Rotation

    turn = np.column_stack([np.sin(3 * TIME), 0.5 * np.sin(5 * TIME), 2.0 * TIME])
    motion = BaseMotion(TIME, np.zeros((TIME.size, 3)), quaternion=Rotation.from_rotvec(turn).as_quat())
    t, h = np.array([0.2, 0.5, 0.83]), 1e-4
    a, b, c = (motion.at(t + k * h) for k in (-1, 0, 1))
    change = np.einsum("tij,tkj->tik", (c.axes - a.axes) / (2 * h), b.axes)
    spin = np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)
    assert spin == pytest.approx(b.rate, abs=1e-5)
    assert (c.rate - a.rate) / (2 * h) == pytest.approx(b.turning, abs=1e-4)


@pytest.mark.parametrize("cutoff", [12.0, "auto"])
def test_smoothing_takes_noise_from_the_acceleration(cutoff, rng):
    time = np.linspace(0.0, 2.0, 401)
    clean = 0.05 * np.sin(2 * np.pi * 1.5 * time)
    rough = BaseMotion(time, np.column_stack([clean + 1e-4 * rng.normal(size=401), 0 * time]), cutoff=cutoff)
    middle = slice(40, -40)
    true = -(2 * np.pi * 1.5) ** 2 * clean
    apart = rough.at(time).acceleration[middle, 0] - true[middle]
    assert np.sqrt(np.mean(apart**2)) < 0.1 * np.abs(true).max()
    raw = BaseMotion(time, rough.position).at(time).acceleration[middle, 0] - true[middle]
    assert np.sqrt(np.mean(raw**2)) > np.abs(true).max()
    assert "401 poses" in rough.summary()
    assert "mm rms from the poses" in rough.summary()


def test_unknown_poses_are_bridged_and_counted():
    place = SHAKEN.copy()
    place[100:110] = np.nan
    motion = BaseMotion(TIME, place, angle=ANGLE)
    assert motion.gaps == 10
    assert "10 unknown ones bridged" in motion.summary()
    assert np.abs(motion.at(TIME).position - SHAKEN).max() < 1e-9


@pytest.mark.parametrize(("given", "message"), [
    ({"position": np.zeros((5, 2)), "time": np.arange(5.0)}, "at least 6 known poses"),
    ({"position": np.zeros((9, 2)), "time": np.arange(9.0)[::-1]}, "increase strictly"),
    ({"position": np.zeros((9, 4)), "time": np.arange(9.0)}, "one row for each time"),
    ({"position": np.zeros((9, 3)), "time": np.arange(9.0), "angle": np.zeros(9)}, "in space a quaternion"),
    ({"position": np.zeros((9, 2)), "time": np.arange(9.0), "cutoff": -1.0}, "a frequency in Hz"),
    ({"position": np.zeros((9, 3)), "time": np.arange(9.0), "quaternion": np.zeros((9, 4))}, "length 1"),
])  # fmt: skip
def test_unusable_motions_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        BaseMotion(**given)


def test_motion_must_cover_the_simulation_and_fit_the_model():
    with pytest.raises(InputError, match=r"known from 0 to 1 s, but is needed from 0 to 1\.5 s"):
        simulate(arm(), NOTHING, duration=1.5, base=FLAT)
    with pytest.raises(InputError, match="moves in space, but the motion of its base has 2 coordinates"):
        simulate(arm(space=True), NOTHING, duration=0.5, base=FLAT)
    with pytest.raises(InputError, match="must be a BaseMotion"):
        simulate(arm(), NOTHING, duration=0.5, base=SHAKEN)


@pytest.mark.parametrize("method", ["extrapolated", "BDF"])
def test_methods_that_do_not_take_a_moving_base_refuse_it(method):
    with pytest.raises(InputError, match=r"does not support moving base \(moving_base\)"):
        simulate(arm(), NOTHING, duration=0.1, base=FLAT, method=method)


def test_accurate_method_follows_a_moving_base():
    times = np.linspace(0.0, 0.3, 31)
    fine, run = (simulate(arm(), NOTHING, times=times, base=FLAT, **more)
                 for more in ({"time_step": 1e-4}, {"method": "accurate", "tolerance": 1e-6}))  # fmt: skip
    assert np.abs(fine.tip_position - run.tip_position).max() < 1e-6
