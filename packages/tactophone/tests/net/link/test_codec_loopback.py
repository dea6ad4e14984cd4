import numpy as np
import pytest

from tactophone.net.link.codec import Codec, encode_and_decode


@pytest.mark.parametrize(
    "codec", [Codec("pcm16", channels=2), Codec("opus", channels=2, packet_size=480)]
)
def test_sound_comes_back_with_its_length_and_aligned(codec: Codec) -> None:
    time = np.arange(10_007) / 48_000
    sound = np.stack(
        [0.5 * np.sin(2 * np.pi * 200 * time), 0.1 * np.sin(2 * np.pi * 330 * time)],
        axis=1,
    )
    back = encode_and_decode(sound.astype(np.float32), codec)
    assert back.shape == sound.shape
    # The first packets are the coder's own fade-in.
    settled = slice(2000, -480)
    for channel in range(2):
        assert np.corrcoef(sound[settled, channel], back[settled, channel])[0, 1] > 0.98
