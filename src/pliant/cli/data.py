"""`pliant data`: list or download published recordings of other laboratories."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer

from pliant.cli.terminal import answer, busy, say


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
