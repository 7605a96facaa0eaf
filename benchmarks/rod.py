"""Compare the test bed's implicit rod with PyElastica: first frequency and computing time of a released cantilever."""

from __future__ import annotations

import json
import time
from pathlib import Path

import elastica
import numpy as np
from speed.timing import machine

from pliant.testbed.rod import RodParameters
from pliant.testbed.stepping import settle, simulate

LENGTH, MASS, EI = 0.17, 0.069, 1.6067 * 0.034  # m, kg, N m2: the paper's actuator
EXACT = 1.875104**2 / (2 * np.pi * LENGTH**2) * np.sqrt(EI * LENGTH / MASS)  # Hz, clamped and free
PULL = 0.002  # N at the tip, let go at the start
SECONDS = 1.0


def frequency(tip: np.ndarray, dt: float) -> float:
    """Return the frequency of a free vibration, Hz, from a windowed spectrum with zero padding."""
    spectrum = np.abs(np.fft.rfft((tip - tip.mean()) * np.hanning(tip.size), 64 * tip.size))
    return float(np.fft.rfftfreq(64 * tip.size, dt)[np.argmax(spectrum)])


def implicit(elements: int, dt: float = 2.5e-4) -> dict[str, float]:
    """Simulate the test bed's discrete elastic rod, with its inextensible layer."""
    p = RodParameters(elements=elements).uniform(bending_stiffness=EI)
    start = settle(p, (0.0, PULL, 0.0, 0.0))
    steps = np.zeros((round(SECONDS / dt), 4))
    simulate(p, steps[:10], dt, stride=1, start=start)  # compiled
    begin = time.perf_counter()
    tip = simulate(p, steps, dt, stride=1, start=start).position[:, -1, 0]
    return {"step_s": dt, "wall_s": time.perf_counter() - begin, "frequency_hz": frequency(tip, dt)}


class Cantilever(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.CallBacks
):
    """A clamped Cosserat rod."""


class Tip(elastica.CallBackBaseClass):
    """Stores the deflection of the tip."""

    def __init__(self, every: int, keep: list[float]) -> None:
        super().__init__()
        self.every, self.keep = every, keep

    def make_callback(self, system, time, current_step) -> None:  # noqa: ARG002 - the signature is PyElastica's
        if current_step % self.every == 0:
            self.keep.append(float(system.position_collection[0, -1]))


def cosserat(elements: int, axial: float) -> dict[str, float]:
    """Simulate PyElastica's explicit rod with a given axial stiffness, N, at 0.5 of the stretch wave's stability limit.
    """
    radius = np.sqrt(4 * EI / axial)  # a circle with both stiffnesses
    area = np.pi * radius**2
    world, keep = Cantilever(), []
    rod = elastica.CosseratRod.straight_rod(
        elements, np.zeros(3), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), LENGTH, radius,
        MASS / (area * LENGTH), youngs_modulus=axial / area, shear_modulus=axial / area / 3,
    )  # fmt: skip
    s = np.linspace(0.0, LENGTH, elements + 1)
    rod.position_collection[0] = PULL * s**2 * (3 * LENGTH - s) / (6 * EI)  # the static line under the pull
    world.append(rod)
    world.constrain(rod).using(elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    wave = np.sqrt(axial * LENGTH / MASS)
    dt = 0.5 * LENGTH / elements / wave
    steps = int(SECONDS / dt)
    world.collect_diagnostics(rod).using(Tip, every=10, keep=keep)
    world.finalize()
    stepper = elastica.PositionVerlet()
    elastica.integrate(stepper, world, 100 * dt, 100, progress_bar=False)  # compiled
    keep.clear()
    begin = time.perf_counter()
    elastica.integrate(stepper, world, SECONDS, steps, progress_bar=False)
    wall = time.perf_counter() - begin
    tip = np.array(keep)
    if not np.isfinite(tip).all():
        raise FloatingPointError(f"the explicit rod is unstable at a step of {dt:.2e} s")
    return {"step_s": dt, "wall_s": wall, "frequency_hz": frequency(tip, 10 * dt)}


def main() -> None:
    """Print one line per method, and write the table."""
    cases = {
        "pliant, implicit, 50 elements": implicit(50),
        "pliant, implicit, 100 elements": implicit(100),
        "PyElastica, 20 kN, 50 elements": cosserat(50, 2e4),
        "PyElastica, 20 kN, 100 elements": cosserat(100, 2e4),
        "PyElastica, 2 kN, 100 elements": cosserat(100, 2e3),
    }
    best = cases["pliant, implicit, 100 elements"]["wall_s"]
    for name, case in cases.items():
        case["frequency_error_percent"] = 100 * (case["frequency_hz"] / EXACT - 1)
        case["ratio"] = case["wall_s"] / best
        print(f"{name:34} step {1e6 * case['step_s']:7.2f} us, {case['wall_s']:8.3f} s a second of motion "
              f"({case['ratio']:6.1f} x), first frequency {case['frequency_error_percent']:+.2f} %")  # fmt: skip
    path = Path(__file__).parent / "results" / "rod.json"
    path.parent.mkdir(exist_ok=True)
    table = {"machine": machine(), "exact_hz": EXACT, "cases": cases}
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
