"""Adds to the site what the pages share with it, plain docstrings, code blocks that
copy commands alone, and the page that listens (`tactophone listen`)."""

import html
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from tactophone.app.listen import write_listening_site

SHARED = (
    Path(__file__).parent.parent
    / "packages"
    / "tactophone"
    / "src"
    / "tactophone"
    / "faces"
    / "web"
    / "static"
)

BLOCK = re.compile(r'<div class="[^"]*highlight"(?=><pre>(.*?)</pre></div>)', re.DOTALL)

COMMAND = re.compile(r"^\w*\$ (.*?(?:\\\n.*?)*)(?:\s{2,}\w+\$ .*)?$", re.MULTILINE)
"""What follows a prompt, ``$`` or ``robot$``, with its continued lines; of two prompts
in a line, the first."""


def on_config(config: Any) -> Any:
    """Lead edit links to the repository, if there is one."""
    config.edit_uri = "edit/main/docs/" if config.repo_url else ""
    return config


def on_files(files: Files, *, config: Any) -> Files:
    """Add the mark and the palette of the pages; the site's dark scheme is called
    slate."""
    palette = (SHARED.parents[2] / "core" / "palette.css").read_text(encoding="utf-8")
    palette = palette.replace(
        ':root[data-theme="dark"]', '[data-md-color-scheme="slate"]'
    )
    files.append(File.generated(config, "assets/palette.css", content=palette))
    files.append(
        File.generated(config, "assets/mark.svg", abs_src_path=str(SHARED / "mark.svg"))
    )
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Return a page without ``::`` before code and without roles such as ``:class:``;
    its blocks copy what is typed."""
    content = re.sub(r"::\s*</p>", ":</p>", content)
    content = re.sub(r":(class|func|data|meth|mod|attr):(?=<code>)", "", content)
    return BLOCK.sub(
        _copied, content.replace("<code>~tactophone.", "<code>tactophone.")
    )


def _copied(block: re.Match[str]) -> str:
    commands = COMMAND.findall(html.unescape(re.sub(r"<[^>]+>", "", block[1])))
    return (
        f'{block[0]} data-copy="{html.escape(chr(10).join(commands))}"'
        if commands
        else block[0]
    )


def on_post_build(config: Any, **_: Any) -> None:
    """Add the page that listens."""
    write_listening_site(Path(config.site_dir, "browser"))
