"""The two ends of the stone box, each for a process of its own: the page's server, and
the finger at the robot."""

from functools import partial
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from tactophone.core.settings import Settings
from tactophone.core.types import Source
from tactophone.faces.web.server import Page
from tactophone_lab.game.stone_box import GameSettings

if TYPE_CHECKING:
    from aiohttp import web


def serve_game(game: GameSettings, address: str | None = None, **place: Any) -> Page:
    """Serve the stone box's page in a process of its own; ``place`` as in
    `tactophone.faces.web.server.Page`.

    Raises `TactophoneError` if the address is not available, or the web server is not
    installed.
    """
    return Page(partial(_application, game), address, **place)


def open_finger(inbox: Connection, settings: Settings) -> Source:
    """Open the finger that follows the messages of the page; call it in the process
    that reads its sound."""
    from tactophone_lab.game.player_finger import StoneBoxSource

    return StoneBoxSource(
        inbox, block_size=settings.capture.block_size, tip=settings.capture.tip
    )


def _application(game: GameSettings) -> "web.Application":
    from tactophone_lab.game.game_server import game_application

    return game_application(game)
