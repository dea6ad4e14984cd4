"""The page an operator looks at: the only room that imports asyncio."""

from tactophone.dashboard.process import ADDRESS, Page, play, watch
from tactophone.game.rounds import Box

__all__ = ["ADDRESS", "Box", "Page", "play", "watch"]
