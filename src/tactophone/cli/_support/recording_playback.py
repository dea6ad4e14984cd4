"""Recordings on the operator's page: played back through the pipeline at the pace of the sound."""

import argparse
import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactophone.capture import FileSource
from tactophone.cli._support import dashboard_options, terminal
from tactophone.dataset import Segment, touch_at
from tactophone.haptics import Oscillator, Playback
from tactophone.pipeline import Pipeline
from tactophone.telemetry import State, Telemetry

BLOCK_DURATION = 0.01
"""Seconds of sound in a block: the interval at which the page shows predictions."""


@dataclass(frozen=True, slots=True)
class Take:
    """A recording to play back, a pipeline opened for it, and its labels where they are known."""

    path: Path
    pipeline: Pipeline
    truth: Sequence[Segment] = ()


def play_on_page(args: argparse.Namespace, takes: Sequence[Take], *, name: str) -> None:
    """Play takes on the page, if ``--dashboard`` was set, over and over until interrupted."""
    if not (args.dashboard or args.lan) or not takes:
        return
    with Telemetry(name) as telemetry, dashboard_options.shown(args, name, live=False):
        terminal.log().print("playing back on the page until Ctrl-C")
        for take in itertools.cycle(takes):
            play(take, telemetry)


def play(take: Take, telemetry: Telemetry) -> None:
    """Play a take once, in real time."""
    pipeline = take.pipeline
    pipeline.reset()
    playback = Playback(Oscillator(pipeline.limits))
    source = FileSource(take.path)
    source = FileSource(take.path, block_size=max(1, round(BLOCK_DURATION * source.sample_rate)))
    state, begin = _state(take, source), time.monotonic()
    with source:
        for block in source:
            end = block.end / block.sample_rate
            time.sleep(max(0.0, begin + end - time.monotonic()))
            now = time.monotonic()
            step = pipeline.push(block)
            telemetry.rendered(playback.push(step.commands, until=end))
            telemetry.publish(step, now=now, truth=touch_at(block.time + block.duration / 2, take.truth))
            telemetry.update(state, now=now)


def _state(take: Take, source: FileSource) -> State:
    limits, profile = take.pipeline.limits, take.pipeline.profile.name
    return State(
        role="replay",
        muted_because="",
        ceiling=limits.ceiling,
        local_ceiling=limits.ceiling,
        profile=profile,
        profiles=(profile,),
        detector=take.pipeline.detector_name,
        threshold_dbfs=take.pipeline.threshold_dbfs,
        source=take.path.name,
        link="replay",
        sample_rate=source.sample_rate,
        channels=source.channels,
    )
