"""JACK by PipeWire, as today's desktops have it: a server of the test's own, with a sink that is no sound card."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

NEEDED = ("dbus-run-session", "pipewire", "wireplumber", "pw-jack")

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(not all(map(shutil.which, NEEDED)), reason=f"needs {', '.join(NEEDED)}"),
]

SINK = """
context.properties = { default.clock.rate = 48000 default.clock.quantum = 128 default.clock.min-quantum = 128 }
context.objects = [ { factory = adapter args = {
  factory.name = support.null-audio-sink node.name = "null" media.class = "Audio/Sink" audio.position = [ FL FR ]
} } ]
"""

SESSION = """
pipewire & server=$!
wireplumber & manager=$!
until pw-cli info all 2>/dev/null | grep -q '"null"'; do sleep 0.1; done
"$@"
kill $server $manager
"""

LISTED = """
import json
from dataclasses import asdict
from tactophone.devices.survey import survey
print(json.dumps(asdict(survey()[0])))
"""


RESTARTED = """
import json, os, signal, subprocess, time
from tactophone.devices.jack import JackClient

def render(_, outputs):
    for samples in outputs:
        samples[:] = 0.1
    calls.append(time.monotonic())

def until(condition):
    while not condition():
        time.sleep(0.02)

calls = []
client = JackClient("finger", render, inputs={}, outputs={"out": "null:playback_FL"})
client.open()
until(lambda: calls)
subprocess.run(["pkill", "-KILL", "-x", "-P", str(os.getppid()), "pipewire"], check=True)
until(lambda: client.fault)
fault, count = client.fault, len(calls)
client.revive()
time.sleep(0.1)
silent = len(calls) == count
subprocess.Popen(["pipewire"])
subprocess.Popen(["wireplumber"])
until(lambda: client.revive() or (client.fault == "" and len(calls) > count))
client.close()
print(json.dumps({"fault": fault, "silent": silent, "losses": client.losses}))
subprocess.run(["pkill", "-x", "-P", str(os.getpid()), "pipewire|wireplumber"], check=False)
"""


def listed(folder: Path, *before: str, program: str = LISTED) -> Any:
    """Return what a program prints, with a private folder for the server's sockets and settings."""
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder), "XDG_CONFIG_HOME": str(folder)}
    command = [*before, "pw-jack", sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    assert lines, done.stderr
    return json.loads(lines[-1])


@pytest.fixture
def sink(tmp_path: Path) -> None:
    settings = tmp_path / "pipewire" / "pipewire.conf.d" / "null.conf"
    settings.parent.mkdir(parents=True)
    settings.write_text(SINK)


@pytest.mark.usefixtures("sink")
def test_a_killed_one_is_a_fault_and_silence_until_its_successor_is_joined(tmp_path: Path) -> None:
    found = listed(tmp_path, "dbus-run-session", "--", "sh", "-c", SESSION, "sh", program=RESTARTED)
    assert "PipeWire is gone: start it again" in found["fault"]
    assert (found["silent"], found["losses"]) == (True, 1)


@pytest.mark.usefixtures("sink")
def test_its_sink_is_listed_by_its_name_with_what_to_type(tmp_path: Path) -> None:
    found = listed(tmp_path, "dbus-run-session", "--", "sh", "-c", SESSION, "sh")
    assert (found["system"], found["outputs"], found["sample_rate"]) == ("JACK by PipeWire", 2, 48_000)
    assert "output.port=null:playback_FL" in found["settings"]
    assert found["note"].startswith("periods of 128 samples")


def test_it_is_named_where_it_does_not_run(tmp_path: Path) -> None:
    assert "PipeWire does not answer: start it" in listed(tmp_path)["actuator"]
