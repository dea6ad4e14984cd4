"""The verb that serves the page that listens, or writes it as a site."""

import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from tactophone.cli import main

pytestmark = pytest.mark.realtime


def test_a_site_holds_the_page_its_model_and_the_licence_of_its_runtime(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):  # the second time over the first
        assert main(["listen", "--site", str(tmp_path / "site")]) == 0
    assert str(tmp_path / "site" / "index.html") in capsys.readouterr().err
    written = {path.name for path in (tmp_path / "site").rglob("*") if path.is_file()}
    assert {"index.html", "model.onnx", "telephone.js", "palette.css"} <= written
    assert {"LICENSE", "ThirdPartyNotices.txt"} <= written
    assert "guide.html" not in written


def test_the_page_is_served_until_ctrl_c(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tactophone", "listen", "--no-open"]
    with subprocess.Popen(
        command, cwd=tmp_path, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        address = process.stderr.readline().partition("page: ")[2].strip()
        with urllib.request.urlopen(address, timeout=20) as answer:
            assert "Use this microphone" in answer.read().decode()
        with urllib.request.urlopen(f"{address}model.onnx", timeout=20) as answer:
            assert len(answer.read()) > 100_000
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 130
        assert "Traceback" not in process.stderr.read()
