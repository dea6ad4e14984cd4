"""The site of the page that listens, written into a folder from anywhere."""

from pathlib import Path

import pytest

from tactophone.app.listen import write_listening_site
from tactophone.core.errors import ConfigError


def test_a_site_is_written_through_no_link(tmp_path: Path) -> None:
    site = tmp_path / "site"
    write_listening_site(site)
    files = sorted(path for path in site.rglob("*") if path.is_file())
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for path in files:
        path.unlink()
        path.symlink_to(victim)
    write_listening_site(site)
    assert victim.read_text() == "mine"
    assert all(path.is_file() and not path.is_symlink() for path in files)


def test_a_folder_of_a_site_that_leads_elsewhere_is_refused(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    site = tmp_path / "site"
    for folder in (elsewhere, site):
        folder.mkdir()
    (site / "static").symlink_to(elsewhere)
    with pytest.raises(ConfigError, match="is a link to another folder: remove it"):
        write_listening_site(site)
    assert not list(elsewhere.iterdir())
