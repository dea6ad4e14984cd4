from pathlib import Path

import pytest

from tactophone import DatasetError
from tactophone.dataset import Recording, channel_order


def recording(*channels: str) -> Recording:
    return Recording(Path("a.wav"), "slate", channels=channels)


@pytest.mark.parametrize(
    ("channels", "count", "order"),
    [
        ((), 2, (0, 1)),
        ((), 1, (0,)),
        (("contact", "air"), 2, (0, 1)),
        (("air", "contact"), 2, (1, 0)),
        (("air", "contact"), 1, (1,)),
        (("air",), 1, (0,)),
    ],
)
def test_contact_comes_first_and_air_stands_in_where_there_is_no_other(
    channels: tuple[str, ...], count: int, order: tuple[int, ...]
) -> None:
    assert channel_order(recording(*channels), count=count) == order


@pytest.mark.parametrize("channels", [("air",), ("contact", "contact")])
def test_a_second_channel_is_never_made_up(channels: tuple[str, ...]) -> None:
    with pytest.raises(DatasetError, match="contact and air are needed; use the one-channel variant"):
        channel_order(recording(*channels), count=2)
