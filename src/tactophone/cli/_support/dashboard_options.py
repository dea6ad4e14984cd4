"""``--dashboard``: the operator's page, beside any verb that runs something to look at."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from tactophone.cli._support import terminal
from tactophone.dashboard import ADDRESS, Page, watch


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the page."""
    group = parser.add_argument_group("page")
    group.add_argument(
        "--dashboard", action="store_true", help="serve a page that shows the run, and print its address"
    )
    add_address(group)


def add_address(group: "argparse._ActionsContainer") -> None:
    """Add where a page listens."""
    group.add_argument(
        "--dashboard-address",
        metavar="HOST:PORT",
        default=ADDRESS,
        help="where the page listens; port 0 is any free one",
    )


@contextmanager
def shown(args: argparse.Namespace, name: str) -> Iterator[None]:
    """Serve the page of the run of that name meanwhile, if it was asked for."""
    if not args.dashboard:
        yield
        return
    with watch(name, args.dashboard_address) as page:
        announce(page)
        yield


def announce(page: Page) -> None:
    """Say where the page is; what is not on this machine alone is said to be in the open."""
    terminal.log().print(f"page: {page.url}", soft_wrap=True)
    if not page.private:
        terminal.log().print("Others on the network can read the page's traffic, the token too: use a trusted network.")
