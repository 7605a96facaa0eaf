"""Support for functions whose keyword options are declared by a `TypedDict` (PEP 692)."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, cast

Options = TypeVar("Options", bound=Mapping[str, object])


def with_defaults(function: Callable[..., Any], given: Options, defaults: Options) -> Options:
    """Return the keyword options `given`, and `defaults` for the others; raise TypeError for an option not in
    `defaults`.

    Raises
    ------
    TypeError
        For a keyword that `function` does not accept; the message lists those that it accepts.
    """
    if unknown := [name for name in given if name not in defaults]:
        named = [p.name for p in inspect.signature(function).parameters.values() if p.kind is not p.VAR_KEYWORD]
        known = ", ".join((*named, *defaults))
        raise TypeError(f"{function.__name__} has no parameter {unknown[0]!r}: it takes {known}")
    return cast(Options, {**defaults, **given})


def full_signature(
    function: Callable[..., Any], names: Iterable[str], defaults: Mapping[str, object],
) -> inspect.Signature:
    """Return the signature of `function` with the keywords `names` listed in place of its ``**options``.

    A keyword without a default is required. Required keywords come first.
    """
    empty, kind = inspect.Parameter.empty, inspect.Parameter.KEYWORD_ONLY
    parameters = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.VAR_KEYWORD]
    named = [inspect.Parameter(name, kind, default=defaults.get(name, empty)) for name in names]
    return inspect.Signature([*parameters, *sorted(named, key=lambda p: p.default is not empty)])
