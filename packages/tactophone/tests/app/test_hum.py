import numpy as np
import pytest

from tactophone.app.hum import Hum, HumMeter
from tactophone.core.types import FloatArray
from tests.sounds import noise


def mains(
    frequency: float, rate: int, *, duration: float, harmonics: tuple[int, ...] = (1, 3)
) -> FloatArray:
    """Hum at -20 dBFS or so."""
    time = np.arange(round(duration * rate)) / rate
    return np.sum(
        [0.1 / k * np.cos(2 * np.pi * k * frequency * time + k) for k in harmonics],
        axis=0,
    ).astype("f4")


def measured(samples: FloatArray, rate: int, *, size: int = 4096) -> Hum | None:
    meter = HumMeter(rate, samples.shape[1])
    for start in range(0, len(samples), size):
        meter.push(samples[start : start + size])
    return meter.hum()


@pytest.mark.parametrize("rate", [8000, 16_000, 44_100, 48_000])
@pytest.mark.parametrize("frequency", [50.0, 50.1, 59.95])
def test_hum_is_found_at_its_true_frequency_and_subtracted(
    frequency: float, rate: int
) -> None:
    wanted = mains(frequency, rate, duration=6.3)
    sound = noise(level_dbfs=-40, duration=7, channels=1)[: len(wanted), 0]
    hum = measured(np.stack((wanted + sound, sound), axis=1), rate)
    assert hum
    assert hum.mains == round(frequency)
    assert hum.level_dbfs == pytest.approx(20 * np.log10(wanted.std()), abs=0.2)
    assert hum.frequency[:, 0] == pytest.approx([frequency, 3 * frequency], abs=0.01)
    found = hum.waveform(0, len(wanted))
    left = np.sqrt(np.square(found[:, 0] - wanted).mean())
    assert left < 0.02 * wanted.std()
    assert not found[:, 1].any(), "the other channel has no hum"


def test_hum_that_comes_and_goes_in_loudness_is_followed() -> None:
    rate, wanted = 16_000, mains(50, 16_000, duration=8, harmonics=(1,))
    wanted *= np.linspace(1, 0.2, len(wanted), dtype="f4")
    sound = noise(level_dbfs=-50, duration=8, channels=1)[: len(wanted)]
    hum = measured(wanted[:, None] + sound, rate)
    assert hum
    assert np.abs(hum.waveform(0, len(wanted))[:, 0] - wanted).max() < 0.01


def test_its_waveform_does_not_depend_on_the_block_size() -> None:
    samples = mains(50, 16_000, duration=4)[:, None]
    first, second = measured(samples, 16_000), measured(samples, 16_000, size=777)
    assert first
    assert second
    whole = first.waveform(0, 5000)
    assert (second.waveform(0, 5000) == whole).all()
    assert first.waveform(1234, 100) == pytest.approx(whole[1234:1334], abs=1e-6)


def test_what_is_no_hum_is_none() -> None:
    rate = 16_000
    time = np.arange(6 * rate) / rate
    strokes = (
        noise(level_dbfs=-20, duration=6, channels=1)[: len(time), 0]
        * np.sin(np.pi * time) ** 2
    )
    assert measured(strokes[:, None].astype("f4"), rate) is None
    # A mesh under a finger whose speed changes: a tone that passes 50 and 100 Hz.
    tone = 0.1 * np.cos(
        2 * np.pi * np.cumsum(80 + 50 * np.sin(2 * np.pi * time / 3)) / rate
    )
    assert measured((tone + 0.1 * strokes)[:, None].astype("f4"), rate) is None
    assert measured(np.zeros((len(time), 1), "f4"), rate) is None
    assert measured(np.full((len(time), 1), np.nan, "f4"), rate) is None
    assert measured(mains(50, rate, duration=2)[:, None], rate) is None, (
        "too short to tell hum from a tone"
    )


@pytest.mark.parametrize("frequency", [50.0, 50.08])
def test_a_loud_stroke_leaves_no_hum_in_the_silence_beside_it(frequency: float) -> None:
    rate = 16_000
    wanted = mains(frequency, rate, duration=6, harmonics=(1, 2, 3, 5, 7)) / 2
    sound = noise(level_dbfs=-60, duration=6, channels=1)[: len(wanted)]
    stroke = slice(2 * rate, 4 * rate)
    sound[stroke] = noise(level_dbfs=-20, duration=2, channels=1)[: 2 * rate]
    hum = measured(wanted[:, None] + sound, rate)
    assert hum
    left = hum.waveform(0, len(wanted))[:, 0] - wanted
    left[stroke] = 0
    assert 20 * np.log10(np.abs(left).std()) < -75, "15 dB under the silence"
