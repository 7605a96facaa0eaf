"""Optional packages, and plug-ins of installed packages, which add readers, estimators, controllers, exporters or
torque laws to pliant.

Another package adds a plug-in with an entry point, in the group of its kind, that names the object to load.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, TypeVar

from pliant.errors import InputError
from pliant.heavy import show_heavy

T = TypeVar("T")


def optional(module: str, remedy: str) -> Any:
    """Return an imported module of an optional package; raise InputError with the sentence `remedy` if the package is
    not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise InputError(remedy) from None


@cache
def installed(group: str) -> Mapping[str, str]:
    """Return {name: ``module:attribute``} of the plug-ins that installed packages declare in an entry-point group."""
    return {point.name: point.value for point in entry_points(group=group)}


def offered(group: str, built_in: Mapping[str, str], kind: type[T]) -> dict[str, T]:
    """Return {name: object} of all plug-ins in a group: the built-in ones, then those of installed packages.

    Parameters
    ----------
    group : str
        Group of the entry points, e.g. ``pliant.readers``.
    built_in : mapping of str to str
        Name to ``module:attribute``. These work without entry points, in a source tree that is not installed.
    kind : type
        Class of which each loaded object must be an instance.

    Raises
    ------
    InputError
        When an entry point cannot be loaded, or its object is not an instance of `kind`.
    """
    targets = {**installed(group), **built_in}
    names = [*built_in, *(name for name in targets if name not in built_in)]
    return {name: _load(group, name, targets[name], kind) for name in names}


def chosen(group: str, built_in: Mapping[str, str], kind: type[T], name: str) -> T:
    """Return the plug-in `name` of a group; raise InputError with the known names if there is none.

    Raises
    ------
    InputError
        When no plug-in has that name.
    """
    if name in built_in:
        return _load(group, name, built_in[name], kind)
    known = offered(group, built_in, kind)
    if name not in known:
        there = f"use one of {', '.join(known)}" if known else "no installed package offers one"
        raise InputError(f"unknown {_noun(group)} {name!r}: {there}")
    return known[name]


def _noun(group: str) -> str:
    return group.rpartition(".")[2].removesuffix("s").replace("_", " ")


def _load(group: str, name: str, target: str, kind: type[T]) -> T:
    module, _, attribute = target.partition(":")
    if not module.startswith("pliant."):
        show_heavy()
    try:
        plugin = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, TypeError) as error:  # TypeError: made with arguments of another version
        raise InputError(
            f"the {_noun(group)} {name!r} of entry point {target!r} cannot be loaded: {error}; update or remove its "
            "package"
        ) from None
    if not isinstance(plugin, kind):
        raise InputError(f"the entry point {target!r} must name an object of the class {kind.__name__} of pliant")
    return plugin
