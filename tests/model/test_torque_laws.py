"""Torque laws of few numbers: closed forms, a wall of rubber, a fit, and laws that other packages bring."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant import plugins
from pliant.equations.chamber import bladder_area, lever_arm, lever_growth, torque
from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, fit
from pliant.identification.parameters import apply, kind_of
from pliant.model import Model, Station, elastic_wall, torque_law
from pliant.simulation import Pulse, simulate

LAW = elastic_wall.TORQUE_LAW
GIVEN = {"elastic_wall_lever": 2e-6, "elastic_wall_compliance": 1.5e-6}
BODY = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6],
    stations=[Station("tip", 1, 0.05)],
)


def test_an_elastic_wall_is_the_papers_bladder_with_a_radius_that_grows():
    radius, strain, pressure = 0.012, 2e-6, np.linspace(0.0, 2e5, 9)
    lever = float(bladder_area(radius) * lever_arm(radius))
    grown = radius * (1.0 + strain * pressure)
    found = torque(pressure, LAW.coefficients(lever=lever, compliance=strain))
    np.testing.assert_allclose(found, pressure * bladder_area(grown) * lever_arm(grown), rtol=1e-13)


def test_a_wall_of_rubber_begins_so():
    """Neo-Hookean at rest: stretch^4 = 1 / (1 - p / limit); equal to first order in p / limit."""
    limit = 3e5
    p = limit * np.array([1e-4, 1e-3])
    rubber = p * lever_growth(1.0 / (1.0 - p / limit))
    apart = torque(p, LAW.coefficients(lever=1.0, compliance=0.25 / limit)) / rubber - 1.0
    assert np.all(np.abs(apart) < (p / limit) ** 2)


def test_a_fit_finds_the_wall_of_a_tube_of_rubber():
    """Recordings of a chamber whose wall gives way within 2 ms, at pressures well below its limit."""
    limit = 8e5
    true = BODY.with_(torque=[2e-6], inflation_limit=limit, inflation_time=2e-3)
    experiments, times = [], np.arange(0.0, 0.8, 0.01)
    for level in (3e4, 6e4, 9e4):
        run = simulate(true, Pulse(level, 0.1, 0.4), times=times)
        seen = np.asarray(run["station_position"].values)
        experiments.append(Experiment(f"at_{level:.0f}", times, seen, ("tip",), "pulse", level=level))
    edges = [Parameter(f"{e.name}.{n}", v, free=False) for e in experiments for n, v in (("start", 0.1), ("stop", 0.5))]
    found = {p.name: p for p in fit(experiments, BODY, ["damping", *GIVEN, *edges], starts=1).parameters}
    assert found["elastic_wall_lever"].value == pytest.approx(2e-6, rel=0.01)
    assert found["elastic_wall_compliance"].value == pytest.approx(0.25 / limit, rel=0.15)
    assert found["elastic_wall_compliance"].unit == "1/Pa"


def test_a_model_takes_the_coefficients():
    np.testing.assert_allclose(apply(BODY, GIVEN).chambers[0].torque, LAW.coefficients(lever=2e-6, compliance=1.5e-6))
    kept = apply(BODY, {"stiffness": 0.4}).chambers[0].torque
    assert kept.tolist() == [1e-6]


def test_a_law_needs_all_of_its_numbers_and_no_other_law():
    with pytest.raises(InputError, match="'elastic_wall' needs all of its numbers: elastic_wall_compliance is missing"):
        apply(BODY, {"elastic_wall_lever": 2e-6})
    with pytest.raises(InputError, match=r"leave out all but one of elastic_wall_\*, torque_<k>"):
        apply(BODY, {**GIVEN, "torque_1": 1e-6})
    with pytest.raises(InputError, match="elastic_wall_lever, elastic_wall_compliance"):
        kind_of("elastic_wall_leverage")


def test_another_package_brings_a_law(monkeypatch):
    cubic = torque_law.TorqueLaw(
        "cubic", {"size": torque_law.LawParameter("N m/Pa^3", 0.0, 1.0, 0.0, "of the cube")},
        lambda size: np.array([0.0, 0.0, size]), lambda p, tau: {"size": float(np.mean(tau / p**3))}, scale="size",
    )
    laws = {torque_law.GROUP: {"cubic": "elsewhere.cubic:LAW"}}
    monkeypatch.setattr(plugins, "installed", lambda group: laws.get(group, {}))
    known = plugins.import_module
    monkeypatch.setattr(
        plugins, "import_module", lambda name: SimpleNamespace(LAW=cubic) if name == "elsewhere.cubic" else known(name)
    )
    for cached in (torque_law.torque_laws, torque_law.law_parameters):
        cached.cache_clear()
    try:
        assert apply(BODY, {"cubic_size": 3e-16}).chambers[0].torque.tolist() == [0.0, 0.0, 3e-16]
    finally:
        for cached in (torque_law.torque_laws, torque_law.law_parameters):
            cached.cache_clear()


def test_a_start_leaves_rests_out_and_one_level_tells_the_lever_alone():
    pressure = np.array([0.0, 2e4, 0.0, 6e4, 1e5])
    given = {"lever": 2e-6, "compliance": 1.5e-6}
    found = LAW.start(pressure, torque(pressure, LAW.coefficients(**given)))
    assert found == pytest.approx(given, rel=1e-9)
    alone = LAW.start(np.array([5e4, 0.0, 5e4]), np.array([0.1, 0.0, 0.1]))
    assert alone == pytest.approx({"lever": 2e-6, "compliance": 0.0})
