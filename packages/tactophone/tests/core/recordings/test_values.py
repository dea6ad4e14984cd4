from pathlib import Path

import pytest

from tactophone import DatasetError, Touch
from tactophone.core.recordings.values import Dataset, Recording, Segment, fingerprint
from tests.folders import write_sound


def test_a_dataset_keeps_only_what_is_labelled_smooth_or_rough() -> None:
    labels = (Touch.ROUGH, Touch.NONE, None, Touch.SMOOTH)
    dataset = Dataset(
        "d",
        Path("d"),
        tuple(
            Recording(Path(f"{n}.wav"), "s", label) for n, label in enumerate(labels)
        ),
    )
    assert [recording.label for recording in dataset.labelled().recordings] == [
        Touch.ROUGH,
        Touch.SMOOTH,
    ]


def test_a_dataset_without_labels_says_so() -> None:
    with pytest.raises(DatasetError, match="none of its 1 recordings is labelled"):
        Dataset("d", Path("d"), (Recording(Path("a.wav"), "s"),)).labelled()


def test_the_fingerprint_follows_the_content_and_not_the_place_or_the_order(
    tmp_path: Path,
) -> None:
    here, there = (
        write_sound(tmp_path / place / "a.wav") for place in ("here", "there")
    )
    other = write_sound(tmp_path / "b.wav", seed=1)
    first, moved = (Recording(path, "slate", Touch.ROUGH) for path in (here, there))
    second = Recording(other, "glass", Touch.SMOOTH)
    assert fingerprint([first, second]) == fingerprint([second, moved])
    assert fingerprint([first]) != fingerprint([Recording(here, "slate", Touch.SMOOTH)])
    write_sound(there, seed=2)
    assert fingerprint([first]) != fingerprint([moved])


def test_known_reads_fields_and_properties_and_nothing_else() -> None:
    recording = Recording(
        Path("a.wav"),
        "slate",
        Touch.ROUGH,
        session="day 1",
        properties={"pressure": "light"},
    )
    assert [
        recording.known(key) for key in ("session", "pressure", "label", "weather")
    ] == [
        "day 1",
        "light",
        "rough",
        "",
    ]


def test_an_unknown_touch_is_still_contact() -> None:
    assert Segment(0.0, 1.0, "contact").contact
    assert not Segment(0.0, 1.0, "no_contact").contact
