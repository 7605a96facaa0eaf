"""Export of a model as a Python module for JAX: one file that imports jax and numpy alone.

The functions are those of the files of `jax_source`, joined, and the kernels of the equations that these import. The
constants of `jax_source.structure` are the model's.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping, Sequence
from copy import deepcopy
from importlib import import_module
from importlib.resources import files
from keyword import iskeyword
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from pliant.compiler.c import tree_of
from pliant.compiler.trace import CURVED
from pliant.equations.laws import LAWS
from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.errors import InputError
from pliant.exporters.c_functions import DERIVED, UNIT, parameters
from pliant.exporters.provenance import Provenance, Uncertainty
from pliant.exporters.registry import Exporter
from pliant.files import write_text
from pliant.identification.parameters import apply
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.actuation_input import ActuationInput
from pliant.model.extensible import tied_joints
from pliant.model.features import FIRST_ORDER, RESTING, VALVES, named
from pliant.model.parts import declared
from pliant.simulation import state

Array = np.ndarray
FOLDER, EQUATIONS = "pliant.exporters.jax_source", "pliant.equations."
CAN = (RESTING - VALVES) | FIRST_ORDER
VALVE = ("rise_time", "fall_time", "rise_rate", "fall_rate")
RUBBER = ("swell_share", "swell_time", "inflation_limit", "inflation_time", "inflation_jm")
BOUCWEN = tuple(f"boucwen_{name}" for name in ("share", "beta", "gamma", "exponent"))
FIXED = ("tied", "dead_time", "boucwen", "valve", "rubber")  # written in another form, or part of the structure
FAR = 1e300  # in place of an infinite bound
SAME = 1e-6  # relative difference of two values that are equal but for the rounding of files
LEAST_WITHIN, STEP = 0.1, 1e-3  # fraction of draws within bounds; step of a derivative over the standard error
FORM = 5  # column of a chamber's constants that holds the number of its torque law


CHOICES = (  # features, the file that expresses them, and the one for models without them
    (("space",), "space", "plane"), (("tendons",), "tendons", "untied"),
    (("creep", "slip", "boucwen", "axial_memory"), "hysteresis", "forgetful"),
)


def exported_parameters(model: Model) -> dict[str, Array]:
    """Return the parameters of the exported module as {name: array}, in SI units."""
    values = parameters(model)
    plain = {k: v for k, v in values.items() if k not in DERIVED and k not in FIXED}
    columns = dict(zip(VALVE, values["valve"].T, strict=True))
    if any(c.swell_share or c.inflation_limit for c in model.chambers):
        columns |= dict(zip(RUBBER, values["rubber"].T, strict=True))
    if named(model, ("boucwen",)):
        columns |= dict(zip(BOUCWEN, values["boucwen"], strict=True))
    return {k: np.array(v, dtype=float) for k, v in (plain | columns).items()}


def units(model: Model) -> dict[str, str]:
    """Return the unit of each parameter of the exported module; those that depend on the input name it."""
    tendons = {"tendon_stiffness": "N/m", "beyond": "1", "chord": "m"}
    known = UNIT | {d.name: d.quantity.unit for d in declared()} | tendons
    inputs = ", ".join(dict.fromkeys(model.actuation.units))
    unit_of = {name: f"{inputs.replace(', ', '/s, ')}/s" for name in ("rise_rate", "fall_rate")}
    unit_of |= {"torque": f"N m, or N of a tendon, over powers of {inputs}", "joint_gain": "1, or m of a strain"}
    return {name: unit_of.get(name, known.get(name, "1")) for name in exported_parameters(model)}


def structure(model: Model) -> dict[str, str]:
    """Return the constants of `jax_source.structure` for a model, as Python expressions by their names."""
    chain, memory = mechanics_of(model), model.memory
    remembering, columns = chain.memory_shape
    counts = len(memory.creep_share), len(memory.slip_share), int(memory.boucwen_share > 0)
    axial = len(memory.axial_creep_share), len(memory.axial_slip_share)
    curved = bool(chain.laws & CURVED)
    points = [(p.along, p.across, p.aside) for p in model.points]
    return {
        "LINKS": repr(model.n), "SEGMENTS": repr(len(model.extensions)),
        "TURNS": repr(model.turns), "ROD": repr(model.mass_at == "rod"),
        "SPRING_TERMS": repr(tuple(SPRING_TERMS)), "SPRING_BOUND": repr(SPRING_BOUND), "CURVED": repr(curved),
        "TIED": table(tied_joints(model) if curved else np.zeros((model.n, 0))), "BRANCHES": repr(counts),
        "AXIAL_BRANCHES": repr(axial), "REMEMBERING": repr(remembering), "COLUMNS": repr(columns),
        "CHAMBERS": repr(chamber_kinds(model.chambers)),
        "LIMITED": f"np.array({[bool(c.valve.rise_rate or c.valve.fall_rate) for c in model.chambers]})",
        "RUBS": repr(model.actuation.tendons_rub),
        "POINT_LINK": f"np.array({[int(p.link) for p in model.points]}, dtype=int)",
        "POINT": table(np.array(points, dtype=float).reshape(-1, 3)),
        "START": table(state.equilibrium(model, np.zeros(model.actuation.count))),
    }


def posterior(model: Model, known: Uncertainty | None) -> dict[str, str]:
    """Return the constants of `jax_source.posterior` as Python expressions by their names; {} without a covariance.

    Raises
    ------
    InputError
        When the model does not have the values of the fit, or less than one in ten random draws lies within the bounds
        of the fit.
    """
    if known is None or not known.names:
        return {}
    check_values(model, known)
    lower, upper = np.clip(known.limits(), -FAR, FAR)
    size = np.sqrt(np.diag(known.covariance))
    scale = np.where(size > 0, size, 1.0)
    value, turn = np.linalg.eigh(known.covariance / np.outer(scale, scale))
    factor = scale[:, None] * turn * np.sqrt(np.maximum(value, 0.0))
    tried = known.mean + np.random.default_rng(0).standard_normal((2000, scale.size)) @ factor.T
    within = float(np.mean(((tried >= lower) & (tried <= upper)).all(axis=1)))
    if within < LEAST_WITHIN:
        raise InputError(f"{100 * within:.1f} % of the draws from the fit's covariance lie within the bounds of its "
                         "parameters, which are too uncertain: fit to more recordings or with fewer free parameters, "
                         "or export without the fit")  # fmt: skip
    slopes = parameter_slopes(model, known, STEP * scale)
    rows = [f"    {k!r}: {table(v)}," for k, v in slopes.items()]
    arrays = {"MEAN": known.mean, "LOWER": lower, "UPPER": upper, "FACTOR": factor}
    return {k: table(v) for k, v in arrays.items()} | {"SLOPES": "\n".join(["{", *rows, "}"])}


def check_values(model: Model, known: Uncertainty) -> None:
    """Raise InputError unless the model has the fitted values, around which its parameters are drawn."""
    values = dict(zip(known.names, known.mean.tolist(), strict=True))
    own, fitted = exported_parameters(model), exported_parameters(apply(model, values))
    for name, value in own.items():
        same_shape = fitted[name].shape == value.shape
        apart = ~np.isclose(fitted[name], value, rtol=SAME, atol=0.0) if same_shape else np.array(True)
        if apart.any():
            by_fit, saved = (listed(v[apart] if same_shape else v) for v in (fitted[name], value))
            raise InputError(
                f"the fit is not that of this model: {name} is {by_fit} by the fit and {saved} "
                "in the model: export the model that was saved with this fit"
            )


def listed(values: Array) -> str:
    """Return numbers with eight digits, separated by commas; equal ones once."""
    return ", ".join(dict.fromkeys(f"{v:.8g}" for v in np.ravel(values)))


def parameter_slopes(model: Model, known: Uncertainty, steps: Array) -> dict[str, Array]:
    """Return the derivatives (P, ...) of those exported parameters that change with the P fitted values."""
    base, rows = exported_parameters(model), {name: [] for name in exported_parameters(model)}  # type: ignore[var-annotated]
    for k, h in enumerate(steps):
        ends = []
        for sign in (-1.0, 1.0):
            moved = known.mean + sign * h * np.eye(steps.size)[k]
            values = dict(zip(known.names, moved.tolist(), strict=True))
            try:
                ends.append((sign, exported_parameters(apply(model, values))))
            except InputError:  # at a physical limit: the other side alone
                ends.append((0.0, base))
        (first, low), (last, high) = ends
        if last == first:
            raise InputError(f"parameter {known.names[k]}: the model takes no value beside {known.mean[k]:.4g}, around "
                             "which the fit would draw: export without the fit")  # fmt: skip
        for name, slopes in rows.items():
            slopes.append((high[name] - low[name]) / (h * (last - first)))
    return {name: np.array(slopes) for name, slopes in rows.items() if np.any(slopes)}


def table(values: Array) -> str:
    """Return a Python expression of an array, with all digits."""
    return f"np.array({values.tolist()!r}, dtype=float).reshape({values.shape!r})"


def chamber_kinds(chambers: tuple[ActuationInput, ...]) -> tuple[Any, ...]:
    """Return the inputs grouped by the kind of their torque: indices, law, lag, inflation and Gent's wall."""
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for i, c in enumerate(chambers):
        if any(law.name == c.law and branches(law.lever) for law in LAWS):
            raise InputError(f"torque law {c.law!r}: not expressible in jax, since it branches: use a polynomial")
        kind = int(c.kernel()[1 + FORM]), bool(c.swell_share), bool(c.inflation_limit), bool(c.inflation_jm)
        kinds.setdefault(kind, []).append(i)
    return tuple((tuple(rows), *kind) for kind, rows in kinds.items())


def sources(model: Model) -> list[str]:
    """Return the files of `jax_source` that a model needs, in the order in which they are joined."""
    body, cords, past = (file if named(model, keys) else other for keys, file, other in CHOICES)
    return ["structure", "numerics", "springs", body, "inputs", cords, past, "motion"]


def source(name: str) -> str:
    """Return the text of a file of `jax_source`."""
    return (files(FOLDER) / f"{name}.py").read_text(encoding="utf-8")


def stripped(name: str) -> str:
    """Return the text of a file of `jax_source` without its docstring and imports."""
    text = source(name)
    rows = text.splitlines()
    for node in reversed(ast.parse(text).body):
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if docstring or isinstance(node, ast.Import | ast.ImportFrom):
            del rows[node.lineno - 1 : node.end_lineno]
    return "\n".join(rows).strip()


def kernels(names: Sequence[str]) -> list[str]:
    """Return the texts of the kernels and records of the equations that files of `jax_source` import, and of the
    functions and tables that these use.
    """
    texts: dict[str, str] = {}
    for node in (node for name in names for node in ast.parse(source(name)).body):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(EQUATIONS):
            for alias in node.names:
                add_kernel(texts, alias.name, getattr(import_module(str(node.module)), alias.name))
    return list(texts.values())


def add_kernel(texts: dict[str, str], name: str, value: Any) -> None:
    """Add a kernel with what it uses, a record or a table of numbers to the dict `texts` under its name."""
    if name in texts:
        return
    if not isinstance(value, FunctionType):
        texts[name] = inspect.getsource(value).strip() if isinstance(value, type) else f"{name} = {value!r}"
        return
    traced = TracedKernel(value)
    texts[name] = ast.unparse(traced.visit(deepcopy(tree_of(value))))
    for other, used in traced.used.items():
        add_kernel(texts, other, used)


def branches(kernel: Any) -> bool:
    """Return whether a kernel, or one that it uses, branches, which JAX does not trace."""
    tree, traced = tree_of(kernel), TracedKernel(kernel)
    if any(isinstance(node, ast.If | ast.IfExp | ast.While) for node in ast.walk(tree)):
        return True
    traced.visit(tree)
    return any(branches(used) for used in traced.used.values() if isinstance(used, FunctionType))


class TracedKernel(ast.NodeTransformer):
    """Translation of a kernel without branches on traced numbers to JAX: NumPy becomes `jax.numpy`, a real part, which
    a derivative by a complex step leaves out, a part that is not differentiated, and names of numbers their values.

    Attributes
    ----------
    used : dict
        The functions and tables of numbers that the kernel uses, by name.
    """

    def __init__(self, kernel: FunctionType) -> None:
        self.used: dict[str, Any] = {}
        self._condition = False
        names = kernel.__code__.co_names
        self._globals = {name: value for name, value in kernel.__globals__.items() if name in names}

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Return a name, or the number for which it stands."""
        value = self._globals.get(node.id)
        if isinstance(value, int | float):
            return ast.Constant(value)
        if isinstance(value, FunctionType | tuple):
            self.used[node.id] = value
        return ast.Name("jnp", node.ctx) if value is np else node

    def visit_If(self, node: ast.If) -> ast.If:
        """Return a condition on a constant of the exported module, of which real parts stay, and its branches."""
        self._condition = True
        node.test = self.visit(node.test)
        self._condition = False
        node.body, node.orelse = ([self.visit(s) for s in part] for part in (node.body, node.orelse))
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """Return an attribute, of a real part the value without derivatives."""
        self.generic_visit(node)
        if node.attr != "real" or self._condition:
            return node
        return ast.parse(f"lax.stop_gradient({ast.unparse(node.value)})", mode="eval").body


def with_values(text: str, values: Mapping[str, str]) -> str:
    """Return the text of `structure` with the values of a model in place of its own."""
    rows: list[str | None] = list(text.splitlines())
    for node in ast.parse(text).body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(target, ast.Name):
            _, mark, comment = str(rows[node.lineno - 1]).partition("  # ")
            assignment = f"{target.id} = {values[target.id]}{mark}{comment}" if target.id in values else None
            rows[node.lineno - 1] = assignment
    return "\n".join(row for row in rows if row is not None)


def code(model: Model, provenance: Provenance) -> str:
    """Return the text of the exported module."""
    names = {
        "inputs": tuple(model.actuation.names), "input_units": tuple(model.actuation.units),
        "stations": tuple(p.name for p in model.points), "coordinates_of": tuple(mechanics_of(model).names),
        "memory_of": model.memory.labels,
    }
    head = ["# " + line for line in provenance.lines("line")]
    value_lines = [f"    {k!r}: {table(v)}," for k, v in exported_parameters(model).items()]
    unit_lines = [f"    {k!r}: {v!r}," for k, v in units(model).items()]
    drawn = posterior(model, provenance.uncertainty)
    parts = [
        "\n".join(head), MODULE_DOCSTRING, IMPORTS, with_values(stripped("structure"), structure(model)),
        "\n".join(["parameters = {  # of the model, in SI units: a pytree", *value_lines, "}"]),
        "\n".join(["units = {", *unit_lines, "}"]), "\n".join(f"{k} = {v!r}" for k, v in names.items()),
        *kernels(sources(model)), *(stripped(name) for name in sources(model)[1:]),
        *(["\n".join(f"{k} = {v}" for k, v in drawn.items()), stripped("posterior")] if drawn else []),
    ]
    return "\n\n\n".join(parts) + "\n"


IMPORTED = ("jax", "numpy", "typing")
IMPORTS = """from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax"""
MODULE_DOCSTRING = '''"""An actuator in JAX: rest, step, rollout and observe, functions of `parameters` and states.

Precision is that of the parameters: call jax.config.update("jax_enable_x64", True) before the first use for 64 bit.
"""'''


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:  # noqa: ARG001
    """Write a model as a module for JAX to `path`, and return the path.

    Raises
    ------
    InputError
        When Python cannot import a file of this name, or would import it in place of a package that the module needs.
    """
    if not path.stem.isidentifier() or iskeyword(path.stem) or path.stem in IMPORTED:
        raise InputError(f"{path.name} cannot be imported as a Python module: use a name of letters, digits and "
                         f"underscores that is not a keyword of Python, nor {', '.join(IMPORTED)}")  # fmt: skip
    return (write_text(path, code(model, provenance)),)


EXPORTER = Exporter("jax", "JAX: one Python module with gradients, for CPU and GPU", (".py",), CAN, write, draws=True)
