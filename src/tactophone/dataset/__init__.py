"""Recordings, labels, surfaces, splits, the guided recorder.

``open_dataset`` reads what is known, ``check`` names what is wrong, ``split`` divides without leaks,
``write_metadata`` writes the one manifest format, and ``find_recording`` tells the truth about a single file.
"""

from tactophone.dataset.channels import channel_order
from tactophone.dataset.checks import check, usable
from tactophone.dataset.discovery import find_recording, open_dataset, truth_of
from tactophone.dataset.metadata import write_metadata
from tactophone.dataset.splits import Fold, split
from tactophone.dataset.values import Dataset, Problem, Recording, Segment, fingerprint, touch_at

__all__ = [
    "Dataset",
    "Fold",
    "Problem",
    "Recording",
    "Segment",
    "channel_order",
    "check",
    "find_recording",
    "fingerprint",
    "open_dataset",
    "split",
    "touch_at",
    "truth_of",
    "usable",
    "write_metadata",
]
