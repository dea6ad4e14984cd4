"""The certificate of a page is replaced while the page is served."""

import socket
import ssl
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tactophone.cli import page as cli_page
from tactophone.core.settings import Settings, change
from tactophone.faces.web.server import Page, watch
from tactophone.net.link.identity import CERTIFICATE_FILE, KEY_FILE, Identity
from tests.faces.web.running import Run


def shown(page: Page) -> str:
    """Return the fingerprint that a browser would see."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    with (
        socket.create_connection(("127.0.0.1", urlsplit(page.url).port)) as raw,
        context.wrap_socket(raw) as connection,
    ):
        found = connection.getpeercert(binary_form=True)
        assert found
        return sha256(found).digest().hex(":").upper()


@pytest.mark.realtime
def test_a_certificate_renewed_in_a_run_is_shown_to_the_next_browser(
    run: Run, tmp_path: Path
) -> None:
    first, second = Identity.create("first"), Identity.create("second")
    first.save(tmp_path)
    second.save(tmp_path / "new")
    files = tmp_path / CERTIFICATE_FILE, tmp_path / KEY_FILE
    with watch(run.telemetry.name, certificate=files) as page:
        assert shown(page) == first.fingerprint
        # A renewal replaces one file after the other, and may be seen in between.
        (tmp_path / "new" / CERTIFICATE_FILE).replace(files[0])
        assert shown(page) == first.fingerprint
        (tmp_path / "new" / KEY_FILE).replace(files[1])
        assert shown(page) == second.fingerprint
        files[0].unlink()
        assert shown(page) == second.fingerprint


def ending(folder: Path, after: timedelta) -> None:
    """Save an identity whose certificate ends then."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "page")])
    now = datetime.now(UTC)
    builder = (
        x509.CertificateBuilder(name, name, key.public_key(), 7)
        .not_valid_before(now - timedelta(days=400))
        .not_valid_after(now + after)
    )
    Identity(key, builder.sign(key, hashes.SHA256())).save(folder)


@pytest.mark.parametrize(
    ("days", "said"), [(-1, True), (3, True), (90, False), (10_000, False)]
)
def test_a_certificate_that_ends_soon_is_named_with_what_to_do(
    days: int, said: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ending(tmp_path, timedelta(days=days))
    changes = ["page.https=true", f"link.identity={tmp_path}"]
    cli_page.place(change(Settings(), changes))
    printed = " ".join(capsys.readouterr().err.split())
    assert ("browsers refuse it from then on" in printed) is said
