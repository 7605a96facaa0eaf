"""The C of a model, compiled and called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pliant.exporters.c99 import code
from pliant.exporters.provenance import Provenance
from pliant.model import Model

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
COMPILER = shutil.which("cc")
ROOM = 65536  # numbers; more than any state or struct of parameters here


LIBRARIES: dict[tuple[str, str], Path] = {}  # by header and source: a text is compiled once, it holds no state


def compiled(folder: Path) -> Path:
    """The library of the C in a folder, without a warning."""
    library = folder / "arm.so"
    command = [str(COMPILER), *STRICT, "-O2", "-fPIC", "-shared", str(folder / "arm.c"), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return library


class Arm:
    """A compiled model: its state and parameters, and its functions."""

    def __init__(self, model: Model, folder: Path, *, time_step: float = 1e-3, precision: str = "double") -> None:
        if COMPILER is None:
            pytest.skip("no C compiler (cc) is on the path: the C is not compiled")
        origin = Provenance(model, "c99", "test")
        made = code(model, origin, time_step=time_step, precision=precision, pressure=0.0, prefix="arm")
        (folder / "arm.h").write_text(made.header, encoding="utf-8")
        (folder / "arm.c").write_text(made.source, encoding="utf-8")
        text = (made.header, made.source)
        if text not in LIBRARIES:
            LIBRARIES[text] = compiled(folder)
        self.library, self.model = ctypes.CDLL(str(LIBRARIES[text])), model
        self.kind = ctypes.c_float if precision == "single" else ctypes.c_double
        self.state, self.parameters = (self.kind * ROOM)(), (self.kind * ROOM)()
        self.library.arm_defaults(self.parameters)
        self.library.arm_init(self.state)

    def step(self, *pressure: float) -> int:
        """One step under commanded pressures [Pa]."""
        command = (self.kind * len(pressure))(*pressure)
        return self.library.arm_step(self.state, self.parameters, command)

    @property
    def angle(self) -> np.ndarray:
        """Absolute link angles (n,), in space the coordinates (N,), rad."""
        return np.array(self.state[: self.model.size])

    @property
    def rate(self) -> np.ndarray:
        """Their rates (n,), rad/s."""
        return np.array(self.state[self.model.size : 2 * self.model.size])

    def ask(self, what: str, *shapes: tuple[int, ...]) -> list[np.ndarray]:
        """Arrays that a function of the state fills."""
        rooms = [(self.kind * int(np.prod(shape)))() for shape in shapes]
        getattr(self.library, f"arm_{what}")(self.state, self.parameters, *rooms)
        return [np.array(room).reshape(shape) for room, shape in zip(rooms, shapes, strict=True)]
