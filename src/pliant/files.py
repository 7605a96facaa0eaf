"""Files are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pliant.errors import InputError


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A draft beside `path` to write to; it takes the place of `path` when all went well, and is removed otherwise."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file atomically: the old content or the new, never half of it."""
    path = Path(path)
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return path
