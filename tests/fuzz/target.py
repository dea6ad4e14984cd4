"""What a fuzzing target is, and what changes its inputs when no library guides by
coverage."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Run = Callable[[bytes], object]

_INTERESTING = bytes(
    [
        0,
        1,
        2,
        3,
        7,
        8,
        15,
        16,
        22,
        31,
        63,
        64,
        95,
        96,
        101,
        127,
        128,
        200,
        204,
        254,
        255,
    ]
)
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF)
_WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"1/0",
    b"null",
    b"true",
    b"[]",
    b"{}",
    b"[" * 200,
    b'"',
    b"\\ud800",
    b"\xff",
    b"\x00",
    b"../",
    b"/etc/passwd",
    b"\n",
    b"9" * 400,
    b"\x1b[2J",
)


@dataclass(frozen=True)
class Target:
    """A parser: bytes to begin with, a function that takes any, and the exceptions that
    its documentation names.

    ``prepare`` makes the function, and whatever it needs that takes long.
    """

    prepare: Callable[[], tuple[Sequence[bytes], Run]]
    documented: tuple[type[Exception], ...] = ()


def mutate(data: bytes, dice: random.Random) -> bytes:
    """Return ``data`` with one to eight random changes."""
    changed = bytearray(data)
    for _ in range(dice.choice((1, 1, 1, 2, 2, 4, 8))):
        at = dice.randrange(len(changed) + 1)
        match dice.randrange(8):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << dice.randrange(8)
            case 1 if changed:
                changed[at % len(changed)] = dice.choice(_INTERESTING)
            case 2:
                del changed[at : at + dice.choice((1, 1, 2, 4, 30))]
            case 3:
                changed[at:at] = dice.randbytes(dice.choice((1, 2, 4, 40)))
            case 4:
                del changed[at:]
            case 5:
                changed[at:at] = changed[at : at + dice.randrange(1, 40)] * dice.choice(
                    (1, 1, 5)
                )
            case 6:
                width = dice.choice((1, 2, 4))
                number = dice.choice(_NUMBERS) % (1 << 8 * width)
                changed[at : at + width] = number.to_bytes(
                    width, dice.choice(("big", "little"))
                )
            case _:
                changed[at : at + dice.choice((0, 0, 3))] = dice.choice(_WORDS)
    return bytes(changed)
