"""The trajectory against SciPy's LSODA, BDF and Radau, its order of convergence, its balance of energy."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

from pliant import basic
from pliant.model import Model, Station, Valve
from pliant.simulation import Pulse, Step, Trace, equilibrium, modes, simulate

PULSE = Pulse(119e3, 0.1003, 0.4711)
TIMES = np.linspace(0, 1, 101)


def slope(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def energy_gap(run: xr.Dataset) -> np.ndarray:
    """Kinetic + elastic + gravitational energy less what the pressure gave and the dampers took, J."""
    stored = run.kinetic_energy + run.elastic_energy + run.gravitational_energy
    gap = stored - stored[0] - run.input_work + run.dissipated_energy
    return np.asarray(np.abs(gap))


@pytest.mark.parametrize(
    "valve",
    [
        Valve(), Valve(rise_time=0.03, fall_time=0.05),
        *(pytest.param(v, marks=pytest.mark.slow)
          for v in (Valve(natural_frequency=9.0), Valve(fall_time=0.03), Valve(rise_time=1e-3))),
    ],
)
def test_the_three_references_agree(paper, valve):
    model, pulse, times = paper.with_(valve=valve), Pulse(119e3, 0.0303, 0.1011), TIMES[:26]  # the rise and the fall
    runs = [simulate(model, pulse, times=times, method=m, rtol=1e-9) for m in ("LSODA", "BDF", "Radau")]
    for run in runs[1:]:
        assert np.abs(run.tip_position - runs[0].tip_position).max() < 2e-8  # m
        assert np.abs(run.input_work - runs[0].input_work).max() < 2e-8  # J
    marched = simulate(model, pulse, times=times, time_step=1e-4)
    assert np.abs(marched.tip_position - runs[0].tip_position).max() < 1e-6


@pytest.mark.slow
def test_the_reference_agrees_with_the_readable_page(paper):
    t, q = basic.pulse(basic.paper(), start=0.12, duration=0.1, end=0.3, rtol=1e-9)
    keep = np.append(np.diff(t) > 0, True)
    run = simulate(paper, Pulse(119e3, 0.12, 0.1), times=t[keep], method="LSODA", rtol=1e-10)
    assert np.abs(run.joint_angle.values - q[keep]).max() < 1e-7


@pytest.mark.slow
def test_the_reference_agrees_with_newton_euler_by_finite_differences(awkward):
    """An awkward chain: virtual work and Lagrange's equation from energies alone, nothing of the kernels."""
    l, m, n = awkward.link_length, awkward.link_mass, awkward.n

    def positions(q, at):
        phi = awkward.base_angle + np.cumsum(q + awkward.rest_angle)
        e = np.stack([-np.sin(phi), np.cos(phi)], axis=1)
        joints = np.vstack([np.zeros(2), np.cumsum(l[:, None] * e, axis=0)])[:-1] + awkward.first_joint
        return joints + (at * l)[:, None] * e, phi

    def lagrange(q, dq, p):
        def mass_matrix(q):
            J = np.imag([np.ravel(positions(q + 1e-30j * d, 0.5)[0]) for d in np.eye(n)]).T / 1e-30
            T = np.imag([positions(q + 1e-30j * d, 1.0)[0][-1] for d in np.eye(n)]).T / 1e-30
            W = np.tri(n)
            return J.T @ (np.repeat(m, 2)[:, None] * J) + W.T @ np.diag(m * l**2 / 12) @ W + awkward.tip_mass * T.T @ T

        def potential(q):
            height = positions(q, 0.5)[0] @ awkward.gravity
            return -(m @ height) - awkward.tip_mass * positions(q, 1.0)[0][-1] @ awkward.gravity

        h = 1e-6
        dM = np.array([(mass_matrix(q + h * d) - mass_matrix(q - h * d)) / (2 * h) for d in np.eye(n)])
        force = np.einsum("kij,k,j->i", dM, dq, dq) - 0.5 * np.einsum("kij,i,j->k", dM, dq, dq)
        slopes = np.array([potential(q + h * d) - potential(q - h * d) for d in np.eye(n)]) / (2 * h)
        drive = awkward.joint_gain * (awkward.torque[0] * p + awkward.torque[1] * p**2)
        return np.linalg.solve(
            mass_matrix(q), drive - awkward.stiffness * q - awkward.damping * dq - slopes - force
        )

    q0 = equilibrium(awkward)
    run = simulate(awkward, Step(8e4), times=np.linspace(0, 0.2, 21), method="LSODA", rtol=1e-10)
    want = solve_ivp(
        lambda _, y: np.append(y[n:], lagrange(y[:n], y[n:], 8e4)), (0, 0.2), np.append(q0, np.zeros(n)),
        method="LSODA", t_eval=run.time, rtol=1e-8, atol=1e-10,
    )
    assert np.abs(run.joint_angle.values - want.y[:n].T).max() < 2e-6


@pytest.mark.parametrize("which", ["paper", "awkward"])
def test_midpoint_is_of_second_order(request, errors_mm, which):
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4])
    errors = errors_mm(request.getfixturevalue(which), PULSE, TIMES, list(steps))
    assert slope(steps, errors) == pytest.approx(2.0, abs=0.1)
    assert errors[1] < 0.025  # mm, the default step


def test_extrapolated_is_of_fourth_order(paper):
    """Behind a valve, under a ramp whose bends lie between the output times: the steps must end there by themselves."""
    model, steps = paper.with_(valve=Valve(rise_time=0.02, fall_time=0.02)), np.array([4e-3, 2e-3, 1e-3])
    ramp = Trace([0.0, 0.0431, 0.1217, 0.3], [0.0, 0.0, 119e3, 0.0])
    truth = simulate(model, ramp, times=TIMES, method="LSODA", rtol=1e-11)["tip_position"]
    runs = [simulate(model, ramp, times=TIMES, method="extrapolated", time_step=h)["tip_position"] for h in steps]
    errors = [1e3 * float(np.abs(run - truth).max()) for run in runs]
    assert slope(steps, errors) == pytest.approx(4.0, abs=0.7)
    assert errors[-1] < 1e-4  # mm


def test_midpoint_errors_of_the_papers_step(paper, errors_mm):
    """Of a tip that moves by 43 mm; output every 20 ms so that the longer steps are taken whole."""
    errors = errors_mm(paper, Step(119e3), np.linspace(0, 1, 51), [1e-3, 2e-3, 4e-3, 1e-2])
    assert np.all(np.array(errors) < [0.01, 0.04, 0.15, 1.0])


def test_rods_of_uniform_mass_are_as_accurate(paper, errors_mm):
    errors = errors_mm(paper.with_(mass_at="rod"), Step(119e3), np.linspace(0, 1, 51), [1e-3, 2e-3, 4e-3])
    assert np.all(np.array(errors) < [0.02, 0.06, 0.24])


@pytest.mark.parametrize("which", ["paper", "awkward"])
def test_the_longest_step_allowed_stays_bounded(request, which):
    model = request.getfixturevalue(which)
    longest = 0.999 / (8 * modes(model)[0][0])
    times = np.arange(0, 400) * longest
    run = simulate(model, Step(6e4), times=times, time_step=longest, check=False)
    rest = equilibrium(model, 6e4)
    assert np.abs(run.joint_angle[-1] - rest).max() < 1e-3
    assert np.abs(run.joint_angle).max() < 4 * np.abs(rest).max()


@pytest.mark.parametrize("which", ["paper", "awkward"])
@pytest.mark.parametrize("damping", [0.0, 5e-3])
def test_energy_balances_at_the_order_of_the_rule(request, which, damping):
    model = request.getfixturevalue(which).with_(damping=damping)
    steps = np.array([1e-4, 5e-5, 2.5e-5])  # the highest mode, undamped, rings at 119 Hz
    gaps = [energy_gap(simulate(model, PULSE, times=TIMES, time_step=h)).max() for h in steps]
    assert slope(steps, gaps) > 1.9
    assert gaps[0] < 2e-5  # J, of some 70 mJ that go in
    assert energy_gap(simulate(model, PULSE, times=TIMES[:31], method="LSODA", rtol=1e-10)).max() < 1e-9


@pytest.mark.slow
def test_without_damping_nothing_is_lost(paper):
    free = simulate(
        paper.with_(damping=0.0), Trace([0], [0.0]), times=TIMES[:31], method="LSODA", rtol=1e-12,
        initial_angle=np.full(5, 0.1),
    )
    total = free.kinetic_energy + free.elastic_energy
    assert np.abs(total / total[0] - 1).max() < 1e-8
    assert free.dissipated_energy.values.tolist() == [0.0] * 31
    assert np.abs(free.input_work).max() == 0.0


def test_the_linear_part_of_the_rule_conserves_energy_exactly():
    """One stiff link on a spring: the midpoint rule keeps its quadratic energy at any step."""
    one = Model(link_length=0.1, link_mass=0.05, stiffness=0.4, damping=0.0, torque=1e-6)
    run = simulate(one, Trace([0], [5e4]), duration=20.0, time_step=0.015, initial_angle=[0.3], check=False)
    total = run.kinetic_energy + run.elastic_energy - run.input_work
    assert np.abs(total - total[0]).max() < 1e-12 * total[0]


def test_under_constant_pressure_energy_only_falls(paper, awkward):
    for model, p in ((paper, 119e3), (awkward, 8e4)):
        run = simulate(model, Step(p), duration=1.0)
        assert np.all(np.diff(run.dissipated_energy) >= 0)
        spent = (run.kinetic_energy + run.elastic_energy + run.gravitational_energy - run.input_work).values
        assert np.diff(spent).max() < 1e-8 * np.ptp(spent)


def test_the_mirror_image_of_a_body_moves_as_its_mirror_image(paper, awkward):
    for model in (paper, awkward.with_(stations=(Station("a", 1, 0.02, 0.004),), stiffening=-0.2)):
        mirrored = model.with_(
            torque=-model.torque, rest_angle=-model.rest_angle, base_angle=-model.base_angle,
            stiffening=-model.stiffening, gravity=model.gravity * [-1, 1],
            stations=[s._replace(across=-s.across) for s in model.stations],
        )
        a, b = (simulate(m, PULSE, duration=0.5) for m in (model, mirrored))
        for name in ("tip_position", "station_position"):
            assert a[name].values * [-1, 1] == pytest.approx(b[name].values, abs=1e-14)
        assert a.station_angle.values == pytest.approx(-b.station_angle.values, abs=1e-14)
        assert a.joint_angle.values == pytest.approx(-b.joint_angle.values, abs=1e-14)
        assert np.array_equal(a.pressure, b.pressure)


def test_positive_pressure_moves_the_tip_towards_minus_x(paper):
    assert simulate(paper, Step(1e5), duration=0.1).tip_position[-1, -1, 0] < -0.005


def test_starting_from_a_given_state(paper):
    q, dq = np.array([0.1, 0.05, 0.0, -0.05, -0.1]), np.array([1.0, 0.0, -1.0, 0.0, 2.0])
    run = simulate(paper, Pulse(0.0), duration=0.1, initial_angle=q, initial_rate=dq)
    assert run.joint_angle[0].values == pytest.approx(q)
    assert run.joint_rate[0].values == pytest.approx(dq)
    first = simulate(paper, Pulse(0.0), times=np.array([0.0, 0.05]), initial_angle=q, initial_rate=dq)
    then = simulate(
        paper, Pulse(0.0), times=np.array([0.05, 0.1]),
        initial_angle=first.joint_angle[-1], initial_rate=first.joint_rate[-1],
    )
    assert then.joint_angle[-1].values == pytest.approx(run.joint_angle[-1].values, abs=1e-12)


def test_a_trajectory_says_what_it_holds(paper):
    run = simulate(paper, PULSE, duration=0.2, time_step=2e-3)
    assert run.sizes == {"time": 101, "joint": 5, "link": 5, "station": 5, "axis": 2, "input": 1}
    assert run.time.values == pytest.approx(np.linspace(0, 0.2, 101))
    assert all({"units", "long_name"} <= set(v.attrs) for v in [*run.data_vars.values(), run.time])
    assert run.attrs["method"] == "midpoint"
    assert run.attrs["step_s"] == 2e-3
    assert np.isfinite(run.to_array()).all()
    assert run.station.values.tolist() == [f"link_{i}" for i in range(1, 6)]


def test_simulation_leaves_its_arguments_alone(paper):
    times, q = np.linspace(0, 0.1, 11), np.full(5, 0.02)
    copies = times.copy(), q.copy()
    simulate(paper, PULSE, times=times, initial_angle=q)
    assert np.array_equal(times, copies[0])
    assert np.array_equal(q, copies[1])


def test_a_loose_budget(paper):
    """4.5 s of the paper's pulse in 1 ms steps takes some 10 ms; a hundred times that is a fault."""
    simulate(paper, PULSE, duration=0.01)
    began = perf_counter()
    simulate(paper, Pulse(119e3, 0.12, 2.76), duration=4.5)
    assert perf_counter() - began < 1.0
