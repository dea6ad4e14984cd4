from pathlib import Path

import numpy as np
import pytest
from lerobot_camera_tactophone.picture import (
    BANDS,
    HIGHEST,
    LOWEST,
    SIZE,
    STRIP,
    Picture,
)
from lerobot_camera_tactophone.sound import LiveSound, LoggedSound

from tactophone import Prediction, Touch
from tactophone.live.telemetry.writer import Telemetry
from tests.live.log.recorded_run import RecordedOperator, record
from tests.models import write_tiny_model
from tests.sounds import blocks


def tone(hertz: float, seconds: float, channel: int = 0) -> np.ndarray:
    sound = np.zeros((round(48_000 * seconds), 2), np.float32)
    sound[:, channel] = 0.3 * np.sin(2 * np.pi * hertz * np.arange(len(sound)) / 48_000)
    return sound


@pytest.mark.parametrize("hertz", [500.0, 2000.0, 10_000.0])
@pytest.mark.parametrize("channel", [0, 1])
def test_a_tone_is_a_bright_row_of_its_microphone(hertz: float, channel: int) -> None:
    picture = Picture()
    picture.hear(tone(hertz, 2.2, channel))
    row = int(np.argmax(picture.pixels[:, 100].astype(int)))
    expected = (
        BANDS * (channel + 1)
        - 1
        - BANDS * np.log(hertz / LOWEST) / np.log(HIGHEST / LOWEST)
    )
    assert row == pytest.approx(expected, abs=2)


def test_the_picture_is_the_same_however_the_sound_is_cut() -> None:
    sound = np.random.default_rng(0).normal(0, 0.1, (100_000, 2)).astype(np.float32)
    whole, parts = Picture(), Picture()
    whole.hear(sound)
    for part in np.array_split(sound, 37):
        parts.hear(part)
    assert whole.pixels.shape == (SIZE, SIZE)
    assert np.abs(whole.pixels.astype(int) - parts.pixels).max() <= 1


def test_the_strip_holds_roughness_and_amplitude() -> None:
    picture = Picture()
    picture.feel(
        Prediction(
            probabilities=(0.0, 0.2, 0.8),
            touch=Touch.ROUGH,
            roughness=0.8,
            start=0.0,
            end=0.1,
            level_dbfs=-20.0,
        ),
        0.4,
    )
    picture.hear(tone(100, 0.1))
    assert picture.pixels[2 * BANDS : 2 * BANDS + STRIP, -1].tolist() == [204] * STRIP
    assert picture.pixels[2 * BANDS + STRIP :, -1].tolist() == [102] * STRIP


def test_a_log_is_drawn_frame_by_frame(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    log = record(tmp_path / "run.mcap", write_tiny_model(tmp_path / "tiny.onnx"))
    picture = Picture()
    sound = LoggedSound(log, picture, fps=30)
    for _ in range(30):
        sound.draw()
    assert picture.pixels[: 2 * BANDS].max() > 60


def test_a_live_run_that_sends_nothing_is_a_dark_picture() -> None:
    now = [0.0]
    with Telemetry("test-camera") as _:
        picture = Picture()
        picture.hear(tone(1000, 2.1))
        sound = LiveSound("test-camera", picture, clock=lambda: now[0])
        now[0] = 3.0
        sound.draw()
        assert picture.pixels[: 2 * BANDS].max() == 0


@pytest.mark.parametrize("paused", [False, True])
def test_a_camera_joins_a_run_whose_log_has_wrapped_and_goes_on_after_a_pause(
    tmp_path: Path, paused: bool
) -> None:
    """A minute of PCM fills the session log several times over."""
    model = write_tiny_model(tmp_path / "tiny.onnx")
    silent = np.zeros((48_000 * 60, 1), np.float32)
    sound = np.concatenate([silent, tone(1000, 3)[:, :1]])
    picture = Picture()
    now = [0.0]
    live: list[LiveSound] = []

    def meanwhile(operator: RecordedOperator, time: float) -> None:
        now[0] = time
        if not live and (paused or time >= 60):
            live.append(LiveSound(operator.run, picture, clock=lambda: now[0]))
        if time < 1 or time >= 60:
            for each in live:
                each.draw()

    record(tmp_path / "run.mcap", model, sound=blocks(sound, 960), meanwhile=meanwhile)
    contact = picture.pixels[:BANDS, 100:].astype(int)
    row = int(np.argmax(contact.mean(axis=1)))
    expected = BANDS - 1 - BANDS * np.log(1000 / LOWEST) / np.log(HIGHEST / LOWEST)
    assert row == pytest.approx(expected, abs=2)


def test_the_camera_is_one_of_lerobots() -> None:
    pytest.importorskip("lerobot.cameras.camera")
    from lerobot.cameras.configs import CameraConfig
    from lerobot_camera_tactophone import TactophoneCamera, TactophoneCameraConfig

    assert CameraConfig.get_choice_class("tactophone") is TactophoneCameraConfig
    with (
        Telemetry("test-camera-2") as _,
        TactophoneCamera(TactophoneCameraConfig(run="test-camera-2")) as camera,
    ):
        assert camera.async_read().shape == (SIZE, SIZE, 3)
