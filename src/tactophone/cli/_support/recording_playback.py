"""Recordings on the operator's page: heard, judged and felt again at the pace of the sound."""

import argparse
import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass

from tactophone.capture import FileSource
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import terminal
from tactophone.dataset import Segment, touch_at
from tactophone.haptics import Oscillator, Playback
from tactophone.pipeline import Pipeline
from tactophone.telemetry import State, Telemetry

BLOCK_DURATION = 0.01
"""Seconds of sound at once: as often as the page shows a tick."""


@dataclass(frozen=True, slots=True)
class Take:
    """A recording to be replayed: its sound, a walk made for it, and the truth where that is known."""

    source: FileSource
    walk: Pipeline
    truth: Sequence[Segment] = ()


def on_page(args: argparse.Namespace, takes: Sequence[Take], *, name: str) -> None:
    """Replay on the page, if one was asked for, one after another and from the first again, until interrupted."""
    if not args.dashboard or not takes:
        return
    with Telemetry(name) as telemetry, page.shown(args, name):
        terminal.log().print("replaying there until Ctrl-C")
        for take in itertools.cycle(takes):
            replay(take, telemetry)


def replay(take: Take, telemetry: Telemetry) -> None:
    """Replay once, in the time that the sound takes."""
    take.walk.reset()
    playback = Playback(Oscillator(take.walk.limits))
    source = FileSource(take.source.path, block_size=max(1, round(BLOCK_DURATION * take.source.sample_rate)))
    state, begin = _state(take), time.monotonic()
    with source:
        for block in source:
            time.sleep(max(0.0, begin + block.end / block.sample_rate - time.monotonic()))
            now = time.monotonic()
            tick = take.walk.push(block)
            telemetry.feel(playback.push(tick.commands, until=block.end / block.sample_rate))
            telemetry.publish(tick, now=now, truth=touch_at(block.time + block.duration / 2, take.truth))
            telemetry.update(state, now=now)


def _state(take: Take) -> State:
    return State(
        role="replay",
        muted_because="",
        ceiling=take.walk.limits.ceiling,
        local_ceiling=take.walk.limits.ceiling,
        profile=take.walk.profile.name,
        profiles=(take.walk.profile.name,),
        detector=take.walk.judge.detector.name,
        threshold_dbfs=take.walk.judge.threshold_dbfs,
        source=take.source.path.name,
        link="replay",
        sample_rate=take.source.sample_rate,
        channels=take.source.channels,
    )
