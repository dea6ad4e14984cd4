from pathlib import Path

import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.hand import each_finger, finger_named, of_finger, with_fingers
from tactophone.core.settings import Settings, change


def hand(tmp_path: Path, text: str) -> Settings:
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return with_fingers(Settings(), str(path))


def test_a_finger_has_its_own_settings_and_shares_the_rest(tmp_path: Path) -> None:
    settings = change(
        hand(
            tmp_path,
            '[thumb]\nprofile = "lra"\nceiling = 0.2\n[index]\nair = '
            '""\nthreshold_dbfs = -34',
        ),
        ["link.codec=pcm16"],
    )
    thumb, index = each_finger(settings)
    assert [finger.name for finger in settings.fingers] == ["thumb", "index"]
    assert (
        thumb.rendering.profile,
        thumb.rendering.ceiling,
        index.rendering.profile,
    ) == ("lra", 0.2, "graded")
    assert (
        index.capture.contact,
        index.capture.air,
        index.detector.threshold_dbfs,
    ) == ("system:capture_3", "", -34.0)
    assert (thumb.output.port, index.output.port, index.output.channel) == (
        "system:playback_1",
        "system:playback_2",
        2,
    )
    assert {thumb.link.codec, index.link.codec} == {"pcm16"}
    assert not thumb.is_hand


def test_a_number_makes_fingers_with_defaults() -> None:
    settings = with_fingers(Settings(), "10")
    assert len({finger.name for finger in settings.fingers}) == 10
    assert of_finger(settings, 9).capture.air == "system:capture_20"
    assert each_finger(Settings()) == [Settings()]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no finger, but a hand has 1 to 10"),
        ("".join(f"[f{n}]\n" for n in range(11)), "11 fingers, but a hand has 1 to 10"),
        ('[index]\nprofil = "paper"', r"\[index\] has profil.*did you mean profile"),
        ("[index]\nport_audio = 1", "no setting of a finger"),
        ("[index]\nprofile = 3", "rendering.profile = 3, but it is a text"),
        ("[index]\nceiling = 2", "0 to 1 of full drive"),
        (
            '[index]\n[thumb]\ncontact = "system:capture_2"',
            r"\[index\] and \[thumb\] both use input system:capture_2",
        ),
        ("[index]\nchannel = 2\n[thumb]\nchannel = 2", "both use channel 2"),
        ('[index]\nport = "a:b"\n[thumb]\nport = "a:b"', "both use port a:b"),
        ("[Zeigefinger]\n", "small letters"),
        ("contact = 3\n", "contact stands outside a table"),
        ("[index", "is not TOML"),
    ],
)
def test_a_wrong_hand_says_what_was_found_and_expected(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        hand(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0", "no finger"),
        ("11", "11 fingers"),
        ("-1", "no finger"),
        ("100000000", "100000000 fingers, but a hand has 1 to 10"),
    ],
)
def test_a_wrong_number_of_fingers(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        with_fingers(Settings(), text)


def test_a_missing_file_and_a_missing_finger() -> None:
    with pytest.raises(ConfigError, match="a number, or a TOML file"):
        with_fingers(Settings(), "no-such.toml")
    with pytest.raises(ConfigError, match="did you mean index"):
        finger_named(with_fingers(Settings(), "5"), "indx")
    with pytest.raises(ConfigError, match="name the hand with --fingers"):
        finger_named(Settings(), "index")


@pytest.mark.parametrize(
    "given",
    ["capture.contact=a:b", 'capture.air=""', "output.port=a:b", "output.channel=3"],
)
def test_a_port_that_fingers_cannot_share_is_refused_and_not_ignored(
    given: str,
) -> None:
    with pytest.raises(
        ConfigError, match="applies to a single finger; with --fingers, set"
    ):
        with_fingers(change(Settings(), [given]), "2")
