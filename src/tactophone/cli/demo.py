"""``tactophone demo``: the whole telephone with no hardware, in one command."""

import argparse
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.capture import FileSource
from tactophone.cli import page, terminal
from tactophone.dataset import Segment
from tactophone.evaluation.feeling import Feeling, Outputs, Summary, feel
from tactophone.evaluation.figures import draw_feeling
from tactophone.evaluation.timeline import read_timeline
from tactophone.haptics import PROFILES
from tactophone.perception import shipped_models
from tactophone.simulation.demonstration import demonstration
from tactophone.simulation.source import SimulatedFinger
from tactophone.simulation.storing import tell
from tactophone.types import Tick, Touch
from tactophone.walk import open_walk

FELT = 0.02
"""Amplitude from which a vibration counts as felt, -34 dB: well under the paper's smooth, at -25 dBFS."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for picture and sound")
    parser.add_argument("--seed", type=int, default=0, help="another seed strokes otherwise, in another set-up")
    parser.add_argument(
        "--model", default="", metavar="NAME|FILE",
        help=f"a model file, or one that ships ({', '.join(shipped_models()) or 'none'}); default: for two channels",
    )  # fmt: skip
    parser.add_argument("--profile", default="paper", metavar="NAME", help=f"one of {', '.join(PROFILES)}")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    page.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Stroke, judge, feel; then show what came of it."""
    args.out.mkdir(parents=True, exist_ok=True)
    finger = demonstration(args.seed)
    walk = open_walk(args.model, sample_rate=finger.sample_rate, channels=finger.channels, profile=args.profile)
    outputs = Outputs(args.out / "vibration.wav", args.out / "timeline.csv")
    with _Listener(finger, args.out / "microphones.wav") as listener:
        summary, feeling = feel(finger, walk, outputs, watch=listener.hear)
    truth, _ = tell(listener.things, finger.scene)
    picture = args.out / "demo.png"
    _draw(picture, outputs, feeling, truth)
    numbers = measure(read_timeline(outputs.timeline), truth)
    _print(args, summary, numbers, picture)
    if args.dashboard:
        from tactophone.cli import replay

        take = replay.Take(FileSource(args.out / "microphones.wav"), walk, truth)
        replay.on_page(args, [take], name="demo")
    return 0


@dataclass(frozen=True, slots=True)
class Numbers:
    """How the telephone did.

    Parameters
    ----------
    smooth_right, rough_right
        Share of beliefs that were right while such a stone was touched.
    false_bumps
        How often smooth was felt as rough, counted as stretches.
    touch_to_felt
        Seconds from each touch to the vibration, median.
    lift_to_silence
        Seconds from each end of touch to the command for silence, median.
    """

    smooth_right: float
    rough_right: float
    false_bumps: int
    touch_to_felt: float
    lift_to_silence: float


def measure(timeline: dict[str, NDArray[Any]], truth: tuple[Segment, ...]) -> Numbers:
    """Hold what was felt against what was true."""
    time, touch, amplitude = timeline["time"], timeline["touch"], timeline["amplitude"]
    inside = {label: _inside(time, truth, label) for label in (Touch.SMOOTH, Touch.ROUGH)}
    bumps = inside[Touch.SMOOTH] & (touch == Touch.ROUGH)
    touched = [one.start for one, before in zip(truth[1:], truth, strict=False) if one.contact and not before.contact]
    left = [one.start for one, before in zip(truth[1:], truth, strict=False) if before.contact and not one.contact]
    return Numbers(
        smooth_right=_share(touch[inside[Touch.SMOOTH]] == Touch.SMOOTH),
        rough_right=_share(touch[inside[Touch.ROUGH]] == Touch.ROUGH),
        false_bumps=int((np.diff(bumps.astype(int)) > 0).sum()),
        touch_to_felt=_delay(time, amplitude >= FELT, touched),
        lift_to_silence=_delay(time, amplitude == 0, left),
    )


class _Listener:
    """Keeps the microphones' sound, and the truth, while the finger is felt."""

    def __init__(self, finger: SimulatedFinger, path: Path) -> None:
        self._finger, self._path = finger, path
        self._things: list[NDArray[np.int16]] = []
        self._resources = ExitStack()

    def __enter__(self) -> "_Listener":
        self._file = self._resources.enter_context(
            soundfile.SoundFile(self._path, "w", self._finger.sample_rate, self._finger.channels, "PCM_24")
        )
        return self

    def __exit__(self, *error: object) -> None:
        self._resources.close()

    @property
    def things(self) -> NDArray[np.int16]:
        """What was touched, per sample."""
        return np.concatenate(self._things)

    def hear(self, tick: Tick) -> None:
        """Keep one step."""
        self._file.write(tick.block.samples)
        self._things.append(self._finger.truth.thing)


def _share(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else float("nan")


def _inside(time: NDArray[Any], truth: tuple[Segment, ...], label: Touch) -> NDArray[np.bool_]:
    inside = np.zeros(len(time), bool)
    for one in truth:
        if one.label is label:
            inside |= (time >= one.start) & (time < one.end)
    return inside


def _delay(time: NDArray[Any], when: NDArray[np.bool_], events: list[float]) -> float:
    """Median time in s from an event to the first line that fulfils something."""
    found = [time[when & (time >= event)] for event in events]
    delays = [float(after[0] - event) for after, event in zip(found, events, strict=True) if len(after)]
    return float(np.median(delays)) if delays else float("nan")


def _draw(picture: Path, outputs: Outputs, feeling: Feeling, truth: tuple[Segment, ...]) -> None:
    title = "a simulated finger strokes a smooth stone, then a rough one, and slips off its edge"
    draw_feeling(
        picture, timeline=outputs.timeline, microphones=feeling.microphones, vibration=feeling.vibration,
        title=title, truth=truth,
    )  # fmt: skip


def _print(args: argparse.Namespace, summary: Summary, numbers: Numbers, picture: Path) -> None:
    files = {"picture": picture, **{name: args.out / f"{name}.wav" for name in ("microphones", "vibration")}}
    if args.json:
        told = {name: str(path) for name, path in files.items()}
        terminal.print_json({**told, **asdict(numbers), "duration": summary.duration, "elapsed": summary.elapsed})
        return
    print(f"{summary.duration:.1f} s felt in {summary.elapsed:.1f} s")
    print(f"on the smooth stone: felt smooth {numbers.smooth_right:.0%} of the time, {numbers.false_bumps} false bumps")
    print(f"on the rough stone:  felt rough {numbers.rough_right:.0%} of the time")
    print(f"from touch to felt {1000 * numbers.touch_to_felt:.0f} ms, from lift to silence "
          f"{1000 * numbers.lift_to_silence:.0f} ms (median, network left out)")  # fmt: skip
    for name, path in files.items():
        print(f"{name + ':':13}{path}")
