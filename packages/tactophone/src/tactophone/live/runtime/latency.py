"""The latency budget of a live run: how long sound spends in each stage, from the marks
of both sides.

A mark holds the time at which sound up to an RTP timestamp reached a stage. The clock
is the machine's own, so the marks of robot and operator can be combined only where both
run on one machine. Between two machines each side computes its own stages, and the
network's part is half the round trip that the robot measures.

For *capture* and *encode*, a live run computes the mean wait of a sample until its
period and its packet are full: half of each. `tactophone latency` measures those stages
too, with impulses.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.codec import Codec

_WRAP = 1 << 32
"""RTP timestamps count samples modulo this (RFC 3550, section 5.1)."""

_NEW_SESSION = 10 * LIVE_SAMPLE_RATE
"""Jump in samples from one mark of a stage to the next that means a new session: each
starts at a random timestamp."""

Marks = dict[str, NDArray[np.void]]


class LocalPeer:
    """The robot's run, watched from the operator's process, where both are on one
    machine; else ``name`` is empty."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.watcher: Watcher | None = None

    def refresh(self) -> None:
        """Find the run, or its successor if it has ended."""
        if self.name and self.watcher is None:
            self.watcher = Watcher.find(self.name)
        elif self.watcher is not None:
            self.watcher.follow(drain=False)

    def truth(self, finger: int = 0) -> int:
        """Return the true `Touch` of a finger now; -1 where it is not known."""
        if self.watcher is None or finger >= self.watcher.fingers:
            return -1
        step = self.watcher.newest_step(finger=finger)
        return int(step["truth"][0]) if step is not None else -1


def robot_stages(robot: Watcher, codec: Codec, *, period: int = 0) -> dict[str, float]:
    """Return the seconds in *capture* and *encode*; empty before there are two marks.

    ``period``: the device's, in samples; 0 without a device, where blocks are taken as
    they come.
    """
    captured = robot.marks("captured")
    sent = robot.marks("sent")
    size = min(len(captured), len(sent))
    if size < 2:
        return {}
    samples = period or float(np.median(np.diff(captured["position"]) % _WRAP))
    block = samples / LIVE_SAMPLE_RATE
    computing = float(np.median(sent["time"][-size:] - captured["time"][-size:]))
    waiting = (codec.packet_size / 2 + codec.lookahead) / LIVE_SAMPLE_RATE
    return {"capture": block / 2, "encode": waiting + computing}


def operator_stages(
    operator: Watcher,
    robot: Watcher | None,
    device_latency: float,
    *,
    sound_delay: float = 0.0,
) -> dict[str, float]:
    """Return the seconds in all stages from *network* on, and ``total`` where the
    robot's stages are known too.

    - ``robot``: known if it runs on this machine.
    - ``device_latency``: latency of the actuator's device.
    - ``sound_delay``: delay in the clocked buffer and in the renderer, for profiles
      that render the sound itself.
    """
    # Only blocks that led to a command are followed: the others have no effect on the
    # vibration.
    names = ("rendered", "received", "released", "decoded", "detected")
    times = follow({name: operator.marks(name) for name in names})
    stages = {
        "playout": _median(times, "received", "released"),
        "decode": _median(times, "released", "decoded"),
        "detect": _median(times, "decoded", "detected"),
        "render": _median(times, "detected", "rendered"),
        "device": device_latency,
    }
    if sound_delay:
        stages |= {"playout": sound_delay, "decode": 0.0, "detect": 0.0, "render": 0.0}
    if robot is not None:
        both = follow(
            {"received": operator.marks("received"), "sent": robot.marks("sent")}
        )
        stages["network"] = _median(both, "sent", "received")
        stages["capture"] = robot.gauge("latency_capture")
        stages["encode"] = robot.gauge("latency_encode")
        stages["total"] = math.fsum(stages.values())
    return stages


def follow(marks: Marks) -> dict[str, NDArray[np.float64]]:
    """Match the marks of each block of sound through the stages.

    ``marks`` holds them by stage. The blocks of the first stage are followed; a block
    has reached another stage when a mark at its end or beyond has. Returns for each
    stage the times in s, one for each block that has reached all stages.
    """
    first = next(iter(marks))
    marks = {name: _newest_session(found) for name, found in marks.items()}
    if any(not len(found) for found in marks.values()):
        return {name: np.empty(0) for name in marks}
    reference = int(marks[first]["position"][-1])
    ends = _unwrapped(marks[first], reference)
    times = {}
    known = np.ones(len(ends), bool)
    for name, found in marks.items():
        # Packets may overtake each other: a stage has reached a position once it has
        # reached a later one.
        positions = np.maximum.accumulate(_unwrapped(found, reference))
        index = np.searchsorted(positions, ends)
        known &= (index < len(found)) & (positions[0] < ends + 1)
        times[name] = found["time"][np.minimum(index, len(found) - 1)]
    return {name: moments[known] for name, moments in times.items()}


def _newest_session(found: NDArray[np.void]) -> NDArray[np.void]:
    """Return the marks of one stage since its newest session began; marks of an earlier
    session would match any later sound."""
    jumps = np.flatnonzero(abs(_wrapped(np.diff(found["position"]))) > _NEW_SESSION)
    return found[jumps[-1] + 1 :] if len(jumps) else found


def _unwrapped(marks: NDArray[np.void], reference: int) -> NDArray[np.int64]:
    """Return positions relative to a reference, across the wrap of the RTP
    timestamp."""
    return _wrapped(marks["position"] - reference)


def _wrapped(differences: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the shortest way between two RTP timestamps: from half a wrap back to half
    a wrap ahead."""
    return (differences + _WRAP // 2) % _WRAP - _WRAP // 2


def _median(times: dict[str, NDArray[np.float64]], start: str, end: str) -> float:
    durations = times[end] - times[start]
    return float(np.median(durations)) if len(durations) else math.nan
