"""Recordings through the pipeline: vibration, timeline and figure on disk. What `tactophone feel` runs."""

from tactophone.offline.plot import draw_recording
from tactophone.offline.prepare import Preparation, PreparedSource
from tactophone.offline.recording import (
    OutputFiles,
    PeakEnvelope,
    RunRecorder,
    RunScores,
    RunSummary,
    process_recording,
    score_run,
)

__all__ = [
    "OutputFiles",
    "PeakEnvelope",
    "Preparation",
    "PreparedSource",
    "RunRecorder",
    "RunScores",
    "RunSummary",
    "draw_recording",
    "process_recording",
    "score_run",
]
