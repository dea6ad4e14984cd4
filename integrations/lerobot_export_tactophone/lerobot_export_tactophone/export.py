"""What a run felt, beside the frames of a robot's data set (LeRobotDataset v3.0): as
features of each frame, and sound.

The format is described in huggingface/lerobot, ``docs/source/lerobot-dataset-v3.mdx``,
and in its ``datasets`` folder. A data set has one rate, and ours is higher: a frame
holds the newest few predictions at its time, oldest first, so that none is left out and
none comes from the frame's future.
"""

import itertools
import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.app.logged_run import write_sound
from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.prediction_fields import PREDICTION_FIELDS
from tactophone.core.recordings.links import foreign_target
from tactophone.core.types import EVENT_KINDS, Touch
from tactophone.live.log import log_topics
from tactophone.live.log.mcap import LogEnd, read_messages

LEROBOT_VALUES = (
    "age",
    *(field.name for field in PREDICTION_FIELDS[3:-1] if field.name != "unknown"),
)
"""What a finger's feature holds of a prediction: its age in s at the frame, -1 where
none is known, and its numbers, ``event`` the last of them, which a log without touch
events leaves out."""

STATE = "observation.state"
"""The feature that LeRobot's policies take as the robot's state; they leave out all
others that are no pictures."""

AUDIO_PATH = "audio/{audio_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.wav"
"""WAV, as AAC in the proposal's ``.m4a`` cuts what a contact microphone hears above 16
kHz and delays it."""

LEROBOT_LOWEST_DBFS = -200.0
"""Stands for the level of digital silence, because a mean over -inf is useless."""

NEW_SESSION = 0.5
"""Seconds by which stream time falls back where another session begins; touch events
may come a window late."""

MOST_FRAMES = 2_000_000
"""Most frames of a data set: 18 hours at 30 a second."""

MOST_NUMBERS = 10_000_000
"""Most predictions that are written, over all frames."""

MOST_VALUES = 100_000_000
"""Most values of a file, over all columns: 800 MB. LeRobot begins another file after
100 MB."""

MOST_BYTES = 800 << 20
"""Most bytes of a column of a file once it is unpacked, as pages are read whole."""

BATCH_BYTES = 64 << 20
"""Bytes of pictures or text that a batch of frames may take."""

_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles in LeRobot's statistics, by their names in its files."""

Rows = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Finger:
    """The predictions of a finger: ``times`` in s since 1970, and a row of
    `LEROBOT_VALUES` but the first for each."""

    name: str
    times: Rows
    rows: Rows

    @property
    def feature(self) -> str:
        return f"observation.tactile.{self.name}"

    @property
    def values(self) -> tuple[str, ...]:
        """Those of `LEROBOT_VALUES` that the log holds."""
        return LEROBOT_VALUES[: 1 + self.rows.shape[1]]

    def names(self, most: int) -> list[str]:
        """Return the names of the values of ``most`` predictions, oldest first; the
        newest end in 0."""
        return [
            f"{name}.{place}" for place in range(1 - most, 1) for name in self.values
        ]


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    folder: Path
    frames: int
    felt: int
    """Frames that the log covers."""
    rows: int
    """Predictions in a frame."""
    features: list[str]
    sound: list[Path]


def export(
    log: Path,
    dataset: Path,
    out: Path,
    *,
    episode: int = 0,
    start: float | None = None,
    into_state: Sequence[str] = (),
) -> Exported:
    """Copy a data set to a new folder, with what was felt in one of its episodes.

    The episode's first frame is at ``start`` s since 1970, by default the time of the
    log's first prediction. A feature ``observation.tactile.FINGER`` holds
    `LEROBOT_VALUES` of each prediction, one after another in one row, as LeRobot's
    tools cannot edit arrays of two dimensions; the newest values of those named in
    ``into_state`` are also appended to ``observation.state``, which policies read. What
    other episodes have felt stays.

    Raises `DatasetError` if log or data set cannot be read, and `ConfigError` if the
    folder exists, the log covers no frame of the episode, a name of ``into_state`` is
    unknown, or an earlier export wrote other values.
    """
    from pyarrow import parquet

    if out.exists():
        raise ConfigError(f"--out {out}: exists already; name a new folder")
    if out.resolve().is_relative_to(dataset.resolve()):
        raise ConfigError(f"--out {out}: is in the data set; name a folder elsewhere")
    info = read_info(dataset)
    fingers, lead = read_fingers(log)
    held, state = _extended_state(into_state, info, dataset, fingers)
    begin = (
        min(float(finger.times[0]) for finger in fingers) if start is None else start
    )
    _refuse_odd_files(dataset)
    paths = sorted((dataset / "data").rglob("*.parquet"))
    frames = count_frames(paths)
    count_frames((dataset / "meta/episodes").rglob("*.parquet"))
    tables = (
        parquet.read_table(path, columns=["timestamp", "episode_index"])
        for path in paths
    )
    moments = np.concatenate(
        [_moments(table, episode, begin) for table in tables] or [np.empty(0)]
    )
    inside = np.sort(moments[np.isfinite(moments)])
    felt = sum(
        int(np.sum((inside >= finger.times[0]) & (inside <= finger.times[-1] + 1)))
        for finger in fingers[:1]
    )
    if not felt:
        raise ConfigError(
            f"{log} covers no frame of episode {episode} of {dataset}: give the time "
            "of its first frame, in s since "
            f"1970, as --start; the log runs from {fingers[0].times[0]:.1f} to "
            f"{fingers[0].times[-1]:.1f}"
        )
    # As many as fall between any two frames, so that each stands in a frame.
    most = max(
        2,
        *(
            int(np.diff(np.searchsorted(finger.times, inside)).max(initial=1))
            for finger in fingers
        ),
    )
    most = max(most, *(_felt_before(info, finger, dataset) for finger in fingers))
    if frames * most > MOST_NUMBERS:
        raise DatasetError(
            f"{dataset}: {frames} frames of {most} predictions each are too many; "
            "export fewer frames"
        )
    _copy(dataset, out)

    def features(table: Any) -> dict[str, Rows]:
        found = {
            finger.feature: _feature(finger, table, episode, begin, most)
            for finger in fingers
        }
        return found | (
            _state(found, table, held, fingers, into_state) if into_state else {}
        )

    with ExitStack() as stack:
        # Half a data set is worse than none.
        stack.callback(shutil.rmtree, out, ignore_errors=True)
        written = _write_frames(paths, dataset, out, features)
        for finger in fingers:
            shape = {"shape": [most * len(finger.values)], "names": finger.names(most)}
            info["features"][finger.feature] = {"dtype": "float32", **shape}
        if into_state:
            info["features"][STATE] = state
        sounds = _write_sound(log, out)
        if sounds:
            info.setdefault("audio_path", AUDIO_PATH)
        first = begin - lead  # of the episode, in its sound
        spans = {
            path.parts[-3]: {
                "chunk_index": 0,
                "file_index": int(path.stem[5:]),
                "from_timestamp": first,
                "to_timestamp": first + float(inside[-1] - inside[0]),
            }
            for path in reversed(sounds)
        }
        _write_meta(dataset, out, info, written, spans, episode)
        stack.pop_all()
    return Exported(
        out, len(moments), felt, most, [finger.feature for finger in fingers], sounds
    )


def read_info(dataset: Path) -> dict[str, Any]:
    try:
        info: dict[str, Any] = json.loads((dataset / "meta/info.json").read_bytes())
        if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
            raise ValueError("no table with features")
        if not all(
            isinstance(each, dict) and isinstance(each.get("names"), list | dict | None)
            for each in info["features"].values()
        ):
            raise ValueError("a feature has neither names nor null")
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(
            f"{dataset}: no LeRobot data set ({error}); wanted meta/info.json of "
            "version v3.0"
        ) from None
    if info.get("codebase_version") != "v3.0":
        raise DatasetError(
            f"{dataset}: version {info.get('codebase_version')}, but v3.0 is wanted; "
            "convert it with lerobot"
        )
    return info


def read_fingers(log: Path) -> tuple[list[Finger], float]:
    """Return the predictions of each finger, and the time of the beginning of the
    sound, in s since 1970."""
    found: dict[str, list[tuple[float, float, list[float]]]] = {}
    for message in read_messages(log):
        if (
            isinstance(message, LogEnd)
            or message.topic.kind != log_topics.PREDICTION_TOPIC.kind
        ):
            continue
        try:
            entries = msgspec.json.decode(message.data, type=dict[str, Any])
            entries |= {
                "touch": Touch[entries["touch"].upper()],
                "event": ("", *EVENT_KINDS).index(entries["event"]),
            }
            entries["level_dbfs"] = max(
                LEROBOT_LOWEST_DBFS, entries.get("level_dbfs", LEROBOT_LOWEST_DBFS)
            )
            name = (
                message.topic.name.split("/")[2]
                if message.topic.name.count("/") > 2
                else "index"
            )
            row = [float(entries.get(key, 0.0)) for key in LEROBOT_VALUES[1:]]
            found.setdefault(name, []).append(
                (message.time, float(entries["window_end"]), row)
            )
        except (
            msgspec.DecodeError,
            KeyError,
            ValueError,
            TypeError,
            AttributeError,
        ) as error:
            raise DatasetError(
                f"{log}: a prediction cannot be read ({error!r:.80}); was the file "
                "changed?"
            ) from None
    if not found:
        raise DatasetError(f"{log}: no prediction in it; record the operator's side")
    width = (
        len(LEROBOT_VALUES)
        - 1
        - (not any(row[-1] for rows in found.values() for *_, row in rows))
    )
    fingers = [
        Finger(
            name,
            _even([row[:2] for row in rows]),
            np.array([row[:width] for *_, row in rows]),
        )
        for name, rows in found.items()
    ]
    return fingers, min(
        float(finger.times[0]) - found[finger.name][0][1] for finger in fingers
    )


def _even(stamps: list[tuple[float, float]]) -> Rows:
    """Return the times of predictions, from their stamps and stream times: as even as
    the stream of each session.

    A stamp follows the least delay seen until then; here the least of a whole session
    is known.
    """
    stamped, ends = np.array(stamps).T
    starts = np.flatnonzero(np.diff(ends, prepend=math.inf) < -NEW_SESSION)
    leads = np.minimum.reduceat(stamped - ends, starts)
    times: Rows = np.repeat(leads, np.diff(np.append(starts, len(ends)))) + ends
    return np.maximum.accumulate(times)


def _moments(table: Any, episode: int, begin: float) -> Rows:
    """Return the time of each frame, in s since 1970; NaN in other episodes."""
    moments = begin + table["timestamp"].to_numpy().astype(float).ravel()
    return np.where(
        table["episode_index"].to_numpy().ravel() == episode, moments, np.nan
    )


def _felt_before(info: dict[str, Any], finger: Finger, dataset: Path) -> int:
    """Return how many predictions of this finger a frame of an earlier export holds; 0
    if there was none."""
    names = info["features"].get(finger.feature, {}).get("names") or []
    most = len(names) // len(finger.values)
    if names != finger.names(most):
        raise ConfigError(
            f"{dataset}: its {finger.feature} has other columns than "
            f"{', '.join(finger.values)}; "
            "export all logs into the original, with touch events in all or in none"
        )
    return most


def _feature(finger: Finger, table: Any, episode: int, begin: float, most: int) -> Rows:
    """Return the feature of a finger, ``most`` predictions a frame; in other episodes
    as it was."""
    moments = _moments(table, episode, begin)
    newest = np.searchsorted(finger.times, moments, side="right") - 1
    known = (newest >= 0) & (moments <= finger.times[-1] + 1)
    places = np.clip(
        newest[:, None] - np.arange(most - 1, -1, -1), 0, len(finger.times) - 1
    )
    ages = (moments[:, None] - finger.times[places])[..., None]
    felt = np.concatenate([ages, finger.rows[places]], axis=2)
    blank = np.zeros_like(felt)
    blank[..., 0] = -1
    if finger.feature in table.column_names:
        before = np.array(table[finger.feature].to_pylist()).reshape(
            len(table), -1, felt.shape[2]
        )
        blank[:, most - before.shape[1] :] = np.where(
            np.isfinite(moments)[:, None, None], blank[:, :1], before
        )
    return np.where(known[:, None, None], felt, blank).reshape(len(table), -1)


def _write_frames(
    paths: Iterable[Path],
    dataset: Path,
    out: Path,
    features: Callable[[Any], dict[str, Rows]],
) -> dict[str, Rows]:
    """Write each file of frames with its new features, batch by batch; return the
    features of all frames."""
    import pyarrow

    collected: dict[str, list[Rows]] = {}

    def extend(table: Any) -> dict[str, Any]:
        columns = {}
        for name, values in features(table).items():
            flat = pyarrow.array(values.astype(np.float32).ravel())
            columns[name] = pyarrow.FixedSizeListArray.from_arrays(
                flat, values.shape[1]
            )
            collected.setdefault(name, []).append(values)
        return columns

    for path in paths:
        _rewrite(path, out / path.relative_to(dataset), extend)
    return {name: np.concatenate(parts) for name, parts in collected.items()}


def _rewrite(
    source: Path, target: Path, extend: Callable[[Any], dict[str, Any]]
) -> None:
    """Write a file of rows anew, batch by batch, with the columns that ``extend``
    returns for each batch; a file without rows is left as it was copied."""
    import pyarrow
    from pyarrow import parquet

    with parquet.ParquetFile(source) as file, ExitStack() as stack:
        writer = None
        for batch in file.iter_batches(batch_size(file.metadata)):
            table = pyarrow.Table.from_batches([batch])
            columns = dict(zip(table.column_names, table.columns, strict=True))
            table = pyarrow.table(columns | extend(table))
            if writer is None:
                target.unlink()  # it may be a link to the original
                writer = stack.enter_context(
                    parquet.ParquetWriter(target, table.schema)
                )
            writer.write_table(table)


def _column_chunks(head: Any) -> Iterator[Any]:
    """Yield the head of each column in each row group of a Parquet file."""
    for group in map(head.row_group, range(head.num_row_groups)):
        yield from map(group.column, range(group.num_columns))


def batch_size(head: Any) -> int:
    """Return how many frames are read at once: one value of a dictionary may stand in
    all of them."""
    sizes = [
        each.total_uncompressed_size
        for each in _column_chunks(head)
        if each.physical_type == "BYTE_ARRAY"
    ]
    return max(1, min(10_000, BATCH_BYTES // max(map(int, sizes), default=1)))


def _extended_state(
    names: Sequence[str], info: dict[str, Any], dataset: Path, fingers: list[Finger]
) -> tuple[int, dict[str, Any]]:
    """Return how many of our values the state holds from an earlier export, and how it
    is described with them."""
    for name in names:
        if name not in (there := fingers[0].values):
            raise ConfigError(
                f"--into-state {name}: no value of a prediction; there are "
                f"{', '.join(there)}"
            )
    if names and STATE not in info["features"]:
        raise ConfigError(
            f"{dataset}: has no {STATE} to append to; leave --into-state out"
        )
    feature = info["features"].get(STATE, {"shape": [0]})
    own: Any = feature.get("names") or [
        f"state.{place}" for place in range(feature["shape"][0])
    ]
    grouped = isinstance(own, dict)  # {"motors": [...]}
    appended = [f"tactile.{finger.name}.{name}" for finger in fingers for name in names]
    held = (
        own.get("tactile", [])
        if grouped
        else [each for each in own if each.startswith("tactile.")]
    )
    if held and held != appended:
        raise ConfigError(
            f"{dataset}: its state has {', '.join(held)}; give --into-state as before"
        )
    named = (
        {**own, "tactile": appended}
        if grouped
        else [*own[: len(own) - len(held)], *appended]
    )
    return len(held), {
        **feature,
        "names": named,
        "shape": [feature["shape"][0] - len(held) + len(appended)],
    }


def _state(
    found: dict[str, Rows],
    table: Any,
    held: int,
    fingers: list[Finger],
    names: Sequence[str],
) -> dict[str, Rows]:
    """Return the state that policies read, with the newest values of all episodes at
    its end."""
    own = np.array(table[STATE].to_pylist(), float).reshape(len(table), -1)
    newest = [
        values[:, values.shape[1] - len(finger.values) :][
            :, [finger.values.index(name) for name in names]
        ]
        for finger, values in zip(fingers, found.values(), strict=True)
    ]
    return {STATE: np.concatenate([own[:, : own.shape[1] - held], *newest], axis=1)}


def _stats(values: Rows) -> dict[str, list[float]]:
    """Return statistics as LeRobot has them: over all but the last axis, where
    ``count`` is the number of frames."""
    rows = values.astype(np.float32).reshape(-1, values.shape[-1])
    found = {
        "min": rows.min(0),
        "max": rows.max(0),
        "mean": rows.mean(0),
        "std": rows.std(0),
    }
    found |= {
        name: np.quantile(rows, share, axis=0) for name, share in _QUANTILES.items()
    }
    return {name: list(map(float, each)) for name, each in found.items()} | {
        "count": [len(values)]
    }


def _frames(of_frame: NDArray[np.int64], number: int) -> NDArray[np.bool_]:
    """Return which frames an episode has; raises `DatasetError` for one without any."""
    found: NDArray[np.bool_] = of_frame == number
    if not found.any():
        raise DatasetError(
            f"episode {number} stands in meta/episodes, but has no frame; was the data "
            "set changed?"
        )
    return found


def _write_meta(
    dataset: Path,
    out: Path,
    info: dict[str, Any],
    written: dict[str, Rows],
    sounds: dict[str, dict[str, float]],
    episode: int,
) -> None:
    """Write ``info.json``, and the statistics of new features for all frames and for
    each episode."""
    import pyarrow
    from pyarrow import parquet

    frames = [
        parquet.read_table(path, columns=["episode_index"])
        for path in sorted((out / "data").rglob("*.parquet"))
    ]
    of_frame = np.concatenate(
        [table["episode_index"].to_numpy().ravel() for table in frames]
    )

    def extend(table: Any) -> dict[str, Any]:
        numbers = table["episode_index"].to_pylist()
        columns = {}
        for name, values in written.items():
            rows = [_stats(values[_frames(of_frame, number)]) for number in numbers]
            columns |= {
                f"stats/{name}/{key}": pyarrow.array([row[key] for row in rows])
                for key in rows[0]
            }
        for key, placed in sounds.items():
            for name, value in placed.items():
                column = f"audio/{key}/{name}"
                before = (
                    table[column].to_pylist()
                    if column in table.column_names
                    else [None] * len(numbers)
                )
                each = [
                    value if number == episode else old
                    for number, old in zip(numbers, before, strict=True)
                ]
                columns[column] = pyarrow.array(each, pyarrow.scalar(value).type)
        return columns

    for path in sorted((dataset / "meta/episodes").rglob("*.parquet")):
        _rewrite(path, out / path.relative_to(dataset), extend)
    info["tactophone"] = {
        "columns_unit": "age in s before the frame; level_dbfs in dBFS; frequency in "
        "Hz; the others 0 to 1",
        "touch": [touch.name.lower() for touch in Touch],
        "event": ["", *EVENT_KINDS],
    }
    stats = (
        json.loads((dataset / "meta/stats.json").read_bytes())
        if (dataset / "meta/stats.json").exists()
        else {}
    )
    stats |= {name: _stats(values) for name, values in written.items()}
    for name, content in (("info.json", info), ("stats.json", stats)):
        (out / "meta" / name).unlink(missing_ok=True)
        (out / "meta" / name).write_text(json.dumps(content, indent=4) + "\n")


def _refuse_odd_files(dataset: Path) -> None:
    """Refuse links that leave the data set, links to folders, which may lead in
    circles, and pipes and devices, which may never end."""
    for path in dataset.rglob("*"):
        if path.is_symlink() and (path.is_dir() or foreign_target(path, dataset)):
            raise DatasetError(f"{path}: a link; copy the data set with `cp -rL` first")
        if not path.is_dir() and not path.is_file():
            raise DatasetError(f"{path}: no file; remove it from the data set first")


def count_frames(paths: Iterable[Path]) -> int:
    """Return the number of frames by the heads of the files, before anything is read;
    raises `DatasetError`."""
    import pyarrow
    from pyarrow import parquet

    count = 0
    for path in paths:
        try:
            head = parquet.read_metadata(path)
        except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
            reason = str(error).partition("\n")[0]
            raise DatasetError(
                f"{path}: no frames of a LeRobot data set ({reason}); was the file "
                "changed?"
            ) from None
        count += head.num_rows
        if (
            values := sum(each.num_values for each in _column_chunks(head))
        ) > MOST_VALUES:
            raise DatasetError(
                f"{path}: {values} values, but at most {MOST_VALUES} are read; export "
                "smaller files"
            )
        size = max(
            (each.total_uncompressed_size for each in _column_chunks(head)), default=0
        )
        if size > MOST_BYTES:
            raise DatasetError(
                f"{path}: a column of {size} bytes, but at most {MOST_BYTES} are read; "
                "export smaller files"
            )
    if count > MOST_FRAMES:
        raise DatasetError(
            f"{count} frames, but at most {MOST_FRAMES} are read at once; export "
            "parts of the data set"
        )
    return count


def _copy(dataset: Path, out: Path) -> None:
    def copy(source: str, target: str) -> None:
        if (
            Path(source).relative_to(dataset).parts[0] == "videos"
        ):  # large, and nothing here writes there
            with suppress(OSError):
                os.link(source, target)
                return
        shutil.copyfile(source, target)

    try:
        shutil.copytree(dataset, out, copy_function=copy)
    except shutil.Error as error:  # of each file: source, target and reason
        shutil.rmtree(out)
        raise ConfigError(
            f"--out {out}: {error.args[0][0][2]}; free some space, or name another "
            "folder"
        ) from None


def _write_sound(log: Path, out: Path) -> list[Path]:
    """Write the sound where the open proposal for sound (huggingface/lerobot, pull
    request 2824) has it."""
    placed = []
    with TemporaryDirectory(prefix="tactophone-", dir=out) as folder:
        try:
            sounds = write_sound(log, Path(folder))
        except DatasetError:
            sounds = []  # a run that carried predictions alone
        for sound in sounds:
            key = f"observation.audio.{sound.finger or 'index'}"
            numbered = (
                out / AUDIO_PATH.format(audio_key=key, chunk_index=0, file_index=n)
                for n in itertools.count()
            )
            path = next(path for path in numbered if not path.exists())
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                placed.append(sound.path.replace(path))
            except OSError as error:
                raise DatasetError(
                    f"{path}: cannot be written ({error.strerror}); was the data set "
                    "changed?"
                ) from None
    return placed
