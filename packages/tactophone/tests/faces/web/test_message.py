"""Messages, parsed again."""

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tactophone.faces.web.feed import (
    STEP_COLUMNS,
    envelope,
    event_table,
    pack,
    step_table,
)
from tactophone.live.telemetry.layout import STEP_RECORD

BUCKET = 480


def parse(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    size = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + size])
    numbers, tables = np.frombuffer(message, "<f4", offset=4 + size), {}
    for name, shape in header["series"].items():
        count = int(np.prod(shape))
        tables[name], numbers = numbers[:count].reshape(shape), numbers[count:]
    assert not len(numbers)
    return header, tables


@pytest.mark.parametrize("word", ["", "é", "four", "longer words"])
def test_a_message_reads_back_and_its_numbers_are_aligned(word: str) -> None:
    table = np.arange(6.0).reshape(2, 3)
    header, tables = parse(
        pack({"word": word}, {"a": table, "none": np.empty((0, 4)), "b": table[0]})
    )
    assert header["word"] == word
    np.testing.assert_array_equal(tables["a"], table)
    np.testing.assert_array_equal(tables["b"], table[0])
    assert tables["none"].shape == (0, 4)


def test_json_has_no_infinity_so_null_stands_for_it() -> None:
    header, _ = parse(
        pack(
            {
                "gauges": {"a": np.inf, "b": float("nan")},
                "faults": ({"since": float("inf")},),
            },
            {},
        )
    )
    assert header["gauges"] == {"a": None, "b": None}
    assert header["faults"] == [{"since": None}]


def test_an_envelope_keeps_the_extremes_of_each_channel() -> None:
    sound = np.zeros((2 * BUCKET, 2), np.float32)
    sound[3], sound[BUCKET + 5] = (0.5, -0.25), (-1, 1)
    low, high = envelope(sound, BUCKET)[:, [0, 3]], envelope(sound, BUCKET)[:, [1, 4]]
    np.testing.assert_array_equal(low, [[0, -0.25], [-1, 0]])
    np.testing.assert_array_equal(high, [[0.5, 0], [0, 1]])


def test_the_level_is_the_bucket_s_rms_and_silence_is_finite() -> None:
    tone = np.sin(2 * np.pi * np.arange(BUCKET) / 48).astype(np.float32)
    levels = envelope(np.column_stack([tone, 0 * tone]), BUCKET)[0, [2, 5]]
    np.testing.assert_allclose(levels, [-3.01, -120], atol=0.01)


def test_every_touch_event_is_sent_also_where_its_step_is_not() -> None:
    steps = np.zeros(3, STEP_RECORD)
    steps["time"], steps["event"] = [7.0, 7.0025, 7.005], [0, 2, 0]
    np.testing.assert_allclose(event_table(steps, origin=7.0), [[0.0025, 2]])


def test_of_fast_steps_one_in_ten_milliseconds_is_sent_and_the_newest() -> None:
    steps = np.zeros(41, STEP_RECORD)
    steps["time"] = 7 + 0.0025 * np.arange(41)
    steps["roughness"] = np.arange(41)
    table = step_table(steps, 7.0)
    assert table.shape == (11, 1 + len(STEP_COLUMNS))
    assert table[-1, 1 + STEP_COLUMNS.index("roughness")] == 40
    assert np.all(np.diff(table[:, 0]) < 0.0126)
    assert step_table(steps[:0], 7.0).shape == (0, 1 + len(STEP_COLUMNS))
