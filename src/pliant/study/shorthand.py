"""Text of a study file before its entries are checked: abbreviations, and open questions marked "?".

The abbreviations are `[recordings.defaults]`, `[actuator.tendon_defaults]`, one entry for many trials, and a fit like
another. They are expanded before the file is checked. The study that a run writes is the expanded one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pliant.errors import InputError, shown

Table = dict[str, Any]
DEFAULTS, TENDON_DEFAULTS = "defaults", "tendon_defaults"
OPEN = "?"


def expanded(content: Any) -> Any:
    """Return the content of a study file with all abbreviations expanded.

    Raises
    ------
    InputError
        When trials have no values or the same name, a fit is like an unknown fit or like itself, or `without` names a
        parameter that the fit does not have.
    """
    if not isinstance(content, Mapping):
        return content  # the schema reports the error
    content = dict(content)
    groups: dict[str, list[str]] = {}
    if isinstance(content.get("actuator"), Mapping):
        content["actuator"] = all_tendons(content["actuator"])
    if tables(content.get("recordings")):
        content["recordings"], groups = all_recordings(content["recordings"])
    if tables(fits := content.get("fits")):
        content["fits"] = {name: ungrouped(fit_of(name, fits, ()), groups) for name in fits}
    if isinstance(content.get("model_selection"), Mapping):
        refuse_stages(content["model_selection"])
        content["model_selection"] = ungrouped(content["model_selection"], groups)
    return content


def refuse_stages(entry: Mapping[str, Any]) -> None:
    """Raise InputError for entries of earlier versions, whose stages held-out recordings chose."""
    if old := [key for key in ("choose_by", "stages", "starts") if key in entry]:
        raise InputError(f"[model_selection] has {old[0]}, which is no longer an entry, because the training "
                         "recordings choose the terms: remove it, and name terms in `terms` or `without` to restrict "
                         "the choice")  # fmt: skip


def tables(content: Any) -> bool:
    """Return True if `content` is a table in which every value is a table too."""
    return isinstance(content, Mapping) and all(isinstance(entry, Mapping) for entry in content.values())


def merged(shared: Mapping[str, Any], own: Mapping[str, Any]) -> Table:
    """Return the table `shared` with the values of the table `own` added, also inside nested tables. Values of `own`
    take precedence.
    """
    both = dict(shared)
    for key, value in own.items():
        old = both.get(key)
        both[key] = merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return both


def all_tendons(actuator: Mapping[str, Any]) -> Table:
    """Return the table of an actuator with its tendons completed by the entries that they share."""
    shared = actuator.get(TENDON_DEFAULTS)
    tendons = actuator.get("tendons")
    if shared is None:
        return dict(actuator)
    if not isinstance(shared, Mapping) or not isinstance(tendons, list):
        raise InputError(f"[actuator.{TENDON_DEFAULTS}] is a table of entries that the tendons [[actuator.tendons]] "
                         "share: add the tendons, or remove it")
    whole = [merged(shared, tendon) if isinstance(tendon, Mapping) else tendon for tendon in tendons]
    return {**{k: v for k, v in actuator.items() if k != TENDON_DEFAULTS}, "tendons": whole}


def all_recordings(listed: Mapping[str, Table]) -> tuple[dict[str, Table], dict[str, list[str]]]:
    """Return every recording; entries that it lacks are taken from the defaults. A recording that selects several
    trials from a file is replaced by one recording for each trial; the names of the trials are returned too.
    """
    shared = listed.get(DEFAULTS, {})
    if "select" in shared:
        raise InputError(f"[recordings.{DEFAULTS}] has select: state it in a single recording instead")
    groups = {name: trials(name, entry["select"]) for name, entry in listed.items() if "select" in entry}
    selected = {trial for names in groups.values() for trial in names}
    expanded_entries: dict[str, Table] = {}
    for name, entry in listed.items():
        if name == DEFAULTS or name in selected:
            continue
        if name not in groups:
            expanded_entries[name] = merged(shared, entry)
            continue
        column, values = entry["select"]["column"], entry["select"]["values"]
        rest = {key: value for key, value in entry.items() if key != "select"}
        for trial, value in zip(groups[name], values, strict=True):
            picked = merged(merged(shared, rest), {"mapping": {"select": {"column": column, "value": value}}})
            expanded_entries[trial] = merged(picked, listed.get(trial, {}))
    return expanded_entries, groups


def trials(name: str, select: Any) -> list[str]:
    """Return the names of the trials that the recording `name` selects from its file, such as "name_3" for the
    trial 3.
    """
    form = 'select = { column = "ID", values = [0, 3, 4] }'
    if not isinstance(select, Mapping) or set(select) != {"column", "values"}:
        raise InputError(f"recording {name} needs {form}, got select = {select!r:.80}")
    values = select["values"]
    if not isinstance(values, list) or not values or not all(type(v) is int for v in values):
        raise InputError(f"recording {name}: values of select must be integers, as in {form}, got {values!r:.80}")
    if len(set(values)) < len(values):
        raise InputError(f"recording {name} selects a trial twice, got values {values!r:.80}: list each trial once")
    return [f"{name}_{value}" for value in values]


def ungrouped(fit: Mapping[str, Any], groups: Mapping[str, list[str]]) -> Table:
    """Return a fit whose lists name single trials: the name of a recording with several trials is replaced by the names
    of these trials.
    """
    lists = {key: fit[key] for key in ("train", "held_out") if isinstance(fit.get(key), list)}
    return {**fit, **{
        key: [name for r in records for name in (groups.get(r, [r]) if isinstance(r, str) else [r])]
        for key, records in lists.items()
    }}


def fit_of(name: str, fits: Mapping[str, Table], above: tuple[str, ...]) -> Table:
    """Return the fit `name`. Entries that it lacks are taken from the fit that its entry `like` names, and the
    parameters that its entry `without` lists are removed.
    """
    stated = {key: value for key, value in fits[name].items() if key not in ("like", "without")}
    like, without = fits[name].get("like"), fits[name].get("without", [])
    if like is not None:
        if not isinstance(like, str) or like not in fits:
            listed = ", ".join(n for n in fits if n != name)
            raise InputError(f"`like` of fit {name} names fit {like!r:.60}, which is not one of "
                             f"{listed or 'the fits'}: correct it")
        if like in (*above, name):
            raise InputError(f"fit {like} refers to itself by `like`, {' -> '.join((*above, name, like))}: remove one "
                             "`like`")
        shared = fit_of(like, fits, (*above, name))
        shared.pop("title", None)  # each fit has a title of its own
        stated = merged(shared, stated)
    parameters = stated.get("parameters", {})
    known = parameters if isinstance(parameters, Mapping) else {}
    if not isinstance(without, list) or [p for p in without if not isinstance(p, str) or p not in known]:
        raise InputError(f"fit {name} has without = {shown(without)}, which must be a list of some of its parameters: "
                         f"{', '.join(known) or 'none'}")
    if without:
        stated["parameters"] = {p: entry for p, entry in parameters.items() if p not in without}
    return stated


def open_entries(content: Any, where: str = "") -> Iterator[str]:
    """Yield the names of the entries that hold "?", such as ``actuator.mass``."""
    if content == OPEN:
        yield where
    elif isinstance(content, Mapping):
        for name, value in content.items():
            yield from open_entries(value, f"{where}.{name}" if where else str(name))
    elif isinstance(content, list):
        for value in content:
            yield from open_entries(value, where)


def refuse_open(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError with the names of all entries of the study file `path` that the user still has to fill in."""
    if names := list(open_entries(content)):
        many = f"{len(names)} open questions" if len(names) > 1 else "one open question"
        raise InputError(f'study {path} has {many}: replace the "?" at {", ".join(names)} with values')


def refuse_mapping(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError if the file is a mapping (the columns and units of a table) instead of a study."""
    if {"points", "stations", "length_unit", "pressure", "delimiter"} & set(content) and not {
        "actuator", "recordings"
    } & set(content):
        raise InputError(f"{path} is a mapping, which describes the columns of a table, not a study: pass it with "
                         f"--mapping, as in pliant order TABLE --mapping {path.name}")  # fmt: skip
