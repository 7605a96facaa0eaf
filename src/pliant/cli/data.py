"""`pliant data`: recordings that other laboratories published."""

from __future__ import annotations

import json as jsonlib
from typing import Annotated, Any, Literal

import typer

from pliant.cli.progress import busy
from pliant.cli.terminal import say


def data(
    action: Annotated[Literal["list", "fetch"], typer.Argument(help="List the data sets, or fetch some.")],
    names: Annotated[list[str] | None, typer.Argument(help="Names to fetch; all where none is given.")] = None,
    mirror: Annotated[
        str | None, typer.Option(help="Address that has the files as NAME/FILE: https://..., file:///...")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """List or download the public recordings of the example studies; downloads are verified by checksum.

    A study, or any command, then finds them as data:NAME/FILE. The folder is that of PLIANT_DATA, else in your caches.

    Example: pliant data fetch silicone_cantilever && pliant run examples/silicone_cantilever.toml -o results/beam
    """
    from pliant.errors import InputError
    from pliant.recording.published import data_folder, data_set, data_sets, fetch

    if action == "list":
        entries = [entry(name) for name in names or data_sets()]
        if json:
            say(jsonlib.dumps({"folder": str(data_folder()), "data": entries}))
            return
        say(f"folder: {data_folder()}")
        for one in entries:
            say(f"\n{one['name']}: {one['what']}\n  {one['licence']}; {one['origin']}")
            for file in one["files"]:
                say(f"  {'here  ' if file['here'] else 'absent'}  {file['file']}"
                           + (f"  (by hand: {file['by_hand']})" if file["by_hand"] else ""))  # fmt: skip
        return
    paths = []
    for name in names or data_sets():
        with busy(f"bringing {name}"):
            try:
                paths += fetch(name, mirror=mirror)
            except InputError as error:
                if names or any(f.address for f in data_set(name).files.values()):
                    raise
                say(f"left out: {error}", error=True)  # of all, what has to be brought by hand
    say(jsonlib.dumps([str(p) for p in paths]) if json else "\n".join(map(str, paths)))


def entry(name: str) -> dict[str, Any]:
    """Return the description of a data set, and which of its files are on this machine."""
    from pliant.recording.published import data_folder, data_set, is_published

    known, folder = data_set(name), data_folder() / name
    files = [{"file": f, "here": (folder / f).is_file() and is_published(folder / f, p), "sha256": p.sha256,
              "address": p.address, "by_hand": p.by_hand} for f, p in known.files.items()]  # fmt: skip
    return {"name": name, "what": known.what, "licence": known.licence, "origin": known.origin, "files": files}
