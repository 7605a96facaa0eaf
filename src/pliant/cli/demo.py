"""`pliant demo`: run the whole analysis on the recordings that come with pliant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")] = Path("results/demo"),
    angles: Annotated[
        bool, typer.Option("--angles", help="Use logs of one angle (flex sensor) and one pressure.")
    ] = False,
    space: Annotated[bool, typer.Option("--space", help="Use a body in space with three chambers.")] = False,
    camera: Annotated[bool, typer.Option("--camera", help="Start from a video, in which the body is tracked.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print metrics.json on standard output.")] = False,
) -> None:
    """Run the whole analysis on bundled recordings: find the tip, choose and place links, fit, predict, report.

    Example: pliant demo -o results/demo
    """
    from pliant.cli.run import run
    from pliant.errors import InputError
    from pliant.study import angles_study, demo_study, space_study

    if angles + camera + space > 1:
        raise InputError("--angles, --space and --camera are different demonstrations: choose one")
    studies = {"angles": angles_study, "space": space_study, "": demo_study}
    study = studies["angles" if angles else "space" if space else ""]
    run(filmed(output) if camera else study(), output, json=json)


def filmed(output: Path) -> Path:
    """Track the body in the bundled video, write the result into `output`, and return the path of a study
    that uses it.
    """
    from pliant.cli.terminal import counting
    from pliant.files import output_folder, read_entries, write_text
    from pliant.recording import write
    from pliant.study import camera_study
    from pliant.testbed.bundle import FOLDER
    from pliant.video import Tracking, track_video

    study = camera_study()
    with output_folder(output):
        tracked, sheet = output / "film.nc", output / "film.png"
        with counting("tracking the body in film.mp4") as progress:
            film = track_video(FOLDER / "film.mp4", read_entries(study, "study")["camera"], Tracking(overlays=(sheet,)),
                               progress=progress)  # fmt: skip
        write(film, tracked)
        text = study.read_text(encoding="utf-8")
        for bundled, target in (("film.csv", tracked), ("film_log.csv", FOLDER / "film_log.csv")):
            text = text.replace(f"../../testbed/bundled/{bundled}", target.resolve().as_posix())
        return write_text(output / "study.toml", text)
