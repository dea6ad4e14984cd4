import functools

import numpy as np
import pytest

from tactophone.core.settings import Settings, change
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.live.runtime.wiring import microphone_faults
from tactophone.signal.perception.fit import (
    EDGES,
    FIT_SPACING,
    TOUCH_MEMORY,
    FitCheck,
    Misfit,
)
from tactophone.signal.perception.models import default_model, open_touch_detector
from tactophone.signal.pipeline import open_pipeline_for
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES

RATE = 48_000
SECONDS = 8


@functools.cache
def stroked(tip: str) -> FloatArray:
    scene = single(find("lava stone"))
    moves = take_moves(
        TAKES[1], scene.placed[0], duration=SECONDS, rng=np.random.default_rng(1)
    )
    session = SessionVariation.of_tip(tip, 1)
    finger = SimulatedFinger(
        scene, moves, session=session, seed=1, place=scene.placed[0].centre
    )
    return finger.render(SECONDS * RATE).samples


def limited(sound: FloatArray, highest: float) -> FloatArray:
    spectrum = np.fft.rfft(sound, axis=0)
    spectrum[round(highest * len(sound) / RATE) :] = 0
    return np.asarray(np.fft.irfft(spectrum, axis=0), np.float32)


def misfit(sound: FloatArray, tip: str, model: str = "") -> Misfit | None:
    detector = open_touch_detector(
        model or default_model(tip), sample_rate=RATE, follow_floor=True
    )
    for start in range(0, len(sound), 4800):
        detector.push(AudioBlock(sound[start : start + 4800], RATE, start))
    return detector.misfit


def test_a_touch_that_stays_unknown_is_noticed_in_one_sentence() -> None:
    check, rng = (
        FitCheck("texture", 16_000, tip="", air=False),
        np.random.default_rng(0),
    )
    said = set()
    for _ in range(2000):
        check.push(
            0.1 * rng.standard_normal((1, 512)).astype(np.float32), touching=True
        )
        check.hear((0.0, 0.5, 0.5) if rng.random() < 0.8 else (0.0, 0.0, 1.0))
        said |= {check.misfit} if check.misfit else set()
    (misfit,) = said  # one sentence, as each new one is printed
    assert misfit.code == "undecided"


@pytest.mark.slow
@pytest.mark.parametrize("tip", ["pad", "stylus"])
def test_the_right_sound_fits(tip: str) -> None:
    assert misfit(stroked(tip), tip) is None


@pytest.mark.slow
@pytest.mark.parametrize(("tip", "highest"), [("pad", 1.2), ("stylus", 1.7)])
def test_a_missing_band_is_named(tip: str, highest: float) -> None:
    found = misfit(limited(stroked(tip), 1200), tip)
    assert found
    assert found.code == "narrow-band"
    assert found.text.startswith(f"no sound above {highest} kHz")


@pytest.mark.parametrize(
    ("sound", "tip", "kinds", "other"),
    [
        ("stylus", "pad", "hard tip", "--tip plastic or --tip stylus"),
        ("pad", "stylus", "soft tip", "--tip rubber or"),
    ],
)
def test_a_tip_of_the_other_kind_is_named(
    sound: str, tip: str, kinds: str, other: str
) -> None:
    found = misfit(stroked(sound), tip)
    assert found
    assert found.code == "other-tip"
    assert kinds in found.text
    assert other in found.text


def test_another_tip_is_noticed_within_seconds() -> None:
    found = misfit(stroked("stylus")[: 4 * RATE], "pad")
    assert found
    assert found.code == "other-tip"


def test_a_pad_is_noticed_under_a_model_for_rubber() -> None:
    found = misfit(stroked("pad"), "rubber")
    assert found
    assert found.text.endswith("--tip pad")


def motor() -> FloatArray:
    random, time = np.random.default_rng(1), np.arange(SECONDS * RATE) / RATE
    tones = sum(
        np.sin(2 * np.pi * 110 * harmonic * time) / harmonic**0.7
        for harmonic in range(1, 31)
    )
    sound = (
        0.02
        * tones[:, None]
        * (np.sin(2 * np.pi * 0.5 * time) > 0)[:, None]
        * np.array([0.1, 1])
    )
    return np.float32(sound + 2e-4 * random.standard_normal((len(time), 2)))


@pytest.mark.slow
@pytest.mark.parametrize("tip", ["pad", "stylus"])
def test_a_motor_is_no_other_tip(tip: str) -> None:
    found = misfit(motor(), tip)
    assert found is None or found.code != "other-tip"


def test_a_motor_at_the_contact_microphone_alone_is_no_other_tip() -> None:
    found = misfit(motor()[:, :1], "pad")
    assert found is None or found.code != "other-tip"


@pytest.mark.slow
def test_one_microphone_is_right_where_the_model_uses_one() -> None:
    air = stroked("stylus")[:, 1:]
    assert misfit(np.repeat(air, 2, axis=1), "stylus") is None
    assert misfit(air, "stylus") is None
    assert misfit(stroked("pad")[:, :1], "pad") is None


def test_noise_that_hides_the_touch_is_named() -> None:
    sound = np.tile(stroked("pad"), (2, 1))
    sound = np.float32(
        sound + 0.07 * np.random.default_rng(0).standard_normal(sound.shape)
    )
    detector, codes = (
        open_touch_detector("texture", sample_rate=RATE, follow_floor=True),
        set(),
    )
    for start in range(0, len(sound), 4800):
        detector.push(AudioBlock(sound[start : start + 4800], RATE, start))
        codes |= {detector.misfit and detector.misfit.code}
    assert codes == {None, "noisy"}


@pytest.mark.slow
def test_a_notice_ends_when_the_sound_fits_again_and_changes_no_prediction() -> None:
    sound = np.concatenate(
        (limited(stroked("pad"), 1200), stroked("pad"), stroked("pad"))
    )
    checked, plain = (
        open_touch_detector("texture", sample_rate=RATE, follow_floor=True)
        for _ in range(2)
    )
    plain.window_detector.fit = None
    codes = []
    for start in range(0, len(sound), 4800):
        block = AudioBlock(sound[start : start + 4800], RATE, start)
        assert checked.push(block) == plain.push(block)
        codes.append(checked.misfit and checked.misfit.code)
    assert "narrow-band" in codes
    assert codes[-1] is None


@pytest.mark.slow
def test_a_notice_reaches_a_live_run_without_muting_it() -> None:
    pipeline = open_pipeline_for(change(Settings(), ["capture.tip=pad"]), channels=2)
    sound = limited(stroked("pad"), 1200)
    amplitudes = [
        command.amplitude
        for start in range(0, len(sound), 4800)
        for command in pipeline.push(
            AudioBlock(sound[start : start + 4800], RATE, start)
        ).commands
    ]
    assert [fault.code for fault in microphone_faults(pipeline.detector)] == [
        "narrow-band"
    ]
    assert max(amplitudes[-200:]) > 0


def test_all_windows_within_the_memory_of_touch_count_alike() -> None:
    check = FitCheck("texture", 16_000)
    sound = np.random.default_rng(0).normal(0, 0.1, (1, 4096)).astype(np.float32)
    for number in range(FIT_SPACING * TOUCH_MEMORY):
        is_quiet = number < FIT_SPACING * TOUCH_MEMORY // 2
        check.push(sound * np.float32(0.25 if is_quiet else 1.0), touching=True)
    values, windows = check.description()
    bands = len(EDGES) - 1
    assert windows == TOUCH_MEMORY
    # Half of the windows are 12 dB louder, so each is 6 dB from the mean.
    assert values[bands : 2 * bands] == pytest.approx(6.0, abs=0.1)
