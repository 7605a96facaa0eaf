"""Registry of controllers, built-in ones and those of other packages (entry-point group ``pliant.controllers``)."""

from __future__ import annotations

from pliant.control.contract import ControllerKind
from pliant.plugins import chosen, offered

GROUP = "pliant.controllers"
BUILT_IN = {
    "lqr": "pliant.control.lqr:CONTROLLER",
    "mpc": "pliant.control.mpc:CONTROLLER",
    "pid": "pliant.control.pid:CONTROLLER",
}


def controllers() -> dict[str, ControllerKind]:
    """Return all known controllers, built-in or from installed packages, as {name: controller type}."""
    return offered(GROUP, BUILT_IN, ControllerKind)


def controller_kind(name: str) -> ControllerKind:
    """Return the controller type with the given name; raise InputError with a list of the known
    names if there is none.
    """
    return chosen(GROUP, BUILT_IN, ControllerKind, name)
