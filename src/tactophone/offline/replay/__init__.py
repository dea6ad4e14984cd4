"""Logs of live runs: computed again, compared, rendered, and read as sound. Needs the link's libraries."""

from tactophone.offline.replay.log_sound import add_sound, decoded_sessions, joined, write_sound
from tactophone.offline.replay.logged_run import LoggedEndpoint, settings_of
from tactophone.offline.replay.run_again import Comparison, RenderedFinger, Replay, write_replay

__all__ = [
    "Comparison",
    "LoggedEndpoint",
    "RenderedFinger",
    "Replay",
    "add_sound",
    "decoded_sessions",
    "joined",
    "settings_of",
    "write_replay",
    "write_sound",
]
