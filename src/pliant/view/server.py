"""The server of the live page: for this machine only, with a token in the address and one running model per page."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from pliant.contact.locate import locate
from pliant.errors import InputError
from pliant.files import regular_file
from pliant.loop.log import MARK
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model
from pliant.model.features import ALL, IN_SPACE, LENGTHENS, Consumer
from pliant.plugins import optional
from pliant.simulation.state import typical_pressure
from pliant.units import shown_in
from pliant.view.live import Live, PageContent, PageRequest
from pliant.view.report import asset, script_json, template

HOST = "127.0.0.1"
RATE = 60.0  # frames in a second
BARE_KPA = 200.0  # upper end of the sliders without recordings
MISSING = "the live page needs the extra view: pip install 'pliant[view]'"
LARGEST = 4096  # bytes of a request
POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
          "connect-src ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'")


BEHIND = 0.7  # s, lag of the page: the log reaches the disk at most 0.5 s after the loop wrote it
KEPT = 4000  # rows
LONGER = LENGTHENS | {"space_lengthening"}
LOG = Consumer(
    "the page of a control loop", ALL - LONGER,
    remedy=dict.fromkeys(LONGER, "the log of a loop holds joint angles alone: watch a model whose length is fixed"),
)
TOUCHED = Consumer("the point of a touch", ALL - LONGER - IN_SPACE)  # drawn in the plane
DOUBT = 3.0  # the torque of a touch is this many standard deviations of the model's error


class WatchedLoop:
    """A control loop shown from its log while it runs, drawn like a running model.

    Parameters
    ----------
    path : Path
        The ``log.csv`` that `pliant control` is writing.
    model : Model
        Model of the body, with as many links, or in space joint coordinates, as the log has angles.
    touch : float
        Unexplained joint torque [N m] above which the page shows the single force that would explain the torques of all
        joints. It should be larger than the unexplained torque in free motion. With 0, no force is shown.

    Raises
    ------
    InputError
        When the file cannot be read, is not the log of a loop, or belongs to another body, or when the model lengthens,
        since a log holds angles alone.
    """

    def __init__(self, path: Path, model: Model, touch: float = 0.0) -> None:
        try:
            with regular_file(path, "log") as file:
                mark, names = (file.readline().decode("ascii", "replace").strip() for _ in range(2))
                self.read = file.tell()
        except OSError as error:
            raise InputError(f"cannot read the log {path}: {error.strerror or error}") from None
        self.path = path
        if mark != MARK:
            raise InputError(f"{path} is not the log of a control loop: name the log.csv that `pliant control` writes")
        self.columns = names.split(",")
        self.angles = [k for k, n in enumerate(self.columns) if n.startswith("phi_")]
        LOG.check(model)
        self.model = model
        self.rows, self.rest = deque[list[float]](maxlen=KEPT), b""
        if len(self.angles) != self.model.size:
            raise InputError(f"the log {path} has {len(self.angles)} angles, but the model has "
                             f"{mechanics_of(model).counted}: use the model of that loop")  # fmt: skip
        self.unit = model.actuation.units[0]  # of all inputs of a task
        self.shown, self.message, self.fault, self.touch = -np.inf, "", "", touch
        self.design = ""  # stability margins and simulated test of the loop
        self.since = np.inf  # s, time of the first row after the last fault
        self.chambers = len(self.inputs)
        self.pending = False  # no model is ever built

    @property
    def inputs(self) -> list[int]:
        """Indices of the log's columns that hold the measured input of each chamber or tendon."""
        return self.named(self.model.actuation.kinds[0])

    def named(self, what: str) -> list[int]:
        """Return the indices of the log's columns that hold one quantity of each input: its command, or its measured
        value, such as the pressure, as `what` says.
        """
        ending = f"_{self.unit.lower()}"
        return [k for k, n in enumerate(self.columns) if n.startswith(f"{what}_") and n.endswith(ending)]

    def values_of(self, row: list[float], columns: list[int]) -> list[float]:
        """Return the values of some inputs in a row of the log, in the unit that the page shows; 0 where unknown."""
        factor, _ = shown_in(self.unit)
        return [round(float(np.nan_to_num(factor * row[k])), 4) for k in columns]

    def receive(self, request: PageRequest) -> None:
        """Ignore a request of the page, since a watched loop must not be changed."""

    def advance(self, elapsed: float) -> None:
        """Read new rows of the log, and advance the displayed time by `elapsed` [s]."""
        with self.path.open("rb") as file:
            file.seek(self.read)
            *lines, self.rest = (self.rest + file.read()).split(b"\n")
            self.read = file.tell()
        for line in lines:
            if line.startswith(b"# design: "):
                self.design = f"; {line[10:].decode('ascii', 'replace')}"
            if line.startswith(b"# fault"):
                self.fault, self.since = line[2:].decode("ascii", "replace"), np.nan
            try:
                row = [float(v) for v in line.split(b",")]
            except ValueError:
                continue  # a comment line
            if len(row) == len(self.columns):
                self.rows.append(row)
                self.since = row[0] if np.isnan(self.since) else self.since
        if self.rows:
            newest = self.rows[-1][0]
            self.shown = float(np.clip(self.shown + elapsed, newest - 2 * BEHIND, newest))

    def frame(self) -> dict[str, Any]:
        """Return the state at the displayed time for drawing: positions [mm], inputs [kPa; for tendons N,
        mm or rad], status.
        """
        row = next((r for r in reversed(self.rows) if r[0] <= self.shown), None)
        if row is None:
            still = [[0.0] * mechanics_of(self.model).dimension] * (self.model.n + 2)
            return {"t": 0.0, "body": still, "message": "waiting for the first row of the log", "measured": None,
                    "kpa": [0.0] * self.chambers, "command": [0.0] * self.chambers, "force": [0, 0]}
        m, phi = self.model, np.array([row[k] for k in self.angles])
        joints = mechanics_of(m).nodes(phi)
        value = dict(zip(self.columns, row, strict=True))
        vented = f"VENTED, {self.fault or 'by a fault'}" if value.get("vented") else "in control"
        if not value.get("vented") and row[0] >= self.since:
            vented = f"in control, but {self.fault}"
        message = f"{vented}; {self.wanted(value)}; computation {value['work_us']:.0f} us per period{self.design}"
        return {
            "t": round(row[0], 6), "body": np.nan_to_num(np.round(1e3 * joints, 3)).tolist(), "message": message,
            "measured": None, "force": [0, 0],
            "kpa": self.values_of(row, self.inputs), "command": self.values_of(row, self.named("command")),
            "touch": self.touching(value),
        }

    def wanted(self, value: dict[str, float]) -> str:
        """Return a text with the target and the error of each controlled output, from one row of the log."""
        texts = []
        for name in (c.removeprefix("target_") for c in self.columns if c.startswith("target_")):
            output, unit = name.rpartition("_")[::2]
            size, word = (1e3, "mm") if unit == "m" else (np.rad2deg(1.0), "deg")
            target, error = size * value[f"target_{name}"], size * value[f"error_{name}"]
            texts.append(f"{output.replace('_', ' ')} target {target:.2f} {word}, error {error:.2f} {word}".lstrip())
        return "; ".join(texts)

    def touching(self, value: dict[str, float]) -> list[float] | None:
        """Return the position [mm] and components [N] of the single contact force that explains the disturbance
        torques; None if there is none, or in space.
        """
        if TOUCHED.lacks(self.model):
            return None
        n = self.model.n
        angle, torque, sd = (np.array([value.get(name.format(i + 1), np.nan) for i in range(n)])
                             for name in ("phi_{}_rad", "torque_{}_nm", "torque_sd_{}_nm"))
        if not self.touch or not np.isfinite(torque + sd).all() or abs(torque).max() < self.touch:
            return None
        push = locate(self.model, angle, torque, np.diag(sd**2 + (self.touch / DOUBT) ** 2))
        return [round(float(v), 4) for v in (*1e3 * push.position, *push.force)]


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
