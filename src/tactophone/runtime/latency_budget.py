"""Where the time goes: from the marks that both sides leave, how long sound spends in each stage.

A mark says when sound up to some RTP timestamp came to some moment. The clock is the machine's own, so the robot's
and the operator's marks fit together only where both run on one machine. Between two machines, the stages of each
side are known to that side, and the network's part is half the round trip that the robot measures.

What a live run can know of *capture* and *encode* is the mean wait of a sample for its period and its packet to be
full: half of each. `tactophone latency` measures those too, with clicks.
"""

import contextlib
import math

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import TactophoneError
from tactophone.link import Codec
from tactophone.telemetry import Watcher

CLOCK_RATE = 48_000
_WRAP = 1 << 32

Marks = dict[str, NDArray[np.void]]


class LocalPeer:
    """The robot's run, looked at from the operator's process, where both are on one machine.

    Parameters
    ----------
    name
        Of the robot's run; empty where it is on another machine.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.watcher: Watcher | None = None

    def look(self) -> None:
        """Find the run, or the new one if that of before has ended."""
        if self._name and (self.watcher is None or not self.watcher.snapshot().alive):
            with contextlib.suppress(TactophoneError):
                self.watcher = Watcher(self._name)

    def truth(self) -> int:
        """What the finger truly touches now; -1 where nobody knows."""
        tick = self.watcher.newest_tick() if self.watcher else None
        return int(tick["truth"][0]) if tick is not None else -1


def robots_part(robot: Watcher, codec: Codec) -> dict[str, float]:
    """Seconds in *capture* and *encode*, as far as the robot knows them."""
    captured, sent = robot.marks("captured"), robot.marks("sent")
    size = min(len(captured), len(sent))
    if size < 2:
        return {}
    block = float(np.median(np.diff(captured["position"]) % _WRAP)) / CLOCK_RATE
    computing = float(np.median(sent["time"][-size:] - captured["time"][-size:]))
    waiting = (codec.packet_size / 2 + codec.lookahead) / CLOCK_RATE
    return {"capture": block / 2, "encode": waiting + computing}


def operators_part(
    operator: Watcher, robot: Watcher | None, device_latency: float, *, sound_delay: float = 0.0
) -> dict[str, float]:
    """Seconds in all stages from *network* on, and ``total`` where the robot's stages are known too.

    Parameters
    ----------
    operator, robot
        Whose marks are followed; the robot's where it runs on this machine.
    device_latency
        Of the actuator's device.
    sound_delay
        Where the sound itself is felt: how long it waits in the clocked buffer and in its renderer; it is not judged.
    """
    # Only stretches that led to a command are followed: the others have no effect to wait for.
    names = ("rendered", "received", "released", "decoded", "judged")
    times = follow({name: operator.marks(name) for name in names})
    stages = {
        "playout": _median(times, "received", "released"),
        "decode": _median(times, "released", "decoded"),
        "judge": _median(times, "decoded", "judged"),
        "render": _median(times, "judged", "rendered"),
        "device": device_latency,
    }
    if sound_delay:
        stages |= {"playout": sound_delay, "decode": 0.0, "judge": 0.0, "render": 0.0}
    if robot is not None:
        both = follow({"received": operator.marks("received"), "sent": robot.marks("sent")})
        stages["network"] = _median(both, "sent", "received")
        stages["capture"], stages["encode"] = robot.gauge("latency_capture"), robot.gauge("latency_encode")
        stages["total"] = math.fsum(stages.values())
    return stages


def follow(marks: Marks) -> dict[str, NDArray[np.float64]]:
    """Follow each stretch of sound through its moments.

    Parameters
    ----------
    marks
        By moment. The first moment's stretches are those followed; at every other moment, a stretch is there when a
        mark at its end or beyond is.

    Returns
    -------
    dict
        For each moment the times (s), one for each stretch that has come through all of them.
    """
    first = next(iter(marks))
    if any(not len(found) for found in marks.values()):
        return {name: np.empty(0) for name in marks}
    reference = int(marks[first]["position"][-1])
    ends = _unwrapped(marks[first], reference)
    times, known = {}, np.ones(len(ends), bool)
    for name, found in marks.items():
        positions = np.maximum.accumulate(_unwrapped(found, reference))
        index = np.searchsorted(positions, ends)
        known &= (index < len(found)) & (positions[0] < ends + 1)
        times[name] = found["time"][np.minimum(index, len(found) - 1)]
    return {name: moments[known] for name, moments in times.items()}


def _unwrapped(marks: NDArray[np.void], reference: int) -> NDArray[np.int64]:
    """Positions relative to one of them, over the wrap of the RTP timestamp."""
    relative: NDArray[np.int64] = (marks["position"] - reference + _WRAP // 2) % _WRAP - _WRAP // 2
    return relative


def _median(times: dict[str, NDArray[np.float64]], start: str, end: str) -> float:
    durations = times[end] - times[start]
    return float(np.median(durations)) if len(durations) else math.nan
