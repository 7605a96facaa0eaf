"""Registry of controllers: built-in ones and those of other packages (entry points ``pliant.controllers``)."""

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
    """Return all known controllers by name."""
    return offered(GROUP, BUILT_IN, ControllerKind)


def controller_kind(name: str) -> ControllerKind:
    """Return the controller with the given name; raise InputError, which lists the known names, for another one."""
    return chosen(GROUP, BUILT_IN, ControllerKind, name)
