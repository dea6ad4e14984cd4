"""The tips that may touch, a row each: model, class, hum, events, words and picture of
a tip derive from its row.

A further tip is a row here and a model file. The simulator renders a tip once
`tactophone_lab/simulation/finger.py` has its mechanics, and a wrong tip is noticed once
`benchmarks/tip_sounds.py` has fitted its sound.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class TipProperties:
    """What is known of a tip."""

    name: str
    words: str
    """Material and size, as shown to people."""
    model: str
    """Name of the shipped model for it: whoever states the tip need not name a
    model."""
    hard: bool
    """Whether impulses grow with roughness by geometry, whatever the gain and the room:
    a rough surface strikes a small hard tip in single clicks
    (docs/reference/simulator.md). A pad averages most of them away. The model of a hard
    tip was trained on an air microphone, without hum."""
    impulses: bool
    """Whether impulses are a sign of roughness at all: under soft rubber rough surfaces
    average, and smooth ones stick and slip."""
    air_led_db: float
    """How much more, in dB, a knock in the air exceeds the floor of the air microphone
    than it exceeds the contact microphone's. Simulated knocks do by 33 to 36 dB, with a
    stylus by 34 to 52; touch-downs of the pad by 10 to 22 dB, of a plastic rod by 15 to
    24, of a steel stylus, which shakes the air microphone, by up to 35."""
    picture: tuple[str, ...]
    """What `setup` shows: two lines of words, four of drawing, two of the mark that it
    leaves."""


_ROWS = (
    TipProperties(
        "rubber",
        "soft rubber of 4 MPa, 6 mm radius",
        "rubber",
        hard=False,
        impulses=False,
        air_led_db=28.0,
        picture=(
            " soft rubber,",
            " silicone",
            "  .-----.",
            " (       )",
            "  '-___-'",
            "===========",
            "mark: 2 mm,",
            "a round blot",
        ),
    ),
    TipProperties(
        "pad",
        "hard skin of 3.3 GPa on a silicone pad, 3 mm radius",
        "texture",
        hard=False,
        impulses=True,
        air_led_db=28.0,
        picture=(
            " hard skin on",
            " a silicone pad",
            "  .-----.",
            " (  ---  )",
            "  '-...-'",
            "===========",
            "mark: 0.1 mm",
            "to 0.5 mm",
        ),
    ),
    TipProperties(
        "plastic",
        "plastic rod of 8 mm",
        "plastic",
        hard=True,
        impulses=True,
        air_led_db=28.0,
        picture=(
            " rod or pen",
            " of plastic",
            "    | |",
            "    | |",
            "    \\_/",
            "===========",
            "mark: 0.1 mm",
            "",
        ),
    ),
    TipProperties(
        "stylus",
        "steel stylus of 5 mm",
        "stylus",
        hard=True,
        impulses=True,
        air_led_db=40.0,
        picture=(
            " steel rod",
            "",
            "    | |",
            "    | |",
            "     V",
            "===========",
            "mark: a dot",
            "",
        ),
    ),
)

TIPS: Mapping[str, TipProperties] = MappingProxyType({tip.name: tip for tip in _ROWS})
"""The tips by name, softest first, in the order of the rows of ``tips.npz``."""

TIP_NAMES = tuple(TIPS)

DEFAULT_TIP = "pad"
"""The tip of the paper's finger, as the simulator has it."""


def tip_picture() -> str:
    """Return the tips side by side, numbered from 1."""
    columns = [
        (f" {number} {tip.name}", *tip.picture)
        for number, tip in enumerate(TIPS.values(), 1)
    ]
    return "\n".join(
        "    " + "".join(f"{line:18}" for line in row).rstrip()
        for row in zip(*columns, strict=True)
    )
