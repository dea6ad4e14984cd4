import numpy as np
import pytest

from tactophone.perception.features import real_fft as module
from tactophone.perception.features.real_fft import real_fft


@pytest.mark.parametrize("shape", [(512,), (2, 512), (5, 2, 512), (2, 511)])
def test_it_is_numpys_bit_for_bit_with_and_without_the_shorter_way(
    shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = np.random.default_rng(0).standard_normal(shape, np.float32)
    expected = np.fft.rfft(sound).tolist()
    assert real_fft(sound).tolist() == expected
    assert real_fft(sound[..., ::-1][..., ::-1]).tolist() == expected
    monkeypatch.setattr(module, "_transform", None)
    assert real_fft(sound).tolist() == expected
