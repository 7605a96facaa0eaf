"""`pliant view`: a model that runs in a page of the browser, on this machine alone."""

from __future__ import annotations

from json import dumps
from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import say


def view(
    source: Annotated[Path, typer.Argument(help="Model file, or folder that `pliant run` has written.")],
    loop: Annotated[
        Path | None, typer.Option("--loop", help="log.csv that `pliant control` is writing: watch that loop.")
    ] = None,
    touch_mn_m: Annotated[
        float, typer.Option("--touch-mn-m", min=0.0, help="Of a loop with --estimator filter: unexplained joint torque,"
                            " mN m, from which on the force that explains it is drawn; 0: none.")
    ] = 0.0,
    port: Annotated[int, typer.Option("--port", help="Port on this machine; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Open a page where the model runs: sliders for pressures, parameters and gravity; pull the body with the mouse.

    Needs the extra view. The page is for this machine alone and ends with this program (Ctrl-C).

    Example: pliant view results/demo
    """
    import webbrowser

    from pliant.view.played import played_from
    from pliant.view.server import Server

    server = Server(played_from(source, loop, 1e-3 * touch_mn_m), port)
    say(dumps({"address": server.address}) if json else server.address)
    if browser:
        webbrowser.open(server.address)
    server.run()
