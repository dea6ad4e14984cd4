import numpy as np
import onnxruntime
import pytest
import torch

from tactophone.signal.perception.model_file import SOUND
from tactophone_lab.training import onnx_export
from tactophone_lab.training.paper_network import magnitudes


def test_channels_follow_one_another_unnormalised() -> None:
    time = np.arange(512) / 2000
    window = np.stack(
        (np.sin(2 * np.pi * 250 * time), 0.5 * np.sin(2 * np.pi * 500 * time)), axis=1
    )
    features = magnitudes(torch.from_numpy(window[None]).float())[0].numpy()
    assert features.dtype == np.float32
    assert features[:257].argmax() == 64
    assert features[257:].argmax() == 128
    np.testing.assert_allclose(
        (features[64], features[257 + 128]), (256, 128), rtol=1e-5
    )


def test_a_model_files_own_magnitudes_are_those_of_training() -> None:
    windows = np.random.default_rng(1).standard_normal((5, 512, 2)).astype(np.float32)
    session = onnxruntime.InferenceSession(
        onnx_export.magnitudes(2).SerializeToString()
    )
    found = [
        session.run(None, {SOUND: np.ascontiguousarray(window.T[None])})[0][0]
        for window in windows
    ]
    assert np.array(found) == pytest.approx(
        magnitudes(torch.from_numpy(windows)).numpy(), abs=1e-4
    )
