"""How far a process has come with its start, so that a slow one is waited for and a stuck one is not."""

from pathlib import Path

START_TIMEOUT = 20.0
"""Seconds that a process may spend at its start without any progress: neither a message nor processor time."""

LONGEST_START = 300.0
"""Seconds that a start may take in all; compiling the simulation on a busy machine takes one minute."""


class StartProgress:
    """How far a process has come with its start; times in s."""

    def __init__(self, pid: int, *, now: float) -> None:
        self.doing, self.failure = "importing", "it ended"
        self._pid = pid
        self._began = self._progressed = self._shown = now
        self._used = 0

    def note(self, doing: str, *, now: float) -> None:
        """Take what the process does next."""
        self.doing, self._progressed = doing, now

    def goes_on(self, now: float) -> bool:
        """Whether to wait longer."""
        if (used := _processor_time(self._pid)) != self._used:
            self._used, self._progressed = used, now
        if now - self._progressed > START_TIMEOUT:
            self.failure = f"no progress within {START_TIMEOUT:g} s"
        elif now - self._began > LONGEST_START:
            self.failure = f"not done within {LONGEST_START:g} s"
        else:
            return True
        return False

    def slow_line(self, now: float) -> str:
        """Return what a slow start is at, every five seconds."""
        if now - self._shown < 5.0:
            return ""
        self._shown = now
        return f"starting for {now - self._began:.0f} s, now {self.doing}"


def _processor_time(pid: int) -> int:
    """Return the clock ticks that a process has used (Linux; elsewhere 0: only its messages count as progress)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])
    except (OSError, IndexError, ValueError):
        return 0
