"""The time loop: implicit steps of the rod under pressure, tip loads and contact."""

from pliant.testbed.stepping.simulate import Motion, settle, simulate

__all__ = ["Motion", "settle", "simulate"]
