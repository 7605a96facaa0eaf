"""`pliant inspect`: show the content and the quality of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.reading import MAPPING, read_with_mapping
from pliant.cli.terminal import answer, busy
from pliant.text import escaped

if TYPE_CHECKING:
    import xarray as xr


def inspect(
    recording: Annotated[Path, typer.Argument(help="A recording: .c3d, .csv, .nc, .npz, .mat, .tsv, ...")],
    mapping: Annotated[list[str] | None, typer.Option(metavar="<path>", help=MAPPING)] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw every station against time (.png or .svg).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Show the content and the quality of a recording: frames, stations, gaps, drop-outs, noise, units.

    Example: pliant inspect pulse.c3d --figure pulse.png
    """
    from pliant.preprocessing.quality import quality
    from pliant.recording.schema import history_of

    ds, proposed = described(recording, mapping)
    with busy("checking the recording"):
        assessed, history = quality(ds), history_of(ds)
    names = [str(s) for s in ds["station"].values] if "station" in ds else []
    content = {"file": str(recording), "format": ds.attrs.get("source_format"), "sizes": dict(ds.sizes),
               "station_names": names, "history": history, "quality": plain(assessed.to_dict()),
               "proposed": proposed, "next": next_step(ds, recording, mapping)}  # fmt: skip
    head = escaped(f"{recording} ({ds.attrs.get('source_format', 'unknown format')})", "line")
    listed = [f"stations: {', '.join(names[:8])}{' ...' if len(names) > 8 else ''}"] if names else []
    lines = [head, *proposed, *listed, assessed.summary(), *(f"  {line}" for line in history),
             f"next: {content['next']}"]  # fmt: skip
    answer(content, "\n".join(lines), as_json=json)
    if figure is not None:
        from pliant.cli.output import write_figure
        from pliant.plotting import recording_overview

        write_figure(recording_overview(ds), figure)


def described(path: Path, mapping: list[str] | None) -> tuple[xr.Dataset, list[str]]:
    """Return a recording, and sentences on the columns of a table that neither its header nor a mapping describes, as
    `pliant new` proposes them.
    """
    from pliant.cli.reading import load_mapping
    from pliant.recording.mapping import options_of
    from pliant.study.first_reading import read_or_guess

    with busy(f"reading {path.name}"):
        reading = read_or_guess(path, options_of(path, load_mapping(mapping)))
    if reading.assumed:
        return read_with_mapping(path, mapping), []  # which names the missing units
    if reading.guess is None:
        return reading.recording, []
    asked = [f"? {name}: {question}" for name, question in reading.guess.questions.items()]
    head = "its columns are proposed from names, units and ranges: pliant new writes them into [mapping]"
    return reading.recording, [head, *reading.guess.notes, *asked]


def next_step(ds: xr.Dataset, path: Path, mapping: list[str] | None) -> str:
    """Return the command that usually follows: a draft of a study for the recording, together with the file that it
    still needs.
    """
    from pliant.recording.rules import shape_variable

    shape = "" if shape_variable(ds) else " RECORDING"
    study = "STUDY.toml" if shape else f"{path.stem}.toml"
    log = "" if {"pressure", "actuation"} & set(ds) else " [LOG]"
    columns = "".join(f" --mapping {entry}" for entry in mapping or ())
    return f"pliant new {study} --from{shape} {path}{log}{columns}"


def plain(value: Any) -> Any:
    """Return `value` with every NaN replaced by None, since JSON has no NaN."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and value != value else value  # noqa: PLR0124  NaN is not itself
