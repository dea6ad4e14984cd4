from pathlib import Path

import numpy as np
import soundfile

from tactophone.app.recordings import open_recording


def test_a_model_for_an_air_microphone_decides_alike_with_and_without_a_contact_channel(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(1)
    air = 0.001 * rng.standard_normal(96_000)
    air[32_000:80_000] += 0.05 * rng.standard_normal(48_000)
    hum = 0.2 * np.sin(2 * np.pi * 130 * np.arange(96_000) / 48_000)
    found = []
    for name, sound in (("air", air[:, None]), ("both", np.stack((hum, air), axis=1))):
        soundfile.write(tmp_path / f"{name}.wav", sound, 48_000, subtype="FLOAT")
        recording = open_recording(tmp_path / f"{name}.wav", "stylus")
        found.append([each for step in recording.steps() for each in step.predictions])
    assert [each.touch for each in found[0]] == [each.touch for each in found[1]]
    assert any(each.touch for each in found[0])
