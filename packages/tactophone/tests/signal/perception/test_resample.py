import numpy as np
import pytest

from tactophone.signal.perception.resample import Resampler, design_kernels
from tests.sounds import ODD_SIZES, blocks, noise, tone


def resample(
    samples: np.ndarray, size: int, *, input_rate: int = 48_000, output_rate: int = 2000
) -> np.ndarray:
    resampler = Resampler(input_rate, output_rate, channels=samples.shape[1])
    pieces = [
        resampler.push(block.samples)
        for block in blocks(samples, size, sample_rate=input_rate)
    ]
    return np.concatenate([*pieces, resampler.flush()])


@pytest.mark.parametrize("input_rate", [2200, 44_100, 48_000, 96_000])
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(input_rate: int, size: int) -> None:
    samples = noise(duration=0.2)
    whole = resample(samples, len(samples), input_rate=input_rate)
    assert np.array_equal(resample(samples, size, input_rate=input_rate), whole)


@pytest.mark.parametrize(
    ("input_rate", "output_rate"),
    [(2200, 2000), (44_100, 2000), (48_000, 2000), (44_100, 16_000)],
)
def test_a_tone_in_the_band_keeps_level_and_phase(
    input_rate: int, output_rate: int
) -> None:
    output = resample(
        tone(200, sample_rate=input_rate),
        480,
        input_rate=input_rate,
        output_rate=output_rate,
    )
    expected = tone(200, sample_rate=output_rate)
    middle = slice(output_rate // 10, -output_rate // 10)
    assert len(output) == output_rate
    assert np.abs(output[middle] - expected[middle]).max() < 0.5 * 10 ** (-50 / 20)


def test_a_tone_beyond_the_band_is_removed() -> None:
    assert np.abs(resample(tone(1400), 480)[100:-100]).max() < 0.5 * 10 ** (-40 / 20)


@pytest.mark.parametrize("input_rate", [2200, 44_100, 48_000])
def test_an_impulse_is_complete_after_the_declared_latency(input_rate: int) -> None:
    resampler = Resampler(input_rate, 2000, channels=1)
    impulse = np.zeros((input_rate, 1), np.float32)
    place = input_rate // 2
    impulse[place] = 1
    returned = 0
    for block in blocks(impulse, 1, sample_rate=input_rate):
        output = resampler.push(block.samples)
        returned += len(output)
        if returned > 1000:
            assert block.start - place == round(resampler.latency * input_rate)
            return
    pytest.fail("the sample at the impulse's place never came")


def test_reset_equals_new() -> None:
    samples = noise(duration=0.1)
    resampler = Resampler(48_000, 2000, channels=2)
    first = resampler.push(samples)
    resampler.reset()
    assert np.array_equal(resampler.push(samples), first)


def test_rates_under_the_lowest_are_refused() -> None:
    with pytest.raises(ValueError, match="1000 to 2000 Hz"):
        design_kernels(1000, 2000)
