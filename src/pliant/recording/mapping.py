"""Base of the mappings: models whose unknown keys and wrong values end in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from pliant.errors import InputError, clipped

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class FileMapping(BaseModel):
    """Mapping entries that a file lacks; frozen, unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def load(cls, mapping: Mapping[str, Any] | None, name: str, what: str = "mapping for") -> Self:
        """Check a mapping for the file `name`; InputError names the key that does not fit."""
        try:
            return cls.model_validate(dict(mapping or {}))
        except ValidationError as error:
            first = error.errors()[0]
            key = clipped(".".join(map(str, first["loc"]))) or "the whole"
            if first["type"] == "extra_forbidden":
                problem = f"unknown key {key!r}; known are {', '.join(cls.model_fields)}"
            else:
                problem = f"{key}: {first['msg'].removeprefix('Value error, ')}"
            raise InputError(f"the {what} {name} does not fit: {problem}") from None


def shorten(names: Sequence[object], most: int = 20) -> str:
    """Names for a sentence: the first of them, each cut to a length that can be read."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(str(name)[:60] for name in names[:most]) + more


class PressureChannels(FileMapping):
    """Names of the channels that hold gauge pressure, and their unit."""

    channels: list[str]
    unit: str
    chamber: list[str] | None = None
