"""Shorthand of study files: `[recordings.defaults]`, one entry for many trials, a fit like another.

A file is written out in full before it is checked; the study that a run leaves behind is the full one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pliant.errors import InputError, shown

Table = dict[str, Any]
DEFAULTS = "defaults"


def written_out(content: Any, path: Path) -> Any:
    """The content of the study file `path` with everything that stands for something else written out.

    Raises
    ------
    InputError
        When trials have no values or names of their own, a fit is like none, like itself, or without what it has not.
    """
    if not isinstance(content, Mapping):
        return content  # the schema says what is wrong with it
    content = dict(content)
    groups: dict[str, list[str]] = {}
    if tables(content.get("recordings")):
        content["recordings"], groups = all_recordings(content["recordings"], path)
    if tables(fits := content.get("fits")):
        content["fits"] = {name: ungrouped(fit_of(name, fits, (), path), groups) for name in fits}
    if isinstance(content.get("model_selection"), Mapping):
        content["model_selection"] = ungrouped(content["model_selection"], groups)
    return content


def tables(content: Any) -> bool:
    """Whether `content` is a table of tables."""
    return isinstance(content, Mapping) and all(isinstance(entry, Mapping) for entry in content.values())


def merged(shared: Mapping[str, Any], own: Mapping[str, Any]) -> Table:
    """`shared` overruled by `own`, tables entry by entry; what `shared` has comes first."""
    both = dict(shared)
    for key, value in own.items():
        old = both.get(key)
        both[key] = merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return both


def all_recordings(listed: Mapping[str, Table], path: Path) -> tuple[dict[str, Table], dict[str, list[str]]]:
    """Every recording with the defaults put in, and the names of the trials of each entry that stands for many."""
    shared = listed.get(DEFAULTS, {})
    if "select" in shared:
        raise InputError(f"study {path}: [recordings.{DEFAULTS}] selects trials: say in one recording which those are")
    groups = {name: trials(name, entry["select"], path) for name, entry in listed.items() if "select" in entry}
    own = {trial for names in groups.values() for trial in names}
    found: dict[str, Table] = {}
    for name, entry in listed.items():
        if name == DEFAULTS or name in own:
            continue
        if name not in groups:
            found[name] = merged(shared, entry)
            continue
        column, values = entry["select"]["column"], entry["select"]["values"]
        rest = {key: value for key, value in entry.items() if key != "select"}
        for trial, value in zip(groups[name], values, strict=True):
            picked = merged(merged(shared, rest), {"mapping": {"select": {"column": column, "value": value}}})
            found[trial] = merged(picked, listed.get(trial, {}))
    return found, groups


def trials(name: str, select: Any, path: Path) -> list[str]:
    """Names of the trials that the entry `name` stands for."""
    form = 'select = { column = "ID", values = [0, 3, 4] }'
    if not isinstance(select, Mapping) or set(select) != {"column", "values"}:
        raise InputError(f"study {path}: recording {name} selects trials as {form}, got select = {select!r:.80}")
    values = select["values"]
    if not isinstance(values, list) or not values or not all(type(v) is int for v in values):
        raise InputError(f"study {path}: recording {name} selects trials by whole numbers, {form}, got {values!r:.80}")
    if len(set(values)) < len(values):
        raise InputError(f"study {path}: recording {name} selects a trial twice: {values!r:.80}")
    return [f"{name}_{value}" for value in values]


def ungrouped(fit: Mapping[str, Any], groups: Mapping[str, list[str]]) -> Table:
    """A fit that names trials one by one where it named the entry that stands for all of them."""
    lists = {key: fit[key] for key in ("train", "held_out") if isinstance(fit.get(key), list)}
    return {**fit, **{
        key: [name for r in records for name in (groups.get(r, [r]) if isinstance(r, str) else [r])]
        for key, records in lists.items()
    }}


def fit_of(name: str, fits: Mapping[str, Table], above: tuple[str, ...], path: Path) -> Table:
    """A fit in full: the one that it is `like`, overruled by its own entries, less the parameters it is `without`."""
    own = {key: value for key, value in fits[name].items() if key not in ("like", "without")}
    like, without = fits[name].get("like"), fits[name].get("without", [])
    if like is not None:
        if not isinstance(like, str) or like not in fits:
            listed = ", ".join(n for n in fits if n != name)
            raise InputError(f"study {path}: fit {name} is like fit {like!r:.60}; the others are {listed or 'none'}")
        if like in (*above, name):
            raise InputError(f"study {path}: fit {like} is like itself: {' -> '.join((*above, name, like))}")
        shared = fit_of(like, fits, (*above, name), path)
        shared.pop("title", None)  # a name of its own
        own = merged(shared, own)
    parameters = own.get("parameters", {})
    known = parameters if isinstance(parameters, Mapping) else {}
    if not isinstance(without, list) or [p for p in without if not isinstance(p, str) or p not in known]:
        raise InputError(
            f"study {path}: fit {name} is without {shown(without)}, which must be a list of some of its parameters: "
            f"{', '.join(known) or 'none'}"
        )
    if without:
        own["parameters"] = {p: entry for p, entry in parameters.items() if p not in without}
    return own
