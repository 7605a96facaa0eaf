"""Bodies of two chambers: closed forms, a chain in other coordinates, energy, and their recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import chain_statics, gradient_and_hessian

from pliant.errors import InputError
from pliant.recording import check_recording, read
from pliant.testbed import Laboratory, generate, generate_file
from pliant.testbed.laboratory import run_rod
from pliant.testbed.plant import Plant
from pliant.testbed.rod import CHAMBERS, ChamberParameters, RodParameters, actuator, build_body
from pliant.testbed.scenarios import scenario
from pliant.testbed.stepping import settle, simulate
from pliant.testbed.truth import read_truth
from pliant.testbed.valve import PressureSensor, SupplyRegulator

LINEAR = {name: actuator(name).uniform() for name in CHAMBERS}
LEVER = 1.5708e-4 * 4.2441e-3  # m3: A d of the chamber
EI = LINEAR["two_segment"].bending_stiffness


def test_two_segments_bend_into_two_arcs():
    """A weightless linear rod: each half a circular arc of curvature p A d G / EI, whatever the other half does."""
    near, far = 9e4, 1.4e5
    p = LINEAR["two_segment"]
    state = settle(p, (near, far, 0.0, 0.0, 0.0))
    kappa = near * LEVER / EI, far * 0.85 * LEVER / EI
    assert state.curvature[:50] == pytest.approx(np.full(50, kappa[0]), rel=1e-9)
    assert state.curvature[51:] == pytest.approx(np.full(49, kappa[1]), rel=1e-9)
    turn = np.array([0.0, 0.5 * p.length * kappa[0], 0.5 * p.length * (kappa[0] + kappa[1])])
    x = -(np.cos(turn[:-1]) - np.cos(turn[1:])) / kappa
    y = (np.sin(turn[1:]) - np.sin(turn[:-1])) / kappa
    assert state.x[-1] == pytest.approx([x.sum(), y.sum()], abs=1e-5)
    assert np.abs(state.x[-1] - [0.0, p.length]).max() > 0.02


@pytest.mark.parametrize("name", ["two_segment", "antagonistic"])
def test_static_shape_agrees_with_a_chain_of_200_links(name):
    """Weight, tip force and two pressures on a rod of varying stiffness."""
    p = replace(LINEAR[name], stiffness_variation=0.15, rest_curvature=3.0, rest_variation=1.6, gain_variation=0.13,
                end_stiffening=0.35, gain=1.8, elements=200, gravity=(6.0, -7.0))  # fmt: skip
    load = (1.2e5, 7e4, 0.15, -0.1, 0.0)
    rod = settle(p, load).x
    assert np.linalg.norm(rod - chain_statics(p, 200, load), axis=1).max() < 1e-4
    assert np.linalg.norm(rod[-1] - settle(p, (1.2e5, 0.0, 0.15, -0.1, 0.0)).x[-1]) > 8e-3


def test_opposite_chambers_of_equal_moment_cancel_and_alone_are_mirror_images():
    p = replace(actuator("antagonistic"), rest_variation=0.0, cap_mass=0.0)
    balanced = (0.85e5, 1e5, 0.0, 0.0, 0.0)
    assert np.abs(settle(p, balanced).curvature).max() < 1e-9
    left, right = settle(p, (0.85e5, 0.0, 0.0, 0.0, 0.0)), settle(p, (0.0, 1e5, 0.0, 0.0, 0.0))
    assert left.curvature == pytest.approx(-right.curvature, rel=1e-8)
    assert left.curvature.mean() > 2.5
    moving = simulate(p, np.tile(balanced, (400, 1)), 2.5e-4)
    assert np.abs(moving.position[:, :, 0]).max() < 1e-9


def test_two_levers_that_grow_soften_the_body_between_them():
    """EI k = p_l g (1 + s k) - p_r g (1 - s k): the sum of the pressures softens, their difference bends."""
    slope, left, right = 4e-3, 2.5e5, 1.5e5
    p = replace(LINEAR["antagonistic"], gain_slope=slope)
    weaker = right * 0.85
    kappa = LEVER * (left - weaker) / (EI - slope * LEVER * (left + weaker))
    assert settle(p, (left, right, 0.0, 0.0, 0.0)).curvature == pytest.approx(np.full(100, kappa), rel=1e-9)
    assert kappa > 1.005 * LEVER * (left - weaker) / EI


def test_two_equal_chambers_in_series_under_one_pressure_are_the_plain_body():
    plain = replace(actuator("a"), tube_resistance=0.0)  # a chamber of half the volume would breathe half the air
    halves = replace(plain, chambers=(ChamberParameters("near", 0.0, 0.5), ChamberParameters("far", 0.5, 1.0)))
    pressure = 1.2e5 * np.minimum(np.arange(1200) / 200, 1.0)
    loads = np.zeros((1200, 5))
    loads[:, 0] = loads[:, 1] = pressure
    one, two = simulate(plain, loads[:, 1:], 2.5e-4), simulate(halves, loads, 2.5e-4)
    assert one.position == pytest.approx(two.position, abs=1e-9)
    assert one.pressure.shape == (301,)
    assert two.pressure.shape == two.volume.shape == (301, 2)
    assert two.volume.sum(axis=1) == pytest.approx(one.volume, rel=1e-7)


@pytest.mark.parametrize("name", list(CHAMBERS))
def test_hessian_is_the_derivative_of_the_gradient(name, rng):
    p = replace(actuator(name), elements=13, gravity=(3.0, -5.0))  # the chambers meet within an element
    state = settle(p)
    x = state.x + 2e-4 * rng.standard_normal(state.x.shape)
    x[0] = 0.0
    load = (1e5, 6e4, 0.1, -0.2, 0.01)
    _, hessian = gradient_and_hessian(p, x, load, state)
    numeric = np.empty_like(hessian)
    for k in range(hessian.shape[0]):
        step = np.zeros_like(x)
        step[1 + k // 2, k % 2] = 1e-8
        up, _ = gradient_and_hessian(p, x + step, load, state)
        down, _ = gradient_and_hessian(p, x - step, load, state)
        numeric[:, k] = (up - down) / 2e-8
    assert hessian == pytest.approx(numeric, abs=2e-6 * np.abs(hessian).max())


@pytest.mark.parametrize("name", list(CHAMBERS))
def test_the_work_of_both_pressures_is_energy_and_loss(name):
    """Work p dV of both chambers minus the gain of energy is dissipation: it only grows; without losses it is zero."""
    time = np.arange(4000) * 2.5e-4
    loads = np.zeros((4000, 5))
    for c, (level, rate) in enumerate(((1.1e5, 2.0), (8e4, 3.0))):
        loads[:, c] = level * np.sin(np.pi * rate * time) ** 2
    for p, losses in ((actuator(name), True), (actuator(name).uniform(gain=1.8, linear=False), False)):
        m = simulate(p, loads, 2.5e-4, stride=1)
        work = np.cumsum(np.sum(0.5 * (m.pressure[1:] + m.pressure[:-1]) * np.diff(m.volume, axis=0), axis=1))
        energy = m.energy.sum(axis=1)
        lost = work - (energy[1:] - energy[0])
        assert np.diff(lost).min() > -1e-6 * energy.max()
        assert (lost[-1] > 0.02 * energy.max()) if losses else (abs(lost[-1]) < 1e-3 * energy.max())


def test_gains_do_not_depend_on_where_elements_end():
    """The moment that a chamber makes in all is that of its part of the body."""
    for elements in (100, 101, 7):
        p = LINEAR["two_segment"].uniform(elements=elements, cap_mass=0.006)
        body = build_body(p)
        assert body.gain @ body.weight == pytest.approx(0.5 * p.length * LEVER * np.array([1.0, 0.85]), rel=1e-12)


@pytest.mark.slow
def test_each_chamber_follows_its_own_command_through_its_own_valve():
    truth = generate("in_turn", "two_segment").truth
    time, pressure = truth["record_time"].values, truth["pressure"].values
    assert truth["pressure"].dims == ("record", "chamber")
    assert np.interp(1.2, time, pressure[:, 0]) == pytest.approx(1.2e5, rel=0.01)
    assert np.interp(3.4, time, pressure[:, 1]) == pytest.approx(1.2e5, rel=0.01)
    assert np.abs(pressure[time < 2.3, 1]).max() < 0.02e5  # what the bending near half breathes through its tube
    half = [np.interp(6e4, p[rise], (time - start)[rise]) for p, start in zip(pressure.T, (0.12, 2.3), strict=True)
            for rise in [(time > start) & (time < start + 0.06)]]  # fmt: skip
    assert half[1] > half[0] + 0.012  # the second valve is slower
    bend = truth["curvature"].values
    moved = [np.ptp(bend[(truth["time"].values > t0) & (truth["time"].values < t1)], axis=0) for t0, t1 in
             ((0.0, 1.3), (2.3, 3.5))]  # fmt: skip
    assert moved[0][:45].mean() > 4 * moved[0][55:].mean()
    assert moved[1][55:].mean() > 4 * moved[1][:45].mean()


def test_a_recording_of_two_chambers_has_their_names_and_sensors_of_their_own(tmp_path):
    case = replace(scenario("pulse_120+60_500ms"), duration=0.6)
    quiet = PressureSensor(noise=0.0, resolution=0.0)
    made = generate(case, "antagonistic", 3, lab=Laboratory(transducer=quiet))
    check_recording(made.recording)
    assert made.recording["pressure"].dims == ("pressure_time", "chamber")
    assert made.recording["chamber"].values.tolist() == ["left", "right"]
    seen = made.recording["pressure"].values
    true = np.stack([np.interp(made.recording["pressure_time"], made.truth["record_time"], p)
                     for p in made.truth["pressure"].values.T], axis=1)  # fmt: skip
    bias = (seen - true).mean(axis=0)
    assert seen == pytest.approx(true + bias, abs=1e-6)
    assert 1.0 < abs(bias[0] - bias[1]) < 1000.0
    path, truth = tmp_path / "r.nc", tmp_path / "t.nc"
    assert generate_file(case, path, body="two_segment", truth=truth)
    assert not generate_file(case, path, body="two_segment", truth=truth)
    assert read(path)["chamber"].values.tolist() == ["near", "far"]
    assert read_truth(truth)["gain"].dims == ("chamber", "vertex")


@pytest.mark.parametrize("output", ["strain", "markers", "angle"])
def test_every_instrument_records_two_chambers(output):
    case = replace(scenario("pulse_120+60_500ms"), duration=0.4)
    ds = generate(case, "two_segment", 1, lab=Laboratory(output=output)).recording
    check_recording(ds)
    assert ds["pressure"].shape == (ds["pressure_time"].size, 2)


def test_what_does_not_fit_together_is_refused():
    brief = replace(scenario("in_turn"), duration=0.3)
    with pytest.raises(InputError, match=r"got 2 commands for a body of 1 chamber\(s\): give one, or one for each"):
        generate(brief, "a")
    three = Laboratory(valve=(SupplyRegulator(),) * 3)
    with pytest.raises(InputError, match=r"3 valves for a body of 2 chamber\(s\)"):
        run_rod(brief, actuator("two_segment"), three)
    with pytest.raises(InputError, match=r"loads must have 5 columns .*, got shape \(1, 4\)"):
        settle(actuator("two_segment"), (1e5, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="has 2 chambers: Plant supports one"):
        Plant("two_segment")
    with pytest.raises(InputError, match="must cover a part of the body"):
        ChamberParameters("x", 0.6, 0.4)
    with pytest.raises(InputError, match="gain of chamber 'x' must be finite and not 0"):
        ChamberParameters("x", gain=0.0)
    with pytest.raises(InputError, match="with different names"):
        RodParameters(chambers=(ChamberParameters(), ChamberParameters()))
    with pytest.raises(InputError, match="a pressure for each of several chambers"):
        scenario("pulse_120+400_500ms")
