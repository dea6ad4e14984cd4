from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.errors import ConfigError
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import (
    Passthrough,
    is_passthrough,
    open_passthrough,
    passthrough_names,
)
from tests.passthroughs import ALL_PASSTHROUGHS, install_plugin
from tests.sounds import ODD_SIZES, noise, tone

FULL = Limits(ceiling=1.0)


def peak_frequency(wave: np.ndarray) -> float:
    return float(
        np.abs(np.fft.rfft(wave * np.hanning(len(wave)))).argmax() * 48_000 / len(wave)
    )


@pytest.mark.parametrize("name", ALL_PASSTHROUGHS)
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(name: str, size: int) -> None:
    sound = noise(duration=0.1)
    passthrough = ALL_PASSTHROUGHS[name](FULL)
    whole = passthrough.push(sound)
    passthrough.reset()
    pieces = [
        passthrough.push(sound[start : start + size])
        for start in range(0, len(sound), size)
    ]
    assert np.concatenate(pieces).tolist() == whole.tolist()


@pytest.mark.parametrize("name", ALL_PASSTHROUGHS)
def test_nothing_more_after_a_whole_number_of_steps_is_silence_not_an_error(
    name: str,
) -> None:
    sound = noise(duration=0.1)
    assert len(sound) % 12 == 0
    passthrough = ALL_PASSTHROUGHS[name](FULL)
    rendered = passthrough.push(sound)
    assert len(passthrough.push(sound[:0])) == 0
    assert len(rendered) + len(passthrough.push(noise(duration=0.001))) > len(rendered)


def test_direct_keeps_a_low_tone_and_pitch_lowers_a_high_one_by_three_octaves() -> None:
    direct = Passthrough(limits=FULL).render_whole(tone(200))[12_000:-4800]
    assert peak_frequency(direct) == pytest.approx(200, abs=3)
    shifted = ALL_PASSTHROUGHS["pitch"](FULL).render_whole(tone(1600, duration=2.0))[
        24_000:-4800
    ]
    assert peak_frequency(shifted) == pytest.approx(200, abs=35)


def test_what_no_finger_feels_is_gone() -> None:
    assert np.abs(Passthrough(limits=FULL).render_whole(tone(6000))[4800:]).max() < 0.01


def test_an_expander_closes_on_noise() -> None:
    loud, quiet = (
        float(
            np.sqrt(
                np.square(
                    Passthrough(limits=FULL).render_whole(noise(level_dbfs=level))[
                        4800:
                    ]
                ).mean()
            )
        )
        for level in (-30, -60)
    )
    assert 20 * np.log10(loud / quiet) > 30 + 20


def test_transients_are_sharpened() -> None:
    sound = tone(150, amplitude=0.02)
    sound[24_000:24_480] *= 4
    flat = Passthrough(limits=FULL).render_whole(sound)
    before, burst = (
        float(np.abs(flat[part]).max())
        for part in (slice(18_000, 23_000), slice(24_000, 25_000))
    )
    assert burst > 2 * before


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_garbage_never_passes_the_ceiling(value: float) -> None:
    sound = noise(level_dbfs=-6)
    sound[1000:1200] = value
    wave = ALL_PASSTHROUGHS["pitch"](Limits(ceiling=0.5)).render_whole(sound)
    assert np.isfinite(wave).all()
    assert np.abs(wave).max() <= 0.5


def test_latency_is_as_declared() -> None:
    click = np.zeros((9600, 1), np.float32)
    click[4800:4808] = 0.5
    first = (
        int(
            np.flatnonzero(np.abs(Passthrough(limits=FULL).render_whole(click)) > 1e-3)[
                0
            ]
        )
        - 4800
    )
    assert abs(first / 48_000 - Passthrough(limits=FULL).latency) < 2e-3


def test_the_median_frequency_of_the_sound_is_the_frequency_felt() -> None:
    both = 0.05 * (tone(120) + 1.2 * tone(480))
    for sound, median in ((tone(150), 150), (tone(700), 700), (both, 480)):
        felt = ALL_PASSTHROUGHS["median-frequency"](FULL).render_whole(sound)[
            12_000:-4800
        ]
        assert peak_frequency(felt) == pytest.approx(median, abs=12)


def test_a_median_outside_the_actuators_band_is_felt_within_it() -> None:
    felt = ALL_PASSTHROUGHS["median-frequency"](FULL).render_whole(
        noise(level_dbfs=-20)
    )[12_000:-4800]
    assert FULL.lowest < peak_frequency(felt) < FULL.highest


def test_the_median_frequency_is_silent_on_silence() -> None:
    assert (
        np.abs(
            ALL_PASSTHROUGHS["median-frequency"](FULL).render_whole(0 * tone(200))
        ).max()
        == 0.0
    )


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the plug-in, and a passthrough under the name of a built-in profile."""
    install_plugin(tmp_path, monkeypatch, "graded = tactophone_passthroughs:PitchShift")
    return tmp_path


def test_a_plug_in_adds_passthroughs_and_replaces_no_profile(plugin: Path) -> None:
    assert passthrough_names() == ("direct", "median-frequency", "pitch")
    assert is_passthrough("pitch")
    assert not is_passthrough("graded")
    sound = noise(duration=0.1)
    expected = ALL_PASSTHROUGHS["pitch"](FULL).render_whole(sound)
    assert open_passthrough("pitch", FULL).render_whole(sound).tolist() == (
        expected.tolist()
    )


def test_feel_renders_what_a_plug_in_adds(plugin: Path) -> None:
    sound = noise(duration=1.0)
    sound[:24_000] *= 1e-4  # quiet before the touch
    soundfile.write(plugin / "finger.wav", sound, 48_000)
    arguments = ["feel", str(plugin / "finger.wav"), "--out", str(plugin)]
    assert main([*arguments, "--profile", "pitch"]) == 0
    assert (plugin / "finger.haptic.wav").exists()


def test_without_the_plug_in_its_names_are_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="no passthrough 'pitch'; there are direct"):
        open_passthrough("pitch")


def test_a_whole_sound_is_rendered_as_if_nothing_came_before() -> None:
    before = Passthrough(limits=FULL)
    before.push(tone(100))
    sound = tone(200)
    fresh = Passthrough(limits=FULL).render_whole(sound)
    assert (before.render_whole(sound) == fresh).all()
