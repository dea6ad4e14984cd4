"""``tactophone listen``: the page that listens through this browser's microphone, with
the detector in the page."""

import argparse
import threading
from pathlib import Path

from tactophone.cli import options, output, page

EXAMPLES = (
    "tactophone listen",
    "tactophone listen --lan",
    "tactophone listen --site build/listen",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--site",
        type=Path,
        metavar="FOLDER",
        help="write the page's files there instead, 5 MB for any web server",
    )
    options.add_settings(parser, "listen")


def run(args: argparse.Namespace) -> int:
    from tactophone.app.listen import serve_listening, write_listening_site

    if args.site is not None:
        write_listening_site(args.site)
        output.note(f"wrote the page that listens: {args.site / 'index.html'}")
        return 0
    settings = options.settings_of(args)
    if settings.page.lan:
        # A phone's browser gives its microphone to encrypted pages alone.
        settings = options.settings_of(args, ["page.https=true"])
    with serve_listening(**page.place(settings)) as served:
        page.announce(served, browser=settings.page.open, words=page.NOTHING_IS_SENT)
        output.log().print("serving the page until Ctrl-C")
        threading.Event().wait()
    return 0
