from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.hand import with_fingers
from tactophone.core.settings import (
    SETTINGS,
    Settings,
    change,
    read_settings,
    set_value,
)


def test_defaults_yield_to_the_file_and_that_to_set(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        '[link]\nport = 5000\npeer = "operator.local"\n[rendering]\nceiling = 1\n'
    )
    settings = change(read_settings(path), ["link.port=6000"])
    assert (settings.link.port, settings.link.peer, settings.rendering.ceiling) == (
        6000,
        "operator.local",
        1.0,
    )
    assert settings.capture == Settings().capture


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("link.packet_length=0.005", "did you mean link.packet_duration"),
        ("telephone.ring=1", "sections are capture, link"),
        ("link.port", "section.name=value"),
        ("link.packet_duration=5", r"5, but it is 0.0005 to 0.02 s"),
        ("link.codec=mp3", "one of opus, pcm16"),
        ("link.port=true", "whole number"),
        ("rendering.muted=1", "switch"),
        ("rendering.ceiling=nan", "0 to 1 of full drive"),
    ],
)
def test_a_wrong_setting_says_what_was_found_and_expected(
    assignment: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        change(Settings(), [assignment])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("port = 5", "outside a table"),
        ("[link]\nprot = 5", "link.port"),
        ("[link]\npeer = 7", "text"),
        ("[link", "not TOML"),
        (None, "tactophone settings"),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "robot.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError, match=message) as error:
        read_settings(path)
    assert "robot.toml" in str(error.value)


@pytest.mark.parametrize("read", [read_settings, partial(with_fingers, Settings())])
def test_a_file_of_a_stranger_is_refused_by_its_size_before_it_is_parsed(
    read: Callable[[Any], Settings], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[link]\nport = 5000\n".ljust(65_537))
    parse = Mock()
    monkeypatch.setattr("msgspec.toml.decode", parse)
    with pytest.raises(
        ConfigError, match=r"robot.toml: 65537 bytes, but at most 65536"
    ):
        read(str(path) if isinstance(read, partial) else path)
    assert not parse.called


def test_a_file_of_the_largest_size_is_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[link]\nport = 5000\n".ljust(65_536))
    assert read_settings(path).link.port == 5000


def test_every_default_would_be_accepted() -> None:
    for entry in SETTINGS.values():
        set_value(Settings(), entry.name, entry.default, where="test")
        assert entry.words


def test_texts_with_equals_signs_and_spaces_stay_whole() -> None:
    settings = change(Settings(), ["capture.device=hw:0, slot = 3"])
    assert settings.capture.device == "hw:0, slot = 3"


def test_a_text_may_look_like_a_number() -> None:
    assert change(Settings(), ["capture.device=3"]).capture.device == "3"
