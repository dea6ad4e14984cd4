from pathlib import Path

import pytest

from tactophone.app.runs import both_sides
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings, change
from tactophone.live.runtime import pairing


@pytest.mark.parametrize("linked", [False, True])
def test_the_vibration_overwrites_no_recording_that_is_heard(
    linked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file named twice was gone, and the run ended in order."""

    def begin(*_: object, **__: object) -> None:
        raise AssertionError("both sides began")

    monkeypatch.setattr(pairing, "both_sides", begin)
    heard = written = tmp_path / "stroke.wav"
    heard.write_bytes(b"sound")
    if linked:
        written = tmp_path / "vibration.wav"
        written.symlink_to(heard)
    settings = change(
        Settings(),
        [
            "capture.source=file",
            f"capture.device={heard}",
            "output.actuator=file",
            f"output.device={written}",
        ],
    )
    with (
        pytest.raises(ConfigError, match="would overwrite the recording"),
        both_sides(settings, name="test-own-source"),
    ):
        pass
    assert heard.read_bytes() == b"sound"
