"""Base class for the options of all readers. It checks them and reports an unknown key or a wrong value in one
sentence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from pliant.errors import InputError, clipped, known_entries

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class FileMapping(BaseModel):
    """Base class for the options of a reader, which cannot be changed after creation. Unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def load(cls, mapping: Mapping[str, Any] | None, name: str, what: str = "mapping for") -> Self:
        """Check the options `mapping` of the file `name` and return them as an object. If a key or value is wrong,
        raise InputError, which names the first wrong key.
        """
        try:
            return cls.model_validate(dict(mapping or {}))
        except ValidationError as error:
            first = error.errors()[0]
            key = clipped(".".join(map(str, first["loc"]))) or "as a whole"
            if first["type"] == "extra_forbidden":
                table = key.rpartition(".")[0]
                keys = ", ".join(known_entries(cls, first["loc"]))
                problem = f"unknown key {key!r}; the known keys{f' of {table}' * bool(table)} are {keys}"
            else:
                problem = f"{key}: {first['msg'].removeprefix('Value error, ')}"
            raise InputError(f"the {what} {name} is invalid: {problem}") from None


def shorten(names: Sequence[object], most: int = 20) -> str:
    """Return the first `most` names as a comma-separated text, with each name cut to 60 characters."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(str(name)[:60] for name in names[:most]) + more


class PressureChannels(FileMapping):
    """Names of the channels of a file that hold gauge pressure, with their unit."""

    channels: list[str]
    unit: str
    chamber: list[str] | None = None
