"""The fingers of a hand, from a TOML file with one table each: ``--fingers hand.toml``,
or ``--fingers 5``.

::

    [thumb]
    contact = "system:capture_1"
    profile = "dualsense"

    [index]
    threshold_dbfs = -34

The order of the tables is the order of the fingers on the link. Ports and channels that
a table leaves out follow from its place in the file. Everything else in `core.settings`
is common to all fingers.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.settings import (
    SETTINGS,
    FingerSettings,
    Settings,
    read_tables,
    set_value,
)
from tactophone.core.types import FINGER_NAMES, FINGER_PATTERN, MOST_FINGERS

OWN_SETTINGS: Mapping[str, str] = {
    "contact": "capture.contact",
    "air": "capture.air",
    "device": "capture.device",
    "model": "detector.model",
    "calibration": "detector.calibration",
    "threshold_dbfs": "detector.threshold_dbfs",
    "profile": "rendering.profile",
    "ceiling": "rendering.ceiling",
    "port": "output.port",
    "channel": "output.channel",
}
"""What a finger's table may hold, and the setting that it replaces for this finger."""

_INPUTS = ("contact", "air")
"""Keys of a table that name an input: both take from the inputs of one device."""

_UNSHARED = ("contact", "air", "port", "channel")
"""Ports and channels: each serves one finger alone."""

_NO_PORT = ("", "-")
"""What stands for no port at all, which any number of fingers may share."""


def with_fingers(settings: Settings, text: str) -> Settings:
    """Return settings with the fingers that ``--fingers`` names: a number of them, or a
    file.

    Raises `ConfigError` if the file cannot be read, an entry is wrong, or the settings
    name a port or channel that fingers cannot share.
    """
    for key in _UNSHARED:
        name = OWN_SETTINGS[key]
        section, _, own = name.partition(".")
        value = getattr(getattr(settings, section), own)
        if value != SETTINGS[name].default:
            raise ConfigError(
                f"{name} = {value!r} applies to a single finger; "
                f"with --fingers, set {key} in that finger's table"
            )
    if text.lstrip("+-").isdecimal():
        if len(text) > len("-10"):  # before so many names are made
            raise ConfigError(
                f"--fingers: {text[:20]} fingers, but a hand has 1 to {MOST_FINGERS}"
            )
        return replace(
            settings, fingers=_checked(default_names(int(text)), where="--fingers")
        )
    path = Path(text).expanduser()
    tables = read_tables(
        path,
        missing="give --fingers a number, or a TOML file with one table a finger",
        outside="write it under a finger's name, as in [index]",
    )
    return replace(settings, fingers=_checked(tables, where=str(path)))


def default_names(count: int) -> dict[str, dict[str, Any]]:
    """Return this many named fingers without settings of their own; more than five are
    named as on two hands.

    >>> list(default_names(3))
    ['thumb', 'index', 'middle']
    >>> list(default_names(6))[::5]
    ['left-thumb', 'right-thumb']
    """
    names = [f"{side}-{name}" for side in ("left", "right") for name in FINGER_NAMES]
    if count <= len(FINGER_NAMES):
        names = list(FINGER_NAMES)
    names += [f"finger-{number}" for number in range(len(names) + 1, count + 1)]
    return {name: {} for name in names[: max(0, count)]}


def of_finger(settings: Settings, index: int) -> Settings:
    """Return the settings of one finger, as if the run had this finger alone.

    >>> of_finger(with_fingers(Settings(), "2"), 1).capture.contact
    'system:capture_3'
    """
    own = settings.fingers[index].settings
    settings = replace(settings, fingers=(FingerSettings(),))
    for name, value in own:
        settings = set_value(settings, name, value, where=name)
    return settings


def each_finger(settings: Settings) -> list[Settings]:
    return [of_finger(settings, index) for index in range(len(settings.fingers))]


def names_of(settings: Settings) -> list[str]:
    """Return the name of every finger, in order; one empty name without
    ``--fingers``."""
    return [finger.name for finger in settings.fingers]


def channels_of(settings: Settings, *, alone: int) -> list[int]:
    """Return the channels of every finger's sound: 2, or 1 without an air microphone;
    ``alone`` for a run without ``--fingers``."""
    if not settings.is_hand:
        return [alone]
    return [2 if own.capture.air else 1 for own in each_finger(settings)]


def finger_named(settings: Settings, name: str | None) -> Settings:
    """Return the settings of the finger of that name (`of_finger`), or of the only one
    where none is named.

    Raises `ConfigError` if there is no such finger, or several and none is named.
    """
    names = list(filter(None, names_of(settings)))
    if name is None and len(names) == 1:
        return of_finger(settings, 0)
    if name is None:
        raise ConfigError(
            f"--fingers names {', '.join(names)}, but one finger is needed: "
            f"add --finger {names[0]}"
        )
    if name not in names:
        known = (
            f"there are {', '.join(names)}"
            if names
            else "name the hand with --fingers hand.toml"
        )
        raise ConfigError(
            f"there is no finger {name!r}; {known}{did_you_mean(name, names)}"
        )
    return of_finger(settings, names.index(name))


def _checked(
    tables: Mapping[str, Mapping[str, Any]], *, where: str
) -> tuple[FingerSettings, ...]:
    """Check every entry, and that no two fingers share a port or channel."""
    if not 1 <= len(tables) <= MOST_FINGERS:
        found = f"{len(tables)} fingers" if tables else "no finger"
        raise ConfigError(
            f"{where}: {found}, but a hand has 1 to {MOST_FINGERS}; "
            "write one table for each, as [index]"
        )
    fingers = tuple(
        FingerSettings(name, tuple(_own(name, place, table, where=where)))
        for place, (name, table) in enumerate(tables.items())
    )
    _check_shared(fingers, where=where)
    return fingers


def _own(
    name: str, place: int, table: Mapping[str, Any], *, where: str
) -> Iterator[tuple[str, Any]]:
    if not re.fullmatch(FINGER_PATTERN, name):
        raise ConfigError(
            f"{where}: a finger called {name!r}, "
            "but a name has up to 16 small letters, digits, hyphens, as in [index]"
        )
    for key in table:
        if key not in OWN_SETTINGS:
            near = (
                did_you_mean(key, OWN_SETTINGS)
                or f"; there are {', '.join(OWN_SETTINGS)}"
            )
            raise ConfigError(
                f"{where}: [{name}] has {key}, which is no setting of a finger{near}"
            )
    # Two inputs and one output for each finger, in order, where the table does not say
    # otherwise.
    placed = {
        "contact": f"system:capture_{2 * place + 1}",
        "air": f"system:capture_{2 * place + 2}",
        "port": f"system:playback_{place + 1}",
        "channel": place + 1,
    }
    for key, written in {**placed, **table}.items():
        setting = SETTINGS[OWN_SETTINGS[key]]
        # A channel of a PortAudio device may be written as a number.
        numbered = key in _INPUTS and type(written) is int
        value = str(written) if numbered else written
        yield setting.name, setting.check(value, where=f"{where}: [{name}]")


def _check_shared(fingers: Sequence[FingerSettings], *, where: str) -> None:
    # The finger that uses each input, port or channel, by its kind and value.
    users: dict[tuple[str, Any], str] = {}
    for finger in fingers:
        own = dict(finger.settings)
        for key in _UNSHARED:
            value = own[OWN_SETTINGS[key]]
            if value in _NO_PORT:
                continue
            kind = "input" if key in _INPUTS else key
            other = users.get((kind, value))
            if other is not None:
                raise ConfigError(
                    f"{where}: [{other}] and [{finger.name}] both use {kind} {value}; "
                    "give each its own"
                )
            users[kind, value] = finger.name
