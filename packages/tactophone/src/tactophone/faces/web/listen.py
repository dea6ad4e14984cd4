"""The page that listens: the detector runs in the browser, so that the server only
hands out files, and a folder of them is a site."""

import shutil
from importlib.resources import as_file
from pathlib import Path

from aiohttp import web

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
    as in `listen_page`."""
    folder.mkdir(parents=True, exist_ok=True)
    ignored = shutil.ignore_patterns(*LEFT_OUT)
    with as_file(views.STATIC) as static:
        shutil.copytree(static, folder / "static", dirs_exist_ok=True, ignore=ignored)
        shutil.copy(static / "listen.html", folder / "index.html")
    palette = views.PALETTE.read_text(encoding="utf-8")
    (folder / "static" / "palette.css").write_text(palette, encoding="utf-8")
    shutil.copy(model, folder / MODEL)
    (folder / TELEPHONE).write_text(constants, encoding="utf-8")
