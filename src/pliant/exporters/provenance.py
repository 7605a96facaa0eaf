"""Origin of an exported model, which is written into the exported file: version, command, units, frame, parameters."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.exporters.difference import Difference
from pliant.files import content_of
from pliant.identification.parameters import kind_of
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.file import model_to_dict, unit_of
from pliant.text import Form, escaped
from pliant.version import __version__


class Uncertainty(NamedTuple):
    """Fitted parameter values with their covariance matrix and the bounds of the fit, in SI units."""

    names: tuple[str, ...]
    mean: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    bounds: np.ndarray | None = None  # (P, 2) lower and upper; None: those of the kind of each parameter

    def limits(self) -> np.ndarray:
        """Return the lower and the upper bounds (2, P) of the values, infinite where there is none."""
        if self.bounds is not None:
            return self.bounds.T
        return np.array([[kind.lower, kind.upper] for kind in map(kind_of, self.names)]).reshape(-1, 2).T


@dataclass(frozen=True)
class Provenance:
    """Origin of an exported model, which is written into the exported file: parameters, command, omitted features and
    standard errors.
    """

    model: Model  # the model before features were omitted
    target: str
    command: str
    left_out: tuple[str, ...] = ()
    difference: Difference | None = None
    std: Mapping[str, float] = field(default_factory=dict)  # standard errors by the names of a fit
    notes: tuple[str, ...] = ()
    messages: list[str] = field(default_factory=list)  # added by the writer of the target
    uncertainty: Uncertainty | None = None  # of the fit that the model comes from

    def to_dict(self) -> dict[str, Any]:
        """Return the origin of an exported model as a dict of plain values."""
        content = model_to_dict(self.model)
        units = content.pop("units")
        for name in ("schema_name", "schema_version", "source", "name"):
            content.pop(name)
        return {
            "name": self.model.name, "made_by": f"pliant {__version__}", "target": self.target,
            "command": self.command, "frame": frame_of(self.model),
            "units": units, "parameters": content, "source": self.model.source,
            "standard_errors": dict(self.std) or "not known: the model file has none and no fit was given",
            "left_out": list(self.left_out), "notes": list(self.notes),
            "difference": self.difference.to_dict() if self.difference else None,
        }

    def json(self) -> str:
        """Return the origin of an exported model as JSON text."""
        return json.dumps(self.to_dict(), indent=1)

    def lines(self, form: Form) -> list[str]:
        """Return the origin of an exported model as lines of text, escaped for comments of the given file format."""
        content = self.to_dict()
        lines = [
            f"{content['name']}: {self.target} made by {content['made_by']}", f"command: {content['command']}",
            f"frame: {content['frame']}", "SI units throughout",
        ]
        units = {k: unit_of(k) for k in content["parameters"]}
        rows = [f"{k}: {json.dumps(v)} {units[k] if units[k] != '1' else ''}".rstrip()
                for k, v in content["parameters"].items()]  # fmt: skip
        standard = content["standard_errors"]
        errors = [f"{k}: {v:.4g}" for k, v in standard.items()] if isinstance(standard, dict) else [standard]
        source = [f"{k}: {v}" for k, v in content["source"].items()]
        sections = {"parameters": rows, "standard errors": errors, "source": source, "left out": self.sentences()}
        for title, part in sections.items():
            if part:
                lines += [f"{title}:", *(f"  {row}" for row in part)]
        return [escaped(line, form) for line in lines]

    def sentences(self) -> list[str]:
        """Return sentences that name the omitted features and how far the tip deviates from that of the original model
        because of the omissions. The notes of the export target follow.
        """
        left_out = [f"left out: {', '.join(self.left_out)}"] if self.left_out else []
        return [*left_out, *([str(self.difference)] if self.difference else []), *self.notes]


def frame_of(model: Model) -> str:
    """Return a text that states the base frame of an exported model and the units of its inputs."""
    inputs = "pressure is gauge, in Pa"
    if set(model.actuation.kinds) != {"pressure"}:
        units = (unit.replace("Pa", "Pa gauge") for unit in model.actuation.units)
        inputs = f"inputs: {', '.join(f'{n} [{u}]' for n, u in zip(model.actuation.names, units, strict=True))}"
    return f"{mechanics_of(model).frame}; {inputs}"


def command_of(source: Sequence[str], target: str, path: Path, options: Mapping[str, Any], *, approximate: bool) -> str:
    """Return the command line of `pliant export` that repeats an export of the model that the words `source` name."""
    parts = ["pliant", "export", *source, "--to", target, "-o", str(path), *(["--approximate"] if approximate else [])]
    return shlex.join([*parts, *(part for k, v in options.items() for part in ("--set", f"{k}={v}"))])


def standard_errors(path: str | Path) -> dict[str, float]:
    """Return {parameter: standard error} from the metrics.json of `pliant run`, or from a fit saved as JSON.

    For a file with several fits, the first one is used, which made the model.

    Raises
    ------
    InputError
        When the file cannot be read or holds no parameters.
    """
    rows = first_fit(path)["parameters"]
    return {name: row["std"] for name, row in rows.items() if row.get("std") is not None}


def first_fit(path: str | Path) -> dict[str, Any]:
    """Return the first fit in the metrics.json of `pliant run`, which is that of the chosen model, or a fit saved as
    JSON. The standard errors of its parameters are numbers or None.

    Raises
    ------
    InputError
        When the file cannot be read or holds no parameters.
    """
    text = content_of(path, "result of a fit")
    try:
        content: dict[str, Any] = json.loads(text)
        if "fits" in content:
            fits = content["fits"]
            content = next(iter(fits.values())) if isinstance(fits, dict) else fits[0]
        for row in content["parameters"].values():
            row["std"] = None if row.get("std") is None else float(row["std"])
    except (ValueError, LookupError, TypeError, StopIteration, AttributeError, OverflowError, RecursionError):
        raise InputError(f"{path} is not the result of a fit: give the metrics.json of `pliant run`") from None
    return content
