from dataclasses import replace

import numpy as np
import pytest
import torch

from tactophone import DatasetError, Touch
from tactophone.core.types import FloatArray
from tactophone_lab.training.paper_network import (
    SIZE,
    PaperNetwork,
    Windows,
    batches,
    channels_of,
    find_windows,
    grid,
    weights_of,
    with_weights,
)
from tactophone_lab.training.recipe_options import Labelling, network_settings


def test_the_paper_counts_1882755_parameters() -> None:
    assert (
        sum(parameter.numel() for parameter in PaperNetwork().parameters()) == 1_882_755
    )


def test_the_layers_compute_what_the_paper_specifies() -> None:
    network = PaperNetwork(channels=1)
    weights = weights_of(network)
    hidden = np.random.default_rng(0).random((5, 257), np.float32)

    def layer(name: str, x: np.ndarray) -> np.ndarray:
        return x @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]

    features = torch.from_numpy(hidden)
    for name in ("layer1", "layer2", "layer3"):
        hidden = np.maximum(layer(name, hidden), 0)
    for number in range(10):
        hidden = hidden + np.maximum(layer(f"layer_resnet.{number}", hidden), 0)
    for name in ("layer4", "layer5"):
        hidden = np.maximum(layer(name, hidden), 0)
    logits = layer("linear", hidden)
    expected = logits - np.log(np.exp(logits).sum(axis=1, keepdims=True))
    assert network(features).detach().numpy() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("channels", [1, 2])
def test_weights_survive_a_round_trip(channels: int) -> None:
    weights = weights_of(PaperNetwork(channels=channels))
    assert channels_of(weights) == channels
    again = weights_of(with_weights(weights))
    assert all(np.array_equal(weights[name], again[name]) for name in weights)


def test_a_missing_layer_is_named() -> None:
    weights = weights_of(PaperNetwork())
    del weights["layer4.bias"]
    with pytest.raises(RuntimeError, match=r"layer4\.bias"):
        with_weights(weights)


def tone(amplitude: float, *, size: int = 1200, channels: int = 2) -> FloatArray:
    wave = amplitude * np.sin(2 * np.pi * 100 / 2000 * np.arange(size))
    return np.repeat(wave[:, None], channels, axis=1).astype(np.float32)


def loudness(windows: FloatArray, kind: str) -> FloatArray:
    contact = windows[:, :, 0]
    return (
        np.sqrt((contact**2).mean(axis=1))
        if kind == "rms"
        else np.abs(contact).mean(axis=1)
    )


@pytest.mark.parametrize(("kind", "threshold"), [("rms", 0.1), ("mean_absolute", 0.08)])
def test_the_running_sum_gives_each_windows_loudness(
    kind: str, threshold: float
) -> None:
    noise = np.random.default_rng(0).normal(0, 0.1, (2000, 1)).astype(np.float32)
    rule = Labelling(kind, threshold)  # type: ignore[arg-type]
    windows = find_windows([noise], [Touch.SMOOTH], rule=rule)
    each = windows.take(np.arange(len(windows)))
    assert np.array_equal(
        windows.labels == Touch.SMOOTH, loudness(each, kind) > threshold
    )
    assert 0 < (windows.labels == Touch.SMOOTH).mean() < 1


def test_no_window_crosses_a_recordings_end() -> None:
    windows = find_windows(
        [tone(0.5), tone(0.4, size=SIZE)],
        [Touch.ROUGH, Touch.SMOOTH],
        rule=network_settings("general").labelling,
    )
    assert len(windows) == (1200 - SIZE + 1) + 1
    last = windows.take(np.array([len(windows) - 1]))[0]
    assert np.array_equal(last, tone(0.4, size=SIZE))


def test_the_papers_general_rule_is_minus_26_dbfs_rms() -> None:
    rule = network_settings("general").labelling
    just = 10 ** (-26 / 20) * np.sqrt(2)
    windows = find_windows(
        [tone(just * 1.02), tone(just * 0.98), tone(0.5)],
        [Touch.ROUGH, Touch.ROUGH, Touch.SMOOTH],
        rule=rule,
    )
    every = 1200 - SIZE + 1
    assert [int(label) for label in windows.labels[::every]] == [
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]


def test_the_authors_rule_is_the_classes_mean_and_drops_quiet_rough_windows() -> None:
    rule = network_settings("general", reference_code=True).labelling
    sounds = [tone(0.4), tone(0.2), tone(0.1), tone(0.02)]
    windows = find_windows(
        sounds, [Touch.ROUGH, Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH], rule=rule
    )
    every = 1200 - SIZE + 1
    assert [int(label) for label in windows.labels[::every]] == [
        Touch.ROUGH,
        Touch.SMOOTH,
        Touch.NONE,
    ]


def test_the_fine_tuned_rule_is_half_the_labels_rms() -> None:
    rule = network_settings("fine-tuned").labelling
    windows = find_windows(
        [tone(0.4), tone(0.1), tone(0.3)],
        [Touch.ROUGH, Touch.ROUGH, Touch.SMOOTH],
        rule=rule,
    )
    every = 1200 - SIZE + 1
    # Half of the RMS of both rough recordings is that of a sine of amplitude 0.146.
    assert [int(label) for label in windows.labels[::every]] == [
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]


def test_a_label_without_contact_says_what_to_do() -> None:
    with pytest.raises(
        DatasetError,
        match=r"no window of the smooth recordings is louder than -26\.0 dBFS",
    ):
        find_windows(
            [tone(0.5), tone(0.01)],
            [Touch.ROUGH, Touch.SMOOTH],
            rule=network_settings("general").labelling,
        )


def every(windows: Windows, *, hop: int, epoch: int = 0, seed: int = 0) -> list[int]:
    order = batches(windows, hop=hop, size=100, seed=seed, epoch=epoch)
    return [int(start) for which in order for start in windows.starts[which]]


def test_a_hop_of_one_yields_every_window_once_and_shuffled() -> None:
    windows = find_windows(
        [tone(0.5), tone(0.4)],
        [Touch.ROUGH, Touch.SMOOTH],
        rule=network_settings("general").labelling,
    )
    order = every(windows, hop=1)
    assert order != sorted(order)
    assert sorted(order) == windows.starts.tolist()


def test_a_longer_hop_yields_another_grid_each_epoch_and_the_same_for_a_seed() -> None:
    windows = find_windows(
        [tone(0.5)], [Touch.ROUGH], rule=network_settings("general").labelling
    )
    grids = {tuple(sorted(every(windows, hop=21, epoch=epoch))) for epoch in range(8)}
    assert len(grids) > 4
    assert all(set(np.diff(starts)) == {21} for starts in grids)
    assert every(windows, hop=21, seed=3) == every(windows, hop=21, seed=3)
    assert len(grid(windows, hop=21, seed=3, epoch=0)[0]) == len(
        every(windows, hop=21, seed=3)
    )


def test_windows_are_views_until_a_batch_is_taken() -> None:
    recipe = replace(network_settings("general"), hop=1)
    windows = find_windows(
        [tone(0.5, size=200_000)], [Touch.ROUGH], rule=recipe.labelling
    )
    held = sum(
        array.nbytes for array in (windows.signal, windows.starts, windows.labels)
    )
    assert held < windows.signal.nbytes * 2
    assert windows.take(np.arange(6)).nbytes == 6 * SIZE * 2 * 4
