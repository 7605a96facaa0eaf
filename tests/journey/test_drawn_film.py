"""Films that OpenCV drew: a body of even curvature in clutter under a drifting exposure; `track`, `new`, `run`."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import invoke

from pliant.study import load_study, run_study

pytestmark = pytest.mark.slow
WIDTH, HEIGHT, PIXELS_PER_MM, RATE = 480, 420, 2.5, 40.0
LENGTH, FREQUENCY, DAMPING = 0.12, 3.0, 0.07  # m, Hz
DRIFT = 0.16  # of the exposure, up and down
LEVELS = (40, 80, 120)  # kPa


def curvature(level: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curvature [1/m] of a ringing body, and the pressure [kPa] that drives it, at these times."""
    fine, w, k, rate, course = np.arange(0.0, times[-1] + 1e-3, 1e-3), 2 * np.pi * FREQUENCY, 0.0, 0.0, []
    pressure = np.where((fine > 0.4) & (fine < 1.4), level, 0.0)
    for p in pressure.tolist():
        course.append(k)
        rate += 1e-3 * (w * w * (0.06 * p - k) - 2 * DAMPING * w * rate)
        k += 1e-3 * rate
    return np.interp(times, fine, course), np.interp(times, fine, pressure)


def clutter(rng: np.random.Generator) -> np.ndarray:
    """A background of soft blotches and 25 discs of any colour."""
    coarse = rng.integers(60, 200, (HEIGHT // 16, WIDTH // 16, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    for _ in range(25):
        place, colour = rng.integers(0, [WIDTH, HEIGHT]).tolist(), rng.integers(0, 255, 3).tolist()
        cv2.circle(picture, place, int(rng.integers(4, 20)), colour, -1)
    return picture


def film(folder: Path, level: int) -> None:
    """Draw a film of one pulse, its exposure drifting, and write the log of the regulator beside it."""
    rng, times = np.random.default_rng(level), np.arange(0.0, 2.4, 1 / RATE)
    behind, s = clutter(np.random.default_rng(1)), np.linspace(0.0, LENGTH, 60)
    out = cv2.VideoWriter(str(folder / f"push_{level}.avi"), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (WIDTH, HEIGHT))
    for t, k in zip(times, curvature(level, times)[0], strict=True):
        turn = 0.5 * k * (s[1:] + s[:-1])
        x, y = (np.append(0.0, np.cumsum(f(turn) * np.diff(s))) for f in (np.sin, np.cos))
        points = np.array([300.0, 60.0]) + 1e3 * PIXELS_PER_MM * np.stack([-x, y], axis=1)
        picture = behind.copy()
        cv2.polylines(picture, [points.astype(np.int32)], False, (225, 225, 215), 30, cv2.LINE_AA)
        bright = picture * (1.0 + DRIFT * np.sin(2 * np.pi * t / 3.2)) + rng.normal(0.0, 3.0, picture.shape)
        out.write(np.clip(bright, 0, 255).astype(np.uint8))
    out.release()
    log = np.arange(0.0, 2.4, 5e-3)
    rows = zip(log, curvature(level, log)[1] + 0.05 * rng.standard_normal(log.size), strict=True)
    text = "t,p_kpa\n" + "".join(f"{t:.3f},{p:.3f}\n" for t, p in rows)
    (folder / f"push_{level}_log.csv").write_text(text, encoding="utf-8")


def test_a_film_in_clutter_under_a_drifting_exposure_ends_in_a_model(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text(f"[camera]\npixels_per_mm = {PIXELS_PER_MM}\n", encoding="utf-8")
    for level in LEVELS:
        film(tmp_path, level)
        tracked = invoke("track", tmp_path / f"push_{level}.avi", "-o", tmp_path / f"push_{level}.nc",
                         "--camera", tmp_path / "camera.toml")  # fmt: skip
        assert tracked.exit_code == 0, tracked.output
    files = [f"--from={tmp_path / f'push_{level}'}{end}" for level in LEVELS for end in (".nc", "_log.csv")]
    drafted = invoke("new", tmp_path / "film.toml", *files, "--mass", 0.05)
    assert drafted.exit_code == 0, drafted.output
    assert not [line for line in drafted.stdout.splitlines() if line.startswith("? ")], drafted.stdout
    held = run_study(load_study(tmp_path / "film.toml")).fits[0].records[-1]
    assert (held.name, held.role) == ("push_80", "held_out")
    assert held.metrics["rmse_percent_of_travel"] < 5.0
    assert held.metrics["frequency_hz"]["modelled"] == pytest.approx(FREQUENCY, rel=0.03)
