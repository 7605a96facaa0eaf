"""`pliant track`: convert a video to a recording of the body's shape."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.reading import vector
from pliant.cli.terminal import answer


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
