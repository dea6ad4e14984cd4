"""Files that a run reads at its start, watched while it goes on.

A run keeps what it has read of models and calibrations, and a process that replaces a
failed one reads them anew. So somebody who changes such a file under a run is told what
the run does. The trusted peers are the exception: they are read again, so that a
machine that is no longer trusted loses its connection at once.

A file is opened only where the system says that it was changed: a run that goes on
loads nothing.
"""

import hashlib
import os
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from tactophone.core.errors import ConfigError, ModelError
from tactophone.core.hand import each_finger
from tactophone.core.plugins import DETECTORS, registered
from tactophone.core.processes import FileStamp, file_stamp
from tactophone.core.settings import Settings
from tactophone.live.telemetry.layout import Fault
from tactophone.net.link.identity import PEERS_FILE, Peers, identity_folder
from tactophone.signal.perception.model_file import MAX_BYTES
from tactophone.signal.perception.models import default_model, model_path

FILES_INTERVAL = 1.0
"""Seconds between two looks at the files."""

GONE = ""
"""Digest of a file that cannot be read."""

OF_NO_USE = "of no use"
"""Digest of what no run could read: a pipe, or more than a model may hold."""


def files_of(settings: Settings) -> dict[str, str]:
    """Return the files that decide what a run feels, each with the SHA-256 of its
    content; `GONE` or `OF_NO_USE` for one that is not read."""
    paths = dict[str, str]()
    for own in each_finger(settings):
        model = own.detector.model or default_model(own.capture.tip)
        # What another package registers is no file; a name without one is refused where
        # the run opens it.
        if model not in registered(DETECTORS):
            with suppress(ModelError):
                paths[str(model_path(model))] = ""
        if own.detector.calibration:
            paths[str(Path(own.detector.calibration).expanduser())] = ""
    return {path: _digest(Path(path)) for path in paths}


class HeldFiles:
    """Compares the files of a run with what was read of them.

    Parameters
    ----------
    read
        Digests of what this process has read, by path (`files_of`).
    began
        The same when the run began, perhaps in a process before this one.
    """

    def __init__(self, read: Mapping[str, str], began: Mapping[str, str]) -> None:
        self._read = read
        self._began = began
        self._seen: dict[str, tuple[FileStamp | None, str]] = {}
        """What the system said of a file, and its digest then."""
        for path in read:
            self._now(path)

    def faults(self) -> Iterator[Fault]:
        """Yield which files are no longer what was read, and what the run does."""
        for number, (path, read) in enumerate(self._read.items(), 1):
            now = self._now(path)
            if now != read:
                how = "is gone" if now == GONE else "was changed"
                text = (
                    f"{path} {how}: the run goes on with what it has read; start it "
                    "again to use another file"
                )
                yield Fault(f"file-{number}", text)
            elif read != self._began.get(path, read):
                text = (
                    f"{path} was changed during the run, and this process, which "
                    "replaced a failed one, uses what it is now: arm only if that is "
                    "meant"
                )
                yield Fault(f"file-{number}", text)

    def _now(self, path: str) -> str:
        stamp = _stamp(Path(path))
        before, digest = self._seen.get(path, (None, GONE))
        if stamp != before:
            digest = _digest(Path(path))
            self._seen[path] = stamp, digest
        return digest


class HeldPeers:
    """Reads the trusted peers again when their file changes.

    ``trust`` is called with the new ones, in the thread that calls `look`.
    """

    def __init__(self, settings: Settings, trust: Callable[[Peers], None]) -> None:
        self._folder = identity_folder(settings.link.identity)
        self._trust = trust
        path = self._folder / PEERS_FILE
        self._stamp = _stamp(path)
        self._seen = _digest(path)
        """Digest of what was passed on."""

    def look(self) -> Iterator[Fault]:
        """Pass changed peers on; yield why the file cannot be used, if it cannot: those
        that were read hold until then."""
        path = self._folder / PEERS_FILE
        stamp = _stamp(path)
        if stamp == self._stamp:
            return
        now = _digest(path)
        if now == self._seen:
            self._stamp = stamp
            return
        problem = f"{path} is gone; `tactophone pair trust` makes it"
        if now != GONE:
            try:
                self._trust(Peers.load(self._folder))
                self._seen = now
                self._stamp = stamp
                return
            except ConfigError as error:
                problem = str(error)
        yield Fault("peers", f"the run goes on with the peers it knows: {problem}")


def _stamp(path: Path) -> FileStamp | None:
    try:
        return file_stamp(path)
    except OSError:
        return None


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file, without waiting for whoever writes to a pipe."""
    try:
        with open(path, "rb", opener=_at_once) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_BYTES:
                return OF_NO_USE
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return GONE


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)
