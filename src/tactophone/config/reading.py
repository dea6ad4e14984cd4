"""Reads settings from TOML files and from the command line, and checks them."""

import dataclasses
import math
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactophone.config.sections import ANY, Settings
from tactophone.errors import ConfigError, did_you_mean


@dataclass(frozen=True, slots=True)
class Entry:
    """One setting, for help texts: its dotted name, default, words with range, and unit."""

    name: str
    default: Any
    words: str
    unit: str = ""
    choices: tuple[Any, ...] = ()


def entries() -> Iterator[Entry]:
    """Return all settings in the order of the file."""
    for section in _section_names():
        for entry in dataclasses.fields(type(getattr(Settings(), section))):
            meta = entry.metadata
            words = f"{meta['words']}{_range(meta.get('span', ANY), meta.get('unit', ''))}"
            yield Entry(f"{section}.{entry.name}", entry.default, words, meta.get("unit", ""), meta.get("choices", ()))


def read(path: Path, settings: Settings | None = None) -> Settings:
    """Read a TOML file over the defaults, or over other settings.

    Raises `ConfigError` when the file cannot be read, or holds an unknown setting or a value out of range.
    """
    settings = settings or Settings()
    tables = read_tables(
        path,
        missing=f"`tactophone settings > {path}` writes one to begin with",
        outside=f"write it under one of {_sections()}",
    )
    for section, table in tables.items():
        for name, value in table.items():
            settings = replace(settings, f"{section}.{name}", value, where=str(path))
    return settings


def read_tables(path: Path, *, missing: str, outside: str) -> dict[str, Mapping[str, Any]]:
    """Read a TOML file that holds tables alone.

    ``missing`` and ``outside`` end the error messages about a file that cannot be read, and an entry outside a table.
    Raises `ConfigError` in either case, or if the file is no TOML.
    """
    try:
        tables = tomllib.loads(path.read_text())
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; {missing}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from None
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise ConfigError(f"{path}: {name} stands outside a table; {outside}")
    return tables


def change(settings: Settings, assignments: Iterable[str]) -> Settings:
    """Apply ``section.name=value`` assignments; a value that is not TOML is taken as plain text.

    >>> change(Settings(), ["link.packet_duration=0.0025", "capture.source=finger"]).link.packet_duration
    0.0025
    """
    defaults = {entry.name: entry.default for entry in entries()}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise ConfigError(f"--set {assignment}: wanted section.name=value, such as link.port=48470")
        value = _value(text.strip())
        if isinstance(defaults.get(name.strip()), str) and not isinstance(value, str):
            value = text.strip()  # a device may be named "3"
        settings = replace(settings, name.strip(), value, where="--set")
    return settings


def replace(settings: Settings, name: str, value: Any, *, where: str) -> Settings:
    """Change the setting of a dotted name, checked; ``where`` is its origin, for the error message."""
    section, _, key = name.partition(".")
    known = {entry.name: entry for entry in entries()}
    if name not in known:
        hint = did_you_mean(name, known) or f"; sections are {_sections()}"
        raise ConfigError(f"{where}: there is no setting {name}{hint}")
    table = getattr(settings, section)
    declared = next(entry for entry in dataclasses.fields(table) if entry.name == key)
    checked = _checked(declared, value, f"{where}: {name} = {value!r}")
    return dataclasses.replace(settings, **{section: dataclasses.replace(table, **{key: checked})})


def _checked(declared: "dataclasses.Field[Any]", value: Any, found: str) -> Any:
    kind = type(declared.default)
    if kind is float and type(value) is int:
        # A whole number of more than 308 digits has no float; infinity is then refused by the range.
        value = float(value) if abs(value) < sys.float_info.max else math.inf if value > 0 else -math.inf
    if type(value) is not kind:
        raise ConfigError(f"{found}, but it is a {_KINDS[kind]}")
    choices = declared.metadata.get("choices", ())
    if choices and value not in choices:
        raise ConfigError(f"{found}, but it is one of {', '.join(choices)}{did_you_mean(str(value), choices)}")
    low, high = declared.metadata.get("span", ANY)
    # NaN is in no range; as a default it means "from the model", and is then allowed.
    unset = kind is float and math.isnan(value) and math.isnan(declared.default)  # type: ignore[arg-type]
    if kind in (int, float) and not low <= value <= high and not unset:
        raise ConfigError(f"{found}, but it is {_range((low, high), declared.metadata['unit']).removeprefix(', ')}")
    return value


_KINDS = {str: "text", int: "whole number", float: "number", bool: "switch: true or false"}


def _range(span: tuple[float, float], unit: str) -> str:
    if math.isinf(span[0]):
        return f", {unit}" if unit else ""
    return f", {span[0]:g} to {span[1]:g} {unit}".rstrip()


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _sections() -> str:
    return ", ".join(_section_names())


def _section_names() -> list[str]:
    return [section.name for section in dataclasses.fields(Settings) if section.name != "fingers"]
