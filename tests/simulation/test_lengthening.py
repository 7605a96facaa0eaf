"""Bodies that lengthen: closed forms at rest and in small motion, the reference solver, and the energy account."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq

import pliant
from pliant.contact import momentum_residual
from pliant.contact.locate import moment_arms
from pliant.control.steady_inputs import equilibria
from pliant.errors import InputError, SimulationError
from pliant.estimation import AdaptiveObserver, LinkAngles
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Model, Valve, chain_model, fixed_length
from pliant.simulation import Pulse, equilibrium, modes

NEAR, FAR = Extension(150.0, 0.5, 0.0, 0.1, "near"), Extension(120.0, 0.3, 0.1, None, "far")


@pytest.fixture(scope="module")
def arm():
    """Two segments, a chamber on each side of the first and one beside the second, under slanted gravity."""
    chambers = (
        Chamber.at_offset(2e-4, 0.02, [1, 1, 0, 0], name="left", valve=Valve(rise_time=0.02, fall_time=0.03)),
        Chamber.at_offset(2e-4, -0.02, [1, 1, 0, 0], name="right"),
        Chamber.at_offset(2e-4, 0.02, [0, 0, 1, 1], name="far"),
    )
    return chain_model(
        length=0.2, mass=0.3, links=4, joint_placement="midsegment", stiffness=1.0, damping=0.01, chambers=chambers,
        gravity=[3.0, -9.0], extensions=(NEAR, FAR), rest_angle=0.05,
    )


def rod(mass_at="rod", **changes):
    """One straight link that lengthens, hanging: m 0.2 kg, L 0.3 m, EA 80 N."""
    given = {"link_length": [0.3], "link_mass": [0.2], "stiffness": 1e-9, "damping": 0.0, "torque": (0.0,)}
    return Model(**given | {"mass_at": mass_at, "gravity": [0.0, 9.81], "extensions": (Extension(80.0),)} | changes)


def test_a_bar_hangs_as_long_as_its_weight_makes_it():
    """Tip of a bar: (m / 2 + m_tip) g L / EA lower."""
    model = rod(tip_mass=0.5)
    strain = equilibrium(model)[1]
    assert strain == pytest.approx((0.1 + 0.5) * 9.81 / 80.0, rel=1e-12)
    tip = mechanics_of(model).tips(mechanics_of(model).coordinates(equilibrium(model)))[0]
    assert tip == pytest.approx([0.0, 0.3 * (1 + strain)], abs=1e-15)


def test_first_axial_mode_of_a_bar_with_a_tip_mass():
    """b tan b = m / m_tip, f = b / 2 pi sqrt(EA / m L): one uniform strain under a heavy tip is right to 0.1 %."""
    model = rod(tip_mass=1.0, gravity=[0.0, 0.0], stiffness=1e9)
    b = brentq(lambda x: x * np.tan(x) - 0.2, 1e-3, 1.5)
    exact = b / (2 * np.pi) * np.sqrt(80.0 / (0.2 * 0.3))
    assert modes(model)[0][0] == pytest.approx(exact, rel=1e-3)


def test_a_rod_that_stretches_and_bends():
    """A chamber beside a uniform rod: an arc of angle p A r L / EI and length L (1 + p A / EA), to 0.25 % of it.

    And its first two modes under a heavy tip, straight: cantilever and bar with a tip mass, each to 1 %.
    """
    L, m, m_tip, EI, EA, n = 0.3, 0.2, 0.6, 0.05, 120.0, 8
    beside = Chamber.at_offset(2e-4, 0.02, np.ones(n))
    rod = chain_model(
        length=L, mass=m, tip_mass=m_tip, links=n, joint_placement="midsegment", stiffness=EI * n / L, damping=0.0,
        chambers=(beside,), extensions=(Extension(EA),),
    )
    angle, length = 5e4 * 2e-4 * 0.02 * L / EI, L * (1.0 + 5e4 * 2e-4 / EA)
    arc = length / angle * np.array([np.cos(angle) - 1.0, np.sin(angle)])
    tip = mechanics_of(rod).tips(mechanics_of(rod).coordinates(equilibrium(rod, 5e4)))[-1]
    np.testing.assert_allclose(tip, arc, atol=2.5e-3 * length)

    def cantilever(b):  # 1 + cos cosh + m_tip / m b (cos sinh - sin cosh) = 0
        c, s, ch, sh = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        return 1.0 + c * ch + m_tip / m * b * (c * sh - s * ch)

    bends = brentq(cantilever, 0.1, 1.9) ** 2 / (2 * np.pi) * np.sqrt(EI / (m * L**3))
    stretches = brentq(lambda b: b * np.tan(b) - m / m_tip, 1e-3, 1.5) / (2 * np.pi) * np.sqrt(EA / (m * L))
    found = modes(rod)[0]
    assert found[0] == pytest.approx(bends, rel=0.01)
    assert np.abs(found / stretches - 1.0).min() < 0.01


def test_a_pendulum_on_a_spring():
    """A mass on an elastic thread: g / (L + stretch) swings, EA / m L bounces."""
    model = rod("tip")
    length = 0.3 * (1.0 + 0.2 * 9.81 / 80.0)
    swing, bounce = np.sqrt(9.81 / length), np.sqrt(80.0 / (0.2 * 0.3))
    assert 2 * np.pi * modes(model)[0] == pytest.approx(sorted([swing, bounce]), rel=1e-6)


def test_chambers_of_known_geometry_bend_and_lengthen_from_two_numbers():
    """Opposite sides at one pressure: no bending, p (A + A) / EA of strain; one alone: p A r / K at every joint."""
    pair = [Chamber.at_offset(2e-4, r, [1, 1], name=n) for n, r in (("left", 0.02), ("right", -0.02))]
    model = chain_model(length=0.1, mass=0.1, links=2, stiffness=1.5, damping=0.0, chambers=tuple(pair),
                        extensions=(Extension(150.0),))  # fmt: skip
    assert equilibrium(model, [3e4, 3e4]) == pytest.approx([0.0, 0.0, 2 * 3e4 * 2e-4 / 150.0], abs=1e-15)
    bent = 3e4 * 2e-4 * 0.02 / 1.5
    assert equilibrium(model, [3e4, 0.0]) == pytest.approx([bent, bent, 3e4 * 2e-4 / 150.0], rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [Memory(), Memory(creep_share=(0.2,), creep_time=(0.3,))], ids=["none", "creep"])
def test_march_and_reference_agree_and_balance(arm, memory):
    model = arm.with_(memory=memory)
    inputs = (Pulse(3e4, 0.02, 0.1), Pulse(1e4, 0.05, 0.1), Pulse(2e4, 0.0, 0.15))
    fine = pliant.simulate(model, inputs, duration=0.2, time_step=2.5e-4)
    exact = pliant.simulate(model, inputs, times=fine.time.values, method="LSODA", rtol=1e-9)
    for name, size in (("tip_position", 2e-5), ("axial_strain", 5e-4)):
        coarse = pliant.simulate(model, inputs, times=fine.time.values[::4], time_step=5e-4)
        errors = [float(np.abs(m[name] - exact[name]).max()) for m in (coarse, fine)]
        assert errors[1] < size
        assert 3.0 < errors[0] / errors[1] < 5.0, "second order"
    names = ("kinetic_energy", "elastic_energy", "gravitational_energy", "dissipated_energy")
    total = sum(exact[k] for k in names) - exact.input_work
    total = total + (exact.memory_energy + exact.memory_dissipation if memory else 0.0)
    assert np.abs(total - total[0]).max() < 1e-6 * float(exact.input_work.max())
    assert fine.attrs["energy_gain"] < 1e-3


def test_a_stepper_takes_the_steps_of_a_march(arm):
    stepper = pliant.Stepper(arm, 2.5e-4)
    held = pliant.simulate(arm, [Pulse(p, 0.0) for p in (3e4, 1e4, 0.0)], duration=0.05, time_step=2.5e-4)
    for _ in range(200):
        stepper.step([3e4, 1e4, 0.0])
    np.testing.assert_allclose(stepper.tips(), held.tip_position[-1], atol=1e-9)
    np.testing.assert_allclose(stepper.strain, held.axial_strain[-1], atol=1e-9)
    saved = stepper.snapshot()
    stepper.step([0.0, 0.0, 0.0])
    stepper.restore(saved)
    np.testing.assert_allclose(stepper.strain, held.axial_strain[-1], atol=1e-9)


def test_a_body_at_rest_stays_there(arm):
    motion = pliant.simulate(arm, [Pulse(p, -1.0, 9.0) for p in (2e4, 1e4, 5e3)], duration=0.05, time_step=5e-4)
    for name in ("joint_angle", "axial_strain"):
        assert np.abs(motion[name] - motion[name][0]).max() < 1e-10
    assert motion.extension[0].values == pytest.approx(motion.axial_strain[0].values * 0.1)


def test_stations_lengthen_with_their_link(arm):
    """A point half-way along a link stays half-way; the strains that a link shares add up."""
    points = (("quarter", 1, 0.5 * arm.link_length[1]), ("tip", 3, float(arm.link_length[3])))
    model = arm.with_(stations=points)
    x = np.append(np.full(4, 0.3), [0.1, 0.2])
    places, tips = mechanics_of(model).stations(x)[0], mechanics_of(model).tips(x)
    np.testing.assert_allclose(places[0], 0.5 * (tips[0] + tips[1]), atol=1e-15)
    np.testing.assert_allclose(places[1], tips[3], atol=1e-15)
    assert np.linalg.norm(tips[1] - tips[0]) == pytest.approx(0.05 * (1 + 0.5 * (0.1 + 0.2)))  # half in each segment
    first = 1.1 * np.array([-0.05 * np.sin(0.3), 0.025 + 0.05 * np.cos(0.3)])  # the part before the joint lengthens too
    np.testing.assert_allclose(tips[0], first, atol=1e-15)


def test_what_cannot_follow_a_lengthening_body_says_so(arm):
    with pytest.raises(InputError, match=r"body of fixed length, but 'model' lengthens \(near, far\)"):
        fixed_length(arm)
    with pytest.raises(InputError, match="body of fixed length"):
        mechanics_of(arm).tips(np.zeros(4))
    with pytest.raises(InputError, match="expected 6 finite numbers for 4 joint angles and 2 strains"):
        pliant.simulate(arm, [Pulse(0.0)] * 3, duration=0.1, initial_angle=np.zeros(4))
    with pytest.raises(SimulationError, match="compressed to nothing"):
        equilibrium(rod(gravity=[0.0, -900.0], stiffness=100.0))


@pytest.mark.parametrize(
    "door",
    [
        lambda m: AdaptiveObserver(m, 4e-3),
        lambda m: equilibria(m, 1e4), lambda m: LinkAngles(m, [0.0, 0.2]),
        lambda m: moment_arms(m, np.zeros((1, 2)), np.array([0]), np.array([0.1])),
        lambda m: momentum_residual(m, np.zeros(3), np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(3)),
    ],
)  # fmt: skip
def test_doors_that_cannot_follow_refuse(door):
    one = chain_model(length=0.2, mass=0.1, links=2, stiffness=1.0, damping=0.01, torque=(1e-6,), axial_gain=50.0,
                      extensions=(Extension(150.0),))  # fmt: skip
    with pytest.raises(InputError, match="lengthens"):
        door(one)


@pytest.mark.parametrize(
    ("extensions", "sentence"),
    [
        ((Extension(9.0, name="a"), Extension(9.0, name="a")), "different names"),
        ((Extension(9.0, name="a"), Extension(9.0, 0.0, 0.1, name="b")), "must not overlap"),
        ((Extension(9.0, 0.0, 0.3, name="a"),), "lies beyond the body, which is 0.2 m long"),
        ((3.0,), "must be Extension objects"),
    ],
)
def test_segments_that_are_none(arm, extensions, sentence):
    with pytest.raises(InputError, match=sentence):
        arm.with_(extensions=extensions)


@pytest.mark.parametrize("mass_at", ["rod", "tip"])
@pytest.mark.parametrize("base", [0.0, 0.02])
def test_more_strains_than_masses_are_refused_and_nothing_else(mass_at, base):
    """For every number of links and segments: a sentence where the masses are too few, else natural frequencies."""
    for n in (1, 2, 3):
        for count in (1, 2, 3, 4):
            edges = np.linspace(0.0, base + 0.05 * n, count + 1)
            segments = [Extension(200.0, 1.0, a, b, f"s{k}") for k, (a, b) in enumerate(pairwise(edges))]
            values = {"link_length": [0.05] * n, "link_mass": 0.01, "stiffness": 1.0, "damping": 5e-3, "torque": 6e-7}
            values |= {"extensions": tuple(segments), "mass_at": mass_at, "base_length": base}
            if count > n + (1 if base and mass_at == "rod" else 0):  # a rod's two ends move apart
                with pytest.raises(InputError, match=f"cannot follow {count} independent strains"):
                    Model(**values)
                continue
            body = Model(**values)
            frequencies = modes(body)[0]
            assert np.isfinite(frequencies).all()
            assert frequencies.min() > 0


def test_a_chamber_pushes_segments_that_there_are(arm):
    chamber = Chamber((1e-6,), axial_gain=[50.0, 0.0, 1.0])
    with pytest.raises(InputError, match=r"axial_gain must be one number or 2 \(one for each segment\), got 3"):
        arm.with_(chambers=(chamber,))
    for bad in ({"stiffness": 0.0}, {"stiffness": 9.0, "damping": -1.0}, {"stiffness": 9.0, "start": 0.2, "stop": 0.1}):
        with pytest.raises(InputError, match="extension 'body'"):
            Extension(**bad)


def test_the_model_file_keeps_segments(arm, tmp_path):
    file = pliant.save_model(arm, tmp_path / "model.json")
    assert pliant.load_model(file) == arm
