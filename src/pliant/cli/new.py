"""`pliant new`: write a commented study file for recordings."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.reading import MAPPING, load_mapping, vector
from pliant.cli.terminal import answer, in_unit

if TYPE_CHECKING:
    from pliant.study.draft import Draft


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
    length: Annotated[float | None, typer.Option(parser=in_unit("m"),
                                                 help="Length of the body, m, or as 170mm.")] = None,
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
    columns, given = load_mapping(mapping), [*files, *more]
    with busy("reading the recordings"):
        draft = draft_study(given, study, mapping=columns, level=level, length=length, mass=mass, gravity=direction)
    write_new(study, draft.text)
    with suppress(KeyboardInterrupt), busy("trying the study; Ctrl-C leaves it untried"):
        draft = checked(draft, study)
        write_text(study, draft.text)
    print_draft(study, draft, as_json=json)


def print_draft(study: Path, draft: Draft, *, as_json: bool) -> None:
    """Print the name of the study file written, its warnings and open questions, what its trial showed, and the next
    command.
    """
    from pliant.study.draft import sentence

    check = draft.check
    failed = check is not None and bool(check.problem)
    first = 'replace each "?" in it, then run: ' if draft.questions else \
        "change what its first lines name, then run: " if failed else ""
    lines = [f"wrote {study}", *(f"! {doubt}" for doubt in draft.doubts), *(f"? {q}" for q in draft.questions),
             *([sentence(check)] if check else []), f"next: {first}pliant run {study} -o results/{study.stem}"]
    content = {"study": str(study), "open": draft.questions, "doubts": draft.doubts,
               "problem": check.problem if check else None, "forecast_s": check.seconds if check else None}
    answer(content, "\n".join(lines), as_json=as_json)
