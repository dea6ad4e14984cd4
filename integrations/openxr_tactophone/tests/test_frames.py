import itertools
import math
import os

import numpy as np
import pytest
from openxr_tactophone import (
    HELD,
    HIGHEST_HZ,
    LOWEST_HZ,
    MOST_POINTS,
    STALE,
    Frame,
    FrameType,
    HapticStream,
)

from tactophone import HapticCommand

STREAMS = int(os.environ.get("OPENXR_STREAMS", "10000"))


def valid(frame: Frame, duration: float) -> bool:
    """By the registry's page of ``XrHapticParametricVibrationEXT`` and its
    constants."""
    for points in (frame.amplitude_points, frame.frequency_points):
        times = [at for at, _ in points]
        if (
            not 1 <= len(points) <= MOST_POINTS
            or times[0] != 0
            or any(b <= a for a, b in itertools.pairwise(times))
        ):
            return False
        if times[-1] > duration * 1e9 + 1 or not all(
            isinstance(at, int) and 0.0 <= value <= 1.0 for at, value in points
        ):
            return False
    return LOWEST_HZ <= frame.min_frequency_hz < frame.max_frequency_hz <= HIGHEST_HZ


def test_every_frame_of_random_streams_keeps_the_headers_limits() -> None:
    rng = np.random.default_rng(0)
    odd = [math.nan, math.inf, -1.0, 1e9, 0.0]
    for _ in range(STREAMS):
        stream, now, kinds = (
            HapticStream(pulsed=bool(rng.random() < 0.3)),
            float(rng.uniform(0, 1e5)),
            [],
        )
        for _ in range(int(rng.integers(1, 4))):
            duration = float(rng.choice([0.002, 0.011, 0.02, 0.05]))
            count = 700 if rng.random() < 0.002 else int(rng.integers(0, 8))
            times = np.sort(rng.uniform(-0.01, duration * 1.2, count)) + now
            values = rng.uniform(0, 2, (count, 2)) * (1, 600)
            if count and rng.random() < 0.1:
                values[rng.integers(count), rng.integers(2)] = odd[
                    rng.integers(len(odd))
                ]
            commands = [
                HapticCommand(*map(float, row), float(at))
                for row, at in zip(values, times, strict=True)
            ]
            frame = stream.frame(commands, now, now + duration)
            assert valid(frame, duration)
            kinds.append(frame.type)
            now += duration
        end = stream.finish()
        assert valid(end, 0.001)
        assert not any(value for _, value in end.amplitude_points)
        assert [*kinds, end.type] == [
            FrameType.FIRST,
            *[FrameType.INTERMEDIATE] * (len(kinds) - 1),
            FrameType.LAST,
        ]


def test_a_command_that_nothing_follows_is_silent_within_100_ms() -> None:
    stream = HapticStream()
    stream.frame([HapticCommand(0.5, 120.0, 10.0)], 10.0, 10.01)
    levels = [
        stream.frame([], 10.0 + k / 100, 10.01 + k / 100).amplitude_points[-1][1]
        for k in range(1, 20)
    ]
    assert levels[0] == 0.5
    assert not any(levels[round(STALE * 100) :])
    assert STALE + HELD <= 0.1


def test_without_a_frequency_rough_pulses_and_smooth_is_steady() -> None:
    def levels(frequency: float) -> list[float]:
        stream = HapticStream(pulsed=True)
        times = [k / 200 for k in range(100)]
        frames = [
            stream.frame([HapticCommand(0.5, frequency, at)], at, at + 0.005)
            for at in times
        ]
        return [frame.amplitude_points[0][1] for frame in frames]

    assert np.std(levels(120.0)) == 0
    assert np.std(levels(60.0)) > 0.2


def test_a_band_over_the_standards_is_refused() -> None:
    with pytest.raises(ValueError, match="1000"):
        HapticStream(highest=1200.0)
