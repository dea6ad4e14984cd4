"""The microphone of a page in a browser, as a source: one air microphone."""

from multiprocessing.connection import Connection

from tactophone.capture.live import LiveSource
from tactophone.devices import Process, StreamDevice

ABSENT = "no page sends sound: open the page on the phone or laptop that listens, and press Use this microphone"


def browser_source(sound: Connection) -> LiveSource:
    """Open the microphone of the page whose messages ``sound`` delivers (`tactophone.devices.StreamDevice`)."""

    def make(process: Process) -> StreamDevice:
        return StreamDevice(sound, process, absent=ABSENT)

    return LiveSource(make, channels=1)
