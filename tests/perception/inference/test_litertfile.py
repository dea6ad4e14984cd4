import numpy as np
import pytest

from tactophone.perception.inference.litert import LiteRtEngine
from tactophone.perception.inference.litertfile import LiteRtWriter

pytest.importorskip("ai_edge_litert")


def test_what_is_written_computes_what_was_meant() -> None:
    rng = np.random.default_rng(0)
    weights, biases = rng.normal(size=(3, 8)).astype(np.float32), rng.normal(size=3).astype(np.float32)
    sound = rng.normal(size=8).astype(np.float32)
    writer = LiteRtWriter()
    value = writer.place(1, 8)
    plain, positive = (
        writer.connect(value, writer.constant(weights), writer.constant(biases), rectify=rectify)
        for rectify in (False, True)
    )
    network = writer.finish(value, writer.softmax(writer.add(plain, positive)))
    line = weights @ sound + biases
    scores = line + np.maximum(line, 0)
    wanted = np.exp(scores) / np.exp(scores).sum()
    assert LiteRtEngine(network).ask(sound) == pytest.approx(wanted, abs=1e-5)


def test_eight_bits_with_a_scale_a_row_are_the_weights() -> None:
    weights, scale = np.array([[127, -127], [64, 0], [1, 1]], np.int8), np.array([1.0, 0.01, 2.0], np.float32)
    writer = LiteRtWriter()
    value = writer.place(1, 2)
    biases = writer.constant(np.zeros(3, np.float32))
    answer = writer.connect(value, writer.constant(weights, scale), biases, rectify=False)
    scores = LiteRtEngine(writer.finish(value, answer)).ask(np.array([1.0, 0.0], np.float32))
    assert scores == pytest.approx([127, 0.64, 2.0], rel=0.01)


def test_parts_sum_up_to_the_value_and_are_rounded_apart() -> None:
    writer = LiteRtWriter()
    value, nothing = writer.place(1, 3), writer.constant(np.zeros(3, np.float32))
    same = writer.constant(np.diag([127, 127, 127]).astype(np.int8), np.full(3, 1 / 127, np.float32))
    answer = writer.total(writer.connect(writer.part(value, 1 / 16), same, nothing, rectify=False))
    sound = np.array([1000.0, 1.0, 200.0], np.float32)
    # In one row of 8 bits, the middle one would be lost in steps of 4.
    assert LiteRtEngine(writer.finish(value, answer)).ask(sound) == pytest.approx(sound, rel=0.2)
