"""Print the rough spans in a log of ``--record``: ``python read_log.py run.mcap``."""

import sys
from pathlib import Path

from tactophone.bridges.mcap import LoggedPrediction, read_log
from tactophone.types import Touch

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
