"""The live console of a running side: one line that changes, messages below it, and the
keys that control it."""

import contextlib
import math
import os
import re
import select
import signal
import sys
import threading
import time
import unicodedata
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from types import FrameType
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from tactophone.cli import output
from tactophone.core.processes import never_suspended
from tactophone.core.settings import DEFAULT_CEILING
from tactophone.core.types import Touch
from tactophone.live.telemetry.layout import Action, Fault, RunState, ended_faults
from tactophone.live.telemetry.watcher import Snapshot, Watcher

if TYPE_CHECKING:  # its import takes 0.3 s, which would slow down --help
    from tactophone.live.runtime.supervisor import Supervisor

RUN_KEYS: dict[str, Action] = {" ": "stop", "m": "mute", "a": "arm"}
"""Which key makes which request; the space bar is the emergency stop, as it is the
largest key. A page's keys are in `faces/web/static/stop.js`."""

QUIT_KEYS = ("q", "\x03", "\x04")
"""Keys that end the run: q, Ctrl-C and Ctrl-D."""

SILENCING_KEYS = (" ", *QUIT_KEYS, "m")
"""Keys after which nothing vibrates, the most urgent first."""

MOST_TYPED = 4096
"""Bytes that a terminal holds at most."""

ESCAPE = "\x1b"
"""First of what a terminal sends for an arrow or a function key, and for Alt with a
key."""

ESCAPED = re.compile(r"\x1b(\[[0-?]*[@-~]|O[0-9;]*[@-~])")
"""An arrow or a function key (ECMA-48, CSI and SS3); it holds no space."""

UNFINISHED = re.compile(rb"\x1b(\[[0-?]*|O[0-9;]*)?")
"""The beginning of one of these, or of Alt with a key."""

ESCAPE_PATIENCE = 0.02
"""Seconds within which the next byte after Escape belongs to it: no person types as
fast."""

ALONE = 0.1
"""Seconds without any other key before and after the one that arms: a paste may come in
pieces, and over a slow line letter by letter."""

PATIENCE = 0.3
"""Seconds after the end of a run was asked for until its vibration is stopped, where it
has not ended: more than between two updates of the line."""

KEYS_HELP = "space: emergency stop   m: mute   a: arm   q: quit"

NOT_SUSPENDED = "Ctrl-Z does not suspend a run: q ends it"
"""Said after Ctrl-Z, which a robot's side ignores."""

STOPPED_INSTEAD = "; the vibration is stopped, and `a` or `tactophone arm` arms it"
"""Said as well where something could vibrate."""

IN_BACKGROUND = (
    "in the background no key reaches the run: `tactophone stop` stops what vibrates "
    "here, and `fg` with Ctrl-C ends the run"
)
"""Said where the terminal's keys belong to another program."""

STRIP = 60
"""Updates, 12 s, of vibration that the line above the figures shows; the newest is at
its right."""

TOUCH_STYLES = {Touch.SMOOTH: "blue", Touch.ROUGH: "red"}
"""How vibration is drawn: in the terminal's own colours, which its theme makes
legible."""

MOST_WORDS = 500
"""Most characters of a message: some come from the other end."""

REFRESH_INTERVAL = 0.2
"""Seconds between two updates; a person reads no faster, and this process also hosts
the watchdog."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    ``last`` is its last snapshot, if it ever started, ``restarts`` how often a side was
    restarted, and ``received`` the signals to end it, also those that come while its
    sides end.
    """

    last: Snapshot | None
    restarts: int
    received: Sequence[int] = ()

    @property
    def signal(self) -> int:
        """What ended it: SIGINT, SIGTERM, or 0 where it ended by itself, by a key or by
        its duration."""
        return self.received[0] if self.received else 0

    @property
    def exit_code(self) -> int:
        """130 after Ctrl-C; 0 after SIGTERM too, by which a service manager ends a run
        in order."""
        return 130 if self.signal == signal.SIGINT else 0


@dataclass(frozen=True, slots=True)
class Keys:
    """The keyboard of a run of that name: ``ending`` is set once the run is to end, as
    a key may ask; from then on no key arms. ``following`` is set by `follow`, which
    looks at that."""

    name: str
    ending: threading.Event = field(default_factory=threading.Event)
    following: threading.Event = field(default_factory=threading.Event)

    def end(self) -> None:
        """End the run, or its start, which waits for what begins and leaves by
        SIGTERM."""
        again = self.ending.is_set()
        self.ending.set()
        if not again and not self.following.is_set():
            os.kill(os.getpid(), signal.SIGTERM)


@contextlib.contextmanager
def keys_obeyed(name: str) -> Iterator[Keys]:
    """Obey the keys for a run of that name. Open it before the run starts, which may
    vibrate before all that records and shows it has started, and leave it once the run
    has ended. In the main thread: a key that ends the start raises `SystemExit`."""
    from tactophone.live.runtime.supervisor import left_by_sigterm

    keys = Keys(name)
    with single_keys() as has_keyboard:
        if not has_keyboard:
            if _has_terminal():
                output.note(IN_BACKGROUND)
            yield keys
            return
        with left_by_sigterm():
            output.log().print(Text(KEYS_HELP, style="dim"))
            with _obeying(keys):
                yield keys


def follow(
    supervisors: "Sequence[Supervisor]", keys: Keys, *, duration: float = 0.0
) -> Outcome:
    """Show a run until a side ends by itself, somebody quits, or the time is over.

    The first of the ``supervisors`` to end by itself ends all. A ``duration`` of 0 s
    means no limit. A terminal that stands still holds up whoever writes to it, so a
    signal or the end of the time stops the vibration, where this does not return soon.
    """
    keys.following.set()
    view = _ConsoleView(keys.name)

    def stop() -> None:
        for side in supervisors:
            side.stop_emergency()

    def suspend() -> None:
        stop()
        view.suspensions += 1

    deadline = time.monotonic() + duration if duration else float("inf")
    returned = threading.Event()

    def stop_unless_returned(after: float) -> None:
        if not returned.wait(after + PATIENCE):
            stop()

    def stop_later(after: float) -> None:
        threading.Thread(
            target=stop_unless_returned, args=(after,), daemon=True
        ).start()

    if duration:
        stop_later(duration)
    with (
        _set_at_end(keys.ending),
        _set_at_end(returned),
        _signals(stop, lambda: stop_later(0.0)) as received,
        never_suspended(suspend),
        output.live_display() as live,
    ):
        view.update()  # of the shortest run too
        while (
            not received
            and not keys.ending.is_set()
            and time.monotonic() < deadline
            and all(side.running for side in supervisors)
        ):
            view.update()
            if live is not None:
                live.update(view.line(), refresh=True)
            left = max(0.0, deadline - time.monotonic())
            if supervisors[0].wait(min(REFRESH_INTERVAL, left)):
                break
    return Outcome(view.last, sum(side.restarts for side in supervisors), received)


class _ConsoleView:
    def __init__(self, name: str) -> None:
        self.last: Snapshot | None = None
        self.suspensions = 0
        """How often Ctrl-Z was pressed, by a signal handler; what was said of it is
        taken off."""
        self._name = name
        self._watcher: Watcher | None = None
        self._printed: dict[str, str] = {}
        self._faults: tuple[Fault, ...] = ()
        self._felt: deque[tuple[Touch, float]] = deque(
            [(Touch.NONE, 0.0)] * STRIP, STRIP
        )

    def update(self) -> None:
        """Take a snapshot, and print what has changed in its state."""
        self._watcher = self._watcher or Watcher.find(self._name)
        if self._watcher is not None:
            self._watcher.follow(drain=False)
            self.last = self._watcher.snapshot()
            self._print_changes(self.last.state)
            if self.suspensions:
                self.suspensions = 0
                operates = self.last.state.role == "operator"
                output.warn(NOT_SUSPENDED + STOPPED_INSTEAD * operates)
            if self.last.steps.size:
                step = self.last.steps[-1]
                self._felt.append((Touch(step["touch"]), float(step["amplitude"])))

    def line(self) -> Text:
        if self.last is None or not self.last.alive:
            return Text("waiting for sound ...", style="yellow")
        figures = _line(self.last)
        return (
            figures
            if self.last.state.role != "operator"
            else Text("\n").join([_strip(self._felt), figures])
        )

    def _print_changes(self, state: RunState) -> None:
        # One entry per subject, so that a message is printed when it appears or
        # changes, not at every update.
        messages = {
            f"fault {fault.code}": f"! {fault.text}" for fault in state.faults
        } | {"link": state.link}
        if state.role == "operator":
            cause = state.muted_because.removeprefix("muted: ")
            messages["muted"] = f"muted: {cause}" if cause else "armed"
        new = [
            text
            for subject, text in messages.items()
            if text and self._printed.get(subject) != text
        ]
        over = [fault.end for fault in ended_faults(self._faults, state.faults)]
        for text in (*new, *over):
            output.log().print(text[:MOST_WORDS], soft_wrap=True)
        self._printed = messages
        self._faults = state.faults


@contextlib.contextmanager
def _obeying(keys: Keys) -> Iterator[None]:
    """Make the requests of keys meanwhile, in a thread that writes nothing: a terminal
    that stands still holds up whoever writes to it.

    They reach the run's own side alone: a run of another process may have its name.
    What silences a run that is not there yet lets it begin stopped. As it may be a
    while until somebody looks at ``ending``, a key that ends the run mutes. Where the
    thread fails, the run ends: no key would stop it any more.
    """
    from tactophone.live.runtime.supervisor import side_of

    ended = threading.Event()

    def obey() -> None:
        watcher: Watcher | None = None
        stopped = False
        typed_at = -math.inf
        while not ended.is_set():
            key = ""
            before = typed_at
            if typed := _typed(REFRESH_INTERVAL):
                key = _key_of(typed)
                typed_at = time.monotonic()
            side = side_of(keys.name)
            pid = side.pid if side and side.state == "running" else 0
            # Kept rather than found anew: the memory may lose its name, which another
            # run may take.
            if side and pid and not (watcher and watcher.pid == pid):
                with contextlib.suppress(OSError):  # no memory at this moment
                    watcher = side.watcher()
            reached = watcher if watcher and watcher.pid == pid else None
            action = "mute" if key in QUIT_KEYS else RUN_KEYS.get(key)
            if action == "arm":
                seen = reached.silenced if reached else 0
                alone = len(typed) == 1 and typed_at - before > ALONE
                if not alone or _waits(ALONE) or keys.ending.is_set():
                    continue
                # Whoever stopped or muted meanwhile did so after the key.
                if reached and reached.silenced == seen:
                    reached.ask("arm")
            elif action and reached:
                reached.ask(action)
            elif action:
                stopped = True
            if stopped and side:
                side.stop_emergency()
                stopped = False
            if key in QUIT_KEYS:
                keys.end()

    def obey_or_end() -> None:
        try:
            obey()
        except BaseException:
            keys.end()
            raise

    thread = threading.Thread(target=obey_or_end, name="keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _strip(felt: Iterable[tuple[Touch, float]]) -> Text:
    """Draw the vibration of each update: a bar from 1/8 at -30 dB to the whole height
    at the default ceiling."""
    strip = Text(no_wrap=True)
    full_db = 20 * np.log10(DEFAULT_CEILING)
    for touch, amplitude in felt:
        level_db = 20 * np.log10(max(amplitude, 1e-6))
        height = round(np.interp(level_db, (-30, full_db), (1, 8)))
        strip.append(
            "▁▂▃▄▅▆▇█"[height - 1] if amplitude else "·", TOUCH_STYLES.get(touch, "dim")
        )
    return strip


def _line(snapshot: Snapshot) -> Text:
    # The newest 0.1 s.
    peaks = np.abs(snapshot.sound[-4800:]).max(axis=0, initial=1e-6)
    contact, air = 20 * np.log10(np.maximum(peaks, 1e-6))
    parts = [f"contact {contact:4.0f}  air {air:4.0f} dBFS"]
    if snapshot.steps.size and snapshot.state.role == "operator":
        step = snapshot.steps[-1]
        parts.append(
            f"{Touch(step['touch']).name.lower():6} {step['frequency']:3.0f} Hz "
            f"{step['amplitude']:4.2f}"
        )
    counters = snapshot.counters
    packets = counters["packets_received"] or counters["packets_sent"]
    parts.append(f"{counters['packets_lost']} lost of {packets}")
    total = snapshot.gauges["latency_total"]
    if np.isfinite(total):
        parts.append(f"{1000 * total:.1f} ms")
    style = (
        "green"
        if snapshot.state.role != "operator" or snapshot.state.armed
        else "yellow"
    )
    return Text("  ".join(parts), style=style, no_wrap=True, overflow="ellipsis")


@contextlib.contextmanager
def _set_at_end(event: threading.Event) -> Iterator[None]:
    try:
        yield
    finally:
        event.set()


@contextlib.contextmanager
def _signals(
    stop: Callable[[], None], ending: Callable[[], None]
) -> Iterator[list[int]]:
    """Yield the signals received that end a run in order, of which ``ending`` is told;
    SIGUSR1 is an emergency stop that keeps it running."""
    received: list[int] = []

    def end(number: int, _: object) -> None:
        received.append(number)
        ending()

    handlers: dict[int, Callable[[int, FrameType | None], None]] = {
        signal.SIGTERM: end,
        signal.SIGUSR1: lambda *_: stop(),
    }
    # A shell lets a script's background jobs ignore SIGINT, which they then keep.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        handlers[signal.SIGINT] = end
    before = {
        number: signal.signal(number, handler) for number, handler in handlers.items()
    }
    try:
        yield received
    finally:
        # The sides end now: a service manager's signal is still only noted, as it would
        # cut that short; a person's may.
        for number, handler in (before | {signal.SIGTERM: end}).items():
            signal.signal(number, handler)


@contextlib.contextmanager
def single_keys() -> Iterator[bool]:
    """Read keys as they are pressed, without Enter; yields whether there is a keyboard
    to read from."""
    if not _has_terminal() or not _in_foreground():
        yield False
        return
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        pressed = termios.tcgetattr(terminal)
        pressed[0] &= ~termios.IXON  # Ctrl-S is a key that does nothing
        termios.tcsetattr(terminal, termios.TCSANOW, pressed)
        yield True
    finally:
        if _in_foreground():  # else the terminal is set as another program needs it
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _has_terminal() -> bool:
    # Python has no standard input at all where it was closed.
    return sys.stdin is not None and sys.stdin.isatty() and os.name == "posix"


def _in_foreground() -> bool:
    """Return whether the terminal's keys belong to this process.

    The system stops one in the background that reads from or sets the terminal. One
    whose terminal is not its controlling one is not stopped: it counts as in front.
    """
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return True


def read_key(timeout: float) -> str:
    """Wait up to ``timeout`` seconds for a key; empty when none is pressed in time.

    Of several that wait, only one that silences or ends a run counts.
    """
    typed = _typed(timeout)
    return _key_of(typed) if typed else ""


def _typed(timeout: float) -> bytes:
    """Wait up to ``timeout`` seconds for what the terminal sends."""
    if _in_foreground():
        if not _waits(timeout):
            return b""
        with contextlib.suppress(OSError):
            if typed := os.read(sys.stdin.fileno(), MOST_TYPED):
                return typed
    # Nobody can type: it is in the background, or its terminal is gone.
    time.sleep(timeout)
    return b""


def _waits(timeout: float) -> bool:
    """Return whether something is typed within ``timeout`` seconds."""
    return bool(select.select([sys.stdin], [], [], timeout)[0])


def _key_of(typed: bytes) -> str:
    """Return the key behind what the terminal sent at once; empty for a paste, and for
    an arrow, a function key or Alt with a letter, which begin with Escape.

    What silences or ends a run counts in any company, as a hand that hits the space bar
    may hit Alt and an arrow with it.
    """
    # Over a slow line the rest of it comes later.
    while UNFINISHED.fullmatch(typed) and (more := _typed(ESCAPE_PATIENCE)):
        typed += more
    text = typed.decode(errors="ignore")
    plain = _plain(ESCAPED.sub("", text))
    if key := next((key for key in SILENCING_KEYS if key in plain), ""):
        return key
    # One key, pressed or held.
    return text[0] if len(set(text)) == 1 and text[0] != ESCAPE else ""


def _plain(text: str) -> str:
    """Return each key as it is without others: Ctrl with the space bar sends NUL, AltGr
    a no-break space, an input method a wide one, and Caps Lock makes letters large."""
    return unicodedata.normalize("NFKC", text).replace("\0", " ").lower()
