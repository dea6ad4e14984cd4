"""Sound in: microphones behind JACK and PortAudio, and files, under one contract (`tactophone.types.Source`)."""

from tactophone.capture.jack import jack_source
from tactophone.capture.live import LiveSource
from tactophone.capture.portaudio import portaudio_source

__all__ = ["LiveSource", "jack_source", "portaudio_source"]
