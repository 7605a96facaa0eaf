"""`pliant view`: run a model interactively on a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import answer, in_unit


def view(
    source: Annotated[Path, typer.Argument(help="Model file, or results folder of `pliant run`.")],
    loop: Annotated[
        Path | None, typer.Option("--loop", help="log.csv that `pliant control` is writing, to watch that loop.")
    ] = None,
    touch_mn_m: Annotated[
        float, typer.Option("--touch-mn-m", parser=in_unit("mN m", least=0.0),
                            help="With --loop and --estimator filter: unexplained joint"
                            " torque, mN m, above which the force that explains it is drawn; 0: never.")
    ] = 0.0,
    port: Annotated[int, typer.Option("--port", help="Port on this machine; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Open a page where the model runs: sliders set pressures, parameters and gravity; the mouse pulls the body.

    Needs the optional packages of the extra view. The page is accessible from this machine only, until this program
    ends (Ctrl-C).

    Example: pliant view results/demo
    """
    import webbrowser

    from pliant.view.live import page_content
    from pliant.view.server import Server

    server = Server(page_content(source, loop, 1e-3 * touch_mn_m), port)
    answer({"address": server.address}, server.address, as_json=json)
    if browser:
        webbrowser.open(server.address)
    server.run()
