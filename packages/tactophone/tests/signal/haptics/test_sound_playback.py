import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray, HapticCommand
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.sound_playback import open_playback
from tests.sounds import blocks, tone

HALF = Limits(ceiling=0.5)


def played(
    sound: FloatArray, *, opened: float = 0.0, closed: float = 9.0, rate: int = 48_000
) -> FloatArray:
    """Play a sound by ``direct``, with a gate that is open between two times in s, and
    0.1 s more."""
    playback = open_playback("direct", HALF, channels=1, sample_rate=rate)
    waves = []
    for block in blocks(sound, rate // 100, sample_rate=rate):
        command = HapticCommand(float(opened <= block.time < closed), 0.0, block.time)
        playback.hear(block)
        end = block.end / rate
        waves.append(playback.push([command], until=end))
    return np.concatenate([*waves, playback.push([], until=end + 0.1)])


@pytest.mark.parametrize("rate", [2_000, 11_025, 44_100, 48_000, 96_000])
def test_the_sound_itself_is_rendered_without_a_gap_at_any_rate(rate: int) -> None:
    wave = played(tone(200, duration=0.5, sample_rate=rate), rate=rate)
    assert len(wave) == pytest.approx(28_800, abs=2)
    felt = wave[4_800:24_000]
    assert 0.3 < np.abs(felt).max() <= 0.5
    spectrum = np.abs(np.fft.rfft(felt * np.hanning(len(felt))))
    assert spectrum.argmax() / 0.4 == pytest.approx(200, abs=3)
    # A sine of 200 Hz rests nowhere for 1 ms; a gap would.
    assert np.abs(felt).reshape(-1, 240).max(axis=1).min() > 0.3


def test_commands_gate_it_and_it_fades_after_the_last_one() -> None:
    wave = played(tone(200, duration=0.5), opened=0.1, closed=0.3)
    assert not wave[:4_800].any()
    assert np.abs(wave[9_600:14_400]).max() > 0.3
    assert not wave[20_000:].any()
    to_the_end = played(tone(200, duration=0.5))
    assert np.abs(to_the_end[23_000:24_000]).max() > 0.3
    assert not to_the_end[-480:].any()


def test_sound_keeps_its_place_after_a_gap_and_after_what_was_skipped() -> None:
    def onset(start: int, *, skipped: bool) -> int:
        playback = open_playback("direct", HALF, channels=1, sample_rate=48_000)
        if skipped:
            playback.skip(start / 48_000)
        playback.hear(AudioBlock(tone(200, duration=0.1), 48_000, start))
        opening = HapticCommand(1.0, 0.0, start / 48_000)
        wave = playback.push([opening], until=start / 48_000 + 0.03)
        return int(np.flatnonzero(np.abs(wave) > 0.05)[0])

    at_once = onset(0, skipped=False)
    assert onset(960, skipped=False) - 960 == pytest.approx(at_once, abs=12)
    assert onset(48_000, skipped=True) == at_once


def test_a_profile_of_commands_is_a_sine() -> None:
    playback = open_playback("graded", HALF, channels=1, sample_rate=48_000)
    assert isinstance(playback.renderer, Oscillator)
