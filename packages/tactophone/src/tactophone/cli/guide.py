"""Guided steps of `setup` and `record`: level meters, a terminal and a page that show
them, and the sound of each step.

The page is on this machine, and there only with ``--dashboard``.
"""

import argparse
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from types import TracebackType
from typing import Any, Self

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.text import Text

from tactophone.app.check import record_act
from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.cli import console, options, output
from tactophone.core.errors import TactophoneError
from tactophone.core.microphones import CONTACT, MICROPHONES
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.calibration import Finding

LAST_LOOK = 0.3
"""Seconds for which the page of a command that waits for nobody stays, so that it shows
the end."""

DONE = "done"
"""Button that ends the page."""

METER_LOWEST_DBFS = -72.0
"""Level at the left end of a meter, in dBFS."""

WIDTH = 36
"""Characters of a meter: 2 dB each."""

METER_INTERVAL = 0.1
"""Seconds between two updates of the screen."""

PEAK_HOLD = 0.7
"""Factor by which a peak falls between two updates: slow enough to be read after a
tap."""

RED_DBFS = -1.0
"""Peak from which a meter is red, in dBFS: the converter is about to clip."""

YELLOW_DBFS = -6.0
"""Peak from which a meter is yellow, in dBFS."""


class Meters:
    """Measures levels; `rows` draws them, with a mark at the threshold unless that is
    NaN."""

    def __init__(self, channels: int, threshold_dbfs: float) -> None:
        self._threshold_dbfs = threshold_dbfs
        self._powers = np.zeros(channels)
        self._peaks = np.zeros(channels)
        self._next = 0.0

    def push(self, block: AudioBlock) -> None:
        """Add sound; levels are averaged over 0.1 s."""
        if not block.size:
            return
        power = np.square(block.samples, dtype=np.float64).mean(axis=0)
        self._powers += (power - self._powers) * min(
            1.0, block.duration / METER_INTERVAL
        )
        self._peaks = np.maximum(self._peaks, np.abs(block.samples).max(axis=0))

    def due(self) -> bool:
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + METER_INTERVAL
        return True

    def levels(self) -> list[tuple[str, float, float]]:
        """Return each microphone's name, level and peak in dBFS, and lower the
        peaks."""
        powers = np.sqrt(self._powers)
        peaks = self._peaks
        self._peaks = PEAK_HOLD * peaks
        return [
            (MICROPHONES[channel], _dbfs(powers[channel]), _dbfs(peaks[channel]))
            for channel in range(len(powers))
        ]

    def rows(
        self, levels: Sequence[tuple[str, float, float]] | None = None
    ) -> list[Text]:
        """Return a row of up to 80 characters for each microphone, of levels measured
        now if none are given."""
        return [
            self._row(*level) for level in (self.levels() if levels is None else levels)
        ]

    def _row(self, name: str, level_dbfs: float, peak_dbfs: float) -> Text:
        if peak_dbfs > RED_DBFS:
            style = "red"
        elif peak_dbfs > YELLOW_DBFS:
            style = "yellow"
        else:
            style = "green"
        filled = _place(level_dbfs)
        mark = _place(self._threshold_dbfs)
        row = Text(f" {name:8}")
        for place in range(WIDTH):
            if name == MICROPHONES[CONTACT] and place == mark:
                row.append("┃", "bold")
            else:
                row.append(
                    "█" if place < filled else "░", style if place < filled else "dim"
                )
        return row.append(f" {level_dbfs:5.0f} dBFS, peak {peak_dbfs:4.0f}", style)


def _place(level_dbfs: float) -> int:
    return (
        round(WIDTH * min(1.0, max(0.0, 1 - level_dbfs / METER_LOWEST_DBFS)))
        if math.isfinite(level_dbfs)
        else -1
    )


def _dbfs(amplitude: float) -> float:
    return (
        max(20 * math.log10(amplitude), METER_LOWEST_DBFS)
        if amplitude > 0
        else METER_LOWEST_DBFS
    )


def add_guidance(parser: argparse.ArgumentParser) -> None:
    """Add what every guided command takes: whether it waits, and where it shows."""
    parser.add_argument(
        "--yes",
        action="store_true",
        help="ask nothing, and start each step without a key press",
    )
    options.add_json(parser, "print the result as JSON")
    parser.add_argument(
        "--dashboard",
        action="store_true",
        help="guide on a page of this machine too, and print its address",
    )


class GuidePage:
    """A guided command's page; a context manager that shows an error and, with
    ``wait``, waits for *Done*."""

    def __init__(self, *, wait: bool) -> None:
        # Needed for --dashboard alone, as it imports processes.
        from tactophone.faces.web.server import serve_guide

        self._orders, page_end = Pipe()
        self._wait = wait
        self._finished = False
        self._page = serve_guide(page_end)

    def __enter__(self) -> Self:
        output.note(f"page: {self._page.url}")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if isinstance(error, TactophoneError):
                self.show(findings=[str(error)])
            if kind is None or isinstance(error, TactophoneError):
                self._await_done()
        finally:
            self._page.__exit__()

    def show(self, **entries: Any) -> None:
        """Show something on the page, in the words of ``static/guide.js``."""
        with suppress(OSError):  # the page's process has ended: the terminal goes on
            self._orders.send(entries)

    def pressed(self, timeout: float = 0.0) -> str:
        """Return the name of the button that was pressed, waiting up to ``timeout`` s;
        empty if none was.

        Without the page's process no button is ever pressed, and nothing is left to
        wait for at the end.
        """
        try:
            return str(self._orders.recv()) if self._orders.poll(timeout) else ""
        except (EOFError, OSError):
            return DONE if self._finished else ""

    def _await_done(self) -> None:
        if not self._wait:
            time.sleep(LAST_LOOK)
            return
        self._finished = True
        self.show(state="", countdown=[], levels=[], buttons={DONE: "Done"})
        output.log().print("the page stays until Done is pressed on it, or Ctrl-C here")
        while self.pressed(1.0) != DONE:
            pass


@dataclass(frozen=True, slots=True)
class GuideScreen:
    """A guided command's terminal and page."""

    live: Live | None = None
    """Display of the terminal, where there is one."""
    has_keyboard: bool = False
    """Whether keys of the terminal answer."""
    page: GuidePage | None = None
    steps: tuple[str, ...] = ()

    @property
    def answers(self) -> bool:
        return self.has_keyboard or self.page is not None

    def begin(self, step: int) -> None:
        """Mark a step as the current one; all before it are done."""
        if self.page is not None:
            coming = (
                {"instruction": f"Next: {self.steps[step]}"}
                if step < len(self.steps)
                else {}
            )
            self.page.show(
                steps=self.steps, step=step, state="", countdown=[], **coming
            )

    def offer(self, buttons: Mapping[str, str]) -> None:
        """Show buttons, by name, on the page; a second press of the last ones is
        dropped."""
        if self.page is not None:
            while self.page.pressed():
                pass
            self.page.show(buttons=dict(buttons))

    def show(
        self,
        meters: Meters,
        instruction: str,
        state: str,
        countdown: Sequence[float] = (),
    ) -> None:
        """Show an instruction, what to do now, the levels of the microphones, and what
        is left of how many seconds."""
        levels = meters.levels()
        if self.live is not None:
            rows = meters.rows(levels)
            self.live.update(
                Group(
                    Text(instruction, style="bold"),
                    *rows,
                    Text(f" {state}", style="cyan"),
                ),
                refresh=True,
            )
        if self.page is not None:
            self.page.show(
                instruction=instruction,
                state=state,
                levels=levels,
                countdown=list(countdown),
            )

    def pressed(self, timeout: float = 0.0) -> str:
        """Return the key or the button that was pressed, waiting up to ``timeout`` s
        for each; empty if none was."""
        key = console.read_key(timeout) if self.has_keyboard else ""
        return key or (self.page.pressed(timeout) if self.page is not None else "")


def record_step(
    audio: AudioInput,
    blocks: Iterator[AudioBlock],
    act: SimulatedAct,
    instruction: str,
    *,
    meters: Meters,
    screen: GuideScreen,
    wait: bool,
) -> FloatArray:
    """Give an instruction, wait for an answer if ``wait``, and return the sound,
    ``(samples, channels)``.

    Raises `DatasetError` if the sound ends too early.
    """
    if wait:
        screen.offer({"start": "Start"})
        while not screen.pressed():
            meters.push(next(blocks))
            if meters.due():
                screen.show(meters, instruction, "press a key to start")
        screen.offer({})

    def follow(block: AudioBlock, left: float) -> None:
        meters.push(block)
        if left > 0 and meters.due():
            screen.show(meters, instruction, f"{left:.1f} s", (left, act.duration))

    return record_act(audio, blocks, act, follow=follow)


class Steps:
    """Shows each step on the terminal and the page; a person starts it, unless
    ``unattended``."""

    def __init__(self, screen: GuideScreen, *, unattended: bool) -> None:
        self._screen = screen
        self._unattended = unattended

    def begin(self, number: int, audio: AudioInput) -> None:
        """Mark a step as the current one; at the first, open the meters."""
        if number == 1:
            self._meters = Meters(audio.source.channels, math.nan)
            self._wait = self._screen.answers and not (
                self._unattended or audio.simulated
            )
        self._screen.begin(number)

    def __call__(
        self,
        audio: AudioInput,
        blocks: Iterator[AudioBlock],
        act: SimulatedAct,
        instruction: str,
    ) -> FloatArray:
        return record_step(
            audio,
            blocks,
            act,
            instruction,
            meters=self._meters,
            screen=self._screen,
            wait=self._wait,
        )


def ask(screen: GuideScreen, question: str, buttons: dict[str, str], words: str) -> str:
    """Ask on the page and, in these words, on the terminal; return the button or the
    key that was pressed."""
    output.log().print(words, highlight=False, markup=False)
    if screen.page is not None:
        screen.begin(0)
        screen.page.show(instruction=question, buttons=buttons)
    while not (key := screen.pressed(0.5)):
        pass
    if key in console.QUIT_KEYS:
        raise KeyboardInterrupt
    if screen.page is not None:
        screen.page.show(instruction="Opening the microphones", buttons={})
    return key


def findings_in_words(findings: Sequence[Finding]) -> Iterator[output.Part]:
    for finding in findings:
        style, word = ("red", "refused:") if finding.fatal else ("yellow", "note:")
        yield output.styled(style, word, f" {finding}")
