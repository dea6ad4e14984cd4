import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples import haptic_files
from tactophone.core.errors import ConfigError
from tactophone.core.types import HapticCommand

STREAM = [
    HapticCommand(amplitude, frequency, 0.0107 * n)
    for n, (amplitude, frequency) in enumerate(
        [(0.0, 120.0)] * 5
        + [(0.028, 120.0)] * 3
        + [(0.5, 60.0)] * 4
        + [(0.3 + 0.2 * math.sin(k), 60 + 5.3 * k) for k in range(40)]
        + [(0.0, 60.0)] * 5
        + [(1e-5, 50.0)]
    )
]


def held(commands: list[HapticCommand], time: float) -> tuple[float, float]:
    newest = [command for command in commands if command.time <= time][-1]
    return newest.amplitude, newest.frequency


def decode_haptic(content: dict[str, Any]) -> list[haptic_files.Point]:
    envelopes = content["signals"]["continuous"]["envelopes"]
    pairs = zip(envelopes["amplitude"], envelopes["frequency"], strict=True)
    return [
        (level["time"], level["amplitude"], hertz(pitch["frequency"]))
        for level, pitch in pairs
    ]


def decode_ahap(content: dict[str, Any]) -> list[haptic_files.Point]:
    values: dict[str, dict[float, float]] = {}
    for entry in content["Pattern"]:
        if curve := entry.get("ParameterCurve"):
            for point in curve["ParameterCurveControlPoints"]:
                time = round(curve["Time"] + point["Time"], 4)
                values.setdefault(curve["ParameterID"], {})[time] = point[
                    "ParameterValue"
                ]
    intensity, sharpness = (
        values["HapticIntensityControl"],
        values["HapticSharpnessControl"],
    )
    return [(time, level, hertz(sharpness[time])) for time, level in intensity.items()]


def decode_hjif(content: dict[str, Any]) -> list[haptic_files.Point]:
    frames = content["perceptions"][0]["channels"][0]["bands"][0]["effects"][0][
        "keyframes"
    ]
    scale = content["timescale"]
    return [
        (
            frame["relative_position"] / scale,
            frame["amplitude_modulation"],
            frame["frequency_modulation"],
        )
        for frame in frames
    ]


def hertz(relative: float) -> float:
    return float(
        haptic_files.LOWEST_HZ
        * (haptic_files.HIGHEST_HZ / haptic_files.LOWEST_HZ) ** relative
    )


@pytest.mark.parametrize(
    ("encode", "decode"),
    [
        (haptic_files.encode_haptic, decode_haptic),
        (haptic_files.encode_ahap, decode_ahap),
        (haptic_files.encode_hjif, decode_hjif),
    ],
)
def test_decoding_returns_the_stream_within_1_db_and_2_percent(encode, decode) -> None:  # type: ignore[no-untyped-def]
    content = json.loads(
        json.dumps(encode(haptic_files.envelope(STREAM, duration=0.8)))
    )
    times, levels, pitches = map(np.array, zip(*decode(content), strict=True))
    assert (np.diff(times) >= 0).all()
    assert times[-1] == pytest.approx(0.8)
    for n in range(len(STREAM) - 1):
        moment = (STREAM[n].time + STREAM[n + 1].time) / 2
        amplitude, frequency = held(STREAM, moment)
        level, pitch = (
            np.interp(moment, times, levels),
            np.interp(moment, times, pitches),
        )
        if amplitude > haptic_files.SILENT_AMPLITUDE:
            assert abs(20 * math.log10(level / amplitude)) < 1
            assert pitch == pytest.approx(frequency, rel=0.02)
        else:
            assert level == 0


def test_a_haptic_file_keeps_the_rules_of_its_format() -> None:
    content = haptic_files.encode_haptic(haptic_files.envelope(STREAM))
    envelopes = content["signals"]["continuous"]["envelopes"]
    assert content["version"] == {"major": 1, "minor": 0, "patch": 0}
    assert len(envelopes["amplitude"]) >= 2
    for points, key in (
        (envelopes["amplitude"], "amplitude"),
        (envelopes["frequency"], "frequency"),
    ):
        assert points[0]["time"] == 0
        assert all(0 <= point[key] <= 1 for point in points)


def test_an_ahap_curve_has_no_more_points_than_core_haptics_plays() -> None:
    content = haptic_files.encode_ahap(haptic_files.envelope(STREAM))
    curves = [
        entry["ParameterCurve"]
        for entry in content["Pattern"]
        if "ParameterCurve" in entry
    ]
    assert len(curves) > 4
    assert all(2 <= len(curve["ParameterCurveControlPoints"]) <= 16 for curve in curves)


def test_silence_alone_is_a_file_too(tmp_path: Path) -> None:
    for ending in haptic_files.FORMATS:
        path = haptic_files.write_haptic_file(tmp_path / f"a{ending}", [], duration=1.0)
        assert json.loads(path.read_text())
    with pytest.raises(ConfigError, match=r"\.hjif"):
        haptic_files.write_haptic_file(tmp_path / "a.wav", [])


def test_hjif_holds_what_mpegs_reference_loader_asks_for() -> None:
    content = haptic_files.encode_hjif(haptic_files.envelope(STREAM, duration=0.8))
    assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", content["date"])
    avatars = [avatar["id"] for avatar in content["avatars"]]
    assert 0 not in avatars
    for perception in content["perceptions"]:
        assert isinstance(perception["effect_library"], list)
        assert perception["avatar_id"] in avatars
        for band in (
            band for channel in perception["channels"] for band in channel["bands"]
        ):
            whole = [band["lower_frequency_limit"], band["upper_frequency_limit"]]
            frames = [
                frame for effect in band["effects"] for frame in effect["keyframes"]
            ]
            whole += [
                frame[name]
                for frame in frames
                for name in ("relative_position", "frequency_modulation")
            ]
            assert all(isinstance(number, int) for number in whole)
            assert np.all(np.diff([frame["relative_position"] for frame in frames]) > 0)
    assert content["timescale"] <= 48_000


def test_no_two_points_of_an_envelope_have_one_time() -> None:
    dice = np.random.default_rng(0)
    times = np.cumsum(dice.exponential(0.004, 3000))
    commands = [
        HapticCommand(float(level), 120.0, float(time))
        for level, time in zip(dice.uniform(0, 1, 3000), times, strict=True)
    ]
    content = haptic_files.encode_haptic(haptic_files.envelope(commands))
    envelopes = content["signals"]["continuous"]["envelopes"]
    written = [point["time"] for point in envelopes["amplitude"]]
    assert np.diff(written).min() > 0


@pytest.mark.parametrize("duration", [0.0, 9.0])
def test_a_gap_between_commands_is_silent_as_it_was_when_it_was_felt(
    duration: float,
) -> None:
    """A lost link was written as a vibration without end."""
    felt = [HapticCommand(0.5, 60.0, 0.01 * n) for n in range(100)]
    later = [HapticCommand(0.5, 60.0, 5.0)]
    points = haptic_files.envelope(felt + later, duration=duration)
    strong = [time for time, level, _ in points if level]
    assert max(time for time in strong if time < 4) < 0.99 + haptic_files.LONGEST_HOLD
    assert max(strong) <= 5.0 + haptic_files.LONGEST_HOLD
    assert points[-1][0] >= duration


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (HapticCommand(0.5, 60.0, 0.1), "the time goes back"),
        (HapticCommand(5.0, 60.0, 0.3), "the amplitude is 5"),
        (HapticCommand(math.nan, 60.0, 0.3), "the amplitude is nan"),
    ],
)
def test_commands_that_no_run_renders_are_refused(
    command: HapticCommand, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        haptic_files.envelope([HapticCommand(0.5, 60.0, 0.2), command])


def test_a_missing_timeline_is_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, haptic_files.__file__, "none.csv", "out.haptic"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "none.csv" in done.stderr
    assert len(done.stderr.splitlines()) == 1
