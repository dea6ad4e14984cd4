"""The stone box: find the two rough stones of five by touch alone, in a browser."""

from tactophone.game.process import open_finger, serve_game
from tactophone.game.rounds import GameSettings

__all__ = ["GameSettings", "open_finger", "serve_game"]
