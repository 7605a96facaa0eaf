"""Domain randomisation: random models drawn from the covariance of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.exporters.provenance import Uncertainty, first_fit
from pliant.identification import FitResult
from pliant.identification.parameters import apply, kind_of
from pliant.model import Model
from pliant.model.file import model_of
from pliant.simulation import state

Fit = FitResult | str | Path | Mapping[str, float]
FIELDS = ("stiffness", "damping", "link_mass", "tip_mass", "rest_angle")
TRIES = 50  # consecutive draws without a valid model, after which drawing fails


def draw_models(
    model: Model | str | Path, fit: Fit, count: int, rng: np.random.Generator | int = 0,
) -> list[Model]:
    """Return `count` models with random parameters, drawn from the uncertainty of a fit.

    The parameters are normally distributed with the covariance of the fit.

    Parameters
    ----------
    model : Model, str or Path
        Model of the fit, or the path of its model file. Parameters that were not fitted are kept.
    fit : FitResult, path or mapping
        A fit, or the path of the metrics.json of `pliant run`: parameters are drawn together by the covariance. Or a
        mapping from fields of the model (``stiffness``, ``damping``, ``link_mass``, ``tip_mass``, ``rest_angle``) to
        standard errors (SI): each field is multiplied by an independent factor.
    count : int
        Number of models.
    rng : numpy.random.Generator or int
        Random generator, or its seed.

    Raises
    ------
    InputError
        When the model file cannot be read, the fit has no covariance, a name is unknown, or nearly all draws are
        invalid or have no equilibrium.
    """
    model = model_of(model)
    rng = np.random.default_rng(rng)
    known = None if isinstance(fit, Mapping) else uncertainty_of(model, fit)
    errors = checked_errors(model, fit) if isinstance(fit, Mapping) else {}
    models: list[Model] = []
    failed = 0
    while len(models) < count:
        try:
            body = scaled(model, errors, rng) if known is None else moved(model, known, rng)
            state.modes(body)
            models.append(body)
            failed = 0
        except (InputError, SimulationError) as error:
            failed += 1
            if failed == TRIES:
                raise InputError(f"{TRIES} consecutive draws gave no valid model (the last: {error}), because the "
                                 "parameters are too uncertain: reduce their standard errors, by a fit to more "
                                 "recordings or with fewer free parameters") from None  # fmt: skip
    return models


def scaled(model: Model, errors: Mapping[str, float], rng: np.random.Generator) -> Model:
    """Return the model with each given field multiplied by a random factor 1 + error * N(0, 1)."""
    factors = {name: 1.0 + error * rng.standard_normal() for name, error in errors.items()}
    return model.with_(**{name: factor * np.asarray(getattr(model, name)) for name, factor in factors.items()})


def moved(model: Model, known: Uncertainty, rng: np.random.Generator) -> Model:
    """Return the model with parameter values drawn at random from a fit's covariance.

    Raises InputError if a parameter is outside its bounds.
    """
    size = np.sqrt(np.diag(known.covariance))
    size = np.where(size > 0, size, 1.0)
    step = size * rng.multivariate_normal(np.zeros(size.size), known.covariance / np.outer(size, size), method="eigh")
    values = dict(zip(known.names, (known.mean + step).tolist(), strict=True))
    for (name, value), lower, upper in zip(values.items(), *known.limits(), strict=True):
        if not lower <= value <= upper:
            raise InputError(f"parameter {name}: the value {value:.4g} drawn at random from the fit's covariance is "
                             f"out of its bounds {lower:.4g} to {upper:.4g}")  # fmt: skip
    return apply(model, values)


def uncertainty_of(model: Model, fit: FitResult | str | Path) -> Uncertainty:
    """Return the fitted parameters of the actuator and their covariance. Parameters that belong to a single recording
    are left out.
    """
    content = fit.to_dict() if isinstance(fit, FitResult) else first_fit(fit)
    if content.get("covariance") is None:
        raise InputError("models are drawn from a fit's covariance, and this fit has none: fit at least one parameter")
    try:
        return body_uncertainty(model, content["parameters"], content["covariance"])
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError):
        raise InputError(
            f"parameters and covariance of the fit {fit} do not match: run the study again to write a new metrics.json"
        ) from None


def uncertainty_within(model: Model | str | Path, fit: FitResult | str | Path) -> Uncertainty | None:
    """Return the fitted parameters of the actuator and their covariance, or None if the fit has no free parameter."""
    content = fit.to_dict() if isinstance(fit, FitResult) else first_fit(fit)
    return None if content.get("covariance") is None else uncertainty_of(model_of(model), fit)


def body_uncertainty(model: Model, rows: Mapping[str, Any], covariance: Mapping[str, Any]) -> Uncertainty:
    """Return the fitted parameters of the actuator and their covariance, from the tables of parameters and covariances
    in a saved fit. Parameters that belong to a single recording or station are left out.
    """
    owners = {"", *(c.name for c in model.chambers), *(e.name for e in model.extensions)}
    keep = [
        k for k, (name, hidden) in enumerate(zip(covariance["names"], covariance["hidden"], strict=True))
        if not hidden and name.rpartition(".")[0] in owners
    ]
    names = tuple(covariance["names"][k] for k in keep)
    matrix = np.asarray(covariance["matrix"], dtype=float)[np.ix_(keep, keep)]
    mean = np.array([float(rows[name]["value"]) for name in names])
    if not (np.isfinite(matrix).all() and np.isfinite(mean).all()):
        raise ValueError("its values or covariances are not finite")
    bounds = np.array([bounds_within(name, rows[name]) for name in names]).reshape(-1, 2)
    return Uncertainty(names, mean, matrix, bounds)


def bounds_within(name: str, row: Mapping[str, Any]) -> tuple[float, float]:
    """Return the bounds of a parameter in a saved fit, within those of its kind."""
    kind, lower, upper = kind_of(name), row.get("lower"), row.get("upper")
    return (kind.lower if lower is None else max(kind.lower, float(lower)),
            kind.upper if upper is None else min(kind.upper, float(upper)))


def checked_errors(model: Model, errors: Mapping[str, float]) -> dict[str, float]:
    """Return the standard errors of the model's fields as {field: fraction}, each relative to the mean absolute value
    of the field.
    """
    deviations = {}
    for name, error in errors.items():
        if name not in FIELDS:
            raise InputError(f"{name!r} is not a field that can be randomised: use {', '.join(FIELDS)}, or give a fit")
        size = float(np.mean(np.abs(getattr(model, name))))
        if not (np.isfinite(error) and error >= 0):
            raise InputError(f"the standard error of {name} must be finite and >= 0, got {error}")
        if not size > 0:
            raise InputError(f"{name} of the model is 0 and cannot be randomised by a factor: leave {name} out")
        deviations[name] = error / size
    return deviations
