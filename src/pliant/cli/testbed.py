"""`pliant testbed`: record a scenario with the virtual actuator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import answer, counting


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
