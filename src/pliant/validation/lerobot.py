"""Writer of a LeRobot data set, version 3.0: one episode per recording, with measured state, inputs and model state.

Source: LeRobotDataset v3.0, huggingface.co/docs/lerobot/lerobot-dataset-v3; files are written with pyarrow (extra
``lerobot``).
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.validation.sides import Side, Sides
from pliant.version import __version__

Array = np.ndarray
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
LARGEST_FILE_MB, FILES_PER_CHUNK, LARGEST_VIDEO_MB = 100, 1000, 200
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
COUNTERS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
            "task_index": "int64"}  # columns that every data set of LeRobot has  # fmt: skip


class Episode(NamedTuple):
    """One recording at the frame rate of the data set. Its columns, by name of the feature, are arrays (T,) or (T,
    width) over T frames.
    """

    name: str
    role: str
    columns: dict[str, Array]

    @property
    def length(self) -> int:
        """Return the number of frames."""
        return len(self.columns["timestamp"])


def write_lerobot(sides: Sides, folder: Path, fps: int = 0) -> tuple[str, ...]:
    """Write recordings, and the motion that the model predicts for them, as a LeRobot data set, atomically.

    The features are ``observation.state`` (measured coordinates of the stations [m] or angles [rad]), ``action``
    (inputs, in the units of the model) and ``model.state`` (coordinates of the model), all float32. The task of an
    episode is the name of its recording. The split ``train`` has the training recordings, ``test`` the held-out ones.

    Parameters
    ----------
    sides : Sides
    folder : Path
        Folder to create; it must not exist.
    fps : int
        Frame rate [Hz]; 0 for the rate of the slowest recording, rounded, at least 1.

    Returns
    -------
    tuple of str
        The frame rate, and for each recording the number of frames that were cut or interpolated.

    Raises
    ------
    InputError
        When the folder exists or cannot be written, or a recording has no part in which all stations were measured.
    """
    if folder.exists():
        raise InputError(f"{folder} exists already: name a new folder, since LeRobot reads all files in it")
    if fps < 0:
        raise InputError(f"fps must be a positive number of frames per second, got {fps}")
    fps = fps or max(1, round(min(1.0 / float(np.median(np.diff(s.time))) for s in sides.sides)))
    episodes, notes, begin = [], [f"{fps} frames per second"], 0
    for k, side in enumerate(sides.sides):
        episode, remarks = episode_of(side, k, begin, fps)
        episodes.append(episode)
        notes += [f"{side.name}: {f}" for f in remarks]
        begin += episode.length
    try:
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".pliant-lerobot-") as temporary:
            draft = Path(temporary) / folder.name
            write_folder(draft, sides, episodes, fps)
            draft.replace(folder)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from None
    return tuple(notes)


def episode_of(side: Side, number: int, begin: int, fps: int) -> tuple[Episode, list[str]]:
    """Return a recording at the frame rate `fps`, and notes on frames cut or interpolated.

    `number` is the index of the episode, `begin` the number of frames before it.
    """
    rows = side.measured.reshape(side.time.size, -1)
    finite = np.isfinite(rows)
    inside = [np.flatnonzero(column)[[0, -1]] if column.any() else [side.time.size, -1] for column in finite.T]
    first, last = max(i[0] for i in inside), min(i[1] for i in inside)
    if last <= first:
        raise InputError(f"{side.name} has no part in which all stations were measured: leave it out of the export")
    time = side.time[first] + np.arange(int((side.time[last] - side.time[first]) * fps + 1e-6) + 1) / fps
    between = finite[first : last + 1]
    gaps, cut = int((~between).any(axis=1).sum()), int(side.time.size - between.shape[0])
    notes = [f"{cut} frame(s) at its ends were cut, since a station was not measured"] if cut else []
    notes += [f"{gaps} frame(s) in which a station was not measured were interpolated in time"] if gaps else []
    count = time.size
    columns = {
        "observation.state": sampled(time, side.time, rows),
        "action": sampled(time, side.time, side.inputs),
        "model.state": sampled(time, side.time, side.modelled.reshape(side.time.size, -1)),
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count), "episode_index": np.full(count, number),
        "index": np.arange(begin, begin + count), "task_index": np.full(count, number),
    }  # fmt: skip
    return Episode(side.name, side.role, columns), notes


def sampled(time: Array, own: Array, rows: Array) -> Array:
    """Return an array (T, W) of float32: the W columns of `rows`, interpolated linearly between their finite values at
    the T new times `time` [s].
    """
    there = np.isfinite(rows)
    lines = [np.interp(time, own[t], column[t]) for column, t in zip(rows.T, there.T, strict=True)]
    return np.stack(lines, axis=1).astype(np.float32)


def write_folder(folder: Path, sides: Sides, episodes: Sequence[Episode], fps: int) -> None:
    """Write all files of a LeRobot data set into a folder."""
    import pandas as pd

    meta = folder / "meta"
    (meta / "episodes").mkdir(parents=True)
    features = features_of(sides)
    locations = write_data(folder / "data", episodes, features)
    write_episodes(meta / "episodes", episodes, locations)
    tasks = pd.DataFrame({"task_index": range(len(episodes))}, index=pd.Index([e.name for e in episodes], name="task"))
    tasks.to_parquet(meta / "tasks.parquet", engine="pyarrow")
    whole = {name: np.concatenate([e.columns[name] for e in episodes]) for name in features}
    stats = {name: statistics(values) for name, values in whole.items()}
    trained = sum(e.role == "train" for e in episodes)
    splits = {"train": f"0:{trained}", "test": f"{trained}:{len(episodes)}"}
    info = {
        "codebase_version": "v3.0", "robot_type": "soft_actuator", "total_episodes": len(episodes),
        "total_frames": sum(e.length for e in episodes), "total_tasks": len(episodes), "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": LARGEST_FILE_MB, "video_files_size_in_mb": LARGEST_VIDEO_MB, "fps": fps,
        "splits": {name: part for name, part in splits.items() if len(set(part.split(":"))) == 2},
        "data_path": f"data/{FILE}", "video_path": None, "features": features,
    }  # fmt: skip
    for name, content in (("info", info), ("stats", stats)):
        (meta / f"{name}.json").write_text(json.dumps(content, indent=4, ensure_ascii=False), encoding="utf-8")
    (folder / "README.md").write_text(card_text(sides, episodes), encoding="utf-8")


def features_of(sides: Sides) -> dict[str, dict[str, Any]]:
    """Return the type, shape and names of every column, as in meta/info.json."""
    unit = "rad" if sides.turns else "m"
    state = [f"{station}.{axis} [{unit}]" for station in sides.stations for axis in sides.axes]
    inputs = [f"{name or 'pressure'} [{u}]" for name, u in zip(sides.inputs, sides.units, strict=True)]
    named = {"observation.state": state, "action": inputs, "model.state": state}
    vectors = {k: {"dtype": "float32", "shape": [len(names)], "names": names} for k, names in named.items()}
    return vectors | {k: {"dtype": kind, "shape": [1], "names": None} for k, kind in COUNTERS.items()}


def write_data(folder: Path, episodes: Sequence[Episode], features: Mapping[str, Any]) -> list[tuple[int, int]]:
    """Write the frames of all episodes as Parquet files, and return the indices of chunk and file of each episode."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    locations: list[tuple[int, int]] = []
    files, size = -1, np.inf
    writer: Any = None
    for e in episodes:
        table = pa.table({name: arrow(e.columns[name]) for name in features})
        size += table.nbytes
        if size > LARGEST_FILE_MB * 2**20:
            if writer is not None:
                writer.close()
            files, size = files + 1, table.nbytes
            path = folder / FILE.format(chunk_index=files // FILES_PER_CHUNK, file_index=files % FILES_PER_CHUNK)
            path.parent.mkdir(parents=True, exist_ok=True)
            writer = pq.ParquetWriter(path, table.schema, compression="snappy")
        writer.write_table(table)
        locations.append((files // FILES_PER_CHUNK, files % FILES_PER_CHUNK))
    writer.close()
    return locations


def arrow(values: Array) -> Any:
    """Return a pyarrow column: numbers if `values` is (T,) or (T, 1), else lists of fixed length."""
    import pyarrow as pa

    if values.ndim == 1 or values.shape[1] == 1:
        return pa.array(values.reshape(-1))
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])


def write_episodes(folder: Path, episodes: Sequence[Episode], places: Sequence[tuple[int, int]]) -> None:
    """Write the table of episodes. It states for each episode where its frames are stored, and the statistics of its
    columns.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows, begin = [], 0
    for k, (e, (chunk, file)) in enumerate(zip(episodes, places, strict=True)):
        stats = {f"stats/{name}/{key}": values for name, column in e.columns.items()
                 for key, values in statistics(column).items()}  # fmt: skip
        rows.append({
            "episode_index": k, "tasks": [e.name], "length": e.length, "data/chunk_index": chunk,
            "data/file_index": file, "dataset_from_index": begin, "dataset_to_index": begin + e.length, **stats,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        })  # fmt: skip
        begin += e.length
    path = folder / FILE.format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path, compression="snappy")


def statistics(values: Array) -> dict[str, list[float] | list[int]]:
    """Return minimum, maximum, mean, standard deviation, count and quantiles of each column of `values`, (T,) or (T, W)
    for T frames.
    """
    rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    exact = values.dtype.kind == "i"
    least, largest = rows.min(axis=0), rows.max(axis=0)
    return {
        "min": [int(v) for v in least] if exact else least.tolist(),
        "max": [int(v) for v in largest] if exact else largest.tolist(),
        "mean": rows.mean(axis=0).tolist(), "std": rows.std(axis=0).tolist(), "count": [len(rows)],
        **{name: np.quantile(rows, q, axis=0).tolist() for name, q in QUANTILES.items()},
    }  # fmt: skip


def card_text(sides: Sides, episodes: Sequence[Episode]) -> str:
    """Return the text of README.md, which describes the data set in the form of a dataset card."""
    lines = "\n".join(f"| {k} | {e.name} | {e.role.replace('_', ' ')} | {e.length} |" for k, e in enumerate(episodes))
    return f"""---
task_categories: [robotics]
tags: [LeRobot, soft-robotics]
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# {sides.title}

Written by pliant {__version__} from the study `{sides.study}`, fit `{sides.fit}`, in the format LeRobotDataset v3.0.
`observation.state` holds the measured stations, `action` the inputs (pressures are gauge), `model.state` the
positions that the fitted model predicts for the same inputs. Positions are in the base frame of the recording.

| episode | recording | role | frames |
|---|---|---|---|
{lines}
"""
