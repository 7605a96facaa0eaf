"""A view of a control loop that runs in another process, through the log that it writes; the loop is not affected."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from pliant.contact.locate import locate
from pliant.errors import InputError
from pliant.files import regular_file
from pliant.loop.log import MARK
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.units import shown_in
from pliant.view.live import PageRequest

BEHIND = 0.7  # s, lag of the page: the log reaches the disk at most 0.5 s after the loop wrote it
KEPT = 4000  # rows
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
        if model.space and mechanics_of(model).lengthens:
            raise InputError("the log of a control loop holds joint angles alone: watch a model whose length is fixed")
        self.model = model if model.space else fixed_length(model)
        self.rows, self.rest = deque[list[float]](maxlen=KEPT), b""
        if len(self.angles) != self.model.size:
            what = "joint coordinates" if model.space else "links"
            raise InputError(f"the log {path} has {len(self.angles)} {what}, but the model has {self.model.size}: use "
                             "the model of that loop")  # fmt: skip
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
            size, shown = (1e3, "mm") if unit == "m" else (np.rad2deg(1.0), "deg")
            target, error = size * value[f"target_{name}"], size * value[f"error_{name}"]
            texts.append(f"{output.replace('_', ' ')} target {target:.2f} {shown}, error {error:.2f} {shown}".lstrip())
        return "; ".join(texts)

    def touching(self, value: dict[str, float]) -> list[float] | None:
        """Return the position [mm] and components [N] of the single contact force that explains the disturbance
        torques; None if there is none, or in space.
        """
        if self.model.space:
            return None
        n = self.model.n
        angle, torque, sd = (np.array([value.get(name.format(i + 1), np.nan) for i in range(n)])
                             for name in ("phi_{}_rad", "torque_{}_nm", "torque_sd_{}_nm"))
        if not self.touch or not np.isfinite(torque + sd).all() or abs(torque).max() < self.touch:
            return None
        push = locate(self.model, angle, torque, np.diag(sd**2 + (self.touch / DOUBT) ** 2))
        return [round(float(v), 4) for v in (*1e3 * push.position, *push.force)]
