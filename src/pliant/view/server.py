"""The server of the live page: for this machine only, with a token in the address and one running model per page."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
from typing import Any

from pydantic import ValidationError

from pliant.errors import InputError
from pliant.model import Chamber, Model
from pliant.plugins import optional
from pliant.simulation.state import typical_pressure
from pliant.units import shown_in
from pliant.view.live import Live, PageContent, PageRequest
from pliant.view.report import asset, script_json, template
from pliant.view.watched import WatchedLoop

HOST = "127.0.0.1"
RATE = 60.0  # frames in a second
BARE_KPA = 200.0  # upper end of the sliders without recordings
MISSING = "the live page needs the extra view: pip install 'pliant[view]'"
LARGEST = 4096  # bytes of a request
POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
          "connect-src ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'")


def running(content: PageContent) -> Live | WatchedLoop:
    """Return the source of the motion that the page shows: a model that is simulated, or the log of a control loop that
    runs in another process.
    """
    return Live(content) if content.log is None else WatchedLoop(content.log, content.model, content.touch)


def live_page(content: PageContent, live: Live | WatchedLoop) -> str:
    """Return the HTML text of the live page."""
    m, ends = content.model, ranges(content, live.chambers)
    data = {
        "length": 1e3 * m.length, "links": m.n, "chambers": chamber_names(m, live.chambers),
        "gravity": [float(g) for g in m.gravity],
        "sliders": [s._asdict() for s in content.sliders], "name": m.name,
        "watched": content.log is not None, **ends,
        "records": [n for n, e in content.records.items() if e.pressure is not None],
    }
    scripts = [asset("uPlot.iife.min.js"), asset("figures.js"), asset("live.js")]
    pressed = all(unit == "kPa" for unit in ends["units"])
    return str(template("live.html.j2").render(
        name=m.name, in_space=m.space is not None, pressed=pressed, records=data["records"],
        data=script_json(data), scripts=scripts,
        styles=[asset("uPlot.min.css"), asset("page.css")]))


def chamber_names(model: Model, count: int) -> list[str]:
    """Return the names of the `count` pressures on the page: those of the model's chambers if it has that many, else
    numbers.
    """
    names = [c.name for c in model.chambers]
    if count == 1:
        return ["pressure"] if names == [Chamber.name] else names[:1]
    return names if len(names) == count else [f"chamber {c + 1}" for c in range(count)]


def highest(content: PageContent) -> float:
    """Return the upper end of the pressure sliders [kPa]: 25 % above the highest recorded pressure."""
    named = dict(zip(content.model.actuation.names, content.model.actuation.units, strict=True))
    peaks = [e.peak for e in content.records.values()]
    if set(named.values()) != {"Pa"}:
        peaks = [trace.peak for e in content.records.values() for name, trace in e.traces.items()
                 if named.get(name) == "Pa"]  # fmt: skip
    return 1.25e-3 * max(peaks) if peaks and max(peaks) > 0 else BARE_KPA


def ranges(content: PageContent, count: int) -> dict[str, list[Any]]:
    """Return the unit, the lowest and the highest value of each input's slider. Pressures and tensions begin at 0;
    displacements and angles of tendons have both signs.
    """
    model = content.model
    known = [shown_in(unit) for unit in model.actuation.units]
    if len(known) != count or all(unit == "kPa" for _, unit in known):
        return {"units": ["kPa"] * count, "lowest": [0.0] * count, "highest": [highest(content)] * count}
    ends = [highest(content) if unit == "kPa" else 2.0 * factor * typical_pressure(model, c)
            for c, (factor, unit) in enumerate(known)]  # fmt: skip
    lowest = [-end if unit in ("mm", "rad") else 0.0 for end, (_, unit) in zip(ends, known, strict=True)]
    return {"units": [unit for _, unit in known], "lowest": lowest, "highest": ends}


def application(content: PageContent, token: str, host: str) -> Any:
    """Return an ASGI application that serves the page and its WebSocket. Any other address is answered with 404, not
    found.
    """
    optional("starlette", MISSING)
    from starlette.applications import Starlette
    from starlette.responses import HTMLResponse, PlainTextResponse
    from starlette.routing import Route, WebSocketRoute

    live_page(content, running(content))  # raises an error now, before a browser connects
    one_build = asyncio.Lock()  # shared by all pages, so that one with many requests does not block the others

    def known(connection: Any) -> bool:
        return connection.headers.get("host") == host and secrets.compare_digest(
            connection.path_params["token"].encode(), token.encode())

    async def page(request: Any) -> Any:
        if not known(request):
            return PlainTextResponse("not found", 404)
        headers = {"Content-Security-Policy": POLICY.format(host=host), "Referrer-Policy": "no-referrer",
                   "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        return HTMLResponse(live_page(content, running(content)), headers=headers)

    async def follow(ws: Any) -> None:
        if not known(ws) or ws.headers.get("origin") != f"http://{host}":
            await ws.close(1008)
            return
        await ws.accept()
        await converse(ws, running(content), one_build)

    app = Starlette(routes=[Route("/{token}/", page), WebSocketRoute("/{token}/live", follow)])
    app.router.redirect_slashes = False
    return app


async def build(live: Live, asked: asyncio.Event, one_build: asyncio.Lock) -> None:
    """Build the models that the page requests on a thread, one at a time, while the motion goes on."""
    while True:
        await asked.wait()
        async with one_build:
            asked.clear()
            job = live.job()
            preparing = asyncio.create_task(asyncio.to_thread(live.prepare, job))
            try:
                live.replace_model(job, await asyncio.shield(preparing))
            finally:
                await asyncio.wait({preparing})  # a thread outlives the closing of its page


async def converse(ws: Any, live: Live | WatchedLoop, one_build: asyncio.Lock) -> None:
    """Send frames at a steady rate and receive requests, until the page is closed."""
    from starlette.websockets import WebSocketDisconnect

    asked = asyncio.Event()
    building = [asyncio.create_task(build(live, asked, one_build))] if isinstance(live, Live) else []

    async def listen() -> None:
        while True:
            message = await ws.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text") or ""
            try:
                live.receive(PageRequest.model_validate_json(text[:LARGEST]))  # a longer text, cut, is invalid
            except ValidationError:
                live.message = "the page sent a request that is not valid: reload the page"
            if live.pending:
                asked.set()

    listening = asyncio.create_task(listen())
    clock = asyncio.get_running_loop().time
    before = due = clock()
    try:
        while not listening.done():
            now = clock()
            live.advance(now - before)
            before = now
            await ws.send_text(json.dumps(live.frame(), allow_nan=False))
            due = max(due + 1 / RATE, now)
            await asyncio.wait({listening}, timeout=max(due - clock(), 0.0))
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass  # the page is gone
    finally:
        for task in (listening, *building):
            task.cancel()


class Server:
    """A server for the live page; `address` is the address to open.

    Parameters
    ----------
    content : PageContent
    port : int
        Port number; 0 for any free one.

    Raises
    ------
    InputError
        When the packages of the extra view are missing, the port is in use, or the model cannot be stepped.
    """

    def __init__(self, content: PageContent, port: int = 0) -> None:
        uvicorn = optional("uvicorn", MISSING)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self.socket.bind((HOST, port))
            self.socket.listen()  # from now on a browser that connects waits instead of being refused
        except OSError as error:
            self.socket.close()
            raise InputError(f"cannot listen at {HOST}:{port}: {error.strerror or error}; try --port 0") from None
        host = f"{HOST}:{self.socket.getsockname()[1]}"
        token = secrets.token_urlsafe(16)
        self.address = f"http://{host}/{token}/"
        try:
            page = application(content, token, host)
        except BaseException:  # such as the log of a loop that is not there
            self.socket.close()
            raise
        config = uvicorn.Config(page, log_level="error", ws="websockets-sansio", timeout_graceful_shutdown=1,
                                lifespan="off", access_log=False)
        self.server = uvicorn.Server(config)

    def run(self) -> None:
        """Serve the page until the program is interrupted, or `stop` is called from another thread."""
        try:
            self.server.run(sockets=[self.socket])
        finally:
            self.socket.close()

    def stop(self) -> None:
        """Stop the server, so that `run` returns."""
        self.server.should_exit = True
