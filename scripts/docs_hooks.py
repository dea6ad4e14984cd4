"""Turns the reStructuredText marks of docstrings, which mkdocstrings leaves as they are, into plain text."""

import re
from typing import Any


def on_page_content(html: str, **_: Any) -> str:
    """Return a page without ``::`` before code and without roles such as ``:class:``."""
    html = re.sub(r"::\s*</p>", ":</p>", html)
    return re.sub(r":(class|func|data|meth|mod|attr):(?=<code>)", "", html).replace(
        "<code>~tactophone.", "<code>tactophone."
    )
