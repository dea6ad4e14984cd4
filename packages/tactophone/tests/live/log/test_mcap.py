import json
import os
import subprocess
from collections import Counter
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from msgspec.structs import astuple, replace

from tactophone.app.logged_run import add_sound, write_sound
from tactophone.app.replay import Comparison, Replay, write_replay
from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.prediction_fields import prediction_of
from tactophone.core.settings import change
from tactophone.core.types import (
    EVENT_KINDS,
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.log.log_topics import TOPICS, Message, Topic
from tactophone.live.log.mcap import (
    CHUNK_INTERVAL,
    LOG_READ_INTERVAL,
    LogEnd,
    LogFile,
    LoggedPrediction,
    McapLog,
    is_mcap,
    read_log,
    read_messages,
)
from tactophone.live.log.reader import encoded
from tactophone.live.telemetry import layout
from tactophone.live.telemetry.layout import (
    PREDICTION_RECORD,
    Fault,
    FingerState,
    RunState,
)
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.impairment import NetworkProfile
from tactophone.net.link.codec import Codec, open_decoder
from tactophone.net.link.packet import PayloadType
from tests.live.log.recorded_run import (
    RecordedOperator,
    decoded,
    decoded_sessions,
    joined,
    messages,
    record,
)
from tests.models import write_tiny_model
from tests.node import NODE, needs_node

mcap_reader = pytest.importorskip("mcap.reader")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_model(tmp_path_factory.mktemp("model") / "tiny.onnx")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, model: Path) -> Path:
    return record(tmp_path_factory.mktemp("log") / "run.mcap", model)


def replayed(path: Path) -> Replay:
    replay = Replay(read_log(path))
    for _ in replay.steps():
        pass
    return replay


@pytest.mark.slow
def test_a_replay_is_equal_to_the_bit(log: Path) -> None:
    comparison = replayed(log).comparison
    assert comparison.equal > 150
    assert (comparison.different, comparison.uncertain) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "codec",
    [
        Codec("opus", channels=2),
        Codec("opus", channels=1),
        Codec("pcm16", packet_size=240),
    ],
)
def test_losses_late_packets_and_every_codec_are_replayed_to_the_bit(
    tmp_path: Path, model: Path, codec: Codec
) -> None:
    network = NetworkProfile(delay=0.01, jitter=0.004)
    lossy = cycle([False] * 7 + [True] * 2 + [False] * 3 + [True])
    comparison = replayed(
        record(tmp_path / "a.mcap", model, codec=codec, lost=lossy, network=network)
    ).comparison
    assert comparison.equal > 150
    assert comparison.different == 0


def test_predictions_made_on_the_robot_are_replayed_to_the_bit(
    tmp_path: Path, model: Path
) -> None:
    comparison = replayed(record(tmp_path / "a.mcap", model, remote=True)).comparison
    assert comparison.equal > 150
    assert comparison.different == 0


@pytest.mark.slow
def test_mutes_ceilings_profiles_and_thresholds_set_meanwhile_are_replayed_to_the_bit(
    tmp_path: Path, model: Path
) -> None:
    def meanwhile(operator: RecordedOperator, now: float) -> None:
        operator.gate.output_level = 0.5 if now > 0.6 else 1.0
        operator.gate.muted_because = "muted" if 0.7 < now < 0.8 else ""
        if now > 0.85:
            operator.endpoint.pipeline.detector.threshold.dbfs = -30.0
        if 0.9 < now < 0.91:
            from tactophone.signal.haptics.profiles import open_profile

            operator.endpoint.pipeline.profile = open_profile("perceptual")

    path = record(tmp_path / "a.mcap", model, meanwhile=meanwhile)
    comparison = replayed(path).comparison
    assert comparison.equal > 150
    assert comparison.different == 0
    logged = [entry for entry in read_log(path) if isinstance(entry, LoggedPrediction)]
    assert any(
        each.command.amplitude == 0 and each.prediction.touch is Touch.ROUGH
        for each in logged
    )


def test_another_profile_or_ceiling_is_computed_instead(log: Path) -> None:
    replay = Replay(
        read_log(log), lambda settings: change(settings, ["rendering.ceiling=0.1"])
    )
    commands = [command for step in replay.steps() for command in step.commands]
    assert max(command.amplitude for command in commands) == pytest.approx(0.1)
    assert replay.comparison.different > 20


def test_a_replay_writes_the_files_of_feel(tmp_path: Path, log: Path) -> None:
    (rendered,) = write_replay(Replay(read_log(log)), tmp_path, "run")
    summary, files = rendered.summary, rendered.files
    vibration, rate = soundfile.read(files["vibration"])
    assert summary.duration == pytest.approx(2.0, abs=0.01)
    assert len(vibration) / rate == pytest.approx(2.1, abs=0.02)
    assert abs(vibration).max() <= 0.5


def test_the_sound_is_that_which_was_decoded(tmp_path: Path, model: Path) -> None:
    path = record(tmp_path / "a.mcap", model, codec=Codec("pcm16", packet_size=240))
    (blocks,) = decoded_sessions(read_log(path))
    sound, rate = soundfile.read(write_sound(path, tmp_path)[0].path, always_2d=True)
    assert rate == 48_000
    assert (sound == joined(blocks)).all()
    assert abs(len(sound) - 96_000) <= 240


def test_opus_is_repackaged_so_that_one_decoder_a_microphone_plays_it(
    tmp_path: Path, model: Path
) -> None:
    path = add_sound(
        record(tmp_path / "a.mcap", model, codec=Codec("opus")), tmp_path / "sound.mcap"
    )
    for topic in ("/tactophone/sound/contact", "/tactophone/sound/air"):
        packets = decoded(path, topic)
        assert {packet.format for packet in packets} == {"opus"}
        decoder = open_decoder(PayloadType.OPUS)
        sound = [decoder.decode(packet.data) for packet in packets]
        assert sum(map(len, sound)) == pytest.approx(96_000, abs=480)
        assert {len(part) for part in sound[:-1]} == {960}
        assert 0.2 < max(abs(part).max() for part in sound) < 0.8


def test_foxgloves_own_schemas_read_the_sound(tmp_path: Path, model: Path) -> None:
    path = record(tmp_path / "a.mcap", model, codec=Codec("pcm16", packet_size=240))
    assert not messages(path, "/tactophone/sound")
    sound = decoded(add_sound(path, tmp_path / "sound.mcap"), "/tactophone/sound")
    assert (sound[0].format, sound[0].sample_rate, sound[0].number_of_channels) == (
        "pcm-s16",
        48_000,
        2,
    )
    assert len(sound[0].data) == 960 * 4
    times = [
        message.timestamp.seconds + message.timestamp.nanos / 1e9 for message in sound
    ]
    assert np.diff(times) == pytest.approx(0.02, abs=1e-3)


def test_a_copy_with_sound_is_the_same_log(tmp_path: Path, log: Path) -> None:
    path = add_sound(log, tmp_path / "sound.mcap")
    assert list(read_log(path)) == list(read_log(log))
    with pytest.raises(ConfigError, match="the log itself"):
        add_sound(log, log)


def indexed(path: Path) -> dict[str, int]:
    """Messages of each topic by the library's indexed reader, which must be the one
    that is chosen."""
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file)
        assert isinstance(reader, mcap_reader.SeekingReader)
        assert reader.get_summary().chunk_indexes
        return dict(Counter(channel.topic for _, channel, _ in reader.iter_messages()))


def written(path: Path) -> dict[str, int]:
    return dict(
        Counter(
            message.topic.name
            for message in read_messages(path)
            if isinstance(message, Message)
        )
    )


def test_the_indexed_reader_returns_every_message(log: Path) -> None:
    assert indexed(log) == written(log)
    assert indexed(log)["/tactophone/prediction"] > 150


@needs_node
def test_the_indexed_reader_of_javascript_returns_every_message(log: Path) -> None:
    done = subprocess.run(
        ["node", NODE / "read_mcap.mjs", log],
        check=True,
        capture_output=True,
        text=True,
    )
    assert json.loads(done.stdout) == written(log)


@pytest.mark.parametrize(
    "topic", [topic for topic in TOPICS if topic.schema.encoding == "jsonschema"]
)
def test_viewers_can_read_the_schemas(topic: Topic) -> None:
    """By the rules of Lichtblick, packages/mcap-support/src/parseJsonSchema.ts; it
    refuses a topic otherwise."""

    def check(part: dict[str, Any]) -> None:
        if part["type"] == "object":
            for each in part["properties"].values():
                check(each)
        elif part["type"] == "array":
            assert "contentEncoding" not in part["items"]
            check(part["items"])
        else:
            assert part["type"] in ("boolean", "string", "number", "integer")

    check(json.loads(topic.schema.data))


def test_events_and_state_can_be_read(tmp_path: Path, log: Path) -> None:
    run = json.loads(messages(log, "/tactophone/run")[0])
    assert run["role"] == "operator"
    assert len(next(iter(run["models"].values()))) == 64
    assert {"tactophone", "numpy", "onnxruntime"} <= set(run["versions"])


def test_the_end_of_a_fault_is_an_event_for_logs_and_bridges(tmp_path: Path) -> None:
    name = f"test-{tmp_path.name}"
    gone = Fault("actuator", "the JACK server is gone")
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        for faults in ((gone,), (gone,), (), ()):
            telemetry.update(RunState("operator", faults=faults), now=0.0)
            log.read()
    events = [
        json.loads(data) for data in messages(tmp_path / "a.mcap", "/tactophone/events")
    ]
    found = [(each["level"], each["message"]) for each in events]
    warning, info = 3, 2
    assert [each for each in found if "JACK" in each[1]] == [
        (warning, "the JACK server is gone"),
        (info, "over: the JACK server is gone"),
    ]


@pytest.mark.parametrize(
    ("kind", "name"), [(McapLog, "run.mcap"), (PredictionLog, "run.csv")]
)
def test_the_log_that_another_run_writes_is_left_to_it(
    kind: type[McapLog] | type[PredictionLog], name: str, tmp_path: Path
) -> None:
    """The first run went on writing into a file without a name, and said nothing."""
    run = f"test-{tmp_path.name}"
    path = tmp_path / name
    with Telemetry(run) as telemetry:
        telemetry.update(RunState(), now=0.0)
        with kind(run, path):
            inode = path.stat().st_ino
            with pytest.raises(ConfigError, match="another run is writing it"):
                kind(run, path).__enter__()
            assert path.stat().st_ino == inode
        with kind(run, path):  # as a service does that starts again
            pass


def test_a_threshold_that_follows_the_noise_floor_is_no_event_at_each_read(
    tmp_path: Path,
) -> None:
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        for threshold in (-40.4, -40.6, -40.2, -37.0):
            telemetry.update(
                RunState(
                    "operator",
                    fingers=(
                        FingerState(
                            threshold_dbfs=threshold, noise_floor_dbfs=threshold
                        ),
                    ),
                ),
                now=0.0,
            )
            log.read()
    texts = [
        json.loads(data)["message"]
        for data in messages(tmp_path / "a.mcap", "/tactophone/events")
    ]
    assert [text for text in texts if "threshold" in text] == [
        "threshold_dbfs: -40.4",
        "threshold_dbfs: -37.0",
    ]
    assert len(messages(tmp_path / "a.mcap", "/tactophone/state")) == 2


def test_counters_and_gauges_are_written_regularly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.live.log.reader.HEALTH_INTERVAL", 0.0)
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        log.read()
        telemetry.count("steps", 3)
        telemetry.gauge("jitter", 1 / 3000)
        log.read()
    first, second = [
        json.loads(data) for data in messages(tmp_path / "a.mcap", "/tactophone/health")
    ]
    assert len(first["counters"]) > 10
    assert second["counters"]["steps"] == 3
    assert second["gauges"]["jitter"] == 1 / 3000


def test_each_chunk_reaches_the_disk(tmp_path: Path, model: Path) -> None:
    name = f"test-{tmp_path.name}"
    with Telemetry(name), McapLog(name, tmp_path / "a.mcap") as log:
        before = (tmp_path / "a.mcap").stat().st_size
        for _ in range(CHUNK_INTERVAL):
            log.read()
        assert (tmp_path / "a.mcap").stat().st_size > before
        (end,) = [
            entry
            for entry in read_log(tmp_path / "a.mcap")
            if isinstance(entry, LogEnd)
        ]
        assert not end.complete


def test_a_power_failure_takes_less_than_a_second_of_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system kept all of a log in memory for half a minute."""
    on_disk: list[int] = []
    monkeypatch.setattr(
        os, "fsync", lambda descriptor: on_disk.append(os.fstat(descriptor).st_size)
    )
    name = f"test-{tmp_path.name}"
    path = tmp_path / "a.mcap"
    with Telemetry(name), McapLog(name, path) as log:
        for _ in range(CHUNK_INTERVAL):
            log.read()
        assert on_disk == [path.stat().st_size]
    assert on_disk[-1] == path.stat().st_size


def test_a_message_longer_than_its_compressed_log_is_read(tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    with LogFile(path, TOPICS) as log:
        log.write(Message(TOPICS[0], 1.0, b" " * 50_000))
        log.write(Message(TOPICS[0], 2.0, b"{}"))
    assert path.stat().st_size < 50_000
    *found, end = read_messages(path)
    assert [message.time for message in found] == [1.0, 2.0]
    assert end.complete


def test_a_full_disk_ends_the_log_with_one_line(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(writer: Writer) -> None:
        raise OSError(28, "No space left on device")

    name = f"test-{tmp_path.name}"
    with Telemetry(name), McapLog(name, tmp_path / "a.mcap") as log:
        monkeypatch.setattr(Writer, "flush", full)
        for _ in range(CHUNK_INTERVAL - 1):
            log.read()
        with pytest.raises(
            ConfigError, match=r"No space left on device\); the run goes on"
        ):
            log.read()


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    name = f"test-{tmp_path.name}"
    with (
        Telemetry(name),
        pytest.raises(ConfigError, match="--record"),
        McapLog(name, tmp_path / "no" / "a.mcap"),
    ):
        pass
    with (
        Telemetry(name),
        pytest.raises(ConfigError, match="--record"),
        McapLog(name, Path("/dev/full")),
    ):
        pass


def test_a_part_that_was_not_read_in_time_is_reported_and_the_rest_is_read(
    tmp_path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry, McapLog(name, path) as log:
        for _ in range(layout.LOG_CAPACITY // layout.LARGEST_RECORD + 2):
            telemetry.log(bytes(layout.LARGEST_RECORD))
        log.read()
    end = list(read_log(path))[-1]
    assert isinstance(end, LogEnd)
    assert end.complete
    assert end.missed["log"] > 0


def test_a_reader_within_a_run_counts_from_where_it_began(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry:
        for _ in range(layout.LOG_CAPACITY // layout.LARGEST_RECORD + 2):
            telemetry.log(bytes(layout.LARGEST_RECORD))
        with McapLog(name, path) as log:
            log.read()
            assert log.lost() == ""
    end = list(read_log(path))[-1]
    assert isinstance(end, LogEnd)
    assert not any(end.missed.values())


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    share=st.floats(0, 1),
    flipped=st.floats(0, 1),
    value=st.integers(0, 255),
    cut=st.booleans(),
)
def test_a_cut_or_changed_log_is_read_as_far_as_it_goes_or_refused_in_one_line(
    log: Path,
    tmp_path_factory: pytest.TempPathFactory,
    share: float,
    flipped: float,
    value: int,
    cut: bool,
) -> None:
    content = bytearray(log.read_bytes())
    if cut:
        del content[int(share * len(content)) :]
    else:
        content[min(int(flipped * len(content)), len(content) - 1)] = value
    path = tmp_path_factory.mktemp("broken") / "a.mcap"
    path.write_bytes(content)
    error: DatasetError | None = None
    try:
        *_, end = read_log(path)
        assert isinstance(end, LogEnd)
    except DatasetError as refusal:
        error = refusal
    assert error is None or (str(path) in str(error) and "\n" not in str(error))


def test_logs_of_others_and_of_the_future_are_refused(tmp_path: Path) -> None:
    from mcap.writer import Writer

    for profile, words in (
        ("ros2", "another program"),
        ("tactophone 9", "version that wrote"),
    ):
        path = tmp_path / f"{profile}.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile=profile)
            writer.finish()
        assert is_mcap(path)
        with pytest.raises(DatasetError, match=words):
            list(read_log(path))
    (tmp_path / "a.wav").write_bytes(b"RIFF")
    assert not is_mcap(tmp_path / "a.wav")
    with pytest.raises(DatasetError, match="not an MCAP"):
        list(read_log(tmp_path / "a.wav"))
    with pytest.raises(DatasetError, match="No such file"):
        list(read_log(tmp_path / "none.mcap"))


def some_predictions() -> list[tuple[Prediction, HapticCommand]]:
    rows = np.zeros(3, PREDICTION_RECORD)
    rows["window_end"], rows["window_start"] = (
        (0.256, 0.266, 0.279),
        (0.0, 0.01, 0.0230001),
    )
    rows["time"] = rows["window_end"] + 1 / 2823
    rows["none"], rows["smooth"], rows["rough"] = np.transpose(
        [[1, 0, 0], [0.1, 0.2, 0.7], [1e-30, 1 / 3, 2 / 3]]
    )
    rows["level_dbfs"], rows["roughness"], rows["touch"] = (
        (-np.inf, -21.234, 0),
        (0, 0.7, 0.123456),
        (0, 2, 1),
    )
    rows["amplitude"], rows["frequency"] = (np.nan, 0.25, 0.5), (np.nan, 60.02, 120)
    rows["event"][1], rows["event_time"][1] = 1 + EVENT_KINDS.index("slip"), 0.25
    return [prediction_of(row) for row in rows]


def test_a_log_holds_the_exact_numbers_of_a_prediction(tmp_path: Path) -> None:
    name, rows = f"test-{tmp_path.name}", some_predictions()
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        for prediction, command in rows:
            block = AudioBlock(np.zeros((1, 2), np.float32), 48_000)
            telemetry.publish(PipelineStep(block, (prediction,), (command,)), now=0.0)
        log.read()
    found = [
        entry
        for entry in read_log(tmp_path / "a.mcap")
        if isinstance(entry, LoggedPrediction)
    ]
    assert [entry.prediction for entry in found] == [
        prediction for prediction, _ in rows
    ]
    for (_, command), logged in zip(rows, found, strict=True):
        np.testing.assert_equal(astuple(logged.command), astuple(command))


def test_the_last_bit_of_any_number_makes_a_difference() -> None:
    _, (prediction, command), _ = some_predictions()
    none, smooth, rough = prediction.probabilities
    for changed, command_now in (
        (
            replace(
                prediction, probabilities=(none, smooth, float(np.nextafter(rough, 1)))
            ),
            command,
        ),
        (
            replace(prediction, roughness=float(np.nextafter(prediction.roughness, 1))),
            command,
        ),
        (replace(prediction, end=float(np.nextafter(prediction.end, 1))), command),
        (
            prediction,
            replace(command, amplitude=float(np.nextafter(command.amplitude, 1))),
        ),
    ):
        comparison = Comparison()
        logged = LoggedPrediction(prediction, command)
        comparison.add(logged, LoggedPrediction(changed, command_now), certain=True)
        comparison.add(logged, LoggedPrediction(changed, command_now), certain=False)
        comparison.add(logged, logged, certain=True)
        assert (comparison.equal, comparison.different, comparison.uncertain) == (
            1,
            1,
            1,
        )


def misfits(value: Any, schema: dict[str, Any], place: str = "") -> list[str]:
    """Return where a value leaves its JSON Schema, of the few keywords that ours
    use."""
    assert set(schema) <= {"title", "type", "properties", "items"}
    kinds = {
        "number": (int, float),
        "integer": int,
        "string": str,
        "boolean": bool,
        "object": dict,
        "array": list,
    }
    fits = isinstance(value, kinds[schema["type"]]) and isinstance(value, bool) == (
        schema["type"] == "boolean"
    )
    if not fits:
        return [f"{place}: {value!r} is no {schema['type']}"]
    if isinstance(value, list):
        return [
            found
            for each in value
            for found in misfits(each, schema["items"], f"{place}[]")
        ]
    known = schema.get("properties", {})
    inside = (
        [(key, each) for key, each in value.items() if key in known]
        if isinstance(value, dict)
        else []
    )
    return [
        found
        for key, each in inside
        for found in misfits(each, known[key], f"{place}.{key}")
    ]


def test_every_message_fits_the_schema_in_the_same_file(log: Path) -> None:
    with log.open("rb") as file:
        found = [
            (channel.topic, misfit)
            for schema, channel, message in mcap_reader.make_reader(
                file
            ).iter_messages()
            if schema.encoding == "jsonschema"
            for misfit in misfits(json.loads(message.data), json.loads(schema.data))
        ]
    assert not found
    assert len(messages(log, "/tactophone/prediction")) > 150


def test_the_schema_of_the_state_has_every_key_of_its_messages(log: Path) -> None:
    """Viewers plot what the schema names, such as whether a run is armed."""
    (topic,) = (each for each in TOPICS if each.name == "/tactophone/state")
    named = json.loads(topic.schema.data)["properties"]
    logged = messages(log, "/tactophone/state")
    assert logged
    assert {"armed", "muted_because"} <= set(named)
    for message in logged:
        assert set(json.loads(message)) <= set(named)


def test_a_prediction_without_a_command_equals_itself_and_is_valid_json() -> None:
    first, second, _ = some_predictions()
    comparison = Comparison()
    comparison.add(LoggedPrediction(*first), LoggedPrediction(*first), certain=True)
    assert comparison.equal == 1
    assert "level_dbfs" not in json.loads(encoded(*first))
    assert json.loads(encoded(*second))["event"] == "slip"


def test_a_log_is_written_through_no_link_and_only_its_user_reads_it(
    tmp_path: Path,
) -> None:
    victim, path = tmp_path / "victim", tmp_path / "run.mcap"
    victim.write_text("mine")
    for link in (os.symlink, os.link):
        link(victim, path)
        with LogFile(path, []):
            pass
        assert victim.read_text() == "mine"
        assert path.stat().st_mode & 0o777 == 0o600
        path.unlink()


def test_the_disk_lacks_less_than_a_second_after_a_kill() -> None:
    assert LOG_READ_INTERVAL * CHUNK_INTERVAL < 1.0
