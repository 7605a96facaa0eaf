"""Registry of export targets, built-in or from other packages, and the function `export`.

Another package adds a target by an entry point of the group ``pliant.exporters`` that refers to an `Exporter`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.exporters.difference import Difference, difference
from pliant.exporters.features import without
from pliant.exporters.provenance import Provenance, Uncertainty, command_of
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import missing, named
from pliant.model.file import model_of
from pliant.plain import plain
from pliant.plugins import offered
from pliant.text import escaped, identifiers, listed
from pliant.units import in_words

GROUP = "pliant.exporters"

BUILT_IN = {
    "mjcf": "pliant.exporters.mjcf:EXPORTER",
    "c99": "pliant.exporters.c99:EXPORTER",
    "fmu": "pliant.exporters.fmu:EXPORTER",
    "state-space": "pliant.exporters.state_space:EXPORTER",
    "urdf": "pliant.exporters.urdf:EXPORTER",
    "jax": "pliant.exporters.jax_module:EXPORTER",
}


KINDS = {"station": "stations", "chamber": "chambers", "segment": "extensions"}


Array = np.ndarray


def stated_levels(target: str, option: str, text: str, model: Model) -> Array:
    """Return the levels (C,) [SI] of C inputs that the text of an option states. One number holds for all inputs if
    these have the same unit, or if it is 0.
    """
    levels, actuation = levels_in(target, option, text), model.actuation
    if levels.size == actuation.count or (levels.size == 1 and (not levels[0] or len(set(actuation.units)) == 1)):
        return np.broadcast_to(levels, actuation.count)
    named = ", ".join(f"{name} [{unit}]" for name, unit in zip(actuation.names, actuation.units, strict=True))
    raise InputError(f"{target} option {option} gives {levels.size} number(s) for the inputs {named}: give one for "
                     "each, separated by commas")  # fmt: skip


def range_note(model: Model, highest: Array) -> str:
    """Return the note of an export that states the default range of its controls, up to `highest` (C,) [SI]."""
    names, units = model.actuation.names, model.actuation.units
    words = [in_words(*limit) for limit in zip(highest, units, strict=True)]
    several = len(set(units)) > 1
    upper = ", ".join(f"{word} ({name})" for word, name in zip(words, names, strict=True)) if several else words[0]
    listed = ", ".join(units) if several else units[0]
    return f"controls range from 0 to {upper}: set highest ({listed}) for another range"


def levels_in(target: str, option: str, text: str) -> Array:
    """Return the levels (C,) [SI] that the text of an option states: one number, or numbers separated by commas."""
    try:
        return np.array([float(part) for part in text.strip("[]() ").split(",")])
    except ValueError:
        raise InputError(f"{target} option {option} must be a number in Pa for each chamber (N, m or rad for each "
                         f"tendon), separated by commas, got {text!r:.60}") from None  # fmt: skip


def with_identifiers(model: Model) -> Model:
    """Return the model with its own name, and those of its stations, chambers and segments, as valid identifiers.

    Names of one kind remain different from each other. Joints keep their names, ``q_1`` ... ``q_n`` in a plane, and no
    station receives one of them. A model whose names are valid is returned unchanged.
    """
    joints = mechanics_of(model).joint_names[: model.size - len(model.extensions)]
    changes: dict[str, Any] = {"name": escaped(model.name, "identifier")}
    for kind, attribute in KINDS.items():
        parts = getattr(model, attribute)
        names = identifiers([part.name for part in parts], joints if kind == "station" else ())
        changes[attribute] = tuple(
            part if part.name == name else part._replace(name=name) if kind == "station" else replace(part, name=name)
            for part, name in zip(parts, names, strict=True)
        )
    same = all(getattr(model, attribute) == value for attribute, value in changes.items())
    return model if same else model.with_(**changes)


def changed_names(model: Model) -> tuple[str, ...]:
    """Return a note for each name that an export changes, such as "station 'a b' is named a_b"."""
    written = with_identifiers(model)
    return tuple(
        f"{kind} {escaped(repr(old.name), 'line')} is named {new.name}" for kind, attribute in KINDS.items()
        for old, new in zip(getattr(model, attribute), getattr(written, attribute), strict=True) if old.name != new.name
    )


def renamed(known: Uncertainty | None, model: Model) -> Uncertainty | None:
    """Return fitted values whose names begin with the exported names of the model's parts, see `with_identifiers`."""
    if known is None:
        return None
    written = with_identifiers(model)
    parts = {old.name: new.name for attribute in KINDS.values()
             for old, new in zip(getattr(model, attribute), getattr(written, attribute), strict=True)}  # fmt: skip
    owners = [name.rpartition(".") for name in known.names]
    return known._replace(names=tuple(f"{parts.get(owner, owner)}{dot}{name}" for owner, dot, name in owners))


@dataclass(frozen=True)
class Exporter:
    """An export target: its name, file extensions, supported model features, options and writing function.

    Attributes
    ----------
    name : str
        Name of the target in ``pliant export --to NAME``.
    title : str
        Short description of the exported file.
    suffixes : tuple of str
        Allowed file extensions, the usual one first.
    can : frozenset of str
        Keys of `pliant.model.features.FEATURES` that the target can express.
    write : callable
        ``write(model, provenance, path, options) -> tuple of Path``. The model has only features that the target can
        express; `provenance` is written into the exported file.
    options : dict
        Options with their defaults; a given value is converted to the default's type.
    by_nature : dict
        Features that no file of this kind can contain, with a note for the user. They are omitted without an error.
    moves : bool
        Whether the exported model moves under pressure, so that omitted features show in a difference of motion. If
        not, an approximate export is not possible.
    draws : bool
        Whether the target writes random parameters by the covariance of a fit.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    can: frozenset[str]
    write: Callable[[Model, Provenance, Path, Mapping[str, Any]], tuple[Path, ...]]
    options: Mapping[str, Any] = field(default_factory=dict)
    by_nature: Mapping[str, str] = field(default_factory=dict)
    moves: bool = True
    draws: bool = False


@dataclass(frozen=True, repr=False)
class Exported(Shown):
    """Result of an export: the written files, the omitted features, and how far the tip deviates from that of the
    original model because of the omissions.

    Attributes
    ----------
    target : str
    files : tuple of Path
    left_out : tuple of str
        Names of the omitted features; empty for an exact export.
    difference : Difference or None
        Difference of motion that the omitted features cause.
    notes : tuple of str
    """

    target: str
    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    difference: Difference | None
    notes: tuple[str, ...]

    def card(self) -> Card:
        """Return a printable summary of an export: the files, the omitted features, and how far the tip deviates from
        that of the original model because of the omissions.
        """
        left = [f"left out: {', '.join(self.left_out)}"] if self.left_out else ["nothing was left out"]
        apart = [str(self.difference)] if self.difference else []
        return Card(f"Exported to {self.target}: {', '.join(map(str, self.files))}", [*left, *apart, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return the result of an export as plain values, for JSON."""
        difference = self.difference.to_dict() if self.difference else None
        return {**plain(self), "files": [str(f) for f in self.files], "difference": difference}


def exporters() -> dict[str, Exporter]:
    """Return all known export targets as {name: Exporter}, built-in ones first."""
    return offered(GROUP, BUILT_IN, Exporter)


def export(
    model: Model | str | Path,
    target: str,
    path: str | Path,
    *,
    approximate: bool = False,
    standard_errors: Mapping[str, float] | None = None,
    uncertainty: Uncertainty | None = None,
    origin: Sequence[str] = (),
    **options: Any,
) -> Exported:
    """Export a model to another tool: MuJoCo, C, an FMU, state space, URDF or JAX.

    Parameters
    ----------
    model : Model, str or Path
        A model, or the path of a model file. Exported numbers are in SI units, pressures in Pa gauge.
    target : str
        One of `pliant.exporters.exporters()`: ``mjcf``, ``c99``, ``fmu``, ``state-space``, ``urdf``, ``jax``.
    path : str or Path
        File to write, with a file extension of the target.
    approximate : bool
        Omit features that the target cannot express, compute the resulting difference of motion under a pulse of each
        input up to the end of the control range, and write both into the exported file. Default: raise an error that
        names these features.
    standard_errors : mapping
        Standard errors by parameter name (SI), to be written into the exported file.
    uncertainty : Uncertainty
        Covariance of the fit, by `pliant.exporters.randomisation.uncertainty_of`, from which a target with `draws`
        writes random parameters.
    origin : sequence of str
        Words that name the model in the command that the exported file states. Default: the path of the model file.
    **options
        Options of the target, such as ``prefix`` of mjcf.

    Returns
    -------
    Exported
        Files, omitted features and difference of motion.

    Raises
    ------
    InputError
        For an unknown target, file extension or option, a feature that the target cannot express, or a path that
        cannot be written.

    Examples
    --------
    >>> import pliant
    >>> pliant.export("model.json", "mjcf", "finger.xml")  # doctest: +SKIP
    """
    exporter = exporter_of(target)
    path, loaded = Path(path), model_of(model)
    if path.suffix not in exporter.suffixes:
        raise InputError(f"the file name for {target} must end in {' or '.join(exporter.suffixes)}, got {path.name!r}")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: the folder {path.parent} does not exist; create it first")
    chosen = checked_options(exporter, options)
    source = origin or ("MODEL.json" if isinstance(model, Model) else str(model),)
    command = command_of(source, target, path, options, approximate=approximate)
    lost = tuple(k for k in missing(loaded, exporter.can) if k not in exporter.by_nature)
    if lost and not exporter.moves:
        raise InputError(
            f"{', '.join(named(loaded, lost))}: not expressible in {target}, which has no springs and no pressure, "
            "so that the difference cannot be measured: export a model without this feature"
        )
    if lost and not approximate:
        raise InputError(
            f"{', '.join(named(loaded, lost))}: not expressible in {target}: use approximate (--approximate) to omit "
            "it and to measure by how much the motion then differs"
        )
    reduced = without(loaded, lost)
    notes = tuple(dict.fromkeys(s for k, s in exporter.by_nature.items() if k in missing(loaded, exporter.can)))
    notes += changed_names(loaded)
    highest = stated_levels(target, "highest", chosen["highest"], loaded) if "highest" in chosen else None
    provenance = Provenance(
        loaded, target, command, named(loaded, lost), difference(loaded, reduced, highest) if lost else None,
        dict(standard_errors or {}), notes, uncertainty=renamed(uncertainty, loaded),
    )
    files = exporter.write(with_identifiers(reduced), provenance, path, chosen)
    return Exported(target, files, provenance.left_out, provenance.difference, (*notes, *provenance.messages))


def exporter_of(target: str) -> Exporter:
    """Return the exporter with the name `target`; raise InputError with a list of the known names if there is none."""
    known = exporters()
    if target not in known:
        raise InputError(f"unknown target {target!r}: use one of {', '.join(known)}")
    return known[target]


def checked_options(exporter: Exporter, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return all options of an export target. A given value replaces the default and is converted to the default's
    type.
    """
    known = dict(exporter.options)
    for name, value in given.items():
        if name not in known:
            raise InputError(f"{exporter.name} has no option {name!r}: its options are {listed(known) or 'none'}")
        kind = type(known[name])
        try:
            known[name] = kind(value)
        except (TypeError, ValueError):
            raise InputError(f"{exporter.name} option {name} must be a {kind.__name__}, got {value!r}") from None
    return known
