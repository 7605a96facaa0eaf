"""The benchmark measures what it says; its targets are judged by `make bench`, not here."""

from __future__ import annotations

import gc
import json
import sys

import numpy as np
import pytest
from benchmark_scripts import loaded
from command_line import invoke

from pliant.actuators import chen2018
from pliant.compiler.choose import twin
from pliant.equations import motion
from pliant.equations.symbols import Slopes
from pliant.errors import InputError
from pliant.mechanics import mechanics_of

run = loaded("run")
kernels, race, realtime = (sys.modules[f"speed.{name}"] for name in ("kernels", "race", "realtime"))
MEANING, TARGET_MM, Problem = run.MEANING, race.TARGET_MM, race.Problem
Method, pliant_extrapolated, pliant_midpoint, scipy_methods = (
    race.Method, race.pliant_extrapolated, race.pliant_midpoint, race.scipy_methods
)
error_of, to_target = race.error_of, race.to_target


@pytest.fixture(scope="module")
def problem():
    """With LSODA at its tightest for the truth: Radau's takes seconds, and lies 2e-9 mm from it."""
    made = Problem()
    made.truth = scipy_methods(made)[0].solve(1e-12)
    return made


def test_the_truth_has_two_sources(problem):
    fine = pliant_extrapolated(problem).solve(2e-4)
    assert problem.error_mm(fine) < 1e-6
    assert problem.error_mm(problem.truth) == 0.0


def test_the_midpoint_meets_its_target(problem):
    row = to_target(problem, pliant_midpoint(problem))
    assert row["error_mm"] <= TARGET_MM
    assert 0 < row["ms"] < 1000


def test_orders_by_regression(problem):
    """Two for the rule, four where two runs are extrapolated."""
    steps = [1e-2 / k for k in (8, 16, 32)]
    for make, order in ((pliant_midpoint, 2), (pliant_extrapolated, 4)):
        errors = [problem.error_mm(make(problem).solve(h)) for h in steps]
        slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
        assert slope == pytest.approx(order, abs=0.3)


def test_lsoda_solves_the_same_problem(problem):
    for method in scipy_methods(problem)[:2]:
        assert error_of(problem, method, 1e-8) < 1e-3


def test_a_method_that_fails_is_never_within(problem):
    def broken(_setting):
        raise RuntimeError("no")

    def useless(_setting):
        return np.full_like(problem.truth, np.nan)

    for solve in (broken, useless):
        method = Method("broken", [1.0, 2.0], solve)
        assert error_of(problem, method, 1.0) == np.inf
        assert to_target(problem, method) is None


def test_mujoco_solves_the_same_problem(problem):
    pytest.importorskip("mujoco", reason="the extra 'bench' is not installed")
    by_name = {m.name: m for m in race.mujoco_methods(problem)}
    assert error_of(problem, by_name["MuJoCo RK4"], 4e-4) < 1e-3
    assert error_of(problem, by_name["MuJoCo implicitfast"], 1e-3) < 0.5


@pytest.mark.slow
def test_real_time_keeps_count_and_leaves_the_collector_on():
    found = realtime.realtime(0.2)
    assert gc.isenabled()
    assert set(found) <= set(MEANING)
    assert found["realtime_steps"] == 200
    assert 0 < found["realtime_median_us"] <= found["realtime_p999_us"] <= found["realtime_worst_us"]
    assert 0 <= found["realtime_missed_by_the_system"] <= found["realtime_missed"] <= 200
    assert 0 <= found["realtime_missed_by_an_empty_loop"] <= 200
    with pytest.raises(InputError, match="at least ten steps"):
        realtime.realtime(0.001)


@pytest.mark.slow
def test_kernels_and_the_file(tmp_path):
    found = run.measure({"kernels": run.JOBS["kernels"]})
    assert {"step_ns", "rhs_ns", "rhs_jacobian_ns", "machine", "pliant"} <= set(found)
    path = run.write(found, tmp_path / "results" / "bench.json")
    assert json.loads(path.read_text(encoding="utf-8"))["step_ns"] == found["step_ns"]
    assert any(line.startswith("  step_ns") for line in run.lines(found))
    assert {k for k in found if k not in ("machine", "pliant")} <= set(MEANING)


def test_the_floor_in_plain_c_does_the_same_mathematics():
    """Written by hand, beside kernels that were recorded from the text: a thousand steps, and every derivative."""
    model = chen2018.model(gravity=[1.0, -9.0], stiffening=-0.3, cubic_stiffening=0.2, rest_angle=0.02, base_angle=0.1)
    floor, n, torque = kernels.Floor(model), 5, np.linspace(0.05, 0.08, 5)
    if floor.code is None:
        pytest.skip("no C compiler")
    phi, w, a = np.linspace(0.05, 0.25, n), np.linspace(0.1, 1.0, n), np.zeros(n)
    out = Slopes(np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))
    a_phi, a_w = np.zeros((n, n)), np.zeros((n, n))
    parts = mechanics_of(model).parts()
    twin(motion.acceleration_jacobian, n)(phi, w, torque, *parts, out)
    floor.call("many_jacobians", 1, phi.copy(), w, torque, a, a_phi, a_w)
    for mine, plain in zip(out, (a, a_phi, a_w), strict=True):
        np.testing.assert_allclose(plain, mine, atol=1e-9 * np.abs(mine).max())
    floor.call("many_accelerations", 1, phi.copy(), w, torque, a)
    np.testing.assert_allclose(a, out.a, atol=1e-9 * np.abs(a).max())
    mine, plain = (phi.copy(), w.copy()), (phi.copy(), w.copy())
    for _ in range(1000):
        twin(motion.step, n)(*mine, 1e-3, torque, *parts)
    floor.call("many_steps", 1000, *plain, 1e-3, torque)
    np.testing.assert_allclose(plain, mine, atol=1e-9)


def test_registers_and_memory_are_those_of_the_machine():
    assert [kernels.lanes_of(flags) for flags in ({"sse2"}, {"avx", "avx2"}, {"avx2", "avx512f"})] == [2, 4, 8]
    assert 1e8 < kernels.bandwidth() < 1e13  # bytes a second: between a memory card and no computer


def test_unknown_parts_are_refused(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["run.py", "tempo"])
    with pytest.raises(SystemExit):
        run.main()
    assert "no part 'tempo': use some of kernels, startup" in capsys.readouterr().err


def test_pliant_has_no_benchmarks_of_its_own():
    result = invoke("bench")
    assert result.exit_code == 2
    assert "No such command 'bench'" in result.output
