"""Write the commands of a timeline as a haptic file:

    python examples/haptic_files.py felt/a.csv a.haptic

Haptic files hold amplitude and frequency envelopes in formats that phones, editors and
codecs read.

=========  ==============================  ===========================================
ending     format                          checked against
=========  ==============================  ===========================================
.haptic    Meta (formerly Lofelt)          the rules of its documentation, as cited
           Haptics, version 1.0.0          below
.ahap      Apple Haptic and Audio          Apple's documented keys, as Apple publishes
           Pattern, version 1.0            no schema
.hjif      MPEG haptics, ISO/IEC           the rules of the reference software; neither
           23090-31, in JSON               its schema nor a player could be had
=========  ==============================  ===========================================

Amplitudes are quantised so that decoding returns the stream within 1 dB and 2 % (tests
decode them). Between two points all formats interpolate linearly; a change is therefore
written as two points.
"""

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tactophone import ConfigError, HapticCommand, TactophoneError
from tactophone.live.telemetry.timeline import read_timeline

LOWEST_HZ = 35.0
"""Lower end of the band of `Limits`: the frequency axis of .haptic and .ahap is
relative, so the file states which band it spans."""

HIGHEST_HZ = 1000.0
"""Upper end of the same band."""

SILENT_AMPLITUDE = 1e-4
"""Amplitude, -80 dB of full drive, below which a command is written as 0."""

LONGEST_HOLD = 0.1
"""Seconds after a command within which the actuator has faded if no other came."""

_STEP = 1e-4
"""Seconds between the two points of a change."""

_AHAP_POINTS = 16
"""Control points of a parameter curve: Core Haptics ignores those beyond (Apple,
CHHapticParameterCurve)."""

Point = tuple[float, float, float]
"""Time in s, amplitude 0-1, frequency in Hz."""


def envelope(
    commands: Iterable[HapticCommand], *, duration: float = 0.0
) -> list[Point]:
    """Return the points of a stream of at least ``duration`` s, from time 0, each
    command held until the next, for at most `LONGEST_HOLD` s.

    Raises `ConfigError` for a command that no run renders, and where times go back.
    """
    points: list[Point] = [(0.0, 0.0, LOWEST_HZ)]
    # In whole steps, as that is what the formats keep: no two points have one time.
    newest = 0
    for command in _faded(commands, duration):
        _, amplitude, frequency = points[-1]
        target = (
            command.amplitude if command.amplitude > SILENT_AMPLITUDE else 0.0,
            command.frequency,
        )
        if target == (amplitude, frequency):
            continue
        if target[0] == 0.0:
            target = (0.0, frequency)  # a silence has no frequency of its own
            if amplitude == 0.0:
                continue
        step = max(round(command.time / _STEP), newest + 1)
        if step - 1 > newest:
            points.append(((step - 1) * _STEP, amplitude, frequency))
        points.append((step * _STEP, *target))
        newest = step
    end = max(round(duration / _STEP), newest + 1)
    return [*points, (end * _STEP, points[-1][1], points[-1][2])]


def _faded(
    commands: Iterable[HapticCommand], duration: float
) -> Iterator[HapticCommand]:
    """Yield the commands, and a silence where none came for `LONGEST_HOLD` s."""
    last = HapticCommand(0.0, LOWEST_HZ, 0.0)
    for command in commands:
        if command.time < last.time:
            raise ConfigError(
                f"at {command.time:g} s the time goes back, from {last.time:g} s: the "
                "run was started again; write each part by itself"
            )
        if not 0.0 <= command.amplitude <= 1.0:
            raise ConfigError(
                f"at {command.time:g} s the amplitude is {command.amplitude:g}; a run "
                "renders 0 to 1"
            )
        yield from _silence_after(last, command.time)
        yield command
        last = command
    yield from _silence_after(last, duration)


def _silence_after(last: HapticCommand, time: float) -> Iterator[HapticCommand]:
    if time - last.time > LONGEST_HOLD:
        yield HapticCommand(0.0, last.frequency, last.time + LONGEST_HOLD)


def encode_haptic(points: Sequence[Point]) -> dict[str, Any]:
    """Encode as .haptic 1.0.0; its frequency runs from 0 to 1, here by ratio over
    `LOWEST_HZ` to `HIGHEST_HZ`."""
    return {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {
            "editor": "tactophone",
            "description": f"frequency 0 to 1 is {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz "
            "by ratio",
        },
        "signals": {
            "continuous": {
                "envelopes": {
                    "amplitude": [
                        {"time": _time(time), "amplitude": _digits(level)}
                        for time, level, _ in points
                    ],
                    "frequency": [
                        {"time": _time(time), "frequency": _relative(hertz)}
                        for time, _, hertz in points
                    ],
                }
            }
        },
    }


def encode_ahap(points: Sequence[Point]) -> dict[str, Any]:
    """Encode as .ahap: one continuous event, and curves of intensity and sharpness."""
    end = points[-1][0]
    event = {
        "Event": {
            "Time": 0.0,
            "EventType": "HapticContinuous",
            "EventDuration": _time(end),
            "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                # The control parameter is added to it.
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.0},
            ],
        }
    }
    curves = [
        _curve(name, points[start : start + _AHAP_POINTS], value)
        for start in range(0, len(points), _AHAP_POINTS - 1)
        if start == 0 or start < len(points) - 1
        for name, value in (
            ("HapticIntensityControl", lambda point: _digits(point[1])),
            ("HapticSharpnessControl", lambda point: _relative(point[2])),
        )
    ]
    return {
        "Version": 1.0,
        "Metadata": {"Project": "tactophone"},
        "Pattern": [event, *curves],
    }


HJIF_TICKS = 10_000
"""Ticks a second of the positions in an .hjif file."""


def encode_hjif(points: Sequence[Point]) -> dict[str, Any]:
    """Encode as .hjif: one perception with one channel, and a band of vectorial waves.

    MPEG's reference software loads nothing without a date, an avatar other than 0 and a
    library of effects, and skips frequencies and positions that are no whole numbers:
    positions are ticks of 0.1 ms.
    """
    keyframes = [
        {
            "relative_position": round(HJIF_TICKS * time),
            "amplitude_modulation": _digits(level),
            "frequency_modulation": round(hertz),
        }
        for time, level, hertz in points
    ]
    band = {
        "band_type": "VectorialWave",
        "lower_frequency_limit": round(LOWEST_HZ),
        "upper_frequency_limit": round(HIGHEST_HZ),
        "effects": [
            {
                "id": 0,
                "position": 0,
                "phase": 0.0,
                "base_signal": "Sine",
                "effect_type": "Basis",
                "keyframes": keyframes,
            }
        ],
    }
    channel = {
        "id": 0,
        "description": "fingertip",
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "bands": [band],
    }
    return {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": "2026-11-24",
        "timescale": HJIF_TICKS,
        "description": "commands of tactophone, after its limits",
        "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [
            {
                "id": 0,
                "avatar_id": 1,
                "description": "roughness",
                "perception_modality": "Vibrotactile",
                "effect_library": [],
                "channels": [channel],
            }
        ],
        "syncs": [],
    }


FORMATS: dict[str, Callable[[Sequence[Point]], dict[str, Any]]] = {
    ".haptic": encode_haptic,
    ".ahap": encode_ahap,
    ".hjif": encode_hjif,
}


def write_haptic_file(
    path: Path, commands: Iterable[HapticCommand], *, duration: float = 0.0
) -> Path:
    """Write a command stream in the format of the file's ending; raises `ConfigError`
    for another ending."""
    if path.suffix not in FORMATS:
        raise ConfigError(f"{path}: haptic files end in {', '.join(FORMATS)}")
    content = FORMATS[path.suffix](envelope(commands, duration=duration))
    path.write_text(json.dumps(content, indent=None, separators=(",", ":")) + "\n")
    return path


def _curve(
    name: str, points: Sequence[Point], value: Callable[[Point], float]
) -> dict[str, Any]:
    start = _time(points[0][0])
    return {
        "ParameterCurve": {
            "ParameterID": name,
            "Time": start,
            "ParameterCurveControlPoints": [
                {"Time": _time(point[0] - start), "ParameterValue": value(point)}
                for point in points
            ],
        }
    }


def _time(seconds: float) -> float:
    return round(seconds, 4)


def _digits(amplitude: float) -> float:
    return float(f"{amplitude:.4g}")


def _relative(hertz: float) -> float:
    """Return the place of a frequency between `LOWEST_HZ` and `HIGHEST_HZ`, 0 to 1 by
    ratio."""
    share = math.log(max(hertz, LOWEST_HZ) / LOWEST_HZ) / math.log(
        HIGHEST_HZ / LOWEST_HZ
    )
    return round(min(share, 1.0), 4)


def main() -> None:
    if len(sys.argv) != 3:
        raise SystemExit("usage: python examples/haptic_files.py TIMELINE.csv OUT")
    try:
        write(Path(sys.argv[1]), Path(sys.argv[2]))
    except (TactophoneError, OSError) as error:
        raise SystemExit(f"haptic_files: {error}") from None


def write(source: Path, target: Path) -> None:
    """Write the commands of a timeline as a haptic file, and print its name."""
    timeline = read_timeline(source)
    rows = zip(
        timeline["amplitude"], timeline["frequency"], timeline["time"], strict=True
    )
    commands = [HapticCommand(*map(float, row)) for row in rows]
    print(write_haptic_file(target, commands))


if __name__ == "__main__":
    main()
