"""Export of measured and modelled motion to the formats of other tools: MCAP for viewers, LeRobot for learning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.plain import plain

if TYPE_CHECKING:
    from pliant.validation.outcome import StudyOutcome

TARGETS = {"mcap": ("rosbags", "ros"), "lerobot": ("pyarrow", "lerobot")}  # target -> (library, extra that installs it)


@dataclass(frozen=True, repr=False)
class ExportedResults(Shown):
    """The files that an export of results wrote.

    Attributes
    ----------
    target : str
    path : Path
        The file, or the folder of a LeRobot data set.
    records : tuple of str
    notes : tuple of str
        For LeRobot, the frame rate [Hz] and the frames that were cut or interpolated. For MCAP, the start time of each
        recording [s].
    """

    target: str
    path: Path
    records: tuple[str, ...]
    notes: tuple[str, ...]

    def card(self) -> Card:
        """Return the file, the recordings and the notes for display."""
        return Card(f"Exported to {self.target}: {self.path}", [f"recordings: {', '.join(self.records)}", *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, for JSON."""
        return {**plain(self), "path": str(self.path)}


def export_results(
    results: StudyOutcome | str | Path, target: str, path: str | Path, *, fit: str = "", records: Sequence[str] = (),
    fps: int = 0,
) -> ExportedResults:
    """Write the recordings of a study, and the motion that a fit predicts for them, in the format of another tool.

    Parameters
    ----------
    results : StudyOutcome, str or Path
        From `pliant.run_study`, or the results folder of `pliant run`.
    target : {"mcap", "lerobot"}
        An MCAP file of ROS 2 messages, which Foxglove and Rerun open, or a LeRobot data set, version 3.0.
    path : str or Path
        File to write, ending in ``.mcap``; for LeRobot a folder that does not exist yet.
    fit : str
        Name of the fit whose model is exported. Default: the first fit, which is the study's model.
    records : sequence of str
        Names of the recordings to export. Default: all recordings of that fit.
    fps : int
        Frame rate [Hz] to which all recordings are interpolated, for LeRobot only. Default: the rate of the slowest
        recording.

    Returns
    -------
    ExportedResults
        Path, recordings, and notes on frames that were cut or interpolated.

    Raises
    ------
    InputError
        For an unknown target, fit or recording, a library that is not installed, or a path that cannot be written.

    Examples
    --------
    >>> from pliant.validation.export_results import export_results
    >>> export_results("results/demo", "mcap", "demo.mcap")  # doctest: +SKIP
    """
    if target not in TARGETS:
        raise InputError(f"the target of results must be {' or '.join(TARGETS)}, got {target!r}")
    library, extra = TARGETS[target]
    if find_spec(library) is None:
        raise InputError(f"{target} needs {library}, which is not installed: pip install 'pliant[{extra}]'")
    from pliant.validation.sides import sides_of

    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: the folder {path.parent} does not exist; create it first")
    if isinstance(results, (str, Path)):
        from pliant.validation.store import load_outcome

        results = load_outcome(results)
    sides = sides_of(results, fit, records)
    if target == "mcap":
        from pliant.validation.mcap_file import write_mcap

        if fps:
            raise InputError("fps is an option of lerobot only, as an MCAP file keeps the recorded times: remove fps")
        notes = write_mcap(sides, path)
    else:
        from pliant.validation.lerobot import write_lerobot

        notes = write_lerobot(sides, path, fps)
    return ExportedResults(target, path, tuple(s.name for s in sides.sides), notes)
