"""Virtual laboratory: a simulated actuator with valve and fibre sensor, whose exact motion is known.

The rod is a planar discrete elastic rod with Cartesian nodes and implicit steps of 0.25 ms. An explicit Cosserat code
would have to resolve the stretch wave of the inextensible layer: 222 m/s over elements of 1.7 mm allow a step of at
most 7.7 us.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pliant.testbed.bundle import BUNDLED, bundled_recording
    from pliant.testbed.family import Member, family_member
    from pliant.testbed.laboratory import Laboratory, generate, generate_file, generate_set
    from pliant.testbed.scenarios import SCENARIOS

__all__ = [
    "BUNDLED", "SCENARIOS", "Laboratory", "Member", "bundled_recording", "family_member", "generate", "generate_file",
    "generate_set",
]

_PAGE = {
    "bundle": ("BUNDLED", "bundled_recording"), "scenarios": ("SCENARIOS",), "family": ("Member", "family_member"),
    "laboratory": ("Laboratory", "generate", "generate_file", "generate_set"),
}
_HOME = {name: module for module, names in _PAGE.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name of the package on its first use."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"pliant.testbed.{_HOME[name]}"), name)
