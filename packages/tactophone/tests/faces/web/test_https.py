"""The page by https, with the certificate of `tactophone pair init`, under a name that
is secure only because of it."""

from pathlib import Path

import pytest
from selenium.webdriver.common.by import By

from tactophone.cli.page import qr_code
from tactophone.faces.web.server import watch
from tactophone.net.link.identity import CERTIFICATE_FILE, KEY_FILE, Identity
from tests.browser import start_chromium, text, wait
from tests.faces.web.running import Run


@pytest.mark.realtime
def test_https_gives_a_phone_its_sound(run: Run, tmp_path: Path) -> None:
    Identity.create("test").save(tmp_path)
    files = tmp_path / CERTIFICATE_FILE, tmp_path / KEY_FILE
    browser = start_chromium("--ignore-certificate-errors")
    try:
        with watch(
            run.telemetry.name, certificate=files, names=("phone.test",)
        ) as page:
            assert page.access.scheme == "https"
            browser.get(page.url.replace("127.0.0.1", "phone.test"))
            assert browser.execute_script("return isSecureContext") is True
            wait(browser, lambda: text(browser, "life") == "live", 20)
            browser.find_element(By.ID, "feel").click()
            wait(browser, lambda: "as sound" in text(browser, "feel-way"))
            assert "missing" not in text(browser, "feel-way")
            browser.get("about:blank")
    finally:
        browser.quit()


def test_a_qr_code_is_square_and_has_its_corners() -> None:
    pytest.importorskip("segno")
    lines = qr_code("http://192.168.1.5:8470/token/").splitlines()
    assert {len(line) for line in lines} == {len(lines[0])}
    assert 2 * len(lines) - len(lines[0]) in (0, 1)
    assert lines[1].strip().startswith("█▀▀▀▀▀█")
