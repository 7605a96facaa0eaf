"""The live page's server: this machine alone, a token in the address, one running model for each page."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
from typing import Any

from pydantic import ValidationError

from pliant.errors import InputError
from pliant.model import Chamber, Model
from pliant.simulation.levels import typical_pressure
from pliant.units import shown_in
from pliant.view.live import Live, Played, Wish
from pliant.view.report import asset, script_json, template
from pliant.view.watched import WatchedLoop

HOST = "127.0.0.1"
RATE = 60.0  # frames in a second
BARE_KPA = 200.0  # where nothing was recorded
LARGEST = 4096  # bytes of a wish
POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
          "connect-src ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'")


def running(played: Played) -> Live | WatchedLoop:
    """Return the moving body of a page: a model of its own, or the loop that is watched."""
    return Live(played) if played.log is None else WatchedLoop(played.log, played.model, played.touch)


def live_page(played: Played, live: Live | WatchedLoop) -> str:
    """The page as text."""
    m, ends = played.model, ranges(played, live.chambers)
    data = {
        "length": 1e3 * m.length, "links": m.n, "chambers": chamber_names(m, live.chambers),
        "gravity": [float(g) for g in m.gravity],
        "sliders": [s._asdict() for s in played.sliders], "name": m.name,
        "watched": played.log is not None, **ends,
        "records": [n for n, e in played.records.items() if e.pressure is not None],
    }
    scripts = [asset("uPlot.iife.min.js"), asset("figures.js"), asset("live.js")]
    pressed = all(unit == "kPa" for unit in ends["units"])
    return str(template("live.html.j2").render(
        name=m.name, in_space=m.space is not None, pressed=pressed, records=data["records"],
        data=script_json(data), scripts=scripts,
        styles=[asset("uPlot.min.css"), asset("page.css")]))


def chamber_names(model: Model, count: int) -> list[str]:
    """Return the page's names of the pressures: those of the model where it names all of them."""
    names = [c.name for c in model.chambers]
    if count == 1:
        return ["pressure"] if names == [Chamber.name] else names[:1]
    return names if len(names) == count else [f"chamber {c + 1}" for c in range(count)]


def highest(played: Played) -> float:
    """Return the upper ends of the pressure sliders, kPa: a quarter above the recorded pressures."""
    seen = [e.peak for e in played.records.values()]
    return 1.25e-3 * max(seen) if seen and max(seen) > 0 else BARE_KPA


def ranges(played: Played, count: int) -> dict[str, list[Any]]:
    """Return unit and ends of the slider of each input: pressures from none to the highest, tendons either way."""
    model = played.model
    known = [shown_in(unit) for unit in model.actuation.units]
    if len(known) != count or all(unit == "kPa" for _, unit in known):
        return {"units": ["kPa"] * count, "lowest": [0.0] * count, "highest": [highest(played)] * count}
    ends = [highest(played) if unit == "kPa" else 2.0 * factor * typical_pressure(model, c)
            for c, (factor, unit) in enumerate(known)]  # fmt: skip
    lowest = [-end if unit in ("mm", "rad") else 0.0 for end, (_, unit) in zip(ends, known, strict=True)]
    return {"units": [unit for _, unit in known], "lowest": lowest, "highest": ends}


def application(played: Played, token: str, host: str) -> Any:
    """The page and its socket, as an ASGI application; everything else is not found."""
    try:
        from starlette.applications import Starlette
        from starlette.responses import HTMLResponse, PlainTextResponse
        from starlette.routing import Route, WebSocketRoute
    except ImportError:
        raise InputError("the live page needs the extra view: pip install 'pliant[view]'") from None
    live_page(played, running(played))  # refused here, before a browser asks
    one_build = asyncio.Lock()  # of all pages: one that asks for many models does not hold up the others

    def known(connection: Any) -> bool:
        return connection.headers.get("host") == host and secrets.compare_digest(
            connection.path_params["token"].encode(), token.encode())

    async def page(request: Any) -> Any:
        if not known(request):
            return PlainTextResponse("not found", 404)
        headers = {"Content-Security-Policy": POLICY.format(host=host), "Referrer-Policy": "no-referrer",
                   "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        return HTMLResponse(live_page(played, running(played)), headers=headers)

    async def follow(ws: Any) -> None:
        if not known(ws) or ws.headers.get("origin") != f"http://{host}":
            await ws.close(1008)
            return
        await ws.accept()
        await converse(ws, running(played), one_build)

    made = Starlette(routes=[Route("/{token}/", page), WebSocketRoute("/{token}/live", follow)])
    made.router.redirect_slashes = False
    return made


async def build(live: Live, asked: asyncio.Event, one_build: asyncio.Lock) -> None:
    """Build on a thread what the page asked for last, one build at a time, while motion and frames go on."""
    while True:
        await asked.wait()
        async with one_build:
            asked.clear()
            job = live.job()
            live.take(job, await asyncio.to_thread(live.prepare, job))


async def converse(ws: Any, live: Live | WatchedLoop, one_build: asyncio.Lock) -> None:
    """Send frames at a steady rate and take wishes, until the page is closed."""
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
                live.ask(Wish.model_validate_json(text[:LARGEST]))  # what is longer is no JSON when cut
            except ValidationError:
                live.message = "the page asked for something that cannot be"
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
    """A server that is ready to run; `address` is what to open.

    Parameters
    ----------
    played : Played
    port : int
        0: any free one.

    Raises
    ------
    InputError
        When the extra is missing, the port is taken or the model cannot be stepped.
    """

    def __init__(self, played: Played, port: int = 0) -> None:
        try:
            import uvicorn
        except ImportError:
            raise InputError("the live page needs the extra view: pip install 'pliant[view]'") from None
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self.socket.bind((HOST, port))
            self.socket.listen()  # from here on a browser that follows the address waits, and is not refused
        except OSError as error:
            self.socket.close()
            raise InputError(f"cannot listen at {HOST}:{port}: {error.strerror or error}") from None
        host = f"{HOST}:{self.socket.getsockname()[1]}"
        token = secrets.token_urlsafe(16)
        self.address = f"http://{host}/{token}/"
        config = uvicorn.Config(application(played, token, host), log_level="error", ws="websockets-sansio",
                                timeout_graceful_shutdown=1, lifespan="off", access_log=False)
        self.server = uvicorn.Server(config)

    def run(self) -> None:
        """Serve until the program is interrupted, or `stop` is called from another thread."""
        try:
            self.server.run(sockets=[self.socket])
        finally:
            self.socket.close()

    def stop(self) -> None:
        """End `run`."""
        self.server.should_exit = True
