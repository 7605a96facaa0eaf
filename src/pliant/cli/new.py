"""`pliant new`: a commented study for the user's own files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.terminal import say

if TYPE_CHECKING:
    from pliant.study.draft import Draft


def new(
    paths: Annotated[list[Path], typer.Argument(
        metavar="study",
        help="Study file to write (.toml); an existing one is left alone. After it, recordings beside that of --from.",
    )],
    files: Annotated[
        list[Path],
        typer.Option("--from", metavar="<path>",
                     help="Recordings, or logs of their pressures (push_log.csv for push.csv), such as --from *.csv"),
    ],
    mapping: Annotated[Path | None, typer.Option(help="TOML file with columns, units and format.")] = None,
    length: Annotated[float | None, typer.Option(help="Of the body, m.")] = None,
    mass: Annotated[float | None, typer.Option(help="Of the body, kg.")] = None,
    level_kpa: Annotated[
        float | None, typer.Option("--level-kpa", help="Level of pulses whose pressure was not recorded, kPa gauge.")
    ] = None,
    gravity: Annotated[
        str | None, typer.Option(help="In the tracker's axes, m/s^2: 'x,y,z', such as '0,0,-9.81'.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was written and asked as JSON.")] = False,
) -> None:
    """Write a commented study file for recordings; entries that only you can know are marked "?".

    Example: pliant new arm.toml --from 100mbar.c3d 200mbar.c3d --mass 0.15
    """
    from pliant.cli.progress import busy
    from pliant.cli.reading import load_mapping
    from pliant.errors import InputError
    from pliant.study.draft import draft_study

    study, *more = paths
    if study.suffix != ".toml":
        raise InputError(f"a study file ends in .toml, not {study.name!r}")
    if study.exists():
        raise InputError(f"{study} exists and is left as it is: choose another name, or remove it first")
    if not study.parent.is_dir():
        raise InputError(f"there is no folder {study.parent}: make it first")
    level = None if level_kpa is None else 1e3 * level_kpa
    direction, columns, given = vector(gravity), load_mapping(mapping), [*files, *more]
    with busy("looking at the recordings"):
        draft = draft_study(given, study, mapping=columns, level=level, length=length, mass=mass, gravity=direction)
    try:
        with study.open("x", encoding="utf-8") as out:
            out.write(draft.text)
    except OSError as error:
        raise InputError(f"cannot write {study}: {error.strerror or error}") from None
    tell(study, draft, as_json=json)


def vector(text: str | None) -> list[float] | None:
    """Three numbers from 'x,y,z'; None stays None."""
    from pliant.errors import InputError

    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--gravity is three numbers 'x,y,z', not {text!r}") from None
    return [x, y, z]


def tell(study: Path, draft: Draft, *, as_json: bool) -> None:
    """Print what was written, what looks wrong, what is open and what comes next."""
    if as_json:
        import json

        say(json.dumps({"study": str(study), "open": list(draft.questions), "doubts": list(draft.doubts)}))
        return
    say(f"wrote {study}")
    for doubt in draft.doubts:
        say(f"! {doubt}")
    for question in draft.questions:
        say(f"? {question}")
    answer = 'answer the "?" in it, then: ' if draft.questions else ""
    say(f"next: {answer}pliant run {study} -o results/{study.stem}")
