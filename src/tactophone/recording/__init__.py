"""The guided recorder: the paper's protocol, a writer that survives kills and full disks, and a check of each take."""

from tactophone.recording.protocol import PROTOCOL, Key, Stage
from tactophone.recording.recorder import RecordedObject, Recorder, SessionPlan
from tactophone.recording.safe_writer import recording_in, recover

__all__ = ["PROTOCOL", "Key", "RecordedObject", "Recorder", "SessionPlan", "Stage", "recording_in", "recover"]
