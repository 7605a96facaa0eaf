"""Time integration of the rod: implicit steps under pressure, tip loads and contact."""

from pliant.testbed.stepping.simulate import RodMotion, settle, simulate

__all__ = ["RodMotion", "settle", "simulate"]
