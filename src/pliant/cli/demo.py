"""`pliant demo`, `pliant data`, `pliant testbed`: use bundled, published and simulated recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pliant.cli.terminal import answer, busy, counting, say


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


def data(
    action: Annotated[Literal["list", "fetch"], typer.Argument(help="list or fetch the data sets.")],
    names: Annotated[list[str] | None, typer.Argument(help="Names of the data sets; default: all.")] = None,
    mirror: Annotated[
        str | None, typer.Option(help="Address of a mirror with the files as NAME/FILE: https://... or file:///...")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """List or download the public recordings of the example studies; downloads are verified by checksum.

    Studies and commands then read them as data:NAME/FILE. They are stored in the folder PLIANT_DATA, by default in your
    cache folder.

    Example: pliant data fetch silicone_cantilever && pliant run examples/silicone_cantilever.toml -o results/beam
    """
    from pliant.errors import InputError
    from pliant.recording.published import data_folder, data_set, data_sets, fetch

    if action == "list":
        entries = [entry(name) for name in names or data_sets()]
        lines = [f"folder: {data_folder()}"]
        for dataset in entries:
            lines.append(f"\n{dataset['name']}: {dataset['what']}\n  {dataset['licence']}; {dataset['origin']}")
            lines += [
                f"  {'here  ' if file['here'] else 'absent'}  {file['file']}"
                + (f"  (by hand: {file['by_hand']})" if file["by_hand"] else "")
                for file in dataset["files"]
            ]
        answer({"folder": str(data_folder()), "data": entries}, "\n".join(lines), as_json=json)
        return
    paths: list[str] = []
    for name in names or data_sets():
        with busy(f"downloading {name}"):
            try:
                paths += map(str, fetch(name, mirror=mirror))
            except InputError as error:
                if names or any(f.address for f in data_set(name).files.values()):
                    raise
                say(f"not downloaded: {error}", error=True)  # data sets that can only be downloaded by hand
    answer(paths, "\n".join(paths), as_json=json)


def entry(name: str) -> dict[str, Any]:
    """Return the description of a data set, and which of its files are on this machine."""
    from pliant.recording.published import data_folder, data_set, is_published

    known, folder = data_set(name), data_folder() / name
    files = [{"file": f, "here": (folder / f).is_file() and is_published(folder / f, p), "sha256": p.sha256,
              "address": p.address, "by_hand": p.by_hand} for f, p in known.files.items()]  # fmt: skip
    return {"name": name, "what": known.what, "licence": known.licence, "origin": known.origin, "files": files}


def run_testbed(
    scenario: Annotated[
        str | None, typer.Argument(help="Name of a scenario (see --list), or pulse_<kPa>_<ms>ms, pulse_120+60_500ms.")
    ] = None,
    *,
    actuator: Annotated[
        str, typer.Option(help="a, b, c, two_segment, antagonistic, lengthening, or a seed for a random one, e.g. 7.")
    ] = "a",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensor noise.")] = 1,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Recording to write (.nc).")] = None,
    truth: Annotated[Path | None, typer.Option(help="Separate file for the true states (.nc).")] = None,
    record: Annotated[str, typer.Option(help="Sensor: position, strain, markers, flex or imu.")] = "position",
    show: Annotated[bool, typer.Option("--list", help="List the scenarios and exit.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the recording, or the list, as JSON.")] = False,
) -> None:
    """Record a scenario with a simulated actuator whose true states are known.

    The recording resembles one from a laboratory: raw sensor frame, separate pressure clock, noise and drop-outs. A
    file that already holds this content is not written again. A number instead of a, b or c is a seed that draws a
    random body, valve and sensors; a scenario's 180 kPa then stands for its working pressure. two_segment, antagonistic
    and lengthening have two chambers with a valve each; pulse_120+60_500ms gives the pressure of each. Pressure
    lengthens the body of lengthening.

    Example: pliant testbed pulse_119 --actuator b --seed 7 -o pulse.nc --truth truth.nc
    """
    from pliant.errors import InputError

    if show:
        _list_scenarios(as_json=json)
        return
    if scenario is None:
        raise InputError("a scenario is missing: name one that --list shows")
    if record not in ("position", "strain", "markers", "flex", "imu"):
        raise InputError(f"--record must be position, strain, markers, flex or imu, got {record!r}")
    from dataclasses import replace

    from pliant.testbed.laboratory import FLEX, IMU, generate_file, resolved

    path = output or Path(f"{scenario}-{actuator}-{seed}.nc")
    sensor = {"flex": FLEX, "imu": IMU}.get(record)
    with counting(scenario) as progress:
        lab = resolved(scenario, actuator, None, "angle" if sensor else record)[2]  # type: ignore[arg-type]
        lab = replace(lab, angle=sensor) if sensor else lab
        ran = generate_file(scenario, path, body=actuator, seed=seed, lab=lab, truth=truth, progress=progress)
    answer(
        {"recording": str(path), "truth": str(truth) if truth else None, "recorded": ran},
        f"{path}: {'recorded' if ran else 'exists with this content, not written again'}",
        as_json=json,
    )


def _list_scenarios(*, as_json: bool) -> None:
    from pliant.testbed.scenarios import SCENARIOS

    entries = {n: {"duration_s": c.duration, "rate_hz": c.rate, "summary": c.summary} for n, c in SCENARIOS.items()}
    width = max(map(len, SCENARIOS))
    lines = [f"{c.name:{width}}  {c.duration:5.1f} s  {c.rate:5.1f} Hz  {c.summary}" for c in SCENARIOS.values()]
    answer(entries, "\n".join(lines), as_json=as_json)
