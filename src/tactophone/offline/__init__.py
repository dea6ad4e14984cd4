"""Recordings through the pipeline: vibration, timeline and figure on disk. What `tactophone feel` runs."""

from tactophone.offline.peaks import PeakEnvelope
from tactophone.offline.plots import draw_recording
from tactophone.offline.prepared_source import Preparation, PreparedSource
from tactophone.offline.process_recording import OutputFiles, RunSummary, process_recording
from tactophone.offline.run_recorder import RunRecorder
from tactophone.offline.run_summary import RunScores, score_run

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
