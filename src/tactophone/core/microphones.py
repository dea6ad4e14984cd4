"""The microphones of a finger, and how many fingers sound has."""

CONTACT = 0
"""Channel of the contact microphone, the piezo on the finger pad."""

AIR = 1
"""Channel of the air microphone, the MEMS beside the finger."""

MICROPHONES = ("contact", "air")
"""The microphones of a finger, in the order of its channels. A further one begins here."""


def fingers_of(channels: int) -> int:
    """Return the number of fingers in sound of so many channels; a single one is a finger without an air microphone."""
    return max(1, channels // len(MICROPHONES))
