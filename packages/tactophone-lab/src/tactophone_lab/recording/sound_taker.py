"""Sound and keys taken in a thread of their own, so that neither a slow disk nor a
terminal that stands still costs a take any sound.

A `tactophone.live.audio.sources.LiveSource` drops what waits for over 60 ms, as it
would be felt too late. A take needs it, however late it is written.
"""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Self

from tactophone.core.types import AudioBlock
from tactophone_lab.recording.protocol import Key

MOST_BLOCKS = 1 << 14
"""Blocks that may wait: 87 s with periods of 256 samples, in some tens of MB."""

WAIT = 0.25
"""Seconds after which reader and thread look again whether to go on, and for which the
reader waits for the thread at the end."""


class SoundTaker:
    """Iterates the blocks of a source, each with the key that was pressed as it came,
    in whatever time the reader takes; a context manager.

    - ``key``: called in the thread, after each block.
    - ``ahead``: whether there is a thread. Simulated sound is not to be read ahead: it
      waits for its reader, who says what is to be done next.

    What the source raises is raised here, after the sound before it.
    """

    def __init__(
        self,
        source: Iterable[AudioBlock],
        key: Callable[[], Key | None],
        *,
        ahead: bool,
    ) -> None:
        self._ahead = ahead
        self._source = source
        self._key = key
        self._taken: queue.Queue[tuple[AudioBlock, Key | None] | Exception | None] = (
            queue.Queue(MOST_BLOCKS)
        )
        """Sound and keys; at the end an error, or ``None`` where there was none."""
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=self._take, name="take the sound", daemon=True
        )

    def __enter__(self) -> Self:
        if self._ahead:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        # Where no sound comes, the thread ends when the source is closed.
        self._ended.set()
        if self._ahead:
            self._thread.join(WAIT)

    def __iter__(self) -> Iterator[tuple[AudioBlock, Key | None]]:
        if not self._ahead:
            yield from ((block, self._key()) for block in self._source)
            return
        while True:
            try:
                taken = self._taken.get(timeout=WAIT)
            except queue.Empty:
                continue  # Windows obeys Ctrl-C between two waits alone
            if taken is None:
                return
            if isinstance(taken, Exception):
                raise taken
            yield taken

    @property
    def waiting(self) -> bool:
        """Whether the reader is behind the sound."""
        return not self._taken.empty()

    def _take(self) -> None:
        end = None
        try:
            for block in self._source:
                self._put((block, self._key()))
                if self._ended.is_set():
                    return
        except Exception as error:
            end = error
        self._put(end)

    def _put(self, taken: tuple[AudioBlock, Key | None] | Exception | None) -> None:
        while not self._ended.is_set():
            try:
                self._taken.put(taken, timeout=WAIT)
            except queue.Full:
                continue
            return
