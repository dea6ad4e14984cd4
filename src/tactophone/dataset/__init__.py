"""Data sets: recordings, their labels, checks, splits and conversion.

`open_dataset` reads the manifest, `check` reports what is wrong, `split` divides recordings without leaks,
`write_metadata` writes the one manifest format, and `ground_truth` returns the known labels of a single file.
"""

from tactophone.dataset.checks import DEFAULT_CONTACT_DBFS, check, check_consistency, usable, with_channels
from tactophone.dataset.convert import convert, set_split, write_card
from tactophone.dataset.heights import HeightReport, draw_heights, measure_heights, read_heights
from tactophone.dataset.layouts import FORMATS, REDUCED_OBJECTS, SPARE_OBJECT
from tactophone.dataset.metadata import FILE_NAME, holds_metadata, read_metadata, write_metadata
from tactophone.dataset.plots import draw_dataset
from tactophone.dataset.read import find_importable, find_recording, ground_truth, open_dataset
from tactophone.dataset.splits import KIN_SPLIT, SPLITS, Fold, kin_of, split, with_kin
from tactophone.dataset.values import (
    LABEL_NAMES,
    Dataset,
    Problem,
    Recording,
    Segment,
    channel_order,
    fingerprint,
    open_sound,
    touch_at,
)

__all__ = [
    "DEFAULT_CONTACT_DBFS",
    "FILE_NAME",
    "FORMATS",
    "KIN_SPLIT",
    "LABEL_NAMES",
    "REDUCED_OBJECTS",
    "SPARE_OBJECT",
    "SPLITS",
    "Dataset",
    "Fold",
    "HeightReport",
    "Problem",
    "Recording",
    "Segment",
    "channel_order",
    "check",
    "check_consistency",
    "convert",
    "draw_dataset",
    "draw_heights",
    "find_importable",
    "find_recording",
    "fingerprint",
    "ground_truth",
    "holds_metadata",
    "kin_of",
    "measure_heights",
    "open_dataset",
    "open_sound",
    "read_heights",
    "read_metadata",
    "set_split",
    "split",
    "touch_at",
    "usable",
    "with_channels",
    "with_kin",
    "write_card",
    "write_metadata",
]
