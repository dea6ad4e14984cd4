"""Scores of touch events by sound. Prints the table of docs/research/touch-events.md.

    python benchmarks/touch_events.py [--train] [--recordings DIR]

Simulated: scenes of taps, strokes, slips and knocks in the air, on objects of the
catalogue on which no constant of the detector was chosen (``--train``: on those on
which they were), in a quiet room and in the competition's noise. Real, where
TACTOPHONE_RECORDINGS or ``--recordings`` names them: finger taps (``tapsense``), double
taps (``taps``), presses of a robot's finger (``phac``) and a sliding stylus (``lmt``);
the rows say on which of them constants were chosen. One step of a tap was chosen on the
even windows of ``taps``, so odd ones are scored apart.
"""

import argparse
import csv
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import AudioBlock, TouchEvent
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.events import EventDetector
from touch_event_metrics import MISSED, class_accuracy, confusion, match_moments
from touch_scenes import touch_scene

TRAIN = ("0", "1", "2", "4", "5", "8", "9", "11", "12", "17")
HELD_OUT = ("21", *map(str, range(23, 33)), "22")
"""22, a soft tile with taps within 10 dB of the noise, comes last, so that the others'
scenes are as without it."""

KINDS = {"tap": 0.05, "knock": 0.05, "stroke": 0.15, "slip": 0.15, "lift-off": 0.15}
"""Seconds within which an event counts: sliding begins and ends gradually."""

LMT_TRAIN = (
    "G1RhombAluminumMesh",
    "G1RhombAluminumMeshVersion2",
    "G2StoneTileVersion1",
    "G2StoneTileVersion2",
    "G3AluminumPlate",
    "G4Bamboo",
    "G5SolidRubberPlateVersion1",
    "G5SolidRubberPlateVersion2",
    "G6Carpet",
    "G6Fibers",
    "G8Cardboard",
    "G8CardboardVersion2",
)
"""Surfaces on which constants were chosen; no other surface is kin of these."""

PHAC_TRAIN = ("bouncy_foam", "cork")
"""Materials on which the gate's threshold was chosen."""

PHAC_WINDOW = 0.25
"""Seconds: `phac` labels a tap by a gap of 0.2 s."""

TAPS_WINDOW = 24_000
"""Samples in a window of `taps`: 0.5 s at 48 kHz."""

TAPS_STEP = 120
"""Samples in a step of 2.5 ms, the resolution at which onsets in `taps` are found."""

APART = 60
"""Least steps between two taps: 150 ms."""

WHOLE = 88
"""Steps that have to follow a tap that completes others."""

PRESS_DB = 35.0
"""How far (dB) a press of a BioTac exceeds the median level of its recording over 32
ms. On the recordings that it was chosen on, presses exceed it by 58 dB under 50 Hz and
the arm's own movements by up to 33 dB (p50 of the recordings)."""


class Pooled:
    """Touch-downs of several recordings."""

    def __init__(self) -> None:
        self.true = self.found = 0
        self.matched: Counter[float] = Counter()

    def add(
        self,
        truth: list[float],
        found: list[float],
        windows: tuple[float, ...] = (0.05, 0.01),
    ) -> None:
        self.true, self.found = self.true + len(truth), self.found + len(found)
        for window in windows:
            self.matched[window] += len(match_moments(truth, found, window))

    def score(self, window: float) -> float:
        return 2 * self.matched[window] / max(1, self.true + self.found)


def detected(
    sound: NDArray[np.float32], rate: int, tip: str = DEFAULT_TIP
) -> list[TouchEvent]:
    return EventDetector(sample_rate=rate, channels=sound.shape[1], tip=tip).push(
        AudioBlock(sound, rate)
    )


def moments(events: list[TouchEvent], kind: str) -> list[float]:
    return [event.time for event in events if event.kind == kind]


def simulated(
    names: tuple[str, ...], *, motors: bool, seed: int, tip: str = DEFAULT_TIP
) -> str:
    pooled, classes = Pooled(), Counter[tuple[str, str]]()
    for number, name in enumerate(names):
        scene = touch_scene(name, seed=seed + number, motors=motors, tip=tip)
        found = detected(scene.sound, 48_000, tip)
        pooled.add(list(scene.times("tap")), moments(found, "tap"))
        classes += confusion(scene.events, found, KINDS)
    # A knock in the air is rejected, whether it is reported as one or not at all.
    classes["knock", "knock"] += classes.pop(("knock", MISSED), 0)
    noise = f"{tip}, " + ("competition's noise" if motors else "quiet room")
    rows = [
        f"| simulated, {len(names)} objects, {noise}: touch-downs F at 50 ms / 10 ms "
        f"| {pooled.score(0.05):.3f} / "
        f"{pooled.score(0.01):.3f} ({pooled.true} true, {pooled.found} found) |",
        f"| the same: class right | {class_accuracy(classes):.3f} of "
        f"{classes.total()} |",
    ]
    for kind in KINDS:
        total = sum(count for (true, _), count in classes.items() if true == kind)
        split = ", ".join(
            f"{count} {found}"
            for (true, found), count in classes.most_common()
            if true == kind
        )
        rows.append(f"| - {kind}, {total} | {split} |")
    return "\n".join(rows)


def sliding(names: tuple[str, ...], *, motors: bool, seed: int) -> str:
    """False taps a minute of simulated sliding: landings are true."""
    false, minutes = 0, 0.0
    for number, name in enumerate(names):
        scene = touch_scene(
            name,
            seed=seed + 100 + number,
            duration=60.0,
            taps=False,
            knocks=False,
            motors=motors,
        )
        found = moments(detected(scene.sound, 48_000), "tap")
        false += len(found) - len(match_moments(list(scene.times("tap")), found, 0.05))
        minutes += len(scene.sound) / 48_000 / 60
    noise = "competition's noise" if motors else "quiet room"
    return (
        f"| simulated sliding, {noise}: false taps in 10 min | "
        f"{10 * false / minutes:.1f} ({minutes:.1f} min) |"
    )


def tapsense(folder: Path) -> Iterator[str]:
    taps = labelled(folder, "tap")
    for part in ("train", "test"):
        pooled = Pooled()
        for file, truth in taps.items():
            if file.endswith("_test.flac") == (part == "test"):
                sound, rate = soundfile.read(
                    folder / file, dtype="float32", always_2d=True
                )
                pooled.add(
                    [begin for begin, _ in truth], moments(detected(sound, rate), "tap")
                )
        yield (
            f"| `tapsense`, {part} files, one air microphone: F at 50 ms / 10 ms | "
            f"{pooled.score(0.05):.3f} / "
            f"{pooled.score(0.01):.3f} ({pooled.true} true, {pooled.found} found) |"
        )


def phac(folder: Path) -> Iterator[str]:
    """Taps are the short gaps between what is labelled as no contact: by sound, and by
    the contact gate."""
    pooled, pressed = Pooled(), {True: Pooled(), False: Pooled()}
    for file, quiet in labelled(folder, "no_contact").items():
        sound, rate = soundfile.read(folder / file, dtype="float32", always_2d=True)
        gaps = [(before[1], after[0]) for before, after in pairwise(quiet)]
        truth = [(begin + end) / 2 for begin, end in gaps if end - begin < 1.0]
        end = (
            max([0.0, *(end for begin, end in gaps if end - begin < 1.0)]) + PHAC_WINDOW
        )
        first = sound[: round((end + 0.2) * rate), :1]
        pooled.add(
            truth,
            [tap for tap in moments(detected(first, rate), "tap") if tap < end],
            (PHAC_WINDOW,),
        )
        begins = [begin for begin, end in gaps if end - begin < 1.0]
        pressed[file.startswith(PHAC_TRAIN)].add(
            begins, [press for press in presses(first, rate) if press < end]
        )
    score = pooled.score(PHAC_WINDOW)
    yield (
        f"| `phac`, first taps, 2.2 kHz: F at 250 ms | {score:.3f} ({pooled.true} "
        f"true, {pooled.found} found) |"
    )
    for chosen, gate in pressed.items():
        title = "materials of the threshold" if chosen else "other materials"
        yield (
            f"| the same by a contact gate {PRESS_DB:g} dB over the median, {title}: "
            "F at 50 ms of the label's begin | "
            f"{gate.score(0.05):.3f} ({gate.true} true, {gate.found} found) |"
        )
    yield from press_power(folder)


def press_power(folder: Path) -> Iterator[str]:
    """How far the loudest 20 ms of presses, and of rest, exceed the median of rest, by
    band; p50 of the recordings."""
    over: dict[tuple[int, int], list[tuple[float, float]]] = defaultdict(list)
    for file, quiet in labelled(folder, "no_contact").items():
        gaps = [
            (before[1], after[0])
            for before, after in pairwise(quiet)
            if after[0] - before[1] < 1.0
        ]
        if not file.startswith(PHAC_TRAIN) or not gaps:
            continue
        sound, rate = soundfile.read(folder / file, always_2d=True)
        time = np.arange(len(sound)) / rate
        pressed = np.any(
            [(time > begin - 0.05) & (time < end + 0.05) for begin, end in gaps], axis=0
        )
        rest = np.any(
            [(time > begin + 0.3) & (time < end - 0.3) for begin, end in quiet], axis=0
        )
        for band in ((5, 50), (50, 100), (100, 200), (200, 500)):
            part = sosfilt(
                butter(4, band, "bandpass", fs=rate, output="sos"), sound[:, 0]
            )
            level = 10 * np.log10(
                np.convolve(
                    np.square(part), np.full(round(0.02 * rate), 50 / rate), "same"
                )
                + 1e-15
            )
            median = np.median(level[rest])
            over[band].append(
                (level[pressed].max() - median, level[rest].max() - median)
            )
    for (low, high), levels in over.items():
        press, resting = np.median(levels, axis=0)
        title = (
            f"`phac`, {low}-{high} Hz: loudest 20 ms of presses, of rest, over "
            "the median of rest"
        )
        yield f"| {title} | {press:.0f}, {resting:.0f} dB |"


def presses(sound: NDArray[np.float32], rate: int) -> list[float]:
    """Return when a contact gate opens."""
    size = round(0.032 * rate)
    powers = (
        np.square(sound[: len(sound) // size * size, 0], dtype=np.float64)
        .reshape(-1, size)
        .mean(axis=1)
    )
    gate = ContactGate(
        10 * np.log10(np.median(powers)) + PRESS_DB, sample_rate=rate, hold=0.1
    )
    states = gate.push(AudioBlock(sound, rate))
    return [
        now.time
        for before, now in pairwise(states)
        if now.touching and not before.touching
    ]


def lmt(folder: Path) -> Iterator[str]:
    for title, chosen in (("surfaces of the design", True), ("other surfaces", False)):
        false, minutes = 0, 0.0
        for path in sorted(folder.glob("*.flac")):
            if (path.stem.rpartition("_")[0] in LMT_TRAIN) == chosen:
                sound, rate = soundfile.read(path, dtype="float32", always_2d=True)
                false += len(moments(detected(sound, rate), "tap"))
                minutes += len(sound) / rate / 60
        if not minutes:
            continue
        share = f"{10 * false / minutes:.1f} ({minutes:.1f} min)"
        yield (
            f"| `lmt`, sliding stylus, one microphone, {title}: taps in 10 min | "
            f"{share} |"
        )


def double_taps(folder: Path) -> Iterator[str]:
    """How many windows of `taps` have a tap, each between 0.8 s and 0.4 s of its own
    noise, and how many a second one.

    Most windows end within 2.5 ms of the onset of their second tap. So that is
    *completed*: from its onset on, by the whole first tap of the next window that has
    one.
    """
    for file, title in (
        ("double_left_palm", "double taps, left"),
        ("double_right_palm", "right"),
        ("noise_and_typing", "typing and noise"),
    ):
        sound, rate = soundfile.read(folder / f"{file}.flac", dtype="float32")
        windows = sound.reshape(-1, TAPS_WINDOW)
        heard = [found_among_noise(window, window) for window in windows]
        share = np.mean([bool(taps) for taps in heard])
        yield (
            f"| `taps`, a laptop's palm rest, {title}: a tap | {share:.1%} of "
            f"{len(windows)} |"
        )
        if file.startswith("double"):
            yield from second_taps(windows, heard, rate, title)


def second_taps(
    windows: NDArray[np.float32], heard: list[list[float]], rate: int, title: str
) -> Iterator[str]:
    """Of the windows with two onsets 150 ms apart or more, how many second taps are
    found."""
    onsets = [onsets_of(window, rate) for window in windows]
    whole = [
        number for number, (steps, level) in enumerate(onsets) if is_whole(steps, level)
    ]
    found: dict[int, list[tuple[bool, bool]]] = {0: [], 1: []}
    for number, (steps, _) in enumerate(onsets):
        if len(steps) < 2 or steps[-1] - steps[0] < APART:
            continue
        window = windows[number]
        second, completed = first_sample(window, steps[-1], rate), heard[number]
        if steps[-1] > len(window) // TAPS_STEP - 32:
            other = next((each for each in whole if each > number), whole[0])
            begin = first_sample(windows[other], onsets[other][0][0], rate)
            tap = windows[other][begin - 24 : begin + WHOLE * TAPS_STEP]
            completed = found_among_noise(
                np.concatenate((window[: second - 24], tap)), window
            )
        near = [
            any(abs(tap - second / rate) < 0.05 for tap in taps)
            for taps in (heard[number], completed)
        ]
        found[number % 2].append((near[0], near[1]))
    for odd, pairs in found.items():
        words = (
            f"{title}, {len(pairs)} {('even', 'odd')[odd]} windows of two onsets: "
            "second as recorded / completed"
        )
        yield "| {} | {:.1%} / {:.1%} |".format(words, *np.mean(pairs, axis=0))


def found_among_noise(
    sound: NDArray[np.float32], window: NDArray[np.float32]
) -> list[float]:
    """Return when taps are found in sound between 0.8 s and 0.4 s of a window's noise,
    its quietest 50 ms."""
    powers = np.square(window).reshape(-1, 2 * TAPS_STEP).mean(axis=1)
    powers = np.where(powers < 1e-11, 1, powers)  # no noise is digital silence
    quietest = int(np.convolve(powers, np.ones(10), "valid").argmin()) * 2 * TAPS_STEP
    noise = window[quietest : quietest + 20 * TAPS_STEP]
    before = np.tile(np.concatenate((noise, noise[::-1])), 8)
    heard = np.concatenate(
        (before, sound, before[: len(before) // 2])
    )  # a tap is known 80 ms after it
    return [
        tap - len(before) / 48_000
        for tap in moments(detected(heard[:, None], 48_000), "tap")
    ]


def over_200_hz(window: NDArray[np.float32], rate: int) -> NDArray[np.float64]:
    sound = sosfilt(
        butter(2, 200, "high", fs=rate, output="sos"),
        np.concatenate((window[::-1], window)),
    )
    return np.asarray(sound[len(window) :])


def onsets_of(
    window: NDArray[np.float32], rate: int
) -> tuple[list[int], NDArray[np.float64]]:
    """Return the steps of a window that are 12 dB over its median and over the 25 ms
    before; and the levels of all."""
    level = 10 * np.log10(
        np.square(over_200_hz(window, rate)).reshape(-1, TAPS_STEP).mean(axis=1) + 1e-12
    )
    steps: list[int] = []
    for step in range(4, len(level)):
        before = np.median(level[max(0, step - 12) : step - 2 + (step < 6)])
        if level[step] > 12 + max(before, np.median(level)) and (
            not steps or step - steps[-1] > 24
        ):
            steps.append(step)
    return steps, level


def is_whole(steps: list[int], level: NDArray[np.float64]) -> bool:
    """Whether the first tap of a window is loud, and long before its end."""
    loud = (
        level[steps[0] : steps[0] + 3].max() > np.median(level) + 20 if steps else False
    )
    return bool(loud) and steps[0] < len(level) - WHOLE - 2


def first_sample(window: NDArray[np.float32], step: int, rate: int) -> int:
    """Return the first sample of a step's onset: six times the level of the 20 ms
    before, or a fifth of its peak."""
    sound, begin = np.abs(over_200_hz(window, rate)), max(0, step - 2) * TAPS_STEP
    noise = np.sqrt(np.mean(np.square(sound[max(0, begin - 960) : begin + 1])))
    loud = max(6 * noise, 0.2 * sound[step * TAPS_STEP : (step + 1) * TAPS_STEP].max())
    return begin + int(np.argmax(sound[begin : (step + 1) * TAPS_STEP] > loud))


def labelled(folder: Path, label: str) -> dict[str, list[tuple[float, float]]]:
    found = defaultdict(list)
    with (folder / "segments.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["label"] == label:
                found[row["file"]].append((float(row["start_s"]), float(row["end_s"])))
    return found


REAL: dict[str, Callable[[Path], Iterable[str]]] = {
    "tapsense": tapsense,
    "phac": phac,
    "lmt": lmt,
    "taps": double_taps,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--train",
        action="store_true",
        help="the objects on which constants were chosen",
    )
    parser.add_argument(
        "--recordings",
        type=Path,
        default=os.environ.get("TACTOPHONE_RECORDINGS"),
        metavar="DIR",
        help="default: TACTOPHONE_RECORDINGS",
    )
    parser.add_argument(
        "--objects", type=int, metavar="N", help="only the first N (default: all)"
    )
    args = parser.parse_args()
    names, seed = (TRAIN, 700) if args.train else (HELD_OUT, 800)
    names = names[: args.objects]
    began = time.perf_counter()
    print("| what | measured |\n|---|--:|")
    for motors in (False, True):
        print(simulated(names, motors=motors, seed=seed))
        print(sliding(names, motors=motors, seed=seed), flush=True)
    print(simulated(names, motors=False, seed=seed, tip="stylus"), flush=True)
    if args.recordings and not args.train:
        for name, score in REAL.items():
            folder = Path(args.recordings) / name
            if folder.is_dir():
                for row in score(folder):
                    print(row, flush=True)
    print(
        "\nF: F-measure of the moments of touch-down, each within so many ms. "
        f"{MISSED.capitalize()}: no event of that kind is near. Took "
        f"{time.perf_counter() - began:.0f} s."
    )


if __name__ == "__main__":
    main()
