"""Print the rough spans in a log of ``--record``: ``python read_log.py run.mcap``."""

import sys
from pathlib import Path

from tactophone.core.types import Touch
from tactophone.live.log.mcap import LoggedPrediction, read_log

begun = None
for entry in read_log(Path(sys.argv[1])):
    if not isinstance(entry, LoggedPrediction):
        continue
    rough, end = entry.prediction.touch is Touch.ROUGH, entry.prediction.end
    if rough and begun is None:
        begun = end
    elif not rough and begun is not None:
        print(f"rough from {begun:.2f} to {end:.2f} s")
        begun = None
