"""Generate the bundled film: ``python -m pliant.testbed.camera.bundle``.

It writes a film of actuator "a" under three pulses, seen by a camera slightly from the side; a log of the pressure with
its own clock; and the track that `pliant track` computes from the film.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pliant.files import write_text
from pliant.testbed.bundle import FOLDER
from pliant.testbed.camera.film import Shutter, film
from pliant.testbed.camera.scene import Look, View
from pliant.testbed.scenarios import Command, Scenario

SEED = 1
LEVELS, WIDTH, REST, BEFORE = (60e3, 180e3, 119e3), 1.2, 1.2, 0.5  # Pa, s
LOG_STARTS, LOG_RATE = -0.35, 100.0  # s on the film's clock, Hz
EDGES = [BEFORE + k * (WIDTH + REST) for k in range(len(LEVELS))]
END = EDGES[-1] + WIDTH + REST
VIEW = View(aside=0.15, tilt=0.08, coefficients=(-0.12, 0.03, 0.0, 0.0, 0.0)).scaled(640)
LOOK = Look(clutter=25, light=0.3, gloss=12.0, hand=(END - 0.6, END - 0.3))
SHUTTER = Shutter(exposure=2e-3, defocus=0.5, noise=2.0)


def case() -> Scenario:
    """Return the scenario of the bundled film: three pulses of pressure."""
    steps = tuple(point for t, level in zip(EDGES, LEVELS, strict=True) for point in ((t, level), (t + WIDTH, 0.0)))
    return Scenario("filmed_pulses", "pulses of 60, 180 and 119 kPa", END, Command("steps", steps))


def main(folder: Path = FOLDER) -> None:
    """Write the film, the pressure log and the body's shape tracked in the film to `folder`."""
    from pliant.recording import append_history, write
    from pliant.video import track_video

    folder.mkdir(parents=True, exist_ok=True)
    filmed = film(case(), folder / "film.mp4", seed=SEED, view=VIEW, look=LOOK, shutter=SHUTTER)
    log_times = np.arange(0.0, filmed.pressure_time[-1] - LOG_STARTS, 1.0 / LOG_RATE)
    kpa = np.interp(log_times + LOG_STARTS, filmed.pressure_time, 1e-3 * filmed.pressure)
    rows = "".join(f"{1e3 * t:.0f},{p:.2f}\n" for t, p in zip(log_times, kpa, strict=True))
    write_text(folder / "film_log.csv", f"t_ms,p_kpa\n{rows}")
    tracked = track_video(folder / "film.mp4", camera())
    rounded = tracked["position"].copy(data=tracked["position"].to_numpy().round(6))
    write(append_history(tracked.assign(position=rounded), "positions rounded to 1 um"), folder / "film.csv")


def camera() -> dict[str, Any]:
    """Return the bundled film's ``[camera]`` table for the mapping that describes how to read the film, with pixels
    rounded to a hundredth.
    """
    table = VIEW.table()
    table["plane"]["pixels"] = np.round(table["plane"]["pixels"], 2).tolist()
    return {**table, "exposure_ms": 1e3 * SHUTTER.exposure, "readout_ms": 0.0}


if __name__ == "__main__":
    main()
