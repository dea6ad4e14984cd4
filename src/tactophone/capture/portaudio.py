"""The two microphones on a PortAudio device."""

from tactophone.capture.live import LiveSource
from tactophone.devices import PortAudioStream
from tactophone.devices.device import Process


def portaudio_source(device: str = "", *, channels: int = 2, sample_rate: int = 48_000) -> LiveSource:
    """Listen to the first one or two channels of a device, given by number or part of its name."""

    def make(process: Process) -> PortAudioStream:
        return PortAudioStream(process, "input", device=device, channels=channels, sample_rate=sample_rate)

    return LiveSource(make, channels=channels, sample_rate=sample_rate)
