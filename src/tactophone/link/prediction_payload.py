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
"""

import math
import struct
from dataclasses import replace

from tactophone.errors import PacketError
from tactophone.link.packet import CLOCK_RATE
from tactophone.types import Prediction, Touch

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

    Raises
    ------
    PacketError
        When the bytes are not a prediction.
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


def _to_16_bits(share: float) -> int:
    return round(_ONE * max(0.0, min(share, 1.0)))
