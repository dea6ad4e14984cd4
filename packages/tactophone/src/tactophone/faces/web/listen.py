"""The page that listens: the detector runs in the browser, so that the server only
hands out files, and a folder of them is a site."""

import shutil
from importlib.resources import as_file
from pathlib import Path

from aiohttp import web

from tactophone.core.errors import ConfigError
from tactophone.core.processes import make_room
from tactophone.faces.web import views

MODEL = "model.onnx"
"""Address of the model file, beside the page."""

TELEPHONE = "telephone.js"
"""Address of the module with the telephone's own constants."""

LEFT_OUT = ("index.html", "try.html", "guide.html", "listen.html")
"""Pages that are no part of the site; the last is its ``index.html``."""


def listen_page(model: Path, constants: str) -> web.Application:
    """Build the page.

    - ``model``: a model file for one microphone.
    - ``constants``: JavaScript that exports what ``listen.js`` and ``touch.js`` import
      of ``telephone.js``.
    """
    app = web.Application()
    app[views.RUNS_WASM] = True

    async def send_model(request: web.Request) -> web.StreamResponse:
        return web.FileResponse(model)

    async def send_constants(request: web.Request) -> web.StreamResponse:
        return web.Response(text=constants, content_type="text/javascript")

    app.router.add_get("/", views.page(views.STATIC / "listen.html"))
    app.router.add_get(f"/{MODEL}", send_model)
    app.router.add_get(f"/{TELEPHONE}", send_constants)
    return app


def write_site(folder: Path, model: Path, constants: str) -> None:
    """Write the page's files into a folder, which any web server can serve; arguments
    as in `listen_page`, errors as in `room_in`."""
    with as_file(views.STATIC) as static:
        for source in sorted(static.rglob("*")):
            name = source.relative_to(static)
            if source.is_file() and name.name not in LEFT_OUT:
                shutil.copy(source, room_in(folder, Path("static") / name))
        shutil.copy(static / "listen.html", room_in(folder, Path("index.html")))
    palette = views.PALETTE.read_text(encoding="utf-8")
    where = room_in(folder, Path("static", "palette.css"))
    where.write_text(palette, encoding="utf-8")
    shutil.copy(model, room_in(folder, Path(MODEL)))
    room_in(folder, Path(TELEPHONE)).write_text(constants, encoding="utf-8")


def room_in(folder: Path, name: Path) -> Path:
    """Return the path of a file to write below a folder, which may have come from
    anywhere: nothing is written through its links.

    Raises `ConfigError` if a folder on the way is a link.
    """
    path = folder / name
    for parent in list(name.parents)[:-1]:
        if (folder / parent).is_symlink():
            raise ConfigError(
                f"{folder / parent} is a link to another folder: remove it, or choose "
                "another --site"
            )
    path.parent.mkdir(parents=True, exist_ok=True)
    make_room(path)
    return path
