import csv
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app.vibration_wav import (
    VIBRATION_TAIL,
    OutputFiles,
    RunSummary,
    process_recording,
)
from tactophone.core.types import Profile
from tactophone.live.audio.files import FileSource
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import GateProfile
from tactophone.signal.pipeline import open_pipeline
from tests.models import write_tiny_model
from tests.sounds import noise, tone


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A second of quiet, then a second of rough."""
    samples = np.concatenate([noise(level_dbfs=-80, channels=1), tone(400)])
    soundfile.write(tmp_path / "rough.wav", samples, 48_000, subtype="FLOAT")
    return tmp_path / "rough.wav"


def process(
    recording: Path,
    *,
    block_size: int = 4096,
    ceiling: float = 1.0,
    profile: Profile | None = None,
    duration: float = 0.0,
) -> tuple[RunSummary, OutputFiles]:
    model = str(write_tiny_model(recording.parent / "tiny.onnx"))
    outputs = OutputFiles.in_folder(recording.parent, f"out{block_size}", json=True)
    source = FileSource(recording, block_size=block_size)
    pipeline = open_pipeline(
        model,
        sample_rate=source.sample_rate,
        channels=source.channels,
        limits=Limits(ceiling=ceiling),
    )
    pipeline.profile = profile or pipeline.profile
    summary, _ = process_recording(source, pipeline, outputs, duration=duration)
    return summary, outputs


def test_the_vibration_is_as_long_as_the_sound_and_its_fade(recording: Path) -> None:
    _, outputs = process(recording)
    wave, rate = soundfile.read(outputs.waveform)
    assert rate == 48_000
    assert len(wave) == round((2 + VIBRATION_TAIL) * rate)
    assert not wave[:48_000].any()
    assert np.abs(wave[72_000:96_000]).max() > 0.99
    assert not wave[-480:].any()


def test_the_sound_itself_fades_after_its_end_too(recording: Path) -> None:
    _, outputs = process(recording, profile=GateProfile("direct"))
    wave, rate = soundfile.read(outputs.waveform)
    assert len(wave) == round((2 + VIBRATION_TAIL) * rate)
    assert not wave[:48_000].any()  # noise, without contact
    spectrum = np.abs(np.fft.rfft(wave[72_000:96_000]))
    assert spectrum.argmax() * 2 == 400  # Hz
    assert not wave[-480:].any()


def test_a_vibration_of_many_hours_is_a_wav_without_a_limit(recording: Path) -> None:
    for duration, expected in ((8.0, "WAV"), (8.4, "WAVEX")):  # h; of RF64 when short
        _, outputs = process(recording, duration=duration * 3600)
        assert soundfile.info(outputs.waveform).format == expected
        assert len(soundfile.read(outputs.waveform)[0]) == 100_800


def test_the_files_do_not_depend_on_the_blocks_read(recording: Path) -> None:
    _, first = process(recording, block_size=4096)
    _, second = process(recording, block_size=509)
    assert first.timeline.read_bytes() == second.timeline.read_bytes()
    assert first.waveform.read_bytes() == second.waveform.read_bytes()


def test_the_summary_holds_the_totals(recording: Path) -> None:
    summary, outputs = process(recording)
    lines = list(csv.DictReader(outputs.timeline.open()))
    assert summary.duration == 2
    assert summary.updates == len(lines)
    assert summary.contact == pytest.approx(
        sum(line["contact"] == "1" for line in lines) / len(lines)
    )
    assert summary.rough > 0.9
    assert summary.loudest_dbfs == pytest.approx(-9, abs=0.1)
    assert summary.faults == {}


def test_the_ceiling_holds_in_the_file(recording: Path) -> None:
    _, outputs = process(recording, ceiling=0.25)
    assert np.abs(soundfile.read(outputs.waveform)[0]).max() <= 0.25


def test_invalid_samples_are_counted_as_a_fault(recording: Path) -> None:
    samples, rate = soundfile.read(recording, dtype="float32")
    samples[70_000] = np.nan
    soundfile.write(recording, samples, rate, subtype="FLOAT")
    summary, _ = process(recording)
    assert summary.faults["sound"] > 0
