"""A control loop that runs elsewhere, watched by the log that it writes: nothing is sent to it."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from pliant.contact.locate import locate
from pliant.errors import InputError
from pliant.loop.log import MARK
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.view.live import Wish

BEHIND = 0.7  # s that the page lags: the log reaches the disk at most half a second after the loop wrote it
KEPT = 4000  # rows
DOUBT = 3.0  # standard deviations of the model's error that the torque of a touch is taken for


class WatchedLoop:
    """The rows of a loop's log as they come, drawn like a running model.

    Parameters
    ----------
    path : Path
        Of the ``log.csv`` that `pliant control` is writing.
    model : Model
        Of the body; its links are as many as the log's angles.
    touch : float
        N m; where a joint's torque that the model does not explain is larger, the one force is shown that would explain
        the torques of all joints. Above what the model's own error makes of it in free motion. 0: none is shown.

    Raises
    ------
    InputError
        When the file cannot be read, is no log of a loop, or is of another body; and when the model lengthens, since
        a log holds angles alone.
    """

    def __init__(self, path: Path, model: Model, touch: float = 0.0) -> None:
        try:
            with path.open("rb") as file:
                mark, names = (file.readline().decode("ascii", "replace").strip() for _ in range(2))
                self.read = file.tell()
        except OSError as error:
            raise InputError(f"cannot read the log {path}: {error.strerror or error}") from None
        self.path = path
        if mark != MARK:
            raise InputError(f"{path} is no log of a control loop: name the log.csv that `pliant control` writes")
        self.columns = names.split(",")
        self.angles = [k for k, n in enumerate(self.columns) if n.startswith("phi_")]
        if len(self.angles) != model.n:
            raise InputError(f"the log {path} is of {len(self.angles)} links, the model has {model.n}")
        self.model, self.rows, self.rest = fixed_length(model), deque[list[float]](maxlen=KEPT), b""
        self.shown, self.message, self.fault, self.touch = -np.inf, "", "", touch
        self.design = ""  # margins and rehearsal of the loop
        self.since = np.inf  # s, time of the first row behind the last fault
        self.chambers = len(self.named("pressure"))
        self.pending = False  # nothing is built here

    def named(self, what: str) -> list[int]:
        """Columns of a pressure or a command, one for each chamber."""
        return [k for k, n in enumerate(self.columns) if n.startswith(f"{what}_") and n.endswith("pa")]

    def ask(self, wish: Wish) -> None:
        """Pass over what the page asks for: a loop that is watched is not touched."""

    def advance(self, elapsed: float) -> None:
        """Read what has come, and move on."""
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
                continue  # a remark
            if len(row) == len(self.columns):
                self.rows.append(row)
                self.since = row[0] if np.isnan(self.since) else self.since
        if self.rows:
            newest = self.rows[-1][0]
            self.shown = float(np.clip(self.shown + elapsed, newest - 2 * BEHIND, newest))

    def frame(self) -> dict[str, Any]:
        """The row of this instant: mm, kPa."""
        row = next((r for r in reversed(self.rows) if r[0] <= self.shown), None)
        if row is None:
            still = [[0.0, 0.0]] * (self.model.n + 2)
            return {"t": 0.0, "body": still, "message": "no row has come yet", "measured": None,
                    "kpa": [0.0] * self.chambers, "command": [0.0] * self.chambers, "force": [0, 0]}
        m, phi = self.model, np.array([row[k] for k in self.angles])
        joints = mechanics_of(m).nodes(phi)
        value = dict(zip(self.columns, row, strict=True))
        vented = f"VENTED, {self.fault or 'by a fault'}" if value.get("vented") else "in control"
        if not value.get("vented") and row[0] >= self.since:
            vented = f"in control, but {self.fault}"
        message = f"{vented}; {self.wanted(value)}; a period's work took {value['work_us']:.0f} us{self.design}"
        return {
            "t": round(row[0], 6), "body": np.nan_to_num(np.round(1e3 * joints, 3)).tolist(), "message": message,
            "measured": None, "force": [0, 0],
            "kpa": [round(float(np.nan_to_num(1e-3 * row[k])), 4) for k in self.named("pressure")],
            "command": [round(float(np.nan_to_num(1e-3 * row[k])), 4) for k in self.named("command")],
            "touch": self.touching(value),
        }

    def wanted(self, value: dict[str, float]) -> str:
        """Target and error of each output that the loop brings to its place."""
        said = []
        for name in (c.removeprefix("target_") for c in self.columns if c.startswith("target_")):
            output, unit = name.rpartition("_")[::2]
            size, shown = (1e3, "mm") if unit == "m" else (np.rad2deg(1.0), "deg")
            target, error = size * value[f"target_{name}"], size * value[f"error_{name}"]
            said.append(f"{output.replace('_', ' ')} target {target:.2f} {shown}, error {error:.2f} {shown}".lstrip())
        return "; ".join(said)

    def touching(self, value: dict[str, float]) -> list[float] | None:
        """Return place [mm] and size [N] of the single force that explains the torques; None if there is none."""
        n = self.model.n
        angle, torque, sd = (np.array([value.get(name.format(i + 1), np.nan) for i in range(n)])
                             for name in ("phi_{}_rad", "torque_{}_nm", "torque_sd_{}_nm"))
        if not self.touch or not np.isfinite(torque + sd).all() or abs(torque).max() < self.touch:
            return None
        push = locate(self.model, angle, torque, np.diag(sd**2 + (self.touch / DOUBT) ** 2))
        return [round(float(v), 4) for v in (*1e3 * push.position, *push.force)]
