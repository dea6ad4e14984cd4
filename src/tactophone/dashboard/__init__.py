"""The page an operator looks at: the only room that imports asyncio."""

from tactophone.dashboard.process import ADDRESS, Page, watch

__all__ = ["ADDRESS", "Page", "watch"]
