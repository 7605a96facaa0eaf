"""How a draft writes values, keys and file names."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pliant.recording.published import PREFIX


def relative(path: Path, folder: Path) -> str:
    """The file's name as the study, which lies in `folder`, should have it."""
    if str(path).startswith(PREFIX):
        return path.as_posix()
    whole, home = path.resolve(), folder.resolve()
    if whole.parts[:2] != home.parts[:2]:  # nothing in common but the root
        return whole.as_posix()
    return Path(os.path.relpath(whole, home)).as_posix()


def toml(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def key(name: str) -> str:
    """A key as TOML, quoted where it must be."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml(name)
