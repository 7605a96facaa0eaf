"""A rod that lengthens under its chambers: closed forms of a bar, and what its markers see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import gradient_and_hessian, mass_matrix
from scipy.linalg import eigh

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, chain_model
from pliant.simulation import equilibrium, modes
from pliant.testbed import Laboratory, generate
from pliant.testbed.laboratory import MotionCapture
from pliant.testbed.rod import ChamberParameters, actuator, build_body
from pliant.testbed.scenarios import scenario
from pliant.testbed.stepping import rest_state, settle, simulate

BAR = actuator("lengthening").uniform()
AREA, EA, LENGTH = BAR.chamber_area, BAR.axial_stiffness, BAR.length
BALANCED = (0.85e5, 1e5, 0.0, 0.0, 0.0)  # opposite moments cancel


def test_balanced_pressures_stretch_the_bar_by_p_a_over_ea():
    state = settle(BAR, BALANCED)
    assert state.x[-1] == pytest.approx([0.0, LENGTH * (1.0 + 1.85e5 * AREA / EA)], abs=1e-12)
    assert state.chamber[:, 0] == pytest.approx(np.full(2, LENGTH * AREA * 1.85e5 * AREA / EA), rel=1e-9)


def test_a_chamber_stretches_its_part_alone():
    """Ends within an element: that share of it is pushed."""
    p = replace(BAR, elements=7, chambers=(ChamberParameters("base", 0.0, 0.4, gain=1e-9, push=0.5),))
    assert settle(p, (1e5, 0.0, 0.0, 0.0)).x[-1, 1] == pytest.approx(LENGTH * (1 + 0.4 * 0.5e5 * AREA / EA), abs=1e-9)


def test_a_hanging_bar_grows_by_half_its_weight():
    """w L / 2 EA of its own weight w, as of rho g L^2 / 2 E; a force at the tip adds F L / EA."""
    p = replace(BAR, gravity=(0.0, 9.81))
    grown = settle(p, (0.0, 0.0, 0.0, 0.3, 0.0)).x[-1, 1] - LENGTH
    assert grown == pytest.approx(LENGTH * (0.5 * p.mass * 9.81 + 0.3) / EA, rel=1e-9)


def test_first_longitudinal_mode_is_that_of_a_bar():
    """(1/4L) sqrt(E / rho), by its eigenvector among all modes, and the second at three times that."""
    x = rest_state(build_body(BAR)).x
    _, stiffness = gradient_and_hessian(BAR, x.copy(), (0.0,) * 5)
    values, vectors = eigh(stiffness, mass_matrix(BAR))
    along = np.sum(vectors[1::2] ** 2, axis=0) > 0.99 * np.sum(vectors**2, axis=0)
    exact = 0.25 / LENGTH * np.sqrt(EA * LENGTH / BAR.mass)
    assert np.sqrt(values[along][:2]) / (2 * np.pi) == pytest.approx([exact, 3 * exact], rel=1e-3)


def test_bending_is_that_of_the_body_of_fixed_length_where_the_layer_is_stiff():
    """With and without thrust, under p A / EA of 1e-4 and 1e-5, the shapes draw together in proportion."""
    load, apart = (1.2e5, 4e4, 0.05, -0.02, 0.0), []
    for ea in (2e5, 2e6):
        p = replace(BAR, axial_stiffness=ea)
        fixed = replace(p, chambers=actuator("antagonistic").chambers)
        apart.append(np.abs(settle(p, load).x - settle(fixed, load).x).max())
    assert apart[0] < 3e-5
    assert apart[1] == pytest.approx(0.1 * apart[0], rel=0.02)


def test_hessian_and_the_work_of_both_pressures(rng):
    p = replace(BAR, elements=9, gravity=(3.0, -5.0), cap_mass=0.006, gain_slope=0.004)
    x = settle(p).x + 2e-4 * rng.standard_normal((11, 2))
    x[0] = 0.0
    load, step = (1e5, 6e4, 0.1, -0.2, 0.01), 1e-8
    _, hessian = gradient_and_hessian(p, x, load)
    for k in range(0, hessian.shape[0], 3):
        moved = np.zeros_like(x)
        moved[1 + k // 2, k % 2] = step
        up, down = (gradient_and_hessian(p, x + s * moved, load)[0] for s in (1, -1))
        assert hessian[:, k] == pytest.approx((up - down) / (2 * step), abs=2e-6 * np.abs(hessian).max())
    time = np.arange(1200) * 2.5e-4
    loads = np.zeros((1200, 5))
    loads[:, :2] = np.sin(np.pi * np.outer(time, (5.0, 7.0))) ** 2 * (1.1e5, 8e4)
    m = simulate(p, loads, 2.5e-4, stride=1)
    work = np.cumsum(np.sum(0.5 * (m.pressure[1:] + m.pressure[:-1]) * np.diff(m.volume, axis=0), axis=1))
    energy = m.energy.sum(axis=1)
    assert np.abs(work - (energy[1:] - energy[0])).max() < 2e-3 * np.ptp(energy)
    assert np.ptp(m.position[:, 9, 1]) > 0.01


def test_a_chain_that_lengthens_rests_and_rings_as_the_rod():
    """Under uneven pressures, slanted weight and a force at the tip; first two modes bent by pressure: within 1 %."""
    p, n, parts = replace(BAR, gravity=(3.0, -9.0)), 12, 3
    cuts = np.linspace(0.0, LENGTH, parts + 1)
    sides = (("left", p.chamber_height), ("right", -0.85 * p.chamber_height))
    chain = chain_model(
        length=LENGTH, mass=p.mass, links=n, joint_placement="midsegment", gravity=p.gravity, damping=0.0,
        stiffness=p.bending_stiffness * n / LENGTH,
        extensions=tuple(Extension(EA, 0.0, *cuts[k : k + 2], f"part_{k}") for k in range(parts)),
        chambers=tuple(Chamber.at_offset(AREA, offset, np.ones(n), name=name) for name, offset in sides),
    )
    still, pressures = np.array([0.0, LENGTH]), (1.2e5, 4e4)
    for force in ((0.0, 0.0), (0.1, -0.15)):
        rod = settle(p, (*pressures, *force, 0.0)).x
        rest = mechanics_of(chain).coordinates(equilibrium(chain, pressures, np.array(force)))
        tip = mechanics_of(chain).tips(rest)[-1]
        assert np.linalg.norm(tip - rod[-1]) < 0.01 * np.linalg.norm(rod[-1] - still)
        bent, straight = np.linalg.norm(np.diff(rod, axis=0), axis=1).sum(), settle(p, (0.0,) * 5).x
        assert bent > 1.05 * np.linalg.norm(np.diff(straight, axis=0), axis=1).sum()  # it does lengthen
    rod = settle(p, (*pressures, 0.0, 0.0, 0.0)).x
    _, stiffness = gradient_and_hessian(p, rod.copy(), (*pressures, 0.0, 0.0, 0.0))
    exact = np.sqrt(eigh(stiffness, mass_matrix(p), eigvals_only=True)[:2]) / (2 * np.pi)
    assert modes(chain, equilibrium(chain, pressures))[0][:2] == pytest.approx(exact, rel=0.01)


def test_markers_ride_on_the_stretched_body():
    case = replace(scenario("pulse_85+100_300ms"), duration=0.6)
    lab = Laboratory(output="markers", mocap=MotionCapture(noise=0.0, drop_out=0.0, stand_off=0.0))
    made = generate(case, "lengthening", lab=lab)
    seen, true = made.recording["position"].values, made.truth["position"].values
    far = [np.linalg.norm(seen[:, -1] - seen[:, :3].mean(axis=1), axis=1), true[:, 100, :]]
    base = np.array([0.0, -0.01, 0.02 / 3.0])
    assert far[0] == pytest.approx(np.hypot(np.linalg.norm(far[1] - base[:2], axis=1), base[2]), abs=2e-5)
    assert np.ptp(true[:, 100, 1]) > 0.01


def test_a_push_is_never_negative():
    with pytest.raises(InputError, match="push of chamber 'x' must be finite and >= 0"):
        ChamberParameters("x", push=-1.0)
