"""The ROS bridge against Fast DDS, which nobody here wrote; skipped without Debian's
libfastrtps-dev and fastddsgen."""

import shutil
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds")

from tactophone.faces.bridges.ros import RosBridge
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.bridges.test_osc import STEP
from tests.faces.bridges.test_ros import URI

SOURCES = Path(__file__).parent / "fastdds"
DOMAIN = 92  # apart from the domains of test_ros.py, which may run beside it


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not shutil.which("fastddsgen") or not Path("/usr/include/fastdds").exists():
        pytest.skip("no Fast DDS here: apt-get install libfastrtps-dev fastddsgen g++")
    folder = tmp_path_factory.mktemp("fastdds")
    for name in ("tactophone.idl", "reader.cpp"):
        shutil.copy(SOURCES / name, folder)
    subprocess.run(
        ["fastddsgen", "-replace", "tactophone.idl"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    command = [
        "g++",
        "-std=c++14",
        "-O0",
        "-w",
        "reader.cpp",
        "tactophone.cxx",
        "tactophonePubSubTypes.cxx",
    ]
    subprocess.run(
        [*command, "-lfastrtps", "-lfastcdr", "-o", "reader"], cwd=folder, check=True
    )
    return folder / "reader"


@pytest.mark.realtime
@pytest.mark.slow
def test_fast_dds_reads_predictions_and_its_one_stop_is_one_stop(
    reader: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    stops = 0
    with (
        Telemetry("test-fastdds") as telemetry,
        RosBridge(telemetry.name, domain=DOMAIN) as bridge,
    ):
        other = subprocess.Popen(
            [reader, str(DOMAIN), "30"], stdout=subprocess.PIPE, text=True
        )
        until = (left := time.monotonic()) + 40
        while time.monotonic() < until and (
            other.poll() is None or time.monotonic() < left + 1
        ):
            left = time.monotonic() if other.poll() is None else left
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            stops += sum(request.action == "stop" for request in telemetry.requests())
            time.sleep(0.02)
    words = other.communicate()[0].split()
    assert other.returncode == 0, words
    assert int(words[1]) >= 20
    assert words[3] == "48000"
    assert 0 <= float(words[5]) <= 1
    assert stops == 1
