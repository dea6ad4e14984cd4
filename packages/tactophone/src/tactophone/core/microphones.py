"""The microphones of a finger, and how many fingers sound has."""

from tactophone.core.errors import ModelError

CONTACT = 0
"""Channel of the contact microphone, the piezo on the finger pad."""

AIR = 1
"""Channel of the air microphone, the MEMS beside the finger."""

MICROPHONES = ("contact", "air")
"""The microphones of a finger, in the order of its channels. A further one begins
here."""


def fingers_of(channels: int) -> int:
    """Return how many fingers this many channels hold; mono counts as one finger
    without an air microphone."""
    return max(1, channels // len(MICROPHONES))


def check_channels(channels: int) -> None:
    """Raise `ModelError` unless the sound has the channels of a single finger."""
    if channels not in (1, 2):
        raise ModelError(
            f"channels = {channels}, but a finger has 1 (contact) or 2 (contact, air); "
            "open a pipeline for each finger"
        )
