"""Recordings as tables, live steps, and detectors and actuators of other packages."""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.cli import main
from tactophone.core.errors import ConfigError, ModelError
from tactophone.core.settings import Settings, change
from tactophone.live.runtime.wiring import open_actuator
from tactophone.signal.perception.health import FaultDetector
from tactophone.signal.perception.opening import tip_warning
from tactophone.signal.pipeline import open_pipeline_for

PACKAGE = """
from collections import Counter
from tactophone import ContactThreshold, Prediction, Touch

class Loud:
    name, latency, bandwidth = "loud", 0.0, 8000.0
    def __init__(self, sample_rate, channels):
        self.faults = Counter()
        self.threshold = ContactThreshold(-40.0)
        self.given = (sample_rate, channels)
    def push(self, block):
        end = block.end / block.sample_rate
        return [Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 0.9, -10.0, block.time, end)]
    def flush(self):
        return []
    def reset(self):
        pass

class Silent:
    device = None
    def __init__(self, render, fingers, device):
        self.given = fingers, device
    def __enter__(self):
        return self
    def __exit__(self, *_):
        pass
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    samples = np.random.default_rng(0).normal(scale=0.1, size=(48_000, 2)).clip(-1, 1)
    samples[:24_000] *= 1e-4
    soundfile.write(tmp_path / "finger.wav", samples, 48_000)
    return tmp_path / "finger.wav"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install a package with a detector and an actuator, as pip does."""
    (tmp_path / "loud_touch.py").write_text(PACKAGE)
    metadata = tmp_path / "loud_touch-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: loud-touch\nVersion: 1.0\n"
    )
    (metadata / "entry_points.txt").write_text(
        "[tactophone.detectors]\nloud = loud_touch:Loud\n[tactophone.actuators]\nglove "
        "= loud_touch:Silent\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("loud_touch", None)


def test_a_recording_becomes_arrays_and_a_csv_file_as_feel_writes_it(
    recording: Path, tmp_path: Path
) -> None:
    table = tactophone.classify(recording)
    assert (
        len(table) == len(table.times) == len(table.touch) == len(table.roughness) > 50
    )
    assert np.all(np.diff(table.times) >= 0)
    assert table.touch[table.times < 0.45].max() == tactophone.Touch.NONE
    assert set(table.touch[table.times > 0.8].tolist()) <= {1, 2}
    assert table.level_dbfs[-1] > table.level_dbfs[5] + 40
    table.to_csv(tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["roughness"]) for row in rows] == pytest.approx(
        table.roughness.tolist(), abs=1e-6
    )
    assert main(["feel", str(recording), "--out", str(tmp_path)]) == 0
    header = next((tmp_path / "finger.timeline.csv").open())
    assert header.strip().split(",") == list(rows[0])


@pytest.mark.slow
def test_a_table_is_drawn_and_becomes_a_data_frame(recording: Path) -> None:
    pytest.importorskip("matplotlib")
    pandas = pytest.importorskip("pandas")
    table = tactophone.classify(recording, events=True)
    assert len(table.plot().axes) == 3
    frame = table.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert set(frame["touch"]) <= {"none", "smooth", "rough"}
    assert len(frame) == len(table)
    assert len(table.events) >= 1


@pytest.mark.slow
def test_live_sound_is_iterated_or_calls_back(recording: Path) -> None:
    steps = list(tactophone.open_live(f"file:{recording}"))
    assert sum(len(step.predictions) for step in steps) > 50
    called: list[tactophone.PipelineStep] = []
    run = tactophone.open_live(f"file:{recording}").start(called.append)
    run.stop()
    before = len(called)
    assert len(list(tactophone.open_live(f"file:{recording}"))) > before


def test_what_does_not_exist_is_one_line(recording: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean finger"):
        tactophone.open_live("fingr")
    with pytest.raises(ModelError, match="channels = 3"):
        tactophone.open_pipeline(sample_rate=48_000, channels=3)
    with pytest.raises(
        ConfigError, match=r"no column roughnes.*did you mean roughness"
    ):
        tactophone.classify(recording).column("roughnes")


def test_sound_of_three_channels_is_one_clear_error_everywhere() -> None:
    block = tactophone.AudioBlock(np.zeros((48_000, 3), np.float32), 48_000)
    pipeline = tactophone.open_pipeline(sample_rate=48_000, channels=2)
    for push in (
        pipeline.push,
        tactophone.open_detector(
            tactophone.DetectorOptions(sample_rate=48_000, channels=2)
        ).push,
        FaultDetector(48_000).push,
    ):
        with pytest.raises(
            ModelError, match=r"channels = 3, but a finger has 1 .* or 2"
        ):
            push(block)


@pytest.mark.usefixtures("package")
def test_a_detector_and_an_actuator_of_another_package_are_found_by_name(
    recording: Path,
) -> None:
    table = tactophone.classify(recording, "loud")
    assert set(table.roughness) == {0.9}
    settings = change(
        Settings(),
        ["detector.model=loud", "output.actuator=glove", "output.device=left"],
    )
    pipeline = open_pipeline_for(settings, channels=1)
    assert (pipeline.detector.name, pipeline.detector.given) == ("loud", (48_000, 1))  # type: ignore[attr-defined]
    assert tip_warning(settings) == ""
    assert open_actuator(settings, lambda outs: None).given == (1, "left")  # type: ignore[attr-defined]
    assert main(["model", "show", "loud"]) == 1  # not a model file


def test_an_actuator_that_nobody_registered_is_one_line() -> None:
    with pytest.raises(ConfigError, match="it is one of jack"):
        change(Settings(), ["output.actuator=glove"])
