"""The virtual actuators as a laboratory knows them: links fitted to free pulses, and recordings laid bare."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pliant.estimation import Noise
from pliant.model import load_model
from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed import bundled_recording, generate

MODELS = Path(__file__).parents[1] / "examples" / "state"  # made by identify.py there
LATENCY = 0.004351  # s, of the shape against the pressure of actuator a, fitted with the rest
NOISE = Noise(angle=9.5e-4, torque=5e-7, random_walk=1e-3, motion_growth=8.0, initial_disturbance=0.01)  # tuned on a
FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)


def fitted(name):
    """Five joints at mid-segment, so that stiffness keeps its physical size; with memory."""
    return load_model(MODELS / f"model_{name}.json")


def laid_bare(recording):
    return body_of_fibre(recording, FIBRE)[0]


@cache
def free(name="pulse_119"):
    """A bundled recording of actuator a without contact."""
    return laid_bare(bundled_recording(name))


@cache
def made(scenario, name):
    """Recording and truth of a scenario."""
    done = generate(scenario, name, 1)
    return laid_bare(done.recording), done.truth
