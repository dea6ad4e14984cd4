"""``--dashboard``: the operator's page for every verb with a run to show."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tactophone.cli._support import terminal

if TYPE_CHECKING:
    from tactophone.dashboard import Page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--dashboard`` and its address."""
    group = parser.add_argument_group("page")
    group.add_argument(
        "--dashboard", action="store_true", help="serve a page that shows the run, and print its address"
    )
    add_address(group)


def add_address(group: "argparse._ActionsContainer") -> None:
    """Add the address of a page."""
    group.add_argument(
        "--dashboard-address",
        metavar="HOST:PORT",
        help="address of the page; port 0 is any free port (default: 127.0.0.1:0, this machine only)",
    )


@contextmanager
def shown(args: argparse.Namespace, name: str) -> Iterator[None]:
    """Serve the page of a run by its name within the context, if ``--dashboard`` is set."""
    if not args.dashboard:
        yield
        return
    from tactophone.dashboard import watch  # for this option alone: it imports a web server's libraries

    with watch(name, args.dashboard_address) as page:
        announce(page)
        yield


def announce(page: "Page") -> None:
    """Print the page's address, with a warning if other machines can reach it."""
    terminal.log().print(f"page: {page.url}", soft_wrap=True)
    if not page.private:
        terminal.log().print("The page's traffic, its token too, can be read on the network: use a trusted one.")
