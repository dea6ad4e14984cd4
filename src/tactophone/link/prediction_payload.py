"""One prediction in 16 bytes, for links too slow for sound.

===========  =====================  ==============================================
bytes        field                  encoding
===========  =====================  ==============================================
0            touch                  0 none, 1 smooth, 2 rough
1            faulty                 1 when sound or model output was invalid, else 0
2-7          probabilities          three times 16 bits, 65535 is 1
8-9          roughness              16 bits, 65535 is 1
10-11        level                  hundredths of dBFS; the lowest number is -inf
12-15        length of the window   samples at 48 kHz; it ends at the timestamp
===========  =====================  ==============================================

Predictions of a hand whose windows end together share a payload: for each, a byte with the number of fingers (upper
four bits) and the finger, counted from 0, and then these 16.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import replace

from tactophone.errors import PacketError
from tactophone.link.packet import CLOCK_RATE, Payload, PayloadType
from tactophone.types import MOST_FINGERS, Prediction, Touch

_LAYOUT = struct.Struct("!BBHHHHhI")
_ONE = 65_535
_SILENT = -32_768


def write_prediction(prediction: Prediction) -> bytes:
    """Encode a prediction without its end, which is the packet's timestamp; non-finite values become a fault."""
    shares = (*prediction.probabilities, prediction.roughness)
    if not all(map(math.isfinite, shares)) or math.isnan(prediction.level_dbfs):
        return write_prediction(
            replace(prediction, probabilities=(1, 0, 0), roughness=0, level_dbfs=-math.inf, faulty=True)
        )
    length = round((prediction.end - prediction.start) * CLOCK_RATE)
    level = round(100 * max(_SILENT / 100, min(prediction.level_dbfs, 327.0)))
    return _LAYOUT.pack(prediction.touch, prediction.faulty, *map(_to_16_bits, shares), level, max(0, length))


def read_prediction(content: bytes, *, end: float) -> Prediction:
    """Decode a prediction whose window ended at ``end`` seconds.

    Raises `PacketError` when the bytes are not a prediction.
    """
    if len(content) != _LAYOUT.size:
        raise PacketError(f"a prediction of {len(content)} bytes, but it has {_LAYOUT.size}")
    touch, faulty, *shares, roughness, level, length = _LAYOUT.unpack(content)
    if touch not in list(Touch) or not sum(shares):
        raise PacketError(f"a prediction of touch {touch} with probabilities {shares}; there are {len(Touch)} touches")
    none, smooth, rough = (share / sum(shares) for share in shares)
    return Prediction(
        probabilities=(none, smooth, rough),
        touch=Touch(touch),
        roughness=roughness / _ONE,
        level_dbfs=-math.inf if level == _SILENT else level / 100,
        start=end - length / CLOCK_RATE,
        end=end,
        faulty=bool(faulty),
    )


def write_predictions(predictions: Mapping[int, Prediction], *, fingers: int) -> tuple[PayloadType, bytes]:
    """Encode predictions by finger, of windows that end together.

    >>> silence = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -60.0, 0.0, 0.256)
    >>> kind, content = write_predictions({1: silence}, fingers=5)
    >>> kind.name, content[:3].hex(" ")
    ('HAND_PREDICTION', '51 00 00')
    """
    if fingers == 1:
        return PayloadType.PREDICTION, write_prediction(predictions[0])
    records = [bytes([fingers << 4 | finger]) + write_prediction(each) for finger, each in predictions.items()]
    return PayloadType.HAND_PREDICTION, b"".join(records)


def read_predictions(payload: Payload, *, end: float) -> tuple[dict[int, Prediction], int]:
    """Decode predictions whose windows ended at ``end`` seconds; returns them by finger, and the number of fingers.

    Raises `PacketError` when the bytes are not predictions of one hand, each of another finger.
    """
    if payload.kind == PayloadType.PREDICTION:
        return {0: read_prediction(payload.content, end=end)}, 1
    content, size = payload.content, 1 + _LAYOUT.size
    records = [content[start : start + size] for start in range(0, len(content), size)]
    predictions = {record[0] & 15: read_prediction(record[1:], end=end) for record in records}
    counts = {record[0] >> 4 for record in records}
    if len(counts) != 1 or len(predictions) != len(records):
        raise PacketError(f"{len(records)} predictions of a hand, but of hands with {sorted(counts)} fingers, or twice")
    fingers = counts.pop()
    if not 2 <= fingers <= MOST_FINGERS or max(predictions) >= fingers:
        raise PacketError(f"a prediction of finger {max(predictions)} of {fingers}; a hand has 2 to {MOST_FINGERS}")
    return predictions, fingers


def _to_16_bits(share: float) -> int:
    return round(_ONE * max(0.0, min(share, 1.0)))
