"""Rest under load, modes, and where the observed points are."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.chains import station
from scipy.optimize import root

from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model, Station, Tendon, chain_model
from pliant.simulation import Trace, equilibrium, modes, simulate


def uniform(**changes):
    values = {"length": 0.17, "mass": 0.069, "stiffness": 1.6067, "damping": 8e-3, "torque": 2e-6 / 3, **changes}
    return chain_model(**values)


def potential_slope(model, q, pressure, force=(0.0, 0.0)):
    """Slope of the total potential by central differences on point masses and springs."""

    def potential(q):
        phi = model.base_angle + np.cumsum(q + model.rest_angle)
        e = np.stack([-np.sin(phi), np.cos(phi)], axis=1)
        tips = model.first_joint + np.cumsum(model.link_length[:, None] * e, axis=0)
        joints = np.vstack([model.first_joint, tips[:-1]])
        centre = tips if model.mass_at == "tip" else 0.5 * (joints + tips)
        weight = model.link_mass @ centre + model.tip_mass * tips[-1]
        work = (model.joint_gain * model.torque_at(pressure)) @ q
        fall = weight @ model.gravity + tips[-1] @ np.array(force)
        return 0.5 * model.stiffness @ q**2 - work - fall

    h = 1e-6
    return np.array([potential(q + h * d) - potential(q - h * d) for d in np.eye(model.n)]) / (2 * h)


def test_rest_without_load_is_the_springs_own(paper):
    assert equilibrium(paper, 119e3) == pytest.approx(119e3 * paper.torque[0] / paper.stiffness, rel=1e-15)


@pytest.mark.parametrize("force", [(0.0, 0.0), (0.3, -0.2)])
def test_rest_is_where_the_potential_is_flat(awkward, force):
    model = awkward
    q = equilibrium(model, 7e4, np.array(force))
    assert np.abs(potential_slope(model, q, 7e4, force)).max() < 1e-9
    scipys = root(lambda q: potential_slope(model, q, 7e4, force), q + 0.05, tol=1e-12)
    assert q == pytest.approx(scipys.x, abs=1e-7)


def test_rest_is_where_a_long_simulation_ends(awkward):
    run = simulate(
        awkward, Trace([0], [7e4]), times=np.array([0.0, 8.0]), initial_angle=np.zeros(3), time_step=4e-3,
    )
    assert run.joint_angle[-1].values == pytest.approx(equilibrium(awkward, 7e4), abs=1e-10)
    still = simulate(awkward, Trace([0], [7e4]), duration=0.5)
    assert np.abs(still.joint_rate).max() < 1e-10


def test_a_hanging_chain_and_a_heavy_cap_stay_on_their_branch():
    heavy = uniform(stiffness=0.02, tip_mass=0.05, gravity=[9.81, 0.0])
    q = equilibrium(heavy)
    assert np.abs(potential_slope(heavy, q, 0.0)).max() < 1e-9
    assert np.all(q < 0)  # gravity towards +x turns about -z
    tip = mechanics_of(heavy).tips(mechanics_of(heavy).coordinates(q))[-1]
    assert tip[0] > 0.1


@pytest.mark.parametrize("links", [1, 5])
def test_a_chain_that_buckles_is_refused(links):
    weight = 0.069 * 9.81 * 0.17
    with pytest.raises(SimulationError, match="buckles"):
        equilibrium(uniform(links=links, stiffness=0.3 * weight, gravity=[0.0, -9.81]))
    assert np.all(equilibrium(uniform(links=links, stiffness=2.0 * weight, gravity=[0.0, -9.81])) == 0)


def test_the_very_load_that_buckles_is_refused():
    one = Model(link_length=1.0, link_mass=1.0, stiffness=1.0, damping=0.1, torque=1e-6, mass_at="tip", gravity=[0, -1])
    with pytest.raises(SimulationError, match="buckles"):
        equilibrium(one)


@pytest.mark.parametrize(("pressure", "force"), [(np.nan, None), (np.inf, None), (0.0, [np.nan, 0.0])])
def test_rest_under_a_load_that_is_not_finite_is_refused(paper, pressure, force):
    with pytest.raises(InputError, match="finite pressure"):
        equilibrium(paper, pressure, force)


MODES = [
    ({"mass_at": "tip"}, [5.0062, 31.2163, 81.7253, 139.2889, 184.7917]),
    ({}, [5.9156, 37.7728, 107.0265, 206.8308, 308.0252]),
]


@pytest.mark.parametrize(("changes", "hertz"), MODES)
def test_frequencies_of_the_papers_links(changes, hertz):
    assert modes(uniform(**changes))[0] == pytest.approx(hertz, abs=6e-5)


@pytest.mark.parametrize(
    ("changes", "hertz"),
    [
        ({"tip_mass": 0.005}, 5.26), ({"tip_mass": 7.464e-3}, 5.000), ({"tip_mass": 0.01}, 4.77),
        ({"tip_mass": 0.02}, 4.10),
        ({"mass": 0.079}, 5.53), ({"gravity": [0.0, 9.81]}, 6.10), ({"gravity": [0.0, -9.81]}, 5.73),
    ],
)
def test_first_frequency_with_cap_mass_and_gravity(changes, hertz):
    assert modes(uniform(**changes))[0][0] == pytest.approx(hertz, abs=6e-3)


def test_damping_ratios_are_proportional_to_frequency():
    f, zeta = modes(uniform(mass_at="tip"))
    assert zeta == pytest.approx(8e-3 / (2 * 1.6067) * 2 * np.pi * f)
    assert zeta[0] == pytest.approx(0.078, abs=5e-4)
    assert modes(uniform())[1][0] == pytest.approx(0.0925, abs=5e-4)


def test_joints_in_the_middle_of_segments_keep_the_first_frequency_of_the_continuum():
    """EI = K l = 0.0546 N m^2: a cantilever of 7.104 Hz; base joints ring 17 % too low."""
    continuum = 1.8751041**2 / (2 * np.pi) * np.sqrt(1.6067 * 0.034 / (0.069 / 0.17)) / 0.17**2
    assert continuum == pytest.approx(7.10, abs=5e-3)
    middle = modes(uniform(joint_placement="midsegment"))[0][0]
    assert middle == pytest.approx(7.17, abs=5e-3)
    assert modes(uniform())[0][0] / continuum - 1 == pytest.approx(-0.17, abs=5e-3)
    for links, gap in ((10, 0.09), (50, 0.02)):
        stiffness = 1.6067 * links / 5
        assert 1 - modes(uniform(links=links, stiffness=stiffness))[0][0] / continuum == pytest.approx(gap, abs=6e-3)
        centred = modes(uniform(links=links, stiffness=stiffness, joint_placement="midsegment"))[0][0]
        assert centred == pytest.approx(continuum, rel=3e-3)


def test_modes_match_the_linearised_simulation(awkward):
    """Small free motion about rest, damped so little that the frequency is that of the undamped chain."""
    model = awkward.with_(damping=1e-7)
    q = equilibrium(model)
    f, _ = modes(model)
    times = np.linspace(0, 3, 3001)
    kick = np.array([1e-6, 1e-6, 1e-6])
    run = simulate(model, Trace([0], [0.0]), times=times, method="LSODA", rtol=1e-9, initial_angle=q + kick)
    spectrum = np.abs(np.fft.rfft((run.joint_angle[:, 0] - q[0]).values * np.hanning(times.size), 2**17))
    peak = np.fft.rfftfreq(2**17, times[1])[spectrum[: 2**13].argmax()]
    assert peak == pytest.approx(f[0], rel=3e-3)


def test_modes_of_an_unstable_shape_are_refused():
    one = Model(link_length=1.0, link_mass=1.0, stiffness=1.0, damping=0.1, torque=1e-6, mass_at="tip", gravity=[0, -2])
    with pytest.raises(SimulationError, match="not stable"):
        modes(one, [0.0])
    with pytest.raises(InputError, match="expected 1 finite number"):
        modes(one, [0.0, 0.0])


@pytest.mark.parametrize(("spacing", "lengthens"), [(0.03, False), (0.0, True), (0.03, True)])
def test_the_inputs_that_hold_a_shape_include_the_sum_of_a_pairs_tensions(spacing, lengthens):
    """It acts on chords between guides, and on the length; one of the pairs has a tendon that is slack."""
    cords = [
        Tendon.at_azimuth(turn, np.ones(3), name=name, lever=0.008, spacing=spacing, driven_by="displacement",
                          line_stiffness=2000.0, pretension=force, pair=True)
        for turn, name, force in ((0.0, "p", 5.0), (1.57, "q", 0.5))
    ]  # fmt: skip
    body = chain_model(length=0.12, mass=0.05, links=3, stiffness=0.05, damping=1e-3, space=True, chambers=cords,
                       gravity=[0.0, 0.0, 9.81], extensions=(Extension(500.0, 1.0),) if lengthens else ())  # fmt: skip
    level = [3e-3, 1e-3]
    assert modes(body, equilibrium(body, level))[0] == pytest.approx(modes(body, pressure=level)[0], rel=1e-8)


def test_stations_are_points_fixed_to_their_links():
    points = [
        Station("base", -1, 0.0), Station("clamp", -1, 0.01, 0.005), Station("joint", 0, 0.0),
        Station("left", 0, 0.04, 0.01), Station("tip", 1, 0.05), Station("right", 1, 0.025, -0.02),
    ]
    model = Model(
        link_length=[0.04, 0.05], link_mass=0.01, stiffness=1.0, damping=1e-3, torque=1e-6, rest_angle=[0.1, 0.2],
        base_length=0.02, base_angle=np.pi / 2, stations=points,
    )
    q = np.array([-0.1, np.pi / 2 - 0.2])  # base and first link along -x, second along -y
    position, angle = mechanics_of(model).stations(mechanics_of(model).coordinates(q))
    want = [[0, 0], [-0.01, -0.005], [-0.02, 0], [-0.06, -0.01], [-0.06, -0.05], [-0.08, -0.025]]
    assert position == pytest.approx(np.array(want), abs=1e-15)
    assert angle == pytest.approx(np.pi * np.array([0.5, 0.5, 0.5, 0.5, 1.0, 1.0]))


def test_stations_and_tips_agree_along_a_trajectory(awkward):
    run = simulate(awkward, Trace([0, 0.1], [0, 8e4]), duration=0.3)
    assert run.station_position.values == pytest.approx(run.tip_position.values, abs=1e-15)
    phi = awkward.base_angle + np.cumsum(run.joint_angle.values + awkward.rest_angle, axis=1)
    assert run.station_angle.values == pytest.approx(phi, abs=1e-14)


def test_stations_lie_where_a_sum_over_the_links_has_them(awkward, rng):
    phi = rng.normal(size=3)
    points = [("a", -1, 0.013, 0.004), ("b", 0, 0.02, -0.01), ("c", 2, 0.06, 0.03)]
    position, _ = mechanics_of(awkward.with_(stations=points)).stations(phi)
    for (_, link, along, across), got in zip(points, position, strict=True):
        p = np.empty(2)
        station(phi, awkward.link_length, awkward.first_joint, awkward.base_angle, (link, along, across), p)
        assert got == pytest.approx(p, abs=1e-15)
