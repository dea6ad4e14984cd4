"""Child processes, worker pools, and files that appear whole or not at all."""

import atexit
import errno
import functools
import multiprocessing
import os
import pickle
import shutil
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, Literal, TypeAlias

from tactophone.core.errors import TactophoneError

FULL_DISK = 1 << 16
"""Bytes left on a disk under which a failed write is put down to a full disk."""

Message: TypeAlias = tuple[Literal["progress", "ready", "error", "bug"], str]
"""What a child tells its parent: what it does next, that it has begun, or the error or
the bug that ended it."""

ORPHAN_TIMEOUT = 2.5
"""Seconds after the end of its parent in which a child may end in order; a log is
complete by then."""

_starting = threading.RLock()
"""Held while a process is started, as that changes this process's environment for a
moment."""


@contextmanager
def _safe_path() -> Iterator[None]:
    """Start Python without the current folder on its path: a folder of data must not be
    a folder of code.

    Multiprocessing starts ``python -c``, which would look for modules in the current
    folder first.
    """
    with _starting:
        before = os.environ.get("PYTHONSAFEPATH")
        os.environ["PYTHONSAFEPATH"] = "1"
        try:
            if os.name == "posix":  # elsewhere there is no tracker
                from multiprocessing import resource_tracker

                # Whoever ends waits for it, which a stopped one would hold up.
                with _blocked(_stops()):
                    resource_tracker.ensure_running()
            yield
        finally:
            if before is None:
                del os.environ["PYTHONSAFEPATH"]
            else:
                os.environ["PYTHONSAFEPATH"] = before


def _stops() -> set[signal.Signals]:
    """Return the signals by which a terminal stops the processes in it."""
    return {signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU}


def _ends() -> set[signal.Signals]:
    """Return the signals by which a service manager, or the end of a login, ends all
    processes of a run at once."""
    return {signal.SIGTERM, signal.SIGHUP}


@contextmanager
def _blocked(signals: set[signal.Signals]) -> Iterator[None]:
    """Block signals for the processes that are started meanwhile, which inherit it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _SafeProcess(SpawnProcess):
    """A process that runs no code of the current folder."""

    def start(self) -> None:
        with _safe_path():
            super().start()


class _ChildProcess(_SafeProcess):
    """A process that sees neither Ctrl-C nor Ctrl-Z, nor what a service manager ends a
    run by, not even while it imports its modules; its parent ends it.

    A terminal sends Ctrl-C to every process in it, and a service manager its signals to
    every process of the service. Here the new process inherits that they are blocked,
    so that it shows no traceback; one that comes at this moment reaches the parent
    afterwards. What Ctrl-Z stops stands still as it is: a vibration goes on.

    SIGUSR1, the emergency stop, is blocked too: it waits until the process can obey it,
    and unblocks it.
    """

    pipe: Connection | None = None
    """The parent's end, kept while the process lives: it would close with the last
    `Child`, and end the process."""

    def start(self) -> None:
        # The resource tracker, which `_safe_path` starts, unblocks SIGINT when it
        # begins; so it must have begun before the signal is blocked.
        blocked = {signal.SIGINT, signal.SIGUSR1} | _ends() | _stops()
        with _safe_path(), _blocked(blocked):
            super().start()


@atexit.register
def _end_children() -> None:
    """End what nobody has ended, as where Ctrl-C cut a start or an end short:
    multiprocessing would send SIGTERM and wait, however long the process goes on."""
    left = [
        child
        for child in multiprocessing.active_children()
        if isinstance(child, _ChildProcess)
    ]
    for child in left:
        child.terminate()
        with suppress(OSError):
            if child.pipe:
                child.pipe.send(None)
    deadline = time.monotonic() + ORPHAN_TIMEOUT
    for child in left:
        child.join(max(0.0, deadline - time.monotonic()))
        child.kill()


class _ChildContext(SpawnContext):
    """Spawns processes rather than forking: a fork would carry audio threads' locks and
    files along."""

    Process = _ChildProcess


class _PoolContext(SpawnContext):
    Process = _SafeProcess


class _Later:
    """What a child unpickles only when asked to: that may import for seconds, which
    would delay all it does before."""

    def __init__(self, value: Any) -> None:
        self._value = value

    def __getstate__(self) -> bytes:
        return bytes(ForkingPickler.dumps(self._value))

    def __setstate__(self, state: bytes) -> None:
        self._state = state

    def unpickle(self) -> Any:
        return pickle.loads(self._state)


class Parent:
    """A child's end of the pipe to its parent."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def tell(self, message: Message) -> None:
        """Send a message, if the parent still listens."""
        with suppress(OSError):
            self._pipe.send(message)

    def wants_end(self, timeout: float = 0.0) -> bool:
        """Return true when the parent asks this process to end or is gone; both wake
        the wait of up to ``timeout`` s."""
        return self._pipe.poll(timeout)

    def fileno(self) -> int:
        """Return what an event loop can wait for in place of `wants_end`."""
        return self._pipe.fileno()


STATUS_WAIT = 0.001
"""Seconds between two looks for the status of a process that has ended."""


class Child:
    """A process of this machine, started at once; it ends no later than its parent.

    SIGTERM and SIGHUP leave it running, until ``work`` handles them otherwise: who ends
    all processes of a run by them ends its parent too, which then asks each to end in
    order.

    It is in a process group of its own: what stops its parent's group at once, as
    ``kill -STOP`` may, leaves it running (`parent_is_stopped`).

    - ``work``: called in the new process with its `Parent` and the arguments, all
      picklable. A `TactophoneError` ends it with one message and no traceback.
    - ``name``: shown by the system, and in what `how_ended` returns.
    - ``niceness``: by how much its priority is lowered, so that on a busy machine it
      waits and not the sound.
    """

    def __init__(
        self, work: Callable[..., None], *arguments: Any, name: str, niceness: int = 0
    ) -> None:
        context = _ChildContext()
        self._pipe, its = context.Pipe()
        self._process = context.Process(
            target=_begin,
            args=(_Later((work, arguments)), niceness, its),
            name=name,
            daemon=True,
        )
        self._process.start()
        self._process.pipe = self._pipe
        # Only the child's copy of its end is left, so the pipe ends with the child.
        its.close()

    @property
    def pid(self) -> int:
        """Process id; 0 if it never started."""
        return self._process.pid or 0

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    def messages(self, timeout: float | None = 0.0) -> Iterator[Message]:
        """Yield messages until none comes for ``timeout`` s, or the child has ended;
        ``None`` waits for as long as it takes.

        What the child told before its end is yielded first.
        """
        with suppress(EOFError, OSError):
            while self._pipe.poll(timeout):
                yield self._pipe.recv()

    def how_ended(self) -> str:
        """Wait for the end and return how it came, as ``exit code 1`` or ``signal
        SIGKILL``; empty for one in order."""
        self._process.join()
        # Where another thread waits too, it may have taken the status from the system
        # and not noted it yet; the process then has ended with a code unknown to us.
        while (code := self._process.exitcode) is None:
            time.sleep(STATUS_WAIT)
        if code == 0:
            return ""
        if code < 0:
            with suppress(ValueError):  # a signal that Python has no name for
                return f"signal {signal.Signals(-code).name}"
        return f"exit code {code}"

    def ask_to_end(self) -> None:
        """Ask the process to end in order; it obeys where it looks at
        `Parent.wants_end`."""
        with suppress(OSError):  # when it has ended by itself
            self._pipe.send(None)

    def wait(self, timeout: float) -> bool:
        """Wait up to ``timeout`` s, and return whether the process has ended."""
        self._process.join(timeout)
        return not self._process.is_alive()

    def end(self, timeout: float) -> None:
        """Wait up to ``timeout`` s for the end that was asked for, then kill the
        process."""
        self._process.join(timeout)
        self.kill()

    def terminate(self) -> None:
        """Send SIGTERM, which ends a process whose ``work`` says so."""
        self._process.terminate()

    def kill(self) -> None:
        """Kill the process if it still runs, and wait until it is gone."""
        if self._process.is_alive():
            self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Close the pipe: nobody reads its messages any more."""
        self._pipe.close()


def _begin(later: _Later, niceness: int, pipe: Connection) -> None:
    # In the parent's session: were the parent to die while this process is stopped, the
    # system would end it.
    os.setpgid(0, 0)
    for number in _ends():
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ends())
    os.nice(niceness)
    if orphaned():
        return
    parent_is_stopped()  # which opens what it reads from then on
    # A side that still starts looks at nothing else, and without its parent nobody
    # would end it.
    threading.Thread(
        target=_end_with_parent, args=(ORPHAN_TIMEOUT,), daemon=True
    ).start()
    parent = Parent(pipe)
    try:
        work, arguments = later.unpickle()
        work(parent, *arguments)
    except TactophoneError as error:
        parent.tell(("error", str(error)))
        raise SystemExit(1) from None
    except Exception as error:
        parent.tell(("bug", f"{type(error).__name__}: {error}"))
        raise


def began() -> float:
    """Return when this process began, in s of the monotonic clock (Linux; elsewhere
    now): its imports take a second or more on a busy machine."""
    now = time.monotonic()
    try:
        # The 22nd field of the line, so the 20th after the command in brackets
        # (proc_pid_stat(5)): clock ticks since the boot.
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        ticks = int(fields[19]) / os.sysconf("SC_CLK_TCK")
        return now - (time.clock_gettime(time.CLOCK_BOOTTIME) - ticks)
    except (OSError, IndexError, ValueError, AttributeError):
        return now


def orphaned() -> bool:
    """Return whether the process that started this one is gone, so that this one should
    end too."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()


@contextmanager
def never_suspended(asked: Callable[[], object]) -> Iterator[None]:
    """Let no terminal suspend this process meanwhile; in the main thread.

    A process that stands still watches nothing, and an actuator may repeat what it
    played last. ``asked`` is called on Ctrl-Z instead, within a signal handler. In the
    background, the terminal can be written to but not read from: that is an `OSError`.
    """
    if os.name != "posix":
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _stops()}
    signal.signal(signal.SIGTSTP, lambda *_: asked())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def parent_is_stopped() -> bool:
    """Return whether the process that started this one stands still after a signal, as
    ``kill -STOP`` sends it (Linux; elsewhere false)."""
    try:
        # The state follows the command in brackets (proc_pid_stat(5)).
        status = os.pread(_parents_status(), 128, 0)
    except OSError:  # it has ended, or there is no such file
        return False
    return status.rpartition(b")")[2].startswith(b" T")


@functools.cache
def _parents_status() -> int:
    """Return the open file of the parent's status: a run opens no file while it goes
    on, and the number of a parent that has ended may be another's."""
    parent = multiprocessing.parent_process()
    path = f"/proc/{parent.pid if parent else 0}/stat"
    return os.open(path, os.O_RDONLY | os.O_CLOEXEC)


def open_pool(
    workers: int, *, prepare: Callable[[], None] | None = None
) -> ProcessPoolExecutor:
    """Return a pool of ``workers`` processes; each calls ``prepare`` first.

    They are spawned, not forked: torch and BLAS do not survive a fork once their
    threads run. They end with the process that started them, however that ends.
    """
    with _safe_path():  # its locks start the resource tracker
        return ProcessPoolExecutor(
            workers,
            mp_context=_PoolContext(),
            initializer=_begin_worker,
            initargs=(prepare,),
        )


def _begin_worker(prepare: Callable[[], None] | None) -> None:
    # A pool whose process is killed does not end its workers: they would finish what
    # they were at and wait for more.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare is not None:
        prepare()


def _end_with_parent(grace: float = 0.0) -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        time.sleep(grace)
        os._exit(1)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield the path of a file to write; it replaces ``path`` when all went well, and
    is on the disk by then.

    After a kill or on a full disk (an `OSError` that names it), ``path`` is the old
    file or the new one, never half. The next write overwrites what a kill left, as its
    name is the same; two processes must not write one path at once.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.part")
    make_room(unfinished)
    try:
        yield unfinished
        flush_to_disk(unfinished)
        os.replace(unfinished, path)
    except (OSError, RuntimeError) as error:
        # The libraries of sound files and torch do not say that the disk is full. The
        # free space must be read now, before the unfinished file is removed.
        if shutil.disk_usage(path.parent).free < FULL_DISK:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        raise
    finally:
        unfinished.unlink(missing_ok=True)


def is_same_file(one: Path, other: Path) -> bool:
    """Return whether two paths lead to one regular file that exists: by another
    spelling, or a link of either kind."""
    try:
        return one.is_file() and one.samefile(other)
    except (OSError, ValueError):  # no such file, or no name at all
        return False


def is_other_file(path: Path, content: bytes) -> bool:
    """Return whether a file with other content is at a path, which a person may have
    written. A link is none: what is written takes its place."""
    return path.is_file() and not path.is_symlink() and path.read_bytes() != content


def make_room(path: Path) -> None:
    """Remove the file or link at a path, so that what is written there reaches no other
    file by a shared name.

    Another user's pipe or socket goes too, as that user would read what is written.
    This user's own stays, and so does a device. Raises `PermissionError` where the
    folder does not allow it.
    """
    if path.is_symlink() or path.is_file() or _is_foreign_pipe(path):
        path.unlink()


def _is_foreign_pipe(path: Path) -> bool:
    try:
        status = path.lstat()
    except OSError:
        return False
    if not (stat.S_ISFIFO(status.st_mode) or stat.S_ISSOCK(status.st_mode)):
        return False
    return status.st_uid != os.getuid()


FileStamp: TypeAlias = tuple[int, int, int]
"""Inode, bytes, and time of the last change in ns."""


def file_stamp(path: Path) -> FileStamp:
    """Return what changes with a file's content, without opening it; raises `OSError`
    where there is no such file."""
    status = path.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns


def make_private(path: Path) -> None:
    """Make an empty file that only this user may read and write, in the place of what
    is at ``path``.

    Raises `OSError` (``EBUSY``) where that is a file that somebody holds
    (`hold`).
    """
    _refuse_held(path)
    make_room(path)
    if path.exists() and not path.is_file():
        return  # a device, such as /dev/null, or this user's own pipe
    # Where others may write to the folder, the file could be theirs by now.
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))


def hold(descriptor: int) -> bool:
    """Hold an open file or folder until it is closed, mapped memory of it included;
    returns whether nobody else does, also where the system knows no locks.

    It is seen from a container that shares the file and not the processes, too.
    """
    try:
        import fcntl  # not on Windows

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        pass
    return True


def _refuse_held(path: Path) -> None:
    held = False
    if path.is_file():
        # Else it is not this user's to read.
        with suppress(OSError), path.open("rb") as file:
            held = not hold(file.fileno())
    if held:
        raise OSError(errno.EBUSY, "another run is writing it", str(path))


def flush_to_disk(path: Path) -> None:
    """Return when a file's bytes are on the disk."""
    with path.open("r+b") as file:  # Windows flushes only what may be written
        os.fsync(file.fileno())


def flush_open_file(descriptor: int) -> None:
    """Return when what was written to an open file is on the disk; a pipe or a device
    has none."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
