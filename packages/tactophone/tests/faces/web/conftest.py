"""A run, its page, and a browser to look at it with."""

import os
from collections.abc import Iterator

import pytest

from tactophone.faces.web.server import Page, watch
from tests.browser import browser, chromium
from tests.faces.web.running import Run

__all__ = ["browser", "chromium"]


@pytest.fixture
def run() -> Iterator[Run]:
    """A run that is shown."""
    with Run(f"test-page-{os.getpid()}") as run:
        yield run


@pytest.fixture
def page(run: Run) -> Iterator[Page]:
    """Its page."""
    with watch(run.telemetry.name) as page:
        yield page
