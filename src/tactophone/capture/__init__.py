"""Sound in: microphones behind JACK and PortAudio, and files, under one contract (`tactophone.types.Source`)."""

from tactophone.capture.files import FileSource
from tactophone.capture.jack import jack_source
from tactophone.capture.live import LiveSource
from tactophone.capture.portaudio import portaudio_source

__all__ = ["FileSource", "LiveSource", "jack_source", "portaudio_source"]
