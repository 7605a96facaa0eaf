"""Functions by which commands read a recording and print its content."""

from __future__ import annotations

import json as jsonlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant.cli.terminal import busy, say
from pliant.files import read_entries
from pliant.text import escaped

if TYPE_CHECKING:
    import xarray as xr


def load_mapping(path: Path | None) -> dict[str, Any] | None:
    """Return the mapping (columns and units of a recording's file) that a TOML file states; None if `path` is None."""
    if path is None:
        return None
    entries: dict[str, Any] = read_entries(path, "mapping")
    return entries


def read_with_mapping(path: Path, mapping: Path | None) -> xr.Dataset:
    """Read the recording in the file `path`. `mapping` is an optional TOML file that states the columns and units of
    that file.
    """
    from pliant.sensing import read_shape

    with busy(f"reading {path.name}"):
        return read_shape(path, mapping=load_mapping(mapping))


def print_recording(recording: xr.Dataset, path: Path, *, as_json: bool) -> None:
    """Print the content of a recording and its quality, as text or JSON."""
    from pliant.preprocessing.quality import quality
    from pliant.recording.schema import history_of

    with busy("checking the recording"):
        assessed = quality(recording)
    if as_json:
        content = {"file": str(path), "format": recording.attrs.get("source_format"), "sizes": dict(recording.sizes)}
        content["station_names"] = [str(s) for s in recording["station"].values] if "station" in recording else []
        content["history"] = history_of(recording)
        say(jsonlib.dumps({**content, "quality": plain(assessed.to_dict())}))
        return
    say(escaped(f"{path} ({recording.attrs.get('source_format', 'unknown format')})", "line"))
    if "station" in recording:
        names = [str(s) for s in recording["station"].values]
        say(f"stations: {', '.join(names[:8])}{' ...' if len(names) > 8 else ''}")
    say(assessed.summary())
    for line in history_of(recording):
        say(f"  {line}")


def plain(value: Any) -> Any:
    """Return `value` with every NaN replaced by None, since JSON has no NaN."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and value != value else value  # noqa: PLR0124  NaN is not itself
