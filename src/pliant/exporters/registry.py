"""Which target a model can be exported to: the built-in ones and those of other packages, and the export itself.

Another package adds a target by an entry point of the group ``pliant.exporters`` that leads to an `Exporter`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.exporters.difference import Difference, difference
from pliant.exporters.features import missing, named, without
from pliant.exporters.names import changed_names, with_identifiers
from pliant.exporters.provenance import Provenance, command_of
from pliant.model import Model, load_model
from pliant.plugins import offered

GROUP = "pliant.exporters"

BUILT_IN = {
    "mjcf": "pliant.exporters.mjcf:EXPORTER",
    "c99": "pliant.exporters.c99:EXPORTER",
    "fmu": "pliant.exporters.fmu:EXPORTER",
    "state-space": "pliant.exporters.state_space:EXPORTER",
    "urdf": "pliant.exporters.urdf:EXPORTER",
}


@dataclass(frozen=True)
class Exporter:
    """One target.

    Attributes
    ----------
    name : str
        As in ``pliant export --to NAME``.
    title : str
        What comes out, in a few words.
    suffixes : tuple of str
        Endings of the file, the usual one first.
    can : frozenset of str
        Keys of `pliant.exporters.features.FEATURES` that the target expresses.
    write : callable
        ``write(model, provenance, path, options) -> tuple of Path``; the model has only what the target can express,
        `provenance` goes into the artefact.
    options : dict
        Options with their defaults, whose type a given value must have.
    by_nature : dict
        Features that no artefact of this kind carries, with the sentence that says so: left out, not refused.
    moves : bool
        Whether the artefact moves under pressure, so that what it leaves out shows in a difference of motion. One that
        does not is never approximate.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    can: frozenset[str]
    write: Callable[[Model, Provenance, Path, Mapping[str, Any]], tuple[Path, ...]]
    options: Mapping[str, Any] = field(default_factory=dict)
    by_nature: Mapping[str, str] = field(default_factory=dict)
    moves: bool = True


@dataclass(frozen=True, repr=False)
class Exported(Shown):
    """Result of an export.

    Attributes
    ----------
    target : str
    files : tuple of Path
    left_out : tuple of str
        What the target cannot express, by name; empty for an exact export.
    difference : Difference or None
        By how much the motion differs for what was left out, m.
    notes : tuple of str
    """

    target: str
    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    difference: Difference | None
    notes: tuple[str, ...]

    def card(self) -> Card:
        """Files, what was left out, what it costs."""
        left = [f"left out: {', '.join(self.left_out)}"] if self.left_out else ["nothing was left out"]
        apart = [str(self.difference)] if self.difference else []
        return Card(f"Exported to {self.target}: {', '.join(map(str, self.files))}", [*left, *apart, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "target": self.target, "files": [str(f) for f in self.files], "left_out": list(self.left_out),
            "difference": self.difference.to_dict() if self.difference else None, "notes": list(self.notes),
        }


def exporters() -> dict[str, Exporter]:
    """All known targets by name: the built-in ones first, then those of installed packages."""
    return offered(GROUP, BUILT_IN, Exporter)


def export(
    model: Model | str | Path,
    target: str,
    path: str | Path,
    *,
    approximate: bool = False,
    standard_errors: Mapping[str, float] | None = None,
    **options: Any,
) -> Exported:
    """Write a model for another tool: MuJoCo, C, an FMU, state space, URDF.

    Parameters
    ----------
    model : Model, str or Path
        A model, or a model file. SI throughout: lengths in m, pressures in Pa gauge.
    target : str
        One of `pliant.exporters.exporters()`: ``mjcf``, ``c99``, ``fmu``, ``state-space``, ``urdf``.
    path : str or Path
        File to write, with the target's ending.
    approximate : bool
        Leave out what the target cannot express, measure by how much the motion then differs on a reference input
        and write both into the artefact. Default: refuse, naming it.
    standard_errors : mapping
        Standard errors by the names of a fit, SI; they go into the artefact.
    **options
        Of the target, such as ``prefix`` of mjcf; an unknown one is refused with the known ones listed.

    Returns
    -------
    Exported
        Files, what was left out, by how much the motion differs.

    Raises
    ------
    InputError
        For an unknown target, ending or option, a model that the target cannot express, a path that cannot be written.

    Examples
    --------
    >>> import pliant
    >>> pliant.export("results/demo/model.json", "mjcf", "finger.xml")  # doctest: +SKIP
    """
    exporter = exporter_of(target)
    path, source = Path(path), str(model) if isinstance(model, (str, Path)) else "MODEL.json"
    loaded = load_model(model) if isinstance(model, (str, Path)) else model
    if path.suffix not in exporter.suffixes:
        raise InputError(f"a file for {target} ends in {' or '.join(exporter.suffixes)}, not {path.name!r}")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: the folder {path.parent} does not exist; make it first")
    chosen = checked_options(exporter, options)
    command = command_of(source, target, path, options, approximate=approximate)
    lost = tuple(k for k in missing(loaded, exporter.can) if k not in exporter.by_nature)
    if lost and not exporter.moves:
        raise InputError(
            f"{', '.join(named(loaded, lost))}: not expressible in {target}, which holds no springs and no pressure: "
            "no difference of motion can be measured; export a model without it"
        )
    if lost and not approximate:
        raise InputError(
            f"{', '.join(named(loaded, lost))}: not expressible in {target}; approximate (--approximate) leaves it out "
            "and measures by how much the motion then differs"
        )
    reduced = without(loaded, lost)
    notes = tuple(dict.fromkeys(s for k, s in exporter.by_nature.items() if k in missing(loaded, exporter.can)))
    notes += changed_names(loaded)
    provenance = Provenance(
        loaded, target, command, named(loaded, lost), difference(loaded, reduced) if lost else None,
        dict(standard_errors or {}), notes,
    )
    files = exporter.write(with_identifiers(reduced), provenance, path, chosen)
    return Exported(target, files, provenance.left_out, provenance.difference, (*notes, *provenance.messages))


def exporter_of(target: str) -> Exporter:
    """The exporter of a target; InputError lists the known ones."""
    known = exporters()
    if target not in known:
        raise InputError(f"unknown target {target!r}: use one of {', '.join(known)}")
    return known[target]


def checked_options(exporter: Exporter, given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of an exporter, those that are given in the type of their defaults."""
    known = dict(exporter.options)
    for name, value in given.items():
        if name not in known:
            listed = ", ".join(known) or "none"
            raise InputError(f"{exporter.name} has no option {name!r}: its options are {listed}")
        kind = type(known[name])
        try:
            known[name] = kind(value)
        except (TypeError, ValueError):
            raise InputError(f"{exporter.name} option {name} must be a {kind.__name__}, got {value!r}") from None
    return known
