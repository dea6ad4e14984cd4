"""Sources of sound: microphones behind JACK and PortAudio, and files; all obey `tactophone.types.Source`."""

from tactophone.capture.files import CombinedSource, FileSource, RecordedSource
from tactophone.capture.live import LiveSource
from tactophone.capture.microphones import browser_source, jack_source, portaudio_source

__all__ = [
    "CombinedSource",
    "FileSource",
    "LiveSource",
    "RecordedSource",
    "browser_source",
    "jack_source",
    "portaudio_source",
]
