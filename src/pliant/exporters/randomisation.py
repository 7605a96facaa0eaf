"""Bodies as a fit cannot tell them apart: models drawn from its covariance, for domain randomisation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.identification import FitResult
from pliant.identification.parameters import apply, kind_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
Fit = FitResult | str | Path | Mapping[str, float]
FIELDS = ("stiffness", "damping", "link_mass", "tip_mass", "rest_angle")
TRIES = 50  # draws in a row of which none is a body


class Uncertainty(NamedTuple):
    """Parameters of a fit with their covariance, SI."""

    names: tuple[str, ...]
    mean: Array  # (P,)
    covariance: Array  # (P, P)


def draw_models(model: Model, fit: Fit, count: int, rng: np.random.Generator | int = 0) -> list[Model]:
    """Bodies drawn from what a fit knows of one: normal, by its covariance, within the bounds of each parameter.

    Parameters
    ----------
    model : Model
        That of the fit; what the fit did not free stays.
    fit : FitResult, path or mapping
        A fit, or the metrics.json of `pliant run`: parameters move together as the covariance has it. Or standard
        errors by fields of the model (``stiffness``, ``damping``, ``link_mass``, ``tip_mass``, ``rest_angle``), SI:
        each field takes one factor, apart from the others.
    count : int
    rng : Generator or int
        A generator, or its seed.

    Raises
    ------
    InputError
        When the fit has no covariance, a name is unknown, or hardly any draw is a body that finds a rest.
    """
    rng = np.random.default_rng(rng)
    known = None if isinstance(fit, Mapping) else uncertainty_of(model, fit)
    errors = checked_errors(model, fit) if isinstance(fit, Mapping) else {}
    found: list[Model] = []
    failed = 0
    while len(found) < count:
        try:
            body = scaled(model, errors, rng) if known is None else moved(model, known, rng)
            state.modes(body)
            found.append(body)
            failed = 0
        except (InputError, SimulationError) as error:
            failed += 1
            if failed == TRIES:
                raise InputError(f"{TRIES} draws in a row are no bodies, the last since {error}: the fit is too unsure "
                                 "for bodies to be drawn from it") from None  # fmt: skip
    return found


def scaled(model: Model, errors: Mapping[str, float], rng: np.random.Generator) -> Model:
    """The model with a factor of its own on each field."""
    factors = {name: 1.0 + error * rng.standard_normal() for name, error in errors.items()}
    return model.with_(**{name: factor * np.asarray(getattr(model, name)) for name, factor in factors.items()})


def moved(model: Model, known: Uncertainty, rng: np.random.Generator) -> Model:
    """The model with the parameters of a fit drawn anew; InputError where one leaves its bounds."""
    size = np.sqrt(np.diag(known.covariance))
    size = np.where(size > 0, size, 1.0)
    step = size * rng.multivariate_normal(np.zeros(size.size), known.covariance / np.outer(size, size), method="eigh")
    values = dict(zip(known.names, (known.mean + step).tolist(), strict=True))
    for name, value in values.items():
        kind = kind_of(name)
        if not kind.lower <= value <= kind.upper:
            raise InputError(f"{name} = {value:.4g} is out of its bounds {kind.lower:.4g} to {kind.upper:.4g}")
    return apply(model, values)


def uncertainty_of(model: Model, fit: FitResult | str | Path) -> Uncertainty:
    """Return the fitted parameters of the body with their covariance; those of single recordings are left out."""
    content = fit.to_dict() if isinstance(fit, FitResult) else first_fit(Path(fit))
    if content.get("covariance") is None:
        raise InputError("bodies are drawn from a fit with free parameters: this one has no covariance")
    try:
        return body_uncertainty(model, content["parameters"], content["covariance"])
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError):
        raise InputError(f"{fit} holds no fit whose parameters and covariance belong together: run the study again"
                         ) from None


def body_uncertainty(model: Model, rows: Mapping[str, Any], covariance: Mapping[str, Any]) -> Uncertainty:
    """Parameters of the body, from the rows and the covariance of a fit."""
    chambers = {c.name for c in model.chambers}
    keep = [
        k for k, (name, hidden) in enumerate(zip(covariance["names"], covariance["hidden"], strict=True))
        if not hidden and ("." not in name or name.partition(".")[0] in chambers)
    ]
    names = tuple(covariance["names"][k] for k in keep)
    matrix = np.asarray(covariance["matrix"], dtype=float)[np.ix_(keep, keep)]
    mean = np.array([float(rows[name]["value"]) for name in names])
    if not (np.isfinite(matrix).all() and np.isfinite(mean).all()):
        raise ValueError("a fit holds finite numbers")
    return Uncertainty(names, mean, matrix)


def first_fit(path: Path) -> dict[str, Any]:
    """The first fit of a metrics.json, which made the model."""
    try:
        fits = json.loads(path.read_text(encoding="utf-8"))["fits"]
        first: dict[str, Any] = next(iter(fits.values()))
        dict(first["parameters"])
    except (OSError, ValueError, LookupError, TypeError, AttributeError, StopIteration, RecursionError):
        raise InputError(f"{path} holds no fit: give metrics.json, as `pliant run` writes it") from None
    if "covariance" not in first:
        raise InputError(f"{path} was written by an older pliant and holds no covariance: run the study again")
    return first


def checked_errors(model: Model, errors: Mapping[str, float]) -> dict[str, float]:
    """Relative standard errors by field of the model."""
    found = {}
    for name, error in errors.items():
        if name not in FIELDS:
            raise InputError(f"{name!r} is no field that can be drawn: use {', '.join(FIELDS)}, or a whole fit")
        size = float(np.mean(np.abs(getattr(model, name))))
        if not (np.isfinite(error) and error >= 0 and size > 0):
            raise InputError(f"a standard error must be a finite number >= 0 of a field that is not zero, got {name}")
        found[name] = error / size
    return found
