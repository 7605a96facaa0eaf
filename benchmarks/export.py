"""Measure exported models in one run: equality, times and sizes; `environments.py` measures the environments.

    python benchmarks/export.py -o benchmarks/results/export.json

The C code of `pliant export --to c99` is compared with pliant's compiled time integration, with hand-written C
(`BY_HAND`: the same linearly implicit step, as loops over arrays), and with MuJoCo running the exported MJCF. Results
that need a missing program are null.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import pliant
from pliant.actuators import chen2018
from pliant.exporters.c99 import code
from pliant.exporters.mjcf import mjcf
from pliant.exporters.provenance import Provenance
from pliant.model import Memory, load_model
from pliant.simulation import Stepper, simulate

STEP, STEPS = 1e-3, 100_000
MODELS = Path(__file__).parents[1] / "examples" / "state"

BY_HAND = r"""
#include <math.h>
#define N 5
static const double l = LENGTH, m = MASS, K = STIFF, D = DAMP, h = 1e-3;
void by_hand(double *phi, double *w, double torque, long steps)
{
    double B[N][N], A[N][N], S[N][N], c[N], s[N], r[N], a[N], t[N];
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) B[i][j] = m * l * l * (N - (i > j ? i : j));
    for (long step = 0; step < steps; step++) {
        for (int i = 0; i < N; i++) { c[i] = cos(phi[i] + 0.5 * h * w[i]); s[i] = sin(phi[i] + 0.5 * h * w[i]); }
        for (int i = 0; i < N; i++) {
            double q = phi[i] - (i ? phi[i - 1] : 0), dq = w[i] - (i ? w[i - 1] : 0);
            t[i] = torque - K * (q + 0.5 * h * dq) - D * dq;
        }
        for (int i = 0; i < N; i++) {
            r[i] = h * (t[i] - (i + 1 < N ? t[i + 1] : 0));
            for (int j = 0; j <= i; j++) {
                A[i][j] = B[i][j] * (c[i] * c[j] + s[i] * s[j]);
                S[i][j] = B[i][j] * (s[i] * c[j] - c[i] * s[j]);
            }
        }
        double g = 0.5 * h * D + 0.25 * h * h * K;
        for (int i = 0; i < N; i++) { A[i][i] += g; if (i) { A[i - 1][i - 1] += g; A[i][i - 1] -= g; } }
        for (int j = 0; j < N; j++) {
            for (int k = 0; k < j; k++) A[j][j] -= A[j][k] * A[j][k] * A[k][k];
            for (int i = j + 1; i < N; i++) {
                for (int k = 0; k < j; k++) A[i][j] -= A[i][k] * A[j][k] * A[k][k];
                A[i][j] /= A[j][j];
            }
        }
        for (int pass = 0; pass < 2; pass++) {
            for (int i = 0; i < N; i++) { double v = pass ? w[i] + 0.5 * a[i] : w[i]; t[i] = h * v * v; }
            for (int i = 0; i < N; i++) a[i] = r[i];
            for (int i = 0; i < N; i++) for (int j = 0; j < i; j++) { a[i] -= S[i][j] * t[j]; a[j] += S[i][j] * t[i]; }
            for (int i = 0; i < N; i++) for (int k = 0; k < i; k++) a[i] -= A[i][k] * a[k];
            for (int i = N - 1; i >= 0; i--) {
                a[i] /= A[i][i];
                for (int k = i + 1; k < N; k++) a[i] -= A[k][i] * a[k];
            }
        }
        for (int i = 0; i < N; i++) { phi[i] += h * (w[i] + 0.5 * a[i]); w[i] += a[i]; }
    }
}
"""
MARCH = """
void many(arm_state *s, const arm_parameters *p, double pressure, long steps)
{
    double u[ARM_CHAMBERS] = {pressure};
    for (long k = 0; k < steps; k++) arm_step(s, p, u);
}
"""


def kinds():
    body = load_model(MODELS / "model_a.json")
    return {"paper": chen2018.model(), "softening": body.with_(memory=Memory()), "memory": body}


def compiled(text, folder, name):
    source = folder / f"{name}.c"
    source.write_text(text, encoding="utf-8")
    command = ["cc", "-std=c99", "-O2", "-fPIC", "-shared", str(source), "-o", str(folder / f"{name}.so"), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(folder / f"{name}.so"))


def best(run, repeats=5):
    """Return the least of a few times, s."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


def arm_of(model, folder, name):
    origin = Provenance(model, "c99", "benchmark")
    made = code(model, origin, time_step=STEP, precision="double", pressure=0.0, prefix="arm")
    (folder / "arm.h").write_text(made.header, encoding="utf-8")
    return compiled(made.source + MARCH, folder, name)


def equality(model, library, rng):
    """Return the largest difference of a link's angle from `Stepper` over all steps, rad."""
    s, p = (ctypes.c_double * 65536)(), (ctypes.c_double * 65536)()
    library.arm_defaults(p)
    library.arm_init(s)
    stepper, worst = Stepper(model, STEP), 0.0
    for level in np.repeat(rng.uniform(0, 1e5, STEPS // 200), 200):
        library.arm_step(s, p, (ctypes.c_double * 1)(level))
        stepper.step(level)
        worst = max(worst, float(np.abs(np.array(s[: model.n]) - stepper.angle).max()))
    return worst


def times(model, library):
    """Return nanoseconds per step of the C code and of pliant's time integration with output at the end alone."""
    s, p = (ctypes.c_double * 65536)(), (ctypes.c_double * 65536)()
    library.arm_defaults(p)
    library.arm_init(s)
    library.many.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_long]
    pulse, ends = pliant.Pulse(5e4), np.array([0.0, STEPS * STEP])
    simulate(model, pulse, times=ends, time_step=STEP)
    return {
        "c99_ns": 1e9 / STEPS * best(lambda: library.many(s, p, 5e4, STEPS)),
        "pliant_ns": 1e9 / STEPS * best(lambda: simulate(model, pulse, times=ends, time_step=STEP)),
    }


def by_hand(folder):
    """Return nanoseconds per step of hand-written C for the paper's model, and its final difference from pliant, rad.
    """
    model = chen2018.model()
    words = {"LENGTH": model.link_length[0], "MASS": model.link_mass[0], "STIFF": model.stiffness[0],
             "DAMP": model.damping[0]}  # fmt: skip
    text = BY_HAND
    for word, value in words.items():
        text = text.replace(f" {word}", f" {float(value)!r}")
    library = compiled(text, folder, "hand")
    phi, w = (ctypes.c_double * 5)(), (ctypes.c_double * 5)()
    torque = ctypes.c_double(float(model.torque_at(5e4)))
    library.by_hand(phi, w, torque, ctypes.c_long(200))
    stepper = Stepper(model, STEP)
    for _ in range(200):
        stepper.step(5e4)
    apart = float(np.abs(np.array(phi[:]) - stepper.angle).max())
    return 1e9 / STEPS * best(lambda: library.by_hand(phi, w, torque, ctypes.c_long(STEPS))), apart


def mujoco_ns(model):
    """Return the nanoseconds that MuJoCo takes for a step of 1 ms of the exported MJCF, without contact detection."""
    if find_spec("mujoco") is None:
        return None
    import mujoco

    m = mujoco.MjModel.from_xml_string(mjcf(model, Provenance(model, "mjcf", "benchmark"), time_step=STEP))
    m.geom_contype[:], m.geom_conaffinity[:] = 0, 0
    d = mujoco.MjData(m)
    d.ctrl[:] = 5e4
    return 1e5 * best(lambda: mujoco.mj_step(m, d, 10000))


def flash(folder):
    """Return bytes of code, state and parameters of the paper's model in single precision on a Cortex-M4."""
    if shutil.which("arm-none-eabi-gcc") is None:
        return None
    model = chen2018.model()
    origin = Provenance(model, "c99", "benchmark")
    made = code(model, origin, time_step=STEP, precision="single", pressure=0.0, prefix="arm")
    (folder / "arm.h").write_text(made.header, encoding="utf-8")
    (folder / "chip.c").write_text(
        made.source + "arm_state ram_state; arm_parameters ram_parameters;", encoding="utf-8"
    )
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-Os", "-std=c99"]
    subprocess.run(
        ["arm-none-eabi-gcc", *core, "-c", str(folder / "chip.c"), "-o", str(folder / "chip.o")], check=True
    )
    told = subprocess.run(["arm-none-eabi-size", str(folder / "chip.o")], capture_output=True, text=True, check=True)
    text, _, bss = (int(v) for v in told.stdout.splitlines()[1].split()[:3])
    return {"flash_bytes": text, "ram_bytes": bss}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    if shutil.which("cc") is None:
        sys.exit("no C compiler (cc) on the path: there is nothing to measure")
    rng, told = np.random.default_rng(1), {"models": {}}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, model in kinds().items():
            library = arm_of(model, folder, name)
            row = {"largest_difference_rad": equality(model, library, rng), **times(model, library)}
            row["c99_over_pliant"] = row["c99_ns"] / row["pliant_ns"]
            told["models"][name] = row
        told["by_hand_ns"], told["by_hand_difference_rad"] = by_hand(folder)
        told["controller"] = flash(folder)
    told["mujoco_ns"] = mujoco_ns(chen2018.model())
    print(json.dumps(told, indent=1))
    if asked.output:
        asked.output.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
