from pathlib import Path

from tactophone.core.recordings.values import (
    Recording,
    cut_slides,
    first_slide,
    read_slides,
    slides_over,
)

LISTED = Recording(
    Path("a.flac"), "slate", properties={"slides": "0.500-1.000 1.500-2.000"}
)
UNKNOWN = Recording(Path("b.flac"), "slate")


def test_a_touch_counts_from_its_first_slide() -> None:
    assert first_slide(LISTED, 0.2, 1.2) == 0.5
    assert first_slide(LISTED, 0.7, 1.2) == 0.7
    assert first_slide(LISTED, 1.1, 1.4) is None


def test_without_the_property_it_slides_throughout() -> None:
    assert read_slides(UNKNOWN) is None
    assert first_slide(UNKNOWN, 0.2, 1.2) == 0.2
    assert slides_over(UNKNOWN, 3.0)


def test_an_edge_is_crossed_sliding_or_not_at_all() -> None:
    assert slides_over(LISTED, 0.7)
    assert not slides_over(LISTED, 0.95)
    assert not slides_over(LISTED, 1.2)


def test_a_piece_keeps_its_slides() -> None:
    assert cut_slides(LISTED, 0.75, 1.25, place=2.75) == ((2.75, 3.0),)
    assert cut_slides(UNKNOWN, 0.75, 1.25, place=2.75) is None
