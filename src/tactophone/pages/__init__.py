"""Pages in a browser: the operator's page, the page of a guided command, and the stone box; each in its own process."""

from tactophone.pages.game import GameSettings, open_finger, serve_game
from tactophone.pages.server import Page, network_address, serve_guide, watch

__all__ = ["GameSettings", "Page", "network_address", "open_finger", "serve_game", "serve_guide", "watch"]
