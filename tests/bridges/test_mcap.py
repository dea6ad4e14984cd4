import io
import json
import signal
import subprocess
import sys
import time
from dataclasses import astuple, replace
from itertools import cycle, takewhile
from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from tactophone.bridges import LogEnd, LoggedPrediction, McapLog, is_mcap, read_log
from tactophone.bridges.mcap_log import CHUNK_INTERVAL
from tactophone.bridges.prediction_rows import RowChecks, entries_of, read_columns, write_columns
from tactophone.errors import ConfigError, DatasetError
from tactophone.link import Codec, open_decoder
from tactophone.link.packet import PayloadType
from tactophone.offline.replay import Comparison, Replay, decoded_sessions, joined, write_replay, write_sound
from tactophone.settings import change
from tactophone.simulation.network import NetworkProfile
from tactophone.telemetry import PREDICTION, RunStart, State, Telemetry, layout
from tactophone.types import EVENT_KINDS, HapticCommand, Prediction, Touch, prediction_of
from tests.bridges.recorded_run import RecordedOperator, record
from tests.models import write_tiny_model

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


def messages(path: Path, topic: str) -> list[bytes]:
    with path.open("rb") as file:
        return [message.data for _, channel, message in mcap_reader.make_reader(file).iter_messages(topics=[topic])]


def test_a_replay_is_equal_to_the_bit(log: Path) -> None:
    comparison = replayed(log).comparison
    assert comparison.equal > 150
    assert (comparison.different, comparison.uncertain) == (0, 0)


@pytest.mark.parametrize(
    "codec", [Codec("opus", channels=2), Codec("opus", channels=1), Codec("pcm16", packet_size=240)]
)
def test_losses_late_packets_and_every_codec_are_replayed_to_the_bit(tmp_path: Path, model: Path, codec: Codec) -> None:
    network = NetworkProfile(delay=0.01, jitter=0.004)
    lossy = cycle([False] * 7 + [True] * 2 + [False] * 3 + [True])
    comparison = replayed(record(tmp_path / "a.mcap", model, codec=codec, lost=lossy, network=network)).comparison
    assert comparison.equal > 150
    assert comparison.different == 0


def test_predictions_made_on_the_robot_are_replayed_to_the_bit(tmp_path: Path, model: Path) -> None:
    comparison = replayed(record(tmp_path / "a.mcap", model, remote=True)).comparison
    assert comparison.equal > 150
    assert comparison.different == 0


def test_mutes_ceilings_profiles_and_thresholds_set_meanwhile_are_replayed_to_the_bit(
    tmp_path: Path, model: Path
) -> None:
    def meanwhile(operator: RecordedOperator, now: float) -> None:
        operator.gate.output_level = 0.5 if now > 0.6 else 1.0
        operator.gate.muted_because = "muted" if 0.7 < now < 0.8 else ""
        if now > 0.85:
            operator.endpoint.pipeline.threshold_dbfs = -30.0
        if 0.9 < now < 0.91:
            from tactophone.haptics import open_profile

            operator.endpoint.pipeline.profile = open_profile("perceptual")

    path = record(tmp_path / "a.mcap", model, meanwhile=meanwhile)
    comparison = replayed(path).comparison
    assert comparison.equal > 150
    assert comparison.different == 0
    logged = [entry for entry in read_log(path) if isinstance(entry, LoggedPrediction)]
    assert any(each.command.amplitude == 0 and each.prediction.touch is Touch.ROUGH for each in logged)


def test_another_profile_or_ceiling_is_computed_instead(log: Path) -> None:
    replay = Replay(read_log(log), lambda settings: change(settings, ["rendering.ceiling=0.1"]))
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


def test_opus_is_repackaged_so_that_one_decoder_a_microphone_plays_it(tmp_path: Path, model: Path) -> None:
    from tactophone.bridges import protobuf

    path = record(tmp_path / "a.mcap", model, codec=Codec("opus"))
    for topic in ("/tactophone/sound/contact", "/tactophone/sound/air"):
        packets = [dict(protobuf.fields(data)) for data in messages(path, topic)]
        assert {packet[3] for packet in packets} == {b"opus"}
        decoder = open_decoder(PayloadType.OPUS)
        sound = [decoder.decode(bytes(packet[2])) for packet in packets]  # type: ignore[arg-type]
        assert sum(map(len, sound)) == pytest.approx(96_000, abs=480)
        assert 0.2 < max(abs(part).max() for part in sound) < 0.8


def test_foxgloves_own_schemas_read_the_sound(tmp_path: Path, model: Path) -> None:
    descriptor_pb2 = pytest.importorskip("google.protobuf.descriptor_pb2")
    descriptor_pool = pytest.importorskip("google.protobuf.descriptor_pool")
    factory = pytest.importorskip("google.protobuf.message_factory")
    path = record(tmp_path / "a.mcap", model, codec=Codec("pcm16", packet_size=240))
    with path.open("rb") as file:
        summary = mcap_reader.make_reader(file).get_summary()
    for schema in summary.schemas.values():
        if schema.encoding == "protobuf":
            pool = descriptor_pool.DescriptorPool()
            for described in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                pool.Add(described)
            kind = factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            if schema.name == "foxglove.RawAudio":
                audio = kind.FromString(messages(path, "/tactophone/sound")[0])
                assert (audio.format, audio.sample_rate, audio.number_of_channels) == ("pcm-s16", 48_000, 2)
                assert len(audio.data) == 240 * 4
            if schema.name == "tactophone.Packets":
                packets = kind.FromString(messages(path, "/tactophone/packets")[-1])
                assert len(packets.delays) == sum(arrival.count or 1 for arrival in packets.arrivals) > 10
            if schema.name == "tactophone.Predictions":
                rows = kind.FromString(messages(path, "/tactophone/predictions")[0])
                assert len(rows.window_end) <= len(rows.check) - 8 > 10


def test_events_and_state_can_be_read(tmp_path: Path, log: Path) -> None:
    run = json.loads(messages(log, "/tactophone/run")[0])
    assert run["role"] == "operator"
    assert len(next(iter(run["models"].values()))) == 64
    assert {"tactophone", "numpy", "onnxruntime"} <= set(run["versions"])


def test_a_threshold_that_follows_the_noise_floor_is_no_event_at_each_read(tmp_path: Path) -> None:
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        for threshold in (-40.4, -40.6, -40.2, -37.0):
            telemetry.update(State(role="operator", threshold_dbfs=threshold, noise_floor_dbfs=threshold), now=0.0)
            log.read()
    texts = [json.loads(data)["message"] for data in messages(tmp_path / "a.mcap", "/tactophone/events")]
    assert [text for text in texts if "threshold" in text] == ["threshold_dbfs: -40.4", "threshold_dbfs: -37.0"]
    assert len(messages(tmp_path / "a.mcap", "/tactophone/state")) == 2


def test_counters_that_do_not_change_are_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactophone.bridges.run_reader.HEALTH_INTERVAL", 0.0)
    name = f"test-{tmp_path.name}"
    with Telemetry(name) as telemetry, McapLog(name, tmp_path / "a.mcap") as log:
        log.read()
        telemetry.count("steps", 3)
        telemetry.gauge("jitter", 1 / 3000)
        log.read()
    first, second = [json.loads(data) for data in messages(tmp_path / "a.mcap", "/tactophone/health")]
    assert len(first["counters"]) > 10
    assert second == {"counters": {"steps": 3}, "gauges": {"jitter": 0.0003333}}


def test_each_chunk_reaches_the_disk(tmp_path: Path, model: Path) -> None:
    name = f"test-{tmp_path.name}"
    with Telemetry(name), McapLog(name, tmp_path / "a.mcap") as log:
        before = (tmp_path / "a.mcap").stat().st_size
        for _ in range(CHUNK_INTERVAL):
            log.read()
        assert (tmp_path / "a.mcap").stat().st_size > before
        (end,) = [entry for entry in read_log(tmp_path / "a.mcap") if isinstance(entry, LogEnd)]
        assert not end.complete


def test_a_full_disk_ends_the_log_with_one_line(tmp_path: Path, model: Path) -> None:
    class Full(io.BytesIO):
        def write(self, data: object) -> int:
            raise OSError(28, "No space left on device")

    name = f"test-{tmp_path.name}"
    with Telemetry(name), McapLog(name, tmp_path / "a.mcap") as log:
        log._writer._file = Full()
        for _ in range(CHUNK_INTERVAL - 1):
            log.read()
        with pytest.raises(ConfigError, match=r"No space left on device\); the run goes on"):
            log.read()


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    name = f"test-{tmp_path.name}"
    with Telemetry(name), pytest.raises(ConfigError, match="--record"), McapLog(name, tmp_path / "no" / "a.mcap"):
        pass
    with Telemetry(name), pytest.raises(ConfigError, match="--record"), McapLog(name, Path("/dev/full")):
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
    assert end.missed > 0


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1), flipped=st.floats(0, 1), value=st.integers(0, 255), cut=st.booleans())
def test_a_cut_or_changed_log_is_read_as_far_as_it_goes_or_refused_in_one_line(
    log: Path, tmp_path_factory: pytest.TempPathFactory, share: float, flipped: float, value: int, cut: bool
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

    for profile, words in (("ros2", "another program"), ("tactophone 9", "version that wrote")):
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
    rows = np.zeros(3, PREDICTION)
    rows["window_end"], rows["window_start"] = (0.256, 0.266, 0.279), (0.0, 0.01, 0.0230001)
    rows["time"] = rows["window_end"] + 1 / 2823
    rows["none"], rows["smooth"], rows["rough"] = np.transpose([[1, 0, 0], [0.1, 0.2, 0.7], [1e-30, 1 / 3, 2 / 3]])
    rows["level_dbfs"], rows["roughness"], rows["touch"] = (-np.inf, -21.234, 0), (0, 0.7, 0.123456), (0, 2, 1)
    rows["amplitude"], rows["frequency"] = (np.nan, 0.25, 0.5), (np.nan, 60.02, 120)
    rows["event"][1], rows["event_time"][1] = 1 + EVENT_KINDS.index("slip"), 0.25
    return [prediction_of(row) for row in rows]


def test_columns_hold_predictions_rounded_with_check_values_of_their_exact_numbers() -> None:
    rows, checks = some_predictions(), RowChecks()
    for (prediction, command), logged in zip(rows, read_columns(write_columns(rows)), strict=True):
        assert logged.check == checks.add(prediction, command)
        assert logged.total == (checks.total() if command is rows[-1][1] else b"")
        found = logged.prediction
        assert found.probabilities == pytest.approx(prediction.probabilities, abs=1e-3)
        assert (found.touch, found.events) == (prediction.touch, prediction.events)
        assert found.level_dbfs == pytest.approx(prediction.level_dbfs, abs=0.51)
        for exact, rounded in ((prediction.start, found.start), (prediction.end, found.end)):
            assert rounded == pytest.approx(exact, abs=1.1e-5)
        for exact, rounded in zip(astuple(command), astuple(logged.command), strict=True):
            assert rounded == pytest.approx(exact, abs=0.051, nan_ok=True)


def checks_of(prediction: Prediction, command: HapticCommand) -> tuple[bytes, bytes]:
    checks = RowChecks()
    return checks.add(prediction, command), checks.total()


def test_the_last_bit_of_any_number_changes_the_check_values() -> None:
    _, (prediction, command), _ = some_predictions()
    none, smooth, rough = prediction.probabilities
    row, total = checks_of(prediction, command)
    for changed, command_now in (
        (replace(prediction, probabilities=(none, smooth, np.nextafter(rough, 1))), command),
        (replace(prediction, roughness=np.nextafter(prediction.roughness, 1)), command),
        (replace(prediction, end=np.nextafter(prediction.end, 1)), command),
        (prediction, replace(command, amplitude=np.nextafter(command.amplitude, 1))),
    ):
        assert checks_of(changed, command_now)[0] != row
        assert checks_of(changed, command_now)[1] != total
    assert checks_of(prediction, replace(command, amplitude=-0.0)) == checks_of(
        prediction, replace(command, amplitude=0.0)
    )


def test_a_row_whose_own_check_value_agrees_by_chance_is_found_by_that_of_all() -> None:
    (prediction, command), checks = some_predictions()[1], RowChecks()
    first = LoggedPrediction(prediction, command, check=checks.add(prediction, command))
    last = LoggedPrediction(prediction, command, check=checks.add(prediction, command), total=checks.total())
    changed = next(
        candidate
        for step in range(1, 5000)
        if checks_of(candidate := replace(prediction, roughness=step / 5000), command)[0] == first.check
    )
    for computed, certain, counts in (
        (prediction, True, (2, 0, 0)), (changed, True, (1, 1, 0)), (changed, False, (1, 0, 1)),
    ):  # fmt: skip
        comparison = Comparison()
        comparison.add(first, LoggedPrediction(computed, command), certain=certain)
        comparison.add(last, LoggedPrediction(prediction, command), certain=certain)
        assert (comparison.equal, comparison.different, comparison.uncertain) == counts


def test_a_prediction_to_look_at_is_valid_json_and_an_unknown_event_is_refused() -> None:
    first, second, _ = some_predictions()
    assert json.loads(json.dumps(entries_of(*first), allow_nan=False))["level_dbfs"] is None
    assert entries_of(*second)["event"] == "slip"
    with pytest.raises(ValueError, match="not in tuple"):
        list(read_columns(write_columns([second]).replace(b"slip", b"poke")))


@pytest.mark.realtime
@pytest.mark.parametrize("victim", ["run", "everything"])
def test_a_killed_run_leaves_a_log_that_replays_to_the_bit(tmp_path: Path, victim: str) -> None:
    from tests.bridges.killed_run import start_loopback

    with start_loopback(tmp_path) as (process, watcher):
        time.sleep(0.5)
        if victim == "run":
            watcher.kill(signal.SIGKILL)
            time.sleep(1.0)
        newest = watcher.newest_prediction()
        for pid in watcher.family():
            subprocess.run(["kill", "-9", str(pid)], check=False)
        process.wait()
    done = subprocess.run(
        [sys.executable, "-m", "tactophone", "replay", str(tmp_path / "run.mcap"), "--json"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, (done.returncode, done.stdout, done.stderr)
    outcome = json.loads(done.stdout)
    assert outcome["different"] == 0
    assert outcome["equal"] >= 100
    _, *entries = read_log(tmp_path / "run.mcap")
    # The process that replaces a killed one counts its times from 0 again.
    first_process = takewhile(lambda entry: not isinstance(entry, RunStart), entries)
    ends = [entry.prediction.end for entry in first_process if isinstance(entry, LoggedPrediction)]
    assert newest - ends[-1] < 1.0
