"""Recordings as a run that pages show: played back through the pipeline at the pace of
the sound."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import structs

from tactophone.core.recordings.values import Segment, touch_at
from tactophone.live.audio.files import FileSource
from tactophone.live.runtime.output_gate import EMERGENCY_STOP, MUTED, armings_first
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry
from tactophone.signal.haptics.sound_playback import open_playback
from tactophone.signal.pipeline import Pipeline

BLOCK_DURATION = 0.01
"""Seconds of sound in a block: the interval at which the page shows predictions."""


@dataclass(frozen=True, slots=True)
class PlayableRecording:
    """A recording to play back under a title, a pipeline opened for it, and its labels
    where they are known.

    There are a recording and a pipeline for each of the ``fingers``, which these name.
    """

    title: str
    paths: Sequence[Path]
    pipelines: Sequence[Pipeline]
    truth: Sequence[Segment] = ()
    fingers: Sequence[str] = ("",)


def play(
    take: PlayableRecording, telemetry: Telemetry, position: float = 0.0
) -> float | None:
    """Play a take from a position in s, in real time; of a hand, until its shortest
    recording ends.

    A page may feel it, so a stop and a mute hold, from one take to the next, until
    somebody arms. Returns the position that a page has asked for meanwhile, or ``None``
    at the end.
    """
    for pipeline in take.pipelines:
        pipeline.reset()
    with ExitStack() as stack:
        sources = [stack.enter_context(_source(path)) for path in take.paths]
        playbacks = [
            open_playback(
                pipeline.profile.name,
                pipeline.limits,
                channels=source.channels,
                sample_rate=source.sample_rate,
            )
            for source, pipeline in zip(sources, take.pipelines, strict=True)
        ]
        before = telemetry.state
        halted = before.fingers[0].muted_because if before.role == "replay" else ""
        state = _gated(_state(take, sources[0]), halted)
        begin = time.monotonic() - position
        for blocks in zip(*sources, strict=False):
            end = blocks[0].end / blocks[0].sample_rate
            if end <= position:
                for playback in playbacks:
                    playback.skip(end)
                continue
            time.sleep(max(0.0, begin + end - time.monotonic()))
            paused = time.monotonic()
            state, sought = _obey(telemetry, state)
            if sought is not None:
                return sought
            now = time.monotonic()
            begin += now - paused  # a pause moves all that follows
            for finger, (block, pipeline, playback) in enumerate(
                zip(blocks, take.pipelines, playbacks, strict=True)
            ):
                step = structs.replace(pipeline.push(block), finger=finger)
                playback.hear(block)
                telemetry.rendered(
                    playback.push(step.commands, until=end), finger=finger
                )
                telemetry.publish(
                    step,
                    now=now,
                    truth=touch_at(block.time + block.duration / 2, take.truth),
                )
            telemetry.update(state, now=now)
    return None


def _obey(telemetry: Telemetry, state: RunState) -> tuple[RunState, float | None]:
    """Carry out what pages ask; while paused, wait here. Returns where to go on, if a
    page has moved the position.

    Of what arrives together all holds, and a stop or a mute wins over an arming.
    """
    while True:
        sought = None
        for request in armings_first(telemetry.requests(now := time.monotonic())):
            if request.action == "seek":
                sought = request.value
            if request.action == "pause":
                state = replace(state, paused=bool(request.value))
            if request.action in ("stop", "mute", "arm"):
                state = _gated(state, _cause(state, request.action))
        if sought is not None:
            telemetry.update(state, now=now)  # from which playing goes on
            return state, sought
        if not state.paused:
            return state, None
        telemetry.update(state, now=now)
        time.sleep(BLOCK_DURATION)


def _cause(state: RunState, action: str) -> str:
    """Return why a replay is silent after a request; a mute makes a stop no weaker."""
    match action:
        case "stop":
            return EMERGENCY_STOP
        case "mute":
            return state.fingers[0].muted_because or MUTED
        case _:
            return ""


def _gated(state: RunState, halted: str) -> RunState:
    """Return the state with all fingers silent for a reason, or armed without one."""
    fingers = (
        replace(finger, armed=not halted, muted_because=halted)
        for finger in state.fingers
    )
    return replace(state, fingers=tuple(fingers))


def _source(path: Path) -> FileSource:
    return FileSource(
        path, block_size=max(1, round(BLOCK_DURATION * FileSource(path).sample_rate))
    )


def _state(take: PlayableRecording, source: FileSource) -> RunState:
    fingers = tuple(
        FingerState(
            name=name,
            ceiling=pipeline.limits.ceiling,
            local_ceiling=pipeline.limits.ceiling,
            profile=pipeline.profile.name,
            detector=pipeline.detector.name,
            threshold_dbfs=pipeline.detector.threshold.dbfs,
        )
        for name, pipeline in zip(take.fingers, take.pipelines, strict=True)
    )
    return RunState(
        role="replay",
        profiles=(fingers[0].profile,),
        source=take.title,
        link="replay",
        sample_rate=source.sample_rate,
        channels=source.channels,
        fingers=fingers,
        duration=source.duration,
    )
