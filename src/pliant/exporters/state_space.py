"""Export of a model, linearised about an equilibrium, as state-space matrices A, B, C, D, continuous or sampled.

MATLAB, NumPy and python-control can read them. In addition to the states of `pliant.linearise`, every branch of creep
adds its n states exactly: d xi/dt = (q - xi) / time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter, levels_in, with_identifiers
from pliant.files import whole
from pliant.linear import linearise
from pliant.linear.linearisation import LinearModel
from pliant.linear.sampled import sample
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import LATER_TERMS
from pliant.plugins import optional

Array = np.ndarray
NO_POINTS = "the outputs are the last tip, the joint angles and the strains, without other observed points"
CAN = LATER_TERMS | {
    "springs", "drive", "chambers", "lengthening", "space_lengthening", "curved_segments", "tied_segments", "gravity",
    "softening", "bounded", "law", "own_law", "lagging_law", "dead_time", "lag", "second_order", "settling", "creep",
    "space", "twist", "soft_swing", "tendons", "tendon_chords", "pair_pretension",
}


def linear_model(model: Model, pressure: float | Array = 0.0) -> LinearModel:
    """Return the model linearised about the equilibrium at a pressure [Pa], including the creep states of the joints.

    The additional states are the relaxed angles xi [rad] of every joint and branch, after all other states.

    Parameters
    ----------
    model : Model
    pressure : float, array (C,) of several chambers
        Gauge pressure of the equilibrium [Pa].

    Raises
    ------
    InputError, SimulationError
        As for `pliant.linearise`.
    """
    linear, n, size = linearise(model, pressure), model.n, model.size
    branches = list(zip(model.memory.creep_share, model.memory.creep_time, strict=True))
    N = linear.A.shape[0]
    A = np.zeros((N + n * len(branches), N + n * len(branches)))
    A[:N, :N] = linear.A
    relative = mechanics_of(model).to_joints[:n]
    M = mechanics_of(model).inertia(linear.position)
    answer = np.linalg.solve(M, relative.T)  # accelerations per torque at each joint
    names = []
    for j, (share, time) in enumerate(branches):
        rows = slice(N + j * n, N + (j + 1) * n)
        A[size : 2 * size, rows] = answer * (model.stiffness * share)  # a branch pulls the joint to its relaxed angle
        A[rows, :size], A[rows, rows] = relative / time, -np.eye(n) / time
        names += [f"creep_{j + 1}_{i + 1}" for i in range(n)]
    more = A.shape[0] - N
    B = np.concatenate([linear.B, np.zeros((more, linear.B.shape[1]))])
    C = np.concatenate([linear.C, np.zeros((linear.C.shape[0], more))], axis=1)
    return replace(linear, A=A, B=B, C=C, states=(*linear.states, *names))


def control_system(model: Model, pressure: float | Array = 0.0, period: float = 0.0) -> Any:
    """Return the model, linearised about an equilibrium, as a `control.StateSpace` object of python-control.

    `pressure` is in Pa, one for each chamber. If `period` > 0 [s], the system is sampled with a zero-order hold and
    includes the dead times. A continuous system does not include dead times: add that of each chamber's valve yourself.
    Dots in names, which python-control does not allow, become underscores.

    Raises
    ------
    InputError
        When python-control is not installed.
    """
    control = optional("control", "python-control is not installed: pip install 'pliant[export]'")
    system = matrices(model, pressure, period)
    labels = {"states": "state", "inputs": "input", "outputs": "output"}
    names = {which: [name.replace(".", "_") for name in system[key]] for which, key in labels.items()}
    return control.ss(system["A"], system["B"], system["C"], system["D"], *([period] if period else []), **names)


def matrices(model: Model, pressure: float | Array, period: float) -> dict[str, Any]:
    """Return A, B, C, D, operating point, names and units of a linearised model as a dict, as in the exported file."""
    model = with_identifiers(model)
    linear = linear_model(model, pressure)
    A, B, C, states, dead = linear.A, linear.B, linear.C, list(linear.states), linear.dead_times
    if period:
        plant = sample(linear, period)
        pairs = zip(model.actuation.labels("command"), plant.waiting, strict=True)  # past commands, as in `Sampled`
        waiting = [f"{label}_{k + 1}_periods_ago" for label, most in pairs for k in range(most)]
        A, B, states, dead = plant.A, plant.B, [*states, *waiting], np.zeros(dead.size)
        C = np.concatenate([C, np.zeros((C.shape[0], len(waiting)))], axis=1)
    point, units = operating_point(model, linear, states)
    inputs = model.actuation.labels("{kind}")
    return {
        "A": A, "B": B, "C": C, "D": linear.D, "period": period, "state": states, "input": inputs,
        "dead_time": dead, "output": list(linear.outputs), "state_unit": units,
        "input_unit": list(model.actuation.units),
        "output_unit": [output_unit(name) for name in linear.outputs],
        "operating_state": point, "operating_input": linear.pressures,
    }


def output_unit(name: str) -> str:
    """Return the unit of an output of the linearised model, from its name."""
    return "m" if name.startswith("tip") else "1" if name.startswith("strain") else "rad"


def operating_point(model: Model, linear: LinearModel, states: list[str]) -> tuple[Array, list[str]]:
    """Return the values (N,) of the states at the equilibrium, and their units. The matrices act on deviations from
    these values.
    """
    chain, zeros = mechanics_of(model), np.zeros(model.size)
    unit = ["1" if name.startswith("strain") else "rad" for name in chain.names]
    known = dict(zip(chain.names, zip(linear.position, unit, strict=True), strict=True))
    rates = [f"{u}/s" for u in unit]
    known |= dict(zip(chain.rate_names, zip(zeros, rates, strict=True), strict=True))
    joint = chain.joint_angles(linear.position)
    for name in states:
        if name.startswith("creep"):
            known[name] = (joint[int(name.rsplit("_", 1)[1]) - 1], "rad")
        elif name not in known:
            known[name] = of_input(model, name, linear.pressures)
    values, units = zip(*(known[name] for name in states), strict=True)
    return np.array(values), list(units)


def of_input(model: Model, name: str, level: Array) -> tuple[float, str]:
    """Return the equilibrium value and the unit of a state that describes the supply of an input: the pressure, the
    rate of the pressure, or a past command.
    """
    words = (model.actuation.labels(what) for what in ("{kind}", "{kind}_settling", "{kind}_rate", "command"))
    for p, unit, level_words, settling, rate, sent in zip(level, model.actuation.units, *words, strict=True):
        if name in (level_words, settling) or re.fullmatch(rf"{re.escape(sent)}_\d+_periods_ago", name):
            return float(p), unit
        if name == rate:
            return 0.0, f"{unit}/s"
    raise InputError(f"state-space cannot export state {name!r}, which belongs to no input of model {model.name!r}: "
                     "use another target")


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the state-space matrices of a model to a .mat or .npz file, and return its path."""
    if options["period"] < 0:
        raise InputError(f"state-space option period must be 0 (continuous) or > 0 s, got {options['period']}")
    level = levels_in("state-space", "pressure", options["pressure"])
    content = matrices(model, level, options["period"]) | {"pliant": provenance.json()}
    with whole(path) as draft, draft.open("wb") as file:
        if path.suffix == ".npz":
            arrays: dict[str, Any] = {k: np.asarray(v) for k, v in content.items()}
            np.savez(file, **arrays)
        else:
            from scipy.io import savemat

            cells = {k: np.array(v, dtype=object) if isinstance(v, list) else v for k, v in content.items()}
            savemat(file, cells)
    return (path,)


EXPORTER = Exporter(
    "state-space", "A, B, C, D about a rest (.mat or .npz)", (".mat", ".npz"), CAN, write,
    {"pressure": "0", "period": 0.0}, {"points": NO_POINTS},
)
