"""Live sound from Python: a source and a pipeline in this process, step by step or by
callback."""

import threading
from collections.abc import Callable, Iterator
from typing import Self

from msgspec.structs import replace

from tactophone.app.sources import UNATTENDED, open_source
from tactophone.core.settings import Settings, change
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import Closable, PipelineStep, Rehearsed, Source
from tactophone.live.audio.pacing import paced
from tactophone.signal.perception.opening import read_calibration
from tactophone.signal.pipeline import Pipeline, open_pipeline


class Live:
    """Live sound through a pipeline in this process, without link, actuator or
    watchdog; made by `open_live`.

    Iterate over it for its steps, or let it call you: ``with
    open_live().start(callback): ...``.
    """

    def __init__(self, source: Source, pipeline: Pipeline, *, at_pace: bool) -> None:
        self._source = source
        self._pipeline = pipeline
        self._at_pace = at_pace
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._moving = False
        self._error: BaseException | None = None

    def __repr__(self) -> str:
        thread = self._thread
        running = thread is not None and thread.is_alive()
        state = "running" if running else "not started or ended"
        source = type(self._source).__name__
        return f"<Live: {source} at {self._source.sample_rate} Hz, {state}>"

    def __iter__(self) -> Iterator[PipelineStep]:
        if isinstance(self._source, Rehearsed):
            self._source.rehearse()
        with self._source as source:
            for block in paced(source) if self._at_pace else source:
                if self._ended.is_set():
                    return
                yield self._pipeline.push(
                    replace(block, moving=True) if self._moving else block
                )

    def moving(self, moves: bool) -> None:
        """Say whether the robot moves now: around each start and stop, contact counts
        once it has lasted 150 ms."""
        self._moving = moves

    def start(self, callback: Callable[[PipelineStep], object]) -> Self:
        """Call back with each step from now on, in a thread of its own, until `stop` or
        the end of the sound.

        An exception, of the callback or the source, ends the run too; `stop` or `wait`
        raises it.
        """

        def run() -> None:
            try:
                for step in self:
                    callback(step)
            except BaseException as error:
                self._error = error

        self._thread = threading.Thread(target=run, name="tactophone-live", daemon=True)
        self._thread.start()
        return self

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of the sound, up to ``timeout`` s; returns whether it has
        ended.

        Raises what the callback or the source raised.
        """
        if self._thread:
            self._thread.join(timeout)
        error = self._error
        self._error = None
        if error:
            raise error
        return not (self._thread and self._thread.is_alive())

    def stop(self) -> None:
        """End the sound and wait for the callback that is running; not from within one.

        Closes the source if it has a method ``close``: a source that delivers nothing,
        as an unplugged microphone, must have one that ends its iteration. Raises what
        the callback or the source raised.
        """
        self._ended.set()
        if self._thread and isinstance(self._source, Closable):
            self._source.close()
        self.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def open_live(
    source: str | Source = "finger",
    model: str = "",
    *,
    profile: str = "graded",
    events: bool = False,
    tip: str = DEFAULT_TIP,
    calibration: str = "",
    check_microphones: bool = True,
) -> Live:
    """Open live sound and a pipeline for it, which decides as ``tactophone receive``
    does.

    Parameters
    ----------
    source
        As the option ``--source`` takes it: ``finger`` (simulated), ``jack``,
        ``portaudio:DEVICE``, ``microphone``, ``file:RECORDING`` or ``ros:/TOPIC``; or a
        `Source`.
    model
        As for `open_pipeline`.
    profile
        Name of a rendering profile.
    events
        Detect touch events (taps, strokes, slips); the profile ``events`` always does.
    tip
        Tip that touches, one of `tactophone.core.tips.TIP_NAMES`.
    calibration
        File that ``tactophone check`` wrote for this finger; empty: none. One of
        another number of microphones is not used.
    check_microphones
        As for `open_pipeline`.

    Raises
    ------
    ConfigError
        If there is no such source, or an extra that it needs is not installed.

    Examples
    --------
    ::

        for step in tactophone.open_live("finger"):
            print([prediction.roughness for prediction in step.predictions])
    """
    opened = _open(source, tip) if isinstance(source, str) else source
    pipeline = open_pipeline(
        model,
        sample_rate=opened.sample_rate,
        channels=opened.channels,
        profile=profile,
        events=events,
        tip=tip,
        calibration=read_calibration(calibration, opened.channels),
        check_microphones=check_microphones,
    )
    return Live(
        opened,
        pipeline,
        at_pace=isinstance(source, str) and source.partition(":")[0] in UNATTENDED,
    )


def _open(text: str, tip: str) -> Source:
    kind, _, device = text.partition(":")
    capture = {"source": kind, "device": device, "tip": tip, "loop": "false"}
    return open_source(
        change(
            Settings(),
            [f"capture.{name}={value}" for name, value in capture.items()],
            where="live",
        )
    )
