"""The rod against closed forms, against chains in other coordinates, and against itself at half the step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import chain_modes, chain_statics, gradient_and_hessian, rod_frequencies
from scipy.linalg import eigh

from pliant.errors import InputError, SimulationError
from pliant.testbed.laboratory import Laboratory, run_rod
from pliant.testbed.rod import RodParameters, actuator, build_body, material_fields
from pliant.testbed.scenarios import SCENARIOS
from pliant.testbed.stepping import settle, simulate

EI = 1.6067 * 0.034  # N m2: the paper's joint stiffness times its link length
EXACT = 7.104  # Hz: 1.8751^2 / (2 pi L^2) sqrt(EI L / m) with 69 g, 0.17 m
CANTILEVER = RodParameters().uniform(bending_stiffness=EI)


def test_first_frequencies_of_the_uniform_cantilever():
    exact = np.array([1.875104, 4.694091, 7.854757]) ** 2 / (2 * np.pi * 0.17**2) * np.sqrt(EI * 0.17 / 0.069)
    assert exact[0] == pytest.approx(EXACT, rel=1e-4)
    assert rod_frequencies(CANTILEVER) == pytest.approx(exact, rel=0.005)


def test_first_frequency_in_time():
    dt = 2.5e-4
    start = settle(CANTILEVER, (0.0, 0.002, 0.0, 0.0))
    tip = simulate(CANTILEVER, np.zeros((16_000, 4)), dt, stride=1, start=start).position[:, -1, 0]
    window = np.hanning(tip.size)
    spectrum = np.abs(np.fft.rfft(tip * window, 16 * tip.size))
    frequency = np.fft.rfftfreq(16 * tip.size, dt)[np.argmax(spectrum)]
    assert frequency == pytest.approx(EXACT, rel=0.005)


def test_end_moment_bends_the_rod_into_a_circle():
    moment = 0.3
    kappa = moment / EI
    state = settle(CANTILEVER, (0.0, 0.0, 0.0, moment))
    assert state.curvature == pytest.approx(np.full(100, kappa), rel=1e-9)
    h = 0.17 / 100
    radius = h / 2 / np.sin(kappa * h / 2)
    assert np.hypot(state.x[:, 0] + radius, state.x[:, 1]) == pytest.approx(np.full(101, radius), abs=1e-9)
    turned = kappa * 0.17
    assert state.x[-1] == pytest.approx([-(1 - np.cos(turned)) / kappa, np.sin(turned) / kappa], abs=1e-5)


@pytest.mark.parametrize("node", [0, 60])
def test_a_small_force_at_a_node_bends_the_rod_as_the_beam_does(node):
    """Deflection of a cantilever of length L under F at a: F a^2 (3 x - a) / (6 EI) beyond a."""
    push, a = 1e-3, 0.17 * (node or 100) / 100
    state = settle(replace(CANTILEVER, pushed_node=node), (0.0, -push, 0.0, 0.0))
    assert -state.x[-1, 0] == pytest.approx(push * a**2 * (3 * 0.17 - a) / (6 * EI), rel=2e-3)


def test_pressure_alone_is_an_end_moment():
    p = replace(CANTILEVER, gain=1.5)
    gain = p.chamber_area * p.chamber_height * p.gain
    pressed = settle(p, (2e5, 0.0, 0.0, 0.0))
    assert pressed.curvature == pytest.approx(np.full(100, 2e5 * gain / p.bending_stiffness), rel=1e-9)


def test_static_shape_agrees_with_a_chain_of_200_links():
    """Weight, tip force and pressure on a rod of varying stiffness."""
    p = replace(actuator("a").uniform(), stiffness_variation=0.15, rest_curvature=3.0, rest_variation=1.6,
                gain_variation=0.13, end_stiffening=0.35, gain=1.8, elements=200, gravity=(6.0, -7.0))  # fmt: skip
    load = (1.2e5, 0.15, -0.1, 0.0)
    chain = chain_statics(p, 200, load)
    rod = settle(p, load).x
    assert np.linalg.norm(rod - chain, axis=1).max() < 1e-4
    assert np.linalg.norm(chain[-1] - settle(replace(p, gravity=(0.0, 0.0))).x[-1]) > 0.03  # the loads do bend it


VARIED = replace(actuator("a").uniform(), stiffness_variation=0.15, rest_curvature=3.0, rest_variation=1.6)


@pytest.mark.parametrize("p", [VARIED, replace(VARIED, cap_mass=0.0065)], ids=["free tip", "cap"])
def test_two_frequencies_agree_with_a_fine_hinge_chain(p):
    assert rod_frequencies(p, 2) == pytest.approx(chain_modes(p), rel=0.005)


def test_two_frequencies_agree_with_a_second_simulator():
    mujoco = pytest.importorskip("mujoco", reason="the second simulator comes with the extra `bench`")
    n, p = 100, CANTILEVER
    h = p.length / n
    body = f'<geom type="capsule" fromto="0 0 0 0 {h} 0" size="0.0005" mass="{p.mass / n}"/>'
    joint = f'<joint type="hinge" axis="0 0 1" pos="0 {h / 2} 0"/>'
    text = ""
    for k in reversed(range(n)):
        text = f'<body pos="0 {h if k else 0} 0">{joint}{body}{text}</body>'
    xml = f'<mujoco><option gravity="0 0 0"/><compiler angle="radian"/><worldbody>{text}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((n, n))
    try:
        mujoco.mj_fullM(model, mass, data.qM)
    except (TypeError, AttributeError):
        mujoco.mj_fullM(model, data, mass)
    stiffness = np.eye(n) * p.bending_stiffness / h
    other = np.sqrt(eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, 1])) / (2 * np.pi)
    assert rod_frequencies(p, 2) == pytest.approx(other, rel=0.02)


def test_hessian_is_the_derivative_of_the_gradient(rng):
    p = replace(actuator("a"), elements=12, gravity=(3.0, -5.0))
    state = settle(p)
    x = state.x + 2e-4 * rng.standard_normal(state.x.shape)
    x[0] = 0.0
    load = (1e5, 0.1, -0.2, 0.01)
    wall = np.array([[1.0, 1.0, 0.0, -0.02, 4e3, 0.3, 1e-3], [0.0, -0.05, 0.16, 0.012, 4e3, 0.0, 1e-3]])
    _, hessian = gradient_and_hessian(p, x, load, state, wall)
    numeric = np.empty_like(hessian)
    for k in range(hessian.shape[0]):
        step = np.zeros_like(x)
        step[1 + k // 2, k % 2] = 1e-8
        up, _ = gradient_and_hessian(p, x + step, load, state, wall)
        down, _ = gradient_and_hessian(p, x - step, load, state, wall)
        numeric[:, k] = (up - down) / 2e-8
    assert hessian == pytest.approx(numeric, abs=2e-6 * np.abs(hessian).max())


def test_pressure_forces_are_the_gradient_of_the_volume(rng):
    from pliant.testbed.stepping_loops import curvatures, volume

    p = replace(actuator("b"), elements=20)
    body, x = build_body(p), settle(p, (1e5, 0.0, 0.0, 0.0)).x

    def chamber(nodes):
        kappa = np.zeros(body.weight.size)
        curvatures(nodes, body, kappa)
        return volume(0, kappa, body.rest_length, body)

    force = gradient_and_hessian(p, x, (0.0, 0, 0, 0))[0] - gradient_and_hessian(p, x, (1e5, 0, 0, 0))[0]
    for _ in range(5):
        step = 1e-6 * rng.standard_normal(x.shape)
        step[0] = 0.0
        work = force @ step[1:].ravel()
        assert work == pytest.approx(1e5 * (chamber(x + step) - chamber(x - step)) / 2, rel=1e-5)


def test_pressure_volume_and_energy_balance_in_motion():
    """Work p dV minus the gain of energy is dissipation: it only grows; without losses it stays zero."""
    case = SCENARIOS["pulse_119_short"]
    for p, losses in ((actuator("a"), True), (actuator("a").uniform(gain=1.8, linear=False), False)):
        time = np.arange(4000) * 2.5e-4
        loads = np.zeros((4000, 4))
        loads[:, 0] = 119e3 * 0.5 * (1 - np.cos(2 * np.pi * np.minimum(time / case.duration * 4, 1.0)))
        m = simulate(p, loads, 2.5e-4, stride=1)
        work = np.cumsum(0.5 * (m.pressure[1:] + m.pressure[:-1]) * np.diff(m.volume))
        energy = m.energy.sum(axis=1)
        lost = work - (energy[1:] - energy[0])
        assert np.diff(lost).min() > -1e-6 * energy.max()
        assert (lost[-1] > 0.02 * energy.max()) if losses else (abs(lost[-1]) < 1e-3 * energy.max())


def test_energy_never_grows_without_input():
    for p in (actuator("a"), CANTILEVER):
        start = settle(p, (0.0, -0.2, 0.1, 0.01))
        energy = simulate(p, np.zeros((4000, 4)), 2.5e-4, stride=1, start=start).energy.sum(axis=1)
        assert energy[0] > 1e-4
        assert np.diff(energy).max() <= 1e-7 * energy[0]
    assert energy[-1] > 0.95 * energy[0]  # the undamped rod keeps swinging


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pulse_119", "step_240"])
def test_halving_step_and_elements_moves_the_tip_path_by_less_than_50_um(name):
    case, p, lab = replace(SCENARIOS[name], duration=1.6), actuator("a"), Laboratory()
    tip = run_rod(case, p, lab).position[:, p.elements]
    finer_step = run_rod(replace(case, time_step=case.time_step / 2), p, lab).position[:, p.elements]
    finer_rod = run_rod(case, replace(p, elements=2 * p.elements), lab).position[:, 2 * p.elements]
    assert np.linalg.norm(finer_step - tip, axis=1).max() < 5e-5
    assert np.linalg.norm(finer_rod - tip, axis=1).max() < 5e-5


@pytest.mark.slow
def test_actuator_resembles_the_papers():
    """Rest bend about 30 degrees, ringing near 5 Hz with a damping ratio near 0.08, below the cap's curvature."""
    p = actuator("a")
    m = run_rod(SCENARIOS["pulse_119"], p, Laboratory())
    bend = np.degrees((m.curvature * build_body(p).weight).sum(axis=1))
    rest, plateau = bend[100], bend[2700]
    assert 25 < rest < 35
    assert 30 < plateau - rest < 60
    ring = bend[150:1500] - plateau
    peaks = np.flatnonzero((ring[1:-1] > ring[:-2]) & (ring[1:-1] > ring[2:])) + 1
    assert 1e3 / np.diff(peaks[:4]).mean() == pytest.approx(5.0, rel=0.05)
    decrement = np.log(ring[peaks[:3]] / ring[peaks[1:4]]).mean()
    assert decrement / (2 * np.pi) == pytest.approx(0.08, abs=0.015)
    hard = run_rod(replace(SCENARIOS["step_240"], duration=1.5), p, Laboratory()).curvature
    assert hard.max() < 0.8 * p.cap_curvature


def test_section_law_softens_and_locks():
    soft = RodParameters().uniform(linear=False, locking=0.0)
    hard = replace(soft, locking=2.0)
    linear = settle(RodParameters().uniform(), (0, 0, 0, 0.3)).curvature[50]
    assert settle(soft, (0, 0, 0, 0.3)).curvature[50] > 1.1 * linear
    assert settle(hard, (0, 0, 0, 0.3)).curvature[50] < settle(soft, (0, 0, 0, 0.3)).curvature[50]


def test_actuators_differ_and_fields_do_not_depend_on_the_mesh():
    a, b = actuator("a"), actuator("b")
    s = np.linspace(0, 0.17, 50)
    assert np.abs(material_fields(a, s)["stiffness"] / material_fields(b, s)["stiffness"] - 1).max() > 0.1
    coarse = material_fields(a, s)["gain"]
    assert material_fields(a, s[::7])["gain"] == pytest.approx(coarse[::7], rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"length": 0.0}, "length must be > 0"), ({"mass": np.nan}, "mass must be finite"),
     ({"elements": 2}, "4 elements"), ({"prony_time": (1.0,)}, "Prony"),
     ({"slip_share": -0.1}, "slip_share must be >= 0"), ({"pushed_node": 102}, "pushed_node must be at most 101")],
)  # fmt: skip
def test_bad_parameters_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(RodParameters(), **change)


def test_unknown_actuator_and_bad_loads_are_refused():
    with pytest.raises(InputError, match="unknown actuator 'z'"):
        actuator("z")
    with pytest.raises(InputError, match="4 columns"):
        simulate(actuator("a"), np.zeros((3, 2)), 1e-3)
    with pytest.raises(InputError, match="7 numbers"):
        simulate(actuator("a"), np.zeros((3, 4)), 1e-3, obstacles=[[1.0, 2.0]])
    with pytest.raises(InputError, match="step must be > 0"):
        simulate(actuator("a"), np.zeros((3, 4)), 0.0)


def test_a_rod_that_cannot_follow_says_so():
    loads = np.zeros((200, 4))
    loads[:, 3] = -50.0  # folds the section flat
    with pytest.raises(SimulationError, match=r"the rod .* at 0\.\d+ s"):
        simulate(actuator("a"), loads, 1e-3)
