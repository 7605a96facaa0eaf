"""`pliant inspect`, `pliant track` and `pliant sync`: check a recording, make it from a video, set its clocks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.reading import MAPPING, read_with_mapping
from pliant.cli.terminal import answer, busy
from pliant.text import escaped

if TYPE_CHECKING:
    import xarray as xr
from dataclasses import asdict

from pliant.cli.reading import vector
from pliant.cli.terminal import in_unit


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
    log = "" if {"pressure", "actuation"} & set(ds) else " PRESSURE_LOG"
    columns = "".join(f" --mapping {entry}" for entry in mapping or ())
    return f"pliant new {study} --from{shape} {path}{log}{columns}"


def plain(value: Any) -> Any:
    """Return `value` with every NaN replaced by None, since JSON has no NaN."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and value != value else value  # noqa: PLR0124  NaN is not itself


def track(
    video: Annotated[Path, typer.Argument(help="Video of the body, in any format that OpenCV reads.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write (.nc or .csv).")],
    camera: Annotated[Path, typer.Option(help="TOML file with a [camera] table (scale, view, lens), such as a study.")],
    method: Annotated[str, typer.Option(help="silhouette, dots or aruco.")] = "silhouette",
    colour: Annotated[str | None, typer.Option(help="Colour of the dots, '#rrggbb'.")] = None,
    base: Annotated[str | None, typer.Option(help="Position of the base, 'x,y' in pixels; default: detected.")] = None,
    overlay: Annotated[list[Path] | None, typer.Option(help="Picture of the shape over some frames (.png), or video "
                                                      "over all (.mp4); may be given twice.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the processing steps as JSON.")] = False,
) -> None:
    """Track a bending body in a video: its silhouette, dots of one colour, or ArUco markers.

    Example: pliant track push.mp4 -o push.nc --camera camera.toml --overlay push.png
    """
    from pliant.cli.terminal import counting
    from pliant.errors import InputError
    from pliant.files import read_entries
    from pliant.recording import write
    from pliant.recording.schema import history_of
    from pliant.video import Tracking, track_video

    entries = read_entries(camera, "camera")
    options = entries.pop("tracking", {})
    if not isinstance(options, dict):
        raise InputError(f"[tracking] of {camera} must be a table with count, region and incomplete")
    if unknown := sorted(set(options) - {"count", "region", "incomplete"}):
        raise InputError(f"[tracking] of {camera} has the unknown entry {unknown[0]}: use count, region or incomplete")
    if output.suffix.lower() not in (".nc", ".nc4", ".csv"):
        raise InputError(f"the name of the recording must end in .nc or .csv, got {output.name!r}")
    base_point = None if base is None else tuple(
        vector(base, 2, f"--base must be two numbers of pixels, 'x,y', got {base!r}"))  # fmt: skip
    how = Tracking(method, base_point, colour, overlays=tuple(overlay or ()), **options)  # type: ignore[arg-type]
    with counting(f"tracking the body in {video.name}") as progress:
        recording = track_video(video, entries.get("camera", entries), how, progress=progress)
    write(recording, output)
    written = [str(p) for p in (output, *how.overlays)]
    history = history_of(recording)
    answer({"history": history, "written": written}, "\n".join([*history, *(f"wrote {p}" for p in written)]),
           as_json=json)


def sync(
    shape: Annotated[Path, typer.Argument(help="Recording of the shape.")],
    pressure: Annotated[
        Path | None, typer.Argument(help="Log of the pressure; default: the inputs in the shape's file.")
    ] = None,
    mapping: Annotated[Path | None, typer.Option(help="TOML file that describes the shape's columns.")] = None,
    pressure_mapping: Annotated[
        Path | None, typer.Option("--pressure-mapping", help="TOML file that describes the log's columns.")
    ] = None,
    largest_s: Annotated[
        float | None, typer.Option("--largest-s", parser=in_unit("s"),
                                   help="Largest offset to try, s; default: half of the overlap.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Joined recording to write (.nc).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of the clocks (.png, .svg or .pdf).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Estimate the offset between the clocks of a pressure log and a recorded shape by comparing pressure and motion.

    Example: pliant sync points.csv log.csv --pressure-mapping log.toml --figure clocks.png
    """
    from pliant.cli.output import write_figure
    from pliant.cli.reading import read_with_mapping
    from pliant.cli.terminal import busy
    from pliant.preprocessing.sync import shift_pressure
    from pliant.preprocessing.sync import sync as find
    from pliant.recording import write
    from pliant.study.aligned import with_pressure

    recording = read_with_mapping(shape, mapping)
    if pressure is not None:
        recording = with_pressure(recording, read_with_mapping(pressure, pressure_mapping), shape.stem, pressure.name)
    with busy("comparing the clocks"):
        offset = find(recording, largest_s=largest_s, drift=True)
    if figure is not None:
        from pliant.plotting import clock_figure
        from pliant.validation.outcome import Clocks

        c = Clocks.of(recording, offset)
        title = f"the {offset.input}'s clock is moved by {1e3 * c.delay:+.1f} ± {1e3 * offset.uncertainty_s:.1f} ms"
        write_figure(clock_figure(c.time, c.motion, c.clock, c.pressure, c.delay, c.drift, title, offset.input),
                     figure)  # fmt: skip
    if output is not None:
        write(shift_pressure(recording, offset.delay_s, offset.drift), output)
    answer(
        asdict(offset),
        f'{offset.summary()}\nin a study: clock = {offset.delay_s:.4f}, or clock = "align"',
        as_json=json,
    )
