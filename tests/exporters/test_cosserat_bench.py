"""Chains as a solver of cosseratbench: its experiments with rods that are held at their start."""

from __future__ import annotations

import sys
import tomllib
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from pliant.errors import InputError

ENTRY = "pliant.exporters.cosserat_bench:ChainSolver"


def test_the_suite_finds_the_solver_by_its_entry_point():
    text = (Path(__file__).resolve().parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["project"]["entry-points"]["cosseratbench.solvers"] == {"pliant": ENTRY}


def test_without_the_suite_its_name_is_told(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "cosseratbench"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, ENTRY.split(":", maxsplit=1)[0], raising=False)
    monkeypatch.setitem(sys.modules, "cosseratbench", None)
    with pytest.raises(InputError, match="cosseratbench is not installed: pip install cosseratbench"):
        import_module(ENTRY.split(":", maxsplit=1)[0])


@pytest.fixture
def suite():
    """Run an experiment of the suite."""
    experiment = pytest.importorskip("cosseratbench.experiment", reason="cosseratbench is not installed")
    solver = import_module(ENTRY.split(":", maxsplit=1)[0]).ChainSolver()

    def run(name, **options):
        of = import_module(f"cosseratbench.experiments.{name}")
        return experiment.run(getattr(of, name), solver, **options)

    return run


@pytest.mark.slow  # compiles the step of 21 links
def test_a_cantilever_and_a_pendulum(suite):
    bent = suite("cantilever")
    assert bent.metrics["tip_deflection_error"] < 2e-3
    assert bent.observations["max_strain"] < 1e-5
    swinging = suite("pendulum", n_elements=20)
    assert swinging.metrics["period_error"] < 2e-3
    assert abs(swinging.metrics["amplitude_change"]) < 1e-3
    across = swinging.trajectory.directors[0]
    np.testing.assert_allclose(np.linalg.norm(across, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(across[0], np.tile([0.0, 1.0, 0.0], (20, 1)), atol=1e-9)


def test_what_no_chain_simulates(suite):
    assert suite("twist").missing == ("a rod whose start is free or whose end is held",)
    assert "rod_contact" in suite("pile").missing


@pytest.mark.slow
def test_the_shape_at_the_start_is_that_of_the_rod(suite):
    from cosseratbench.experiments.pendulum import build

    rods = import_module(ENTRY.split(":", maxsplit=1)[0])
    scenario = build(1e7)
    turn = np.linspace(0.0, 1.2, 400)
    curve = np.stack([0.3 * (1 - np.cos(turn)), 0.1 * turn, 0.3 * np.sin(turn)], axis=1)
    for start in ("pinned", "clamped"):
        held = type(scenario.rods[0].start)(start)
        rod = replace(scenario.rods[0], centerline=tuple(map(tuple, curve)), rest_arc_length=None, start=held,
                      normal=(1.0, 0.0, 0.0))  # fmt: skip
        model, frame = rods.chain_of(rod, (0.0, 0.0, -9.81), 40)
        nodes, across = rods.nodes_of(model, rod, frame, rods.angles_of(rod, frame, 40)[None])
        np.testing.assert_allclose(nodes[0], rod.nodes(40), atol=2e-4)
        np.testing.assert_allclose(across[0], rod.directors(40), atol=0.02)
