import csv
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.capture import FileSource
from tactophone.haptics import Limits
from tactophone.offline.process_recording import TAIL, Outputs, Summary, feel
from tactophone.pipeline import open_pipeline
from tests.models import write_tiny_model
from tests.sounds import noise, tone


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A second of quiet, then a second of rough."""
    samples = np.concatenate([noise(level_dbfs=-80, channels=1), tone(400)])
    soundfile.write(tmp_path / "rough.wav", samples, 48_000, subtype="FLOAT")
    return tmp_path / "rough.wav"


def felt(recording: Path, *, block_size: int = 4096, ceiling: float = 1.0) -> tuple[Summary, Outputs]:
    model = str(write_tiny_model(recording.parent / "tiny.onnx"))
    outputs = Outputs.beside(recording.parent, f"out{block_size}", json=True)
    source = FileSource(recording, block_size=block_size)
    walk = open_pipeline(
        model, sample_rate=source.sample_rate, channels=source.channels, limits=Limits(ceiling=ceiling)
    )
    return feel(source, walk, outputs)[0], outputs


def test_the_vibration_is_as_long_as_the_sound_and_its_fade(recording: Path) -> None:
    _, outputs = felt(recording)
    wave, rate = soundfile.read(outputs.waveform)
    assert rate == 48_000
    assert len(wave) == round((2 + TAIL) * rate)
    assert not wave[:48_000].any()
    assert np.abs(wave[72_000:96_000]).max() > 0.99
    assert not wave[-480:].any()


def test_the_files_do_not_depend_on_the_blocks_read(recording: Path) -> None:
    _, one = felt(recording, block_size=4096)
    _, other = felt(recording, block_size=509)
    assert one.timeline.read_bytes() == other.timeline.read_bytes()
    assert one.waveform.read_bytes() == other.waveform.read_bytes()


def test_the_summary_sums_up(recording: Path) -> None:
    summary, outputs = felt(recording)
    lines = list(csv.DictReader(outputs.timeline.open()))
    assert summary.duration == 2
    assert summary.updates == len(lines)
    assert summary.contact == pytest.approx(sum(line["contact"] == "1" for line in lines) / len(lines))
    assert summary.rough > 0.9
    assert summary.loudest_dbfs == pytest.approx(-9, abs=0.1)
    assert summary.faults == {}


def test_the_ceiling_holds_in_the_file(recording: Path) -> None:
    _, outputs = felt(recording, ceiling=0.25)
    assert np.abs(soundfile.read(outputs.waveform)[0]).max() <= 0.25


def test_garbage_is_summed_up_as_a_fault(recording: Path) -> None:
    samples, rate = soundfile.read(recording, dtype="float32")
    samples[70_000] = np.nan
    soundfile.write(recording, samples, rate, subtype="FLOAT")
    summary, _ = felt(recording)
    assert summary.faults["sound"] > 0
