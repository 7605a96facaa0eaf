"""Measure how accurately and how fast films are tracked under each disturbance, and how well models from films predict.

    python benchmarks/camera.py                  # everything, about ten minutes on one core
    python benchmarks/camera.py noise clutter    # only these disturbances
    python benchmarks/camera.py model            # the model from films compared with the model from the fibre

A virtual camera makes the films: 1920 x 1080 pixels (640 x 360 for the model), 60 frames a second, MPEG-4. The
reference is the shape of the simulated rod. Times are processor times of one thread.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from pliant.errors import InputError
from pliant.recording import make_recording, write
from pliant.study import demo_study, load_study, run_study
from pliant.testbed.camera import Filmed, Look, Shutter, View, film
from pliant.testbed.scenarios import Scenario, pulse
from pliant.video import Tracking, track_video
from pliant.video.follow import Follower
from pliant.video.reel import open_reel
from pliant.video.silhouette import Stillness, base_of
from pliant.video.surroundings import surroundings

VIEW, LOOK, SHUTTER = View(), Look(), Shutter()
MARKED = replace(LOOK, half_width=(0.0085, 0.0085), mark_places=(0.06, 0.3, 0.54, 0.78, 0.94))
DOTS, ARUCO = Tracking("dots", colour="#c8283c"), Tracking("aruco")
CASES: dict[str, tuple[View, Look, Shutter, Tracking]] = {
    "none": (VIEW, LOOK, SHUTTER, Tracking()),
    "view from the side": (replace(VIEW, aside=0.35, tilt=0.15), LOOK, SHUTTER, Tracking()),
    "lens": (replace(VIEW, coefficients=(-0.25, 0.08, 1e-3, -5e-4, 0.0)), LOOK, SHUTTER, Tracking()),
    "motion blur, open 4 ms": (VIEW, LOOK, replace(SHUTTER, exposure=4e-3), Tracking()),
    "motion blur, open 8 ms": (VIEW, LOOK, replace(SHUTTER, exposure=8e-3), Tracking()),
    "focus, sd 3 px": (VIEW, LOOK, replace(SHUTTER, defocus=3.0), Tracking()),
    "noise, 12 levels": (VIEW, LOOK, replace(SHUTTER, noise=12.0), Tracking()),
    "light falls by 60 %, gloss": (VIEW, replace(LOOK, light=0.6, gloss=25.0), SHUTTER, Tracking()),
    "compression, JPEG 12": (VIEW, LOOK, replace(SHUTTER, quality=12), Tracking()),
    "clutter, 140 things": (VIEW, replace(LOOK, clutter=140), SHUTTER, Tracking()),
    "a hand passes": (VIEW, replace(LOOK, hand=(0.85, 1.05)), SHUTTER, Tracking()),
    "frames lost and doubled": (VIEW, LOOK, replace(SHUTTER, dropped=(20, 21, 50), doubled=(30, 57)), Tracking()),
    "all at once": (
        replace(VIEW, aside=0.2, tilt=0.1, coefficients=(-0.2, 0.05, 0.0, 0.0, 0.0)),
        replace(LOOK, clutter=120, light=0.4, gloss=20.0, hand=(0.9, 1.1)),
        replace(SHUTTER, exposure=4e-3, defocus=1.0, noise=6.0, quality=40, dropped=(20, 21), doubled=(40,)),
        Tracking(),
    ),
    "dots": (VIEW, replace(MARKED, marks="dots"), SHUTTER, DOTS),
    "dots, noise and clutter": (VIEW, replace(MARKED, marks="dots", clutter=60), replace(SHUTTER, noise=6.0), DOTS),
    "ArUco markers": (VIEW, replace(MARKED, marks="aruco"), SHUTTER, ARUCO),
    "ArUco, noise": (VIEW, replace(MARKED, marks="aruco"), replace(SHUTTER, noise=4.0), ARUCO),
}  # fmt: skip
MOTION = Scenario("filmed", "180 kPa for half a second", 1.1, pulse(180e3, 0.5, start=0.15))


def at_shares(lines: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return points (T, S, 2) at given fractions of the length of lines (T, N, 2)."""
    made = []
    for line in lines:
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        made.append(CubicSpline(along, line)(shares * along[-1]))
    return np.array(made)


def curvature(points: np.ndarray) -> np.ndarray:
    """Return curvature (T, S - 4) [1/m] from positions (T, S, 2) at equal arc lengths."""
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points[0], axis=0), axis=1)))
    line = CubicSpline(s, points, axis=1)
    d, dd = line(s[2:-2], 1), line(s[2:-2], 2)
    return (d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]) / np.linalg.norm(d, axis=2) ** 3


def judged(path: Path, view: View, look: Look, shutter: Shutter, how: Tracking) -> str:
    """Return one row of the table: errors in pixels, bias of the curvature, number of gaps."""
    truth = film(MOTION, path, view=view, look=look, shutter=shutter)
    camera = {**view.table(), "exposure_ms": 1e3 * shutter.exposure, "readout_ms": 0.0}
    try:
        ds = track_video(path, camera, how)
    except InputError as error:
        return f"refused: {error}"
    late = float(np.abs(ds["time"].to_numpy() - truth.truth["time"].to_numpy()).max())
    place = ds["position"].to_numpy()[..., :2]
    body = how.method == "silhouette"
    shares = np.linspace(0.0, 1.0, place.shape[1]) if body else np.array(look.mark_places)
    true = at_shares(truth.centreline(), shares)
    seen = np.isfinite(place).all(axis=(1, 2))
    apart = np.linalg.norm(view.pixels(place[seen]) - view.pixels(true[seen]), axis=2)
    rms = np.sqrt(np.mean(apart**2, axis=0))
    k, k_true = (curvature(p[seen]) for p in (place, true)) if body else (np.ones(1), np.ones(1))
    bias = f"{100 * ((k * k_true).sum() / (k_true**2).sum() - 1):+8.2f}" if body else f"{'':8}"
    pixels = f"{np.sqrt(np.mean(rms**2)):8.3f} {apart.max():8.2f} {rms[-1]:8.2f}"
    return f"{pixels} {bias} {int((~seen).sum()):6d} {1e3 * late:9.4f}"


def flow(path: Path) -> None:
    """Track points of the rest shape by optical flow alone (Lucas-Kanade with pyramids)."""
    view = VIEW
    look, shutter = replace(LOOK, marks="dots", clutter=60), replace(SHUTTER, noise=6.0)
    truth = film(MOTION, path, view=view, look=look, shutter=shutter)
    true = view.pixels(at_shares(truth.centreline(), np.linspace(0.1, 0.95, 18)))
    points, before, errors = true[0][:, None].astype(np.float32), None, []
    for k, (_, picture) in enumerate(open_reel(path).frames()):
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        if before is not None:
            points, _, _ = cv2.calcOpticalFlowPyrLK(before, grey, points, None, winSize=(41, 41), maxLevel=4)
        before = grey
        errors.append(np.linalg.norm(points[:, 0] - true[k], axis=1))
    e = np.array(errors)
    print(f"optical flow alone: rms {np.sqrt((e**2).mean()):.1f} px, after {len(e)} frames {e[-1].mean():.1f} px")


def speed(path: Path) -> None:
    """Measure the tracked frames per second of a silhouette, and the time of decoding separately."""
    film(MOTION, path, view=VIEW, look=replace(LOOK, clutter=60), shutter=replace(SHUTTER, noise=4.0))
    reel = open_reel(path)
    began = time.process_time()
    around = surroundings(reel)
    base = base_of(reel, around)
    learnt = time.process_time() - began
    best = []
    for _ in range(3):
        follow, still, spent, count = Follower(around, base), Stillness(around, reel), 0.0, 0
        began = time.process_time()
        for _, picture in reel.frames():
            here = time.process_time()
            still(picture)
            follow(picture)
            spent += time.process_time() - here
            count += 1
        best.append((spent / count, (time.process_time() - began - spent) / count))
    ours, decode = min(best)
    print(f"following 1080p, one core: {1e3 * ours:.1f} ms a frame ({1 / ours:.0f} a second), decoding "
          f"{1e3 * decode:.1f} ms beside it ({1 / (ours + decode):.0f} a second together); "
          f"learning the scene once: {learnt:.1f} s")
    print(f"memory at most, all of this program: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


def model(folder: Path) -> None:
    """Fit models to 60 and 180 kPa from films and from the fibre, and predict 119 kPa; the motions are the same."""
    fibre = load_study(demo_study())
    fits = {"softening": fibre.fits["softening"].model_copy(update={"starts": 1, "held_out": ["pulse_119"]})}
    names = ("pulse_60", "pulse_180", "pulse_119")
    fibre = fibre.model_copy(update={"fits": fits, "model_selection": None})
    view = replace(VIEW, aside=0.15, tilt=0.08).scaled(640)
    look, shutter = replace(LOOK, clutter=40, light=0.3), replace(SHUTTER, exposure=2e-3, noise=4.0)
    entries = {}
    for name in names:
        made: Filmed = film(name, folder / "f.mp4", view=view, look=look, shutter=shutter)
        camera = {**view.table(), "exposure_ms": 2.0, "readout_ms": 0.0}
        seen = track_video(folder / "f.mp4", camera)
        seen = make_recording(
            seen["time"], seen["position"], station=seen["station"].values.tolist(), arc_length=seen["arc_length"],
            pressure=made.pressure, pressure_time=made.pressure_time,
        )  # fmt: skip
        write(seen, folder / f"{name}.nc")
        entries[name] = fibre.recordings[name].model_copy(update={"file": str(folder / f"{name}.nc")})
    alignment = fibre.alignment.model_copy(update={"options": {"base": "base", "tangent": "+y"}})
    reduction = fibre.reduction.model_copy(update={"recording": "pulse_180"})
    changes = {"recordings": entries, "fibre": None, "alignment": alignment, "reduction": reduction}
    filmed = fibre.model_copy(update=changes)
    held_out = {}
    for what, study in (("fibre", fibre), ("film", filmed)):
        record = run_study(study, folder / what).to_dict()["records"]["pulse_119"]
        held_out[what] = record["rmse_mm"]
        print(f"model from the {what}: held-out 119 kPa {record['rmse_mm']:.3f} mm RMSE, "
              f"{record['rmse_percent_of_travel']:.2f} % of travel")
    print(f"ratio film / fibre: {held_out['film'] / held_out['fibre']:.2f} (target 1.5)")


def main(wanted: list[str]) -> None:
    """Print the table, the speed and the models."""
    cv2.setNumThreads(1)
    chosen = [name for name in CASES if not wanted or any(w in name for w in wanted)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.mp4"
        if chosen:
            heads = ("rms px", "most px", "tip rms", "bend %")
            print(f"{'disturbance alone':28} {' '.join(f'{h:>8}' for h in heads)} {'gaps':>6} {'time ms':>9}")
        for name in chosen:
            print(f"{name:28} {judged(path, *CASES[name])}", flush=True)
        for name, job in (("flow", flow), ("speed", speed)):
            if not wanted or name in wanted:
                job(path)
        if not wanted or "model" in wanted:
            model(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
