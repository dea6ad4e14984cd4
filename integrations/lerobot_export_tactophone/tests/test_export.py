"""A run beside a robot's frames, written and read back by the description of
LeRobotDataset v3.0."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile
from lerobot_export_tactophone import export
from lerobot_export_tactophone.export import LEROBOT_VALUES

from tactophone.cli import main
from tactophone.live.log.mcap import LogEnd, read_messages

FEATURE = "observation.tactile.index"
FPS = 30
"""Of the data set's frames."""

FRAMES = 45
"""Of each episode of the data set."""

parquet = pytest.importorskip("pyarrow.parquet")
pandas = pytest.importorskip("pandas")


def read_episode(root: Path, episode: int) -> "pandas.DataFrame":
    """Read as LeRobot's documentation describes it, with nothing of ours."""
    info = json.loads((root / "meta/info.json").read_text())
    rows = pandas.concat(
        map(pandas.read_parquet, (root / "meta/episodes").rglob("*.parquet"))
    )
    row = rows[rows["episode_index"] == episode].iloc[0]
    path = info["data_path"].format(
        chunk_index=row["data/chunk_index"], file_index=row["data/file_index"]
    )
    return parquet.read_table(
        root / path, filters=[("episode_index", "=", episode)]
    ).to_pandas()


VALUES = LEROBOT_VALUES[:-1]  # the log has no touch events


def columns(table: "pandas.DataFrame") -> dict[str, "np.ndarray"]:
    """Return the columns of a finger's feature, each ``(frames, predictions)``."""
    values = np.stack(table[FEATURE]).reshape(len(table), -1, len(VALUES))
    return {name: values[..., place] for place, name in enumerate(VALUES)}


def export_of(log: Path, dataset: Path, out: Path, *words: str) -> list[str]:
    """Return the command that adds a log to a copy of a data set."""
    command = ["export-lerobot", str(log), "--with", str(dataset), "--out", str(out)]
    return [*command, *words]


@pytest.mark.slow
def test_every_prediction_stands_beside_the_frames_of_its_episode(
    log: Path, dataset: Path, tmp_path: Path
) -> None:
    original = (dataset / "data/chunk-000/file-000.parquet").read_bytes()
    film = dataset / "videos/observation.images.front/chunk-000/file-000.mp4"
    out = tmp_path / "felt"
    assert main(export_of(log, dataset, out, "--episode", "1")) == 0
    logged = [
        (message.time, json.loads(message.data))
        for message in read_messages(log)
        if not isinstance(message, LogEnd)
        and message.topic.name == "/tactophone/prediction"
    ]
    info = json.loads((out / "meta/info.json").read_text())
    (width,), names = (
        info["features"][FEATURE]["shape"],
        info["features"][FEATURE]["names"],
    )
    assert len(names) == width
    assert 3 <= width // len(VALUES) <= 12
    assert names[-len(VALUES) :] == [f"{name}.0" for name in VALUES]
    table, other = read_episode(out, 1), read_episode(out, 0)
    felt = columns(table)
    assert len(table) == len(other) == FRAMES
    assert np.array_equal(
        np.stack(table["observation.state"]),
        np.stack(read_episode(dataset, 1)["observation.state"]),
    )
    assert np.all(columns(other)["age"] == -1)
    lead = min(time - entry["window_end"] for time, entry in logged)
    begin = lead + logged[0][1]["window_end"]
    times = (
        begin + table["timestamp"].to_numpy(float)[:, None] - felt["age"].astype(float)
    )
    assert np.all(felt["age"] >= 0)  # nothing of a frame's future
    found = {
        (round(float(time), 3), round(float(rough), 4))
        for time, rough in zip(times.ravel(), felt["rough"].ravel(), strict=True)
    }
    until = begin + (FRAMES - 1) / FPS
    expected = {
        (round(lead + entry["window_end"], 3), round(entry["rough"], 4))
        for _, entry in logged
        if lead + entry["window_end"] < until
    }
    near = {
        (round(time + step / 1000, 3), rough)
        for time, rough in found
        for step in (-1, 0, 1)
    }
    assert len(expected) > 100
    assert not expected - near
    stats = json.loads((out / "meta/stats.json").read_text())
    assert set(stats[FEATURE]) == set(stats["action"])
    assert len(stats[FEATURE]["mean"]) == width
    assert (dataset / "data/chunk-000/file-000.parquet").read_bytes() == original
    assert "tactophone" not in json.loads((dataset / "meta/info.json").read_text())
    assert (out / film.relative_to(dataset)).read_bytes() == film.read_bytes()


def test_the_sound_of_an_episode_is_found_by_the_path_of_the_data_set(
    log: Path, dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "felt"
    assert main(export_of(log, dataset, out, "--episode", "1")) == 0
    episodes = pandas.concat(
        map(pandas.read_parquet, (out / "meta/episodes").rglob("*.parquet"))
    )
    row = episodes[episodes["episode_index"] == 1].iloc[0]
    key = "audio/observation.audio.index"
    place = {name: int(row[f"{key}/{name}"]) for name in ("chunk_index", "file_index")}
    path = json.loads((out / "meta/info.json").read_text())["audio_path"]
    sound = soundfile.info(
        out / path.format(audio_key="observation.audio.index", **place)
    )
    assert (sound.subtype, sound.samplerate) == ("FLOAT", 48_000)
    assert (
        0
        <= row[f"{key}/from_timestamp"]
        < row[f"{key}/to_timestamp"]
        <= sound.duration + 1
    )
    assert np.isnan(
        episodes[episodes["episode_index"] == 0].iloc[0][f"{key}/from_timestamp"]
    )


def test_the_newest_values_join_the_state_with_names_and_statistics(
    log: Path, dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "felt"
    command = export_of(log, dataset, out, "--episode", "1")
    assert main([*command, "--into-state", "roughness,contact"]) == 0
    feature = json.loads((out / "meta/info.json").read_text())["features"][
        "observation.state"
    ]
    assert feature["names"][2:] == ["tactile.index.roughness", "tactile.index.contact"]
    assert feature["shape"] == [4]
    table = read_episode(out, 1)
    state, felt = np.stack(table["observation.state"]), columns(table)
    assert np.array_equal(
        state[:, :2], np.stack(read_episode(dataset, 1)["observation.state"])
    )
    assert np.array_equal(state[:, 2], felt["roughness"][:, -1])
    assert np.array_equal(state[:, 3], felt["contact"][:, -1])
    episodes = pandas.read_parquet(out / "meta/episodes/chunk-000/file-000.parquet")
    mean = episodes[episodes["episode_index"] == 1].iloc[0][
        "stats/observation.state/mean"
    ]
    np.testing.assert_allclose(mean, state.mean(0), rtol=1e-5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--start", "5"], "covers no frame of episode 0"),
        (["--with", "nowhere"], "no LeRobot data set"),
        (["--out", "."], "exists already"),
        (["--into-state", "weight"], "no value of a prediction"),
    ],
)
def test_what_does_not_fit_is_one_line(
    log: Path,
    dataset: Path,
    tmp_path: Path,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = export_of(log, dataset, tmp_path / "out", *words)
    assert main(command) == 1
    assert message in capsys.readouterr().err


def test_a_link_in_a_data_set_overwrites_no_file_elsewhere(
    log: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    victim = tmp_path / "victim.txt"
    victim.write_text("mine")
    sound = dataset / "audio/unsorted/run.wav"
    sound.parent.mkdir(parents=True)
    sound.symlink_to(victim)
    command = ["export-lerobot", str(log), "--with", str(dataset), "--out"]
    assert main([*command, str(tmp_path / "linked")]) == 1
    assert "a link" in capsys.readouterr().err
    sound.unlink()
    other = dataset / "audio/observation.audio.index/chunk-000/file-000.wav"
    other.parent.mkdir(parents=True)
    for path in (sound, other):
        path.write_text("theirs")
    assert main([*command, str(tmp_path / "copied")]) == 0
    assert (victim.read_text(), sound.read_text(), other.read_text()) == (
        "mine",
        "theirs",
        "theirs",
    )
    copied = tmp_path / "copied" / other.relative_to(dataset)
    assert copied.read_text() == "theirs"
    assert soundfile.info(copied.with_name("file-001.wav")).frames


def test_a_file_of_endless_frames_is_refused_by_its_header(
    log: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import pyarrow

    zeros = pyarrow.table(
        {"timestamp": pyarrow.nulls(1_000_000, pyarrow.float32()).fill_null(0)}
    )
    with parquet.ParquetWriter(
        dataset / "data/chunk-000/file-001.parquet", zeros.schema
    ) as writer:
        for _ in range(3):
            writer.write_table(zeros)
    assert main(export_of(log, dataset, tmp_path / "out")) == 1
    assert "frames, but at most" in capsys.readouterr().err


def test_a_frame_of_endless_values_is_refused_by_its_header(
    log: Path,
    dataset: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import pyarrow

    monkeypatch.setattr(export, "MOST_VALUES", 1_000_000)
    zeros = pyarrow.nulls(1_000_001, pyarrow.uint8()).fill_null(0)
    columns = {
        "timestamp": pyarrow.array([0.0]),
        "x": pyarrow.ListArray.from_arrays([0, len(zeros)], zeros),
    }
    for place in ("data/chunk-000", "meta/episodes/chunk-000"):
        path = dataset / place / "file-001.parquet"
        parquet.write_table(pyarrow.table(columns), path)
        assert path.stat().st_size < 10_000
        assert main(export_of(log, dataset, tmp_path / "out")) == 1
        assert "values, but at most" in capsys.readouterr().err
        path.unlink()


@pytest.mark.slow
def test_frames_with_long_words_are_read_a_few_at_a_time(
    log: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow

    path = dataset / "data/chunk-000/file-000.parquet"
    table = parquet.read_table(path)
    word = ["A" * 1_000_000] * len(table)
    monkeypatch.setattr(export, "BATCH_BYTES", 4_000_000)
    parquet.write_table(
        table.append_column("word", pyarrow.chunked_array([word])), path
    )
    assert export.batch_size(parquet.read_metadata(path)) < 5
    out = tmp_path / "out"
    assert main(export_of(log, dataset, out, "--episode", "1")) == 0
    written = parquet.read_metadata(out / path.relative_to(dataset))
    assert written.num_rows == len(table)
    assert written.num_row_groups > len(table) / 5


def test_a_second_episode_leaves_the_first_ones_touch_sound_and_state(
    log: Path, dataset: Path, tmp_path: Path
) -> None:
    command = ["export-lerobot", str(log), "--into-state", "roughness,contact"]
    once, twice = tmp_path / "once", tmp_path / "twice"
    assert (
        main([*command, "--with", str(dataset), "--out", str(once), "--episode", "0"])
        == 0
    )
    assert (
        main([*command, "--with", str(once), "--out", str(twice), "--episode", "1"])
        == 0
    )
    for name in (FEATURE, "observation.state"):
        first = np.stack(read_episode(once, 0)[name])
        assert np.array_equal(np.stack(read_episode(twice, 0)[name]), first)
        assert np.array_equal(
            np.stack(read_episode(twice, 1)[name])[:, -9:], first[:, -9:]
        ) == (name == FEATURE)
    feature = json.loads((twice / "meta/info.json").read_text())["features"][
        "observation.state"
    ]
    assert (feature["shape"], len(feature["names"])) == ([4], 4)
    episodes = pandas.concat(
        map(pandas.read_parquet, (twice / "meta/episodes").rglob("*.parquet"))
    )
    key = "audio/observation.audio.index"
    assert episodes.set_index("episode_index")[
        f"{key}/file_index"
    ].dropna().to_dict() == {0: 0, 1: 1}
    for number in range(2):
        assert soundfile.info(twice / key / f"chunk-000/file-00{number}.wav").frames


def test_another_choice_of_values_does_not_shift_the_state(
    log: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    once = tmp_path / "once"
    command = export_of(log, dataset, once, "--into-state", "roughness")
    assert main(command) == 0
    command = export_of(log, once, tmp_path / "twice")
    assert main(command) == 1
    assert (
        "its state has tactile.index.roughness; give --into-state as before"
        in capsys.readouterr().err
    )


@pytest.mark.slow
def test_episodes_with_long_words_are_read_a_few_at_a_time(
    log: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow

    path = dataset / "meta/episodes/chunk-000/file-000.parquet"
    table = parquet.read_table(path)
    word = pyarrow.chunked_array([["A" * 1_000_000] * len(table)])
    parquet.write_table(table.append_column("word", word), path)
    monkeypatch.setattr(export, "BATCH_BYTES", 1_000_000)
    out = tmp_path / "out"
    assert main(export_of(log, dataset, out, "--episode", "1")) == 0
    written = parquet.ParquetFile(out / path.relative_to(dataset))
    assert written.metadata.num_row_groups == len(table) > 1
    values = written.read().to_pydict()
    assert values["word"] == word.to_pylist()
    counts = [row[0] for row in values[f"stats/{FEATURE}/count"]]
    assert counts == [FRAMES] * len(table)


def test_a_column_that_unpacks_to_more_than_fits_is_refused_by_its_header(
    log: Path,
    dataset: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import pyarrow

    monkeypatch.setattr(export, "MOST_BYTES", 1_000_000)
    path = dataset / "meta/episodes/chunk-000/file-001.parquet"
    table = pyarrow.table({"word": ["A" * 500_000] * 50})
    parquet.write_table(table, path, compression="zstd", use_dictionary=False)
    assert path.stat().st_size < 10_000
    assert main(export_of(log, dataset, tmp_path / "out")) == 1
    assert "bytes, but at most" in capsys.readouterr().err


def test_a_copy_into_the_data_set_itself_is_refused(
    log: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It copied itself into itself until Python gave up."""
    assert main(export_of(log, dataset, dataset / "exports" / "v1")) == 1
    assert "is in the data set; name a folder elsewhere" in capsys.readouterr().err
    assert not (dataset / "exports").exists()


def test_a_pipe_among_the_frames_is_refused(
    log: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its header was waited for without end."""
    os.mkfifo(dataset / "data/chunk-000/file-001.parquet")
    assert main(export_of(log, dataset, tmp_path / "out")) == 1
    assert "no file; remove it from the data set first" in capsys.readouterr().err


def test_an_episode_without_frames_is_named_and_leaves_no_half_of_a_copy(
    log: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import pyarrow

    table = pyarrow.table({"episode_index": pyarrow.array([7])})
    parquet.write_table(table, dataset / "meta/episodes/chunk-000/file-001.parquet")
    assert main(export_of(log, dataset, tmp_path / "out", "--episode", "1")) == 1
    assert "episode 7 stands in meta/episodes" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
