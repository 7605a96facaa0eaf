"""Convert recordings of a soft actuator's shape to a validated, real-time reduced-order model.

The public functions and classes, in the order in which an analysis uses them. Each is imported when it is first used,
so that ``import pliant`` loads nothing else.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pliant.version import __version__ as __version__

if TYPE_CHECKING:
    from pliant.errors import InputError, PliantError
    from pliant.estimation import estimate
    from pliant.exporters import export
    from pliant.identification import experiment, fit, predict
    from pliant.linear import linearise
    from pliant.model import Chamber, Model, chain_model, load_model, save_model
    from pliant.preprocessing.align import align
    from pliant.recording import read, write
    from pliant.simulation import Pulse, Step, Stepper, equilibrium, modes, simulate
    from pliant.study import adapt as adapt
    from pliant.study import load_study, run_study

_PAGE = {
    "pliant.recording": ("read", "write"),
    "pliant.preprocessing.align": ("align",),
    "pliant.model": ("Model", "Chamber", "chain_model", "load_model", "save_model"),
    "pliant.simulation": ("Pulse", "Step", "simulate", "Stepper", "equilibrium", "modes"),
    "pliant.identification": ("experiment", "fit", "predict"),
    "pliant.study": ("load_study", "run_study", "adapt"),
    "pliant.estimation": ("estimate",),
    "pliant.linear": ("linearise",),
    "pliant.exporters": ("export",),
    "pliant.errors": ("PliantError", "InputError"),
}
_HOME = {name: module for module, names in _PAGE.items() for name in names}

__all__ = [  # noqa: RUF022  in the order of an analysis
    "read", "write", "align",
    "Model", "Chamber", "chain_model", "load_model", "save_model",
    "Pulse", "Step", "simulate", "Stepper", "equilibrium", "modes",
    "experiment", "fit", "predict", "load_study", "run_study",
    "estimate", "linearise", "export",
    "PliantError", "InputError",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pliant' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
