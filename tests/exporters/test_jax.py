"""The JAX module takes the steps of `Stepper`, and its derivatives are those of differences and of the package."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from command_line import invoke
from jax_arms import BODIES, INPUTS, PASTS, combined, jax_arm, levels, loaded
from target_models import paper

import pliant
from pliant.compiler.choose import twin
from pliant.equations.laws import LAWS
from pliant.equations.linearised import step_jacobian
from pliant.exporters.provenance import Uncertainty
from pliant.exporters.randomisation import draw_models
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Valve, save_model
from pliant.simulation import Stepper, equilibrium

H = 1e-3  # s


@pytest.fixture(scope="module", autouse=True)
def double():
    """64 bit."""
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield jax
    jax.config.update("jax_enable_x64", before)


def test_the_command_writes_a_module_that_imports_jax_alone(tmp_path):
    file = save_model(combined("plane", "all", "swelling"), tmp_path / "model.json")
    done = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py")
    assert done.exit_code == 0, done.output
    tree = ast.parse((tmp_path / "arm.py").read_text(encoding="utf-8"))
    names = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert names == {"typing", "jax", "jax.numpy", "numpy"}
    arm = loaded(tmp_path / "arm.py")
    assert set(arm.parameters) == set(arm.units)
    assert arm.units["stiffness"] == "N m/rad"
    np.testing.assert_array_equal(arm.parameters["link_length"], paper().link_length)
    assert {"rest", "step", "rollout", "observe"} <= set(vars(arm))
    assert arm.inputs == ("chamber",)


def test_a_part_that_jax_lacks_is_refused_by_name(tmp_path):
    for valve, words in ((Valve(dead_time=0.01), "dead time"), (Valve(natural_frequency=5.0), "second-order valve"),
                         (Valve(settle_share=0.2), "late settling"), (Valve(dead_band=1e3), "dead band")):  # fmt: skip
        file = save_model(paper().with_(valve=valve), tmp_path / "model.json")
        refused = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py")
        assert words in str(refused.exception)
        assert "not expressible in jax" in str(refused.exception)
        assert not (tmp_path / "arm.py").exists()


@pytest.mark.parametrize("name", ["jax", "numpy", "class", "my arm", "2_arms"])
def test_a_file_that_python_cannot_import_is_refused(name, tmp_path):
    file = save_model(paper(), tmp_path / "model.json")
    refused = invoke("export", file, "--to", "jax", "-o", tmp_path / f"{name}.py")
    assert f"{name}.py cannot be imported as a Python module" in str(refused.exception)
    assert not list(tmp_path.glob("*.py"))


def all_names(tree):
    """Names that a module reads, and those that it or its functions define."""
    read = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
    made = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
    made |= {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)}
    made |= {n.arg for n in ast.walk(tree) if isinstance(n, ast.arg)}
    return read, made | {a.asname or a.name for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)
                         for a in n.names}  # fmt: skip


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("past", ["none", "all"])
def test_the_module_defines_each_name_once_and_every_name_that_it_uses(body, past, tmp_path):
    pliant.export(combined(body, past, "plain"), "jax", tmp_path / "arm.py")
    tree = ast.parse((tmp_path / "arm.py").read_text(encoding="utf-8"))
    read, made = all_names(tree)
    assert not read - made - set(dir(__builtins__)) - set(__builtins__ if isinstance(__builtins__, dict) else ())
    top = [n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    top += [t.id for n in tree.body if isinstance(n, ast.Assign) for t in n.targets if isinstance(t, ast.Name)]
    assert len(top) == len(set(top))


def test_a_module_runs_without_pliant(tmp_path):
    pliant.export(paper(), "jax", tmp_path / "arm.py")
    code = "import sys, arm; print(sorted(m for m in sys.modules if m.split('.')[0] in ('pliant', 'scipy', 'numba')))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "pliant" not in done.stdout


def folded_lever(p, a):
    """A torque law that branches on the pressure."""
    return a[0] if p < a[1] else a[0] * a[1] / p


def test_every_torque_law_is_tried_and_one_that_branches_is_refused(tmp_path, monkeypatch):
    assert {law.name for law in LAWS} <= {row.get("law") for row in INPUTS.values()}
    folded = tuple(replace(law, lever=folded_lever) for law in LAWS)
    monkeypatch.setattr("pliant.exporters.jax_module.LAWS", folded)
    with pytest.raises(pliant.InputError, match="torque law 'saturating': not expressible in jax"):
        pliant.export(combined("plane", "none", "saturating"), "jax", tmp_path / "arm.py")
    assert not list(tmp_path.iterdir())


def cases():
    """Bodies with hysteresis and inputs, so that every two kinds of parts meet."""
    pasts, inputs = list(PASTS), list(INPUTS)
    rows = [(body, past, inputs[(2 * i + j) % len(inputs)]) for i, body in enumerate(BODIES)
            for j, past in enumerate(pasts)]  # fmt: skip
    return rows + [("plane", "none", kind) for kind in inputs]


def started(arm, stepper):
    """The state of the module at that of a stepper."""
    kept = stepper.memory[:, : arm.COLUMNS] if arm.COLUMNS else np.zeros((0, 0))
    slow = stepper.model.actuation.rest_state(stepper.pressure)
    return arm.BodyState(*map(np.array, (stepper.position, stepper.velocity, kept, stepper.pressure, slow, 0.0)))


@pytest.mark.slow
@pytest.mark.parametrize(("body", "past", "inputs"), cases())
def test_steps_are_those_of_the_stepper(body, past, inputs, tmp_path, double):
    model = combined(body, past, inputs)
    arm, stepper = jax_arm(model, tmp_path), Stepper(model, H, np.zeros(model.actuation.count))
    state, step = started(arm, stepper), double.jit(arm.step)
    worst = 0.0
    for command in levels(model, 60):
        state = step(arm.parameters, state, command, H)
        stepper.step(command)
        worst = max(worst, np.abs(state.position - stepper.position).max(),
                    H * np.abs(state.velocity - stepper.velocity).max())  # fmt: skip
    assert worst < 1e-12
    assert float(state.failed) == 0.0
    kept = stepper.memory[: arm.REMEMBERING, : arm.COLUMNS]
    assert np.abs(np.asarray(state.memory) - kept).max(initial=0.0) < 1e-11
    assert np.abs(stepper.position - Stepper(model, H, np.zeros(model.actuation.count)).position).max() > 1e-3
    seen = arm.observe(arm.parameters, state)
    place, angle = stepper.stations()
    np.testing.assert_allclose(seen["position"], place, atol=1e-12)
    np.testing.assert_allclose(seen["angle"], angle, atol=1e-11)
    np.testing.assert_allclose(seen["tips"], stepper.tips(), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("body", "inputs"), [("plane", "gent"), ("flat_longer", "lag"), ("tied", "saturating"),
                                              ("pulled", "lag")])  # fmt: skip
def test_rest_is_the_equilibrium(body, inputs, tmp_path, double):
    model = combined(body, "all", inputs)
    arm, command = jax_arm(model, tmp_path), levels(model, 10)[5]
    state = double.jit(arm.rest)(arm.parameters, command)
    q = equilibrium(model, command)
    np.testing.assert_allclose(state.position, mechanics_of(model).coordinates(q), atol=1e-10)
    assert float(state.failed) == 0.0
    stepper = Stepper(model, H, command)
    np.testing.assert_allclose(state.memory, stepper.memory[:, : arm.COLUMNS], atol=1e-10)
    np.testing.assert_allclose(state.slow, model.actuation.rest_state(command), rtol=1e-12)


SMOOTH = {  # parameters that switch a part off at their value of 0, or select one of its sides
    "rise_time", "fall_time", "rise_rate", "fall_rate", "stiffening_bound", "axial_stiffening_bound", "inflation_jm",
    "friction", "entry_friction",
}


KEPT_AT_ZERO = {"torque", "tendon_stiffness", "pretension"}  # powers of Pa of all sizes; a tendon at 0 N has a kink


def directions(arm, arguments, rng):
    """Random directions in each argument: a parameter by its own size, and states and inputs by theirs."""
    def along(value, least):
        return rng.uniform(0.5, 1.5, np.shape(value)) * np.maximum(np.abs(value), least)

    own, state, commands = arguments
    for name, value in own.items():
        if name not in SMOOTH or np.all(np.abs(np.asarray(value) - 0.5) < 0.5):
            size = 0.0 if name in KEPT_AT_ZERO else float(np.max(np.abs(value))) or 0.01
            yield name, ({k: along(v, size) if k == name else 0.0 * v for k, v in own.items()},
                         arm.BodyState(*(0.0 * np.asarray(s) for s in state)), 0.0 * commands)  # fmt: skip
    still = {k: 0.0 * v for k, v in own.items()}
    moved = arm.BodyState(*(along(s, 1e-3) if k < 3 else 0.0 * np.asarray(s) for k, s in enumerate(state)))
    yield "state", (still, moved, 0.0 * commands)
    yield "inputs", (still, arm.BodyState(*(0.0 * np.asarray(s) for s in state)), along(commands, 1e-6))


@pytest.mark.slow
@pytest.mark.parametrize(("body", "past", "inputs", "reverse"), [
    ("plane", "slip", "plain", True), ("plane", "all", "gent", True), ("flat_longer", "all", "swelling", False),
    ("twisting", "all", "saturating", False), ("tied", "none", "plain", False), ("pulled", "slip", "lag", False),
])
def test_derivatives_are_those_of_differences(body, past, inputs, reverse, tmp_path, double):
    """By parameters, states and inputs, through slip and slack; in reverse mode those of forward mode."""
    model = combined(body, past, inputs)
    arm, jnp = jax_arm(model, tmp_path), double.numpy
    commands = levels(model, 50)[:30]
    state = started(arm, Stepper(model, H, np.zeros(model.actuation.count)))

    def reached(parameters, state, commands):
        last, _ = arm.rollout(parameters, state, commands, H)
        place = arm.observe(parameters, last)["position"][-1]
        return 100.0 * jnp.sum(place * jnp.arange(1.0, 1.0 + place.size))

    arguments = (arm.parameters, state, commands)
    value = double.jit(reached)
    backward = double.jit(double.grad(reached, argnums=(0, 1, 2)))(*arguments) if reverse else None
    forward = double.jit(lambda a, d: double.jvp(reached, a, d)[1])
    add, leaves = double.tree_util.tree_map, double.tree_util.tree_leaves
    for name, way in directions(arm, arguments, np.random.default_rng(3)):
        rows = []
        for h in (2e-5, 1e-5):
            ends = [value(*add(lambda a, d, s=s: a + s * d, arguments, way)) for s in (h, -h)]
            rows.append((ends[0] - ends[1]) / (2 * h))
        difference = (4.0 * rows[1] - rows[0]) / 3.0
        own = float(forward(arguments, add(jnp.asarray, way)))
        assert own == pytest.approx(float(difference), rel=1e-7, abs=1e-8), name
        if reverse:
            pairs = zip(leaves(backward), leaves(way), strict=True)
            assert sum(float(np.sum(np.asarray(a) * d)) for a, d in pairs) == pytest.approx(own, rel=1e-9, abs=1e-11)


@pytest.mark.slow
def test_derivatives_of_a_step_are_those_of_the_filter(tmp_path, double):
    model = combined("plane", "none", "plain")
    chain, n = mechanics_of(model), model.n
    arm, rng = jax_arm(model, tmp_path), np.random.default_rng(5)
    x, v = rng.normal(0.0, 0.2, n), rng.normal(0.0, 2.0, n)
    state = arm.BodyState(x, v, np.zeros((0, 0)), np.zeros(1), np.array([[0.0, 1.0]]), np.array(0.0))
    slopes = double.jacfwd(lambda s: arm.step(arm.parameters, s, np.array([4e4]), H)[:2])(state)
    J, torque = chain.slopes(), model.actuation.joint_torques(4e4)
    twin(step_jacobian, *chain.sizes)(x.copy(), v.copy(), H, torque, chain.body, chain.joints, J)
    wanted = J.J[: 2 * n]
    for k, part in enumerate(slopes):
        columns = slice(k * n, (k + 1) * n)
        np.testing.assert_allclose(part.position, wanted[:n, columns].T, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(part.velocity, wanted[n:, columns].T, rtol=1e-9, atol=1e-8)


@pytest.mark.slow
def test_single_precision_many_bodies_and_a_failed_step(tmp_path, double):
    model = combined("plane", "slip", "plain")
    arm, jnp = jax_arm(model, tmp_path), double.numpy
    state = started(arm, Stepper(model, H, np.zeros(1)))
    many = double.jit(double.vmap(lambda s, u: arm.rollout(arm.parameters, s, u, H)[0], in_axes=(None, 0)))
    commands = levels(model, 30)[None] * np.array([1.0, 0.5, 1e4])[:, None, None]
    last = many(state, commands)
    assert list(np.asarray(last.failed) > 0) == [False, False, True]
    one = double.jit(lambda s, u: arm.rollout(arm.parameters, s, u, H)[0])(state, commands[1])
    np.testing.assert_allclose(last.position[1], one.position, atol=1e-13)
    single = double.tree_util.tree_map(lambda a: jnp.asarray(a, jnp.float32), (arm.parameters, state))
    short = double.jit(lambda p, s, u: arm.rollout(p, s, u, H)[0])(*single, commands[1])
    assert short.position.dtype == jnp.float32
    assert float(short.failed) == 0.0
    np.testing.assert_allclose(short.position, one.position, atol=1e-4)


KNOWN = Uncertainty(("stiffness", "creep_share_1"), np.array([1.5, 0.1]), np.array([[0.04, 0.002], [0.002, 9e-4]]))


def test_the_command_writes_the_draws_of_a_fit(tmp_path):
    file = save_model(paper().with_(stiffness=1.5), tmp_path / "model.json")
    rows = {"stiffness": {"value": 1.5, "std": 0.1}, "damping": {"value": 8e-3, "std": 1e-3}}
    spread = {"names": ["stiffness", "damping"], "hidden": [False, False], "matrix": [[0.01, 0.0], [0.0, 1e-6]]}
    fit = tmp_path / "metrics.json"
    fit.write_text(json.dumps({"fits": {"first": {"parameters": rows, "covariance": spread}}}))
    done = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py", "--fit", fit)
    assert done.exit_code == 0, done.output
    arm = loaded(tmp_path / "arm.py")
    assert set(arm.SLOPES) == {"stiffness", "damping"}
    np.testing.assert_allclose(arm.SLOPES["stiffness"], [np.ones(5), np.zeros(5)], atol=1e-9)
    np.testing.assert_allclose(arm.FACTOR @ arm.FACTOR.T, spread["matrix"], atol=1e-12)
    invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py")
    assert not hasattr(loaded(tmp_path / "arm.py"), "draws")


def test_a_fit_too_uncertain_to_draw_from_is_refused(tmp_path):
    model = paper().with_(stiffness=1.5, memory=Memory((0.1,), (0.5,)))
    vague = KNOWN._replace(covariance=np.diag([0.01, 1e8]))
    with pytest.raises(pliant.InputError, match=r"lie within the bounds of its parameters, which are too uncertain"):
        jax_arm(model, tmp_path, uncertainty=vague)


def test_draws_of_a_fit_keep_its_bounds_and_its_covariance(tmp_path, double):
    """From metrics.json, through the command: parameters that depend on each other, one close to a bound of its own."""
    model = paper().with_(memory=Memory((0.1,), (0.5,)))
    values = {"stiffness": 1.6067, "damping": 8e-3, "creep_share_1": 0.1}
    std, lower = np.array([0.02, 4e-4, 0.02]), 0.09
    correlation = np.array([[1.0, -0.3, -0.8], [-0.3, 1.0, 0.2], [-0.8, 0.2, 1.0]])
    rows = {n: {"value": v, "std": s, "lower": None, "upper": None}
            for (n, v), s in zip(values.items(), std, strict=True)}  # fmt: skip
    spread = {"names": [*values], "hidden": [False] * 3, "matrix": (correlation * np.outer(std, std)).tolist()}
    rows["creep_share_1"]["lower"] = lower
    (tmp_path / "metrics.json").write_text(json.dumps({"fits": {"first": {"parameters": rows, "covariance": spread}}}))
    file = save_model(model, tmp_path / "model.json")
    done = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py", "--fit", tmp_path / "metrics.json")
    assert done.exit_code == 0, done.output
    arm = loaded(tmp_path / "arm.py")
    bodies = arm.draws(20_000, double.random.key(3))
    assert {k: v.shape for k, v in bodies.items()} == {k: (20_000, *v.shape) for k, v in arm.parameters.items()}
    drawn = np.stack([bodies["stiffness"][:, 0], bodies["damping"][:, 4], bodies["creep_share"][:, 0]])
    mean, matrix = np.array([*values.values()]), np.array(spread["matrix"])
    wanted = np.random.default_rng(0).multivariate_normal(mean, matrix, 40_000)
    wanted = wanted[(wanted >= [0.0, 0.0, lower]).all(axis=1)].T
    assert drawn[2].min() >= lower
    np.testing.assert_allclose((drawn.mean(axis=1) - wanted.mean(axis=1)) / std, 0.0, atol=0.04)
    np.testing.assert_allclose((np.cov(drawn) - np.cov(wanted)) / np.outer(std, std), 0.0, atol=0.04)
    models = draw_models(model, tmp_path / "metrics.json", 40, 0)
    assert min(m.memory.creep_share[0] for m in models) >= lower


def test_a_fit_of_another_model_is_refused(tmp_path):
    file = save_model(paper(), tmp_path / "model.json")
    rows = {"stiffness": {"value": 1.5, "std": 0.1}}
    spread = {"names": ["stiffness"], "hidden": [False], "matrix": [[0.01]]}
    fit = tmp_path / "metrics.json"
    fit.write_text(json.dumps({"fits": {"first": {"parameters": rows, "covariance": spread}}}))
    refused = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py", "--fit", fit)
    assert refused.exit_code != 0
    assert "the fit is not that of this model: stiffness is 1.5 by the fit and 1.6067 in the model" in str(
        refused.exception)
    assert not (tmp_path / "arm.py").exists()


def test_draws_change_the_parameters_of_segments_and_of_renamed_chambers(tmp_path):
    body = combined("flat_longer", "none", "plain")
    first, *others = body.chambers
    body = body.with_(chambers=(replace(first, name="side a"), *others))
    segment = body.extensions[0]
    values = {"side a.torque_1": first.torque[0], f"{segment.name}.axial_stiffness": segment.stiffness, "p.start": 0.1}
    rows = {name: {"value": value, "std": 0.1 * value} for name, value in values.items()}
    spread = {"names": [*values], "hidden": [False] * 3, "matrix": np.diag([(0.1 * v) ** 2 for v in values.values()])}
    fit = {"parameters": rows, "covariance": spread | {"matrix": spread["matrix"].tolist()}}
    (tmp_path / "metrics.json").write_text(json.dumps({"fits": {"first": fit}}))
    file = save_model(body, tmp_path / "model.json")
    done = invoke("export", file, "--to", "jax", "-o", tmp_path / "arm.py", "--fit", tmp_path / "metrics.json")
    assert done.exit_code == 0, done.output
    arm = loaded(tmp_path / "arm.py")
    assert arm.MEAN.tolist() == [*values.values()][:2]
    assert arm.SLOPES["torque"][0].ravel() == pytest.approx(np.eye(arm.parameters["torque"].size)[0], rel=1e-9)
    assert arm.SLOPES["axial_stiffness"][1].ravel() == pytest.approx([1.0, *[0.0] * (len(body.extensions) - 1)])
