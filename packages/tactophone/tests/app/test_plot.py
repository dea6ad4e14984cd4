from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app.plot import draw_recording
from tactophone.app.vibration_wav import OutputFiles, process_recording
from tactophone.core.recordings.values import Segment
from tactophone.live.audio.files import FileSource
from tactophone.signal.pipeline import open_pipeline
from tests.models import write_tiny_model
from tests.sounds import noise

pytest.importorskip("matplotlib")


@pytest.mark.slow
@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("duration", [0.01, 1.0])
def test_a_figure_of_any_recording(
    tmp_path: Path, channels: int, duration: float
) -> None:
    soundfile.write(
        tmp_path / "a.wav", noise(duration=duration, channels=channels), 48_000
    )
    model = str(write_tiny_model(tmp_path / "tiny.onnx", channels=channels))
    outputs = OutputFiles.in_folder(tmp_path, "a")
    source = FileSource(tmp_path / "a.wav")
    _, renderer = process_recording(
        source, open_pipeline(model, sample_rate=48_000, channels=channels), outputs
    )
    truth = (
        [Segment(0.0, duration / 2, "rough"), Segment(duration / 2, duration, "none")]
        if channels == 2
        else []
    )
    figure = tmp_path / "a.png"
    draw_recording(
        figure,
        timeline=outputs.timeline,
        microphones=renderer.microphones,
        vibration=renderer.vibration,
        title="a.wav",
        truth=truth,
    )
    pixels = _pixels(figure)
    assert pixels.shape[1] == 1430
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 20


def _pixels(path: Path) -> np.ndarray:
    from matplotlib import image

    return image.imread(path)
