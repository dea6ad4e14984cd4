"""The microphones on a PortAudio device: two, or two for each finger of a hand."""

from collections.abc import Sequence

from tactophone.capture.live import LiveSource
from tactophone.devices import PortAudioStream, Process
from tactophone.types import LIVE_SAMPLE_RATE


def portaudio_source(device: str = "", *, channels: int = 2, sample_rate: int = LIVE_SAMPLE_RATE) -> LiveSource:
    """Open the microphones at the first one or two channels of a device, given by number or part of its name."""

    def make(process: Process) -> PortAudioStream:
        return PortAudioStream(process, "input", device=device, channels=channels, sample_rate=sample_rate)

    return LiveSource(make, channels=channels, sample_rate=sample_rate)


def portaudio_hand_source(fingers: Sequence[tuple[int, int]], device: str = "") -> LiveSource:
    """Open contact and air of each finger at channels of one device, counted from 1; an air channel of 0 is silence."""
    inputs = max(max(pair) for pair in fingers)

    def make(process: Process) -> PortAudioStream:
        return PortAudioStream(process, "input", device=device, channels=inputs)

    return LiveSource(make, channels=2 * len(fingers), order=[channel - 1 for pair in fingers for channel in pair])
