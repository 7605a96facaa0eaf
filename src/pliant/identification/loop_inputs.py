"""Arguments of the compiled simulation of a fit, with derivatives (`Numbers`) and without (`ForwardProblem`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.equations.poses import Settling
from pliant.equations.symbols import Joints, MemoryLaw
from pliant.model import Model
from pliant.simulation.drive import Drive

Array = np.ndarray
APART = ("h", "torque", "load", "chambers", "base")  # entries of `Numbers` that most forward problems of a fit share


class Numbers(NamedTuple):
    """All quantities of one simulated experiment that may depend on fitted parameters. They may therefore carry
    derivatives with respect to these parameters.
    """

    held: Any  # (n,) rad, absolute angles of the first rows
    held_base: Any  # rad
    phi: Any  # (n,) rad, at the start of the motion
    rate: Any  # (n,) rad/s, of phi at the start of the motion
    h: Any  # (steps,) s
    torque: Any  # (steps, C) N m, of the chambers; one more column for a hand that lets go
    gain: Any  # (C, n) factor on that torque at each joint
    chambers: Any  # (C, k) constants on which the torques depend, one row for each chamber (`row_of`)
    torque_before: Any  # (n,) N m, under which the chain rests at the start
    load: Any  # (steps, n, 2) N m, of known forces; no rows where there are none
    base: Any  # (steps, 5), in space (steps, 6), motion of the base, see `equations.base`; no rows at rest
    load_before: Any  # (n, 2) N m, under which the chain rests at the start; (n + 1, 4) of a body that lengthens
    body: Any  # `Mechanics.body`
    joints: Joints
    memory: MemoryLaw
    along: Any  # (S,) m
    across: Any  # (S,) m
    aside: Any  # (S,) m
    shift: Any  # (2,), (3,) in space, m
    reference: Any  # rad
    sensor_lag: Any  # (S,) s, of the stations' sensors; no entries where none lags
    length: Any  # (n,) m, of the links
    base_length: Any  # m
    share: Any  # (n + 1, S) fraction of each link that lies in each extensible segment


class ForwardProblem(NamedTuple):
    """Everything that is needed to simulate one experiment of a fit: its `Numbers`, output times, model and points."""

    numbers: Numbers
    keep: Array  # (steps,) row of the output after the step, negative: none
    still: int  # rows before the motion begins
    carrier: Array  # (S,)
    model: Model
    pressure: Array  # (T, C) Pa, behind the valves
    from_rest: bool  # whether the start is the equilibrium under `torque_before`
    pulled: bool = False  # whether a hand pulled the body to its pose from its unloaded shape
    drive: Drive | None = None  # steps and torques of a body that is not let go
    between: tuple[Array, Array] | None = None  # with sensor lag: times of the rows, and the frames' indices in them
    first_seen: Array | None = None  # (S, 2) m, first positions of the markers, which are attached there at the start
    poses: bool = False  # whether each row is a settled pose, without a motion between them
    settled: list[Settling] | None = None  # of such a recording: its equilibria, once they are computed
    oriented: Array = np.zeros(0, dtype=int)  # stations whose link frames are observed: see `observation`


def in_one_row(numbers: Numbers) -> Array:
    """Flatten `numbers` to one vector, arrays first, then scalars.
    Steps, torques, loads, chambers and base (`APART`) are left out.
    """
    arrays: list[Array] = []
    alone: list[Any] = []
    for e in leaves(numbers):
        if isinstance(e, Array):
            arrays.append(e.ravel())
        else:
            alone.append(e)
    return np.concatenate([*arrays, np.array(alone)])


def from_one_row(row: Array, like: Numbers) -> Numbers:
    """Rebuild `Numbers` from the vector that `in_one_row` made.
    Array shapes and the entries of `APART` are copied from `like`.

    A matrix `row` (N, W) gives arrays with a last axis of length W.
    """
    single = row[sum(e.size for e in leaves(like) if isinstance(e, Array)) :]
    alone = iter(single.tolist() if row.ndim == 1 else single)
    first = 0

    def taken(entry: Any) -> Any:
        nonlocal first
        if isinstance(entry, tuple):
            return type(entry)(*map(taken, entry))
        if not isinstance(entry, Array):
            return next(alone)
        part, first = row[first : first + entry.size], first + entry.size
        return part if entry.ndim == 1 else part.reshape(*entry.shape, *row.shape[1:])

    return Numbers(*(e if n in APART else taken(e) for n, e in zip(Numbers._fields, like, strict=True)))


def leaves(numbers: Numbers) -> list[Any]:
    """Return the arrays and scalars of `numbers` as a flat list, without the entries of `APART`."""
    flat: list[Any] = []
    for name, entry in zip(Numbers._fields, numbers, strict=True):
        if name not in APART:
            flat.extend(entry if isinstance(entry, tuple) else (entry,))
    return flat
