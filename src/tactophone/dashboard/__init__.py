"""The operator's page: a web server in its own process that reads telemetry and sends requests."""

from tactophone.dashboard.feed import WatchedRun
from tactophone.dashboard.message import pack, step_table
from tactophone.dashboard.process import Page, guide, network_address, watch

__all__ = ["Page", "WatchedRun", "guide", "network_address", "pack", "step_table", "watch"]
