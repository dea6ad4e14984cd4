"""The exceptions that Tactophone raises on purpose.

::

    TactophoneError
    ├── ConfigError    a setting that is unknown, malformed or out of range
    ├── DeviceError    a sound device that is missing, wrong or lost
    ├── PacketError    bytes from the network that are malformed
    ├── ModelError     a model file that cannot be read or does not fit the sound
    └── DatasetError   a recording, label or manifest that cannot be used

A mistake in the code or by the user raises; a disturbance from outside (loss, delay,
bad bytes, underflow) is counted and shown. An invalid argument, such as a negative
size, stays :class:`ValueError`. Every message says what was found, what was expected,
where, and the next step.
"""

import difflib
from collections.abc import Iterable

SHORTEST_HINT = 4
"""Letters from which part of a name is worth a hint: three occur in too many names."""

MOST_HINTS = 3
"""Choices that a message suggests at most."""


class TactophoneError(Exception):
    """Base of all errors raised on purpose; the command line prints it in one line and
    exits with 1."""


class ConfigError(TactophoneError):
    """A setting is unknown, malformed or out of range."""


class DeviceError(TactophoneError):
    """A sound device is missing, has the wrong rate or too few channels, or was
    lost."""


class PacketError(TactophoneError):
    """Bytes from the network are malformed."""


class ModelError(TactophoneError):
    """A model file cannot be read, is not a Tactophone model, or does not fit the
    sound."""


class DatasetError(TactophoneError):
    """A recording, label or manifest cannot be used."""


def plain(text: str) -> str:
    r"""Return text with what a terminal may interpret, such as escape sequences,
    replaced, and the bytes of a name that is no UTF-8 written out.

    >>> plain("a\x1b[2Jb"), plain("gr\udcfcn")
    ('a�[2Jb', 'gr\\xfcn')
    """
    if text.isprintable():
        return text
    return "".join(map(_plain_character, text))


def _plain_character(char: str) -> str:
    if char.isprintable() or char in "\n\t":
        return char
    if "\udc80" <= char <= "\udcff":
        # A byte of a file's name that is no UTF-8, as Python stands in for it.
        return f"\\x{ord(char) - 0xDC00:02x}"
    return "\N{REPLACEMENT CHARACTER}"


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest choice, or nothing
    if none is near.

    >>> did_you_mean("textur", ["paper", "texture"])
    '; did you mean texture?'
    """
    # Every option begins with dashes, which would make all of them look near.
    name = name.lower().lstrip("-")
    by_lower = {choice.lower().lstrip("-"): choice for choice in choices}
    near = difflib.get_close_matches(name, by_lower, n=1)
    if near:
        return f"; did you mean {by_lower[near[0]]}?"
    # Half of a long name is a good hint too, well written or nearly so: "marble" or
    # "marbel" for "polished marble".
    words = {word for lower in by_lower for word in lower.split()}
    (part,) = difflib.get_close_matches(name, words, n=1, cutoff=0.75) or (name,)
    if len(part) < SHORTEST_HINT:
        return ""
    found = [choice for lower, choice in by_lower.items() if part in lower]
    if not found:
        return ""
    return f"; did you mean {' or '.join(found[:MOST_HINTS])}?"
