"""The two microphones on a PortAudio device."""

from tactophone.capture.live import LiveSource
from tactophone.devices import PortAudioStream, Process
from tactophone.types import LIVE_SAMPLE_RATE


def portaudio_source(device: str = "", *, channels: int = 2, sample_rate: int = LIVE_SAMPLE_RATE) -> LiveSource:
    """Open the microphones at the first one or two channels of a device, given by number or part of its name."""

    def make(process: Process) -> PortAudioStream:
        return PortAudioStream(process, "input", device=device, channels=channels, sample_rate=sample_rate)

    return LiveSource(make, channels=channels, sample_rate=sample_rate)
