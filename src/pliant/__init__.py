"""From recordings of a soft bending actuator's shape to a validated, real-time reduced-order model.

The public page, in the order of the journey. Names are loaded when they are first used, so that ``import pliant``
costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pliant.version import __version__ as __version__

if TYPE_CHECKING:
    from pliant.batch.batch import simulate_batch
    from pliant.contact import find_contact, map_contacts
    from pliant.control import design_lqr
    from pliant.errors import FitError, InputError, PliantError, SimulationError
    from pliant.estimation import estimate
    from pliant.exporters import export
    from pliant.identification import (
        Experiment,
        Parameter,
        experiment,
        fit,
        identifiability,
        predict,
        predict_held_out,
        prediction_band,
        select_model,
    )
    from pliant.linear import linearise
    from pliant.model import Chamber, Extension, Memory, Model, Station, Valve, chain_model, load_model, save_model
    from pliant.preprocessing.align import align
    from pliant.preprocessing.clusters import assemble
    from pliant.preprocessing.quality import quality
    from pliant.recording import make_recording, read, write
    from pliant.reduction import select_order
    from pliant.simulation import (
        Chirp,
        Multisine,
        Pulse,
        Stepper,
        Trace,
        equilibrium,
        modes,
        ramp,
        simulate,
        step,
        triangle,
    )
    from pliant.study import load_study, run_study
    from pliant.sweep.sweep import run_sweep

_PAGE = {
    "pliant.recording": ("read", "write", "make_recording"),
    "pliant.preprocessing.quality": ("quality",),
    "pliant.preprocessing.clusters": ("assemble",),
    "pliant.preprocessing.align": ("align",),
    "pliant.reduction": ("select_order",),
    "pliant.model": (
        "Model", "Chamber", "Extension", "Station", "Valve", "Memory", "chain_model", "load_model", "save_model",
    ),
    "pliant.simulation": (
        "Pulse", "step", "ramp", "triangle", "Chirp", "Multisine", "Trace",
        "simulate", "equilibrium", "modes", "Stepper",
    ),
    "pliant.batch.batch": ("simulate_batch",),
    "pliant.identification": (
        "Experiment", "experiment", "Parameter", "identifiability", "fit", "select_model", "predict",
        "predict_held_out", "prediction_band",
    ),
    "pliant.study": ("load_study", "run_study"),
    "pliant.sweep.sweep": ("run_sweep",),
    "pliant.estimation": ("estimate",),
    "pliant.contact": ("find_contact", "map_contacts"),
    "pliant.linear": ("linearise",),
    "pliant.control": ("design_lqr",),
    "pliant.exporters": ("export",),
    "pliant.errors": ("PliantError", "InputError", "SimulationError", "FitError"),
}
_HOME = {name: module for module, names in _PAGE.items() for name in names}

__all__ = [  # noqa: RUF022  in the order of the journey
    "read", "write", "make_recording", "quality", "assemble", "align", "select_order",
    "Model", "Chamber", "Extension", "Station", "Valve", "Memory", "chain_model", "load_model", "save_model",
    "Pulse", "step", "ramp", "triangle", "Chirp", "Multisine", "Trace", "simulate", "equilibrium", "modes", "Stepper",
    "simulate_batch",
    "Experiment", "experiment", "Parameter", "identifiability", "fit", "select_model", "predict", "predict_held_out",
    "prediction_band", "load_study", "run_study", "run_sweep",
    "estimate", "find_contact", "map_contacts", "linearise", "design_lqr", "export",
    "PliantError", "InputError", "SimulationError", "FitError",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pliant' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
