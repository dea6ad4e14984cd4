"""Sound devices as they are: clients that outlive their server, and lists of what there is.

Both ends of the journey sit on a device (microphones in `capture`, an actuator in `haptics`), so what they share
about JACK and PortAudio stands below them: opening with a clear error, losing a server without a sound, coming back.
"""

from tactophone.devices.clocked import ClockedDevice
from tactophone.devices.device import Device
from tactophone.devices.dummy import DummyServer
from tactophone.devices.jack import JackClient, JackPort
from tactophone.devices.portaudio import PortAudioDevice, PortAudioStream
from tactophone.devices.survey import Found, survey

__all__ = [
    "ClockedDevice",
    "Device",
    "DummyServer",
    "Found",
    "JackClient",
    "JackPort",
    "PortAudioDevice",
    "PortAudioStream",
    "survey",
]
