"""`pliant new`: write a commented study file for recordings."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.reading import MAPPING, load_mapping, vector
from pliant.cli.terminal import answer, in_unit

if TYPE_CHECKING:
    from pliant.study.draft import Draft


def lengths(given: Any) -> float | tuple[float, ...]:
    """Return a length [m], or those of several segments that commas separate."""
    metres = in_unit("m")
    if not isinstance(given, str) or "," not in given:
        return metres(given)
    parts = given.split(",")
    if len({part.strip()[-1:].isalpha() for part in parts}) > 1 or (len(parts) == 2 and parts[0].strip() in ("0", "")):
        raise typer.BadParameter(f"{given} states lengths of segments, with a unit for each or for none, as 60mm,62mm; "
                                 "a decimal comma is a point, as 0.17")
    values = tuple(map(metres, parts))
    if not all(0 < value < math.inf for value in values):
        raise typer.BadParameter(f"{given}: the length of each segment must be above 0 and finite")
    return values


lengths.__name__ = "float"  # as the help shows it


def new(
    paths: Annotated[list[Path], typer.Argument(
        metavar="study",
        help="Study file to write (.toml), which must not exist; then more recordings besides those of --from.",
    )],
    files: Annotated[
        list[Path],
        typer.Option("--from", metavar="<path>",
                     help="Recordings, and logs of their pressures (push_log.csv for push.csv), e.g. --from *.csv"),
    ],
    mapping: Annotated[list[str] | None, typer.Option(metavar="<path>", help=MAPPING)] = None,
    length: Annotated[Any, typer.Option(
        parser=lengths, metavar="<float>",
        help="Length of the body, m, or as 170mm; of unequal segments from the base on, as 60mm,62mm.",
    )] = None,
    mass: Annotated[float | None, typer.Option(parser=in_unit("kg"), help="Mass of the body, kg, or as 50g.")] = None,
    level_kpa: Annotated[
        float | None, typer.Option("--level-kpa", parser=in_unit("kPa"),
                                   help="Pressure of pulses that was not recorded, kPa gauge.")
    ] = None,
    gravity: Annotated[
        str | None, typer.Option(help="Gravity in the tracker's axes, m/s^2: 'x,y,z', such as '0,0,-9.81'.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the file, open questions and warnings as JSON.")] = False,
) -> None:
    """Write a commented study file for recordings; values that only you know are marked "?".

    The study is then tried as a run would, for one step of its fit, with assumed values for these.

    Example: pliant new arm.toml --from 100mbar.c3d 200mbar.c3d --mass 0.15
    """
    from pliant.cli.terminal import busy
    from pliant.errors import InputError
    from pliant.files import write_new, write_text
    from pliant.study.draft import checked, draft_study

    study, *more = paths
    if study.suffix != ".toml":
        raise InputError(f"the name of a study file must end in .toml, got {study.name!r}")
    if study.exists():
        raise InputError(f"{study} exists already and is not overwritten: choose another name, or remove it first")
    if not study.parent.is_dir():
        raise InputError(f"there is no folder {study.parent}: create it first")
    level = None if level_kpa is None else 1e3 * level_kpa
    direction = None if gravity is None else vector(
        gravity, 3, f"--gravity must be three numbers 'x,y,z', got {gravity!r}", "m/s^2"
    )
    parts = length if isinstance(length, tuple) else None
    columns, given = load_mapping(mapping), [*files, *more]
    with busy("reading the recordings"):
        draft = draft_study(given, study, mapping=columns, level=level, length=None if parts else length, mass=mass,
                            segments=parts, gravity=direction)
    write_new(study, draft.text)
    with suppress(KeyboardInterrupt), busy("trying the study; Ctrl-C leaves it untried"):
        draft = checked(draft, study)
        write_text(study, draft.text)
    columns_of = [part for mapping_file in mapping or ["columns.toml"] for part in ("--mapping", mapping_file)]
    again = " ".join(["pliant new", str(study), "--from", *map(str, given), *columns_of])
    print_draft(study, draft, again, as_json=json)


def print_draft(study: Path, draft: Draft, again: str, *, as_json: bool) -> None:
    """Print the name of the study file written, its warnings and open questions, what its trial showed, and the steps
    that follow. `again` is the command that writes the draft by a mapping, which is its last argument.
    """
    from pliant.study.draft import sentence

    check, steps = draft.check, next_steps(study, draft, again)
    lines = [f"wrote {study}", *(f"! {doubt}" for doubt in draft.doubts), *(f"? {q}" for q in draft.questions),
             *([sentence(check)] if check else []), f"next: {steps[0]}", *(f"then: {step}" for step in steps[1:])]
    content = {"study": str(study), "open": draft.questions, "doubts": draft.doubts, "next": steps,
               "problem": check.problem if check else None, "forecast_s": check.seconds if check else None}
    answer(content, "\n".join(lines), as_json=as_json)


def next_steps(study: Path, draft: Draft, again: str) -> list[str]:
    """Return what to do next with a draft, in this order: a run is the last step, and the first one only if no question
    is open and the trial did not fail.
    """
    run = f"pliant run {study} -o results/{study.stem}"
    if draft.inspected is not None and draft.inspected.first.asks_inputs:
        entry = 'pressure = { columns = [4, 5], unit = "kPa" }'
        file = again.rsplit(maxsplit=1)[-1].rpartition("=")[2]
        return [f"write into {file} the columns and unit of the inputs, such as: {entry}", f"remove {study}", again]
    if draft.inspected is not None and (orders := draft.inspected.without_cause):
        return [f"add the log of the inputs to the recordings of pliant new; without one: pliant order {orders[0]}"]
    steps = []
    if draft.check is not None and draft.check.problem:
        steps.append(f"change in {study} what its first lines name")
    if draft.questions:
        names = ", ".join(dict.fromkeys(q.partition(":")[0] for q in draft.questions))
        steps.append(f'replace each "?" in {study}: {names}')
    return [*steps, run]
