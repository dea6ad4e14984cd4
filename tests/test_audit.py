"""What `make audit` says of a lock file, with a registry of our own."""

import json
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

AUDIT = Path(__file__).parent.parent / "scripts" / "audit"

ADVISORY = {
    "id": "PYSEC-1",
    "aliases": ["CVE-1"],
    "fixed_in": ["2.1"],
    "summary": "reads \x1b[2J too far\nand more",
}

ANSWERS = {
    "/pypi/good/1.0/json": {"vulnerabilities": []},
    "/pypi/bad/2.0/json": {
        "vulnerabilities": [ADVISORY, {"id": "OLD", "withdrawn": "2020-01-01"}]
    },
}


class Registry(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        answer = ANSWERS.get(self.path)
        self.send_response(200 if answer else 404)
        self.end_headers()
        self.wfile.write(json.dumps(answer).encode())

    def log_message(self, *_: object) -> None:
        pass


def audit(tmp_path: Path, *packages: str) -> subprocess.CompletedProcess[str]:
    lock = tmp_path / "lock.txt"
    lock.write_text(
        "# comment\n" + "".join(f"{each} \\\n    --hash=x\n" for each in packages)
    )
    server = ThreadingHTTPServer(("127.0.0.1", 0), Registry)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        return subprocess.run(
            [
                sys.executable,
                AUDIT,
                lock,
                "--index",
                f"http://127.0.0.1:{server.server_port}",
            ],
            capture_output=True,
            text=True,
            timeout=60,
        )
    finally:
        server.shutdown()
        server.server_close()


def test_each_advisory_is_one_line_with_the_version_that_mends_it(
    tmp_path: Path,
) -> None:
    done = audit(tmp_path, "good==1.0", "bad==2.0")
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        "bad 2.0: PYSEC-1 CVE-1, mended in 2.1: reads [2J too far",
        "audit: 1 advisories for 2 of 2 packages",
    ]


def test_a_package_without_an_answer_is_named(tmp_path: Path) -> None:
    done = audit(tmp_path, "good==1.0", "unknown==3.0")
    assert done.returncode == 0
    assert "audit: 0 advisories for 1 of 2 packages" in done.stdout
    assert "nothing known of unknown 3.0 (HTTP 404)" in done.stdout


@pytest.mark.parametrize("count", [5, 40])
def test_a_registry_without_metadata_of_versions_is_named_after_a_few_tries(
    count: int, tmp_path: Path
) -> None:
    done = audit(tmp_path, *(f"p{number}==1" for number in range(count)))
    assert done.returncode == 0
    assert done.stdout.startswith("audit: cannot say which vulnerabilities are known.")
    assert len(done.stdout.splitlines()) == 1
