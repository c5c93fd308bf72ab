"""Demonstrations as a dataset of LeRobot, format v3.0, as https://github.com/huggingface/lerobot reads and writes it.

A dataset is a folder: ``meta/info.json``, ``meta/stats.json``, ``meta/tasks.parquet``, one row for each episode in
``meta/episodes``, and one for each frame in ``data``. Positions are float32, as everywhere in LeRobot.
"""

import json
import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError, how_to_install
from pidtsm_experiments.errors import RunError

VERSION = "v3.0"
STATE, ACTION = "observation.state", "action"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FIRST = _FILE.format(chunk_index=0, file_index=0)
_INDICES = ("frame_index", "episode_index", "index", "task_index")
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
_Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Demonstration:
    """One episode at a regular rate.

    Attributes:
        joints: names.
        state: positions, shape (frames, joints), rad or m.
        action: where the joints should go from there, likewise.
    """

    joints: tuple[str, ...]
    state: Array
    action: Array


def require_pyarrow() -> None:
    """Raises: UsageError: pyarrow is not installed."""
    try:
        import pyarrow  # noqa: F401  It is loaded only where it is needed.
    except ModuleNotFoundError:
        raise UsageError(f"datasets of LeRobot need pyarrow: {how_to_install('parquet')}") from None


def write_dataset(folder: Path, episodes: Sequence[Demonstration], fps: int, task: str, robot: str | None) -> None:
    """Write a dataset whole, or nothing.

    Args:
        folder: that does not exist yet, in one that does.
        episodes: at least one, with the same joints in the same order.
        fps: frames per second.
        task: what is demonstrated, in words.
        robot: name of the arm; None: unknown.

    Raises:
        RunError: it cannot be written.
    """
    draft = folder.with_name(f".{folder.name[:100]}.{secrets.token_hex(4)}")
    try:
        for place in ("data/chunk-000", "meta/episodes/chunk-000"):
            (draft / place).mkdir(parents=True)
        _write(draft, episodes, fps, task, robot)
        draft.rename(folder)
    except OSError as error:
        raise RunError(f"cannot write {folder}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _write(folder: Path, episodes: Sequence[Demonstration], fps: int, task: str, robot: str | None) -> None:
    import pyarrow as arrow
    from pyarrow import parquet

    joints, begin = episodes[0].joints, 0
    frames: list[_Columns] = []
    rows: list[dict[str, Any]] = []
    for number, episode in enumerate(episodes):
        columns = _frames(episode, number, begin, fps)
        begin += len(episode.state)
        frames.append(columns)
        rows.append(_row(number, columns, task))
    whole = {name: np.concatenate([columns[name] for columns in frames]) for name in frames[0]}
    vectors = arrow.list_(arrow.float32(), len(joints))
    data = {
        name: arrow.FixedSizeListArray.from_arrays(column.ravel(), type=vectors) if column.ndim == 2 else column
        for name, column in whole.items()
    }
    parquet.write_table(arrow.table(data), folder / "data" / _FIRST, compression="snappy")
    parquet.write_table(arrow.Table.from_pylist(rows), folder / "meta" / "episodes" / _FIRST, compression="snappy")
    parquet.write_table(_tasks(task), folder / "meta" / "tasks.parquet")
    contents: dict[str, Any] = {"info": _info(joints, len(episodes), begin, fps, robot)}
    contents["stats"] = {name: _statistics(column) for name, column in whole.items()}
    for name, content in contents.items():
        text = json.dumps(content, indent=4, default=np.ndarray.tolist)
        (folder / "meta" / f"{name}.json").write_text(f"{text}\n", encoding="utf-8")


def _frames(episode: Demonstration, number: int, begin: int, fps: int) -> _Columns:
    count = len(episode.state)
    frame = np.arange(count, dtype=np.int64)
    return {
        STATE: episode.state.astype(np.float32),
        ACTION: episode.action.astype(np.float32),
        "timestamp": (frame / fps).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(count, number, dtype=np.int64),
        "index": begin + frame,
        "task_index": np.zeros(count, dtype=np.int64),
    }


def _row(number: int, columns: _Columns, task: str) -> dict[str, Any]:
    """What the dataset knows of an episode."""
    statistics = {name: _statistics(column) for name, column in columns.items()}
    return {
        "episode_index": number,
        "tasks": [task],
        "length": len(columns["index"]),
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": int(columns["index"][0]),
        "dataset_to_index": int(columns["index"][-1]) + 1,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        **{f"stats/{name}/{key}": value.tolist() for name, found in statistics.items() for key, value in found.items()},
    }


def _statistics(column: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Over the frames, each of shape (values of a frame,)."""
    values = column.reshape(len(column), -1).astype(np.float64)
    quantiles = zip(_QUANTILES, np.quantile(values, _QUANTILES, axis=0), strict=True)
    return {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
        **{f"q{round(100 * share):02d}": found for share, found in quantiles},
    }


def _tasks(task: str) -> Any:
    """A table whose index is the task, as pandas stores it."""
    import pyarrow as arrow

    kinds = {"task_index": "int64", "task": "unicode"}
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": kind, "metadata": None}
        for name, kind in kinds.items()
    ]
    known = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = arrow.table({"task_index": np.zeros(1, dtype=np.int64), "task": [task]})
    return table.replace_schema_metadata({"pandas": json.dumps(known)})


def _info(joints: Sequence[str], episodes: int, frames: int, fps: int, robot: str | None) -> dict[str, Any]:
    vector = {"dtype": "float32", "shape": [len(joints)], "names": list(joints)}
    one: dict[str, Any] = {"shape": [1], "names": None}
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": {
            STATE: vector,
            ACTION: vector,
            "timestamp": {"dtype": "float32", **one},
            **{name: {"dtype": "int64", **one} for name in _INDICES},
        },
    }


def is_dataset(folder: Path) -> bool:
    """Whether a folder is a dataset of LeRobot, of any version."""
    return (folder / "meta" / "info.json").is_file()


def read_episode(folder: Path, episode: int, feature: str) -> tuple[tuple[str, ...], Array, Array]:
    """The motion of an episode.

    Args:
        folder: a dataset.
        episode: its number.
        feature: `STATE` or `ACTION`, or another with one position for each joint.

    Returns:
        Names of the joints; times, s, shape (frames,); positions, rad or m, shape (frames, joints).

    Raises:
        UsageError: it is of another version, damaged, or lacks episode, feature or names; or pyarrow is not installed.
    """
    require_pyarrow()
    from pyarrow import ArrowException, parquet

    try:
        info = json.loads((folder / "meta" / "info.json").read_text(encoding="utf-8"))
        if info["codebase_version"] != VERSION:
            raise UsageError(f"{folder}: format {info['codebase_version']}; LeRobot converts it to {VERSION}")
        joints = (info["features"].get(feature) or {}).get("names")
        if not (isinstance(joints, list) and all(isinstance(joint, str) for joint in joints)):
            raise UsageError(f"{folder}: no {feature} with names of joints; there are {', '.join(info['features'])}")
        if not 0 <= episode < info["total_episodes"]:
            raise UsageError(f"{folder}: no episode {episode}; there are 0 to {info['total_episodes'] - 1}")
        wanted = [("episode_index", "=", episode)]
        where = parquet.read_table(folder / "meta" / "episodes", filters=wanted).to_pylist()[0]
        place = info["data_path"].format(
            chunk_index=where["data/chunk_index"], file_index=where["data/file_index"], episode_index=episode
        )
        table = parquet.read_table(folder / place, columns=["timestamp", feature], filters=wanted)
        times = np.array(table["timestamp"].to_pylist(), dtype=np.float64)
        positions = np.array(table[feature].to_pylist(), dtype=np.float64)
    except (OSError, ArrowException, KeyError, IndexError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise UsageError(f"{folder}: not a whole dataset of LeRobot: {error}") from None
    whole = positions.shape == (len(times), len(joints)) and bool(np.isfinite(positions).all())
    if not (whole and len(times) and np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
        raise UsageError(f"{folder}: episode {episode} has frames without times, or positions that are missing or bad")
    return tuple(joints), times - times[0], positions


def new_folder(out: Path) -> Path:
    """Check that a dataset can be written here, before the work.

    Raises:
        UsageError: it exists, or its folder does not, or may not be written.
    """
    if out.exists() or out.is_symlink():
        raise UsageError(f"--out {out}: exists; name a new folder")
    parent = out.absolute().parent
    if not (parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)):
        raise UsageError(f"--out {out}: {parent} is not a folder, or may not be written")
    return out
